//! A fan with a tachometer: a rotor with inertia, two pulses a turn.
//!
//! A driven rotor approaches full speed, one without power stops, each with its own time
//! constant. The tachometer is an open collector with a pull-up: high and low for a quarter turn
//! each, at any speed.
//!
//! | what | test |
//! |---|---|
//! | spin-up, run-down, average under PWM | `the_rotor_*`, `pwm_*` |
//! | edges of the tachometer at their exact instants | `the_tachometer_*` |
//! | stuck rotor, dead tachometer | `a_stuck_*` |
//!
//! Left out: a tachometer that stops between PWM pulses (a fan switched at its ground loses the
//! tachometer's supply), speed by voltage.

/// Levels of the tachometer in a turn: two pulses, each a high and a low.
const LEVELS_A_TURN: f64 = 4.0;
/// Speed below which friction stops a fan, turns per second.
const MIN_TURNS_PER_S: f64 = 0.5;

/// The properties of a fan.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Config {
    /// Full speed, turns per minute.
    pub full_rpm: f64,
    /// Time constant of spinning up, ns.
    pub spin_up_ns: u64,
    /// Time constant of running down, ns.
    pub run_down_ns: u64,
}

/// A fault of a fan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum FanFault {
    /// The rotor is blocked and stops at once.
    Stuck,
    /// The rotor turns, but the tachometer stays high.
    TachometerDead,
}

/// The fan.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Fan {
    config: Config,
    driven: bool,
    fault: Option<FanFault>,
    /// Speed, turns per second.
    speed: f64,
    /// Quarter turns since the start.
    quarters: f64,
    at_ns: u64,
}

impl Fan {
    /// A fan at rest.
    pub fn new(config: Config) -> Self {
        Self { config, driven: false, fault: None, speed: 0.0, quarters: 0.0, at_ns: 0 }
    }

    /// Follows the fan's output pin; PWM calls this at each edge.
    pub fn set_driven(&mut self, now_ns: u64, driven: bool) {
        self.advance(now_ns);
        self.driven = driven;
    }

    /// Breaks or mends the fan.
    pub fn set_fault(&mut self, now_ns: u64, fault: Option<FanFault>) {
        self.advance(now_ns);
        self.fault = fault;
        if fault == Some(FanFault::Stuck) {
            self.speed = 0.0;
        }
    }

    /// The speed, turns per minute.
    pub fn rpm(&mut self, now_ns: u64) -> f64 {
        self.advance(now_ns);
        self.speed * 60.0
    }

    /// The airflow, 0 to 1: the speed relative to full speed.
    pub fn airflow(&mut self, now_ns: u64) -> f64 {
        let full_rpm = self.config.full_rpm.max(1e-9);
        (self.rpm(now_ns) / full_rpm).clamp(0.0, 1.0)
    }

    /// The tachometer's level at the time of the last call.
    pub fn tacho(&self) -> bool {
        self.fault == Some(FanFault::TachometerDead) || (self.quarters as u64).is_multiple_of(2)
    }

    /// Advances the rotor to `now_ns`.
    pub fn advance(&mut self, now_ns: u64) {
        let passed_ns = now_ns.saturating_sub(self.at_ns);
        if passed_ns == 0 {
            return;
        }
        (self.speed, self.quarters) = self.after(passed_ns);
        self.at_ns = now_ns;
        if !self.driven && self.speed < MIN_TURNS_PER_S {
            self.speed = 0.0;
        }
    }

    /// The next edge of the tachometer, ns; `None` while the rotor is at rest.
    pub fn next_event_ns(&self) -> Option<u64> {
        if self.fault == Some(FanFault::TachometerDead) {
            return None;
        }
        let next = self.quarters.floor() + 1.0;
        let reaches = |passed_ns: u64| self.after(passed_ns).1 >= next;
        // At most two seconds ahead; a slower rotor is examined again then.
        let mut high = 2_000_000_000;
        if !reaches(high) {
            let turns = self.speed > MIN_TURNS_PER_S || (self.driven && self.fault.is_none());
            return turns.then_some(self.at_ns + high);
        }
        let mut low = 0;
        while high - low > 1 {
            let middle = low + (high - low) / 2;
            if reaches(middle) { high = middle } else { low = middle }
        }
        Some(self.at_ns + high)
    }

    /// Speed and quarter turns after this time, both in closed form.
    fn after(&self, passed_ns: u64) -> (f64, f64) {
        if self.fault == Some(FanFault::Stuck) {
            return (0.0, self.quarters);
        }
        let (end, constant_ns) = if self.driven {
            (self.config.full_rpm / 60.0, self.config.spin_up_ns)
        } else {
            (0.0, self.config.run_down_ns)
        };
        let constant_s = constant_ns.max(1) as f64 / 1e9;
        let passed_s = passed_ns as f64 / 1e9;
        // 1 - exp(-x), accurate for tiny x too.
        let approach = -(-passed_s / constant_s).exp_m1();
        let turns = end * passed_s + (self.speed - end) * constant_s * approach;
        (self.speed + (end - self.speed) * approach, self.quarters + LEVELS_A_TURN * turns)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    const SECOND: u64 = 1_000_000_000;

    fn fan() -> Fan {
        Fan::new(Config { full_rpm: 6_000.0, spin_up_ns: SECOND / 2, run_down_ns: SECOND })
    }

    fn edges(fan: &mut Fan, from_ns: u64, until_ns: u64) -> Vec<u64> {
        let mut edges = Vec::new();
        fan.advance(from_ns);
        while let Some(at_ns) = fan.next_event_ns().filter(|&at_ns| at_ns <= until_ns) {
            let before = fan.tacho();
            fan.advance(at_ns);
            if fan.tacho() != before {
                edges.push(at_ns);
            }
        }
        edges
    }

    #[test]
    fn the_rotor_spins_up_and_runs_down_with_its_inertia() {
        let mut fan = fan();
        fan.set_driven(0, true);
        assert!((fan.rpm(SECOND / 2) - 6_000.0 * 0.632_12).abs() < 1.0);
        assert!((fan.rpm(10 * SECOND) - 6_000.0).abs() < 0.01);
        // 10 s at full speed minus one time constant.
        assert!((fan.quarters - 4.0 * 950.0).abs() < 0.01, "{}", fan.quarters);
        fan.set_driven(10 * SECOND, false);
        assert!((fan.rpm(11 * SECOND) - 6_000.0 * 0.367_88).abs() < 1.0);
        assert_eq!((fan.rpm(30 * SECOND), fan.next_event_ns()), (0.0, None));
    }

    #[test]
    fn the_tachometer_has_two_pulses_a_turn() {
        let mut fan = fan();
        fan.set_driven(0, true);
        let edges = edges(&mut fan, 20 * SECOND, 21 * SECOND);
        // 100 turns, 400 edges, 2.5 ms apart.
        assert!((399..=401).contains(&edges.len()), "{}", edges.len());
        assert!(edges.windows(2).all(|pair| (pair[1] - pair[0]).abs_diff(2_500_000) <= 2));
    }

    #[test]
    fn the_tachometer_is_independent_of_the_calls() {
        let (mut seldom, mut often) = (fan(), fan());
        seldom.set_driven(0, true);
        often.set_driven(0, true);
        let first = seldom.next_event_ns().unwrap();
        (1..100).for_each(|part| often.advance(first * part / 101));
        assert!(often.next_event_ns().unwrap().abs_diff(first) <= 1);
    }

    #[test]
    fn pwm_gives_intermediate_speeds() {
        let mut fan = fan();
        for period in 0..1_000 {
            fan.set_driven(period * 10_000_000, true);
            fan.set_driven(period * 10_000_000 + 5_000_000, false);
        }
        // Half on: the drive accelerates twice as strongly as friction slows.
        let rpm = fan.rpm(10 * SECOND);
        assert!((rpm - 4_000.0).abs() < 60.0, "{rpm}");
    }

    #[test]
    fn a_stuck_rotor_and_a_dead_tachometer_make_no_edges() {
        let mut fan = fan();
        fan.set_driven(0, true);
        fan.set_fault(5 * SECOND, Some(FanFault::Stuck));
        assert_eq!((fan.rpm(6 * SECOND), fan.next_event_ns(), fan.airflow(6 * SECOND)), (0.0, None, 0.0));
        fan.set_fault(6 * SECOND, Some(FanFault::TachometerDead));
        assert!(edges(&mut fan, 7 * SECOND, 8 * SECOND).is_empty() && fan.rpm(9 * SECOND) > 5_900.0);
        fan.set_fault(9 * SECOND, None);
        assert!(!edges(&mut fan, 9 * SECOND, 10 * SECOND).is_empty());
    }
}
