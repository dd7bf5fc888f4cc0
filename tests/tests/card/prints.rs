//! A print from the card makes the same steps as `print` of the file.

use ferrostep_planner::StepDigests;
use ferrostep_printer::Profile;
use ferrostep_session::Session;
use ferrostep_session::gpre;
use ferrostep_session::job::{self, JobProgress};

use crate::card::setup::{Said, Setup, gunzip, image, nothing, profile};

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
    let replies = ferrostep_session::JobReplies::new(|_: &str| {});
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

/// A profile with two tools and macros.
fn with_macros() -> Profile {
    let text = format!(
        "{}\n[tools]\nlift_mm = 0\nbefore_change = \"WIPE\"\n[tools.t1]\nmotor = \"e1\"\noffset_mm = {{ x = 20, y = 0, z = 0 }}\n\
         [macro.WIPE]\ngcode = '''\nM118 #from {{FROM}}\nG1 X{{PLACE=70}}\n'''\n\
         [macro.BEGIN]\ngcode = '''\nG28\nG1 X50 Y{{Y=10}} F6000\nM104 S{{HOT=0}}\n'''\n",
        ferrostep_profiles::builtin_text("cartesian").unwrap()
    );
    ferrostep_profiles::parse(&text, "two.toml").unwrap()
}

#[test]
fn macros_of_the_profile_and_of_a_change_are_printed_from_the_card() {
    let setup = Setup::new(with_macros(), image());
    setup.put("MACRO.G", b"begin y=30\nM118 #begun\nT1\nM118 #end\nG1 Y35\n");
    let said = setup.say(&["M21", "M23 MACRO.G", "M24"], &mut nothing);
    let marks: Vec<&String> =
        said.iter().filter(|line| line.starts_with('#') || line.contains("Active Extruder")).collect();
    assert_eq!(marks, ["#begun", "#from 0", "echo:Active Extruder: 1", "#end"], "{said:?}");
    assert!(said.iter().any(|line| line == "Done printing file"), "{said:?}");
    // One for each line of the host.
    assert_eq!(said.iter().filter(|line| line.starts_with("ok")).count(), 3, "{said:?}");
    let [x, y, _, _] = setup.motor_steps();
    assert_eq!([x, y], [50 * 80, 35 * 80]);
}

#[test]
fn a_macro_that_fails_pauses_a_print_from_the_card() {
    let setup = Setup::new(with_macros(), image());
    setup.put("FAIL.G", b"G28\nBEGIN HOT=900\nM118 #end\n");
    let mut is_over = false;
    let said = setup.say(&["M21", "M23 FAIL.G", "M24"], &mut |_, _| {
        let ends = setup.has_said("//action:paused") && !std::mem::replace(&mut is_over, true);
        if ends { vec!["M524".to_owned()] } else { Vec::new() }
    });
    let place =
        said.iter().position(|line| line == "echo:line 2: BEGIN, line 3: \"M104 S900\" ends the macro").unwrap();
    assert!(said[place + 1].starts_with("echo:line 2: ") && said[place + 2].contains("paused at line 2"), "{said:?}");
    assert!(!said.iter().any(|line| line == "#end"), "{said:?}");
}
