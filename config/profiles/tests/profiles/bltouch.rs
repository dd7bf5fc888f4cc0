//! A probe with a pin: its keys, and the room that a pin needs.

use ferrostep_printer::BlTouch;
use ferrostep_profiles::{builtin_text, parse};

/// The MINI's profile with a table and after replacements.
fn mini(table: &str, changes: &[(&str, &str)]) -> Result<Option<BlTouch>, String> {
    let mut text = format!("{}\n{table}", builtin_text("prusa-mini").unwrap());
    for (from, to) in changes {
        assert!(text.contains(from), "{from:?} does not occur");
        text = text.replace(from, to);
    }
    parse(&text, "mini.toml").map(|profile| profile.bltouch).map_err(|error| error.to_string())
}

#[test]
fn a_pin_is_there_with_its_table_alone() {
    assert_eq!(mini("", &[]), Ok(None));
    let usual = BlTouch { move_ms: 680, stows_each_touch: true, tests_signal: true };
    assert_eq!(mini("[bltouch]", &[]), Ok(Some(usual)));
    let all = "[bltouch]\nmove_ms = 400\nstow_each_touch = false\ntest_signal = false";
    let other = BlTouch { move_ms: 400, stows_each_touch: false, tests_signal: false };
    assert_eq!(mini(all, &[]), Ok(Some(other)));
}

#[test]
fn what_contradicts_a_pin_is_refused() {
    let offset = ("x = -29, y = -3, z = 0", "x = -29, y = -3, z = -2.5");
    for (table, changes, expected) in [
        ("[bltouch]\nmove_ms = 50", &[] as &[_], "bltouch.move_ms = 50: expected 100 to 5000 ms"),
        ("[bltouch]", &[offset], "homing.raise_mm = 4: expected at least 4.5 mm with the table [bltouch]"),
        ("[bltouch]", &[offset, ("raise_mm = 4\n", "raise_mm = 10\n")], "mesh.lift_mm = 2: expected at least 4.5 mm"),
        (
            "[bltouch]\nstow_each_touch = false",
            &[("fast_mm_per_s = 6\n", "fast_mm_per_s = 2\n")],
            "bltouch.stow_each_touch = false: expected true, or homing.z.back_off_mm at most 0.65 s of homing.z.fast_mm_per_s",
        ),
    ] {
        let error = mini(table, changes).unwrap_err();
        assert!(error.contains(expected), "{error}");
    }
    let text = format!("{}\n[bltouch]", builtin_text("corexy").unwrap());
    let error = parse(&text, "corexy.toml").unwrap_err().to_string();
    assert!(
        error.contains("bltouch = [bltouch]: expected homing.z.sensor = \"probe\" with it: only a probe has a pin"),
        "{error}"
    );
}
