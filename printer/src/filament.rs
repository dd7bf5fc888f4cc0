//! M412, and the pause when the filament has run out.

use ferrostep_gcode::{AxisWords, Command};
use ferrostep_hal_shim::Heater;

use crate::ports::{Heating, Ports, Replies};
use crate::printer::Printer;
use crate::profile::FilamentSensor;
use crate::signals::Signals;

/// Watches a filament sensor, freed of bounces: a new state counts when it has lasted for the profile's time.
#[derive(Clone, Copy, Debug, Default)]
pub struct FilamentWatch {
    /// When the sensor began to say something else than what counts, ms.
    since_ms: Option<u32>,
}

impl FilamentWatch {
    /// The sensor has said nothing yet: the filament is there.
    pub const fn new() -> Self {
        Self { since_ms: None }
    }

    /// To be called several times a second with what the sensor says now and a clock of milliseconds that may wrap.
    pub fn look(&mut self, now_ms: u32, is_missing: bool, sensor: &FilamentSensor, signals: &Signals) {
        if is_missing == signals.is_filament_missing() {
            self.since_ms = None;
        } else if now_ms.wrapping_sub(*self.since_ms.get_or_insert(now_ms)) >= u32::from(sensor.debounce_ms) {
            signals.set_filament_missing(is_missing);
            self.since_ms = None;
        }
    }
}

/// What a print does when its filament has run out: M600 without words.
pub(crate) static CHANGE_FILAMENT: Command<'static> =
    Command::ChangeFilament { park: AxisWords { x: None, y: None, z: None, e: None }, unload: None, load: None };

/// Whether a command lays a line, as only prints do. A person who pushes new filament in moves E alone.
pub(crate) fn lays(command: &Command<'_>) -> bool {
    let lays = |axes: &AxisWords| axes.e.is_some() && (axes.x.is_some() || axes.y.is_some());
    match command {
        Command::Linear { axes, .. } | Command::Arc { axes, .. } => lays(axes),
        _ => false,
    }
}

impl<P: Ports> Printer<'_, P> {
    /// M412.
    pub(crate) fn filament_sensor(&mut self, on: Option<bool>) {
        match on {
            Some(false) => self.pauses_at_runout = false,
            _ if self.profile.filament_sensor.is_none() => {
                let text = "echo:no filament sensor: the profile has no filament_sensor";
                self.replies.say(format_args!("{text}"));
            }
            Some(true) => self.pauses_at_runout = true,
            None => {
                let state = if self.pauses_at_runout { "ON" } else { "OFF" };
                let filament = if self.signals.is_filament_missing() { "missing" } else { "present" };
                self.replies.say(format_args!("echo:Filament runout {state}; filament: {filament}"));
            }
        }
    }

    /// Whether the filament of a print that lays lines has run out, which is reported then. As long as it is missing, each line of a print
    /// says so.
    // In a future the compiler would keep every value in memory.
    #[inline(never)]
    pub(crate) fn has_run_out(&self) -> bool {
        let is_out = self.pauses_at_runout && self.signals.is_filament_missing();
        // A print's nozzle is hot; lines without heat are a rehearsal.
        let is_out = is_out && self.heating.status(Heater::Nozzle).target_celsius > 0.0;
        if is_out {
            self.replies.say(format_args!("echo:The filament has run out; M412 S0 ignores the sensor"));
        }
        is_out
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
