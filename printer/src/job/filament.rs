//! Filament that has run out or does not move.

pub(crate) mod encoder;

use crate::job::debounce::Debounce;
use crate::settings::profile::filament::FilamentSensor;
use crate::signals::Signals;

/// Watches a switch in the filament's path, freed of bounces: a new state counts when it has lasted
/// for the profile's time.
#[derive(Clone, Copy, Debug, Default)]
pub struct FilamentWatch {
    debounce: Debounce,
}

impl FilamentWatch {
    /// The watch before the sensor's first signal: the filament is present.
    pub const fn new() -> Self {
        Self { debounce: Debounce::new() }
    }

    /// Looks at the sensor; to be called several times a second with its present state and a clock
    /// of milliseconds that may wrap.
    pub fn look(&mut self, now_ms: u32, is_missing: bool, sensor: &FilamentSensor, signals: &Signals) {
        if self.debounce.has_settled(now_ms, is_missing, signals.is_filament_missing(), sensor.debounce_ms.into()) {
            signals.set_filament_missing(is_missing);
        }
    }

    /// The same for a switch beside a sensor that sees filament move.
    pub fn look_beside_encoder(&mut self, now_ms: u32, is_missing: bool, switch: &FilamentSensor, signals: &Signals) {
        if self.debounce.has_settled(now_ms, is_missing, signals.is_filament_out(), switch.debounce_ms.into()) {
            signals.set_filament_out(is_missing);
        }
    }
}
