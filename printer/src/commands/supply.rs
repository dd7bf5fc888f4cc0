//! M80 and M81, and the commands that need the power supply.

use ferrostep_gcode::{Command, Decimal, SupplyCommand};
use ferrostep_hal_shim::Heater;
use ferrostep_tmc2209::MOST_MOTORS;

use crate::error::CommandError;
use crate::part::Part;
use crate::ports::{Heating, Ports, Replies};
use crate::printer::Printer;

/// Time from M80 until the supply's voltage counts as steady, ms: an ATX supply reports that within
/// 500 ms (ATX12V Power Supply Design Guide 2.2, 3.3.1).
const POWER_GOOD_MS: u64 = 500;

/// Temperature below which the nozzle no longer needs its fan, degrees Celsius: the hot end's fan
/// switches off there as well.
const COOL_CELSIUS: f32 = 45.0;

/// Mask of all motors.
const ALL_MOTORS: u8 = 0b1111;

impl<P: Ports> Printer<'_, P> {
    /// Returns true if the power supply can be switched.
    pub(crate) fn has_supply(&self) -> bool {
        <P::Heating as Heating>::Supply::PRESENT && self.profile.power_supply.is_some()
    }

    /// Checks that heaters, motors and fans have power.
    ///
    /// # Errors
    /// [`CommandError::SupplyOff`].
    pub(crate) fn supplied(&self) -> Result<(), CommandError> {
        let is_off = self.has_supply() && !self.heating.is_supply_on();
        if is_off { Err(CommandError::SupplyOff) } else { Ok(()) }
    }

    /// Refuses a command that would have no effect while the supply is off. Targets are checked
    /// where they are set.
    // In a future the compiler would keep every value in memory.
    #[inline(never)]
    pub(crate) fn needs_supply(&self, command: &Command<'_>) -> Result<(), CommandError> {
        if !<P::Heating as Heating>::Supply::PRESENT {
            return Ok(());
        }
        match *command {
            Command::Linear { .. }
            | Command::Arc { .. }
            | Command::Retract
            | Command::Recover
            | Command::Home { .. }
            | Command::EnableMotors(_)
            | Command::Autotune { .. }
            | Command::HeaterModel { .. }
            | Command::LoadFilament { .. }
            | Command::SelectTool { tool: Some(1..), .. }
            | Command::Pause(_)
            | Command::ChangeFilament { .. }
            | Command::Fan { power: 1.., .. }
            | Command::NamedFan { power: 1.., .. }
            | Command::SetOutput { power: 1.., .. } => self.supplied(),
            Command::SetLight { colors } if colors != [0; 4] && self.has_light() => self.supplied(),
            Command::Bed(bed) if self.has_bed() && bed.probes() => self.supplied(),
            _ => Ok(()),
        }
    }

    /// Executes M80 and M81, on a machine whose supply can be switched.
    pub(crate) async fn supply(&mut self, command: SupplyCommand) -> Result<(), CommandError> {
        match command {
            SupplyCommand::Report => {
                self.replies.say(format_args!("PS:{}", u8::from(self.heating.is_supply_on())));
                Ok(())
            }
            SupplyCommand::On if self.heating.is_supply_on() => Ok(()),
            SupplyCommand::On => {
                self.heating.set_supply(true);
                self.waits().for_ms(POWER_GOOD_MS).await?;
                self.set_drivers_up_again()
            }
            SupplyCommand::Off { when_cool } => self.supply_off(when_cool).await,
        }
    }

    /// Sets the drivers up again: they lost their settings together with their supply.
    fn set_drivers_up_again(&mut self) -> Result<(), CommandError> {
        let Some(drivers) = self.fitted.drivers else { return Ok(()) };
        for motor in 0..MOST_MOTORS {
            let Some(report) = drivers.report(motor) else { continue };
            drivers.set(motor, report.settings).map_err(|error| CommandError::DriverSettings { motor, error })?;
        }
        Ok(())
    }

    /// Executes M81: motion ends, then heaters, motors and fans go off, and then the supply.
    async fn supply_off(&mut self, when_cool: bool) -> Result<(), CommandError> {
        self.everything_off(when_cool).await?;
        self.heating.set_supply(false);
        Ok(())
    }

    /// Executes M81 except for the supply, which stays on if it cannot be switched.
    pub(crate) async fn everything_off(&mut self, when_cool: bool) -> Result<(), CommandError> {
        if self.is_paused() || self.is_of_other_print() {
            return Err(CommandError::SupplyInUse);
        }
        self.disable_motors(ALL_MOTORS).await?;
        self.nozzles_off()?;
        self.set_temperature(Heater::Bed, 0.0)?;
        self.set_chamber(Decimal::ZERO)?;
        if when_cool {
            // An M108 sent before this command does not end its wait.
            self.signals.take_end_wait();
            self.waits().for_cooling(Heater::Nozzle, COOL_CELSIUS, &self.heating).await?;
        }
        self.commanded_fans_off().await;
        self.keep_statistics();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use core::cell::Cell;

    use ferrostep_tmc2209::{DriverReport, DriverSettings, DriverState, SECOND_EXTRUDER, SettingsError};

    use crate::motion::homing::tests::rig::{Drivers, Rig};
    use crate::ports::MotorDrivers;

    /// Drivers of X, Y, Z, E and T1's motor, and a mask of those that were set.
    #[derive(Debug)]
    struct Noted(Drivers, Cell<u32>);

    impl MotorDrivers for Noted {
        fn state(&self, motor: usize) -> Option<DriverState> {
            self.0.state(motor)
        }
        fn report(&self, motor: usize) -> Option<DriverReport> {
            matches!(motor, 0..=3 | SECOND_EXTRUDER).then(|| self.0.report(motor))?
        }
        fn check(&self, motor: usize, settings: &DriverSettings) -> Result<(), SettingsError> {
            self.0.check(motor, settings)
        }
        fn set(&self, motor: usize, settings: DriverSettings) -> Result<(), SettingsError> {
            self.1.set(self.1.get() | 1 << motor);
            self.0.set(motor, settings)
        }
        fn take_moved(&self) -> u8 {
            0
        }
    }

    #[test]
    fn each_driver_is_set_up_again_also_that_of_a_second_tool() {
        let settings = DriverSettings {
            current_ma: 500,
            hold_percent: 50,
            microsteps: 16,
            interpolate: true,
            stealth_chop: true,
            spread_cycle_above_mm_per_s: 0,
            steps_per_mm: 100.0,
            stall_threshold: 0,
            both_edges: false,
        };
        let (rig, drivers) = (Rig::new(|_| {}), Noted(Drivers(settings), Cell::new(0)));
        let mut printer = rig.printer();
        printer.set_drivers(&drivers);
        printer.set_drivers_up_again().unwrap();
        assert_eq!(drivers.1.get(), 0b1111 | 1 << SECOND_EXTRUDER);
    }
}
