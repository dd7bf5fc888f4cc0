//! A nozzle that is controlled by its model, on the Octopus: the image finds the model, prints by
//! it, and knows how fast filament is melted.

use std::sync::OnceLock;

use crate::firmware::bench::Bench;
use crate::firmware::equipped::octopus;
use crate::firmware::images::{Variant, changed};
use crate::firmware::job::Job;

/// A small hot end, so that a test need not wait: what the plant has, and what the image is told
/// before it finds out.
const TABLES: &str = "[nozzle]\nmodel = { power_w = 40, capacity_j_per_k = 6, loss_w_per_k = 0.068, fan_loss_w_per_k = 0.029, \
     dead_time_s = 0.3 }\ncontrol_model = { power_w = 40, capacity_j_per_k = 12, loss_w_per_k = 0.1, fanned_loss_w_per_k = 0.1, \
     sensor_per_s = 0.5 }\n";

/// Lines of the cube: homing, the skirt and a part of the first layer.
const LINES: usize = 100;

/// PLA of 1.75 mm.
const PLA_J_PER_K_MM: f64 = 0.0054;

/// Play of Z, of which `backlash.rs` has the test: X and Y share their motors.
const PLAY: &str = "\n[backlash]\nplay_mm = { x = 0, y = 0, z = 0.1 }\n";

/// Image with the model, which is built once.
pub fn with_model() -> &'static Variant {
    static BUILT: OnceLock<Variant> = OnceLock::new();
    BUILT.get_or_init(|| {
        let tables = |profile: String| profile.replacen("[nozzle]\n", TABLES, 1) + PLAY;
        changed("btt-octopus-1.1", "corexy", "octopus-with-model", |board| board, tables)
    })
}

/// The true temperature of the nozzle.
fn celsius(bench: &mut Bench) -> f64 {
    let now_ns = bench.now_ns();
    bench.with(move |machine, _| {
        let place = machine.plant.heaters.iter_mut().find(|heater| heater.name == "nozzle").unwrap();
        place.heater.body_celsius(now_ns)
    })
}

/// The number after a letter of a line.
fn number(line: &str, letter: char) -> f64 {
    let word =
        line.split(' ').find_map(|word| word.strip_prefix(letter)).unwrap_or_else(|| panic!("{letter} in {line}"));
    word.parse().unwrap()
}

/// Lets the image find the model, which takes minutes: the line that sets it.
fn tune(bench: &mut Bench) -> String {
    bench.host.send_raw(b"M306 T\n").unwrap();
    let mut parts = 0;
    loop {
        let line = bench.host.wait_for("a sign of life", |_| true).unwrap();
        assert!(!line.starts_with("Error"), "{line}");
        parts += u32::from(line.starts_with(" part: "));
        if line == "MPC Autotune finished!" {
            break;
        }
    }
    assert_eq!(parts, 5);
    let found = bench.host.wait_for("the model", |line| line.starts_with("echo:M306 E0 ")).unwrap();
    bench.host.wait_for("ok", |line| line == "ok").unwrap();
    found
}

/// Greatest distance of the nozzle from this temperature while 15 mm^3/s are pushed for 12 s,
/// and for 12 s after.
fn disturbance(bench: &mut Bench, at_rest: f64) -> f64 {
    let mut worst = 0.0_f64;
    bench.host.send("G92 E0").unwrap();
    bench.host.send("G1 E75 F374").unwrap();
    for _ in 0..240 {
        bench.pass(100);
        worst = worst.max((celsius(bench) - at_rest).abs());
    }
    worst
}

#[test]
fn an_image_finds_its_nozzle_s_model_and_prints_by_it() {
    let Variant { board, profile, image } = with_model();
    let mut bench = Bench::boot_variant(octopus(), board, profile, image);
    assert_eq!(bench.host.ask("M306", "echo:M306").unwrap(), "echo:M306 E0 P40 C12 R0.5 A0.1 F0.1 H0.0054");
    bench.host.send_raw(b"M301 P20\n").unwrap();
    bench.host.wait_for("a refusal", |line| line.contains("a model controls this heater")).unwrap();
    bench.host.wait_for("ok", |line| line == "ok").unwrap();
    let found = tune(&mut bench);
    // The plant's constants, and with its lag of 0.5 s the dead time of 0.3 s and the image's own
    // filter of 0.2 s.
    for (letter, is, share) in [('C', 6.0, 0.1), ('A', 0.068, 0.1), ('F', 0.097, 0.1), ('R', 1.0, 0.3)] {
        let number = number(&found, letter);
        assert!((number / is - 1.0).abs() < share, "{letter}: {number} of {is}, {found}");
    }
    assert_eq!(bench.host.ask("M306", "echo:M306").unwrap(), found, "what was found is in force");

    // The plant's thermistor follows its maker's beta, the image the table: what it holds
    // for 210 degrees.
    bench.host.send("M109 S210").unwrap();
    bench.pass(10_000);
    let at_rest = celsius(&mut bench);
    assert!((200.0..220.0).contains(&at_rest), "{at_rest}");

    // A print, whose filament takes heat.
    bench.change(|plant, _| plant.filament_j_per_k_mm = PLA_J_PER_K_MM);
    let job = Job::cube(LINES);
    for line in job.lines() {
        bench.host.send(line).unwrap();
        let off = celsius(&mut bench) - at_rest;
        assert!(off.abs() < 2.0, "{line}: off by {off}");
    }
    bench.host.send("M400").unwrap();
    bench.pass(5000);

    // It knows of the filament: without that heat in the model the nozzle goes off much further.
    bench.host.send("M83").unwrap();
    let known = disturbance(&mut bench, at_rest);
    bench.host.send("M306 H0").unwrap();
    let unknown = disturbance(&mut bench, at_rest);
    assert!(known < 0.5 && unknown > 2.0 * known, "{known} and, not knowing, {unknown}");
}
