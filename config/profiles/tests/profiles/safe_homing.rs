//! Protection of the bed from the nozzle: keys that a probe needs, and places that a machine has.

use ferrostep_profiles::{builtin_text, parse};

/// The MINI's profile after replacements.
fn mini(changes: &[(&str, &str)]) -> String {
    let mut text = builtin_text("prusa-mini").unwrap().to_owned();
    for (from, to) in changes {
        assert_eq!(text.matches(from).count(), 1, "{from:?} must occur once");
        text = text.replace(from, to);
    }
    text
}

/// The one-line error after them.
fn error(changes: &[(&str, &str)]) -> String {
    parse(&mini(changes), "mini.toml").expect_err("refused").to_string()
}

/// The line number of a text, counted from 1.
fn line(text: &str, wanted: &str) -> usize {
    1 + text.lines().position(|line| line.starts_with(wanted)).unwrap()
}

const HOME_AT: &str = "home_at_mm = { x = 176.4, y = 24.1 }\n";
const RAISE: &str = "raise_mm = 4\n";
const OFFSET: &str = "probe_offset_mm = { x = -29, y = -3, z = 0 }\n";

#[test]
fn a_probe_without_what_it_needs_is_refused() {
    for (key, written) in
        [("homing.home_at_mm", HOME_AT), ("homing.raise_mm", RAISE), ("homing.probe_offset_mm", OFFSET)]
    {
        let text = mini(&[(written, "")]);
        let error = parse(&text, "mini.toml").expect_err(key).to_string();
        let number = line(&text, "sensor = \"probe\"");
        let start = format!("mini.toml:{number}: homing.z.sensor = \"probe\": expected {key} with it: ");
        assert!(error.starts_with(&start) && error.contains("; for example "), "{error}");
    }
    // A switch needs none of these keys, and has no offset.
    let switch = ("sensor = \"probe\"", "sensor = \"end-stop\"");
    let no_mesh = (crate::mesh::MESH, "");
    parse(&mini(&[switch, no_mesh, (HOME_AT, ""), (RAISE, ""), (OFFSET, "")]), "mini.toml").unwrap();
    assert!(
        error(&[switch, no_mesh])
            .contains("homing.probe_offset_mm.x = -29: expected homing.z.sensor = \"probe\" with it")
    );
}

#[test]
fn a_probe_that_misses_the_bed_is_refused_with_the_numbers() {
    let text = mini(&[("x = 176.4, y", "x = 28.9, y")]);
    let number = line(&text, "home_at_mm");
    assert_eq!(
        parse(&text, "mini.toml").unwrap_err().to_string(),
        format!(
            "mini.toml:{number}: homing.home_at_mm.x = 28.9: expected 29 to 209 mm: the probe is -29 mm beside the nozzle \
             (homing.probe_offset_mm.x), and misses the bed, which reaches from 0 to 180 mm (homing.bed_mm)"
        )
    );
    // Where the machine homes without it: in front of the sheet.
    assert!(error(&[("y = 24.1", "y = -3")]).contains("homing.home_at_mm.y = -3: expected 3 to 183 mm"));
    // Without an outline the travel is the bed: the probe is at -1 mm there, and the
    // travel begins at -2.
    let outline = "bed_mm = { x = [0, 180], y = [0, 180] }\n";
    parse(&mini(&[(outline, ""), ("x = 176.4, y", "x = 28, y")]), "mini.toml").unwrap();
}

#[test]
fn places_outside_the_travel_are_refused() {
    assert!(error(&[("x = 176.4, y", "x = 181, y")]).contains("homing.home_at_mm.x = 181: expected -2 to 180.4 mm"));
    assert!(error(&[("position_mm = 180.4", "position_mm = 181")]).contains("expected 89.2 to 180.4 mm"));
    assert!(error(&[("position_mm = -3", "position_mm = -3.1")]).contains("expected -3 to 88.5 mm"));
    assert!(
        error(&[("x = -2, y = -3, z = 0", "x = -2, y = 1, z = 0")]).contains("lower_end_mm.y = 1: expected -1000 to 0")
    );
}

#[test]
fn lengths_keep_to_their_ranges() {
    assert!(
        error(&[("y = -3, z = 0 }\nbed", "y = -3, z = -10.1 }\nbed")])
            .contains("homing.probe_offset_mm.z = -10.1: expected -10 to 5")
    );
    assert!(error(&[(RAISE, "raise_mm = 0\n")]).contains("homing.raise_mm = 0: expected 0.5 to 50"));
    assert!(error(&[("y = [0, 180] }", "y = [180, 0] }")]).contains("homing.bed_mm.y = [180, 0]: expected "));
    assert!(
        error(&[("back_off_mm = 2\n", "back_off_mm = 2\nagree_mm = 3\n")])
            .contains("homing.z.agree_mm = 3: expected 0.01 to 2")
    );
    let overrun = ("back_off_mm = 2\noverrun_mm = 10", "back_off_mm = 2\noverrun_mm = 31");
    assert!(error(&[overrun]).contains("homing.z.overrun_mm = 31: expected 0 to 30"));
}

#[test]
fn keys_that_may_be_left_out() {
    let text = mini(&[("slow_mm_per_s = 1.5\n", "slow_mm_per_s = 1.5\nagree_mm = 0.1\n")]);
    assert_eq!(parse(&text, "mini.toml").unwrap().homing[2].agree_10nm, 10_000);
    let text = mini(&[("lower_end_mm = { x = -2, y = -3, z = 0 }\n", ""), ("position_mm = -3", "position_mm = 0")]);
    assert_eq!(parse(&text, "mini.toml").unwrap().lower_end_10nm, [0; 3]);
}
