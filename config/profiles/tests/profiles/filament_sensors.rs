//! The filament sensor of a profile.

use ferrostep_printer::{FilamentSensor, FilamentSensorKind};
use ferrostep_profiles::{builtin_text, parse};

fn with(keys: &str) -> Result<FilamentSensor, String> {
    let text = format!("{}\n[filament_sensor]\n{keys}\n", builtin_text("cartesian").unwrap());
    let profile = parse(&text, "test.toml").map_err(|error| error.to_string())?;
    Ok(profile.filament_sensor.unwrap())
}

#[test]
fn a_sensor_is_a_switch_or_sees_filament_move() {
    for (keys, kind, debounce_ms) in [
        ("missing_is_low = true", FilamentSensorKind::Switch { missing_is_low: true }, 500),
        (
            "kind = \"switch\"\nmissing_is_low = false\ndebounce_s = 2",
            FilamentSensorKind::Switch { missing_is_low: false },
            2000,
        ),
        ("kind = \"motion\"", FilamentSensorKind::Encoder { detection_10nm: 700_000 }, 5),
        (
            "kind = \"motion\"\ndetection_mm = 2.88\ndebounce_s = 0.05",
            FilamentSensorKind::Encoder { detection_10nm: 288_000 },
            50,
        ),
    ] {
        assert_eq!(with(keys), Ok(FilamentSensor { kind, debounce_ms }), "{keys}");
    }
}

#[test]
fn keys_of_the_other_kind_are_refused() {
    for (keys, refusal) in [
        ("", "filament_sensor.missing_is_low"),
        ("debounce_s = 1", "expected true or false for a switch"),
        ("missing_is_low = true\ndetection_mm = 7", "a switch sees no filament move, kind = \"motion\" does"),
        ("kind = \"motion\"\nmissing_is_low = true", "neither level of a motion sensor means that filament is missing"),
        ("kind = \"motion\"\ndetection_mm = 0.9", "1 to 100 mm"),
        ("kind = \"motion\"\ndetection_mm = 101", "1 to 100 mm"),
        ("kind = \"motion\"\ndebounce_s = 0.06", "0 to 0.05 s for a motion sensor"),
        ("kind = \"encoder\"", "expected \"switch\" or \"motion\""),
    ] {
        let error = with(keys).unwrap_err();
        assert!(error.contains(refusal), "{keys}: {error}");
    }
}

#[test]
fn a_switch_may_be_beside_a_motion_sensor_only() {
    let with = |keys: &str| {
        let text = format!("{}\n{keys}\n", builtin_text("cartesian").unwrap());
        parse(&text, "test.toml").map(|profile| profile.filament_switch).map_err(|error| error.to_string())
    };
    let motion = "[filament_sensor]\nkind = \"motion\"\n";
    let kind = FilamentSensorKind::Switch { missing_is_low: true };
    for (keys, debounce_ms) in [("", 500), ("debounce_s = 0.2\n", 200)] {
        let text = format!("{motion}[filament_switch]\nmissing_is_low = true\n{keys}");
        assert_eq!(with(&text), Ok(Some(FilamentSensor { kind, debounce_ms })), "{keys}");
    }
    assert_eq!(with(motion), Ok(None));
    let alone = "a table [filament_sensor] with kind = \"motion\" in the profile";
    for (keys, refusal) in [
        ("[filament_switch]\nmissing_is_low = true", alone),
        ("[filament_sensor]\nmissing_is_low = true\n[filament_switch]\nmissing_is_low = true", alone),
        ("[filament_sensor]\nkind = \"motion\"\n[filament_switch]", "filament_switch.missing_is_low"),
        (
            "[filament_sensor]\nkind = \"motion\"\n[filament_switch]\nmissing_is_low = true\ndetection_mm = 3",
            "unknown key",
        ),
    ] {
        let error = with(keys).unwrap_err();
        assert!(error.contains(refusal), "{keys}: {error}");
    }
}
