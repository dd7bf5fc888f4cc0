//! Heaters with their heated bodies, and thermistors ([`thermistor`]).
//!
//! A heated body is one mass that loses heat to the air; its sensor follows it with its own lag, so
//! the response to power is of second order. A transport delay before it can be set. Between
//! changes of power both equations are solved exactly:
//!
//! ```text
//! C dT/dt = P - G (T - ambient)        lag dS/dt = T - S
//! ```
//!
//! G is the loss to still air, more of it with the fan, and what filament takes that is melted.
//!
//! | what | test |
//! |---|---|
//! | mass, loss, fan, filament, sensor lag, each in closed form | `fine_steps_agree`, `the_body_settles_*`, `equal_times_*` |
//! | transport delay | `a_dead_time_*` |
//! | supply voltage, broken heater, switch shorted | `faults_*` |
//!
//! Left out: radiation (loss that grows faster than the difference), heat from the bed to
//! the nozzle. Set `loss_w_per_k` for the temperature of interest.

pub mod thermistor;

use std::collections::VecDeque;

/// The properties of a heater and its body.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Config {
    /// Power at nominal voltage, in watts.
    pub power_w: f64,
    /// Heat capacity, in joules per kelvin.
    pub capacity_j_per_k: f64,
    /// Loss to still air, in watts per kelvin above ambient.
    pub loss_w_per_k: f64,
    /// Additional loss with the fan at full speed, in watts per kelvin.
    pub fan_loss_w_per_k: f64,
    /// Time constant of the sensor's lag, in seconds; 0 for none.
    pub sensor_lag_s: f64,
    /// Delay before power begins to warm the body, in ns.
    pub dead_time_ns: u64,
    /// Temperature of the air, and of the body at the start, in degrees Celsius.
    pub ambient_celsius: f64,
}

/// A fault of a heater.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum HeaterFault {
    /// The wire is broken: it never heats.
    Broken,
    /// The transistor always conducts: it heats whatever the level of the pin.
    StuckOn,
}

/// A heated body.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Heater {
    config: Config,
    on: bool,
    power_scale: f64,
    fan: f64,
    filament_w_per_k: f64,
    fault: Option<HeaterFault>,
    ambient_celsius: f64,
    /// Changes of power that have not reached the body yet.
    pending: VecDeque<(u64, f64)>,
    power_w: f64,
    body_celsius: f64,
    sensor_celsius: f64,
    hottest_celsius: f64,
    at_ns: u64,
    energy_j: f64,
    drawn_w: f64,
    drawn_since_ns: u64,
}

impl Heater {
    /// A heater that is off and as warm as the air.
    ///
    /// # Errors
    /// Capacity or loss is not above 0, or the lag is below 0.
    pub fn new(config: Config) -> Result<Self, String> {
        for (name, value) in [("capacity_j_per_k", config.capacity_j_per_k), ("loss_w_per_k", config.loss_w_per_k)] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(format!("{name} is {value}, expected a number above 0"));
            }
        }
        for (name, value) in [("sensor_lag_s", config.sensor_lag_s), ("fan_loss_w_per_k", config.fan_loss_w_per_k)] {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(format!("{name} is {value}, expected 0 or more"));
            }
        }
        let ambient_celsius = config.ambient_celsius;
        Ok(Self {
            config,
            on: false,
            power_scale: 1.0,
            fan: 0.0,
            filament_w_per_k: 0.0,
            fault: None,
            ambient_celsius,
            pending: VecDeque::new(),
            power_w: 0.0,
            body_celsius: ambient_celsius,
            sensor_celsius: ambient_celsius,
            hottest_celsius: ambient_celsius,
            at_ns: 0,
            energy_j: 0.0,
            drawn_w: 0.0,
            drawn_since_ns: 0,
        })
    }

    /// Switches the heater on or off.
    pub fn set_on(&mut self, now_ns: u64, on: bool) {
        self.on = on;
        self.change_power(now_ns);
    }

    /// Sets the supply's power relative to nominal: the square of voltage over nominal.
    pub fn set_power_scale(&mut self, now_ns: u64, scale: f64) {
        self.power_scale = scale.max(0.0);
        self.change_power(now_ns);
    }

    /// Breaks or mends the heater.
    pub fn set_fault(&mut self, now_ns: u64, fault: Option<HeaterFault>) {
        self.fault = fault;
        self.change_power(now_ns);
    }

    /// True if the transistor always conducts.
    pub fn is_stuck_on(&self) -> bool {
        self.fault == Some(HeaterFault::StuckOn)
    }

    /// Sets the airflow at the body, 0 to 1.
    pub fn set_fan(&mut self, now_ns: u64, fan: f64) {
        self.advance(now_ns);
        self.fan = fan.clamp(0.0, 1.0);
    }

    /// Sets the heat that filament takes, which comes as cold as the air, in watts per
    /// kelvin above ambient.
    pub fn set_filament(&mut self, now_ns: u64, w_per_k: f64) {
        self.advance(now_ns);
        self.filament_w_per_k = w_per_k.max(0.0);
    }

    /// Sets the air's temperature in degrees Celsius.
    pub fn set_ambient(&mut self, now_ns: u64, celsius: f64) {
        self.advance(now_ns);
        self.ambient_celsius = celsius;
    }

    /// Sets body and sensor to a temperature, to start with a warm machine.
    pub fn set_temperature(&mut self, now_ns: u64, celsius: f64) {
        self.advance(now_ns);
        (self.body_celsius, self.sensor_celsius) = (celsius, celsius);
        self.hottest_celsius = self.hottest_celsius.max(celsius);
    }

    /// The electrical power now, in watts.
    pub fn drawn_w(&self) -> f64 {
        self.drawn_w
    }

    /// The energy so far, in joules.
    pub fn energy_j(&self, now_ns: u64) -> f64 {
        self.energy_j + self.drawn_w * seconds(now_ns.saturating_sub(self.drawn_since_ns))
    }

    /// The body's temperature in degrees Celsius.
    pub fn body_celsius(&mut self, now_ns: u64) -> f64 {
        self.advance(now_ns);
        self.body_celsius
    }

    /// The sensor's temperature in degrees Celsius.
    pub fn sensor_celsius(&mut self, now_ns: u64) -> f64 {
        self.advance(now_ns);
        self.sensor_celsius
    }

    /// The highest temperature of the body, in degrees Celsius, sampled at changes of power and at
    /// reads. The body is hottest when its power ends, so no maximum between the samples is missed.
    pub fn hottest_celsius(&self) -> f64 {
        self.hottest_celsius
    }

    /// The air's temperature in degrees Celsius.
    pub fn ambient_celsius(&self) -> f64 {
        self.ambient_celsius
    }

    fn change_power(&mut self, now_ns: u64) {
        self.advance(now_ns);
        let on = match self.fault {
            None => self.on,
            Some(HeaterFault::Broken) => false,
            Some(HeaterFault::StuckOn) => true,
        };
        let drawn_w = if on { self.config.power_w * self.power_scale } else { 0.0 };
        if drawn_w == self.drawn_w {
            return;
        }
        self.energy_j = self.energy_j(now_ns);
        (self.drawn_w, self.drawn_since_ns) = (drawn_w, now_ns);
        self.pending.push_back((now_ns + self.config.dead_time_ns, drawn_w));
        self.advance(now_ns);
    }

    /// Simulates the flow of heat up to `now_ns`.
    pub fn advance(&mut self, now_ns: u64) {
        while let Some((at_ns, power_w)) = self.pending.pop_front_if(|(at_ns, _)| *at_ns <= now_ns) {
            self.flow(at_ns);
            self.power_w = power_w;
        }
        self.flow(now_ns);
    }

    /// Solves both equations over a time of constant power.
    fn flow(&mut self, until_ns: u64) {
        let passed_s = seconds(until_ns.saturating_sub(self.at_ns));
        if passed_s <= 0.0 {
            return;
        }
        self.at_ns = until_ns;
        let loss_w_per_k = self.config.loss_w_per_k + self.fan * self.config.fan_loss_w_per_k + self.filament_w_per_k;
        let end_celsius = self.ambient_celsius + self.power_w / loss_w_per_k;
        let body_s = self.config.capacity_j_per_k / loss_w_per_k;
        let lag_s = self.config.sensor_lag_s;
        let body_decay = (-passed_s / body_s).exp();
        let above = self.body_celsius - end_celsius;
        let sensor_above = self.sensor_celsius - end_celsius;
        self.sensor_celsius = end_celsius
            + if lag_s <= 0.0 {
                above * body_decay
            } else if (body_s - lag_s).abs() < 1e-6 * body_s {
                (sensor_above + above * passed_s / lag_s) * (-passed_s / lag_s).exp()
            } else {
                let share = above * body_s / (body_s - lag_s);
                share * body_decay + (sensor_above - share) * (-passed_s / lag_s).exp()
            };
        self.body_celsius = end_celsius + above * body_decay;
        self.hottest_celsius = self.hottest_celsius.max(self.body_celsius);
    }
}

fn seconds(ns: u64) -> f64 {
    ns as f64 / 1e9
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use proptest::prelude::*;

    const SECOND: u64 = 1_000_000_000;

    fn hotend() -> Config {
        Config {
            power_w: 40.0,
            capacity_j_per_k: 12.0,
            loss_w_per_k: 0.12,
            fan_loss_w_per_k: 0.04,
            sensor_lag_s: 3.0,
            dead_time_ns: 0,
            ambient_celsius: 21.0,
        }
    }

    proptest! {
        #[test]
        fn fine_steps_agree(
            lag_s in 0.5_f64..150.0,
            pieces in proptest::collection::vec((any::<bool>(), 0.0_f64..1.0, 1_u64..20), 1..8),
        ) {
            let config = Config { sensor_lag_s: lag_s, ..hotend() };
            let mut heater = Heater::new(config.clone()).unwrap();
            let (mut body, mut sensor, mut now_ns) = (21.0, 21.0, 0);
            for (on, fan, length_s) in pieces {
                heater.set_on(now_ns, on);
                heater.set_fan(now_ns, fan);
                for _ in 0..length_s * 1000 {
                    let loss = 0.12 + 0.04 * fan;
                    let power = if on { 40.0 } else { 0.0 };
                    let flow: f64 = power - loss * (body - 21.0);
                    // Two stages a step (Heun), so that the check is more accurate than the model.
                    let half = body + flow / 12.0 * 0.0005;
                    let sensor_half: f64 = sensor + (body - sensor) / lag_s * 0.0005;
                    body += (power - loss * (half - 21.0)) / 12.0 * 0.001;
                    sensor += (half - sensor_half) / lag_s * 0.001;
                }
                now_ns += length_s * SECOND;
                prop_assert!((heater.body_celsius(now_ns) - body).abs() < 1e-3);
                prop_assert!((heater.sensor_celsius(now_ns) - sensor).abs() < 1e-3);
            }
        }
    }

    #[test]
    fn the_body_settles_where_loss_equals_power() {
        let mut heater = Heater::new(hotend()).unwrap();
        heater.set_on(0, true);
        let end = 21.0 + 40.0 / 0.12;
        assert!((heater.sensor_celsius(3_000 * SECOND) - end).abs() < 0.01);
        heater.set_fan(3_000 * SECOND, 1.0);
        assert!((heater.sensor_celsius(6_000 * SECOND) - (21.0 + 40.0 / 0.16)).abs() < 0.01);
        let mut melting = heater.clone();
        melting.set_filament(6_000 * SECOND, 0.04);
        assert!((melting.sensor_celsius(9_000 * SECOND) - (21.0 + 40.0 / 0.2)).abs() < 0.01);
        assert!((heater.energy_j(6_000 * SECOND) - 240_000.0).abs() < 1e-6);
        heater.set_on(6_000 * SECOND, false);
        assert!((heater.body_celsius(9_000 * SECOND) - 21.0).abs() < 0.01);
        assert!((heater.hottest_celsius() - end).abs() < 0.01);
        assert!((heater.energy_j(9_000 * SECOND) - 240_000.0).abs() < 1e-6);
    }

    #[test]
    fn equal_times_are_continuous() {
        let lag_s = 12.0 / 0.12;
        let at = |lag_s: f64| {
            let mut heater = Heater::new(Config { sensor_lag_s: lag_s, ..hotend() }).unwrap();
            heater.set_on(0, true);
            heater.sensor_celsius(50 * SECOND)
        };
        assert!((at(lag_s) - at(lag_s * 1.0001)).abs() < 0.01 && at(lag_s) > 30.0);
        assert!((at(0.0) - at(1e-9)).abs() < 1e-3);
    }

    #[test]
    fn a_dead_time_only_delays_the_response() {
        let mut prompt = Heater::new(hotend()).unwrap();
        let mut late = Heater::new(Config { dead_time_ns: 2 * SECOND, ..hotend() }).unwrap();
        for second in 0..20 {
            for heater in [&mut prompt, &mut late] {
                heater.set_on(second * SECOND, second % 3 != 0);
            }
        }
        for second in 20..30 {
            let (now, then) = (prompt.body_celsius(second * SECOND), late.body_celsius((second + 2) * SECOND));
            assert!((now - then).abs() < 1e-6, "{now} {then}");
        }
    }

    #[test]
    fn faults_and_supply_change_the_power() {
        let mut heater = Heater::new(hotend()).unwrap();
        heater.set_fault(0, Some(HeaterFault::Broken));
        heater.set_on(0, true);
        assert_eq!((heater.drawn_w(), heater.body_celsius(SECOND)), (0.0, 21.0));
        heater.set_fault(SECOND, Some(HeaterFault::StuckOn));
        heater.set_on(SECOND, false);
        heater.set_power_scale(SECOND, 0.25);
        assert_eq!(heater.drawn_w(), 10.0);
        assert!(heater.body_celsius(2 * SECOND) > 21.5);
        assert!(Heater::new(Config { capacity_j_per_k: 0.0, ..hotend() }).unwrap_err().contains("capacity_j_per_k"));
    }
}
