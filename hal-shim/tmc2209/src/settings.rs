//! A driver's settings, its wiring on a board, and the registers that follow from both.

use core::fmt;

use super::current::{CurrentError, CurrentScale};
use super::registers::{ChopConf, GlobalConf, HoldRun, MicrostepResolution, Register};

/// The largest value of TSTEP and its thresholds, 20 bits (section 5.2).
pub const MAX_THRESHOLD: u32 = 0xf_ffff;

/// The chip's internal clock, Hz (section 14: 12 MHz).
pub const CLOCK_HZ: u32 = 12_000_000;

/// Microsteps of a full step that TSTEP counts in.
pub const TSTEP_MICROSTEPS: u32 = 256;

/// The slowest speed at which a motor's load can be measured, full steps a second: a revolution a
/// second of most motors (section 11.4).
pub const STALL_FULL_STEPS_PER_S: u32 = 200;

/// TCOOLTHRS, the speed below which there is no stall signal: three quarters of
/// [`STALL_FULL_STEPS_PER_S`], so that the chip's clock may be off by some percent.
const STALL_CLOCKS: u32 = CLOCK_HZ / (STALL_FULL_STEPS_PER_S * 3 / 4 * TSTEP_MICROSTEPS);

/// NODECONF: the chip waits 3 times 8 bit times before it replies. Less is not allowed where
/// several share a line (section 5.1), and more only costs time.
const NODE_CONF: u32 = 2 << 8;

/// TPOWERDOWN: 2^18 clocks times this from the last step to the hold current, 0.44 s; the chip's
/// default (section 5.2).
const POWER_DOWN: u32 = 20;

/// Time of each step down to the hold current, 2^18 clocks.
const HOLD_DELAY: u8 = 8;

/// PWMCONF: both automatic tunings on, 2/683 of the clock, and the rest at its reset value
/// (section 5.5.2).
const PWM_CONF: u32 = 0xc10d_0024;

/// The machine's settings for a motor's driver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriverSettings {
    /// Effective current in motion, mA.
    pub current_ma: u16,
    /// Current at standstill in percent of that, 0 to 100.
    pub hold_percent: u8,
    /// Microsteps of a full step: 1, 2, 4 ... 256.
    pub microsteps: u16,
    /// The chip interpolates them to 256 microsteps.
    pub interpolate: bool,
    /// stealthChop; else spreadCycle at all speeds.
    pub stealth_chop: bool,
    /// Speed at which spreadCycle takes over from stealthChop, mm/s; 0: never.
    pub spread_cycle_above_mm_per_s: u16,
    /// The motor's steps for each mm, from which that speed's time between two steps follows: the
    /// profile's, whatever M92 says.
    pub steps_per_mm: f32,
    /// SGTHRS: the stall signal comes when the measured load is at most twice this; 0 = never.
    pub stall_threshold: u8,
    /// Both edges of the step signal step.
    pub both_edges: bool,
}

/// A driver's wiring on a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DriverWiring {
    /// Index of its line.
    pub line: u8,
    /// Address on the line, by the pins MS1 and MS2: 0 to 3.
    pub address: u8,
    /// Sense resistors of the driver, milliohm.
    pub sense_milliohm: u16,
}

impl DriverSettings {
    /// Returns true if spreadCycle has taken over from stealthChop at this speed, mm/s.
    #[must_use]
    pub fn leaves_stealth_chop_at(&self, mm_per_s: f64) -> bool {
        self.spread_cycle_above_mm_per_s != 0 && f64::from(self.spread_cycle_above_mm_per_s) <= mm_per_s
    }

    /// TPWMTHRS: spreadCycle takes over where a microstep of 1/256 takes less than this many clocks
    /// of the chip (section 5.2); 0 = nowhere.
    fn chopper_clocks(&self) -> u32 {
        if self.spread_cycle_above_mm_per_s == 0 {
            return 0;
        }
        let full_steps_per_s =
            f32::from(self.spread_cycle_above_mm_per_s) * self.steps_per_mm / f32::from(self.microsteps);
        let clocks = CLOCK_HZ as f32 / (full_steps_per_s * TSTEP_MICROSTEPS as f32) + 0.5;
        // A conversion saturates.
        (clocks as u32).clamp(1, MAX_THRESHOLD)
    }
}

/// Settings that the chip cannot take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SettingsError {
    /// The current.
    Current(CurrentError),
    /// The microsteps are not 1, 2, 4 ... 256.
    Microsteps(u16),
}

impl fmt::Display for SettingsError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Current(error) => fmt::Display::fmt(error, out),
            Self::Microsteps(microsteps) => {
                write!(out, "{microsteps} microsteps are not possible, expected 1, 2, 4 ... 256")
            }
        }
    }
}

/// All registers that are written, and the currents that they mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RegisterImage {
    /// Registers and values in the order of writing. NODECONF comes first: before it, replies may
    /// disturb others on the line.
    pub writes: [(Register, u32); 10],
    /// Effective current in motion, mA.
    pub run_ma: u16,
    /// Effective current at standstill, mA.
    pub hold_ma: u16,
}

impl RegisterImage {
    /// NODECONF, which every driver on a line must have before any is asked something.
    pub const NODE_CONF: (Register, u32) = (Register::NodeConf, NODE_CONF);

    /// The registers for these settings.
    ///
    /// # Errors
    /// The chip cannot take them.
    pub fn new(settings: &DriverSettings, wiring: &DriverWiring) -> Result<Self, SettingsError> {
        let run = CurrentScale::from_ma(settings.current_ma, wiring.sense_milliohm).map_err(SettingsError::Current)?;
        let hold = run.percent(settings.hold_percent);
        let resolution = MicrostepResolution::from_microsteps(settings.microsteps)
            .ok_or(SettingsError::Microsteps(settings.microsteps))?;
        let global = GlobalConf {
            spread_cycle: !settings.stealth_chop,
            pin_is_serial: true,
            microsteps_by_register: true,
            filter_steps: true,
        };
        // Off time, hysteresis: the chip's own at reset. Blank time: 32 clocks, which section
        // 5.5.1 recommends.
        let chopper = ChopConf {
            off_time: 3,
            hysteresis_start: 5,
            hysteresis_end: 0,
            blank_time: 2,
            high_sensitivity: run.high_sensitivity,
            resolution,
            interpolate: settings.interpolate,
            both_edges: settings.both_edges,
        };
        // A motor that starts has no load to tell, and would seem to stall.
        let stall_until = if settings.stall_threshold == 0 { 0 } else { STALL_CLOCKS };
        let currents = HoldRun { hold: hold.scale, run: run.scale, hold_delay: HOLD_DELAY };
        Ok(Self {
            writes: [
                Self::NODE_CONF,
                (Register::Gconf, global.bits()),
                (Register::IholdIrun, currents.bits()),
                (Register::Tpowerdown, POWER_DOWN),
                (Register::Tpwmthrs, settings.chopper_clocks()),
                (Register::Tcoolthrs, stall_until),
                (Register::Sgthrs, u32::from(settings.stall_threshold)),
                // No current by load: it is for machines that run on batteries.
                (Register::CoolConf, 0),
                (Register::PwmConf, PWM_CONF),
                (Register::ChopConf, chopper.bits()),
            ],
            run_ma: run.current_ma(wiring.sense_milliohm),
            hold_ma: hold.current_ma(wiring.sense_milliohm),
        })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    const MINI: DriverSettings = DriverSettings {
        current_ma: 350,
        hold_percent: 100,
        microsteps: 16,
        interpolate: true,
        stealth_chop: true,
        spread_cycle_above_mm_per_s: 0,
        steps_per_mm: 100.0,
        stall_threshold: 0,
        both_edges: false,
    };
    const WIRING: DriverWiring = DriverWiring { line: 0, address: 1, sense_milliohm: 220 };

    fn value(settings: &DriverSettings, register: Register) -> u32 {
        let image = RegisterImage::new(settings, &WIRING).unwrap();
        image.writes.iter().find(|(written, _)| *written == register).unwrap().1
    }

    #[test]
    fn registers_bit_for_bit() {
        assert_eq!(value(&MINI, Register::Gconf), 0b1_1100_0000);
        assert_eq!(value(&MINI, Register::IholdIrun), 8 << 16 | 20 << 8 | 20);
        // intpol, MRES = 4, vsense, TBL = 2, HSTRT = 5, TOFF = 3.
        assert_eq!(value(&MINI, Register::ChopConf), 0x1403_0053);
        assert_eq!(value(&MINI, Register::Tcoolthrs), 0);
        let other = DriverSettings {
            stealth_chop: false,
            microsteps: 256,
            interpolate: false,
            both_edges: true,
            stall_threshold: 60,
            current_ma: 900,
            hold_percent: 50,
            spread_cycle_above_mm_per_s: 100,
            steps_per_mm: 1600.0,
        };
        assert_eq!(value(&other, Register::Gconf), 0b1_1100_0100);
        assert_eq!(value(&other, Register::ChopConf), 0x2001_0053);
        assert_eq!(value(&other, Register::IholdIrun), 8 << 16 | 29 << 8 | 14);
        assert_eq!(value(&other, Register::Tpwmthrs), 75);
        assert_eq!((value(&other, Register::Tcoolthrs), value(&other, Register::Sgthrs)), (312, 60));
    }

    #[test]
    fn what_the_chip_cannot_do_is_refused() {
        for microsteps in [0, 3, 17, 255, 512] {
            let settings = DriverSettings { microsteps, ..MINI };
            assert_eq!(RegisterImage::new(&settings, &WIRING), Err(SettingsError::Microsteps(microsteps)));
        }
        for power in 0..=8 {
            assert_eq!(MicrostepResolution::from_microsteps(1 << power).unwrap().microsteps(), 1 << power);
        }
        let error = RegisterImage::new(&DriverSettings { current_ma: 1200, ..MINI }, &WIRING).unwrap_err();
        assert_eq!(error.to_string(), "a current of 1200 mA is out of range, expected 17 to 958 mA");
    }

    #[test]
    fn the_speed_of_the_change_is_a_time_of_a_microstep() {
        let clocks = |spread_cycle_above_mm_per_s, steps_per_mm| {
            value(&DriverSettings { spread_cycle_above_mm_per_s, steps_per_mm, ..MINI }, Register::Tpwmthrs)
        };
        // 100 mm/s at 100 steps/mm of 1/16: 160,000 microsteps of 1/256 a second, 75 clocks each.
        assert_eq!(clocks(100, 100.0), 75);
        assert_eq!(clocks(0, 100.0), 0);
        assert_eq!(clocks(1, 0.0), MAX_THRESHOLD);
        assert_eq!(clocks(1, 1e-3), MAX_THRESHOLD);
        assert_eq!(clocks(u16::MAX, 1e9), 1);
    }
}
