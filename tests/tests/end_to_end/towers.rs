//! A tower's print is the print of the same file with the values written into it.

use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;

use crate::end_to_end::command::{directory, ferrostep, file};
use crate::end_to_end::desk::{profile, rehearse};
use crate::end_to_end::hosts::{Conversation, machine};

const LAYERS: u32 = 24;

/// Squares of 0.25 mm a layer, corners slow and sides fast; `before` precedes the first
/// line of each layer.
fn job(before: impl Fn(u32) -> String) -> String {
    let mut job = String::from("M302 P1\nM83\nG28\nG1 X40 Y40 F6000\n");
    for layer in 1..=LAYERS {
        let quarters = layer * 25;
        job +=
            &format!("G1 Z{}.{:02} F600\nG1 E-0.5 F2400\nG1 E0.5\n{}", quarters / 100, quarters % 100, before(layer));
        job += "G1 X80 Y40 E0.8 F3600\nG1 X80 Y80 E0.8 F1200\nG3 X40 Y80 R20 E0.8\nG1 X40 Y40 E0.8\n";
    }
    job
}

/// A tower, and the line with the same effect at a layer's height, mm.
type Case = (&'static str, fn(f64) -> String);

fn cases() -> [Case; 5] {
    [
        ("COMMAND=M900 PARAMETER=K START=0 FACTOR=.02", |z| format!("M900 K{}", 0.02 * z)),
        ("COMMAND=M204 PARAMETER=P START=500 STEP_DELTA=250 STEP_HEIGHT=1", |z| {
            format!("M204 P{}", 500.0 + 250.0 * z.floor())
        }),
        ("COMMAND=M221 PARAMETER=S START=100 FACTOR=-4 BAND=2", |z| {
            format!("M221 S{}", 100.0 - 4.0 * ((z / 2.0).floor() * 2.0 + 1.0))
        }),
        ("COMMAND=SET_INPUT_SHAPER PARAMETER=SHAPER_FREQ_X START=30 STEP_DELTA=5 STEP_HEIGHT=2", |z| {
            format!("SET_INPUT_SHAPER SHAPER_FREQ_X={}", 30.0 + 5.0 * (z / 2.0).floor())
        }),
        ("COMMAND=M205 PARAMETER=J START=0.01 FACTOR=0.01 SKIP=2", |z| {
            format!("M205 J{}", 0.01 + 0.01 * (z - 2.0).max(0.0))
        }),
    ]
}

#[test]
fn a_tower_is_the_print_with_its_values_in_the_file() {
    let profile = profile("cartesian");
    let plain = rehearse(&profile, LOOK_AHEAD_BLOCKS, &mut job(|_| String::new()).as_bytes());
    for (tower, line) in cases() {
        // A value that stays is not set again, which for a filter would be a stop.
        let written = job(|layer| {
            let [before, now] = [layer - 1, layer].map(|layer| line(f64::from(layer) * 0.25));
            if layer > 1 && before == now { String::new() } else { format!("{now}\n") }
        });
        let tower = format!("TUNING_TOWER {tower}\n{}", job(|_| String::new()));
        let [tower, written] = [&tower, &written].map(|job| rehearse(&profile, LOOK_AHEAD_BLOCKS, &mut job.as_bytes()));
        assert!(tower.outcome.is_ok() && written.outcome.is_ok(), "{:?}", tower.notices);
        assert_eq!(tower.figures.digests, written.figures.digests, "{}", line(1.0));
        assert_ne!(tower.figures.digests, plain.figures.digests, "{}", line(1.0));
        assert_eq!(tower.notices, plain.notices, "{}", line(1.0));
    }
}

#[test]
fn a_tower_that_a_host_sets_before_its_print_is_that_of_the_file() {
    let profile = profile("cartesian");
    let machine = machine(&profile);
    let mut conversation = Conversation::new(&machine);
    let tower = "TUNING_TOWER COMMAND=M900 PARAMETER=K START=0 FACTOR=.02";
    let job = job(|_| String::new());
    for line in [tower, "M110 N0"].into_iter().chain(job.lines()) {
        let said = conversation.say(line);
        assert_eq!(said.last().map(String::as_str), Some("ok"), "{line}: {said:?}");
    }
    assert_eq!(conversation.say("TUNING_TOWER")[1], "echo:TUNING_TOWER at Z6.00: M900 K0.12");
    conversation.finish();
    let file = rehearse(&profile, LOOK_AHEAD_BLOCKS, &mut format!("{tower}\n{job}").as_bytes());
    assert_eq!(machine.figures().digests, file.figures.digests);
}

#[test]
fn a_prepared_job_contains_no_tower() {
    let directory = directory();
    let job = format!("G28\nTUNING_TOWER COMMAND=M900 PARAMETER=K START=0 FACTOR=.02\n{}", job(|_| String::new()));
    let gcode = file(&directory, "tower.gcode", &job);
    let out = directory.path().join("tower.gpre");
    let outcome = ferrostep(["preprocess", gcode.to_str().unwrap(), "-o", out.to_str().unwrap()]);
    assert_ne!(outcome.status, Some(0), "{outcome:#?}");
    let says = "line 2: TUNING_TOWER changes values while a print is made and cannot be prepared";
    assert!(outcome.stderr.contains(says), "{outcome:#?}");
    assert!(!out.exists());
}
