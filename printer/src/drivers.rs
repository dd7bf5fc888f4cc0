//! M122, M569, M906 and M914, and what may move before the drivers are set up: nothing.

use core::fmt::{Arguments, write};

use embedded_hal_async::delay::DelayNs;
use ferrostep_gcode::{AxisFlags, DriverWords, Reply};
use ferrostep_hal_shim::Clock;
use ferrostep_hal_shim::tmc2209::{DriverEvent, DriverReport, DriverSettings, DriverState};
use ferrostep_planner::Kinematics;

use crate::AXIS_NAMES;
use crate::error::CommandError;
use crate::ports::{Heating, Motion, MotorDrivers, Replies};
use crate::printer::{Printer, Text};

/// How often a wait for a driver looks. A set-up takes tenths of a second, and always ends.
const LOOK_MS: u32 = 10;

/// Motors A and B of a CoreXY machine: each of them moves both axes.
const PLANE: u8 = 0b11;

/// Tells what has happened to a driver. `true`: a motor with current (`motors_on` is their mask) may not be where its
/// steps say, so that who calls must halt the machine as M112 does; the host has been told, but for
/// [`Reply::Killed`].
///
/// Without current nothing is lost but the axis' home, and printers are often without motor supply: then it is only a
/// notice, for hosts end a print at each `Error:`.
pub fn tell_driver_event(event: &DriverEvent, motors_on: u8, replies: &impl Replies) -> bool {
    let halts = event.stops_motion() && motors_on >> event.motor & 1 == 1;
    if event.is_notable() {
        say(replies, format_args!("{}{event}", if halts { "Error:" } else { "echo:" }));
    }
    halts
}

/// A line of text; one that is too long is cut.
fn say(replies: &impl Replies, line: Arguments<'_>) {
    let mut text = Text::new();
    let _ = write(&mut text, line);
    replies.send(Reply::Text(&text));
}

/// What a motor's driver is called in a line.
fn name(motor: usize) -> char {
    AXIS_NAMES.get(motor).copied().unwrap_or('?')
}

const fn chopper(settings: &DriverSettings) -> &'static str {
    if settings.stealth_chop { "stealthChop" } else { "spreadCycle" }
}

impl<M: Motion, H: Heating, T: Clock + DelayNs + Clone, R: Replies> Printer<'_, M, H, T, R> {
    /// Waits until all drivers have confirmed their settings. An axis whose driver was reset is no longer homed.
    pub(crate) async fn drivers_confirmed(&mut self, drivers: &dyn MotorDrivers) -> Result<(), CommandError> {
        let mut waits = true;
        while waits {
            waits = false;
            for motor in 0..AXIS_NAMES.len() {
                match drivers.state(motor) {
                    Some(DriverState::Failed(failure)) => {
                        let error = CommandError::Driver { motor, failure };
                        // A print that cannot move shall not go on with its heat: hosts end it at this word.
                        say(self.replies, format_args!("Error:{error}"));
                        return Err(error);
                    }
                    Some(DriverState::Unconfirmed) => waits = true,
                    Some(DriverState::Confirmed) | None => {}
                }
            }
            if waits {
                self.clock.delay_ms(LOOK_MS).await;
                if self.signals.is_halted() {
                    return Err(CommandError::Halted);
                }
            }
        }
        let mut moved = drivers.take_moved();
        if self.profile.kinematics == Kinematics::CoreXy && moved & PLANE != 0 {
            moved |= PLANE;
        }
        for (axis, homed) in self.modal.homed.iter_mut().enumerate() {
            *homed &= moved >> axis & 1 == 0;
        }
        Ok(())
    }

    /// The drivers, or the answer that there are none.
    fn drivers_or_say<'a>(&self, command: &str) -> Option<&'a dyn MotorDrivers>
    where
        Self: 'a,
    {
        if self.drivers.is_none() {
            say(self.replies, format_args!("echo:{command}: not available, this machine's drivers cannot be set"));
        }
        self.drivers
    }

    /// A line for each motor in the mask whose driver can be set.
    fn say_of_each(&self, drivers: &dyn MotorDrivers, mut line: impl FnMut(char, &DriverReport, &R)) {
        for motor in 0..AXIS_NAMES.len() {
            if let Some(report) = drivers.report(motor) {
                line(name(motor), &report, self.replies);
            }
        }
    }

    /// Changes the settings of some drivers, of all or of none, and waits until they have confirmed it.
    async fn change_drivers(
        &mut self,
        drivers: &dyn MotorDrivers,
        change: impl Fn(usize, &mut DriverSettings) -> bool,
    ) -> Result<(), CommandError> {
        let changed = |motor| {
            let mut settings = drivers.report(motor)?.settings;
            change(motor, &mut settings).then_some(settings)
        };
        for motor in 0..AXIS_NAMES.len() {
            if let Some(settings) = changed(motor) {
                drivers.check(motor, &settings).map_err(|error| CommandError::DriverSettings { motor, error })?;
            }
        }
        for motor in 0..AXIS_NAMES.len() {
            if let Some(settings) = changed(motor) {
                drivers.set(motor, settings).map_err(|error| CommandError::DriverSettings { motor, error })?;
            }
        }
        self.drivers_confirmed(drivers).await
    }

    /// M122.
    pub(crate) fn report_drivers(&self) {
        let Some(drivers) = self.drivers_or_say("M122") else { return };
        self.say_of_each(drivers, |name, report, replies| {
            let state = match report.state {
                DriverState::Unconfirmed => "being set up",
                DriverState::Confirmed => "confirmed",
                DriverState::Failed(_) => "failed",
            };
            let DriverReport { settings, run_ma, hold_ma, load, repeated, status, .. } = report;
            let (microsteps, chopper) = (settings.microsteps, chopper(settings));
            let threshold = settings.stall_threshold;
            say(
                replies,
                format_args!(
                    "echo:driver {name}: {state}, {run_ma} mA, {hold_ma} mA at rest, {microsteps} microsteps, {chopper}, \
                     stall threshold {threshold}, load {load}, {repeated} datagrams repeated, {status}"
                ),
            );
            if let DriverState::Failed(failure) = report.state {
                say(replies, format_args!("echo:driver {name} {failure}"));
            }
        });
    }

    /// M569.
    pub(crate) async fn stealth_chop(&mut self, motors: AxisFlags, on: Option<bool>) -> Result<(), CommandError> {
        let Some(drivers) = self.drivers_or_say("M569") else { return Ok(()) };
        let named = [motors.x, motors.y, motors.z, motors.e];
        let Some(on) = on else {
            self.say_of_each(drivers, |name, report, replies| {
                let is_named = AXIS_NAMES.iter().zip(named).any(|(axis, named)| *axis == name && named);
                if motors.is_empty() || is_named {
                    say(replies, format_args!("echo:driver {name}: {}", chopper(&report.settings)));
                }
            });
            return Ok(());
        };
        let change = |motor: usize, settings: &mut DriverSettings| {
            settings.stealth_chop = on;
            named.get(motor) == Some(&true)
        };
        self.change_drivers(drivers, change).await
    }

    /// M906.
    pub(crate) async fn driver_current(&mut self, words: DriverWords) -> Result<(), CommandError> {
        let Some(drivers) = self.drivers_or_say("M906") else { return Ok(()) };
        if words == DriverWords::default() {
            self.say_of_each(drivers, |name, report, replies| {
                let DriverReport { settings, run_ma, hold_ma, .. } = report;
                let current_ma = settings.current_ma;
                say(replies, format_args!("echo:driver {name}: {current_ma} mA ({run_ma} mA, {hold_ma} mA at rest)"));
            });
            return Ok(());
        }
        let change = |motor: usize, settings: &mut DriverSettings| match words.all().get(motor) {
            Some(Some(current_ma)) => {
                settings.current_ma = *current_ma;
                true
            }
            _ => false,
        };
        self.change_drivers(drivers, change).await
    }

    /// M914.
    pub(crate) async fn stall_threshold(&mut self, words: DriverWords) -> Result<(), CommandError> {
        let Some(drivers) = self.drivers_or_say("M914") else { return Ok(()) };
        if words == DriverWords::default() {
            self.say_of_each(drivers, |name, report, replies| {
                let threshold = report.settings.stall_threshold;
                say(replies, format_args!("echo:driver {name}: stall threshold {threshold}, load {}", report.load));
            });
            return Ok(());
        }
        let change = |motor: usize, settings: &mut DriverSettings| match words.all().get(motor) {
            Some(Some(threshold)) => {
                settings.stall_threshold = (*threshold).min(255) as u8;
                true
            }
            _ => false,
        };
        self.change_drivers(drivers, change).await
    }
}
