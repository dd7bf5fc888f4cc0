//! M48 on a probe of known scatter.

use super::rig::{profile, run};

/// Approaches end anywhere within 0.05 mm of the sheet, all places alike: their standard deviation
/// is 0.05 mm / sqrt(3).
#[test]
fn the_deviation_is_that_of_the_probe() {
    let machine = profile("[mesh]\n[mesh.sheet]\nscatter_mm = 0.05\n");
    let done = run(&machine, ["G28", "M48 P250 X100 Y100"]).well();
    let deviation: f64 = done.line("Standard Deviation: ").parse().unwrap();
    let expected = 0.05 / 3f64.sqrt();
    println!("M48: {deviation} mm, the probe's is {expected:.6} mm");
    // 250 draws of an even distribution: 3 % is a standard error.
    assert!((deviation / expected - 1.0).abs() < 0.09, "{deviation} mm, expected {expected} mm");
    let words: Vec<f64> = done.line("Mean: ").split_whitespace().filter_map(|word| word.parse().ok()).collect();
    let [mean, least, most, range] = words[..] else { panic!("{words:?}") };
    assert!((most - least - range).abs() < 1e-4 && range <= 0.105 && range > 0.09, "{words:?}");
    // One of these places is that at which Z was homed.
    assert!(mean.abs() < 0.06 && least < mean && mean < most, "{words:?}");
}

#[test]
fn an_exact_probe_has_no_deviation() {
    for line in ["M48", "M48 P4 X150 Y30", "PROBE_ACCURACY SAMPLES=12"] {
        let done = run(&profile(""), ["G28", line]).well();
        let deviation: f64 = done.line("Standard Deviation: ").parse().unwrap();
        assert!(deviation < 0.0013, "{line}: {deviation}");
    }
}
