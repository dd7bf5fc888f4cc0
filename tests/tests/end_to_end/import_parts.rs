//! `ferrostep import`: parts that a machine may have, from Klipper's files and Marlin's.

use serde_json::Value;

use crate::end_to_end::imports::{klipper, lost, marlin, profile, says};

/// Marlin's skew is imported from lengths or from factors, which win if both are given; without its
/// switch, nothing is imported.
#[test]
fn marlins_skew_is_kept() {
    let lengths = "#define XY_DIAG_AC 142.2\n#define XY_DIAG_BD 140.6\n#define XY_SIDE_AD 100\n";
    let imported = marlin(&format!("#define SKEW_CORRECTION\n{lengths}#define XZ_SKEW_FACTOR 0.01\n"));
    says(&imported, "skew.xy = { ac_mm = 142.2, bd_mm = 140.6, ad_mm = 100 }\n");
    assert!(profile(&imported)["skew"].get("xz").is_none());
    let imported = marlin(&format!(
        "#define SKEW_CORRECTION\n#define SKEW_CORRECTION_FOR_Z\n{lengths}#define XY_SKEW_FACTOR 0.002\n#define YZ_SKEW_FACTOR -0.001\n"
    ));
    says(&imported, "skew = { xy = { factor = 0.002 }, yz = { factor = -0.001 } }\n");
    assert!(lost(&imported, "XY_DIAG_AC").unwrap().contains("the factor holds"));
    assert!(profile(&marlin(lengths)).get("skew").is_none());
}

/// Marlin's example of a V6, and values of Kalico's calibration (their configurations and manuals).
#[test]
fn models_of_heaters_are_kept() {
    let text = "#define MPC_HEATER_POWER { 40.0f }\n#define MPC_BLOCK_HEAT_CAPACITY { 16.7f }\n#define MPC_SENSOR_RESPONSIVENESS { 0.22f }\n\
                #define MPC_AMBIENT_XFER_COEFF { 0.068f }\n#define MPC_AMBIENT_XFER_COEFF_FAN255 { 0.097f }\n\
                #define FILAMENT_HEAT_CAPACITY_PERMM { 5.6e-3f }\n#define MPC_SMOOTHING_FACTOR 0.5f\n";
    let imported = marlin(&format!("#define MPCTEMP\n{text}"));
    says(
        &imported,
        "nozzle.control_model = { power_w = 40, capacity_j_per_k = 16.7, sensor_per_s = 0.22, loss_w_per_k = 0.068, \
         fanned_loss_w_per_k = 0.097, filament_j_per_k_mm = 0.0056 }\n",
    );
    assert!(lost(&imported, "MPC_SMOOTHING_FACTOR").is_some());
    assert!(profile(&marlin(text))["nozzle"].get("control_model").is_none(), "without its switch there is none");

    let path = ferrostep_testkit::program::repository().join("tests/configurations/corexy.cfg");
    let text = std::fs::read_to_string(path).unwrap();
    let modelled = |of_extruder: &str, of_bed: &str| {
        let text = text
            .replacen("[extruder]\n", &format!("[extruder]\n{of_extruder}"), 1)
            .replacen("[heater_bed]\n", &format!("[heater_bed]\n{of_bed}"), 1)
            .replace("control: pid\n", "")
            .replace("control = pid\n", "");
        klipper(&text)
    };
    let imported = modelled(
        "control: mpc\nheater_power: 60\nblock_heat_capacity: 22.3110\nsensor_responsiveness: 0.0998635\nambient_transfer: 0.155082\n\
         fan_ambient_transfer: 0.155082, 0.20156, 0.216441\nfilament_density: 1.25\nfilament_heat_capacity: 1.2\n",
        "control: mpc\nheater_power: 400\nblock_heat_capacity: 2078.86\nsensor_responsiveness: 0.0139945\nambient_transfer: 15.6868\n",
    );
    says(
        &imported,
        "nozzle.control_model = { power_w = 60, capacity_j_per_k = 22.311, sensor_per_s = 0.0998635, loss_w_per_k = 0.155082, \
         fanned_loss_w_per_k = 0.216441, filament_j_per_k_mm = 0.0036079 }\n\
         bed.control_model = { power_w = 400, capacity_j_per_k = 2078.86, sensor_per_s = 0.0139945, loss_w_per_k = 15.6868 }\n",
    );
    let uncalibrated = modelled("control: mpc\nheater_power: 60\n", "");
    assert!(lost(&uncalibrated, "[extruder] control").unwrap().contains("M306 T"));
    assert!(profile(&uncalibrated)["nozzle"].get("control_model").is_none());
}

/// A sensor that sees filament move goes before a switch, whichever maker's.
#[test]
fn a_motion_sensor_is_kept() {
    let imported = marlin(
        "#define FILAMENT_RUNOUT_SENSOR\n#define FIL_RUNOUT_STATE LOW\n#define FILAMENT_RUNOUT_DISTANCE_MM 3.5\n\
         #define FILAMENT_MOTION_SENSOR\n",
    );
    says(&imported, "filament_sensor = { kind = \"motion\", detection_mm = 3.5 }\n");
    assert!(lost(&imported, "FIL_RUNOUT_STATE").unwrap().contains("neither level"));
    let both = marlin(
        "#define FILAMENT_RUNOUT_SENSOR\n#define FIL_RUNOUT_STATE HIGH\n#define FILAMENT_RUNOUT_DISTANCE_MM 3.5\n\
         #define FILAMENT_SWITCH_AND_MOTION\n",
    );
    says(&both, "filament_sensor = { kind = \"motion\", detection_mm = 3.5 }\n");
    says(&both, "filament_switch.missing_is_low = false\n");
    assert!(lost(&both, "FIL_RUNOUT_STATE").is_none() && lost(&both, "FILAMENT_SWITCH_AND_MOTION").is_none());
    let switch = marlin("#define FILAMENT_RUNOUT_SENSOR\n#define FILAMENT_RUNOUT_DISTANCE_MM 25\n");
    says(&switch, "filament_sensor = { missing_is_low = true }\n");
    assert!(lost(&switch, "FILAMENT_RUNOUT_DISTANCE_MM").unwrap().contains("at once"));

    let path = ferrostep_testkit::program::repository().join("tests/configurations/corexy.cfg");
    let text = std::fs::read_to_string(path).unwrap()
        + "\n[filament_motion_sensor encoder]\nswitch_pin = ^PC2\ndetection_length = 2.88\nextruder = extruder\n";
    let imported = klipper(&text);
    says(&imported, "filament_sensor = { kind = \"motion\", detection_mm = 2.88 }\n");
    assert!(profile(&imported)["filament_sensor"].get("missing_is_low").is_none());
    // The file has a switch beside it.
    says(&imported, "filament_switch.missing_is_low = true\n");
    assert!(lost(&imported, "[filament_switch_sensor toolhead] switch_pin").is_none());
    assert_eq!(lost(&imported, "[filament_motion_sensor encoder] extruder").unwrap(), "one extruder");
    // A sensor that pauses nothing is left out; without a length the profile's
    // default is Klipper's.
    let imported = klipper(&text.replace("^PC2", "^PC2\npause_on_runout = False"));
    says(&imported, "filament_sensor = { missing_is_low = true }\n");
    let imported = klipper(&text.replace("detection_length = 2.88\n", ""));
    says(&imported, "filament_sensor = { kind = \"motion\" }\n");
}

#[test]
fn a_module_that_says_that_the_supply_fails_is_kept() {
    let module = "#define POWER_LOSS_RECOVERY\n#define POWER_LOSS_PIN 44\n#define POWER_LOSS_STATE LOW\n#define POWER_LOSS_ZRAISE 2\n";
    says(&marlin(module), "power_loss.failing_is_low = true");
    says(
        &marlin(&format!("{module}#define BACKUP_POWER_SUPPLY\n")),
        "power_loss = { failing_is_low = true, rise_mm = 2 }",
    );
    says(&marlin("#define POWER_LOSS_RECOVERY\n#define POWER_LOSS_STATE HIGH\n"), "power_loss.failing_is_low = false");
    for without in [
        "#define POWER_LOSS_RECOVERY\n",
        "#define POWER_LOSS_RECOVERY\n#define POWER_LOSS_PIN -1\n",
        "#define POWER_LOSS_STATE LOW\n",
    ] {
        assert!(!profile(&marlin(without)).contains_key("power_loss"), "{without}");
    }
}

/// Imports Klipper's text of a small machine with these sections.
fn small_klipper(sections: &str) -> Value {
    let axis = |name: &str| {
        format!(
            "[stepper_{name}]\nrotation_distance: 40\nmicrosteps: 16\nendstop_pin: P\nposition_endstop: 0\nposition_max: 200\n"
        )
    };
    let axes = ["x", "y", "z"].map(axis).concat();
    let extruder = "[extruder]\nrotation_distance: 30\nmicrosteps: 16\nsensor_type: EPCOS 100K B57560G104F\n";
    klipper(&format!("[printer]\nkinematics: corexy\n{axes}{extruder}{sections}"))
}

#[test]
fn a_switched_supply_is_kept_and_other_outputs_are_named() {
    let imported = marlin(
        "#define PSU_CONTROL\n#define PSU_ACTIVE_STATE HIGH\n#define PSU_DEFAULT_OFF\n#define PSU_POWERUP_DELAY 250\n",
    );
    says(&imported, "power_supply = { on_is_low = false, on_at_start = false }");
    assert!(lost(&imported, "PSU_POWERUP_DELAY").unwrap().contains("only M80 switches it on"));
    let imported =
        marlin("#define PSU_CONTROL\n#define CASE_LIGHT_ENABLE\n#define CASE_LIGHT_DEFAULT_BRIGHTNESS 105\n");
    says(&imported, "power_supply.on_is_low = true");
    for key in ["CASE_LIGHT_ENABLE", "CASE_LIGHT_DEFAULT_BRIGHTNESS"] {
        assert!(lost(&imported, key).unwrap().contains("write a table outputs.NAME"));
    }
    assert!(!profile(&marlin("#define PSU_ACTIVE_STATE LOW\n")).contains_key("power_supply"));

    let imported = small_klipper(
        "[output_pin ps_on_pin]\npin: !PE11\nvalue: 1\nshutdown_value: 0\n[output_pin caselight]\npin: PD12\npwm: True\n",
    );
    says(&imported, "power_supply = { on_is_low = true, on_at_start = true }");
    assert!(
        lost(&imported, "[output_pin ps_on_pin] shutdown_value").unwrap().contains("a halt switches the supply off")
    );
    for key in ["[output_pin caselight] pin", "[output_pin caselight] pwm"] {
        assert!(lost(&imported, key).unwrap().contains("write a table outputs.NAME"));
    }
    says(&small_klipper("[output_pin PSU]\npin: PE11\n"), "power_supply = { on_is_low = false, on_at_start = false }");
    assert!(!profile(&small_klipper("[output_pin beeper]\npin: PC5\n")).contains_key("power_supply"));
}

#[test]
fn a_chamber_is_kept_with_its_thermometer_or_its_heater() {
    // A thermometer alone, as most machines of this kind have it, whose bed warms their chamber.
    let imported = small_klipper(
        "[temperature_sensor chamber_temp]\nsensor_type: Generic 3950\nsensor_pin: PF5\nmin_temp: 0\nmax_temp: 100\n\
         gcode_id: C\n",
    );
    says(
        &imported,
        "chamber = { thermistor = \"nozzle1\", min_celsius = 0, max_celsius = 100, \
         sensor = { celsius = [25.0, 150.0, 250.0], ohm = [100000.0, 1770.0, 230.0] } }",
    );
    assert!(profile(&imported)["chamber"].get("heater").is_none());
    let imported = small_klipper(
        "[heater_generic chamber]\nheater_pin: PB10\nsensor_type: EPCOS 100K B57560G104F\nsensor_pin: PF6\n\
         control: watermark\nmin_temp: 0\nmax_temp: 70\n[verify_heater heater_generic chamber]\ncheck_gain_time: 600\n",
    );
    says(
        &imported,
        "chamber = { thermistor = \"nozzle1\", heater = \"nozzle1\", min_celsius = 0, max_celsius = 70, \
         sensor = \"epcos-100k\", watch_s = 600 }",
    );
    // No thermistor, no chamber.
    let imported = small_klipper("[temperature_sensor chamber]\nsensor_type: BME280\ni2c_address: 118\n");
    assert!(!profile(&imported).contains_key("chamber"));
    assert!(lost(&imported, "[temperature_sensor chamber] sensor_type").unwrap().contains("nozzle, bed and chamber"));

    let imported = marlin(
        "#define TEMP_SENSOR_CHAMBER 1\n#define CHAMBER_MINTEMP 5\n#define CHAMBER_MAXTEMP 60\n\
         #define TEMP_CHAMBER_HYSTERESIS 1\n",
    );
    says(
        &imported,
        "chamber = { thermistor = \"nozzle1\", sensor = \"epcos-100k\", min_celsius = 5, max_celsius = 60, \
         residency_window_celsius = 1 }",
    );
    assert!(!profile(&marlin("#define TEMP_SENSOR_CHAMBER 0\n")).contains_key("chamber"));
}
