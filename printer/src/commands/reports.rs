//! Reports that a host requests: M114, M115, M117 to M119, M73 and M798.

use ferrostep_gcode::{EndStopState, FirmwareInfo, Position, Reply};

use crate::ports::{Heating, Motion, Ports, Replies};
use crate::printer::Printer;
use crate::settings::profile::homing::{HomeEnd, HomeSensor};

impl<P: Ports> Printer<'_, P> {
    pub(crate) fn position(&self) -> Position {
        let [x, y, z, _] = self.motion.motor_steps();
        Position {
            logical_10nm: self.interpreter.modal.logical_10nm(),
            motor_steps: [x, y, z],
            motor_names: self.profile.kinematics.motor_names(),
        }
    }

    /// Reports M115.
    pub(crate) fn report_firmware(&self) {
        self.replies.send(Reply::Firmware(FirmwareInfo {
            version: self.identity.version,
            source_code_url: env!("CARGO_PKG_REPOSITORY"),
            identifier: self.identity.identifier,
            machine: self.profile.name,
            kinematics: self.profile.kinematics.reported_name(),
            extruders: self.count_tools(),
            lower_end_10nm: self.profile.lower_end_10nm,
            size_10nm: self.profile.size_10nm,
            emergency_parser: self.identity.emergency_parser,
            meatpack: self.identity.meatpack,
            thermal_protection: self.fitted.equipment.heaters,
            z_probe: self.profile.homing[2].sensor == HomeSensor::Probe,
            card: self.print.card.is_there(),
            stores_settings: self.fitted.settings_memory.is_some(),
            filament_sensor: self.profile.filament_sensor.is_some(),
            power_supply: self.has_supply(),
            chamber: self.heating.chamber_is_heated().is_some(),
        }));
    }

    /// Executes M798. Switching it on clears the values, so that a report covers one measurement
    /// only.
    pub(crate) fn timing(&self, on: Option<bool>, clear: bool) {
        let Some(timing) = self.fitted.timing else {
            return self.replies.send(Reply::Text("echo:timing: this machine has no timer"));
        };
        if on == Some(false) {
            timing.switch(false);
        }
        if clear || on == Some(true) {
            timing.clear();
        }
        if on == Some(true) {
            timing.switch(true);
        }
        if on.is_none() && !clear {
            timing.figures().into_iter().for_each(|figures| self.replies.send(Reply::Timing(figures)));
        }
    }

    /// Reports M119.
    pub(crate) fn report_end_stops(&self) {
        const NAMES: [[&str; 2]; 3] = [["x_min", "x_max"], ["y_min", "y_max"], ["z_min", "z_max"]];
        // Marlin's meaning: filament triggers the sensor.
        let filament = EndStopState { name: "filament", triggered: !self.is_filament_missing() };
        let mut states = [filament; 4];
        for (axis, state) in states.iter_mut().take(3).enumerate() {
            let homing = &self.profile.homing[axis];
            let name = match homing.sensor {
                HomeSensor::Probe => "z_probe",
                HomeSensor::EndStop | HomeSensor::Stall => NAMES[axis][usize::from(homing.end == HomeEnd::Max)],
            };
            *state = EndStopState { name, triggered: self.motion.is_end_stop_triggered(axis) };
        }
        let shown = if self.profile.filament_sensor.is_some() { 4 } else { 3 };
        self.replies.send(Reply::EndStops(states.get(..shown).unwrap_or_default()));
    }

    /// Executes M117: without a display the host shows the text. The text of a file on the desk is
    /// not reported.
    pub(crate) fn display(&self, text: &str) {
        if self.has_host() && !text.is_empty() {
            self.replies.say(format_args!("//action:notification {text}"));
        }
    }

    /// Executes M73; without words, a query.
    pub(crate) fn progress(&mut self, percent: Option<u8>, minutes_left: Option<u16>) {
        let (percent_before, minutes_before) = self.print.progress;
        self.print.progress = (percent.or(percent_before), minutes_left.or(minutes_before));
        let (percent, minutes_left) = self.print.progress;
        if self.has_host() {
            self.replies.send(Reply::Progress { percent, minutes_left });
        }
    }

    /// Executes SET_PRINT_STATS_INFO, like [`Self::display`].
    pub(crate) fn layer(&self, current: Option<u32>, total: Option<u32>) {
        if !self.has_host() {
            return;
        }
        match (current, total) {
            (Some(current), Some(total)) => {
                self.replies.say(format_args!("//action:notification Layer {current}/{total}"))
            }
            (Some(current), None) => self.replies.say(format_args!("//action:notification Layer {current}")),
            (None, Some(total)) => self.replies.say(format_args!("//action:notification {total} layers")),
            (None, None) => {}
        }
    }

    /// Executes M118.
    pub(crate) fn echo(&self, echo_prefix: bool, action_prefix: bool, text: &str) {
        let prefix = match (echo_prefix, action_prefix) {
            (true, _) => "echo:",
            (false, true) => "//",
            (false, false) => "",
        };
        self.replies.say(format_args!("{prefix}{text}"));
    }
}
