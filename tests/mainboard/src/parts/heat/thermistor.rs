//! Thermistors: resistance by temperature, and the voltage at a converter below a pull-up.
//!
//! | what | source | test |
//! |---|---|---|
//! | beta equation | B25/85 from data sheets | `beta_*` |
//! | Steinhart and Hart's equation, also through three points of a maker's table | | `three_points_*` |
//! | a maker's table, interpolated linearly in ln R over 1/T | | `a_table_*` |
//! | Semitec 104GT-2, EPCOS B57560G104F | makers' data | `known_sensors_*` |
//! | platinum | IEC 60751, with the term for temperatures below 0 | `platinum_*` |
//! | noise, open, short, slipped out, drift, loose contact | | `faults_*`, `noise_*` |
//!
//! Left out: self-heating of the bead (some 0.1 K at a pull-up of 4.7 kiloohm), the converter's own
//! errors and sampling capacitor.

use crate::parts::random::Random;

const ZERO_CELSIUS_K: f64 = 273.15;

/// The dependence of resistance on temperature.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum Curve {
    /// R = R25 exp(B (1/T - 1/298.15 K)).
    Beta {
        /// Resistance at 25 degrees Celsius in ohms.
        r25_ohm: f64,
        /// B in kelvin.
        beta_k: f64,
    },
    /// 1/T = a + b ln R + c (ln R)^3, T in kelvin, R in ohms.
    SteinhartHart {
        /// a
        a: f64,
        /// b
        b: f64,
        /// c
        c: f64,
    },
    /// Callendar and van Dusen's equation with the coefficients of IEC 60751.
    Platinum {
        /// Resistance at 0 degrees Celsius in ohms.
        r0_ohm: f64,
    },
    /// A maker's table: degrees Celsius, rising, and ohms, falling. Its outermost
    /// pairs extrapolate.
    Table(Vec<(f64, f64)>),
}

impl Curve {
    /// Semitec 104GT-2 by its maker's constants: 100 kiloohm at 25 degrees Celsius, B25/85 4267 K.
    /// Accurate near those temperatures; at 200 degrees and above use
    /// [`Curve::semitec_104gt_2_points`].
    pub fn semitec_104gt_2() -> Self {
        Self::Beta { r25_ohm: 100_000.0, beta_k: 4267.0 }
    }

    /// Semitec 104GT-2 through three points of its maker's table: 20, 150 and 300 degrees Celsius.
    pub fn semitec_104gt_2_points() -> Self {
        Self::three_points([(20.0, 126_800.0), (150.0, 1_360.0), (300.0, 80.65)])
    }

    /// EPCOS (TDK) B57560G104F through three points of its maker's table: 25, 150 and 250
    /// degrees Celsius.
    pub fn epcos_b57560g104f() -> Self {
        Self::three_points([(25.0, 100_000.0), (150.0, 1_641.9), (250.0, 226.15)])
    }

    /// A PT1000.
    pub fn pt1000() -> Self {
        Self::Platinum { r0_ohm: 1000.0 }
    }

    /// Steinhart and Hart's equation through three pairs of degrees Celsius and
    /// ohms, all different.
    pub fn three_points(points: [(f64, f64); 3]) -> Self {
        let logs = points.map(|(_, ohm)| ohm.ln());
        let inverse = points.map(|(celsius, _)| 1.0 / (celsius + ZERO_CELSIUS_K));
        let slope = |index: usize| (inverse[index] - inverse[0]) / (logs[index] - logs[0]);
        let (second, third) = (slope(1), slope(2));
        let c = (third - second) / ((logs[2] - logs[1]) * (logs[0] + logs[1] + logs[2]));
        let b = second - c * (logs[0].powi(2) + logs[0] * logs[1] + logs[1].powi(2));
        let a = inverse[0] - logs[0] * (b + c * logs[0].powi(2));
        Self::SteinhartHart { a, b, c }
    }

    /// Resistance in ohms at this temperature.
    pub fn ohm(&self, celsius: f64) -> f64 {
        let kelvin = (celsius + ZERO_CELSIUS_K).max(1.0);
        match self {
            Self::Beta { r25_ohm, beta_k } => r25_ohm * (beta_k * (1.0 / kelvin - 1.0 / 298.15)).exp(),
            Self::SteinhartHart { a, b, c } => {
                // The only real root of c x^3 + b x + a - 1/T = 0 (Cardano), b and c above 0.
                if c.abs() < 1e-15 {
                    return ((1.0 / kelvin - a) / b).exp();
                }
                let half = (a - 1.0 / kelvin) / (2.0 * c);
                let third = b / (3.0 * c);
                let root = (half * half + third.powi(3)).max(0.0).sqrt();
                ((root - half).cbrt() - (root + half).cbrt()).exp()
            }
            Self::Platinum { r0_ohm } => {
                let below = if celsius < 0.0 { -4.183e-12 * (celsius - 100.0) * celsius.powi(3) } else { 0.0 };
                r0_ohm * (1.0 + 3.9083e-3 * celsius - 5.775e-7 * celsius * celsius + below)
            }
            Self::Table(points) => table_ohm(points, kelvin),
        }
    }
}

fn table_ohm(points: &[(f64, f64)], kelvin: f64) -> f64 {
    let celsius = kelvin - ZERO_CELSIUS_K;
    let above = points.partition_point(|&(at, _)| at < celsius).clamp(1, points.len().saturating_sub(1).max(1));
    let (Some(low), Some(high)) = (points.get(above - 1), points.get(above)) else {
        return points.first().map_or(f64::INFINITY, |point| point.1);
    };
    let inverse = |celsius: f64| 1.0 / (celsius + ZERO_CELSIUS_K);
    let part = (1.0 / kelvin - inverse(low.0)) / (inverse(high.0) - inverse(low.0));
    (low.1.ln() + part * (high.1 / low.1).ln()).exp()
}

/// A fault of a thermistor.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum SensorFault {
    /// The wire is broken: the pull-up pulls the converter to the reference.
    Open,
    /// Shorted to ground: 0 V.
    Short,
    /// Slipped out of its block at `since_ns`: falls to the air's temperature with this time
    /// constant, except for a share of the block's temperature above it.
    SlippedOut {
        /// The instant of the slip.
        since_ns: u64,
        /// Time constant in ns, some 10 s.
        time_constant_ns: u64,
        /// Share of the block's heat that still reaches it, 0 to 1.
        coupling: f64,
    },
    /// The reading's error grows from `since_ns` on.
    Drift {
        /// The start.
        since_ns: u64,
        /// Kelvin per hour; below 0 it reads too cold.
        kelvin_per_hour: f64,
    },
    /// A loose contact: each reading is open with this probability (0 to 1).
    Loose {
        /// The probability.
        probability: f64,
    },
}

/// The properties of a thermistor with its pull-up.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ThermistorConfig {
    /// The curve.
    pub curve: Curve,
    /// Pull-up resistor to the reference, in ohms, typically 4700.
    pub pull_up_ohm: f64,
    /// The converter's reference and the pull-up's other end, in millivolts.
    pub reference_mv: f64,
    /// Standard deviation of a reading in millivolts; 0.8 is one step of 12 bits at 3.3 V.
    pub noise_mv: f64,
    /// Seed of noise and loose contacts.
    pub seed: u64,
}

/// A thermistor.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Thermistor {
    config: ThermistorConfig,
    fault: Option<SensorFault>,
    random: Random,
}

impl Thermistor {
    /// A thermistor without a fault.
    pub fn new(config: ThermistorConfig) -> Self {
        let random = Random::new(config.seed);
        Self { config, fault: None, random }
    }

    /// Breaks or mends the thermistor.
    pub fn set_fault(&mut self, fault: Option<SensorFault>) {
        self.fault = fault;
    }

    /// The voltage of one sample at the converter, in millivolts, at these temperatures
    /// of sensor and air.
    pub fn millivolts(&mut self, now_ns: u64, celsius: f64, ambient_celsius: f64) -> f64 {
        let reference_mv = self.config.reference_mv;
        let noise_mv = self.random.normal() * self.config.noise_mv;
        let sensed_celsius = match self.fault {
            None => celsius,
            Some(SensorFault::Open) => return reference_mv,
            Some(SensorFault::Short) => return 0.0,
            Some(SensorFault::Loose { probability }) => {
                if self.random.chance(probability) {
                    return reference_mv;
                }
                celsius
            }
            Some(SensorFault::SlippedOut { since_ns, time_constant_ns, coupling }) => {
                let passed = now_ns.saturating_sub(since_ns) as f64 / time_constant_ns.max(1) as f64;
                let share = coupling + (1.0 - coupling) * (-passed).exp();
                ambient_celsius + share * (celsius - ambient_celsius)
            }
            Some(SensorFault::Drift { since_ns, kelvin_per_hour }) => {
                celsius + kelvin_per_hour * now_ns.saturating_sub(since_ns) as f64 / 3.6e12
            }
        };
        let ohm = self.config.curve.ohm(sensed_celsius);
        (reference_mv * ohm / (ohm + self.config.pull_up_ohm) + noise_mv).clamp(0.0, reference_mv)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(value: f64, expected: f64, part: f64) -> bool {
        (value / expected - 1.0).abs() < part
    }

    #[test]
    fn beta_meets_its_own_two_points() {
        let curve = Curve::semitec_104gt_2();
        assert!(near(curve.ohm(25.0), 100_000.0, 1e-9));
        // B25/85 means: ln(R25/R85) is B (1/298.15 - 1/358.15).
        assert!(near((100_000.0 / curve.ohm(85.0)).ln(), 4267.0 * (1.0 / 298.15 - 1.0 / 358.15), 1e-9));
    }

    #[test]
    fn three_points_are_met_and_resistance_falls() {
        let points = [(25.0, 100_000.0), (150.0, 1_641.9), (250.0, 226.15)];
        let curve = Curve::three_points(points);
        assert!(points.iter().all(|&(celsius, ohm)| near(curve.ohm(celsius), ohm, 1e-6)));
        assert!((-20..400).all(|celsius| curve.ohm(f64::from(celsius)) > curve.ohm(f64::from(celsius) + 1.0)));
    }

    #[test]
    fn a_table_is_met_and_extrapolates() {
        let beta = Curve::Beta { r25_ohm: 100_000.0, beta_k: 4000.0 };
        let table = Curve::Table([0.0, 50.0, 100.0, 200.0].map(|at| (at, beta.ohm(at))).to_vec());
        for celsius in [-30.0, 0.0, 20.0, 50.0, 75.0, 150.0, 200.0, 260.0] {
            assert!(near(table.ohm(celsius), beta.ohm(celsius), 1e-9), "{celsius}");
        }
        assert_eq!(Curve::Table(vec![(25.0, 5.0)]).ohm(80.0), 5.0);
        assert!(Curve::Table(Vec::new()).ohm(80.0).is_infinite());
    }

    #[test]
    fn known_sensors_agree_with_their_constants() {
        assert!(near(Curve::semitec_104gt_2_points().ohm(25.0), 100_000.0, 0.01));
        let ratio = Curve::semitec_104gt_2_points().ohm(25.0) / Curve::semitec_104gt_2_points().ohm(85.0);
        assert!(near(ratio.ln() / (1.0 / 298.15 - 1.0 / 358.15), 4267.0, 0.01));
        let ratio = Curve::epcos_b57560g104f().ohm(25.0) / Curve::epcos_b57560g104f().ohm(100.0);
        let beta_k = ratio.ln() / (1.0 / 298.15 - 1.0 / 373.15);
        assert!(near(beta_k, 4092.0, 0.005), "{beta_k}");
    }

    #[test]
    fn platinum_has_the_standards_resistances() {
        for (celsius, ohm) in [(-50.0, 803.06), (0.0, 1000.0), (100.0, 1385.06), (500.0, 2809.78)] {
            assert!(near(Curve::pt1000().ohm(celsius), ohm, 1e-4), "{celsius}");
        }
    }

    fn thermistor(noise_mv: f64) -> Thermistor {
        let curve = Curve::epcos_b57560g104f();
        Thermistor::new(ThermistorConfig { curve, pull_up_ohm: 4_700.0, reference_mv: 3_300.0, noise_mv, seed: 4 })
    }

    #[test]
    fn faults_give_the_voltages_of_a_bench() {
        let mut sensor = thermistor(0.0);
        let sound = sensor.millivolts(0, 200.0, 20.0);
        assert!(near(sound, 3_300.0 * 554.0 / 5_254.0, 0.02), "{sound}");
        let cold = sensor.millivolts(0, 20.0, 20.0);
        sensor.set_fault(Some(SensorFault::Open));
        assert_eq!(sensor.millivolts(0, 200.0, 20.0), 3_300.0);
        sensor.set_fault(Some(SensorFault::Short));
        assert_eq!(sensor.millivolts(0, 200.0, 20.0), 0.0);
        let second = 1_000_000_000;
        sensor.set_fault(Some(SensorFault::SlippedOut { since_ns: second, time_constant_ns: second, coupling: 0.0 }));
        assert_eq!(sensor.millivolts(second, 200.0, 20.0), sound);
        assert!(near(sensor.millivolts(30 * second, 200.0, 20.0), cold, 1e-6));
        sensor.set_fault(Some(SensorFault::Drift { since_ns: 0, kelvin_per_hour: -10.0 }));
        let drifted = sensor.millivolts(3_600 * second, 210.0, 20.0);
        assert!(near(drifted, sound, 1e-9));
        sensor.set_fault(Some(SensorFault::Loose { probability: 0.25 }));
        let open = (0..1000).filter(|_| sensor.millivolts(0, 200.0, 20.0) == 3_300.0).count();
        assert!((200..300).contains(&open), "{open}");
    }

    #[test]
    fn noise_has_its_deviation_and_repeats_by_seed() {
        let (mut one, mut same) = (thermistor(2.0), thermistor(2.0));
        let sound = thermistor(0.0).millivolts(0, 200.0, 20.0);
        let off: Vec<f64> = (0..2000).map(|_| one.millivolts(0, 200.0, 20.0) - sound).collect();
        assert!(off.iter().all(|&off| same.millivolts(0, 200.0, 20.0) - sound == off));
        let spread = (off.iter().map(|off| off * off).sum::<f64>() / 2000.0).sqrt();
        assert!((1.8..2.2).contains(&spread), "{spread}");
    }
}
