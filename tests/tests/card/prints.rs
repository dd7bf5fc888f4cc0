//! A print from the card makes the same steps as `print` of the file.

use ferrostep::gpre;
use ferrostep::job::{self, JobProgress};
use ferrostep::session::Session;
use ferrostep_planner::StepDigests;
use ferrostep_printer::Profile;

use crate::setup::{Said, Setup, gunzip, image, nothing, profile};

/// The result of `print` for a file.
pub fn printed(profile: Profile, text: &[u8]) -> StepDigests {
    let session = Session::print(profile, 128, (), Said::default());
    let mut printer = session.printer();
    let outcome = session.run(job::run(&mut &text[..], &mut printer, &mut JobProgress::default(), |_| {}));
    outcome.unwrap();
    session.figures().digests
}

#[test]
fn a_file_on_the_card_prints_as_the_file_does() {
    let text = gunzip("examples/cube-slic3r.gcode.gz");
    let setup = Setup::new(profile("cartesian"), image());
    setup.put("CUBE.GCO", &text);
    let said = setup.say(&["M21", "M23 CUBE.GCO", "M24"], &mut nothing);
    assert_eq!(said.last().unwrap(), "Done printing file", "{said:?}");
    assert_eq!(setup.digests(), printed(profile("cartesian"), &text));
}

#[test]
fn a_prepared_job_on_the_card_prints_as_the_file_does() {
    let text = gunzip("examples/cube-slic3r.gcode.gz");
    let mut job = std::io::Cursor::new(Vec::new());
    let target = gpre::Target { out: &mut job, encoding: ferrostep_gpre::Encoding::Compact };
    let replies = ferrostep::session::JobReplies::new(|_: &str| {});
    gpre::prepare(&mut &text[..], None, profile("cartesian"), replies, target, |_, _| {}).unwrap();
    let job = job.into_inner();
    let undisturbed = Setup::new(profile("cartesian"), image());
    undisturbed.put("CUBE.GPR", &job);
    let said = undisturbed.say(&["M21", "M23 CUBE.GPR", "M24"], &mut nothing);
    assert_eq!(said.last().unwrap(), "Done printing file", "{said:?}");
    assert_eq!(undisturbed.digests().order, printed(profile("cartesian"), &text).order);

    // Paused in the middle, where the nozzle goes aside, and resumed.
    let setup = Setup::new(profile("cartesian"), image());
    setup.put("CUBE.GPR", &job);
    let mut is_paused = false;
    let mut pauses = 0;
    let said = setup.say(&["M21", "M23 CUBE.GPR", "M24"], &mut |_, progress| {
        let (position, size) = progress.unwrap_or_default();
        let half = position > size / 2;
        if half && pauses == 0 {
            (is_paused, pauses) = (true, 1);
            return vec!["M25".to_owned()];
        }
        if std::mem::take(&mut is_paused) { vec!["M24".to_owned()] } else { Vec::new() }
    });
    assert_eq!(said.last().unwrap(), "Done printing file", "{said:?}");
    assert_eq!(pauses, 1);
    assert!(said.contains(&"//action:resumed".to_owned()), "{said:?}");
    assert_eq!(setup.motor_steps(), undisturbed.motor_steps());
    assert_ne!(setup.digests().order, undisturbed.digests().order);
}

#[test]
fn a_job_for_another_machine_is_refused() {
    let setup = Setup::new(profile("cartesian"), image());
    setup.put("BAD.GPR", b"G28\n");
    let said = setup.say(&["M21", "M23 BAD.GPR", "M24"], &mut nothing);
    assert!(said.iter().any(|line| line.starts_with("echo:gpre: ")), "{said:?}");
    assert!(said.iter().any(|line| line == "echo:card: the print has ended at byte 0"), "{said:?}");
    assert!(!said.iter().any(|line| line == "Done printing file"), "{said:?}");
}
