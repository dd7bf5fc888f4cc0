//! Reasons for which a profile has no place for a setting of Klipper's.

const NO_KEY: &str = "no such key in a profile";

/// Returns the reason for which a profile has no place for a setting.
pub(super) fn reason(section: &str, key: &str) -> &'static str {
    let kind = section.split(' ').next().unwrap_or_default();
    match kind {
        "tmc2209" if section.starts_with("tmc2209 stepper_z") => "all motors of Z have the settings of its driver",
        "homing_override" => "homing is the profile's: homing.x and the others",
        "screws_tilt_adjust" => "a profile's screws have names, places that the probe reaches, and a pitch",
        "skew_correction" => "one skew is in force, of one section: choose one, or send SET_SKEW",
        "bed_screws" | "bed_tilt" => "a profile's screws are probed: G35",
        "hall_filament_width_sensor" | "tsl1401cl_filament_width_sensor" => "no filament sensor",
        "probe" | "bltouch" if key.starts_with("sample") || key.ends_with("speed") => {
            "the probe is homed with: twice, at the speeds of homing.z"
        }
        "bltouch" if key == "set_output_mode" => {
            "set the probe's output by hand: M280 P0 S140 for 5 V, S150 for open drain"
        }
        "bltouch" if key == "probe_with_touch_mode" => "the bed is sought with the pin out, and not in touch mode",
        "bltouch" if key == "pin_up_reports_not_triggered" => "a pin that is in and reads as triggered is a failure",
        "gcode_macro" | "delayed_gcode" => {
            "Klipper's macros are programs: write plain G-code as a macro of the profile, or into the slicer's start and end code"
        }
        "bed_mesh" => {
            "a profile's mesh has corners that the probe reaches, points, an interpolation, a fade and a lift"
        }
        "mcu" | "board_pins" | "static_digital_output" | "multi_pin" | "duplicate_pin_override" => "the board's",
        "output_pin" => {
            "lights and relays hang at the board's outputs for fans: write a table outputs.NAME with that output"
        }
        "stepper_x1" | "stepper_y1" => "X and Y have one driver each: several motors on one driver turn together",
        "z_tilt" | "quad_gantry_level" => "the motors of Z are aligned with a probe, and one place for each of them",
        "extruder1" => "a second extruder has a motor, steps, a heater and a pressure advance",
        "extruder2" | "extruder_stepper" => "two extruders",
        "tmc2208" | "tmc2130" | "tmc5160" | "tmc2240" | "tmc2660" => {
            "drivers that are set are TMC2209: this one runs as its pins say"
        }
        "temperature_fan" => "a profile's fans turn by command, with the hot end or with the motors",
        "fan" | "heater_fan" | "controller_fan" | "fan_generic" => {
            "fans hang at the board's outputs, and turn by command, with the hot end or with the motors"
        }
        "display" | "display_template" | "menu" => "no display",
        "led" => "write a table outputs.NAME with the board's output and a color for each of its pins",
        "neopixel" | "dotstar" => "lights whose LEDs have chips are not driven",
        "filament_switch_sensor" => "a profile's sensor pauses a print when it says that filament is missing",
        "filament_motion_sensor" if key == "extruder" => "one extruder",
        "filament_motion_sensor" => "a profile's sensor pauses a print when filament is pushed and does not move",
        "virtual_sdcard" | "pause_resume" | "display_status" | "respond" | "exclude_object" | "gcode_arcs"
        | "save_variables" => "Klipper's own module",
        "adxl345" | "resonance_tester" | "lis2dw" | "mpu9250" => "an accelerometer is the board's",
        "temperature_sensor" | "heater_generic" => "heaters and thermometers are those of nozzle, bed and chamber",
        _ if key.ends_with("_pin") || key == "pin" || key == "serial" || key == "uart_address" => {
            "pins are the board's"
        }
        _ if key == "sense_resistor" => "the board's",
        _ => NO_KEY,
    }
}

/// Returns the reason for which a section without settings has no place.
pub(super) fn nothing_in_it(section: &str) -> &'static str {
    match reason(section, "") {
        NO_KEY => "no setting in it",
        why => why,
    }
}
