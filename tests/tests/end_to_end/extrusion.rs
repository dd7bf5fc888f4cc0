//! The extruder against the nozzle, step by step through whole prints (Wu 2024, eqs. 10 and 11): it
//! is never more than a step away from lambda times the nozzle's path, also in ramps and at
//! corners, whether lambda is the G-code's or the machine's.
//!
//! The nozzle's path is taken from the X and Y motors' own steps in the trace, so that the check
//! needs no time law.

use std::fs::File;
use std::path::Path;

use ferrostep_oracle::trace::{Record, TraceReader};
use ferrostep_oracle::trace_check::Slave;

use crate::end_to_end::command::{directory, example, ferrostep, file};

/// Profile cartesian.
const XY_STEPS_PER_MM: f64 = 80.0;
const E_STEPS_PER_MM: f64 = 95.0;

/// Tolerance for the nozzle's distance from its motors' last whole steps: half a step of each,
/// times lambda, in steps of the extruder; and for events that were joined.
const TOLERANCE_STEPS: f64 = 0.1;

/// A straight move of a job.
#[derive(Clone, Copy, Debug)]
struct Straight {
    line: u32,
    from_mm: [f64; 2],
    to_mm: [f64; 2],
    filament_mm: f64,
}

impl Straight {
    fn length_mm(&self) -> f64 {
        let [x, y] = [0, 1].map(|axis| self.to_mm[axis] - self.from_mm[axis]);
        x.hypot(y)
    }

    /// The part of the path that the motors have made.
    fn part(&self, xy_steps: [i64; 2]) -> f64 {
        let length_mm = self.length_mm();
        let along: f64 = (0..2)
            .map(|axis| {
                let way_mm = self.to_mm[axis] - self.from_mm[axis];
                (xy_steps[axis] as f64 / XY_STEPS_PER_MM - self.from_mm[axis]) * way_mm
            })
            .sum();
        (along / (length_mm * length_mm)).clamp(0.0, 1.0)
    }
}

/// The words of a line, comment cut.
fn word(line: &str, letter: char) -> Option<f64> {
    let words = line.split(';').next()?.split_ascii_whitespace();
    words.skip(1).find_map(|word| word.strip_prefix(letter)).map(|number| number.parse().unwrap())
}

/// The moves of a job of G0 and G1 with absolute coordinates that homes to zero, with the filament
/// of its E (absolute), or of its length.
fn moves(job: &str, mut lambda: impl FnMut(&str, bool) -> Option<f64>) -> Vec<Straight> {
    let (mut at, mut e, mut z) = ([0.0; 2], 0.0, 0.0);
    let mut moves = Vec::new();
    let mut relative_e = false;
    for (line, text) in (1..).zip(job.lines()) {
        let command = text.split([' ', ';']).next().unwrap_or_default();
        match command {
            "G92" => e = word(text, 'E').unwrap_or(e),
            "M82" => relative_e = false,
            "M83" => relative_e = true,
            "G0" | "G1" => {
                let to = [word(text, 'X').unwrap_or(at[0]), word(text, 'Y').unwrap_or(at[1])];
                let to_z = word(text, 'Z').unwrap_or(z);
                let told = word(text, 'E').map(|word| if relative_e { word } else { word - e });
                let length = (to[0] - at[0]).hypot(to[1] - at[1]);
                let by_length = lambda(text, command == "G1" && to_z == z).map(|lambda| lambda * length);
                let filament_mm = told.or(by_length).unwrap_or(0.0);
                if to != at || to_z != z || filament_mm != 0.0 {
                    moves.push(Straight { line, from_mm: at, to_mm: to, filament_mm });
                }
                (at, z) = (to, to_z);
                if !relative_e {
                    e += told.unwrap_or(0.0);
                }
            }
            _ => {}
        }
    }
    moves
}

/// The extruder's greatest error at any of its steps, in steps.
#[derive(Debug, Default)]
struct Deviations {
    steps: u64,
    of_the_machine: f64,
    /// The same of an extruder that steps with some of the master's steps by Bresenham, from one
    /// rounded position to the next; this one is made here, from the same X and Y steps.
    of_a_slave: f64,
}

impl Deviations {
    fn note(largest: &mut f64, before: i64, step: i64, ideal: f64) {
        let off = (before as f64 - ideal).abs().max(((before + step) as f64 - ideal).abs());
        *largest = largest.max(off);
    }
}

/// One move's step events: X, Y and E.
type Event = [i64; 3];

fn deviations(trace: &Path, moves: &[Straight]) -> Deviations {
    let mut found = Deviations::default();
    let mut moves = moves.iter();
    let (mut xy, mut e, mut ideal_start) = ([0i64; 2], 0i64, 0.0f64);
    let mut events: Vec<Event> = Vec::new();
    for record in TraceReader::new(File::open(trace).unwrap()).unwrap() {
        match record.unwrap() {
            Record::Step(event) => {
                let step = |axis: u8| {
                    let sign = if event.directions >> axis & 1 == 0 { 1 } else { -1 };
                    i64::from(event.axes >> axis & 1) * sign
                };
                events.push([step(0), step(1), step(3)]);
            }
            Record::PositionsRedefined { positions, .. } => {
                events.clear();
                xy = [positions[0].into(), positions[1].into()];
            }
            Record::MoveEnd { line, .. } => {
                let straight = moves.next().unwrap();
                assert_eq!(straight.line, line);
                one_move(straight, &events, &mut xy, &mut e, ideal_start, &mut found);
                ideal_start += straight.filament_mm * E_STEPS_PER_MM;
                assert!((e as f64 - ideal_start).abs() <= 0.5 + 1e-3, "line {line}: {e}, not {ideal_start}");
                events.clear();
            }
        }
    }
    assert_eq!(moves.next().map(|straight| straight.line), None);
    found
}

fn one_move(
    straight: &Straight,
    events: &[Event],
    xy: &mut [i64; 2],
    e: &mut i64,
    ideal_start: f64,
    found: &mut Deviations,
) {
    let displacement = straight.filament_mm * E_STEPS_PER_MM;
    let is_print = straight.length_mm() > 0.0 && displacement != 0.0;
    let totals: [i64; 2] = [0, 1].map(|axis| events.iter().map(|event| event[axis].abs()).sum());
    let master = usize::from(totals[1] > totals[0]);
    // The slaved extruder's position, and its steps in this move.
    let mut slave = ideal_start.round() as i64;
    let slave_steps = (ideal_start + displacement).round() as i64 - slave;
    let has_slave = slave_steps.abs() <= totals[master];
    let mut bresenham = Slave::new(totals[master], slave_steps.abs());
    for [x, y, step] in events {
        xy[0] += x;
        xy[1] += y;
        if !is_print {
            *e += step;
            continue;
        }
        let ideal = ideal_start + displacement * straight.part(*xy);
        if *step != 0 {
            found.steps += 1;
            Deviations::note(&mut found.of_the_machine, *e, *step, ideal);
            *e += step;
        }
        if has_slave && [x, y][master] != &0 && bresenham.steps() {
            Deviations::note(&mut found.of_a_slave, slave, slave_steps.signum(), ideal);
            slave += slave_steps.signum();
        }
    }
}

#[track_caller]
fn check(name: &str, job: &str, moves: &[Straight]) -> Deviations {
    let directory = directory();
    let (trace, path) = (directory.path().join("trace"), file(&directory, "job.gcode", job));
    let outcome =
        ferrostep(["print".as_ref(), path.as_os_str(), "--json".as_ref(), "--trace".as_ref(), trace.as_os_str()]);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    let filament_mm: f64 = moves.iter().map(|straight| straight.filament_mm).sum();
    let printed_mm = outcome.json()["filament_mm"].as_f64().unwrap();
    assert!((printed_mm - filament_mm).abs() < 1e-3, "{name}: {printed_mm} mm of filament, not {filament_mm}");
    let found = deviations(&trace, moves);
    println!("{name}: {found:?}");
    assert!(found.of_the_machine <= 1.0 + TOLERANCE_STEPS, "{name}: {found:?}");
    assert!(found.steps > 10_000, "{name}: {found:?}");
    found
}

/// Up to the change of the profile's limits this is an ordinary job.
fn cube() -> String {
    String::from_utf8(example("cube.gcode")).unwrap()
}

#[test]
fn filament_of_the_gcode_follows_the_nozzle() {
    let job = cube();
    let found = check("cube", &job, &moves(&job, |_, _| None));
    // An extruder that waits for the master's steps has a greater error than one
    // with its own times.
    assert!(found.of_a_slave > found.of_the_machine, "{found:?}");
}

/// The same path without E: travels by G0, retractions relative.
fn stripped(job: &str, settings: &str) -> String {
    let mut stripped = String::new();
    let mut e = 0.0;
    for line in job.lines() {
        let is_move = line.starts_with("G1 ");
        let told = word(line, 'E').map(|word| word - e);
        match (is_move, told) {
            (true, Some(filament)) if word(line, 'X').or(word(line, 'Y')).is_none() => {
                stripped += &format!("G1 E{filament:.5} F2100\n");
            }
            (true, Some(filament)) => {
                // Wipes retract while they move: their E stays as it was.
                let words = line.split(';').next().unwrap().split_ascii_whitespace();
                let kept = words.filter(|word| !word.starts_with('E')).collect::<Vec<_>>().join(" ");
                stripped += &if filament > 0.0 { kept } else { format!("{kept} E{filament:.5}") };
                stripped += "\n";
            }
            (true, None) => stripped += &format!("G0{}\n", line.strip_prefix("G1").unwrap()),
            (false, _) if line.starts_with("M82") => stripped += &format!("M83\n{settings}\n"),
            (false, _) => stripped += &format!("{line}\n"),
        }
        if is_move || line.starts_with("G92") {
            e = word(line, 'E').unwrap_or(e);
        }
    }
    stripped
}

#[test]
fn filament_by_length_follows_the_nozzle() {
    let job = stripped(&cube(), "M795 S1 H0.2 W0.45 D1.75");
    let section = std::f64::consts::PI * 1.75 * 1.75 / 4.0;
    let moves = moves(&job, |_, lays| lays.then_some(0.2 * 0.45 / section));
    assert!(moves.iter().filter(|straight| straight.filament_mm > 0.0 && straight.length_mm() > 0.0).count() > 1000);
    let found = check("cube by length", &job, &moves);
    assert!(found.of_a_slave > found.of_the_machine, "{found:?}");
}

#[test]
fn filament_by_length_is_for_moves_without_e() {
    let section = std::f64::consts::PI * 1.75 * 1.75 / 4.0;
    let lambda = 0.2 * 0.45 / section;
    let filament = |lines: &str| {
        let directory = directory();
        let job = format!("M302 P1\nG28\nG1 Z1 F600\nG0 X50 Y50 F6000\nM795 S1 H0.2 W0.45 D1.75\n{lines}\n");
        let path = file(&directory, "job.gcode", job);
        let outcome = ferrostep(["print".as_ref(), path.as_os_str(), "--json".as_ref()]);
        assert_eq!(outcome.status, Some(0), "{lines}: {outcome:#?}");
        (outcome.json()["filament_mm"].as_f64().unwrap(), outcome.json()["position_mm"]["e"].as_f64().unwrap())
    };
    for (lines, path_mm, told_mm) in [
        ("G1 X80 Y90", 50.0, 0.0),
        ("G0 X80 Y90", 0.0, 0.0),
        ("G1 X80 Y90 E3", 0.0, 3.0),
        ("G1 X80 Y90 E0", 0.0, 0.0),
        ("G1 X80 Y90 Z1.2", 0.0, 0.0),
        ("G1 Z2", 0.0, 0.0),
        ("G1 X80 Y90\nG1 E2\nG1 E1", 50.0, 1.0),
        ("G10\nG1 X80 Y90\nG11\nG1 X110 Y50", 50.0, 0.0),
        ("M221 S50\nG1 X80 Y90", 25.0, 0.0),
        ("M795 S0\nG1 X80 Y90", 0.0, 0.0),
        ("M795 H0.4\nG1 X80 Y90", 100.0, 0.0),
        ("M795 D3.5\nG1 X80 Y90", 12.5, 0.0),
        ("G20\nM795 D0.1377952755\nG21\nG1 X80 Y90", 12.5, 0.0),
        // Drawn to the soft limit: 50 mm of the 100.
        ("G0 X150\nG1 X250", 50.0, 0.0),
        // A half circle of 10 mm, as chords.
        ("G2 X70 Y50 I10 J0", std::f64::consts::PI * 10.0, 0.0),
        ("G3 X70 Y50 I10 J0 E1", 0.0, 1.0),
    ] {
        let (pushed_mm, e_mm) = filament(lines);
        let expected_mm = lambda * path_mm + told_mm;
        // Chords are a little shorter than their arc.
        assert!((pushed_mm - expected_mm).abs() < 1e-3, "{lines}: {pushed_mm}, not {expected_mm}");
        assert!((e_mm - told_mm).abs() < 1e-9, "{lines}: the G-code's position is {e_mm}, not {told_mm}");
    }
}

#[test]
fn settings_out_of_range_are_refused() {
    for (line, word) in [("M795 H6", 'H'), ("M795 W0.001", 'W'), ("M795 S1 D0.1", 'D')] {
        let directory = directory();
        let path = file(&directory, "job.gcode", line);
        let outcome = ferrostep(["print".as_ref(), path.as_os_str()]);
        assert_eq!(outcome.status, Some(1), "{outcome:#?}");
        assert!(outcome.stderr.contains(&format!("{word}: ")), "{outcome:#?}");
    }
    // Cold extrusion is refused as in any other move.
    let directory = directory();
    let path = file(&directory, "job.gcode", "G28\nM795 S1\nG1 X10 F600\n");
    let outcome = ferrostep(["print".as_ref(), path.as_os_str()]);
    assert_eq!(outcome.status, Some(1), "{outcome:#?}");
    assert!(outcome.stderr.contains("cold"), "{outcome:#?}");
}
