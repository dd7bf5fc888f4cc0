//! Pressure advance: the lead of the extruder ahead of the flow.

use ferrostep_planner::{PressureAdvance, SecondSlope};
use ferrostep_profiles::{ProfileError, builtin_text, parse};

fn with(tail: &str) -> Result<(PressureAdvance, u64), ProfileError> {
    let text = format!("{}\n{tail}", builtin_text("corexy").unwrap());
    parse(&text, "test.toml").map(|profile| (profile.motion.pressure_advance, profile.plan_hash))
}

#[test]
fn the_advance_is_as_written() {
    let (none, hash) = with("").unwrap();
    assert_eq!(none, PressureAdvance::NONE);
    let (zero, _) = with("[pressure_advance]\nseconds = 0").unwrap();
    assert_eq!(zero, PressureAdvance::NONE);
    let (one, other_hash) = with("[pressure_advance]\nseconds = 0.045").unwrap();
    assert_eq!(one, PressureAdvance { seconds: 0.045, ..PressureAdvance::NONE });
    // Lines are planned so that the extruder can follow.
    assert_ne!(other_hash, hash);
    let all =
        "[pressure_advance]\nseconds = 0.05\nsmooth_time_s = 0.02\nabove = { filament_mm_per_s = 4, seconds = 0.03 }";
    let above = Some(SecondSlope { filament_mm_per_s: 4.0, seconds: 0.03 });
    assert_eq!(with(all).unwrap().0, PressureAdvance { seconds: 0.05, above, smooth_time_s: Some(0.02) });
}

#[test]
fn what_cannot_be_followed_is_refused_with_its_range() {
    for (table, blamed, says) in [
        ("seconds = 2.1", "pressure_advance.seconds", "0 to 2 s"),
        ("seconds = -0.1", "pressure_advance.seconds", "0 to 2 s"),
        ("seconds = nan", "pressure_advance.seconds", "0 to 2 s"),
        ("smooth_time_s = 0.02", "pressure_advance.seconds", "missing key"),
        ("seconds = 0.04\nsmooth_time_s = 0.2", "pressure_advance.smooth_time_s", "0.001 to 0.1 s"),
        ("seconds = 0.04\nsmooth_time = 0.02", "pressure_advance.smooth_time", "smooth_time_s"),
        ("seconds = 0.04\nabove = { seconds = 0.02 }", "pressure_advance.above.filament_mm_per_s", "missing key"),
        (
            "seconds = 0.04\nabove = { filament_mm_per_s = 200, seconds = 0.02 }",
            "pressure_advance.above.filament_mm_per_s",
            "0.01 to 100 mm/s",
        ),
    ] {
        let error = with(&format!("[pressure_advance]\n{table}")).unwrap_err();
        assert_eq!(error.key(), Some(blamed), "{table}: {error}");
        assert!(error.to_string().contains(says), "{table}: {error}");
    }
}
