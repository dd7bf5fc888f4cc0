//! Tests commands that change limits, for each firmware.

use ferrostep_rules::klipper::KlipperSettings;
use ferrostep_rules::marlin::{Corner, JerkRule, MarlinSettings};
use ferrostep_rules::rrf::{JerkPolicy, RrfSettings};
use ferrostep_rules::{Change, Effect, FirmwareRetraction, Rules, VelocityLimit, Words};

const DEVIATION: Corner = Corner::JunctionDeviation { deviation_mm: 0.05, handles_small_segments: true };

#[test]
fn klipper_takes_m204_s_or_the_smaller_of_p_and_t() {
    let mut settings = KlipperSettings::with_defaults(300.0, 3000.0, 0.4, 1.75);
    let mut change = |words: &[(char, f64)]| {
        let effect = settings.change(&Change::M204(Words::new(words)));
        (effect, settings.max_accel_mm_per_s2)
    };
    assert_eq!(change(&[('S', 1000.0)]), (Effect::Changed, 1000.0));
    assert_eq!(change(&[('P', 2000.0), ('T', 1500.0)]), (Effect::Changed, 1500.0));
    assert_eq!(change(&[('P', 900.0)]), (Effect::Refused, 1500.0));
    assert_eq!(change(&[('S', 0.0)]), (Effect::Refused, 1500.0));
    assert_eq!(change(&[]), (Effect::Refused, 1500.0));
    assert_eq!(settings.change(&Change::M205(Words::new(&[('X', 8.0)]))), Effect::Unknown);
    assert_eq!(settings.change(&Change::M201(Words::new(&[('X', 8.0)]))), Effect::Unknown);
}

#[test]
fn klipper_takes_set_velocity_limit() {
    let mut settings = KlipperSettings::with_defaults(300.0, 3000.0, 0.4, 1.75);
    let limit = VelocityLimit { accel: Some(5000.0), minimum_cruise_ratio: Some(0.0), ..VelocityLimit::default() };
    assert_eq!(settings.change(&Change::VelocityLimit(limit)), Effect::Changed);
    assert_eq!((settings.max_accel_mm_per_s2, settings.minimum_cruise_ratio), (5000.0, 0.0));
    let bad = VelocityLimit { velocity: Some(0.0), accel: Some(1.0), ..VelocityLimit::default() };
    assert_eq!(settings.change(&Change::VelocityLimit(bad)), Effect::Refused);
    assert_eq!((settings.max_accel_mm_per_s2, settings.max_velocity_mm_per_s), (5000.0, 300.0));
    assert_eq!(settings.change(&Change::VelocityLimit(VelocityLimit::default())), Effect::Unchanged);
}

/// As in *G-Codes* of Klipper 0.12: the ratio is 1 minus `ACCEL_TO_DECEL` over the acceleration,
/// and `MINIMUM_CRUISE_RATIO` takes precedence.
#[test]
fn klipper_takes_accel_to_decel_for_a_ratio() {
    let mut settings = KlipperSettings::with_defaults(300.0, 3000.0, 0.4, 1.75);
    let mut ratio = |accel, accel_to_decel, minimum_cruise_ratio| {
        let limit = VelocityLimit { accel, accel_to_decel, minimum_cruise_ratio, ..VelocityLimit::default() };
        (settings.change(&Change::VelocityLimit(limit)), settings.minimum_cruise_ratio)
    };
    assert_eq!(ratio(None, Some(750.0), None), (Effect::Changed, 0.75));
    assert_eq!(ratio(Some(1000.0), Some(900.0), None), (Effect::Changed, 1.0 - 0.9));
    assert_eq!(ratio(None, Some(5000.0), None), (Effect::Changed, 0.0));
    assert_eq!(ratio(None, Some(100.0), Some(0.25)), (Effect::Changed, 0.25));
    assert_eq!(ratio(None, Some(0.0), None), (Effect::Refused, 0.25));
    assert_eq!(ratio(None, None, Some(1.0)), (Effect::Refused, 0.25));
}

#[test]
fn marlin_takes_its_commands() {
    let mut settings = MarlinSettings::example(DEVIATION);
    assert_eq!(settings.change(&Change::M201(Words::new(&[('X', 900.0), ('E', 4000.0)]))), Effect::Changed);
    assert_eq!(settings.max_acceleration_mm_per_s2, [900.0, 3000.0, 100.0, 4000.0]);
    assert_eq!(settings.change(&Change::M203(Words::new(&[('X', 200.0), ('Z', 0.0)]))), Effect::Refused);
    assert_eq!(settings.max_feed_mm_per_s[0], 300.0);
    assert_eq!(settings.change(&Change::M204(Words::new(&[('S', 800.0), ('R', 700.0)]))), Effect::Changed);
    let accelerations = [
        settings.acceleration_mm_per_s2,
        settings.travel_acceleration_mm_per_s2,
        settings.retract_acceleration_mm_per_s2,
    ];
    assert_eq!(accelerations, [800.0, 800.0, 700.0]);
    assert_eq!(settings.change(&Change::M205(Words::new(&[('X', 8.0), ('Y', 8.0)]))), Effect::Unchanged);
    assert_eq!(settings.change(&Change::M205(Words::new(&[('J', 0.5)]))), Effect::Refused);
    assert_eq!(settings.change(&Change::M205(Words::new(&[('J', 0.02)]))), Effect::Changed);
    assert_eq!(settings.corner, Corner::JunctionDeviation { deviation_mm: 0.02, handles_small_segments: true });
    let rule = JerkRule::SafeSpeed;
    let mut settings = MarlinSettings::example(Corner::ClassicJerk { jerk_mm_per_s: [8.0; 4], rule });
    assert_eq!(settings.change(&Change::M205(Words::new(&[('X', 5.0), ('S', 1.0)]))), Effect::Changed);
    assert_eq!(settings.corner, Corner::ClassicJerk { jerk_mm_per_s: [5.0, 8.0, 8.0, 8.0], rule });
    assert_eq!(settings.change(&Change::M205(Words::new(&[('J', 0.02)]))), Effect::Unchanged);
    assert_eq!(settings.change(&Change::M566(Words::new(&[('X', 600.0)]))), Effect::Unknown);
}

#[test]
fn rrf_takes_its_commands_in_its_units() {
    let mut settings = RrfSettings::defaults();
    assert_eq!(settings.change(&Change::M203(Words::new(&[('X', 12_000.0)]))), Effect::Changed);
    assert_eq!(settings.max_feed_mm_per_s[0], 200.0);
    assert_eq!(settings.change(&Change::M203(Words::new(&[('S', 1.0), ('Y', 150.0)]))), Effect::Changed);
    assert_eq!(settings.max_feed_mm_per_s[1], 150.0);
    assert_eq!(settings.change(&Change::M566(Words::new(&[('X', 600.0), ('P', 1.0)]))), Effect::Changed);
    assert_eq!((settings.jerk_mm_per_s[0], settings.jerk_policy), (10.0, JerkPolicy::Always));
    assert_eq!(settings.change(&Change::M205(Words::new(&[('Y', 7.0)]))), Effect::Changed);
    assert_eq!(settings.jerk_mm_per_s[1], 7.0);
    assert_eq!(settings.change(&Change::M204(Words::new(&[('P', 900.0), ('T', 1200.0)]))), Effect::Changed);
    assert_eq!((settings.print_acceleration_mm_per_s2, settings.travel_acceleration_mm_per_s2), (900.0, 1200.0));
    assert!(settings.check().is_ok());
}

#[test]
fn settings_of_zero_are_refused_by_name() {
    let klipper = KlipperSettings { max_accel_mm_per_s2: 0.0, ..KlipperSettings::with_defaults(300.0, 1.0, 0.4, 1.75) };
    assert_eq!(klipper.check().unwrap_err().to_string(), "max_accel is 0, expected more than 0");
    let mut marlin = MarlinSettings::example(DEVIATION);
    marlin.max_feed_mm_per_s[2] = f64::NAN;
    assert_eq!(marlin.check().unwrap_err().name(), "M203 Z");
    let rrf = RrfSettings { ring_length: 0, ..RrfSettings::defaults() };
    assert_eq!(rrf.check().unwrap_err().name(), "M595 P");
}

#[test]
fn m220_is_a_factor_where_the_firmware_takes_it() {
    assert_eq!(Rules::Klipper.speed_factor(150.0), Some(1.5));
    assert_eq!(Rules::Klipper.speed_factor(0.0), None);
    assert_eq!(Rules::MarlinClassicJerk.speed_factor(80.9), Some(0.8));
    assert_eq!(Rules::Rrf.speed_factor(0.5), None);
}

#[test]
fn m207_means_something_else_to_each() {
    let start = FirmwareRetraction {
        length_mm: 1.0,
        extra_recover_mm: 0.0,
        retract_mm_per_s: 40.0,
        recover_mm_per_s: 30.0,
        lift_mm: 0.0,
    };
    let words = [('S', 0.8), ('R', -1.0), ('F', 1800.0)];
    let mut rrf = start;
    rrf.set_by_rrf_m207(&Words::new(&words));
    assert_eq!((rrf.retract(), rrf.recover()), ((-0.8, 30.0), (0.0, 30.0)));
    let mut marlin = start;
    marlin.set_by_marlin_m207(&Words::new(&words));
    marlin.set_by_marlin_m208(&Words::new(&[('S', 0.1), ('F', 600.0)]));
    assert_eq!((marlin.retract(), marlin.recover()), ((-0.8, 30.0), (0.9, 10.0)));
}
