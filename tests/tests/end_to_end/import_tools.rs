//! `ferrostep import` of machines with two extruders.

use serde_json::Value;

use super::imports::{self, lost, marlin, says};

const KLIPPER: &str = "[printer]\nkinematics: cartesian\nmax_velocity: 300\nmax_accel: 3000\n\
                       [stepper_x]\nrotation_distance: 40\nmicrosteps: 16\nposition_endstop: 0\nposition_max: 300\nendstop_pin: PG6\n\
                       [stepper_y]\nrotation_distance: 40\nmicrosteps: 16\nposition_endstop: 0\nposition_max: 300\nendstop_pin: PG9\n\
                       [stepper_z]\nrotation_distance: 8\nmicrosteps: 16\nposition_endstop: 0\nposition_max: 300\nendstop_pin: PG10\n\
                       [extruder]\nrotation_distance: 33.5\nmicrosteps: 16\nsensor_type: EPCOS 100K B57560G104F\nmin_temp: 0\n\
                       max_temp: 280\npid_Kp: 22.2\npid_Ki: 1.08\npid_Kd: 114\n";

const SECOND: &str = "[extruder1]\nstep_pin: PB0\ndir_pin: !PC5\nrotation_distance: 23\nmicrosteps: 16\nheater_pin: PA3\nsensor_pin: PF5\n\
                      sensor_type: ATC Semitec 104GT-2\nmin_temp: 0\nmax_temp: 250\npid_Kp: 20\npid_Ki: 1\npid_Kd: 100\n\
                      pressure_advance: 0.04\nnozzle_diameter: 0.4\n[tmc2209 extruder1]\nrun_current: 0.65\n";

fn klipper(more: &str) -> Value {
    imports::klipper(&format!("{KLIPPER}{more}"))
}

fn parsed(imported: &Value) -> ferrostep_printer::Profile {
    ferrostep_profiles::parse(imported["profile"].as_str().unwrap(), "imported.toml").unwrap()
}

#[test]
fn klippers_second_extruder_is_kept() {
    let imported = klipper(SECOND);
    let profile = parsed(&imported);
    let tool = *profile.tools.unwrap().0.get(1).unwrap();
    assert_eq!((tool.socket, tool.is_inverted, tool.offset_10nm), ("e1", true, [0; 3]));
    assert!((tool.steps_per_mm.to_f64() - 3200.0 / 23.0).abs() < 1e-3);
    assert_eq!((tool.advance.seconds, tool.driver.unwrap().current_ma), (0.04, 650));
    let heater = tool.heater.unwrap();
    assert_eq!((heater.heater.name(), heater.settings.max_celsius), ("nozzle1", 250.0));
    assert!((heater.settings.gains.proportional - 20.0 / 255.0).abs() < 1e-6);
    let why = lost(&imported, "[extruder1] nozzle_diameter").unwrap();
    assert!(why.contains("as that of the first extruder"), "{why}");
    // A socket that lifts Z is not taken.
    let three = klipper(&format!("[stepper_z1]\ndir_pin: PC1\n[stepper_z2]\ndir_pin: PC2\n{SECOND}"));
    assert_eq!(parsed(&three).tools.unwrap().0.get(1).unwrap().socket, "e2");
    // One nozzle for both.
    let shared = klipper(
        "[extruder1]\nstep_pin: PB0\ndir_pin: PC5\nrotation_distance: 23\nmicrosteps: 16\nshared_heater: extruder\n",
    );
    assert_eq!(parsed(&shared).tools.unwrap().0.get(1).unwrap().heater, None);
    assert!(lost(&shared, "[extruder1] shared_heater").unwrap().contains("leaving out"));
}

#[test]
fn marlins_second_extruder_is_kept() {
    let imported = marlin(
        "#define EXTRUDERS 2\n#define HOTEND_OFFSET_X { 0.0, 24.50 }\n#define HOTEND_OFFSET_Y { 0.0, -0.75 }\n\
         #define HOTEND_OFFSET_Z { 0.0, 0.20 }\n#define TEMP_SENSOR_1 5\n#define HEATER_1_MINTEMP 5\n#define HEATER_1_MAXTEMP 260\n\
         #define INVERT_E1_DIR true\n#define TOOLCHANGE_ZRAISE 2\n#define TOOLCHANGE_FILAMENT_SWAP\n#define TOOLCHANGE_FS_LENGTH 12\n\
         #define TOOLCHANGE_FS_RETRACT_SPEED (50*60)\n",
    );
    says(
        &imported,
        "tools.lift_mm = 2\ntools.retract_mm = 12\ntools.retract_mm_per_s = 50\ntools.t1.motor = \"e1\"\ntools.t1.inverted = true\n\
         tools.t1.offset_mm = { x = 24.5, y = -0.75, z = 0.2 }\ntools.t1.heater = \"nozzle1\"\n",
    );
    let one = marlin("#define EXTRUDERS 1\n#define TEMP_SENSOR_1 0\n");
    assert!(!one["profile"].as_str().unwrap().contains("tools"));
    // More than two have no place.
    let five = marlin("#define EXTRUDERS 5\n");
    assert!(lost(&five, "EXTRUDERS").unwrap().contains("one extruder, or two"));
}
