//! The three built-in profiles hold the values that the design document shares with outside checks.

use ferrostep_planner::{Kinematics, Limits, StepsPerMm};
use ferrostep_printer::{
    AxisHoming, DriverTiming, FirmwareRetraction, HeaterSettings, HeaterWatch, HomeEnd, HomeSensor, PidGains, Profile,
    SafeHoming,
};
use ferrostep_profiles::{Problem, builtin_names, builtin_text, load};
use ferrostep_thermistor::{Thermistor, ThermistorType};
use ferrostep_tmc2209::DriverSettings;
use ferrostep_virtual_board::HeatedMass;

const MM: i64 = 100_000;

/// Differences between the machines, from the design document's table.
struct Expected {
    name: &'static str,
    kinematics: Kinematics,
    size_mm: [f64; 3],
    steps_per_mm: [f64; 4],
    limits: Limits,
    jerk_mm_per_s3: f64,
    homes: [(HomeEnd, HomeSensor, f64); 3],
}

fn units(mm: f64) -> i64 {
    (mm * MM as f64).round() as i64
}

fn check(expected: &Expected) -> Profile {
    let profile = load(expected.name).unwrap();
    assert_eq!(profile.name, expected.name);
    assert_eq!(profile.kinematics, expected.kinematics);
    assert_eq!(profile.size_10nm, expected.size_mm.map(units));
    assert_eq!(profile.steps_per_mm, expected.steps_per_mm.map(|steps| StepsPerMm::from_f64(steps).unwrap()));
    assert_eq!(profile.limits, expected.limits);
    assert_eq!(profile.motion.jerk_mm_per_s3, expected.jerk_mm_per_s3);
    for (homing, (end, sensor, position_mm)) in profile.homing.iter().zip(expected.homes) {
        assert_eq!((homing.end, homing.sensor, homing.position_10nm), (end, sensor, units(position_mm)));
    }
    // 2 us at 84 MHz.
    assert_eq!(profile.minimum_event_interval_ticks, 168);
    // 400,000 events and 8,000 moves a second.
    assert_eq!((profile.event_cost_ticks, profile.move_cost_ticks), (210, 10_500));
    assert_eq!(profile.min_extrusion_celsius, 170.0);
    assert_eq!(
        profile.retraction,
        FirmwareRetraction {
            length_10nm: 3 * MM,
            retract_10nm_per_s: 45 * MM,
            extra_recover_10nm: 0,
            recover_10nm_per_s: 8 * MM,
            lift_10nm: 0,
        }
    );
    for heater in [profile.nozzle, profile.bed] {
        assert_eq!((heater.residency_window_celsius, heater.residency_ms), (1.0, 10_000));
    }
    profile
}

#[test]
fn cartesian_is_as_designed() {
    let profile = check(&Expected {
        name: "cartesian",
        kinematics: Kinematics::Cartesian,
        size_mm: [200.0, 200.0, 200.0],
        steps_per_mm: [80.0, 80.0, 400.0, 95.0],
        limits: Limits {
            max_feed_mm_per_s: [200.0, 200.0, 10.0, 60.0],
            max_acceleration_mm_per_s2: [1500.0, 1500.0, 100.0, 5000.0],
            print_acceleration_mm_per_s2: 1000.0,
            travel_acceleration_mm_per_s2: 1000.0,
            retract_acceleration_mm_per_s2: 1500.0,
            junction_deviation_mm: 0.1,
            instantaneous_corner_velocity_mm_per_s: [f64::INFINITY, f64::INFINITY, 5.0, 10.0],
        },
        jerk_mm_per_s3: 10_000.0,
        homes: [
            (HomeEnd::Min, HomeSensor::EndStop, 0.0),
            (HomeEnd::Min, HomeSensor::EndStop, 0.0),
            (HomeEnd::Min, HomeSensor::EndStop, 0.0),
        ],
    });
    assert_eq!(profile.lower_end_10nm, [0; 3]);
    assert_eq!(profile.safe_homing, SafeHoming { bed_10nm: [[0, 200 * MM]; 2], ..SafeHoming::NONE });
    // The conversions that the table has no column for, once each.
    assert_eq!(
        profile.homing[2],
        AxisHoming {
            end: HomeEnd::Min,
            sensor: HomeSensor::EndStop,
            triggers_low: false,
            position_10nm: 0,
            fast_mm_per_s: 4.0,
            slow_mm_per_s: 2.0,
            back_off_10nm: 2 * MM,
            overrun_10nm: 5 * MM,
            agree_10nm: MM / 2,
        }
    );
    assert_eq!(
        profile.nozzle,
        HeaterSettings {
            thermistor: Thermistor { kind: ThermistorType::Semitec104Gt2, pull_up_ohm: 4700.0 },
            watch: HeaterWatch { watch_ms: 20_000, watch_celsius: 2.0, runaway_ms: 40_000, runaway_celsius: 4.0 },
            min_celsius: 5.0,
            max_celsius: 275.0,
            max_target_celsius: 275.0,
            gains: PidGains { proportional: 0.1, integral: 0.004, derivative: 0.1, fan: 0.0 },
            residency_window_celsius: 1.0,
            residency_ms: 10_000,
            mass: HeatedMass::NOZZLE,
            is_heated: true,
            is_warmed_by_others: false,
        }
    );
    assert_eq!(profile.chamber, None);
    assert_eq!(profile.bed.thermistor, Thermistor { kind: ThermistorType::Epcos100k, pull_up_ohm: 4700.0 });
    assert_eq!(
        profile.bed.watch,
        HeaterWatch { watch_ms: 60_000, watch_celsius: 2.0, runaway_ms: 20_000, runaway_celsius: 2.0 }
    );
    assert_eq!(
        profile.driver,
        DriverTiming { pulse_width_ns: 1000, direction_setup_ns: 200, both_edges: false, inverted: 0 }
    );
    assert_eq!(profile.drivers, [None; 4]);
}

#[test]
fn corexy_is_as_designed() {
    check(&Expected {
        name: "corexy",
        kinematics: Kinematics::CoreXy,
        size_mm: [300.0, 300.0, 300.0],
        steps_per_mm: [160.0, 160.0, 800.0, 400.0],
        limits: Limits {
            max_feed_mm_per_s: [500.0, 500.0, 20.0, 80.0],
            max_acceleration_mm_per_s2: [10_000.0, 10_000.0, 500.0, 10_000.0],
            print_acceleration_mm_per_s2: 10_000.0,
            travel_acceleration_mm_per_s2: 10_000.0,
            retract_acceleration_mm_per_s2: 3000.0,
            junction_deviation_mm: 0.02,
            instantaneous_corner_velocity_mm_per_s: [f64::INFINITY, f64::INFINITY, 5.0, 10.0],
        },
        jerk_mm_per_s3: 300_000.0,
        homes: [
            (HomeEnd::Max, HomeSensor::EndStop, 300.0),
            (HomeEnd::Max, HomeSensor::EndStop, 300.0),
            (HomeEnd::Min, HomeSensor::EndStop, 0.0),
        ],
    });
}

#[test]
fn prusa_mini_is_as_designed() {
    let profile = check(&Expected {
        name: "prusa-mini",
        kinematics: Kinematics::Cartesian,
        size_mm: [180.4, 180.0, 185.0],
        steps_per_mm: [100.0, 100.0, 400.0, 325.0],
        limits: Limits {
            max_feed_mm_per_s: [180.0, 180.0, 12.0, 80.0],
            max_acceleration_mm_per_s2: [1250.0, 1250.0, 400.0, 4000.0],
            print_acceleration_mm_per_s2: 1250.0,
            travel_acceleration_mm_per_s2: 1250.0,
            retract_acceleration_mm_per_s2: 1250.0,
            junction_deviation_mm: 0.05,
            instantaneous_corner_velocity_mm_per_s: [f64::INFINITY, f64::INFINITY, 2.0, 10.0],
        },
        jerk_mm_per_s3: 15_000.0,
        homes: [
            (HomeEnd::Max, HomeSensor::Stall, 180.4),
            (HomeEnd::Min, HomeSensor::Stall, -3.0),
            (HomeEnd::Min, HomeSensor::Probe, 0.0),
        ],
    });
    // Prusa-Firmware-Buddy, Configuration_MINI.h: X_MIN_POS, Y_MIN_POS; Z_SAFE_HOMING_*_POINT less
    // NOZZLE_TO_PROBE_OFFSET.
    assert_eq!(profile.lower_end_10nm, [-2 * MM, -3 * MM, 0]);
    let safe = SafeHoming {
        raise_10nm: 4 * MM,
        home_at_10nm: Some([units(147.4 + 29.0), units(21.1 + 3.0)]),
        probe_offset_10nm: [-29 * MM, -3 * MM, 0],
        bed_10nm: [[0, 180 * MM]; 2],
        is_round: false,
    };
    assert_eq!(profile.safe_homing, safe);
    let [x, y, z] = profile.homing;
    assert_eq!((x.fast_mm_per_s, x.slow_mm_per_s, x.back_off_10nm, x.overrun_10nm), (50.0, 50.0, units(2.56), 10 * MM));
    assert_eq!((y.fast_mm_per_s, y.slow_mm_per_s, y.back_off_10nm, y.overrun_10nm), (50.0, 50.0, units(2.56), 10 * MM));
    assert_eq!((z.fast_mm_per_s, z.slow_mm_per_s, z.agree_10nm), (6.0, 1.5, MM / 5));
    let x = DriverSettings {
        current_ma: 350,
        hold_percent: 100,
        microsteps: 16,
        interpolate: true,
        stealth_chop: true,
        spread_cycle_above_mm_per_s: 0,
        steps_per_mm: 100.0,
        stall_threshold: 130,
        both_edges: true,
    };
    let z = DriverSettings { microsteps: 8, stall_threshold: 0, steps_per_mm: 400.0, ..x };
    let e = DriverSettings { microsteps: 16, current_ma: 400, stealth_chop: false, steps_per_mm: 325.0, ..z };
    assert_eq!(profile.drivers, [Some(x), Some(x), Some(z), Some(e)]);
    assert_eq!(profile.driver.inverted, 0b0011);
    let limits = |heater: HeaterSettings| (heater.max_celsius, heater.max_target_celsius);
    assert_eq!((limits(profile.nozzle), limits(profile.bed)), ((295.0, 280.0), (110.0, 100.0)));
    // The nozzle's gains are this project's, as the file says; the bed's are Prusa's: gains of
    // 255 and seconds.
    let gains = profile.bed.gains;
    for (gain, prusa) in [(gains.proportional, 120.0), (gains.integral, 1.5), (gains.derivative, 600.0)] {
        assert!((gain * 255.0 - prusa).abs() < 0.002 * prusa, "{gain} for {prusa} / 255");
    }
    assert_eq!(
        profile.bed.watch,
        HeaterWatch { watch_ms: 240_000, watch_celsius: 2.0, runaway_ms: 45_000, runaway_celsius: 25.0 }
    );
}

#[test]
fn the_names_are_those_that_load() {
    let names: Vec<_> = builtin_names().collect();
    assert_eq!(names, ["cartesian", "corexy", "prusa-mini"]);
    for name in names {
        assert_eq!(load(name).unwrap().name, name);
    }
    assert_eq!(builtin_text("delta"), None);
}

#[test]
fn a_path_is_read_and_equals_the_built_in_text() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/prusa-mini.toml");
    assert_eq!(load(path).unwrap(), load("prusa-mini").unwrap());
}

#[test]
fn what_is_neither_a_name_nor_a_file_is_answered_with_the_names() {
    let error = load("carthesian").unwrap_err();
    assert!(matches!(error.problem(), Problem::Read { .. }));
    let text = error.to_string();
    assert!(text.starts_with("carthesian: there is no such file, and no built-in profile of this name "), "{text}");
    assert!(text.ends_with("(cartesian, corexy, prusa-mini): did you mean cartesian?"), "{text}");
}

#[test]
fn a_folder_a_binary_file_and_an_endless_one_are_refused() {
    let this_program = std::env::current_exe().unwrap();
    let this_program = this_program.to_str().unwrap();
    for path in [env!("CARGO_MANIFEST_DIR"), this_program] {
        let error = load(path).unwrap_err();
        assert!(matches!(error.problem(), Problem::Read { .. }), "{path}: {error}");
    }
    if cfg!(unix) {
        let error = load("/dev/zero").unwrap_err();
        assert!(error.to_string().contains("larger than 1 MiB"), "{error}");
    }
}
