//! M412, and the pause when filament has run out or does not move.

use ferrostep_gcode::{AxisWords, Command, FilamentSensorWords, Real};

use crate::error::CommandError;
use crate::job::command_kind::moves;
use crate::ports::{Heating, Motion, Ports, Replies};
use crate::printer::Printer;
use crate::settings::profile::filament::FilamentSensor;

/// Command that pauses a print whose filament has run out: M600 without words.
pub(crate) static CHANGE_FILAMENT: Command<'static> = Command::ChangeFilament {
    tool: None,
    park: AxisWords { x: None, y: None, z: None, e: None },
    unload: None,
    load: None,
};

/// Returns true if a command extrudes a line, as only prints do. A person who pushes new filament
/// in moves E alone.
pub(crate) fn lays(command: &Command<'_>) -> bool {
    let lays = |axes: &AxisWords| axes.e.is_some() && (axes.x.is_some() || axes.y.is_some());
    match command {
        Command::Linear { axes, .. } | Command::Arc { axes, .. } => lays(axes),
        _ => false,
    }
}

/// Returns true if a print may begin or restart with this command: before it, filament may have
/// been moved by hand.
fn begins(command: &Command<'_>) -> bool {
    matches!(command, Command::Home { .. } | Command::SetNozzle(..) | Command::WaitNozzle(..))
}

impl<P: Ports> Printer<'_, P> {
    /// Returns true if the filament sensor detects movement of filament.
    pub(crate) fn has_encoder(&self) -> bool {
        P::Motion::FOLLOWS_FILAMENT
            && self.profile.filament_sensor.is_some_and(|sensor| sensor.detection_10nm().is_some())
    }

    /// Returns true if a switch accompanies that sensor.
    pub(crate) fn has_filament_switch(&self) -> bool {
        P::Motion::HAS_FILAMENT_SWITCH && self.profile.filament_switch.is_some()
    }

    /// Returns true if one of the sensors reports that filament is missing.
    pub(crate) fn is_filament_missing(&self) -> bool {
        self.signals.is_filament_missing() || self.has_filament_switch() && self.signals.is_filament_out()
    }

    /// M412.
    pub(crate) fn filament_sensor(&mut self, words: FilamentSensorWords) -> Result<(), CommandError> {
        let FilamentSensorWords { on, distance, resets } = words;
        if self.has_encoder() {
            let range_10nm = [FilamentSensor::MIN_DETECTION_10NM, FilamentSensor::MAX_DETECTION_10NM];
            if let Some(length_10nm) = self.length_within_10nm('D', distance, range_10nm)? {
                self.signals.set_filament_detection_10nm(length_10nm as u32);
            }
            if on.is_some() || resets {
                self.signals.count_filament_anew();
            }
        }
        match on {
            Some(false) => self.modes.pauses_at_runout = false,
            _ if self.profile.filament_sensor.is_none() => {
                let text = "echo:no filament sensor: the profile has no filament_sensor";
                self.replies.say(format_args!("{text}"));
            }
            Some(true) => self.modes.pauses_at_runout = true,
            None if words.is_query() => self.report_filament_sensor(),
            None => {}
        }
        Ok(())
    }

    fn report_filament_sensor(&self) {
        let state = if self.modes.pauses_at_runout { "ON" } else { "OFF" };
        let word = |is_missing| if is_missing { "missing" } else { "present" };
        let filament = word(self.signals.is_filament_missing());
        if self.has_encoder() {
            let distance_mm = Real::short(f64::from(self.signals.filament_detection_10nm()) / 1e5, 5);
            let [before, switch] = match () {
                () if self.has_filament_switch() => ["; switch: ", word(self.signals.is_filament_out())],
                () => ["", ""],
            };
            self.replies.say(format_args!(
                "echo:Filament runout {state}; distance: {distance_mm} mm; filament: {filament}{before}{switch}"
            ));
        } else {
            self.replies.say(format_args!("echo:Filament runout {state}; filament: {filament}"));
        }
    }

    /// Restarts an encoder's count at the first extruded line after a print begins, or after it
    /// continues from a pause in which a person has handled the filament.
    pub(crate) fn follow_filament(&mut self, command: &Command<'_>, is_of_print: bool) {
        if !self.has_encoder() {
            return;
        }
        if begins(command) || moves(command) && !is_of_print {
            self.print.lays_lines = false;
        } else if lays(command) && !core::mem::replace(&mut self.print.lays_lines, true) {
            self.signals.count_filament_anew();
        }
    }

    /// Returns true, and reports it, if the filament of a print that extrudes lines has run out or
    /// does not move. As long as it is missing, each line of a print reports it.
    // In a future the compiler would keep every value in memory.
    #[inline(never)]
    pub(crate) fn has_run_out(&self) -> bool {
        let is_out = self.modes.pauses_at_runout && self.is_filament_missing();
        // A real print's nozzle is hot; lines without heat are a rehearsal.
        let is_out = is_out && self.heating.status(self.nozzle()).target_celsius > 0.0;
        if is_out {
            let is_switch = self.has_filament_switch() && self.signals.is_filament_out();
            let what = if self.has_encoder() && !is_switch {
                "The filament does not move, it is jammed or has run out"
            } else {
                "The filament has run out"
            };
            self.replies.say(format_args!("echo:{what}; M412 S0 ignores the sensor"));
        }
        is_out
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
