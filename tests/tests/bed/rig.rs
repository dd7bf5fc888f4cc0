//! A printer with a probe on the virtual board, and the places of its nozzle over the sheet.

use std::cell::RefCell;
use std::path::Path;

use ferrostep_gcode::Reply;
use ferrostep_planner::StepObserver;
use ferrostep_printer::{Failure, Profile, Replies};
use ferrostep_session::Session;
use ferrostep_session::record::Observer;
use ferrostep_virtual_board::START_10NM;

/// The probe beside the nozzle, mm.
pub const PROBE_MM: [f64; 3] = [-20.0, 10.0, -1.2];

/// A bed of 200 mm with this table `[mesh]`.
pub fn profile(mesh: &str) -> Profile {
    machine(mesh, false)
}

/// The same with a round bed.
pub fn round(mesh: &str) -> Profile {
    machine(mesh, true)
}

fn machine(mesh: &str, is_round: bool) -> Profile {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../config/profiles/cartesian.toml");
    let mut text = std::fs::read_to_string(path).unwrap();
    // All of the bed is measured, to its ends, unless the table says otherwise.
    let whole = "[mesh]\narea_mm = { x = [0, 200], y = [0, 200] }\n";
    let mesh = match () {
        () if mesh.contains("area_mm") => mesh.to_owned(),
        () if mesh.contains("[mesh]\n") => mesh.replacen("[mesh]\n", whole, 1),
        () => format!("{whole}{mesh}"),
    };
    let [x, y, z] = PROBE_MM;
    let homing = format!(
        "[homing]\nraise_mm = 5\nhome_at_mm = {{ x = 120, y = 90 }}\nprobe_offset_mm = {{ x = {x}, y = {y}, z = {z} }}\n\
         bed_mm = {{ x = [0, 200], y = [0, 200], round = {is_round} }}\n\n{mesh}\n[homing.x]"
    );
    for (from, to) in [
        ("[homing.x]", homing.as_str()),
        ("[homing.z]\nend = \"min\"\nsensor = \"end-stop\"", "[homing.z]\nend = \"min\"\nsensor = \"probe\""),
        // Room for the probe, which is 20 mm to the left of and 10 mm behind the nozzle, to
        // reach all of the bed.
        ("size_mm = { x = 200,", "size_mm = { x = 220,"),
        ("\nsteps_per_mm", "\nlower_end_mm = { x = 0, y = -10, z = 0 }\nsteps_per_mm"),
        (
            "[homing.y]\nend = \"min\"\nsensor = \"end-stop\"\nposition_mm = 0",
            "[homing.y]\nend = \"min\"\nsensor = \"end-stop\"\nposition_mm = -10",
        ),
    ] {
        assert!(text.contains(from), "{from} in {text}");
        text = text.replacen(from, to, 1);
    }
    ferrostep_profiles::parse(&text, "bed").unwrap()
}

/// The printer's replies.
#[derive(Default)]
pub struct Said(RefCell<Vec<String>>);

impl Replies for Said {
    fn send(&self, reply: Reply<'_>) {
        self.0.borrow_mut().extend(reply.to_string().lines().map(str::to_owned));
    }
}

/// A step: the nozzle's true place, mm, whether the extruder pushes, and the tick.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    pub place_mm: [f64; 3],
    pub pushes: bool,
    pub tick: u64,
    pub axes: u8,
    pub directions: u8,
}

/// Counts the motors' steps from their true start.
pub struct Nozzle {
    steps: [i64; 3],
    steps_per_mm: [f64; 3],
    pub seen: Vec<Step>,
}

impl Nozzle {
    fn new(profile: &Profile) -> Self {
        let [x, y, z, _] = profile.steps_per_mm.map(|steps| steps.to_f64());
        let steps = profile.geometry().motor_steps(START_10NM).map(i64::from);
        Self { steps, steps_per_mm: [x, y, z], seen: Vec::new() }
    }
}

impl StepObserver for Nozzle {
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        for (motor, steps) in self.steps.iter_mut().enumerate() {
            if axes >> motor & 1 == 1 {
                *steps += if directions >> motor & 1 == 0 { 1 } else { -1 };
            }
        }
        let place_mm = [0, 1, 2].map(|axis| self.steps[axis] as f64 / self.steps_per_mm[axis]);
        let pushes = axes & 0b1000 != 0 && directions & 0b1000 == 0;
        self.seen.push(Step { place_mm, pushes, tick, axes, directions });
    }
}

impl Observer for Nozzle {
    fn redefined(&mut self, _: u64, _: [i64; 4]) {}
    fn move_ended(&mut self, _: u64, _: u32) {}
}

/// Outcome of the lines that were run.
pub struct Done {
    /// The failure of each line, as the printer reports it.
    pub failures: Vec<(String, Failure)>,
    /// All replies, the `ok`s left out.
    pub said: Vec<String>,
    /// X, Y, Z and E of the G-code, mm, after the last line.
    pub logical_mm: [f64; 4],
    /// Every step.
    pub steps: Vec<Step>,
}

impl Done {
    /// The one line with this beginning, without the beginning.
    pub fn line(&self, beginning: &str) -> &str {
        let mut lines = self.said.iter().filter_map(|line| line.strip_prefix(beginning));
        let line = lines.next().unwrap_or_else(|| panic!("no {beginning} in {:#?}", self.said));
        assert!(lines.next().is_none(), "{beginning} twice in {:#?}", self.said);
        line
    }

    /// The nozzle's true place at the end, mm.
    pub fn place_mm(&self) -> [f64; 3] {
        self.steps.last().unwrap().place_mm
    }

    /// Checks that no line has failed.
    #[track_caller]
    pub fn well(self) -> Self {
        assert!(self.failures.is_empty(), "{:?}", self.failures);
        self
    }
}

/// Executes lines on a machine that has just been switched on.
pub fn run<'l>(profile: &Profile, lines: impl IntoIterator<Item = &'l str>) -> Done {
    let session = Session::print(*profile, 128, Nozzle::new(profile), Said::default());
    let mut failures = Vec::new();
    let logical_mm = {
        let mut printer = session.printer();
        for (number, line) in (1..).zip(lines) {
            if let Err(failure) = session.run(printer.execute(number, line)) {
                failures.push((line.to_owned(), failure));
            }
        }
        session.run(printer.finish()).unwrap();
        printer.logical_10nm().map(|units| units as f64 / 1e5)
    };
    let said = session.replies().0.take().into_iter().filter(|line| line != "ok").collect();
    Done { failures, said, logical_mm, steps: session.into_observer().seen }
}

/// Height of the sheet below the nozzle, mm.
pub fn sheet_mm(profile: &Profile, [x, y]: [f64; 2]) -> f64 {
    let sheet = profile.mesh.unwrap().sheet;
    let [tilt_x, tilt_y] = sheet.tilt_10nm.map(|units| units as f64 / 1e5);
    let bend = sheet.bend_10nm as f64 / 1e5;
    let [u, v] = [x, y].map(|place| place / 100.0 - 1.0);
    bend + 0.5 * (tilt_x * u + tilt_y * v) - 0.5 * bend * (u * u + v * v)
}
