//! Heaters: range, control, and when one counts as failed.

use ferrostep_hal_shim::SpareConnector;
use ferrostep_thermistor::Thermistor;
use ferrostep_virtual_board::HeatedMass;

use crate::heat::gains::PidGains;

/// Default for the seconds without use after which heaters go off: Prusa's
/// (`SafetyTimer`, 30 minutes).
pub const DEFAULT_HEATER_TIMEOUT_S: u16 = 1800;

/// Limits at which a heater that should heat counts as failed ([`crate::heat::safety`]). The
/// defaults are Marlin's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeaterWatch {
    /// While it heats up, the temperature must rise within this time, milliseconds ...
    pub watch_ms: u32,
    /// ... by this much, degrees.
    pub watch_celsius: f32,
    /// Longest time, once the heater has reached its target, milliseconds ...
    pub runaway_ms: u32,
    /// ... for which the temperature may be farther below the target than this, degrees. Near the
    /// room's temperature less is allowed ([`crate::heat::safety`]).
    pub runaway_celsius: f32,
}

impl HeaterWatch {
    /// The nozzle's defaults.
    pub const NOZZLE: Self = Self { watch_ms: 20_000, watch_celsius: 2.0, runaway_ms: 40_000, runaway_celsius: 4.0 };
    /// The bed's defaults.
    pub const BED: Self = Self { watch_ms: 60_000, watch_celsius: 2.0, runaway_ms: 20_000, runaway_celsius: 2.0 };
    /// The chamber's defaults: it warms slowly, and a door may be opened for a moment.
    pub const CHAMBER: Self =
        Self { watch_ms: 300_000, watch_celsius: 2.0, runaway_ms: 300_000, runaway_celsius: 10.0 };
}

/// Range and control of a heater; temperatures in degrees Celsius, powers from 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeaterSettings {
    /// Thermistor of the heater.
    pub thermistor: Thermistor,
    /// Below this all heaters are switched off.
    pub min_celsius: f32,
    /// Temperature at or above which all heaters are switched off.
    pub max_celsius: f32,
    /// Higher targets are refused, and so is [`Self::max_celsius`].
    pub max_target_celsius: f32,
    /// Limits at which it counts as failed.
    pub watch: HeaterWatch,
    /// Gains of its control loop.
    pub gains: PidGains,
    /// M109 and M190 wait until the temperature stays this near the target, degrees.
    pub residency_window_celsius: f32,
    /// ... for this long, milliseconds.
    pub residency_ms: u32,
    /// The model of it on the virtual board; control and checks do not use it.
    pub mass: HeatedMass,
    /// True if it has a heater, and not only a thermometer.
    pub is_heated: bool,
    /// True if others heat it as well: without power it may become hotter, and stay hot.
    pub is_warmed_by_others: bool,
}

/// The chamber around the printer: its thermometer, and its heater if it has one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChamberSettings {
    /// The board's input for the thermometer.
    pub thermistor: SpareConnector,
    /// The board's output for the heater.
    pub heater: Option<SpareConnector>,
    /// Range and control.
    pub settings: HeaterSettings,
}
