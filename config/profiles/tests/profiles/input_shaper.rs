//! Shapers of X and Y.

use ferrostep_planner::{AxisShaper, ShaperKind};
use ferrostep_profiles::{ProfileError, builtin_text, parse};

fn with(tail: &str) -> Result<([AxisShaper; 2], u64), ProfileError> {
    let text = format!("{}\n{tail}", builtin_text("corexy").unwrap());
    parse(&text, "test.toml").map(|profile| (profile.motion.shapers, profile.plan_hash))
}

#[test]
fn each_axis_has_the_shaper_that_is_written() {
    let (none, hash) = with("").unwrap();
    assert_eq!(none, [AxisShaper::NONE; 2]);
    let (both, shaped_hash) = with(
        "[input_shaper.x]\nkind = \"ei_old\"\nfrequency_hz = 52.5\n\
         [input_shaper.y]\nkind = \"3hump_ei\"\nfrequency_hz = 38\ndamping = 0.06",
    )
    .unwrap();
    let x = AxisShaper { kind: ShaperKind::EiOld, frequency_hz: 52.5, damping: 0.1 };
    let y = AxisShaper { kind: ShaperKind::ThreeHumpEi, frequency_hz: 38.0, damping: 0.06 };
    assert_eq!(both, [x, y]);
    // Shapers change the motion as it is played: a job that was prepared without shapers
    // holds with them.
    assert_eq!(shaped_hash, hash);
    let (one, _) = with("[input_shaper]\ny = { kind = \"mzv\", frequency_hz = 40 }").unwrap();
    assert_eq!(one, [AxisShaper::NONE, AxisShaper { kind: ShaperKind::Mzv, ..AxisShaper::NONE }]);
    for kind in ShaperKind::EXAMPLES {
        let (shapers, _) = with(&format!("[input_shaper]\nx = {{ kind = \"{kind}\", frequency_hz = 60 }}")).unwrap();
        assert_eq!(shapers, [AxisShaper { kind, frequency_hz: 60.0, damping: 0.1 }, AxisShaper::NONE]);
    }
}

#[test]
fn what_cannot_be_made_is_refused_with_its_line_and_its_cure() {
    let last = builtin_text("corexy").unwrap().lines().count() + 3;
    for (table, blamed, says) in [
        ("frequency_hz = 50", "input_shaper.x.kind", "\"none\", \"zv\", \"mzv\""),
        ("kind = \"mzv\"", "input_shaper.x.frequency_hz", "5 to 500 Hz"),
        ("kind = \"zvddd\", frequency_hz = 50", "input_shaper.x.kind", "\"2hump_ei\" or \"3hump_ei\""),
        ("kind = \"mzv(5)\", frequency_hz = 50", "input_shaper.x.kind", "or a value such as \"mzv(5,0.9)\""),
        ("kind = \"mzv(9,1)\", frequency_hz = 50", "input_shaper.x.kind", "in mzv(N,T) N from 3 to 5"),
        ("kind = \"mzv(5,1.1)\", frequency_hz = 10", "input_shaper.x.frequency_hz", "for \"mzv(5,1.100)\""),
        ("kind = \"mzv\", frequency_hz = 4.9", "input_shaper.x.frequency_hz", "5 to 500 Hz"),
        ("kind = \"mzv\", frequency_hz = 501", "input_shaper.x.frequency_hz", "5 to 500 Hz"),
        ("kind = \"mzv\", frequency_hz = nan", "input_shaper.x.frequency_hz", "5 to 500 Hz"),
        ("kind = \"mzv\", frequency_hz = 50, damping = -0.1", "input_shaper.x.damping", "0 to 0.99"),
        ("kind = \"zv\", frequency_hz = 50, damping = 1", "input_shaper.x.damping", "0 to 0.99"),
        ("kind = \"ei\", frequency_hz = 50, damping = 0.41", "input_shaper.x.damping", "0 to 0.4 for \"ei\""),
        ("kind = \"2hump_ei\", frequency_hz = 50, damping = 0.31", "input_shaper.x.damping", "0 to 0.3 for"),
        ("kind = \"3hump_ei\", frequency_hz = 50, damping = 0.21", "input_shaper.x.damping", "0 to 0.2 for"),
        ("kind = \"mzv\", frequency_hz = 7.5, damping = 0", "input_shaper.x.frequency_hz", ""),
        ("kind = \"mzv\", frequency_hz = 7.4", "input_shaper.x.frequency_hz", "at least 7.54 Hz for \"mzv\""),
        (
            "kind = \"3hump_ei\", frequency_hz = 15",
            "input_shaper.x.frequency_hz",
            "longer than 100 ms; or a shorter kind",
        ),
        ("kind = \"mzv\", frequency_hz = 50, dampng = 0.1", "input_shaper.x.dampng", "damping"),
    ] {
        let outcome = with(&format!("[input_shaper]\nx = {{ {table} }}"));
        if says.is_empty() {
            assert!(outcome.is_ok(), "{table}: {outcome:?}");
            continue;
        }
        let error = outcome.unwrap_err();
        assert_eq!(error.key(), Some(blamed), "{table}");
        let error = error.to_string();
        assert!(error.starts_with(&format!("test.toml:{last}: ")) && error.contains(says), "{table}: {error}");
    }
    let error = with("[input_shaper]\nz = { kind = \"mzv\", frequency_hz = 50 }").unwrap_err();
    assert_eq!(error.key(), Some("input_shaper.z"));
    let text = format!("input_shaper = \"mzv\"\n{}", builtin_text("corexy").unwrap());
    let error = parse(&text, "test.toml").unwrap_err();
    assert!(error.to_string().contains("a table"), "{error}");
}

#[test]
fn a_moving_average_is_beside_the_shapers() {
    let average = |tail: &str| {
        let text = format!("{}\n{tail}", builtin_text("corexy").unwrap());
        parse(&text, "test.toml").map(|profile| (profile.motion.smooth_time_s, profile.plan_hash))
    };
    let (none, hash) = average("").unwrap();
    assert_eq!(none, None);
    // A plan does not depend on it.
    assert_eq!(average("[input_shaper]\nsmooth_time_s = 0.008").unwrap(), (Some(0.008), hash));
    // MZV at 15 Hz lasts 50.3 ms.
    assert!(average("[input_shaper]\nsmooth_time_s = 0.0497\nx = { kind = \"mzv\", frequency_hz = 15.1 }").is_ok());
    for (tail, blamed, says) in [
        ("smooth_time_s = 0.0009", "input_shaper.smooth_time_s", "0.001 to 0.05 s"),
        ("smooth_time_s = 0.051", "input_shaper.smooth_time_s", "0.001 to 0.05 s"),
        ("smooth_time_s = nan", "input_shaper.smooth_time_s", "0.001 to 0.05 s"),
        (
            "smooth_time_s = 0.05\ny = { kind = \"mzv\", frequency_hz = 14 }",
            "input_shaper.smooth_time_s",
            "at most 0.0461 s",
        ),
        (
            "smooth_time_s = 0.05\ny = { kind = \"mzv\", frequency_hz = 14 }",
            "input_shaper.smooth_time_s",
            "at least 15.08 Hz",
        ),
    ] {
        let error = average(&format!("[input_shaper]\n{tail}")).unwrap_err();
        assert_eq!(error.key(), Some(blamed), "{tail}");
        assert!(error.to_string().contains(says), "{tail}: {error}");
    }
    let text = builtin_text("corexy").unwrap();
    let curved = text.replace("acceleration = \"trapezoid\"", "acceleration = \"s-curve\"");
    let curved = if curved == text { format!("acceleration = \"s-curve\"\n{text}") } else { curved };
    let error = parse(&format!("{curved}\n[input_shaper]\nsmooth_time_s = 0.008"), "test.toml").unwrap_err();
    assert_eq!(error.key(), Some("acceleration"));
    assert!(error.to_string().contains("limits the jerk by itself"), "{error}");
}

#[test]
fn what_the_machine_cannot_filter_is_refused() {
    let changed = |profile: &str, from: &str, to: &str, kind: &str| {
        let text = builtin_text(profile).unwrap();
        assert_eq!(text.matches(from).count(), 1, "{profile}: {from}");
        let shaper = format!("[input_shaper]\ny = {{ kind = {kind:?}, frequency_hz = 50 }}");
        parse(&format!("{}\n{shaper}", text.replace(from, to)), "test.toml").map(|_| ())
    };
    let (kinematics, steps) = ("kinematics = \"corexy\"", "y = 160, z = 800");
    let dual_rate = format!("interpolation = \"dual-rate\"\n{kinematics}");
    let core_xz = kinematics.replace("xy", "xz");
    for (from, to, blamed, says) in [
        (
            kinematics,
            &*dual_rate,
            "interpolation",
            "expected \"step-bresenham\" with input_shaper and pressure_advance",
        ),
        (
            steps,
            "y = 160.01, z = 800",
            "steps_per_mm.y",
            "expected 160 as that of x: with input_shaper or pressure_advance",
        ),
        (
            kinematics,
            &core_xz,
            "steps_per_mm.z",
            "expected 160 as that of x: with input_shaper or pressure_advance both are the same on corexz",
        ),
    ] {
        let error = changed("corexy", from, to, "zv").unwrap_err();
        assert_eq!(error.key(), Some(blamed), "{error}");
        assert!(error.to_string().contains(says), "{error}");
        changed("corexy", from, to, "none").unwrap();
    }
    // Motors that move an axis each may differ.
    changed("cartesian", "y = 80, z = 400", "y = 100, z = 400", "zv").unwrap();
}
