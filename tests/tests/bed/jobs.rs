//! Prepared jobs, estimates, and machines without a probe.

use std::cell::RefCell;
use std::io::Cursor;

use ferrostep_gpre::Encoding;
use ferrostep_printer::Profile;
use ferrostep_session::gpre::{self, Target};
use ferrostep_session::job::{self, JobProgress};
use ferrostep_session::{JobReplies, Session};

use super::rig::{profile, run};

fn prepared(profile: &Profile, text: &str, encoding: Encoding) -> Result<Vec<u8>, String> {
    let mut out = Cursor::new(Vec::new());
    let target = Target { out: &mut out, encoding };
    let replies = JobReplies::new(|_: &str| {});
    gpre::prepare(&mut text.as_bytes(), None, *profile, replies, target, |_, _| {})
        .map_err(|error| error.to_string())?;
    Ok(out.into_inner())
}

/// Prints a prepared job after some lines.
fn play(profile: &Profile, lines: &[&str], job: &[u8]) -> Result<(), String> {
    let notices = RefCell::new(Vec::new());
    let replies = JobReplies::new(|text: &str| notices.borrow_mut().push(text.to_owned()));
    let session = Session::print(*profile, gpre::LOOK_AHEAD_BLOCKS, (), replies);
    let mut printer = session.printer();
    for line in lines {
        session.run(printer.execute(0, line)).unwrap();
    }
    let mut progress = JobProgress::default();
    let played = session.run(gpre::play_from(0, &mut &job[..], profile, &mut printer, &mut progress, |_| {}));
    played.map_err(|error| error.to_string())
}

/// A prepared job brings its own heights: it is refused while a mesh is on, and so is a file that
/// would switch one on.
#[test]
fn a_prepared_job_follows_no_mesh() {
    let machine = profile("[mesh]\npoints = { x = 2, y = 2 }\n[mesh.sheet]\ntilt_mm = { x = 0.5, y = 0 }\n");
    let says = "a prepared job has fixed heights and cannot follow the mesh";
    for encoding in [Encoding::Compact, Encoding::Wide] {
        let job = prepared(&machine, "G1 X10 Y10 Z2 F3000\nG1 X50\n", encoding).unwrap();
        let refused = play(&machine, &["G28", "G29"], &job).unwrap_err();
        assert!(refused.contains(says) && refused.contains("M420 S0"), "{encoding:?}: {refused}");
        // M420 S0 in the job switches the mesh off; homing does so as well.
        let job = prepared(&machine, "G28\nM420 S0\nG1 X10 Y10 Z2 F3000\nG1 X50\n", encoding).unwrap();
        assert_eq!(play(&machine, &["G28", "G29"], &job), Ok(()), "{encoding:?}");
        for line in ["G29", "M420 S1", "G80", "BED_MESH_CALIBRATE"] {
            let refused = prepared(&machine, &format!("G28\n{line}\nG1 X10 F3000\n"), encoding).unwrap_err();
            let says = "a prepared job brings its own heights and follows no mesh";
            assert!(refused.starts_with("line 2: ") && refused.contains(says), "{line}: {refused}");
        }
    }
    // A job for a machine without a probe treats these lines as every other job does.
    let flat = ferrostep_profiles::load("cartesian").unwrap();
    assert!(prepared(&flat, "G28\nG29\nM420 S1\nG1 X10 F3000\n", Encoding::Compact).is_ok());
}

/// An estimate measures the bed as the print does, and takes as long.
#[test]
fn an_estimate_takes_the_time_of_measuring() {
    let machine = profile("[mesh]\npoints = { x = 3, y = 3 }\n[mesh.sheet]\ntilt_mm = { x = 0.5, y = 0.2 }\n");
    let text = "G28\nG29\nG1 X10 Y10 Z2 F9000\nG1 X150 Y170\nG1 X10\n";
    let printed = Session::print(machine, 128, (), JobReplies::new(|_: &str| {}));
    let mut printer = printed.printer();
    let mut progress = JobProgress::default();
    printed.run(job::run(&mut text.as_bytes(), &mut printer, &mut progress, |_| {})).unwrap();
    let estimated = Session::estimate(machine, 128, JobReplies::new(|_: &str| {}));
    let mut printer = estimated.printer();
    estimated.run(job::run(&mut text.as_bytes(), &mut printer, &mut progress, |_| {})).unwrap();
    let [printed, estimated] = [printed.figures().motion_time_s, estimated.figures().motion_time_s];
    assert!((printed / estimated - 1.0).abs() < 0.01, "{printed} s, estimated {estimated} s");
}

/// Each command of the bed has one fate without a probe: one remark, and the job continues.
#[test]
fn without_a_probe_each_command_says_so_once() {
    let flat = ferrostep_profiles::load("cartesian").unwrap();
    for line in [
        "G29",
        "G29 P1",
        "G29 L10 R20 F10 B20",
        "G80",
        "G30",
        "G30 X10 Y10",
        "M48",
        "M420 S1",
        "M420 S1 Z2",
        "M420 V",
        "M421 I0 J0 Z0.1",
        "M555 X0 Y0 W10 H10",
        "BED_MESH_CALIBRATE",
        "PROBE_ACCURACY",
    ] {
        let done = run(&flat, [line]).well();
        let says = "this machine has no probe, its bed must be level by itself; no effect (said once a job)";
        assert_eq!(done.said, [format!("echo:line 1: \"{line}\": {says}")], "{line}");
        assert!(done.steps.is_empty(), "{line}");
    }
    for line in ["M420 S0", "BED_MESH_CLEAR"] {
        assert_eq!(run(&flat, [line]).well().said, [""; 0], "{line}");
    }
}
