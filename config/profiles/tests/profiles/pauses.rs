//! The table of the pauses.

use ferrostep_printer::PauseSettings;
use ferrostep_profiles::{Problem, builtin_text, load, parse};

/// The cartesian profile with a table of the pauses.
fn with(pause: &str) -> String {
    format!("{}\n[pause]\n{pause}\n", builtin_text("cartesian").unwrap())
}

const DEFAULT: PauseSettings = PauseSettings {
    place_10nm: [1_000_000, 19_000_000],
    rise_10nm: 2_000_000,
    unload_10nm: 0,
    load_10nm: 0,
    more_10nm: 5_000_000,
    filament_10nm_per_s: 500_000,
};

#[test]
fn absent_keys_have_their_defaults() {
    assert_eq!(load("cartesian").unwrap().pause, DEFAULT);
}

#[test]
fn values_are_taken_and_bind_no_prepared_job() {
    let keys = "place_mm = { x = 150, y = 0 }\nrise_mm = 5\nunload_mm = 400\nload_mm = 420\nmore_mm = 35\nfilament_mm_per_s = 20";
    let profile = parse(&with(keys), "test.toml").unwrap();
    let expected = PauseSettings {
        place_10nm: [15_000_000, 0],
        rise_10nm: 500_000,
        unload_10nm: 40_000_000,
        load_10nm: 42_000_000,
        more_10nm: 3_500_000,
        filament_10nm_per_s: 2_000_000,
    };
    assert_eq!(profile.pause, expected);
    assert_eq!(profile.plan_hash, load("cartesian").unwrap().plan_hash);
}

#[test]
fn others_are_refused_by_name() {
    for (keys, key) in [
        ("place_mm = { x = 201, y = 0 }", "pause.place_mm.x"),
        ("place_mm = { x = 0, y = -1 }", "pause.place_mm.y"),
        ("rise_mm = 1001", "pause.rise_mm"),
        ("unload_mm = -400", "pause.unload_mm"),
        ("load_mm = 2001", "pause.load_mm"),
        ("filament_mm_per_s = 0", "pause.filament_mm_per_s"),
    ] {
        let error = parse(&with(keys), "test.toml").unwrap_err();
        let Problem::OutOfRange { key: blamed, .. } = error.problem() else { panic!("{key}: {error}") };
        assert_eq!(blamed, key, "{error}");
        assert!(error.line().is_some(), "{error}");
    }
}
