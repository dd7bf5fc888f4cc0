//! The ends of the bed: a machine that homes by stall is some hundredths beside the place that it
//! counts, and still finds the sheet there.

use ferrostep_printer::Profile;

use super::rig::run;

/// A MINI whose profile does not say which part of the bed is measured.
fn without_area() -> Profile {
    let text = ferrostep_profiles::builtin_text("prusa-mini").unwrap();
    let area = "area_mm = { x = [5, 151], y = [5, 175] }\n";
    assert!(text.contains(area));
    ferrostep_profiles::parse(&text.replacen(area, "", 1), "mini-no-area.toml").unwrap()
}

/// Heights of the mesh's points, mm.
fn heights(said: &[String]) -> Vec<f64> {
    let rows = said.iter().filter(|line| line.contains(" +") || line.contains(" -"));
    rows.flat_map(|line| line.split_whitespace().skip(1).map(|number| number.parse().unwrap())).collect()
}

#[test]
fn the_default_area_gives_a_flat_mesh() {
    let done = run(&without_area(), ["G28", "G29"]).well();
    let heights = heights(&done.said);
    assert_eq!(heights.len(), 16, "{:#?}", done.said);
    assert!(heights.iter().all(|height| height.abs() < 0.006), "{heights:?}");
}

/// Prusa's start code cleans its mesh from the corner on.
#[test]
fn the_very_ends_of_the_bed_are_found() {
    for profile in [without_area(), ferrostep_profiles::load("prusa-mini").unwrap()] {
        run(&profile, ["G28", "G29 P1 X0 Y0 W50 H20 C", "G30 X10 Y0", "G30 X0 Y0", "G30 X10 Y0.05", "G30 X10 Y177"])
            .well();
    }
}
