//! A print never continues cold: while any of its lines waits, its heaters keep their targets, or
//! are heated again before anything moves. The same files by a card, a host that waits for each
//! answer, and `print`.

use ferrostep_printer::Profile;
use ferrostep_session::Session;
use ferrostep_session::job::{self, JobProgress};

use crate::card::setup::{Said, Setup, image, profile};

/// Bed temperatures in replies to M105, degrees Celsius.
fn beds_celsius(said: &[String]) -> Vec<f32> {
    let reports = said.iter().filter(|line| line.contains("T:") && !line.contains(" W:"));
    let bed = |line: &String| line.split_once("B:")?.1.split_whitespace().next()?.parse().ok();
    reports.filter_map(bed).collect()
}

/// A file that prints with 100 degrees of the bed after it has waited.
fn file(waits: &str) -> String {
    format!(
        "G28\nM140 S100\nM190 S100\n{waits}\nM104 S200\nM109 S200\nM83\nG1 X50 Y50 Z0.2 F3000\nG1 X60 E1 F1200\nM105\n\
         G1 X70 E1\n"
    )
}

fn switched_off(said: &[String]) -> bool {
    said.iter().any(|line| line.starts_with("echo:heaters switched off"))
}

/// Prints from the card; a pause ends after 40 minutes.
fn from_card(profile: Profile, text: &str) -> Vec<String> {
    let setup = Setup::new(profile, image());
    setup.put("SOAK.GCO", text.as_bytes());
    setup.idle_ms.set(100);
    let mut paused_s = None;
    setup.say(&["M21", "M23 SOAK.GCO", "M24"], &mut |_, _| {
        if paused_s.is_none() && setup.has_said("//action:paused") {
            paused_s = Some(setup.now_s());
        }
        let goes_on = paused_s.is_some_and(|paused_s| setup.now_s() > paused_s + 2405.0);
        if goes_on && !setup.has_said("//action:resumed") { vec!["M24".to_owned()] } else { Vec::new() }
    })
}

fn by_host(profile: Profile, text: &str) -> Vec<String> {
    let setup = Setup::new(profile, image());
    let lines: Vec<&str> = text.lines().collect();
    setup.say(&lines, &mut |_, _| Vec::new())
}

fn by_print(profile: Profile, text: &str) -> Vec<String> {
    let session = Session::print(profile, 128, (), Said::default());
    let mut printer = session.printer();
    session.run(job::run(&mut text.as_bytes(), &mut printer, &mut JobProgress::default(), |_| {})).unwrap();
    session.replies().0.take()
}

type Printed = fn(Profile, &str) -> Vec<String>;

#[test]
fn a_long_wait_in_a_print_leaves_the_bed_hot() {
    for waits in [
        "G4 S2400",
        "G4 S1700\nG4 S1700\nG4 S1700",
        "M86 S60\nG4 S90\nG4 S90\nM109 R150\nM109 S210",
        "M86 S60\nM190 R80\nM190 S100",
        "M104 S170\nG4 S2400\nM400",
    ] {
        for (way, printed) in
            [("card", from_card as Printed), ("host", by_host as Printed), ("print", by_print as Printed)]
        {
            let said = printed(profile("cartesian"), &file(waits));
            assert!(!switched_off(&said), "{waits:?} by {way}: {said:#?}");
            let beds = beds_celsius(&said);
            assert!(beds.len() == 1 && beds[0] > 97.0, "{waits:?} by {way}: {beds:?}");
        }
    }
}

/// Heaters go off while a print waits for a person, and are hot again before the next move.
#[test]
fn a_pause_of_forty_minutes_heats_again() {
    for waits in ["M601", "M0", "M600", "M0 S2400", "M104 S170\nM109 S170\nM600"] {
        let said = from_card(profile("cartesian"), &file(waits));
        assert!(switched_off(&said), "{waits:?}: {said:#?}");
        assert_eq!(said.last().map(String::as_str), Some("Done printing file"), "{waits:?}: {said:#?}");
        let beds = beds_celsius(&said);
        assert!(beds.len() == 1 && beds[0] > 97.0, "{waits:?}: {beds:?}");
    }
    let said = by_print(profile("cartesian"), &file("M0 S2400"));
    let remarks = said.iter().filter(|line| line.contains("switches its heaters off after 1800 s of this pause"));
    assert_eq!(remarks.count(), 1, "{said:#?}");
}

/// A wait for heat whose temperature does not come nearer does not count as a use of the heaters:
/// it ends the print.
#[test]
fn a_bed_that_never_arrives_ends_the_print() {
    let mut weak = profile("prusa-mini");
    // A bed in equilibrium at 92 degrees, which its maker's watch allows.
    weak.bed.mass.loss_w_per_k = weak.bed.mass.heater_w / 70.0;
    let setup = Setup::new(weak, image());
    setup.put("SOAK.GCO", file("").as_bytes());
    let mut polls = 0;
    let said = setup.say(&["M21", "M23 SOAK.GCO", "M24"], &mut |_, _| {
        polls += 1;
        if setup.has_said("//action:paused") && polls % 1000 == 0 { vec!["M524".to_owned()] } else { Vec::new() }
    });
    assert!(switched_off(&said), "{said:#?}");
    assert!(said.iter().any(|line| line.contains("the heaters were switched off during the wait")), "{said:#?}");
    assert_eq!(beds_celsius(&said), [0.0_f32; 0], "no line after it was executed");
}
