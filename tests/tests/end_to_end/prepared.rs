//! Prepared jobs make the same steps as the G-code with unlimited look-ahead, and files that are
//! not jobs make none.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use ferrostep_gpre::compact::{HEAD_BYTES, frame_length};
use ferrostep_gpre::{Encoding, EntrySpeed, Header};
use ferrostep_papers::wide::{Packet, Status};
use ferrostep_printer::Profile;
use ferrostep_session::JobReplies;
use ferrostep_session::gpre::{self, Target};
use ferrostep_testkit::hand_made::{self, given};
use proptest::prelude::*;
use serde_json::Value;
use tempfile::TempDir;

use crate::end_to_end::command::{directory, example, ferrostep, file, repository};
use crate::end_to_end::desk::{profile, rehearse_behind, rehearse_far};
use crate::end_to_end::programs::generator::program;

/// Prepares G-code in memory; a job that stops at a line gives no file.
pub fn prepared(profile: &Profile, gcode: &[u8], encoding: Encoding) -> Option<Vec<u8>> {
    let mut out = Cursor::new(Vec::new());
    let target = Target { out: &mut out, encoding };
    let replies = JobReplies::new(|_: &str| {});
    gpre::prepare(&mut &gcode[..], None, *profile, replies, target, |_, _| {}).ok()?;
    Some(out.into_inner())
}

fn json(arguments: &[&str]) -> Value {
    let outcome = ferrostep(arguments.iter().copied().chain(["--json"]));
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    outcome.json()
}

/// Prepares an example and prints it both ways.
fn check(name: &str, profile: &str, most_bytes_per_move: f64) {
    let directory = directory();
    let gcode = repository().join("examples").join(name);
    let gcode = gcode.to_str().unwrap();
    for format in ["compact", "wide"] {
        let out = directory.path().join("job.gpre");
        let out = out.to_str().unwrap();
        let summary = json(&["preprocess", gcode, "-o", out, "--profile", profile, "--format", format]);
        let planned = json(&["print", gcode, "--profile", profile, "--look-ahead", "65536"]);
        let executed = json(&["print", out, "--profile", profile]);
        let keys = ["step_digest", "order_digest", "motor_steps", "moves", "position_mm", "motion_time_s"];
        for key in keys {
            assert_eq!(executed[key], planned[key], "{key} of {format}");
        }
        // Packets have filament in 1/256 steps.
        let [pushed, expected] = [&executed, &planned].map(|summary| summary["filament_mm"].as_f64().unwrap());
        assert!((pushed - expected).abs() <= if format == "wide" { 0.01 } else { 0.0 }, "{pushed} {expected}");
        assert_eq!(summary["moves"], planned["moves"]);
        let bytes = std::fs::metadata(out).unwrap().len();
        assert_eq!(summary["bytes"], bytes);
        let ring = json(&["print", gcode, "--profile", profile]);
        assert!(executed["motion_time_s"].as_f64().unwrap() <= ring["motion_time_s"].as_f64().unwrap() + 1e-6);
        if format == "compact" {
            assert!(summary["bytes_per_move"].as_f64().unwrap() <= most_bytes_per_move, "{summary}");
            // The board's own look-ahead ring is enough to follow the plan.
            let board = json(&["print", out, "--profile", profile, "--look-ahead", "128"]);
            assert_eq!(board["step_digest"], planned["step_digest"]);
        }
    }
}

#[test]
fn a_cube() {
    check("cube.gcode", "cartesian", 6.0);
}

#[test]
fn a_gyroid() {
    check("gyroid.gcode.gz", "cartesian", 4.6);
}

#[test]
fn a_vase() {
    // An eighth of its moves share a block, which takes two bits more.
    check("vase.gcode.gz", "cartesian", 4.9);
}

#[test]
fn arcs_on_a_corexy() {
    check("arcs-corexy.gcode.gz", "corexy", 28.0);
}

#[test]
fn firmware_retraction() {
    check("firmware-retraction.gcode.gz", "cartesian", 6.2);
}

#[test]
fn other_slicers() {
    check("cube-cura.gcode.gz", "cartesian", 6.2);
    check("cube-slic3r.gcode.gz", "prusa-mini", 5.2);
}

proptest! {
    #![proptest_config(ferrostep_random_cases::share_of_cases(200))]

    /// A prepared job is executed as planned to the last record of the trace: every step at its
    /// tick, every move's end.
    #[test]
    fn any_program_is_executed_as_planned(program in program(), name in prop::sample::select(vec!["cartesian", "corexy"])) {
        let machine = profile(name);
        let planned = rehearse_far(&machine, &mut program.text.as_bytes(), false);
        let job = prepared(&machine, program.text.as_bytes(), Encoding::Compact);
        prop_assert_eq!(planned.outcome.is_ok(), job.is_some());
        if let Some(job) = job {
            let executed = rehearse_far(&machine, &mut &job[..], true);
            prop_assert!(executed.outcome.is_ok(), "{:?}", executed.outcome);
            prop_assert_eq!(executed.figures.digests, planned.figures.digests);
            prop_assert!(executed.trace == planned.trace, "other records");
            prop_assert_eq!(executed.logical_10nm, planned.logical_10nm);
            prop_assert_eq!(executed.tally.filament_100pm, planned.tally.filament_100pm);
            let job = prepared(&machine, program.text.as_bytes(), Encoding::Wide);
            let executed = rehearse_far(&machine, &mut &job.unwrap()[..], true);
            prop_assert!(executed.outcome.is_ok(), "{:?}", executed.outcome);
            prop_assert!(executed.trace == planned.trace, "other records");
            prop_assert_eq!(executed.logical_10nm, planned.logical_10nm);
        }
    }

    /// A file is refused after any change, or the change does not matter; the machine keeps to its
    /// limits and stops.
    #[test]
    fn a_changed_file_is_answered(changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4)) {
        let machine = profile("cartesian");
        let mut job = prepared(&machine, SQUARE.as_bytes(), Encoding::Compact).unwrap();
        let before = job.clone();
        for (place, byte) in changes {
            let place = place.index(job.len());
            job[place] = byte;
        }
        let executed = rehearse_far(&machine, &mut &job[..], true);
        prop_assert_eq!(executed.outcome.is_err(), job != before);
        prop_assert_eq!(executed.figures.underruns, 0);
    }
}

/// Two rounds of a square.
pub const SQUARE: &str = "G28\nM302 P1\nG90\nM83\nG1 X20 Y20 Z5 F3000\nG1 X60 E1\nG1 Y60 E1\nG1 X20 E1\nG1 Y20 E1\nM204 P500\n\
                      G1 X60 E1\nG1 Y60 E1\nM106 S100\nG1 X20 E1\nG1 Y20 E1\nM400\nG1 X0 Y0\n";

/// A prepared square and its directory.
fn square() -> (TempDir, PathBuf) {
    let directory = directory();
    let job = prepared(&profile("cartesian"), SQUARE.as_bytes(), Encoding::Compact).unwrap();
    let path = file(&directory, "square.gpre", job);
    (directory, path)
}

/// Prints a file that is refused. Returns the message.
#[track_caller]
fn refusal(path: &Path, status: i32, arguments: &[&str]) -> String {
    let outcome = ferrostep(["print", path.to_str().unwrap()].iter().chain(arguments));
    assert_eq!(outcome.status, Some(status), "{outcome:#?}");
    outcome.stderr
}

#[track_caller]
pub fn says(stderr: &str, expected: &str) {
    assert!(stderr.contains(expected), "{expected:?} is not in {stderr:?}");
}

#[test]
fn each_broken_file_is_refused_with_its_message() {
    let (directory, path) = square();
    let job = std::fs::read(&path).unwrap();
    let header = Header::read(&job).unwrap().length() as usize;
    let changed = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut job = job.clone();
        change(&mut job);
        file(&directory, "broken.gpre", job)
    };
    let cut = changed(&|job| job.truncate(header + 40));
    says(&refusal(&cut, 1, &[]), &format!("frame 0 at byte {}: the file is cut short", header + 40));
    let cut = changed(&|job| job.truncate(30));
    says(&refusal(&cut, 1, &[]), "at byte 30: the file is cut short");
    let mark = changed(&|job| job[1] = b'X');
    says(&refusal(&mark, 2, &[]), "not a text file: byte 0x1a at offset 7");
    let newer = changed(&|job| job[8] = 2);
    says(&refusal(&newer, 1, &[]), "at byte 8: written in version 2 of the format, expected at most 1");
    says(&refusal(&path, 1, &["--profile", "corexy"]), "at byte 16: prepared for another machine");
    let bit = changed(&|job| job[header + 20] ^= 1);
    says(&refusal(&bit, 1, &[]), &format!("frame 0 at byte {header}: damaged: its checksum is "));
    let bit = changed(&|job| job[20] ^= 1);
    says(&refusal(&bit, 1, &[]), "at byte 0: damaged: its checksum");
    let longer = changed(&|job| job.push(0));
    says(&refusal(&longer, 1, &[]), &format!("at byte {}: bytes follow the last frame", job.len()));
    let mut swapped = by_hand(&[(40, EntrySpeed::Bound), (40, EntrySpeed::Bound)]);
    let head = swapped[header..].first_chunk::<HEAD_BYTES>().unwrap();
    let length = frame_length(head).unwrap();
    swapped[header..].rotate_left(length);
    let swapped = file(&directory, "swapped.gpre", swapped);
    says(&refusal(&swapped, 1, &[]), &format!("frame 0 at byte {header}: frames out of order: this is number 1"));
}

#[test]
fn content_decides_what_a_file_is() {
    let (directory, path) = square();
    let named_gcode = directory.path().join("square.gcode");
    std::fs::copy(&path, &named_gcode).unwrap();
    let outcome = ferrostep(["print", named_gcode.to_str().unwrap()]);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    says(&outcome.stderr, "the content is a prepared job: printing it as that");
    let named_gpre = file(&directory, "text.gpre", SQUARE);
    let outcome = ferrostep(["print", named_gpre.to_str().unwrap()]);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    says(&outcome.stderr, "the name says prepared job, the content is G-code");
    for (command, file, expected) in [
        ("estimate", &path, "this is a prepared job, and estimate takes G-code"),
        ("inspect", &named_gpre, "this is G-code, and inspect reads prepared jobs"),
    ] {
        let outcome = ferrostep([command, file.to_str().unwrap()]);
        assert_eq!(outcome.status, Some(2), "{outcome:#?}");
        says(&outcome.stderr, expected);
    }
    let outcome = ferrostep(["preprocess", path.to_str().unwrap(), "-o", "/dev/null"]);
    assert_eq!(outcome.status, Some(2), "{outcome:#?}");
    says(&outcome.stderr, "this is a prepared job already");
}

/// Filters are the machine's that prints: a job may set them, and is prepared for a
/// machine with any.
#[test]
fn a_prepared_job_sets_filters_where_the_gcode_does() {
    let directory = directory();
    let plain = std::fs::read_to_string(repository().join("config/profiles/cartesian.toml")).unwrap();
    let shaper =
        "[input_shaper]\nx = { kind = \"mzv\", frequency_hz = 50 }\ny = { kind = \"ei\", frequency_hz = 38 }\n";
    let profiles = [plain.clone(), format!("{plain}\n{shaper}")];
    let [plain, shaped] = [("plain.toml", &profiles[0]), ("shaped.toml", &profiles[1])]
        .map(|(name, text)| file(&directory, name, text).to_str().unwrap().to_owned());
    // The first line sets what the second machine already has: it is a standstill
    // nevertheless, as planned.
    let gcode = "G28\nG1 X20 F6000\nG1 X40 Y1\nSET_INPUT_SHAPER SHAPER_TYPE_X=mzv SHAPER_FREQ_X=50\nG1 X60 Y2\nG1 X80\n\
                 M593 Y P\"zvd\" F44 S0.05\nG1 X90 Y30\nG1 X70 Y60\nM593 F0\nG1 X20\nM593\n";
    let gcode = file(&directory, "job.gcode", gcode).to_str().unwrap().to_owned();
    let job = directory.path().join("job.gpre").to_str().unwrap().to_owned();
    json(&["preprocess", &gcode, "-o", &job, "--profile", &plain]);
    for profile in [&plain, &shaped] {
        let planned = json(&["print", &gcode, "--profile", profile, "--look-ahead", "65536"]);
        let executed = json(&["print", &job, "--profile", profile]);
        for key in ["step_digest", "order_digest", "motor_steps", "moves", "position_mm", "motion_time_s"] {
            assert_eq!(executed[key], planned[key], "{key} on {profile}");
        }
    }
}

#[test]
fn preprocess_leaves_no_file_if_the_job_stops() {
    let directory = directory();
    let gcode = file(&directory, "bad.gcode", "G28\nG1 X10 F3000\nG1 Xnan\n");
    let out = directory.path().join("bad.gpre");
    let outcome = ferrostep(["preprocess", gcode.to_str().unwrap(), "-o", out.to_str().unwrap()]);
    assert_eq!(outcome.status, Some(1), "{outcome:#?}");
    says(&outcome.stderr, "line 3");
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 1);
}

/// A job brings its own heights. A shift before it would be lost, or count twice, and is
/// refused by name.
#[test]
fn a_prepared_job_is_refused_while_z_is_shifted() {
    let directory = directory();
    let gcode = file(&directory, "shift.gcode", "G28\nM290 Z0.1\nG1 X10 F3000\n");
    let out = directory.path().join("shift.gpre");
    let outcome = ferrostep(["preprocess", gcode.to_str().unwrap(), "-o", out.to_str().unwrap()]);
    assert_ne!(outcome.status, Some(0), "{outcome:#?}");
    says(&outcome.stderr, "line 2: M290 shifts a print by hand and cannot be prepared");

    let machine = profile("cartesian");
    // A job without G28 continues from the machine's place; homing ends a shift.
    for (text, is_refused) in [("G1 X10 Y10 Z2 F3000\n", true), ("G28\nG1 X10 Y10 Z2 F3000\n", false)] {
        let job = prepared(&machine, text.as_bytes(), Encoding::Compact).unwrap();
        let printed = rehearse_behind(&machine, &["G28", "M290 Z0.1", "M400"], &mut &job[..]);
        let said = format!("{:?}", printed.outcome);
        assert_eq!(said.contains("M290 or SET_GCODE_OFFSET has shifted Z by 0.100 mm"), is_refused, "{said}");
        assert_eq!(printed.outcome.is_err(), is_refused, "{said}");
    }
}

#[test]
fn inspect_lists_every_move() {
    let (_directory, path) = square();
    let outcome = ferrostep(["inspect", path.to_str().unwrap(), "--items"]);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    for expected in
        ["G28", "M204 P500", "fan 100", "X60.00000 Y20.00000 Z5.00000 E+1.00000 F50 mm/s", "entry by corner"]
    {
        says(&outcome.stdout, expected);
    }
}

/// A job made by hand for this machine.
fn by_hand(moves: &[(i64, EntrySpeed)]) -> Vec<u8> {
    hand_made::job(profile("cartesian").plan_hash, moves)
}

#[test]
fn impossible_plans_stop_where_they_begin() {
    let machine = profile("cartesian");
    let ended = |moves: &[(i64, EntrySpeed)]| rehearse_far(&machine, &mut &by_hand(moves)[..], true);
    let message = |moves: &[(i64, EntrySpeed)]| ended(moves).outcome.unwrap_err().to_string();

    let sound = ended(&[(40, EntrySpeed::Bound), (40, given(50.0)), (1, EntrySpeed::Falling), (20, EntrySpeed::Bound)]);
    assert!(sound.outcome.is_ok(), "{:?}", sound.outcome);

    // A planned speed above the feed; there is no corner, because the path continues straight.
    let moves = [(40, EntrySpeed::Bound), (40, given(100.1)), (20, EntrySpeed::Bound)];
    assert!(message(&moves).starts_with("frame 3"), "{}", message(&moves));
    says(
        &message(&moves),
        "line 4: the planned speed is too high: 100.1 mm/s, where corner and feeds allow 100.0 mm/s; prepare the job again",
    );
    // The move slows from 100 mm/s to 1 mm/s within 1 mm.
    let moves = [(40, EntrySpeed::Bound), (1, EntrySpeed::Bound), (40, given(1.0)), (20, EntrySpeed::Bound)];
    says(&message(&moves), "line 5: the planned speed is too low: 1.0 mm/s, where the move before slows down to ");
    // 40 mm belong to no move.
    let moves = [(40, EntrySpeed::Bound), (40, EntrySpeed::Continues)];
    assert!(message(&moves).contains("joins this move to the one before"), "{}", message(&moves));
    // Beyond the end of the axis.
    let moves = [(40, EntrySpeed::Bound), (400, EntrySpeed::Bound)];
    assert!(message(&moves).contains("X: outside the soft limits"), "{}", message(&moves));

    // The sound part is executed; the machine is on the path, and knows its position.
    let stopped = ended(&[(40, EntrySpeed::Bound), (1, EntrySpeed::Bound), (40, given(1.0)), (20, EntrySpeed::Bound)]);
    assert_eq!(stopped.logical_10nm[0], 4_100_000);
    assert_eq!(stopped.figures.underruns, 0);
}

#[test]
fn all_examples_can_be_prepared() {
    // Labels of objects, and comments between moves.
    let gcode = example("four-cubes-labelled.gcode.gz");
    let machine = profile("cartesian");
    let job = prepared(&machine, &gcode, Encoding::Compact).unwrap();
    let planned = rehearse_far(&machine, &mut &gcode[..], false);
    let executed = rehearse_far(&machine, &mut &job[..], true);
    assert!(executed.trace == planned.trace, "other records");
}

/// A spiral in pieces of some hundredths of a mm, with a retraction now and then.
fn spiral() -> String {
    let mut text = "M104 S200\nM109 S200\nG28\nM83\nG1 X150 Y150 Z1 F9000\n".to_owned();
    for piece in 0..4_000 {
        let turn = f64::from(piece) / 200.0;
        let radius = 2.0 + turn / 4.0;
        let (x, y) = (150.0 + radius * turn.cos(), 150.0 + radius * turn.sin());
        text.push_str(&format!("G1 X{x:.4} Y{y:.4} E.00071\n"));
        if piece % 2_000 == 1_999 {
            text.push_str("G1 E-2 F2400\nG1 E2 F2400\nG1 F6000\n");
        }
    }
    text
}

/// Part of an extruder step may be owed from before, and the flow may differ from the plan's:
/// then the extruder steps at other places within a block that joins many moves. That is not a
/// fault of the plan.
#[test]
fn a_job_prints_after_any_filament_and_at_any_flow() {
    let machine = profile("corexy");
    let job = prepared(&machine, spiral().as_bytes(), Encoding::Compact).unwrap();
    let plain = rehearse_far(&machine, &mut &job[..], true);
    assert!(plain.outcome.is_ok(), "{:?}", plain.outcome);
    assert!(plain.figures.merged_moves > 50, "{} moves", plain.figures.merged_moves);
    let parts = (1..16).map(|part| format!("G1 E{:.5}", f64::from(part) * 0.00022));
    let live = ["M221 S97", "M221 S50", "M221 S143", "M220 S60", "M220 S170"];
    for before in parts.chain(live.map(str::to_owned)) {
        let lines = ["M302 P1", "M83", &before, "M400", "M302 P0", "M302 S170", "M82"];
        let printed = rehearse_behind(&machine, &lines, &mut &job[..]);
        assert!(printed.outcome.is_ok(), "behind {before}: {:?}", printed.outcome);
        assert_eq!(printed.figures.motor_steps[..3], plain.figures.motor_steps[..3], "behind {before}");
        assert_eq!(printed.figures.merged_moves, plain.figures.merged_moves, "behind {before}");
        let time = printed.figures.motion_time_s / plain.figures.motion_time_s;
        let expected = match &*before {
            "M220 S60" => 1.3..1.7,
            "M220 S170" => 0.6..0.99,
            // The budget slows these short moves, and counts the extruder's steps among their cost.
            "M221 S50" => 0.94..0.98,
            "M221 S143" => 1.02..1.06,
            // Retractions are longer or shorter.
            _ => 0.98..1.02,
        };
        assert!(expected.contains(&time), "behind {before}: {time}");
    }
}

/// A flow that is too fast for the extruder at the plan's speeds ends the job there, at
/// rest on its path.
#[test]
fn too_much_flow_ends_the_job_at_rest() {
    let machine = profile("cartesian");
    let gcode = "G28\nM302 P1\nM83\nG1 X20 Y20 Z1 F6000\nG1 X40 E18\nG1 X60 E18\nG1 X80 Y30 E18\nG1 X100 Y32 E18\n\
                 G1 X101 E1\nG1 Y33 E1\nG1 Y60 E22\n";
    let job = prepared(&machine, gcode.as_bytes(), Encoding::Compact).unwrap();
    for (flow, fits) in [("M221 S110", true), ("M221 S160", false), ("M221 S400", false)] {
        let more = rehearse_behind(&machine, &[flow], &mut &job[..]);
        assert_eq!(more.figures.underruns, 0, "{flow}");
        if fits {
            assert!(more.outcome.is_ok(), "{flow}: {:?}", more.outcome);
            continue;
        }
        says(&more.outcome.unwrap_err().to_string(), "line 10: the planned speed is too high");
        assert_eq!(more.logical_10nm[..3], [10_000_000, 3_200_000, 100_000], "{flow}");
    }
}

#[test]
fn the_benchmarked_jobs_are_of_the_current_planner() {
    let folder = repository().join("tests/bench/src/gyroid");
    let gcode = std::fs::read(folder.join("job.gcode")).unwrap();
    for (name, encoding) in [("compact.gpre", Encoding::Compact), ("wide.gpre", Encoding::Wide)] {
        let job = prepared(&profile("cartesian"), &gcode, encoding).unwrap();
        let kept = folder.join(name);
        if std::env::var_os("FERROSTEP_REFRESH").is_some() {
            std::fs::write(&kept, &job).unwrap();
        }
        assert!(std::fs::read(&kept).unwrap() == job, "{name} has changed: set FERROSTEP_REFRESH to keep it");
    }
}

/// Prints packets whose last place says another E, and then one that has no meaning;
/// E afterwards, mm.
fn extruder_after_refusal(extruder_10nm: i64) -> f64 {
    let machine = profile("cartesian");
    let gcode = b"M302 P1\nG28\nG1 X10 E2 F3000\nG1 X20 E3\nM400\nG1 X30 E4\nM400\n";
    let job = prepared(&machine, gcode, Encoding::Wide).unwrap();
    let length = Header::read(&job).unwrap().length() as usize;
    let (mut out, mut rest) = (job[..length].to_vec(), &job[length..]);
    while !rest.is_empty() {
        let (used, packet) = (Packet::length(*rest.first_chunk().unwrap()).unwrap(), Packet::read(rest).unwrap());
        let packet = match packet {
            Packet::Status(Status::Place { part: part @ 6..=9, .. }) => {
                Packet::Status(Status::Place { part, bits: (extruder_10nm >> (16 * (i64::from(part) - 6))) as u16 })
            }
            other => other,
        };
        packet.write(&mut out);
        rest = &rest[used..];
    }
    let last = out.len() - 4;
    out[last..].fill(0xff);
    let ended = rehearse_behind(&machine, &[], &mut &out[..]);
    assert!(ended.outcome.is_err());
    ended.logical_10nm[3] as f64 / 100_000.0
}

/// A refused job does not change E: E is what the motors have pushed.
#[test]
fn a_refused_job_leaves_e_where_the_motors_are() {
    for (extruder_10nm, pushed_mm) in [(400_000, 4.0), (50_000_000, 4.0), (i64::MAX, 3.0), (i64::MIN, 3.0)] {
        let extruder_mm = extruder_after_refusal(extruder_10nm);
        assert!((extruder_mm - pushed_mm).abs() < 0.01, "{extruder_10nm}: {extruder_mm}");
    }
}
