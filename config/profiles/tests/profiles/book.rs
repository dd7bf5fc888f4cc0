//! The book's tables of keys and of the built-in profiles.

use std::path::{Path, PathBuf};

use ferrostep_checked_toml::book;
use ferrostep_printer::{AxisHoming, HomeEnd, HomeSensor, Profile};
use ferrostep_profiles::{builtin_names, load, schema};

/// Tables whose keys the book has under another table.
const ALIKE: [(&str, &str); 5] = [
    ("chamber.sensor", "nozzle.sensor"),
    ("chamber.model", "nozzle.model"),
    ("tools.t1.driver", "drivers.e"),
    ("tools.t1.pressure_advance", "pressure_advance"),
    ("tools.t1.nozzle", "nozzle"),
];

fn page() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/src/profiles.md")
}

#[test]
fn the_table_of_keys_is_current() {
    book::keep(&page(), "keys", &schema().markdown(&ALIKE)).unwrap();
}

#[test]
fn tables_that_the_book_has_once_have_the_same_keys() {
    let schema = schema();
    let keys_of = |table: &str| -> Vec<(&str, &str, &str)> {
        let within =
            schema.keys().iter().filter_map(|key| Some((key, key.path.strip_prefix(table)?.strip_prefix('.')?)));
        within.map(|(key, path)| (path, key.unit, key.allowed.as_str())).collect()
    };
    for (table, other) in ALIKE {
        assert!(!keys_of(table).is_empty(), "{table}");
        assert_eq!(keys_of(table), keys_of(other), "{table}");
    }
}

#[test]
fn the_table_of_built_in_profiles_is_current() {
    let profiles: Vec<Profile> = builtin_names().map(|name| load(name).unwrap()).collect();
    let mut text = format!("| | {} |\n|---|{}\n", builtin_names().collect::<Vec<_>>().join(" | "), "---|".repeat(3));
    let mut row = |title: &str, cell: &dyn Fn(&Profile) -> String| {
        let cells: Vec<String> = profiles.iter().map(cell).collect();
        text += &format!("| {title} | {} |\n", cells.join(" | "));
    };
    row("kinematics", &|profile| format!("{:?}", profile.kinematics));
    row("travel, mm", &|profile| {
        let ends = profile.lower_end_10nm.iter().zip(&profile.size_10nm);
        ends.map(|(lower, upper)| format!("{} to {}", mm(*lower), mm(*upper))).collect::<Vec<_>>().join(" × ")
    });
    row("steps/mm x, y, z, e", &|profile| list(&profile.steps_per_mm.map(|steps| steps.to_f64())));
    row("largest feed x, y, z, e, mm/s", &|profile| list(&profile.limits.max_feed_mm_per_s));
    row("largest acceleration x, y, z, e, mm/s²", &|profile| list(&profile.limits.max_acceleration_mm_per_s2));
    row("acceleration print, travel, retract, mm/s²", &|profile| {
        let limits = &profile.limits;
        list(&[
            limits.print_acceleration_mm_per_s2,
            limits.travel_acceleration_mm_per_s2,
            limits.retract_acceleration_mm_per_s2,
        ])
    });
    row("junction deviation, mm", &|profile| profile.limits.junction_deviation_mm.to_string());
    row("instantaneous corner velocity z, e, mm/s", &|profile| {
        list(&profile.limits.instantaneous_corner_velocity_mm_per_s[2..])
    });
    row("homes to", &|profile| {
        let axes = ["x", "y", "z"].iter().zip(&profile.homing);
        axes.map(|(axis, homing)| home(axis, homing)).collect::<Vec<_>>().join(", ")
    });
    book::keep(&page(), "built-in", &text).unwrap();
}

fn mm(units_10nm: i64) -> String {
    (units_10nm as f64 / 100_000.0).to_string().replace('-', "−")
}

fn list(values: &[f64]) -> String {
    values.iter().map(f64::to_string).collect::<Vec<_>>().join(", ")
}

fn home(axis: &str, homing: &AxisHoming) -> String {
    let end = if homing.end == HomeEnd::Min { "min" } else { "max" };
    let sensor = match homing.sensor {
        HomeSensor::EndStop => "",
        HomeSensor::Probe => " by probe",
        HomeSensor::Stall => " by stall",
    };
    format!("{axis} {end} ({}){sensor}", mm(homing.position_10nm))
}
