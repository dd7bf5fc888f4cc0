//! Supply rails: their voltage under load, when they are cut, and when they return.
//!
//! | what | test |
//! |---|---|
//! | cut and return with time constants, instants of crossing a threshold | `a_cut_*`, `a_restored_*` |
//! | sag by load through the supply's resistance | `load_*` |
//! | heaters' power by voltage, drivers' supply with hysteresis | `load_*`, `a_sag_*` |
//!
//! Left out: ripple; the duration of a sag's edge (it is immediate); coupling of rails (cut both,
//! with their own times).

/// The properties of a rail.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Config {
    /// Nominal voltage in millivolts.
    pub nominal_mv: f64,
    /// Time constant after a cut, in ns: capacitors over load.
    pub fall_ns: u64,
    /// Time constant of the return, in ns.
    pub rise_ns: u64,
    /// Resistance of supply and cables in milliohms.
    pub resistance_milliohm: f64,
    /// Falling voltage at which the supplied parts switch off, in millivolts.
    pub off_below_mv: f64,
    /// Rising voltage at which they switch on again, in millivolts.
    pub on_above_mv: f64,
}

impl Config {
    /// A 24 V rail for motors and heaters. A TMC2209 works from 4.75 V and locks out below some 4 V
    /// (data sheet 20, operating range).
    pub fn motors_24_v() -> Self {
        Self {
            nominal_mv: 24_000.0,
            fall_ns: 20_000_000,
            rise_ns: 5_000_000,
            resistance_milliohm: 50.0,
            off_below_mv: 4_000.0,
            on_above_mv: 4_500.0,
        }
    }

    /// A 3.3 V rail for the chip, with the power-down reset at 1.68 and 1.72 V (STM32F4 data sheet,
    /// embedded reset block).
    pub fn chip_3_3_v() -> Self {
        Self {
            nominal_mv: 3_300.0,
            fall_ns: 10_000_000,
            rise_ns: 1_000_000,
            resistance_milliohm: 0.0,
            off_below_mv: 1_680.0,
            on_above_mv: 1_720.0,
        }
    }
}

/// The rail.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Rail {
    config: Config,
    /// The final voltage of the source.
    target_mv: f64,
    source_mv: f64,
    at_ns: u64,
    load_ma: f64,
    on: bool,
}

impl Rail {
    /// A rail at its nominal voltage.
    pub fn new(config: Config) -> Self {
        let (target_mv, source_mv) = (config.nominal_mv, config.nominal_mv);
        Self { config, target_mv, source_mv, at_ns: 0, load_ma: 0.0, on: true }
    }

    /// A rail that is off, without voltage.
    pub fn off(config: Config) -> Self {
        Self { target_mv: 0.0, source_mv: 0.0, on: false, ..Self::new(config) }
    }

    /// Cuts the rail: it falls to 0 with its time constant.
    pub fn cut(&mut self, now_ns: u64) {
        self.aim(now_ns, 0.0);
    }

    /// Restores the nominal voltage.
    pub fn restore(&mut self, now_ns: u64) {
        self.aim(now_ns, self.config.nominal_mv);
    }

    /// Sets another final voltage in millivolts: a brown-out, a weak source.
    pub fn aim(&mut self, now_ns: u64, target_mv: f64) {
        self.advance(now_ns);
        self.target_mv = target_mv.max(0.0);
    }

    /// Sets the load current in milliamperes.
    pub fn set_load(&mut self, now_ns: u64, load_ma: f64) {
        self.advance(now_ns);
        self.load_ma = load_ma.max(0.0);
        self.switch();
    }

    /// The voltage at this time, in millivolts.
    pub fn millivolts(&self, now_ns: u64) -> f64 {
        let source_mv = self.source_at(now_ns.saturating_sub(self.at_ns));
        (source_mv - self.sag_mv()).max(0.0)
    }

    /// True if the supplied parts work: off below one threshold, on again above the other.
    pub fn on(&self) -> bool {
        self.on
    }

    /// A heater's power relative to nominal: the square of the relative voltage.
    pub fn power_scale(&self, now_ns: u64) -> f64 {
        (self.millivolts(now_ns) / self.config.nominal_mv.max(1e-9)).powi(2)
    }

    /// Advances to `now_ns`; true if [`Rail::on`] changed.
    pub fn advance(&mut self, now_ns: u64) -> bool {
        if now_ns > self.at_ns {
            self.source_mv = self.source_at(now_ns - self.at_ns);
            self.at_ns = now_ns;
        }
        self.switch()
    }

    /// The next change of [`Rail::on`], ns; `None` without one.
    pub fn next_event_ns(&self) -> Option<u64> {
        let threshold_mv = if self.on { self.config.off_below_mv } else { self.config.on_above_mv } + self.sag_mv();
        let crosses = if self.on { self.target_mv < threshold_mv } else { self.target_mv > threshold_mv };
        if !crosses {
            return None;
        }
        // source = target + (now - target) exp(-t / constant), solved for t.
        let ratio = (self.source_mv - self.target_mv) / (threshold_mv - self.target_mv);
        let passed_ns = ratio.max(1.0).ln() * self.constant_ns();
        // A nanosecond more, so that the voltage is certainly beyond the threshold.
        Some(self.at_ns + passed_ns.ceil() as u64 + 1)
    }

    fn switch(&mut self) -> bool {
        let now_mv = self.millivolts(self.at_ns);
        let on = if self.on { now_mv >= self.config.off_below_mv } else { now_mv > self.config.on_above_mv };
        let changed = on != self.on;
        self.on = on;
        changed
    }

    fn sag_mv(&self) -> f64 {
        self.load_ma * self.config.resistance_milliohm / 1000.0
    }

    fn constant_ns(&self) -> f64 {
        let ns = if self.target_mv < self.source_mv { self.config.fall_ns } else { self.config.rise_ns };
        ns.max(1) as f64
    }

    fn source_at(&self, passed_ns: u64) -> f64 {
        self.target_mv + (self.source_mv - self.target_mv) * (-(passed_ns as f64) / self.constant_ns()).exp()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn a_cut_rail_falls_with_its_time_constant_and_switches_off_at_its_threshold() {
        let mut rail = Rail::new(Config::motors_24_v());
        assert_eq!((rail.next_event_ns(), rail.millivolts(5)), (None, 24_000.0));
        rail.cut(1_000);
        assert!((rail.millivolts(20_001_000) - 24_000.0 / std::f64::consts::E).abs() < 0.01);
        let off_ns = rail.next_event_ns().unwrap();
        // ln 6 time constants.
        assert!(off_ns.abs_diff(1_000 + 35_835_189) <= 3, "{off_ns}");
        assert!(!rail.advance(off_ns - 10) && rail.on());
        assert!(rail.advance(off_ns) && !rail.on() && rail.next_event_ns().is_none());
    }

    #[test]
    fn a_restored_rail_switches_on_above_its_upper_threshold() {
        let mut rail = Rail::new(Config::motors_24_v());
        rail.cut(0);
        rail.advance(1_000_000_000);
        rail.restore(1_000_000_000);
        let on_ns = rail.next_event_ns().unwrap();
        assert!(!rail.advance(on_ns - 10) && !rail.on());
        assert!(rail.advance(on_ns) && rail.on() && rail.millivolts(on_ns) > 4_500.0);
        assert!((rail.millivolts(2_000_000_000) - 24_000.0).abs() < 1e-6);
    }

    #[test]
    fn load_makes_a_rail_sag_and_heaters_lose_power_by_the_square() {
        let mut rail = Rail::new(Config::motors_24_v());
        rail.set_load(0, 24_000.0);
        assert!((rail.millivolts(0) - 22_800.0).abs() < 1e-9);
        assert!((rail.power_scale(0) - 0.9025).abs() < 1e-9);
    }

    #[test]
    fn a_sag_switches_drivers_off() {
        let mut rail = Rail::new(Config::motors_24_v());
        rail.aim(0, 5_000.0);
        rail.advance(1_000_000_000);
        assert!(rail.on());
        rail.set_load(1_000_000_000, 21_000.0);
        assert!(!rail.on());
        // 4.4 V is between the thresholds: the rail stays off.
        rail.set_load(1_000_000_000, 12_000.0);
        assert!(!rail.on() && rail.next_event_ns().is_none());
    }

    #[test]
    fn a_brown_out_of_the_chip_lowers_its_voltage() {
        let mut rail = Rail::new(Config::chip_3_3_v());
        rail.aim(0, 2_000.0);
        assert!((rail.millivolts(1_000_000_000) - 2_000.0).abs() < 1e-6);
        assert_eq!(rail.next_event_ns(), None);
    }
}
