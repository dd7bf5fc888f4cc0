//! The printers for slicers in `examples/slicers/`: their figures are those of the firmware's
//! profiles, as are their sizes. Slicers slice with them in `tests/outside`.

use ferrostep_profiles::load;
use ferrostep_testkit::slicers::{MACHINES, bundle, definition};

const UNITS_PER_MM: f64 = 100_000.0;

/// A slicer's figures of a machine, in the order of [`figures_of_profile`].
const PRUSA_SLICER_KEYS: [&str; 11] = [
    "machine_max_feedrate_x",
    "machine_max_feedrate_y",
    "machine_max_feedrate_z",
    "machine_max_feedrate_e",
    "machine_max_acceleration_x",
    "machine_max_acceleration_y",
    "machine_max_acceleration_z",
    "machine_max_acceleration_e",
    "machine_max_acceleration_extruding",
    "machine_max_acceleration_travel",
    "machine_max_acceleration_retracting",
];

fn figures_of_profile(profile: &str) -> Vec<f64> {
    let limits = load(profile).unwrap().limits;
    let mut figures = Vec::from(limits.max_feed_mm_per_s);
    figures.extend(limits.max_acceleration_mm_per_s2);
    figures.extend([
        limits.print_acceleration_mm_per_s2,
        limits.travel_acceleration_mm_per_s2,
        limits.retract_acceleration_mm_per_s2,
    ]);
    figures
}

#[test]
fn the_bundle_for_prusa_slicer_has_the_profiles_figures() {
    let bundle = bundle();
    for (name, _, profile_name) in MACHINES {
        let printer = &bundle[&format!("printer:{name}")];
        let first = |key: &str| printer[key].split(',').next().unwrap().parse::<f64>().unwrap();
        assert_eq!(PRUSA_SLICER_KEYS.map(first).to_vec(), figures_of_profile(profile_name), "{name}");
        let profile = load(profile_name).unwrap();
        assert_eq!(printer["printer_notes"], format!("The firmware's profile: {profile_name}"));
        let corners = printer["bed_shape"].split(',').map(|corner| {
            let (x, y) = corner.split_once('x').unwrap();
            [x.parse::<f64>().unwrap(), y.parse::<f64>().unwrap()]
        });
        for [x, y] in corners {
            assert!(x >= 0.0 && x * UNITS_PER_MM <= profile.size_10nm[0] as f64, "{name}: X{x}");
            assert!(y >= 0.0 && y * UNITS_PER_MM <= profile.size_10nm[1] as f64, "{name}: Y{y}");
        }
        assert_eq!(first("max_print_height") * UNITS_PER_MM, profile.size_10nm[2] as f64, "{name}");
    }
}

#[test]
fn the_definitions_for_cura_have_the_profiles_figures() {
    for (name, file, profile_name) in MACHINES {
        let definition = definition(file);
        assert_eq!(definition["name"], name);
        let value = |key: &str| definition["overrides"][key]["default_value"].as_f64().unwrap();
        let mut figures: Vec<f64> = PRUSA_SLICER_KEYS.iter().take(8).map(|key| value(key)).collect();
        figures.push(value("machine_acceleration"));
        assert_eq!(figures, figures_of_profile(profile_name)[..9], "{name}");
        let profile = load(profile_name).unwrap();
        for (axis, key) in ["machine_width", "machine_depth", "machine_height"].into_iter().enumerate() {
            // A MINI's X ends 0.4 mm after the sheet.
            assert_eq!(value(key), (profile.size_10nm[axis] as f64 / UNITS_PER_MM).floor(), "{name}: {key}");
        }
    }
}
