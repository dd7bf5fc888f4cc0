//! Accelerations from the error that is allowed.

use ferrostep_profiles::response::FrameMode;
use ferrostep_profiles::{ProfileError, builtin_text, error_budget, parse};

const FRAME: &str = "[frame.x]\nfrequency_hz = 60\nfrequency_uncertainty_hz = 1.2\ndamping = 0.06\n\
                     [frame.y]\nfrequency_hz = 50\nfrequency_uncertainty_hz = 1\n";
const SHAPERS: &str =
    "[input_shaper]\nx = { kind = \"zv\", frequency_hz = 60 }\ny = { kind = \"zv\", frequency_hz = 50 }\n";

/// The CoreXY's text with these keys before its own and these tables after them.
fn text(keys: &str, tables: &str) -> String {
    format!("{keys}\n{}\n{tables}", builtin_text("corexy").unwrap())
}

/// Largest accelerations of X and Y, and the number that prepared jobs are bound to.
fn accelerations(keys: &str, tables: &str) -> Result<([f64; 2], u64), ProfileError> {
    let profile = parse(&text(keys, tables), "test.toml")?;
    let [x, y, z, e] = profile.limits.max_acceleration_mm_per_s2;
    // The others are not touched.
    assert_eq!([z, e], [500.0, 10_000.0]);
    Ok(([x, y], profile.plan_hash))
}

fn refusal(keys: &str, tables: &str) -> ProfileError {
    accelerations(keys, tables).unwrap_err()
}

#[test]
fn without_a_budget_nothing_changes() {
    let (own, hash) = accelerations("", "").unwrap();
    assert_eq!(own, [10_000.0; 2]);
    assert_eq!(accelerations("", &format!("{FRAME}{SHAPERS}")).unwrap(), (own, hash));
    let frame = error_budget(&text("", FRAME), "test.toml").unwrap();
    assert_eq!(frame.budget_mm, None);
    let y = FrameMode { frequency_hz: 50.0, frequency_uncertainty_hz: 1.0, damping: 0.1 };
    assert_eq!(
        frame.frame,
        [Some(FrameMode { frequency_hz: 60.0, frequency_uncertainty_hz: 1.2, damping: 0.06 }), Some(y)]
    );
}

#[test]
fn each_axis_accelerates_as_its_frame_and_filter_allow() {
    let of = |budget: &str, tables: &str| accelerations(&format!("error_budget_mm = {budget}"), tables).unwrap().0;
    let shaped = format!("{FRAME}{SHAPERS}");
    let [x, y] = of("0.03", &shaped);
    // The softer axis accelerates less, about by the square of the frequencies.
    assert!(x / y > 1.3 && x / y < 1.6 && y > 1000.0 && x < 10_000.0, "{x} {y}");
    // More error, more acceleration, up to that of the profile.
    let [more_x, more_y] = of("0.045", &shaped);
    assert!(more_x > 1.4 * x && more_y > 1.4 * y, "{more_x} {more_y}");
    assert_eq!(of("1", &shaped), [10_000.0; 2]);
    // Without filters the frame itself is all that there is.
    let [bare_x, bare_y] = of("0.03", FRAME);
    assert!(bare_x < 0.3 * x && bare_y < 0.3 * y, "{bare_x} {bare_y}");
    // A frame whose frequency is known worse is driven slower.
    let [unsure_x, same_y] = of("0.03", &shaped.replace("_hz = 1.2", "_hz = 6"));
    assert!(unsure_x < 0.8 * x && same_y == y, "{unsure_x} {same_y}");
    // Sharper corners leave more for the acceleration.
    let sharper = text("error_budget_mm = 0.03", &shaped)
        .replace("junction_deviation_mm = 0.02", "junction_deviation_mm = 0.005");
    assert!(parse(&sharper, "test.toml").unwrap().limits.max_acceleration_mm_per_s2[0] > 1.3 * x);
}

#[test]
fn prepared_jobs_are_bound_to_the_accelerations_that_follow() {
    let shaped = format!("{FRAME}{SHAPERS}");
    let (none, budget, more) = ("", "error_budget_mm = 0.03", "error_budget_mm = 1");
    let hash = |keys: &str, tables: &str| accelerations(keys, tables).unwrap().1;
    assert_ne!(hash(none, &shaped), hash(budget, &shaped));
    // A budget that changes no acceleration, and another way to the same accelerations.
    assert_eq!(hash(none, &shaped), hash(more, &shaped));
    let ([x, y], bound) = accelerations(budget, &shaped).unwrap();
    let written = format!("x = {x}, y = {y}, z = 500");
    let same = text("", "").replace("x = 10000, y = 10000, z = 500", &written);
    assert_ne!(same, text("", ""));
    assert_eq!(parse(&same, "test.toml").unwrap().plan_hash, bound);
}

#[test]
fn a_budget_that_nothing_keeps_is_refused_with_what_would_do() {
    let shaped = format!("{FRAME}{SHAPERS}");
    let only_x = FRAME.split("[frame.y]").next().unwrap();
    for tables in ["", SHAPERS, only_x] {
        let error = refusal("error_budget_mm = 0.03", tables);
        assert_eq!((error.key(), error.line()), (Some("error_budget_mm"), Some(1)));
        assert!(error.to_string().contains("expected frame.x and frame.y in the profile"), "{error}");
    }
    let error = refusal("error_budget_mm = 0.005", &shaped);
    assert_eq!((error.key(), error.line()), (Some("error_budget_mm"), Some(1)));
    let shown = error.to_string();
    assert!(shown.contains("with which y accelerates at 100 mm/s^2"), "{shown}");
    assert!(shown.contains("a smaller frame.y.frequency_uncertainty_hz, a shorter input_shaper.y"), "{shown}");
    // The named budget would do, and hardly less.
    let least: f64 = shown.split("at least ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    let ([_, y], _) = accelerations(&format!("error_budget_mm = {least}"), &shaped).unwrap();
    assert!((100.0..=110.0).contains(&y), "{y}");
    refusal(&format!("error_budget_mm = {}", least - 0.0002), &shaped);
}

#[test]
fn a_frame_that_is_none_is_refused() {
    for (from, to, blamed, says) in [
        ("frequency_hz = 60", "frequency_hz = 4", "frame.x.frequency_hz", "5 to 500 Hz"),
        ("_hz = 1.2", "_hz = 30.1", "frame.x.frequency_uncertainty_hz", "0 to 30 Hz, at most half of frequency_hz"),
        ("_hz = 1.2", "_hz = -1", "frame.x.frequency_uncertainty_hz", "0 to 30 Hz"),
        ("damping = 0.06", "damping = 0.61", "frame.x.damping", "0 to 0.6"),
        ("damping = 0.06", "ratio = 0.06", "frame.x.ratio", "damping"),
        ("[frame.y]", "[frame.z]", "frame.z", "\"x\" or \"y\""),
        ("frequency_uncertainty_hz = 1\n", "", "frame.y.frequency_uncertainty_hz", "missing"),
    ] {
        assert!(FRAME.contains(from), "{from}");
        let error = refusal("", &FRAME.replace(from, to));
        assert_eq!(error.key(), Some(blamed), "{error}");
        assert!(error.to_string().contains(says), "{error}");
    }
    for budget in ["0", "-0.1", "1.1", "nan", "\"small\""] {
        let error = refusal(&format!("error_budget_mm = {budget}"), FRAME);
        assert_eq!(error.key(), Some("error_budget_mm"), "{error}");
    }
}
