//! M122, M569, M906, M913 and M914. No motor moves or gets current before its driver is set up.

use core::fmt;

use embedded_hal_async::delay::DelayNs;
use ferrostep_gcode::{Command, DriverSetting, DriverWords};
use ferrostep_tmc2209::{
    DriverEvent, DriverReport, DriverSettings, DriverState, MOST_MOTORS, SECOND_EXTRUDER, motor_name,
};

use crate::error::CommandError;
use crate::part::Part;
use crate::ports::{MotorDrivers, Ports, Replies, ToolsPart};
use crate::printer::Printer;

/// Polling interval of a wait for a driver, ms. A set-up takes tenths of a second, and always ends.
const LOOK_MS: u32 = 10;

/// Reports an event of a driver. Returns `true` if a motor with current (mask `motors_on`) may not
/// be where its steps say: the caller must then halt the machine as M112 does and send
/// `Reply::Killed`; all else has been reported.
///
/// Without current only the axis' home is lost. Printers often run without motor supply, so that is
/// only a notice: hosts end a print at each `Error:`.
pub fn tell_driver_event(event: &DriverEvent, motors_on: u8, replies: &(impl Replies + ?Sized)) -> bool {
    let halts = event.stops_motion() && motors_on >> event.axis() & 1 == 1;
    if event.is_notable() {
        replies.say(format_args!("{}{event}", if halts { "Error:" } else { "echo:" }));
    }
    halts
}

impl<P: Ports> Printer<'_, P> {
    /// Waits until all drivers have confirmed their settings. An axis whose driver was reset is
    /// no longer homed.
    pub(crate) async fn drivers_confirmed(&mut self, drivers: &dyn MotorDrivers) -> Result<(), CommandError> {
        let mut waits = true;
        while waits {
            waits = false;
            for motor in 0..MOST_MOTORS {
                match drivers.state(motor) {
                    Some(DriverState::Failed(failure)) => {
                        let error = CommandError::Driver { motor, failure };
                        // Hosts end a print at `Error:`: without motion, heating must not continue.
                        self.replies.say(format_args!("Error:{error}"));
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
        self.interpreter.forget_home(drivers.take_moved());
        Ok(())
    }

    /// Executes the drivers' part of a command, if it has one. Returns `true` if the command
    /// continues once all drivers have confirmed their settings.
    // Not inlined: it would enlarge the future of the waiting commands.
    #[inline(never)]
    pub(crate) fn drivers_part(&self, command: &Command<'_>) -> Result<bool, CommandError> {
        let (code, setting, values, tool) = match *command {
            Command::StealthChop { tool, .. } | Command::Driver(_, DriverWords { tool, .. })
                if self.is_for_no_tool(tool) =>
            {
                return Ok(false);
            }
            // Includes M17: until its driver is set up, a motor has the chip's default current.
            Command::Linear { .. }
            | Command::Arc { .. }
            | Command::Retract
            | Command::Recover
            | Command::Home { .. }
            | Command::SelectTool { tool: Some(1..), .. }
            | Command::Pause(_)
            | Command::ChangeFilament { .. }
            | Command::LoadFilament { .. }
            | Command::ShiftZ { .. }
            | Command::OffsetZ { .. }
            | Command::EnableMotors(_) => return Ok(true),
            Command::Bed(bed) => return Ok(self.has_bed() && bed.probes()),
            Command::ReportDrivers => (122, Shown::All, ALL_MOTORS, None),
            Command::StealthChop { motors, tool, on } => {
                let named = [motors.x, motors.y, motors.z, motors.e];
                let value = named.map(|named| named.then_some(on.map(u16::from)));
                let value = if motors.is_empty() { queried(tool) } else { value };
                (569, Shown::Chopper, value, tool)
            }
            Command::Driver(setting, words) => (setting.code(), Shown::Setting(setting), values(words), words.tool),
            _ => return Ok(false),
        };
        let Some(drivers) = self.fitted.drivers else {
            self.replies.say(format_args!("echo:M{code}: not available, this machine's drivers cannot be set"));
            return Ok(false);
        };
        let changes = values.iter().flatten().any(Option::is_some);
        let extruder = if ToolsPart::<P>::PRESENT { self.extruder_of(tool, changes)? } else { None };
        if changes {
            change(drivers, setting, values, extruder.unwrap_or(FIRST_EXTRUDER), self.replies)?;
        } else {
            for motor in 0..MOST_MOTORS {
                // A setting of Z applies to all its motors.
                let of = if motor == SECOND_EXTRUDER { FIRST_EXTRUDER } else { 2 };
                let is_named = values.get(motor).or(values.get(of)).is_some_and(Option::is_some);
                let is_other =
                    matches!(motor, FIRST_EXTRUDER | SECOND_EXTRUDER) && extruder.is_some_and(|it| it != motor);
                if is_named
                    && !is_other
                    && let Some(report) = drivers.report(motor)
                {
                    setting.say(motor_name(motor), &report, self.replies);
                }
            }
        }
        Ok(changes)
    }

    /// The motor that E means on a machine with several tools: the tool's; `None` means each
    /// extruder's, for a query without T.
    #[inline(never)]
    fn extruder_of(&self, tool: Option<u8>, changes: bool) -> Result<Option<usize>, CommandError> {
        match tool {
            None if !changes => Ok(None),
            tool => Ok(Some(if self.tool(tool)? == 0 { FIRST_EXTRUDER } else { SECOND_EXTRUDER })),
        }
    }
}

/// The setting of a driver that a command shows or changes.
#[derive(Clone, Copy)]
enum Shown {
    All,
    Chopper,
    Setting(DriverSetting),
}

/// Value of each motor: `None` if the command does not name it, otherwise the value to set, or
/// `None` for a query.
type Values = [Option<Option<u16>>; 4];

/// The motor of the first extruder.
const FIRST_EXTRUDER: usize = 3;

const ALL_MOTORS: Values = [Some(None); 4];

/// Values that a command names; a command without words queries all motors, one with T alone that
/// extruder's.
fn values(words: DriverWords) -> Values {
    let all = words.all();
    if all == [None; 4] { queried(words.tool) } else { all.map(|value| value.map(Some)) }
}

/// Motors of a query without motor words.
fn queried(tool: Option<u8>) -> Values {
    if tool.is_some() { [None, None, None, Some(None)] } else { ALL_MOTORS }
}

/// Changes all drivers that the command names, or none. E is `extruder`.
fn change(
    drivers: &dyn MotorDrivers,
    setting: Shown,
    values: Values,
    extruder: usize,
    replies: &(impl Replies + ?Sized),
) -> Result<(), CommandError> {
    for is_set in [false, true] {
        for (motor, value) in [0, 1, 2, extruder].into_iter().zip(&values) {
            let (Some(Some(value)), Some(report)) = (value, drivers.report(motor)) else { continue };
            let mut settings = report.settings;
            match setting {
                Shown::All => {}
                Shown::Chopper => settings.stealth_chop = *value != 0,
                Shown::Setting(DriverSetting::Current) => settings.current_ma = *value,
                Shown::Setting(DriverSetting::SpreadCycleAbove) => settings.spread_cycle_above_mm_per_s = *value,
                Shown::Setting(DriverSetting::StallThreshold) => settings.stall_threshold = (*value).min(255) as u8,
            }
            // The speed has no effect yet while stealthChop is off.
            if is_set
                && matches!(setting, Shown::Setting(DriverSetting::SpreadCycleAbove))
                && *value != 0
                && !settings.stealth_chop
            {
                setting.say(motor_name(motor), &DriverReport { settings, ..report }, replies);
            }
            let outcome = if is_set { drivers.set(motor, settings) } else { drivers.check(motor, &settings) };
            outcome.map_err(|error| CommandError::DriverSettings { motor, error })?;
        }
    }
    Ok(())
}

/// Text on a driver's chopper mode, with the speed from which it changes.
struct Chopper<'a>(&'a DriverSettings);

impl fmt::Display for Chopper<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.0.stealth_chop, self.0.spread_cycle_above_mm_per_s) {
            (true, 0) => out.write_str("stealthChop"),
            (true, above) => write!(out, "stealthChop, spreadCycle above {above} mm/s"),
            (false, 0) => out.write_str("spreadCycle"),
            (false, above) => write!(out, "spreadCycle, with M569 S1 only above {above} mm/s"),
        }
    }
}

impl Shown {
    /// Reports the setting of one driver.
    fn say(self, name: &str, report: &DriverReport, replies: &(impl Replies + ?Sized)) {
        let DriverReport { state, settings, run_ma, hold_ma, status, load, repeated } = report;
        let DriverSettings { current_ma, microsteps, stall_threshold, .. } = settings;
        let chopper = Chopper(settings);
        match self {
            Self::All => {
                let state = match state {
                    DriverState::Unconfirmed => "being set up",
                    DriverState::Confirmed => "confirmed",
                    DriverState::Failed(_) => "failed",
                };
                replies.say(format_args!(
                        "echo:driver {name}: {state}, {run_ma} mA, {hold_ma} mA at rest, {microsteps} microsteps, \
                         {chopper}, stall threshold {stall_threshold}, load {load}, {repeated} datagrams repeated, {status}"
                    ),
                );
            }
            Self::Chopper | Self::Setting(DriverSetting::SpreadCycleAbove) => {
                replies.say(format_args!("echo:driver {name}: {chopper}"))
            }
            Self::Setting(DriverSetting::Current) => {
                replies.say(format_args!("echo:driver {name}: {current_ma} mA ({run_ma} mA, {hold_ma} mA at rest)"));
            }
            Self::Setting(DriverSetting::StallThreshold) => {
                replies.say(format_args!("echo:driver {name}: stall threshold {stall_threshold}, load {load}"));
            }
        }
        if let (Self::All, DriverState::Failed(failure)) = (self, state) {
            replies.say(format_args!("echo:driver {name} {failure}"));
        }
    }
}
