//! The gains of the built-in profiles settle on the heaters they are written for: 40 W and 250 W.
//! The MINI's heaters are others, with separate tests (`mini_heat.rs`).
//!
//! A plain f64 simulation: one heat capacity, loss to the room, a sensor that follows with a delay
//! of first order, and a PID at a fixed period. The derivative is that of the measurement, so that
//! a new target gives no kick; the integral is of the error that the slope leads to, and pauses
//! while the power is at its limit.

use ferrostep_printer::{HeaterSettings, PidGains};
use ferrostep_profiles::{builtin_names, load};

const ROOM_CELSIUS: f64 = 25.0;
/// Step of the simulated heater, s.
const STEP_S: f64 = 0.01;

/// A heated mass.
#[derive(Clone, Copy)]
struct Heater {
    watts: f64,
    joules_per_kelvin: f64,
    watts_per_kelvin: f64,
    sensor_delay_s: f64,
}

const NOZZLE: Heater = Heater { watts: 40.0, joules_per_kelvin: 12.0, watts_per_kelvin: 0.15, sensor_delay_s: 0.0 };

const BED: Heater = Heater { watts: 250.0, joules_per_kelvin: 500.0, watts_per_kelvin: 1.8, sensor_delay_s: 0.0 };

/// Result of a run, from the start towards the target.
#[derive(Debug)]
struct Outcome {
    /// Furthest beyond the target, degrees.
    overshoot: f64,
    /// Time from which the measured temperature stayed within the window, s.
    settled_s: f64,
    /// Changes of the temperature's direction of more than a tenth of a degree.
    reversals: usize,
}

/// Runs a heater from `start` to `target` for ten minutes.
fn simulate(heater: Heater, settings: &HeaterSettings, period_s: f64, start: f64, target: f64) -> Outcome {
    let steps_per_period = (period_s / STEP_S).round() as usize;
    let (mut temperature, mut measured, mut previous) = (start, start, start);
    // At rest at the start: the integral is the power that holds this temperature.
    let mut integral = heater.watts_per_kelvin * (start - ROOM_CELSIUS) / heater.watts;
    let mut power = integral;
    let mut outcome = Outcome { overshoot: 0.0, settled_s: 0.0, reversals: 0 };
    let mut turning_point = start;
    let mut rising = target > start;
    for step in 0..(600.0 / STEP_S) as usize {
        if step % steps_per_period == 0 {
            let error = target - measured;
            let rate = (measured - previous) / period_s;
            previous = measured;
            let raw =
                f64::from(settings.gains.proportional) * error + integral - f64::from(settings.gains.derivative) * rate;
            power = raw.clamp(0.0, 1.0);
            if raw == power {
                let ahead_s = f64::from(settings.gains.derivative / settings.gains.proportional);
                integral = (integral + f64::from(settings.gains.integral) * (error - ahead_s * rate) * period_s)
                    .clamp(0.0, 1.0);
            }
        }
        let lost_watts = heater.watts_per_kelvin * (temperature - ROOM_CELSIUS);
        temperature += (heater.watts * power - lost_watts) / heater.joules_per_kelvin * STEP_S;
        measured += (temperature - measured) * STEP_S / (heater.sensor_delay_s + STEP_S);

        let beyond = if target > start { temperature - target } else { target - temperature };
        outcome.overshoot = outcome.overshoot.max(beyond);
        if (measured - target).abs() > f64::from(settings.residency_window_celsius) {
            outcome.settled_s = (step + 1) as f64 * STEP_S;
        }
        let further = if rising { temperature > turning_point } else { temperature < turning_point };
        if further {
            turning_point = temperature;
        } else if (temperature - turning_point).abs() > 0.1 {
            outcome.reversals += 1;
            rising = !rising;
            turning_point = temperature;
        }
    }
    outcome
}

/// Time that full power takes from `start` to `target`, s.
fn full_power_s(heater: Heater, start: f64, target: f64) -> f64 {
    let highest = ROOM_CELSIUS + heater.watts / heater.watts_per_kelvin;
    heater.joules_per_kelvin / heater.watts_per_kelvin * ((highest - start) / (highest - target)).ln()
}

/// Every run of a heater: up to each target from the room and up by ten degrees, at three control
/// periods and with sensors up to this delay.
fn check(name: &str, heater: Heater, settings: &HeaterSettings, targets: &[f64], longest_delay_s: f64) {
    for &target in targets {
        for start in [ROOM_CELSIUS, target - 10.0] {
            for period_s in [0.05, 0.1, 0.25] {
                for sensor_delay_s in [0.0, longest_delay_s / 2.0, longest_delay_s] {
                    let heater = Heater { sensor_delay_s, ..heater };
                    let outcome = simulate(heater, settings, period_s, start, target);
                    let case =
                        format!("{name} {start} to {target}, {period_s} s, delay {sensor_delay_s} s: {outcome:?}");
                    assert!(outcome.overshoot < 2.0, "{case}");
                    // One return from the overshoot, and perhaps one more towards the target.
                    assert!(outcome.reversals <= 2, "{case}");
                    let limit_s = full_power_s(heater, start, target) + 60.0;
                    assert!(outcome.settled_s < limit_s, "{case}, expected {limit_s:.0} s");
                }
            }
        }
    }
}

/// The profiles for such heaters.
fn usual_names() -> impl Iterator<Item = &'static str> {
    builtin_names().filter(|name| *name != "prusa-mini")
}

#[test]
fn nozzles_settle_without_oscillation() {
    for name in usual_names() {
        let profile = load(name).unwrap();
        check(name, NOZZLE, &profile.nozzle, &[60.0, 170.0, 200.0, 215.0, 240.0], 1.5);
    }
}

#[test]
fn beds_settle_without_oscillation() {
    for name in usual_names() {
        let profile = load(name).unwrap();
        check(name, BED, &profile.bed, &[40.0, 60.0, 80.0, 100.0], 3.0);
    }
}

#[test]
fn heaters_settle_downwards_too() {
    // Cooling is not the controller's to hurry, but it must not end far below.
    for name in usual_names() {
        let profile = load(name).unwrap();
        for (heater, settings, start, target) in
            [(NOZZLE, profile.nozzle, 220.0, 200.0), (BED, profile.bed, 70.0, 60.0)]
        {
            let outcome = simulate(heater, &settings, 0.1, start, target);
            assert!(outcome.overshoot < 2.0 && outcome.reversals <= 2, "{name}: {outcome:?}");
            assert!(outcome.settled_s < 90.0, "{name}: {outcome:?}");
        }
    }
}

#[test]
fn the_simulation_can_tell_bad_gains() {
    let profile = load("cartesian").unwrap();
    let delayed = Heater { sensor_delay_s: 1.5, ..NOZZLE };
    let eager =
        HeaterSettings { gains: PidGains { integral: 0.1, derivative: 0.0, ..profile.nozzle.gains }, ..profile.nozzle };
    let outcome = simulate(delayed, &eager, 0.1, ROOM_CELSIUS, 200.0);
    assert!(outcome.overshoot > 2.0 && outcome.reversals > 2, "{outcome:?}");
}
