//! `ferrostep import` of machines with several motors for Z.

use ferrostep_import::of_text;
use serde_json::Value;

use super::imports::{self, lost, marlin, profile, says};

/// A machine of Klipper's with a probe; the corners and points of its gantry are those of a
/// Voron 2.4 of 300 mm.
const KLIPPER: &str = "[printer]\nkinematics: corexy\nmax_velocity: 300\nmax_accel: 3000\n\
                       [stepper_x]\nrotation_distance: 40\nmicrosteps: 32\nposition_endstop: 300\nposition_max: 300\n\
                       endstop_pin: PG6\n[stepper_y]\nrotation_distance: 40\nmicrosteps: 32\nposition_endstop: 300\n\
                       position_max: 300\nendstop_pin: PG9\n\
                       [stepper_z]\ndir_pin: !PG3\nrotation_distance: 8\nmicrosteps: 32\nposition_min: -5\n\
                       position_max: 260\nendstop_pin: probe:z_virtual_endstop\n[probe]\nx_offset: 0\ny_offset: 25\n\
                       z_offset: 1\n[extruder]\nrotation_distance: 22\nmicrosteps: 16\n\
                       sensor_type: EPCOS 100K B57560G104F\n[safe_z_home]\nhome_xy_position: 150, 150\n\
                       [stepper_z1]\nstep_pin: PG4\ndir_pin: PC1\nmicrosteps: 32\nrotation_distance: 8\n\
                       [tmc2209 stepper_z1]\nrun_current: 0.8\n";

fn klipper(more: &str) -> Value {
    imports::klipper(&format!("{KLIPPER}{more}"))
}

#[test]
fn a_gantry_on_four_belts_is_kept() {
    let imported = klipper(
        "[stepper_z2]\ndir_pin: !PF10\n[stepper_z3]\ndir_pin: PF0\n[quad_gantry_level]\ngantry_corners:\n  -60,-10\n  360,370\n\
         points:\n  50,25\n  50,225\n  250,225\n  250,25\nretries: 5\nretry_tolerance: 0.0075\nmax_adjust: 10\nspeed: 100\n",
    );
    // Their numbers go round, from the front left one to the back left one.
    says(
        &imported,
        "z_motors.max_correction_mm = 10\n\
         z_motors.motors = { z = { x = -60, y = -10 }, z2 = { x = -60, y = 370, inverted = false }, \
         e1 = { x = 360, y = 370, inverted = true }, e2 = { x = 360, y = -10, inverted = false } }\n\
         z_motors.points = { point1 = { x = 50, y = 50 }, point2 = { x = 50, y = 250 }, point3 = { x = 250, y = 250 }, \
         point4 = { x = 250, y = 50 } }\n",
    );
    for (key, why) in [
        ("[quad_gantry_level] retries", "words of the command"),
        ("[stepper_z1] step_pin", "pins are the board's"),
        ("[stepper_z1] rotation_distance", "all motors of Z make the same steps"),
        ("[tmc2209 stepper_z1] run_current", "the settings of its driver"),
    ] {
        assert!(lost(&imported, key).unwrap().contains(why), "{key}: {:?}", lost(&imported, key));
    }
    // The profile is whole: a machine can be built of it.
    let text = imported["profile"].as_str().unwrap();
    let profile = ferrostep_profiles::parse(text, "imported.toml").unwrap();
    assert_eq!((profile.z_motors.unwrap().0.count(), profile.aligns_z()), (4, true));
    assert_eq!(profile.driver.inverted, 0b0100);
}

/// Klipper came with these weights from four heights to the motors', in a log that an owner has
/// published: a Voron 2.4 of 350 mm, corners at -60, -10 and 410, 420, whose probe is 25 mm behind
/// the nozzle (pastebin.com/KM4f90cM).
#[test]
fn four_motors_stand_where_klipper_finds_them() {
    let motors = "[z_motors.motors]\nz = { x = -60, y = -10 }\nz2 = { x = -60, y = 420 }\ne1 = { x = 410, y = 420 }\n\
                  e2 = { x = 410, y = -10 }\n[z_motors.points]\na = { x = 50, y = 50 }\nb = { x = 50, y = 300 }\n\
                  c = { x = 300, y = 300 }\nd = { x = 300, y = 50 }\n";
    let (one_motor, _) = KLIPPER.split_once("[stepper_z1]").unwrap();
    let imported = of_text("printer.cfg", one_motor, &mut |_| Err("none".to_owned())).unwrap();
    let imported = serde_json::to_value(imported).unwrap();
    let text = format!("{}\n{motors}", imported["profile"].as_str().unwrap());
    let profile = ferrostep_profiles::parse(&text, "voron.toml").unwrap();
    // The gantry's heights beside the probe's, which are the other way round.
    let heights = [4.209_353, 4.211_853, 4.210_603, 4.210_603];
    let motors = [4.207_939, 4.214_131, 4.209_525, 4.211_417];
    for (weights, motor) in profile.z_alignment().unwrap().weights.iter().zip(motors) {
        let found: f64 = weights.iter().zip(heights).map(|(weight, height)| f64::from(*weight) * height).sum();
        assert!((found - motor).abs() < 3e-6, "{found}, {motor}");
    }
}

#[test]
fn a_bed_on_screws_is_kept() {
    let imported = klipper(
        "[z_tilt]\nz_positions:\n  -20, 130\n  320, 130\npoints:\n  20, 130\n  280, 130\nhorizontal_move_z: 10\n",
    );
    says(
        &imported,
        "z_motors.motors = { z = { x = -20, y = 130 }, z2 = { x = 320, y = 130, inverted = false } }\n\
         z_motors.points = { point1 = { x = 20, y = 155 }, point2 = { x = 280, y = 155 } }\n",
    );
    // Without a place for each motor they move together, and are not aligned.
    let imported = klipper("[z_tilt]\nz_positions:\n  -20, 130\npoints:\n  20, 130\n  280, 130\n");
    assert!(profile(&imported)["z_motors"].get("points").is_none());
    assert!(lost(&imported, "[z_tilt] points").unwrap().contains("one place for each"));
}

#[test]
fn marlins_motors_are_kept() {
    let machine = "#define X_BED_SIZE 300\n#define Y_BED_SIZE 300\n#define X_MAX_POS 300\n#define Y_MAX_POS 300\n#define Z_MAX_POS 260\n#define NOZZLE_TO_PROBE_OFFSET { 0, 0, -1 }\n\
                   #define Z_MIN_PROBE_USES_Z_MIN_ENDSTOP_PIN\n#define FIX_MOUNTED_PROBE\n#define Z_HOME_DIR -1\n\
                   #define INVERT_Z_DIR true\n#define Z_DRIVER_TYPE TMC2209\n#define Z2_DRIVER_TYPE TMC2209\n\
                   #define INVERT_Z2_VS_Z_DIR\n#define Z2_CURRENT 800\n";
    let align = "#define Z_STEPPER_AUTO_ALIGN\n#define Z_STEPPER_ALIGN_XY { {  10, 150 }, { 290, 150 } }\n";
    let imported = marlin(&format!("{machine}{align}#define Z_STEPPER_ALIGN_ITERATIONS 5\n"));
    says(
        &imported,
        "z_motors.motors = { z = { x = 10, y = 150 }, z2 = { x = 290, y = 150, inverted = false } }\n\
         z_motors.points = { point1 = { x = 10, y = 150 }, point2 = { x = 290, y = 150 } }\n",
    );
    assert!(lost(&imported, "Z_STEPPER_ALIGN_ITERATIONS").unwrap().contains("G34 I"));
    assert!(lost(&imported, "Z2_CURRENT").unwrap().contains("settings of its driver"));
    // An older one, with known places and without a probe's alignment.
    let places = "#define Z_STEPPER_ALIGN_STEPPER_XY { { -20.5, 150.0 }, { 320.5, 150.0 } }\n";
    says(
        &marlin(&format!("{machine}{align}{places}#define NUM_Z_STEPPER_DRIVERS 2\n")),
        "z_motors.motors = { z = { x = -20.5, y = 150 }, z2 = { x = 320.5, y = 150 } }\n",
    );
    let imported = marlin("#define NUM_Z_STEPPERS 2\n");
    says(&imported, "z_motors.motors.z2.inverted = false\n");
    assert!(profile(&imported)["z_motors"].get("points").is_none());
    assert!(profile(&marlin("#define NUM_Z_STEPPERS 1\n")).get("z_motors").is_none());
}
