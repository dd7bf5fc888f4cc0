//! Prepared jobs entered at a frame: from there on they make the steps of the whole job, and the
//! nozzle avoids the print on the way there.

use std::path::Path;

use ferrostep_gpre::compact::{Frame, FrameState, HEAD_BYTES, frame_length};
use ferrostep_gpre::{Encoding, EntrySpeed, Header};
use ferrostep_oracle::trace::{Record, TraceReader};
use ferrostep_printer::Profile;
use ferrostep_testkit::hand_made;
use proptest::prelude::*;

use crate::end_to_end::command::{directory, example, ferrostep, file};
use crate::end_to_end::desk::{Ended, profile, rehearse_far, rehearse_from};
use crate::end_to_end::prepared::{SQUARE, prepared, says};
use crate::end_to_end::programs::generator::{Program, program};

/// Height by which the nozzle is raised on the way, units of 10 nm.
const CLEARANCE_10NM: i64 = 500_000;

/// States at the starts of a job's frames.
fn starts(job: &[u8]) -> Vec<FrameState> {
    let header = Header::read(job).unwrap();
    let mut rest = &job[header.length() as usize..];
    let mut starts = Vec::new();
    while !rest.is_empty() {
        let length = frame_length(rest.first_chunk::<HEAD_BYTES>().unwrap()).unwrap();
        let (frame, behind) = rest.split_at(length);
        starts.push(*Frame::read(frame, 0, Some(starts.len() as u32)).unwrap().items().unwrap().start());
        rest = behind;
    }
    starts
}

/// The frames after the first at which a job can be entered.
pub fn entries(job: &[u8]) -> Vec<(u32, FrameState)> {
    (0..).zip(starts(job)).skip(1).filter(|(_, start)| start.can_be_entered).collect()
}

fn records(ended: &Ended) -> Vec<Record> {
    TraceReader::new(&ended.trace[..]).unwrap().map(Result::unwrap).collect()
}

/// The parts before and after the last homing, or the last move up to a line.
fn behind(mut records: Vec<Record>, line: u32) -> (Vec<Record>, Vec<Record>) {
    let ended = |record: &Record| match record {
        Record::Step(_) => false,
        Record::PositionsRedefined { .. } => true,
        Record::MoveEnd { line: ended, .. } => *ended <= line,
    };
    let last = records.iter().rposition(ended).unwrap();
    let behind = records.split_off(last + 1);
    (records, behind)
}

/// The steps of X, Y and Z in their order: motors and directions.
fn way(records: &[Record]) -> Vec<(u8, u8)> {
    let events = records.iter().filter_map(|record| if let Record::Step(event) = record { Some(event) } else { None });
    let of_way = events.map(|event| (event.axes & 0b111, event.directions & event.axes & 0b111));
    of_way.filter(|(axes, _)| *axes != 0).collect()
}

/// Extruder steps, forwards less backwards.
fn pushed(records: &[Record]) -> i64 {
    let mut sum = 0;
    for record in records {
        if let Record::Step(event) = record
            && event.axes & 0b1000 != 0
        {
            sum += if event.directions & 0b1000 != 0 { -1 } else { 1 };
        }
    }
    sum
}

/// The whole job, and the same job entered at a frame.
#[track_caller]
fn entered(machine: &Profile, job: &[u8], frame: u32) -> Ended {
    let entered = rehearse_from(machine, frame, &mut &job[..]);
    assert!(entered.outcome.is_ok(), "frame {frame}: {:?}", entered.outcome);
    assert_eq!(entered.figures.underruns, 0);
    entered
}

/// Checks the path to a frame: the nozzle moves along X and Y above the print alone,
/// and Z is not homed.
#[track_caller]
fn keeps_above(machine: &Profile, way: &[Record], start: &FrameState) {
    let z_steps = |z_10nm: i64| machine.geometry().motor_steps([0, 0, z_10nm])[2];
    let above = z_steps((start.position_10nm[2] + CLEARANCE_10NM).min(machine.size_10nm[2]));
    let (mut z, mut moved) = (None, 0);
    for record in way {
        match record {
            Record::PositionsRedefined { positions, .. } => {
                // The first sets Z; X and Y are homed later and leave it unchanged.
                assert_eq!(positions[2], z.unwrap_or(z_steps(start.position_10nm[2])), "Z was homed");
                z = Some(positions[2]);
            }
            Record::Step(event) => {
                let z = z.as_mut().expect("a step before Z is known");
                if event.axes & 0b100 != 0 {
                    *z += if event.directions & 0b100 != 0 { -1 } else { 1 };
                }
                if event.axes & 0b11 != 0 {
                    assert_eq!(*z, above, "X or Y moves at another height");
                    moved += 1;
                }
                assert_eq!(event.axes & 0b1000, 0, "the extruder moves");
            }
            Record::MoveEnd { .. } => {}
        }
    }
    assert!(moved > 1_000, "X and Y were not homed");
    assert_eq!(z, Some(z_steps(start.position_10nm[2])));
}

/// A job entered at each of some frames.
#[track_caller]
fn check(name: &str, machine: &str, lines: usize) {
    let machine = profile(machine);
    let text = String::from_utf8(example(name)).unwrap();
    let gcode: String = text.lines().take(lines).map(|line| format!("{line}\n")).collect();
    let job = prepared(&machine, gcode.as_bytes(), Encoding::Compact).unwrap();
    let whole = rehearse_far(&machine, &mut &job[..], true);
    let all = records(&whole);
    let entries = entries(&job);
    assert!(entries.len() > 3, "{} frames", entries.len());
    for (frame, start) in entries.into_iter().step_by(3) {
        let entered = entered(&machine, &job, frame);
        let (approach, tail) = behind(records(&entered), start.line);
        let (_, expected) = behind(all.clone(), start.line);
        keeps_above(&machine, &approach, &start);
        assert!(way(&tail) == way(&expected), "frame {frame}: other steps");
        // The whole job may have part of an extruder step left over at the entry; the entered
        // one begins without.
        assert!((pushed(&tail) - pushed(&expected)).abs() <= 1, "frame {frame}");
        assert_eq!(entered.logical_10nm, whole.logical_10nm, "frame {frame}");
        assert_eq!(entered.lines, whole.lines);
    }
}

#[test]
fn a_cube_resumes_at_any_frame() {
    check("cube.gcode", "cartesian", 3_000);
}

#[test]
fn a_gyroid_resumes_at_any_frame() {
    check("gyroid.gcode.gz", "cartesian", 6_000);
}

#[test]
fn a_slic3r_cube_resumes_on_a_machine_that_homes_by_stall() {
    check("cube-slic3r.gcode.gz", "prusa-mini", 3_000);
}

#[test]
fn a_corexy_job_resumes_at_any_frame() {
    check("cube-corexy.gcode.gz", "corexy", 3_000);
}

proptest! {
    #![proptest_config(ferrostep_random_cases::share_of_cases(150))]

    /// Enters jobs in a homed machine with any settings.
    #[test]
    fn any_program_resumes_at_any_frame(program in homed_program()) {
        let machine = profile(program.machine);
        let Some(job) = prepared(&machine, program.text.as_bytes(), Encoding::Compact) else { return Ok(()) };
        let whole = rehearse_far(&machine, &mut &job[..], true);
        let all = records(&whole);
        for (frame, start) in entries(&job) {
            let entered = rehearse_from(&machine, frame, &mut &job[..]);
            prop_assert!(entered.outcome.is_ok(), "frame {}: {:?}", frame, entered.outcome);
            let (_, tail) = behind(records(&entered), start.line);
            let (_, expected) = behind(all.clone(), start.line);
            prop_assert!(way(&tail) == way(&expected), "frame {}: other steps", frame);
            prop_assert_eq!(&entered.logical_10nm[..3], &whole.logical_10nm[..3]);
            let extruder = entered.logical_10nm[3] - whole.logical_10nm[3];
            // No frame contains a remainder of a unit.
            prop_assert!(extruder.abs() <= 1, "E is {} beside", extruder);
        }
    }
}

/// A program whose moves are straight: chords of an arc have a line in common, and cannot be
/// told apart by it.
fn homed_program() -> impl Strategy<Value = Program> {
    program().prop_filter("homed, straight", |program| !program.has_arcs && program.text.starts_with("M302 P1\nG28\n"))
}

/// Settings of a job before its middle; in its middle the machine is at rest, and no part of an
/// extruder step is owed.
const SETTINGS: &str = "G28\nM302 P1\nM83\nM201 X2100\nM203 Y130.5\nM204 P700 T900 R1100\nM205 J0.07\nM221 S80\nM207 S0.7\n\
                        G1 X20 Y20 Z5 F3000\nG92 X10 Z1 E3\nG1 X60 E1 F4000\nG1 E-1\nM106 S77\nG1 Y60\nM400\nM220 S90\n";

/// The job's second half.
const MORE: &str =
    "G1 X100 Y70 E1 F5000\nG1 X70 E2\nG10\nG1 Y20\nG11\nG1 X60 Y61 E1\nM106 S5\nG1 X61 Y62 Z2 E.2\nG1 X20\n";

#[test]
fn steps_keep_their_times_from_a_standstill_on() {
    for machine in ["cartesian", "corexy"] {
        let machine = profile(machine);
        let gcode = [SETTINGS, MORE].concat();
        let job = prepared(&machine, gcode.as_bytes(), Encoding::Compact).unwrap();
        let line = SETTINGS.lines().count() as u32;
        let (frame, start) = entries(&job).into_iter().find(|(_, start)| start.line == line).unwrap();
        let whole = rehearse_far(&machine, &mut &job[..], true);
        let entered = entered(&machine, &job, frame);
        let tail = |ended: &Ended| -> Vec<Record> {
            let (_, tail) = behind(records(ended), start.line);
            let Some(Record::Step(first)) = tail.iter().find(|record| matches!(record, Record::Step(_))) else {
                panic!("no step");
            };
            let from = |tick: u64| tick - first.tick;
            let later = tail.iter().map(|record| match record.clone() {
                Record::Step(event) => {
                    Record::Step(ferrostep_oracle::trace::StepEvent { tick: from(event.tick), ..event })
                }
                Record::MoveEnd { tick, line } => Record::MoveEnd { tick: from(tick), line },
                Record::PositionsRedefined { .. } => panic!("the tail homes nothing"),
            });
            later.collect()
        };
        assert!(tail(&entered) == tail(&whole), "other records");
        assert_eq!(entered.logical_10nm, whole.logical_10nm);
    }
}

/// The output of the command that enters a job.
fn print_from(path: &Path, frame: &str, status: i32) -> String {
    let outcome = ferrostep(["print", path.to_str().unwrap(), "--from-frame", frame]);
    assert_eq!(outcome.status, Some(status), "{outcome:#?}");
    outcome.stderr
}

#[test]
fn impossible_entry_frames_are_refused() {
    let directory = directory();
    let machine = profile("cartesian");
    // One frame a move, after the frame that homes.
    let moves = [
        (40, EntrySpeed::Bound),
        (20, EntrySpeed::Falling),
        (10, EntrySpeed::Falling),
        (10, EntrySpeed::Bound),
        (5, EntrySpeed::Falling),
    ];
    let path = file(&directory, "moves.gpre", hand_made::job(machine.plan_hash, &moves));
    says(&print_from(&path, "6", 1), "frame 6: there is no such frame, expected one from 0 to 5");
    let goes_on = "a job cannot be entered here, because its first move continues the one before";
    says(&print_from(&path, "2", 1), &format!("frame 2: {goes_on}; the next one that can be entered is 4"));
    says(&print_from(&path, "5", 1), &format!("frame 5: {goes_on}; no later one can"));
    says(&print_from(&path, "4", 0), "");

    let wide = file(&directory, "wide.gpre", prepared(&machine, SQUARE.as_bytes(), Encoding::Wide).unwrap());
    says(&print_from(&wide, "1", 1), "frame 1: packets cannot be entered: prepare the job with --format compact");
    let text = file(&directory, "square.gcode", SQUARE);
    says(&print_from(&text, "1", 2), "this is G-code, and --from-frame needs a prepared job");
    says(&print_from(&path, "first", 2), "invalid value 'first' for '--from-frame <N>'");
}

#[test]
fn inspect_lists_exactly_the_possible_entry_frames() {
    let directory = directory();
    let job = prepared(&profile("cartesian"), &example("cube.gcode"), Encoding::Compact).unwrap();
    let path = file(&directory, "cube.gpre", &job);
    let outcome = ferrostep(["inspect", path.to_str().unwrap(), "--entries"]);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    let (_, list) = outcome.stdout.split_once("in motion before\n").unwrap();
    let listed: Vec<Vec<&str>> = list.lines().map(|line| line.split_whitespace().take(3).collect()).collect();
    let expected = entries(&job).into_iter().map(|(frame, start)| {
        [frame.to_string(), start.line.to_string(), format!("{:.3}", start.position_10nm[2] as f64 / 100_000.0)]
    });
    assert!(listed.iter().map(Vec::as_slice).eq(expected), "{list}");
    // The times increase, to no more than the job's.
    let last = list.lines().last().unwrap();
    assert!(last.contains("about 2") && last.contains(" min "), "{last}");
}

#[test]
fn a_resumed_job_heats_first() {
    let directory = directory();
    let text = String::from_utf8(example("cube.gcode")).unwrap();
    let gcode: String = text.lines().take(1_500).map(|line| format!("{line}\n")).collect();
    let job = prepared(&profile("cartesian"), gcode.as_bytes(), Encoding::Compact).unwrap();
    let path = file(&directory, "part.gpre", &job);
    let (frame, start) = entries(&job)[1];
    assert!(start.modal.nozzle_celsius > 200 && start.modal.bed_celsius > 50);
    let arguments = ["print", path.to_str().unwrap(), "--json", "--from-frame", &frame.to_string()];
    let outcome = ferrostep(arguments);
    // A cold nozzle would be refused.
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    let summary = outcome.json();
    let heating_s = summary["print_time_s"].as_f64().unwrap() - summary["motion_time_s"].as_f64().unwrap();
    assert!(heating_s > 100.0, "{summary}");
    // Entered at its start it is the whole job.
    let whole = ferrostep(["print", path.to_str().unwrap(), "--json"]).json();
    let first = ferrostep(["print", path.to_str().unwrap(), "--json", "--from-frame", "0"]).json();
    assert_eq!(whole["step_digest"], first["step_digest"]);
}
