//! Temperatures in time, in bounded memory.

/// Maximum number of instants that are kept.
const MAX_INSTANTS: usize = 1 << 15;
/// Shortest time between two, s, and smallest difference that is worth one within it, degrees.
const INTERVAL_S: f64 = 1.0;
const DIFFERENCE_C: f32 = 0.5;

/// A chamber's temperature at a time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Chamber {
    /// Degrees Celsius.
    pub celsius: f32,
    /// Target of the chamber; 0 is off.
    pub target_celsius: f32,
}

/// Temperatures and fan at a time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Temperature {
    /// s from the first line on.
    pub time_s: f64,
    /// Nozzle and bed, degrees Celsius.
    pub celsius: [f32; 2],
    /// Targets of nozzle and bed; 0 is off.
    pub target_celsius: [f32; 2],
    /// The same of the chamber, if its temperature is known.
    pub chamber: Option<Chamber>,
    /// Part-cooling fan, 0 to 255.
    pub fan_power: u8,
}

/// All instants; where there are too many, those are left out whose neighbours are near.
#[derive(Debug)]
pub(crate) struct Temperatures {
    kept: Vec<Temperature>,
    last: Temperature,
    interval_s: f64,
}

impl Default for Temperatures {
    fn default() -> Self {
        Self { kept: Vec::new(), last: Temperature::default(), interval_s: INTERVAL_S }
    }
}

impl Temperatures {
    pub fn note(&mut self, now: Temperature) {
        self.last = now;
        let is_new = self.kept.last().is_none_or(|kept| {
            let chambers = kept.chamber.zip(now.chamber);
            let pairs = kept.celsius.into_iter().zip(now.celsius).chain(chambers.map(|(a, b)| (a.celsius, b.celsius)));
            let differs = pairs.into_iter().any(|(a, b)| (a - b).abs() > DIFFERENCE_C);
            let targets = kept.target_celsius != now.target_celsius
                || chambers.is_some_and(|(a, b)| a.target_celsius != b.target_celsius);
            let changed = targets || kept.fan_power != now.fan_power;
            let passed_s = now.time_s - kept.time_s;
            passed_s >= 60.0 * self.interval_s || (differs || changed) && passed_s >= self.interval_s
        });
        if !is_new {
            return;
        }
        if self.kept.len() == MAX_INSTANTS {
            let mut number = 0;
            self.kept.retain(|_| {
                number += 1;
                number % 2 == 1
            });
            self.interval_s *= 2.0;
        }
        self.kept.push(now);
    }

    pub fn finish(mut self) -> Vec<Temperature> {
        if self.kept.last() != Some(&self.last) {
            self.kept.push(self.last);
        }
        self.kept
    }
}
