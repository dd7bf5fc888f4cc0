//! A machine whose drives have play, and one whose firmware knows it.

use std::fs::{self, File};
use std::path::Path;

use ferrostep_oracle::trace::{Record, StepEvent, TraceReader};

use crate::end_to_end::command::{Outcome, directory, ferrostep, file, repository};
use crate::end_to_end::imports::{lost, marlin, profile, says};

const PLAY_MM: [f64; 3] = [0.15, 0.1, 0.05];
const STEPS_PER_MM: [f64; 3] = [80.0, 80.0, 400.0];

const TABLE: &str = "[backlash]\nplay_mm = { x = 0.15, y = 0.1, z = 0.05 }\n";

/// A print of a file on the cartesian profile with further keys, and its trace.
fn print(job: &Path, keys: &str, trace: &Path) -> Outcome {
    let directory = directory();
    let text = fs::read_to_string(repository().join("config/profiles/cartesian.toml")).unwrap();
    let profile = file(&directory, "profile.toml", format!("{text}\n{keys}"));
    let arguments = ["print", "--json", "--profile", profile.to_str().unwrap(), "--trace", trace.to_str().unwrap()];
    let outcome = ferrostep(arguments.into_iter().chain([job.to_str().unwrap()]));
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    outcome
}

/// The step events between the homing before the print and one after it, with ticks from there.
fn events(trace: &Path) -> Vec<StepEvent> {
    let (mut print, mut events, mut homed) = (Vec::new(), Vec::new(), 0);
    let mut note = |events: &mut Vec<StepEvent>| {
        if events.len() > print.len() {
            print = std::mem::take(events);
        }
        events.clear();
    };
    for record in TraceReader::new(File::open(trace).unwrap()).unwrap() {
        match record.unwrap() {
            Record::Step(event) => events.push(StepEvent { tick: event.tick - homed, ..event }),
            Record::PositionsRedefined { tick, .. } => {
                homed = tick;
                note(&mut events);
            }
            Record::MoveEnd { .. } => {}
        }
    }
    note(&mut events);
    print
}

/// Steps of each motor in an event, with their signs.
fn steps(event: &StepEvent) -> [i64; 3] {
    [0, 1, 2].map(|motor| {
        let way = if event.directions >> motor & 1 == 0 { 1 } else { -1 };
        i64::from(event.axes >> motor & 1) * way
    })
}

/// Each axis stays until its motor has gone through the play, and goes with it from there. Returns
/// in how many thousandths of the plan's events of X and Y each was off by more than a step, and by
/// how many steps at most.
fn off(plan: &[StepEvent], motors: &[StepEvent]) -> [(usize, i64); 3] {
    let play = [0, 1, 2].map(|axis| (PLAY_MM[axis] * STEPS_PER_MM[axis]).round() as i64);
    // Homing has left the axes where a motor pulls them backwards.
    let (mut wanted, mut motor, mut axes) = ([0; 3], [0; 3], [0; 3]);
    let (mut all, mut off, mut most) = (0, [0; 3], [0; 3]);
    let mut motors = motors.iter().peekable();
    for event in plan {
        while let Some(made) = motors.next_if(|made| made.tick <= event.tick) {
            for (axis, by) in steps(made).into_iter().enumerate() {
                motor[axis] += by;
                axes[axis] = i64::clamp(axes[axis], motor[axis] - play[axis], motor[axis]);
            }
        }
        let by = steps(event);
        for axis in 0..3 {
            wanted[axis] += by[axis];
            // Moves of neither X nor Y print nothing.
            if by[0] != 0 || by[1] != 0 {
                let away = i64::abs(axes[axis] - wanted[axis]);
                off[axis] += usize::from(away > 1);
                most[axis] = most[axis].max(away);
            }
        }
        all += usize::from(by[0] != 0 || by[1] != 0);
    }
    assert!(motors.next().is_none());
    [0, 1, 2].map(|axis| (off[axis] * 1000 / all, most[axis]))
}

/// Two files of slicers: uncorrected the axes are off by their play half of the time, corrected on
/// the way after a reversal only.
#[test]
fn prints_are_where_they_are_to_be() {
    for (name, most) in [("cube-slic3r.gcode.gz", 80), ("gyroid.gcode.gz", 120)] {
        let (job, directory) = (repository().join("examples").join(name), directory());
        let [plain, corrected] = ["plain", "corrected"].map(|name| directory.path().join(name));
        let one = print(&job, "", &plain).json();
        let other = print(&job, TABLE, &corrected).json();
        let [plain, corrected] = [&plain, &corrected].map(|trace| events(trace));
        let (uncorrected, left) = (off(&plain, &plain), off(&plain, &corrected));
        println!("{name}: off by more than a step in {uncorrected:?} of 1000 events without, {left:?} with");
        for axis in 0..2 {
            assert!(uncorrected[axis].0 > 400, "{name}: {uncorrected:?}");
            assert!(left[axis].0 < most, "{name}: {left:?}");
        }
        assert_eq!(one["motion_time_s"], other["motion_time_s"], "a print takes no longer by it");
    }
}

#[test]
fn a_machine_that_shares_motors_has_no_play_of_one_axis() {
    let directory = directory();
    let text = fs::read_to_string(repository().join("config/profiles/corexy.toml")).unwrap();
    let profile = file(&directory, "profile.toml", format!("{text}\n{TABLE}"));
    let job = file(&directory, "job.gcode", "G28\n");
    let outcome = ferrostep(["print", job.to_str().unwrap(), "--profile", profile.to_str().unwrap()]);
    assert_eq!(outcome.status, Some(2), "{outcome:#?}");
    assert!(outcome.stderr.contains("backlash.play_mm.x"), "{outcome:#?}");
}

/// Marlin takes up no part of the play until M425 F or its definition says more.
#[test]
fn marlins_play_is_kept() {
    let play =
        "#define BACKLASH_COMPENSATION\n#define BACKLASH_DISTANCE_MM { 0.1, 0.08, 0.02 }\n#define BACKLASH_GCODE\n";
    let imported = marlin(&format!("{play}#define BACKLASH_CORRECTION 0.5\n#define BACKLASH_SMOOTHING_MM 2\n"));
    says(&imported, "backlash = { play_mm = { x = 0.1, y = 0.08, z = 0.02 }, correction = 0.5, smoothing_mm = 2 }\n");
    assert!(lost(&imported, "BACKLASH_GCODE").unwrap().contains("M425"));
    let imported = marlin(play);
    says(&imported, "backlash.correction = 0\n");
    assert!(profile(&marlin("#define BACKLASH_DISTANCE_MM { 0.1, 0.08, 0.02 }\n")).get("backlash").is_none());
}
