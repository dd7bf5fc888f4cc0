//! M104, M109, M140, M141, M190 and M191.

use ferrostep_gcode::{Decimal, Real, Reply, WaitTarget};
use ferrostep_hal_shim::Heater;

use crate::commands::waits::{Until, WaitReport};
use crate::error::CommandError;
use crate::ports::{Heating, Motion, Ports, Replies, temperatures};
use crate::printer::Printer;
use crate::settings::profile::heaters::HeaterSettings;

impl<'a, P: Ports> Printer<'a, P> {
    /// The settings of a heater.
    ///
    /// # Errors
    /// The machine has no such heater.
    pub(crate) fn heater_settings(&self, heater: Heater) -> Result<&'a HeaterSettings, CommandError> {
        self.profile.heater(heater).ok_or(CommandError::NotEquipped(heater.name()))
    }

    /// Executes M104, M140 and M141.
    pub(crate) fn set_temperature(&mut self, heater: Heater, celsius: f64) -> Result<(), CommandError> {
        let settings = self.heater_settings(heater)?;
        // In the precision of the control: rounding must not raise it to the maximum.
        let target = celsius as f32;
        if target >= settings.max_celsius || target > settings.max_target_celsius {
            // At the maximum the heater is switched off, so a target must be below it; the
            // profile's largest target itself is allowed.
            let below = settings.max_target_celsius >= settings.max_celsius;
            return Err(CommandError::TooHot { celsius, maximum_celsius: settings.max_target_celsius, below });
        }
        self.needs(self.fitted.equipment.heaters || celsius <= 0.0, "heaters")?;
        if celsius > 0.0 {
            self.supplied()?;
        }
        self.see_heat();
        self.heating.set_target(heater, target);
        self.modes.targets_celsius[heater.index()] = target;
        self.target_is_set();
        Ok(())
    }

    /// Returns true if the machine measures its chamber's temperature.
    pub(crate) fn has_chamber(&self) -> bool {
        self.heating.chamber_is_heated().is_some()
    }

    /// Executes M141. Without a chamber the line only gets its remark.
    pub(crate) fn set_chamber(&mut self, celsius: Decimal) -> Result<(), CommandError> {
        if self.has_chamber() { self.set_temperature(Heater::Chamber, celsius.to_f64()) } else { Ok(()) }
    }

    /// Switches off the nozzles of all tools.
    pub(crate) fn nozzles_off(&mut self) -> Result<(), CommandError> {
        self.set_temperature(Heater::Nozzle, 0.0)?;
        if self.heating.has_nozzles() { self.set_temperature(Heater::Nozzle1, 0.0) } else { Ok(()) }
    }

    /// Returns true if the nozzle of any tool has a target.
    pub(crate) fn is_a_nozzle_on(&self) -> bool {
        let is_on = |heater| self.heating.status(heater).target_celsius > 0.0;
        is_on(Heater::Nozzle) || self.heating.has_nozzles() && is_on(Heater::Nozzle1)
    }

    /// Returns true if any heater was switched off as unused: commands have set a target that is
    /// now gone.
    pub(crate) fn have_heaters_rested(&self) -> bool {
        let mut targets = Heater::ALL.into_iter().zip(self.modes.targets_celsius);
        targets.any(|(heater, celsius)| celsius > 0.0 && self.heating.status(heater).target_celsius <= 0.0)
    }

    /// Keeps heaters that are off from being heated again until they get a new target, because a
    /// new print begins or one was given up.
    pub(crate) fn forget_rested_heaters(&mut self) {
        for heater in Heater::ALL {
            if self.heating.status(heater).target_celsius <= 0.0 {
                self.modes.targets_celsius[heater.index()] = 0.0;
            }
        }
    }

    /// Waits until heaters are as hot as a print left them; those switched off meanwhile (M86) heat
    /// up again.
    pub(crate) async fn heat_again(&mut self, targets_celsius: [f32; Heater::COUNT]) -> Result<(), CommandError> {
        let is_meant = |(heater, celsius): &(Heater, f32)| *celsius > 0.0 && self.profile.heater(*heater).is_some();
        let targets = Heater::ALL.into_iter().zip(targets_celsius).filter(is_meant);
        for (heater, celsius) in targets.clone() {
            if self.heating.status(heater).target_celsius <= 0.0 {
                self.set_temperature(heater, f64::from(celsius))?;
            }
        }
        for (heater, _) in targets {
            let status = self.heating.status(heater);
            let window_celsius = self.heater_settings(heater)?.residency_window_celsius;
            if status.celsius < status.target_celsius - window_celsius {
                self.wait_until_hot(heater).await?;
            }
        }
        Ok(())
    }

    /// Executes the wait of M109, M190 and M191: until the temperature has stayed near its target
    /// for the profile's residency time. S waits only if heating is needed, and then also until an
    /// overshoot has passed. M108 ends the wait, not the heating.
    pub(crate) async fn wait_for_heat(&mut self, heater: Heater, target: WaitTarget) -> Result<(), CommandError> {
        let until = match target {
            WaitTarget::Heating(value) => {
                self.set_temperature(heater, value.to_f64())?;
                Until::Near { cooling_counts: false }
            }
            WaitTarget::HeatingOrCooling(value) => {
                self.set_temperature(heater, value.to_f64())?;
                Until::Near { cooling_counts: true }
            }
            WaitTarget::Current => Until::Near { cooling_counts: false },
            WaitTarget::AtLeast(value) => Until::AtLeast(value.to_f64() as f32),
        };
        self.print_heats();
        // An M108 sent before this command does not end its wait; one during the end of the
        // previous motion does.
        self.signals.take_end_wait();
        self.motion.finish().await?;
        self.wait_until(heater, until).await
    }

    /// Waits until a heater with a target has reached it from below. M108 ends the wait.
    pub(crate) async fn wait_until_hot(&mut self, heater: Heater) -> Result<(), CommandError> {
        self.signals.take_end_wait();
        self.wait_until(heater, Until::Near { cooling_counts: false }).await
    }

    async fn wait_until(&mut self, heater: Heater, until: Until) -> Result<(), CommandError> {
        let settings = self.heater_settings(heater)?;
        self.signals.set_waiting_for_heat(true);
        let mut waits = self.waits();
        let (heating, replies, line) = (&self.heating, self.replies, self.lines.number);
        let outcome = waits
            .for_heat(heater, settings, until, heating, |report| match report {
                WaitReport::Remaining(left_s) => replies.send(Reply::Waiting(temperatures(heating), left_s)),
                WaitReport::CoolsNoFurther(status) => {
                    let name = heater.name();
                    let (celsius, target) = (Real::fixed(status.celsius, 1), Real::short(status.target_celsius, 2));
                    replies.say(format_args!(
                        "echo:line {line}: the {name} cools no further than {celsius} C, the wait for {target} C ends \
                         (expected a target above the room's temperature)"
                    ));
                }
            })
            .await;
        self.signals.set_waiting_for_heat(false);
        outcome
    }
}
