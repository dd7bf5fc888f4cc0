//! The tolerance of the filtered path.

use ferrostep_planner::MotionChoice;
use ferrostep_profiles::{ProfileError, builtin_text, parse};

const SHAPERS: &str =
    "[input_shaper]\nx = { kind = \"mzv\", frequency_hz = 60 }\ny = { kind = \"mzv\", frequency_hz = 50 }\n";

/// Methods, and the number that prepared jobs are bound to, of the CoreXY's text with these keys
/// before its own and these tables after them.
fn with(keys: &str, tables: &str) -> Result<(MotionChoice, u64), ProfileError> {
    let text = format!("{keys}\n{}\n{tables}", builtin_text("corexy").unwrap());
    parse(&text, "test.toml").map(|profile| (profile.motion, profile.plan_hash))
}

#[test]
fn it_is_read_and_off_by_itself() {
    assert_eq!(with("", SHAPERS).unwrap().0.path_tolerance_mm, None);
    let (motion, _) = with("path_tolerance_mm = 0.08", SHAPERS).unwrap();
    assert_eq!(motion.path_tolerance_mm, Some(0.08));
    // MZV at 50 Hz: half of its variance is 16e-6 s^2, which leaves some thousand mm/s^2.
    let acceleration = motion.tolerance_acceleration_mm_per_s2().unwrap();
    assert!((1500.0..5000.0).contains(&acceleration), "{acceleration}");
}

#[test]
fn prepared_jobs_are_for_the_tolerance_and_the_filters_that_it_follows_from() {
    let hash = |keys: &str, tables: &str| with(keys, tables).unwrap().1;
    let other = SHAPERS.replace("60", "61");
    let average = format!("{SHAPERS}smooth_time_s = 0.004\n");
    // Without it filters are the machine's own.
    assert_eq!(hash("", SHAPERS), hash("", &other));
    let kept = hash("path_tolerance_mm = 0.08", SHAPERS);
    for unlike in [
        hash("", SHAPERS),
        hash("path_tolerance_mm = 0.09", SHAPERS),
        hash("path_tolerance_mm = 0.08", &other),
        hash("path_tolerance_mm = 0.08", &average),
    ] {
        assert_ne!(kept, unlike);
    }
    assert_eq!(kept, hash("path_tolerance_mm = 0.080", SHAPERS));
}

#[test]
fn what_nothing_can_keep_is_refused_with_what_would_do() {
    let shown = |keys: &str, tables: &str| {
        let error = with(keys, tables).unwrap_err().to_string();
        assert!(error.contains("path_tolerance_mm"), "{error}");
        error
    };
    for value in ["0", "0.0009", "1.1", "nan", "-0.1", "\"fine\""] {
        assert!(shown(&format!("path_tolerance_mm = {value}"), SHAPERS).contains("0.001 to 1 mm"));
    }
    let bare = shown("path_tolerance_mm = 0.05", "");
    assert!(bare.contains("input_shaper.smooth_time_s in the profile"), "{bare}");
    let slow = SHAPERS.replace("50", "20");
    let tight = shown("path_tolerance_mm = 0.003", &slow);
    assert!(tight.contains("at least 0.0") && tight.contains("a higher input_shaper frequency_hz"), "{tight}");
    // The named tolerance works.
    let least = tight.split("at least ").nth(1).unwrap().split(' ').next().unwrap();
    assert!(with(&format!("path_tolerance_mm = {least}"), &slow).is_ok(), "{least}");
    let below = least.parse::<f64>().unwrap() - 0.0002;
    assert!(with(&format!("path_tolerance_mm = {below}"), &slow).is_err(), "{below}");
}
