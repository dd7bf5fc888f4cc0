//! Stall reports of a TMC2209: the virtual board's model of StallGuard4 (data sheet, section 11).
//!
//! A motor that is held back lags behind its steps, and the chip's measure of the load, SG_RESULT,
//! falls from that of free motion to 0 at a full step. The signal comes when it is down to twice
//! SGTHRS, in stealthChop, and only where the chip counts a time between microsteps from TPWMTHRS
//! to TCOOLTHRS: a slow motor does not show its load.

use ferrostep_planner::TICKS_PER_SECOND;

use ferrostep_tmc2209::{CLOCK_HZ, GlobalConf, Register, TSTEP_MICROSTEPS};

/// SG_RESULT of free motion: of the motors and speeds that it is used for some hundred of 510.
const FREE_LOAD: i64 = 400;

/// A rotor that lags by more full steps than these falls back by a period of its windings ...
const HOLDING_STEPS: i64 = 2;
/// ... which is this many full steps.
const PERIOD_STEPS: i64 = 4;

/// A chip's settings, as far as its stall signal depends on them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StallSignal {
    /// The load at which it comes.
    load: i64,
    /// The longest and the shortest time between two microsteps of 1/256 in which it does,
    /// clocks of the chip.
    longest_clocks: u64,
    shortest_clocks: u64,
    /// Microsteps of a full step.
    microsteps: i64,
}

impl StallSignal {
    /// The settings that registers hold; `None` where there is no signal: in spreadCycle,
    /// or at threshold 0.
    pub fn from_registers(register: impl Fn(Register) -> u32) -> Option<Self> {
        let threshold = register(Register::Sgthrs) & 0xff;
        let spread_cycle = register(Register::Gconf) & GlobalConf::SPREAD_CYCLE != 0;
        if threshold == 0 || spread_cycle {
            return None;
        }
        let resolution = register(Register::ChopConf) >> 24 & 0xf;
        Some(Self {
            load: i64::from(threshold) * 2,
            longest_clocks: register(Register::Tcoolthrs).into(),
            shortest_clocks: register(Register::Tpwmthrs).into(),
            microsteps: 256 >> resolution.min(8),
        })
    }

    /// True if the signal is there when the motor lags by `lag_steps` and its last step has taken
    /// `interval_ticks`.
    pub fn is_there(&self, lag_steps: i64, interval_ticks: u64) -> bool {
        let microsteps = self.microsteps.cast_unsigned();
        let clocks = interval_ticks.saturating_mul(u64::from(CLOCK_HZ) * microsteps)
            / (u64::from(TICKS_PER_SECOND) * u64::from(TSTEP_MICROSTEPS));
        if clocks > self.longest_clocks || clocks < self.shortest_clocks {
            return false;
        }
        let held = lag_steps.clamp(0, self.microsteps);
        FREE_LOAD - FREE_LOAD * held / self.microsteps <= self.load
    }

    /// Steps by which a rotor falls back that lags by `lag_steps`.
    pub fn falls_back(&self, lag_steps: i64) -> i64 {
        if lag_steps < self.microsteps * HOLDING_STEPS { 0 } else { self.microsteps * PERIOD_STEPS }
    }
}
