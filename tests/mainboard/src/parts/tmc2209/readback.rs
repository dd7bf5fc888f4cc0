//! Registers that show the chip's present state.

use super::Tmc2209;
use super::registers::{VERSION, drv_status};

impl Tmc2209 {
    /// IOIN: levels at the pins, and the version (5.1).
    pub(super) fn ioin(&self) -> u32 {
        u32::from(self.enable_not)
            | u32::from(self.config.ms1) << 2
            | u32::from(self.config.ms2) << 3
            | u32::from(self.diag) << 4
            | u32::from(self.pdn_level) << 6
            | u32::from(self.step_level) << 7
            | u32::from(self.config.spread) << 8
            | u32::from(self.direction_level) << 9
            | VERSION << 24
    }

    /// MSCURACT: a sine wave of amplitude 247 for phase A, a quarter ahead for phase B (5.4).
    pub(super) fn mscuract(&self) -> u32 {
        let phase = |offset: u16| {
            let angle = f64::from((self.mscnt + offset) & 1023) + 0.5;
            let wave = 247.5 * (angle * std::f64::consts::TAU / 1024.0).sin();
            (wave.round() as i32).clamp(-247, 247) as u32 & 0x1FF
        };
        phase(0) | phase(256) << 16
    }

    /// DRV_STATUS (5.5.3).
    pub(super) fn drv_status(&self, now_ns: u64) -> u32 {
        let (warning, _) = self.registers.over_temperature_celsius();
        let flag = |present: bool, bit: u32| if present { bit } else { 0 };
        let open_loads = self.faults_present & (drv_status::OLA | drv_status::OLB);
        flag(self.celsius >= warning, drv_status::OTPW)
            | flag(self.over_temperature, drv_status::OT)
            | self.shorts_latched
            | flag(self.energized, open_loads)
            | flag(self.celsius >= 120.0, drv_status::T120)
            | flag(self.celsius >= 143.0, drv_status::T143)
            | flag(self.celsius >= 150.0, drv_status::T150)
            | flag(self.celsius >= 157.0, drv_status::T157)
            | self.current_scale(now_ns) << 16
            | flag(self.stealth_chop(self.tstep_at(now_ns)), drv_status::STEALTH)
            | flag(self.stands_still(now_ns), drv_status::STST)
    }
}
