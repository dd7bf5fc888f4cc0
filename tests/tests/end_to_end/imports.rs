//! `ferrostep import`: profiles from other firmwares' configurations.

use ferrostep_import::of_text;
use serde_json::Value;

use crate::end_to_end::command::{directory, ferrostep};

fn import(name: &str) -> Value {
    let outcome = ferrostep(["import", &format!("tests/configurations/{name}"), "--json"]);
    assert_eq!((outcome.status, outcome.stderr.as_str()), (Some(0), ""), "{outcome:#?}");
    outcome.json()
}

/// The profile's values.
pub(super) fn profile(imported: &Value) -> toml::Table {
    imported["profile"].as_str().unwrap().parse().unwrap()
}

#[track_caller]
pub(super) fn says(imported: &Value, expected: &str) {
    let (profile, expected) = (profile(imported), expected.parse::<toml::Table>().unwrap());
    for (path, value) in flat(&expected, "") {
        let found = flat(&profile, "").into_iter().find(|(found, _)| *found == path).map(|(_, value)| value);
        let near = match (&found, &value) {
            (Some(found), value) => match (number(found), number(value)) {
                (Some(found), Some(value)) => (found - value).abs() < 1e-4,
                _ => found == value,
            },
            (None, _) => false,
        };
        assert!(near, "{path}: {found:?}, expected {value:?}");
    }
}

fn number(value: &toml::Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|number| number as f64))
}

fn flat(table: &toml::Table, path: &str) -> Vec<(String, toml::Value)> {
    let each = table.iter().flat_map(|(key, value)| match value {
        toml::Value::Table(inner) => flat(inner, &format!("{path}{key}.")),
        value => vec![(format!("{path}{key}"), value.clone())],
    });
    each.collect()
}

/// Reason for which a setting is not kept; `None` if it is.
#[track_caller]
pub(super) fn lost(imported: &Value, key: &str) -> Option<String> {
    let rows = imported["rows"].as_array().unwrap();
    let row = rows.iter().find(|row| row["key"] == key).unwrap_or_else(|| panic!("no row for {key} in {rows:#?}"));
    row["kept"].is_null().then(|| row["why"].as_str().unwrap().to_owned())
}

/// Checks that each line of a file with a setting has a row.
#[track_caller]
fn every_line_has_a_row(imported: &Value, name: &str, is_setting: fn(&str) -> bool) {
    let path = ferrostep_testkit::program::repository().join("tests/configurations").join(name);
    let text = std::fs::read_to_string(path).unwrap();
    for (index, line) in text.lines().enumerate().filter(|(_, line)| is_setting(line)) {
        let is_row = |row: &&Value| row["file"] == name && row["line"] == index + 1;
        assert!(imported["rows"].as_array().unwrap().iter().any(|row| is_row(&row)), "{name}:{}: {line}", index + 1);
    }
}

#[test]
fn a_cartesian_machine_of_klippers_becomes_a_profile() {
    let imported = import("bed-slinger.cfg");
    says(
        &imported,
        "kinematics = \"cartesian\"\n\
         size_mm = { x = 235, y = 230, z = 250 }\nlower_end_mm = { y = -4, z = -2 }\n\
         steps_per_mm = { x = 80, y = 80, z = 1600, e = 830 }\n\
         max_feed_mm_per_s = { x = 300, y = 300, z = 10 }\n\
         max_acceleration_mm_per_s2 = { x = 3000, z = 100 }\n\
         acceleration_mm_per_s2 = { print = 3000, travel = 3000 }\n\
         junction_deviation_mm = 0.003452\nnozzle_diameter_mm = 0.4\n\
         homing.x = { end = \"min\", sensor = \"end-stop\", position_mm = 0, fast_mm_per_s = 50, slow_mm_per_s = 25, back_off_mm = 5 }\n\
         homing.y = { end = \"min\", triggers_low = true, position_mm = -4, slow_mm_per_s = 10, back_off_mm = 6 }\n\
         homing.z = { end = \"min\", sensor = \"probe\", position_mm = 0 }\n\
         homing.raise_mm = 10\nhoming.home_at_mm = { x = 117, y = 117 }\n\
         homing.probe_offset_mm = { x = -44, y = -6, z = -1.25 }\n\
         bltouch = { move_ms = 400, stow_each_touch = true, test_signal = false }\n\
         nozzle = { sensor = \"semitec-104gt-2\", max_celsius = 260, proportional = 0.1, integral = 0.004, derivative = 0.5 }\n\
         bed = { max_celsius = 130, proportional = 0.2 }\n\
         driver.inverted = [\"x\"]\npressure_advance.seconds = 0.045\n\
         mesh = { area_mm = { x = [20.0, 180.0], y = [20.0, 200.0] }, points = { x = 5, y = 4 }, interpolation = \"bicubic\", fade_mm = 12, lift_mm = 6, samples = 2 }\n\
         bed_screws.pitch_mm = 0.7\nbed_screws.clockwise_lifts = false\n\
         bed_screws.places = { front_left = { x = 31, y = 34 }, screw2 = { x = 171, y = 34 } }\n\
         fans.part.kick_start_s = 0.2\nfans.hotend.turns = \"hotend\"\n\
         fans.electronics = { output = \"fan2\", turns = \"controller\", power = 0.5, idle_s = 45 }\n\
         fans.bento_box = { output = \"fan3\", turns = \"command\" }\nfilament_sensor.missing_is_low = false\n\
         input_shaper = { x = { kind = \"ei\", frequency_hz = 45 }, y = { kind = \"ei\", frequency_hz = 38.5 } }\n\
         macro.START.gcode = \"\\nG28\\nG1 Z5 F600\\n\"\n\
         skew = { xy = { factor = 0.001413 }, xz = { factor = -0.002 }, yz = { factor = 0 } }\n",
    );
    for (key, why) in [
        ("include", "not read: "),
        ("[bed_mesh] mesh_pps", "a profile's mesh has"),
        ("[filament_switch_sensor runout] event_delay", "pauses a print"),
        ("[bltouch] control_pin", "pins are the board's"),
        ("[bltouch] set_output_mode", "M280 P0 S140"),
        ("[fan] pin", "fans hang at the board's outputs"),
        ("[stepper_x] step_pin", "pins are the board's"),
        ("[extruder] max_extrude_only_distance", "no such key"),
    ] {
        let said = lost(&imported, key).unwrap_or_else(|| panic!("{key} is kept"));
        assert!(said.contains(why), "{key}: {said}");
    }
    let is_setting = |line: &str| {
        let line = line.trim_start_matches("#*# ");
        !line.starts_with([' ', '#', ';', '[', '<']) && !line.is_empty()
    };
    every_line_has_a_row(&imported, "bed-slinger.cfg", is_setting);
}

#[test]
fn a_corexy_machine_of_klippers_becomes_a_profile() {
    let imported = import("corexy.cfg");
    says(
        &imported,
        "kinematics = \"corexy\"\nsteps_per_mm = { x = 160, z = 800 }\nmax_feed_mm_per_s.z = 400\n\
         homing.x = { end = \"max\", sensor = \"stall\", position_mm = 300 }\n\
         drivers.x = { current_ma = 800, hold_current_percent = 50, microsteps = 32, mm_per_turn = 40, stealth_chop = true, \
         spread_cycle_above_mm_per_s = 0, stall_threshold = 90 }\n\
         nozzle.sensor = { celsius = [25.0, 150.0, 250.0], ohm = [100000.0, 1770.0, 230.0] }\n\
         bed.sensor = { celsius = [25.0, 150.0, 250.0], ohm = [100000.0, 1641.9, 226.15] }\nfilament_sensor.missing_is_low = true\n",
    );
    // A value out of a profile's range is replaced by the nearest one, and the reason is said.
    says(&imported, "bed.max_celsius = 200");
    let rows = imported["rows"].as_array().unwrap();
    let limit = rows.iter().rfind(|row| row["key"] == "[heater_bed] max_temp").unwrap();
    assert_eq!((&limit["refused"], &limit["kept"]), (&true.into(), &"bed.max_celsius = 200.0".into()), "{limit}");
    assert!(limit["why"].as_str().unwrap().contains("expected 60 to 200"));
    // The machine has no probe.
    assert!(lost(&imported, "[bed_mesh] mesh_min").unwrap().contains("corners that the probe reaches"));
    says(&imported, "z_motors.motors.z2.inverted = false");
    assert!(lost(&imported, "[stepper_z1] microsteps").unwrap().contains("all motors of Z make the same steps"));
    assert!(lost(&imported, "[stepper_x] homing_retract_dist").unwrap().contains("above 0"));
    let is_setting = |line: &str| line.contains(" = ");
    every_line_has_a_row(&imported, "corexy.cfg", is_setting);
}

#[test]
fn marlins_configuration_becomes_a_profile() {
    let imported = import("Configuration.h");
    says(
        &imported,
        "name = \"Slinger\"\nkinematics = \"cartesian\"\nsize_mm = { x = 220, y = 210, z = 240 }\nlower_end_mm.y = -5\n\
         steps_per_mm = { x = 80, y = 80, z = 400, e = 93.5 }\nmax_feed_mm_per_s = { x = 250, z = 10, e = 50 }\n\
         acceleration_mm_per_s2 = { print = 1000, travel = 1300, retract = 1100 }\njunction_deviation_mm = 0.04\n\
         instantaneous_corner_velocity_mm_per_s.z = 0.4\n\
         homing.x = { end = \"min\", triggers_low = true, fast_mm_per_s = 50, slow_mm_per_s = 25, back_off_mm = 5 }\n\
         homing.y.position_mm = -5\nhoming.z = { sensor = \"probe\", fast_mm_per_s = 4, slow_mm_per_s = 1, back_off_mm = 2 }\n\
         bltouch = { move_ms = 500, stow_each_touch = false }\n\
         homing.probe_offset_mm = { x = 10, y = -8, z = -1.5 }\nhoming.home_at_mm.x = 100\n\
         nozzle = { sensor = \"semitec-104gt-2\", max_celsius = 275, proportional = 0.09 }\n\
         drivers.x = { current_ma = 580, microsteps = 16, stealth_chop = true }\ndriver.inverted = [\"y\"]\n\
         pressure_advance.seconds = 0.08\nmin_extrusion_celsius = 170\n\
         mesh = { area_mm = { x = [15.0, 205.0], y = [15.0, 195.0] }, points = { x = 5, y = 5 }, fade_mm = 8, samples = 2 }\n\
         filament_sensor.missing_is_low = true\n",
    );
    assert!(lost(&imported, "TEMP_SENSOR_BED").unwrap().contains("do not heat it"));
    assert!(lost(&imported, "AUTO_BED_LEVELING_BILINEAR").unwrap().contains("a profile's mesh has"));
    assert!(lost(&imported, "MOTHERBOARD").unwrap().contains("the board's"));
    assert!(!imported["rows"].as_array().unwrap().iter().any(|row| row["key"] == "JUNCTION_DEVIATION_MM"));
    every_line_has_a_row(&imported, "Configuration_adv.h", |line| line.starts_with("#define"));
}

/// Klipper homes once by a stall, at the full speed, and in stealthChop whatever it prints in; a
/// profile's approaches and modes must let the signal come as well.
#[test]
fn a_machine_that_homes_by_stalls_homes_by_stalls() {
    let imported = import("sensorless.cfg");
    says(
        &imported,
        "homing.x = { sensor = \"stall\", fast_mm_per_s = 48, slow_mm_per_s = 48 }\n\
         homing.y = { sensor = \"stall\", slow_mm_per_s = 48 }\nhoming.z.sensor = \"end-stop\"\n\
         drivers.x = { stealth_chop = true, spread_cycle_above_mm_per_s = 60, stall_threshold = 100 }\n\
         drivers.y = { stealth_chop = true, spread_cycle_above_mm_per_s = 90 }\n\
         nozzle.sensor = { r25_ohm = 100000, beta_k = 4100 }\n",
    );
    let row = |key: &str| imported["rows"].as_array().unwrap().iter().find(|row| row["key"] == key).unwrap().clone();
    assert_eq!(row("[stepper_x] endstop_pin")["value"], "tmc2209_stepper_x:virtual_endstop");
    assert!(row("[tmc2209 stepper_x] stealthchop_threshold")["why"].as_str().unwrap().contains("homes in stealthChop"));
    assert!(lost(&imported, "[stepper_x] homing_retract_dist").unwrap().contains("here at one speed"));
    assert_eq!(lost(&imported, "[verify_heater extruder]").unwrap(), "no setting in it");
    assert!(lost(&imported, "[homing_override] gcode").unwrap().contains("homing is the profile's"));
    assert_eq!(row("[homing_override] gcode")["value"], "G28 X G28 Y");
    assert!(lost(&imported, "[screws_tilt_adjust] screw1").unwrap().contains("screws"));
}

/// A key that the file gives is not listed as assumed, not even in other words.
#[test]
fn what_a_file_says_is_not_assumed() {
    let imported = import("sensorless.cfg");
    let assumed: Vec<&str> =
        imported["assumed"].as_array().unwrap().iter().map(|value| value.as_str().unwrap()).collect();
    for key in [
        "nozzle.sensor",
        "bed.sensor",
        "drivers.x.microsteps",
        "drivers.x.mm_per_turn",
        "drivers.x.full_steps_per_turn",
        "drivers.x.spread_cycle_above_mm_per_s",
    ] {
        assert!(!assumed.iter().any(|value| value.starts_with(key)), "{key}: {assumed:#?}");
    }
    for key in ["drivers.y.full_steps_per_turn = 200", "drivers.x.hold_current_percent = 100", "homing.x.back_off_mm"] {
        assert!(assumed.iter().any(|value| value.starts_with(key)), "{key}: {assumed:#?}");
    }
}

/// Lines that Marlin's configuration needs for any machine.
pub(super) const MARLIN_MACHINE: &str = "#define DEFAULT_AXIS_STEPS_PER_UNIT { 100, 100, 400, 95 }\n#define X_MAX_POS 200\n\
                              #define Y_MAX_POS 200\n#define Z_MAX_POS 200\n#define X_HOME_DIR -1\n#define Y_HOME_DIR -1\n\
                              #define Z_HOME_DIR -1\n#define TEMP_SENSOR_0 5\n#define TEMP_SENSOR_BED 1\n";

/// Imports a text in Marlin's form: the parts of the profile.
pub(super) fn marlin(text: &str) -> Value {
    imported("Configuration.h", &format!("{MARLIN_MACHINE}{text}"))
}

/// Imports a text in Klipper's form: the parts of the profile.
pub(super) fn klipper(text: &str) -> Value {
    imported("printer.cfg", text)
}

fn imported(name: &str, text: &str) -> Value {
    serde_json::to_value(of_text(name, text, &mut |_| Err("none".to_owned())).unwrap()).unwrap()
}

/// A mesh with a radius makes a round bed.
#[test]
fn klippers_round_bed_is_kept() {
    let path = ferrostep_testkit::program::repository().join("tests/configurations/bed-slinger.cfg");
    let text = std::fs::read_to_string(path).unwrap();
    let mut round =
        text.replace("mesh_min: 20, 20", "mesh_radius: 90").replace("mesh_max: 180, 200", "mesh_origin: 110, 112");
    assert!(round.contains("mesh_radius") && round.contains("mesh_origin"), "{text}");
    let count = round.lines().find(|line| line.starts_with("probe_count")).unwrap().to_owned();
    round = round.replace(&count, "round_probe_count: 7");
    let imported = klipper(&round);
    says(
        &imported,
        "homing.bed_mm = { x = [20.0, 200.0], y = [22.0, 202.0], round = true }\nmesh.points = { x = 7, y = 7 }\n",
    );
    assert_eq!(lost(&imported, "[bed_mesh] mesh_radius"), None);
}

#[test]
fn marlins_first_version_is_read() {
    let imported = marlin(
        "#define X_MIN_POS 0\n#define X_MAX_POS 180\n#define Y_MIN_POS -10\n#define Y_MAX_POS 200\n#define X_HOME_DIR -1\n\
         const bool X_MIN_ENDSTOP_INVERTING = true; // low\n#if ENABLED(NOT_THERE)\nconst bool X_MIN_ENDSTOP_INVERTING = false;\n#endif\n\
         #define HOMING_FEEDRATE {40*60, 30*60, 3*60, 0}\n#define DEFAULT_ACCELERATION 1000\n#define DEFAULT_XYJERK 10.0\n\
         #define FIX_MOUNTED_PROBE\n#define Z_MIN_PROBE_USES_Z_MIN_ENDSTOP_PIN\n#define X_PROBE_OFFSET_FROM_EXTRUDER -20\n\
         #define Y_PROBE_OFFSET_FROM_EXTRUDER 30\n#define Z_PROBE_OFFSET_FROM_EXTRUDER -1.25\n#define Z_RAISE_BEFORE_HOMING 6\n\
         #define Z_SAFE_HOMING_X_POINT (X_MAX_LENGTH/2)\n#define Z_SAFE_HOMING_Y_POINT Y_CENTER\n\
         #define SOURCE_CODE_URL \"http://example.org\" // where\n",
    );
    says(
        &imported,
        "homing.x = { triggers_low = true, fast_mm_per_s = 40 }\nhoming.y.fast_mm_per_s = 30\nhoming.z.fast_mm_per_s = 3\n\
         junction_deviation_mm = 0.04\nhoming.probe_offset_mm = { x = -20, y = 30, z = -1.25 }\nhoming.raise_mm = 6\n\
         homing.home_at_mm = { x = 110, y = 75 }\n",
    );
    let rows = imported["rows"].as_array().unwrap();
    assert!(
        rows.iter().any(|row| row["key"] == "SOURCE_CODE_URL" && row["value"] == "\"http://example.org\""),
        "{rows:#?}"
    );
}

#[test]
fn a_value_that_cannot_be_worked_out_is_said() {
    let imported = marlin("#define DEFAULT_MAX_FEEDRATE { 300, FAST(2), 5, 25 }\n#define Y_MAX_POS double(190)\n");
    says(&imported, "max_feed_mm_per_s = { x = 300, y = 200, z = 5, e = 25 }\nsize_mm = { x = 200, y = 190 }\n");
    let feeds = imported["rows"].as_array().unwrap().iter().find(|row| row["key"] == "DEFAULT_MAX_FEEDRATE").unwrap();
    assert!(feeds["why"].as_str().unwrap().contains("worked out"), "{feeds}");
}

/// Blocks for other drivers than the machine's set the same names again.
#[test]
fn marlins_settings_of_other_drivers_are_not_the_machines() {
    let imported = marlin(
        "#define X_DRIVER_TYPE TMC2209\n#define Y_DRIVER_TYPE TMC2209\n#define E0_DRIVER_TYPE TMC2209\n\
         #if HAS_DRIVER(TMC26X)\n#if AXIS_DRIVER_TYPE_X(TMC26X)\n#define X_MICROSTEPS 64\n#endif\n#endif\n\
         #if HAS_TRINAMIC_CONFIG\n#if AXIS_IS_TMC(X)\n#define X_CURRENT 500\n#define X_MICROSTEPS 16\n#endif\n\
         #if AXIS_IS_TMC(E0)\n#define E0_CURRENT 550\n#define E0_MICROSTEPS 32\n#endif\n\
         #if AXIS_IS_TMC(Z)\n#define Z_CURRENT 700\n#define Z_MICROSTEPS 16\n#endif\n#define STEALTHCHOP_XY\n\
         #define HYBRID_THRESHOLD\n#define X_HYBRID_THRESHOLD 120\n#define E0_HYBRID_THRESHOLD 30\n\
         #define SENSORLESS_HOMING\n#if EITHER(SENSORLESS_HOMING, SENSORLESS_PROBING)\n#define X_STALL_SENSITIVITY 90\n#endif\n#endif\n\
         #if HAS_L64XX\n#if AXIS_IS_L64XX(X)\n#define X_MICROSTEPS 128\n#endif\n#endif\n\
         #define HOMING_FEEDRATE_MM_M { (50*60), (50*60), (4*60) }\n#define HOMING_BUMP_MM { 0, 3, 2 }\n\
         #define HOMING_BUMP_DIVISOR { 2, 2, 4 }\n\
         #if TEMP_SENSOR_CHAMBER == 1000\n#endif\n#define TEMP_SENSOR_0 5\n#if TEMP_SENSOR_0 == 1000\n#define HOTEND0_BETA 3950\n#endif\n\
         #define DEFAULT_Kp_LIST { 25.5, 1 }\n",
    );
    says(
        &imported,
        "drivers.x = { current_ma = 500, microsteps = 16, stealth_chop = true, spread_cycle_above_mm_per_s = 120, stall_threshold = 90 }\n\
         drivers.e = { current_ma = 550, microsteps = 32, stealth_chop = false, spread_cycle_above_mm_per_s = 0 }\n\
         homing.x = { sensor = \"stall\", slow_mm_per_s = 50 }\nhoming.y = { sensor = \"end-stop\", slow_mm_per_s = 25, back_off_mm = 3 }\n\
         homing.z = { slow_mm_per_s = 1, back_off_mm = 2 }\nnozzle.proportional = 0.1\n",
    );
    let rows = imported["rows"].as_array().unwrap();
    for key in ["HOTEND0_BETA", "Z_CURRENT"] {
        assert!(!rows.iter().any(|row| row["key"] == key), "{key} is not in force");
    }
    assert!(lost(&imported, "Y_DRIVER_TYPE").unwrap().contains("without Y_CURRENT and Y_MICROSTEPS"));
    let bump = rows.iter().find(|row| row["key"] == "HOMING_BUMP_MM").unwrap();
    assert!(bump["why"].as_str().unwrap().contains("homes twice"), "{bump}");
}

#[test]
fn an_imported_machine_prints() {
    let directory = directory();
    for name in ["bed-slinger.cfg", "corexy.cfg", "sensorless.cfg", "Configuration.h"] {
        let out = directory.path().join(format!("{name}.toml"));
        let out = out.to_str().unwrap();
        let imported = ferrostep(["import", &format!("tests/configurations/{name}"), "-o", out]);
        assert_eq!(imported.status, Some(0), "{imported:#?}");
        assert!(imported.stdout.contains("not kept, ") && imported.stdout.contains("look at each"), "{imported:#?}");
        assert!(imported.stdout.lines().next_back().unwrap().contains(" need a look before the machine moves"));
        let again = ferrostep(["import", &format!("tests/configurations/{name}"), "-o", out]);
        assert_eq!(again.status, Some(0), "what an import wrote is written anew: {again:#?}");
        let printed = ferrostep(["estimate", "examples/cube.gcode", "--profile", out, "--json"]);
        assert_eq!(printed.status, Some(0), "{name}: {printed:#?}");
    }
}
