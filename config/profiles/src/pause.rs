//! Settings of a pause: the nozzle's waiting place, and the lengths of a filament change.

use ferrostep_checked_toml::{Range, Section, range};
use ferrostep_printer::PauseSettings;

use crate::axes::{FEED, Travel, units_10nm};

/// Range before the travel is known.
const PLACE: Range = range(-1_000.0, 2_000.0, "mm");

/// Distance of the default waiting place from the ends of the travel: Marlin's `NOZZLE_PARK_POINT`.
const FROM_END_MM: f64 = 10.0;
const RISE_MM: f64 = 20.0;

/// Four to five times the contents of a hot end.
const MORE_MM: f64 = 50.0;

/// A speed at which filament is still pushed into a nozzle that melts 12 mm^3/s of 1.75 mm.
const FILAMENT_MM_PER_S: f64 = 5.0;

/// Reads the settings of a pause.
pub(crate) fn pause(keys: &Section<'_>, travel: &Travel) -> PauseSettings {
    let table = keys.section_of_defaults(
        "pause",
        "parking while a print is [paused](gcode.md#pauses), and what M600 moves; words of a line take precedence",
    );
    let within = [0, 1].map(|axis| PLACE.between(travel.lower_mm[axis], travel.upper_mm[axis], "within the travel"));
    let place_mm = table
        .numbers("place_mm", ["x", "y"], within)
        .optional("10 mm from the left and from the back end", "park position of the nozzle (M600 X Y)");
    let [left_mm, back_mm] = [travel.lower_mm[0] + FROM_END_MM, travel.upper_mm[1] - FROM_END_MM];
    let millimetres = |units: i64| units as f64 / 100_000.0;
    let rise = range(0.0, millimetres(PauseSettings::MAX_RISE_10NM), "mm");
    let filament = range(0.0, millimetres(PauseSettings::MAX_FILAMENT_10NM), "mm");
    let units = |key, range, default, about| units_10nm(table.number(key, range).or(default, about));
    PauseSettings {
        place_10nm: place_mm.unwrap_or([left_mm, back_mm]).map(units_10nm),
        rise_10nm: units("rise_mm", rise, RISE_MM, "height the nozzle is raised before parking (M600 Z)"),
        unload_10nm: units("unload_mm", filament, 0.0, "filament that M600 unloads (U); 0 = unload by hand"),
        load_10nm: units(
            "load_mm",
            filament,
            0.0,
            "filament that M600 loads before the nozzle returns (L); 0 = load by hand",
        ),
        more_10nm: units(
            "more_mm",
            filament,
            MORE_MM,
            "filament purged at each press of the second button of M600's prompt; 0 = no such button",
        ),
        filament_10nm_per_s: units(
            "filament_mm_per_s",
            FEED,
            FILAMENT_MM_PER_S,
            "speed of unloading, loading and purging",
        ),
    }
}
