//! Filament: firmware retraction, and filament for moves without an E word.

use ferrostep_checked_toml::{Range, Section, range};
use ferrostep_printer::{ExtrusionSettings, FirmwareRetraction};

use crate::axes::{FEED, units_10nm};

const RETRACTION: Range = range(0.0, 100.0, "mm");
const EXTRA_RECOVER: Range = range(-100.0, 100.0, "mm");
const LIFT: Range = range(0.0, 50.0, "mm");

/// Firmware retraction at start-up.
pub(crate) fn retraction(keys: &Section<'_>) -> FirmwareRetraction {
    let table = keys.section("firmware_retraction", "settings of G10 and G11 at start-up; M207 and M208 change them");
    let units = |key, range, about| units_10nm(table.number(key, range).required(about));
    FirmwareRetraction {
        length_10nm: units("length_mm", RETRACTION, "retraction length"),
        retract_10nm_per_s: units("retract_mm_per_s", FEED, "retraction speed"),
        extra_recover_10nm: units("extra_recover_mm", EXTRA_RECOVER, "extra length on recovery"),
        recover_10nm_per_s: units("recover_mm_per_s", FEED, "recovery speed"),
        lift_10nm: units("lift_mm", LIFT, "Z hop while retracted"),
    }
}

/// Filament for moves without an E word.
pub(crate) fn extrusion(keys: &Section<'_>) -> ExtrusionSettings {
    let table = keys.section_of_defaults(
        "extrusion",
        "extrusion of moves without an E word ([velocity-adaptive \
         extrusion](papers/wu.md#velocity-adaptive-extrusion)); M795 changes it",
    );
    let default = ExtrusionSettings::DEFAULT;
    let mm = |units: i64| units as f64 / 100_000.0;
    let [height, width, diameter] =
        ExtrusionSettings::RANGES_10NM.map(|(smallest, largest)| range(mm(smallest), mm(largest), "mm"));
    let units = |key, range, default, about| units_10nm(table.number(key, range).or(mm(default), about));
    ExtrusionSettings {
        adaptive: table.word("mode", [("gcode", false), ("adaptive", true)]).or(
            default.adaptive,
            "filament from E words; or G1, G2 and G3 in the plane without E push λ = 4·h·b/(π·D²) times their length",
        ),
        layer_height_10nm: units("layer_height_mm", height, default.layer_height_10nm, "layer height h"),
        line_width_10nm: units("line_width_mm", width, default.line_width_10nm, "line width b"),
        filament_diameter_10nm: units(
            "filament_diameter_mm",
            diameter,
            default.filament_diameter_10nm,
            "diameter D of the filament or of the pushed barrel",
        ),
    }
}
