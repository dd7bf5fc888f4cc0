//! The states of a board in which M410, M112 or M108 comes, or its host goes.

use std::io::Cursor;
use std::ops::Range;

use ferrostep_gpre::Encoding;
use ferrostep_printer::{HomeEnd, Profile};
use ferrostep_session::JobReplies;
use ferrostep_session::gpre::{self, Target};
use ferrostep_testkit::board_model::LOOK_AHEAD_BLOCKS;

/// Width of the machines, mm: small, so that homing does not take most of the test's time, and wide
/// enough for moves from the motors' place at power-on.
const SIZE_MM: i64 = 95;

/// The board's work.
pub enum Work {
    /// The board executes these lines.
    Lines(Vec<String>),
    /// The board receives this prepared job; the host sends none of it between these ms.
    Job(Vec<u8>, Range<u64>),
}

/// A state.
pub struct State {
    pub name: &'static str,
    pub profile: Profile,
    /// Blocks in the look-ahead ring.
    pub look_ahead: usize,
    /// Lines that come before.
    pub before: Vec<String>,
    pub work: Work,
    /// Silence after the work that belongs to it, ms.
    pub silence_ms: u64,
}

/// A built-in machine, made small.
fn machine(name: &str) -> Profile {
    let mut profile = ferrostep_profiles::load(name).unwrap();
    profile.size_10nm = [SIZE_MM * 100_000; 3];
    // The probe is then at X 31 and Y 21, above the bed.
    profile.safe_homing.home_at_10nm = profile.safe_homing.home_at_10nm.map(|_| [6_000_000, 2_400_000]);
    for homing in profile.homing.iter_mut().filter(|homing| homing.end == HomeEnd::Max) {
        homing.position_10nm = SIZE_MM * 100_000;
    }
    profile
}

fn owned(lines: &str) -> Vec<String> {
    lines.split(';').map(|line| line.trim().to_owned()).collect()
}

impl State {
    fn new(name: &'static str, profile: &str, before: &str, lines: &str) -> Self {
        Self {
            name,
            profile: machine(profile),
            look_ahead: LOOK_AHEAD_BLOCKS,
            before: owned(before),
            work: Work::Lines(owned(lines)),
            silence_ms: 0,
        }
    }

    fn with_look_ahead(self, look_ahead: usize) -> Self {
        Self { look_ahead, ..self }
    }

    fn then_silent(self, silence_ms: u64) -> Self {
        Self { silence_ms, ..self }
    }

    fn with_work(self, work: Work) -> Self {
        Self { work, ..self }
    }

    /// Returns true if E is what was pushed: a firmware retraction does not count in E,
    /// and a job has G92.
    pub fn tells_filament(&self) -> bool {
        matches!(&self.work, Work::Lines(lines) if !lines.iter().any(|line| line == "G10"))
    }

    /// All states.
    pub fn all() -> Vec<Self> {
        const NEAR_MIN: &str = "G28; G1 X8 Y7 Z3 F6000; M400";
        const NEAR_MAX: &str = "G28; G1 X87 Y88 Z3 F6000; M400";
        const HOMED: &str = "G28; G1 X5 Y5 Z3 F6000; M400; M82";
        const ARC: &str = "G2 I5 J0 E1 F1800; G3 X4 Y4 I2 J2 E2; G2 X0 Y0 I-2 J-2 E3; M400";
        vec![
            Self::new("G28, end stops at min", "cartesian", NEAR_MIN, "G28"),
            Self::new("G28, CoreXY, end stops at max", "corexy", NEAR_MAX, "G28"),
            Self::new("G28, stall and probe", "prusa-mini", NEAR_MAX, "G28"),
            Self::new("G28 X", "cartesian", NEAR_MIN, "G28 X"),
            Self::new("G28 X, stall", "prusa-mini", NEAR_MAX, "G28 X"),
            Self::new("G28 Z", "corexy", "G28; G1 Z1 F600; M400", "G28 Z"),
            Self::new("G1, long", "cartesian", "M82", "G1 X30 Y10 E1 F6000; G1 X0 E2; G1 X25 Y30 E3; G1 Z1; M400"),
            Self::new("G1, short", "corexy", HOMED, "M400").with_work(Work::Lines(short_moves())),
            Self::new("G1, short, ring of 3", "cartesian", "M82", "M400")
                .with_look_ahead(3)
                .with_work(Work::Lines(short_moves())),
            Self::new("G2, G3", "cartesian", "M82; M211 S0", ARC),
            Self::new("G2, G3, ring of 3", "cartesian", "M82; M211 S0", ARC).with_look_ahead(3),
            Self::new("G10, G11", "cartesian", "M83; M207 S2 Z1", "G1 X9 E1 F3000; G10; G1 X2; G11; G1 X5 E1; M400"),
            Self::new("G10, G11, ring of 3", "cartesian", "M83; M207 S2 Z1", "G1 X9 E1 F3000; G10; G1 X2; G11; M400")
                .with_look_ahead(3),
            Self::new("G4", "cartesian", "M82", "G1 X9 E1 F3000; G4 P700; G1 X2; G4 P30; M400"),
            Self::new("M400", "cartesian", "M82", "G1 X30 Y10 E1 F3000; M400"),
            Self::new("M106, M18", "cartesian", "M82", "G1 X9 E1 F1800; M106 S99; G1 X12; M107; M18; G1 X9; M84"),
            Self::new("M109", "cartesian", "M82", "G1 X9 E1 F1800; M109 S200"),
            Self::new("M109 R, above it", "cartesian", "M82", "G1 X9 E1 F1800; M109 R10"),
            Self::new("M190", "corexy", HOMED, "G1 X9 Y3 E1 F1800; M190 S60"),
            Self::new("idle", "cartesian", "M82", "G1 X9 E1 F3000; G1 X20 E2").then_silent(700),
            Self::new("prepared job", "cartesian", "M302 P1", "M400").with_work(Work::Job(job(600), 0..0)),
            Self::new("prepared job, its host pauses", "cartesian", "M302 P1", "M400")
                .with_work(Work::Job(job(600), 100..25_000)),
        ]
    }
}

/// Moves back and forth in pieces of some hundredths of a millimetre.
fn short_moves() -> Vec<String> {
    let place =
        |index: u32| [index * 5 + index % 3, (index / 40 % 2) * 40 + index % 40].map(|place| f64::from(place) / 100.0);
    let moves = (1..400).map(|index| {
        let [x, y] = place(index);
        format!("G1 X{x:.2} Y{y:.2} E{:.4} F9000", f64::from(index) * 0.002)
    });
    moves.chain(["M400".to_owned()]).collect()
}

/// A prepared job of this many moves, with commands in between.
fn job(moves: u32) -> Vec<u8> {
    let lines = (1..=moves).map(|index| {
        let [x, y] = [index * 7 % 30, index * 3 % 20].map(|place| f64::from(place) / 10.0 + 2.125);
        let command = ["", "M106 S77\n", "G92 E0\n", "M204 S900\n"][(index % 40 / 10) as usize];
        let command = if index % 10 == 0 { command } else { "" };
        format!("{command}G1 X{x} Y{y} Z0.3 E0.05 F9000\n")
    });
    let gcode = format!("M302 P1\nM83\n{}", lines.collect::<String>());
    let mut out = Cursor::new(Vec::new());
    let target = Target { out: &mut out, encoding: Encoding::Compact };
    let replies = JobReplies::new(|_: &str| {});
    gpre::prepare(&mut gcode.as_bytes(), None, machine("cartesian"), replies, target, |_, _| {}).unwrap();
    out.into_inner()
}
