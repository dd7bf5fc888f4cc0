//! The motor's current: run, hold, and the scale of the sense resistors (data sheet 8 and 9).

use super::Tmc2209;

/// Unit of TPOWERDOWN and IHOLDDELAY, in clocks (5.2).
const DELAY_CLOCKS: u64 = 1 << 18;
/// Resistance of bond wires and traces in series with a sense resistor, in milliohms (8).
const SERIES_MILLIOHM: u32 = 20;

impl Tmc2209 {
    /// CS_ACTUAL: the effective scale, 0 to 31. After standstill the run current stays for
    /// TPOWERDOWN and then falls to IHOLD by one for each IHOLDDELAY. With GCONF.pdn_disable 0 that
    /// requires a low level at PDN_UART (9).
    pub fn current_scale(&self, now_ns: u64) -> u32 {
        let (run, hold) = (self.registers.irun(), self.registers.ihold());
        if !self.stands_still(now_ns) || (!self.registers.pdn_disable() && self.pdn_level) {
            return run;
        }
        let still_ns = now_ns - self.last_step_ns - self.standstill_after_ns;
        let still_clocks = (u128::from(still_ns) * u128::from(self.config.clock_hz) / 1_000_000_000) as u64;
        let Some(after_clocks) = still_clocks.checked_sub(u64::from(self.registers.tpowerdown) * DELAY_CLOCKS) else {
            return run;
        };
        let one_step_clocks = u64::from(self.registers.ihold_delay()) * DELAY_CLOCKS;
        let steps = after_clocks.checked_div(one_step_clocks).unwrap_or(31).min(31) as u32;
        if hold < run { run.saturating_sub(steps).max(hold) } else { (run + steps).min(hold) }
    }

    /// The phase current in milliamperes RMS at full excitation (8), from scale, VREF and sense
    /// resistors. 0 with the outputs off.
    pub fn current_ma(&self, now_ns: u64) -> u32 {
        if !self.energized {
            return 0;
        }
        let full_scale_mv = if self.registers.vsense() { 180.0 } else { 325.0 };
        let by_vref =
            if self.registers.scales_by_vref() { f64::from(self.config.vref_mv.min(2500)) / 2500.0 } else { 1.0 };
        let ohm = f64::from(self.config.sense_milliohm + SERIES_MILLIOHM) / 1000.0;
        let scale = f64::from(self.current_scale(now_ns) + 1) / 32.0;
        (scale * full_scale_mv * by_vref / ohm / std::f64::consts::SQRT_2).round() as u32
    }
}
