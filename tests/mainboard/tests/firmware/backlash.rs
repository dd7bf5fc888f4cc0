//! The play of Z on the Octopus: its motor goes farther where it turns, and the image's
//! own count agrees.

use crate::firmware::bench::Bench;
use crate::firmware::equipped::octopus;
use crate::firmware::heater_model::with_model;
use crate::firmware::images::Variant;

/// `play_mm.z` of the profile.
const PLAY_MM: f64 = 0.1;

/// Position of Z's motor, mm.
fn motor_mm(bench: &mut Bench) -> f64 {
    bench.host.send("M400").unwrap();
    bench.with(|machine, _| machine.plant.motion.motor_mm(2))
}

#[test]
fn z_s_motor_goes_farther_where_it_turns() {
    let Variant { board, profile, image } = with_model();
    let mut bench = Bench::boot_variant(octopus(), board, profile, image);
    let settings = bench.host.ask("M425", "echo:  M425").unwrap();
    assert_eq!(settings, "echo:  M425 F1.00 S1.00 X0 Y0 Z0.1 ; (mm)");
    bench.host.send("G91").unwrap();
    let start = motor_mm(&mut bench);
    for (line, plan_mm, ahead_mm) in [
        ("G1 Z3 F600", 3.0, 0.0),
        ("G1 Z-2", 1.0, -PLAY_MM),
        ("G1 Z-0.5", 0.5, -PLAY_MM),
        ("G1 X5 F3000", 0.5, -PLAY_MM),
        ("G1 Z2 F600", 2.5, 0.0),
        ("M425 Z0.05", 2.5, 0.0),
        ("G1 Z-2", 0.5, -0.05),
        ("M425 F0", 0.5, -0.05),
        ("G1 Z2", 2.5, -0.05),
    ] {
        bench.host.send(line).unwrap();
        let moved = motor_mm(&mut bench) - start;
        assert!((moved - plan_mm - ahead_mm).abs() < 0.004, "{line}: {moved}");
    }
    let z = bench.host.ask("M114", "X:").unwrap();
    assert!(z.contains(" Z:2.50 "), "{z}");
    let motion = bench.host.ask("M797", "echo:motion ").unwrap();
    assert!(motion.contains(" miscounts:0") && motion.contains(" refused_entries:0"), "{motion}");
}
