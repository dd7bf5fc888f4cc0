//! Reasons for which a profile has no place for a definition of Marlin's.

use crate::marlin_report;

/// Returns the reason for which a profile has no place for a definition.
pub(super) fn reason(name: &str) -> &'static str {
    if let Some(why) = marlin_report::reason(name) {
        return why;
    }
    match name {
        _ if name.ends_with("_PIN") || ["MOTHERBOARD", "SERIAL_PORT", "BAUDRATE", "SERIAL_PORT_2"].contains(&name) => {
            "the board's"
        }
        _ if name.ends_with("_DRIVER_TYPE") => "drivers that are set are TMC2209: this one runs as its pins say",
        _ if name.starts_with("MESH_") || name.starts_with("AUTO_BED_LEVELING") || name.starts_with("GRID_") => {
            "the bed is measured by G29: a profile's mesh has points, an area, an interpolation, a fade and a lift"
        }
        _ if name.starts_with("Z_STEPPER_") => {
            "the motors of Z are aligned with a probe, and one place for each of them"
        }
        "MAX_BED_POWER" | "PID_MAX" | "BANG_MAX" | "MIN_BED_POWER" => {
            "profiles drive a heater at full power: where less than 255 stands here, gains are to be found anew (M303), and a heater that must \
             not have all of its power needs another supply"
        }
        "EXTRUDERS" => "one extruder, or two",
        "EEPROM_SETTINGS" => "M500 stores what it can where the board has a memory",
        "S_CURVE_ACCELERATION" => {
            "acceleration = \"s-curve\" with jerk_mm_per_s3, whose value Marlin does not have: set both by hand"
        }
        _ if name.starts_with("CASE_LIGHT") => {
            "a light hangs at one of the board's outputs for fans: write a table outputs.NAME with that output"
        }
        "BLTOUCH_SET_5V_MODE"
        | "BLTOUCH_FORCE_5V_MODE"
        | "BLTOUCH_FORCE_OPEN_DRAIN_MODE"
        | "BLTOUCH_FORCE_MODE_SET" => "set the probe's output by hand: M280 P0 S140 for 5 V, S150 for open drain",
        "BLTOUCH_FORCE_SW_MODE" => "the bed is sought with the pin out, and not in touch mode",
        _ if name.starts_with("PSU_") || name.starts_with("AUTO_POWER") => {
            "a profile's supply has a level and a state at the start; only M80 switches it on"
        }
        "FILAMENT_RUNOUT_DISTANCE_MM" => "a switch pauses a print at once: its tube's filament is not used up",
        _ if name.starts_with("FILAMENT_RUNOUT") || name.starts_with("FIL_RUNOUT") => {
            "a profile's sensor pauses a print when it says that filament is missing"
        }
        _ => "no such key in a profile",
    }
}
