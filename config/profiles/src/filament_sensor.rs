//! The sensor in the filament's path.

use ferrostep_checked_toml::{Range, Section, range};
use ferrostep_printer::{FilamentSensor, FilamentSensorKind};

use crate::axes::units_10nm;

/// Range of the time for which a sensor must report the same.
const DEBOUNCE: Range = range(0.0, 10.0, "s");
const SWITCH_DEBOUNCE_S: f64 = 0.5;

/// A motion sensor's level lasts no longer than its filament takes from edge to edge.
const MAX_MOTION_DEBOUNCE_S: f64 = 0.05;
/// Contacts bounce for a few milliseconds; at 100 mm/s of filament an edge comes every 29 ms from a
/// sensor with 2.88 mm.
const MOTION_DEBOUNCE_S: f64 = 0.005;

/// BIGTREETECH's of its first smart filament sensor, and Klipper's `detection_length`.
const DETECTION_MM: f64 = 7.0;

/// Kind of a sensor's signal, read before its other keys.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Switch,
    Motion,
}

/// The filament sensor, if there is one.
pub(crate) fn filament_sensor(keys: &Section<'_>) -> Option<FilamentSensor> {
    let table = keys.optional_section(
        "filament_sensor",
        "no sensor",
        "pauses a print [when the filament has run out](gcode.md#when-the-filament-runs-out); its pin is the board's `filament`",
    )?;
    let kind = table.word("kind", [("switch", Kind::Switch), ("motion", Kind::Motion)]).or(
        Kind::Switch,
        "sensor type: a switch detects the presence of filament, a motion sensor toggles while filament moves",
    );
    let missing_is_low = table
        .flag("missing_is_low")
        .optional("required for a switch", "whether the switch signal is low while filament is missing");
    let [least, most] = [FilamentSensor::MIN_DETECTION_10NM, FilamentSensor::MAX_DETECTION_10NM];
    let detection = range(least as f64 / 1e5, most as f64 / 1e5, "mm");
    let detection_mm = table.number("detection_mm", detection).optional(
        "7",
        "filament pushed without a change of a motion sensor's level before it counts as stopped (M412 D)",
    );
    let debounce_s = table.number("debounce_s", DEBOUNCE).optional(
        "0.5 for a switch, 0.005 for a motion sensor",
        "time the signal must be stable; for a motion sensor at most 0.05",
    );
    match kind {
        Kind::Switch if missing_is_low.is_none() => table.refuse("missing_is_low", "true or false for a switch"),
        Kind::Switch if detection_mm.is_some() => {
            table.refuse("detection_mm", "no such key: a switch sees no filament move, kind = \"motion\" does");
        }
        Kind::Motion if missing_is_low.is_some() => {
            table.refuse(
                "missing_is_low",
                "no such key: neither level of a motion sensor means that filament is missing",
            );
        }
        Kind::Motion if debounce_s.is_some_and(|seconds| seconds > MAX_MOTION_DEBOUNCE_S) => {
            table.refuse("debounce_s", "0 to 0.05 s for a motion sensor, whose level changes while filament moves");
        }
        _ => {}
    }
    let usual_s = if kind == Kind::Switch { SWITCH_DEBOUNCE_S } else { MOTION_DEBOUNCE_S };
    Some(FilamentSensor {
        kind: match kind {
            Kind::Switch => FilamentSensorKind::Switch { missing_is_low: missing_is_low.unwrap_or_default() },
            Kind::Motion => {
                let detection_10nm = units_10nm(detection_mm.unwrap_or(DETECTION_MM)) as u32;
                FilamentSensorKind::Encoder { detection_10nm }
            }
        },
        debounce_ms: (debounce_s.unwrap_or(usual_s) * 1e3).round() as u16,
    })
}

/// The switch beside a sensor that sees filament move, if there is one.
pub(crate) fn filament_switch(keys: &Section<'_>, sensor: Option<FilamentSensor>) -> Option<FilamentSensor> {
    let table = keys.optional_section(
        "filament_switch",
        "no second sensor",
        "switch in addition to a [`filament_sensor`](gcode.md#two-filament-sensors) of kind `\"motion\"`; its pin is \
         the board's `filament2`",
    )?;
    let missing_is_low =
        table.flag("missing_is_low").required("whether the switch signal is low while filament is missing");
    let debounce_s = table.number("debounce_s", DEBOUNCE).or(SWITCH_DEBOUNCE_S, "time the signal must be stable");
    if sensor.and_then(|sensor| sensor.detection_10nm()).is_none() {
        table.refuse(
            "missing_is_low",
            "a table [filament_sensor] with kind = \"motion\" in the profile; a switch alone is [filament_sensor] \
             with kind = \"switch\"",
        );
    }
    let debounce_ms = (debounce_s * 1e3).round() as u16;
    Some(FilamentSensor { kind: FilamentSensorKind::Switch { missing_is_low }, debounce_ms })
}
