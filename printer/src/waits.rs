//! Waits: for time, for heat.

use embedded_hal_async::delay::DelayNs;
use ferrostep_gcode::{Real, Reply, Temperatures, WaitTarget};
use ferrostep_hal_shim::{Clock, Heater};

use crate::error::CommandError;
use crate::ports::{HeaterStatus, Heating, Motion, Ports, Replies};
use crate::printer::{Printer, Text};

/// How often a wait looks around. A cancelled wait ends within this time.
const LOOK_MS: u64 = 100;

/// Interval of the lines that M109 and M190 print.
const REPORT_MS: u64 = 1000;

/// A wait for cooling ends where the temperature falls by less than this in this time: colder than the room nothing
/// gets. Well above what a thermistor's reading wanders, and well below what a heater loses 10 degrees above the room.
const MIN_COOLING_CELSIUS: f32 = 0.5;
const MIN_COOLING_MS: u64 = 120_000;

/// Watches a heater cool.
#[derive(Clone, Copy, Debug, Default)]
struct Cooling {
    /// When it was looked at last, ms, and how warm it was then.
    before: Option<(u64, f32)>,
}

impl Cooling {
    /// Whether the temperature has ceased to fall.
    fn is_over(&mut self, now_ms: u64, celsius: f32) -> bool {
        match self.before {
            Some((since_ms, _)) if now_ms.saturating_sub(since_ms) < MIN_COOLING_MS => false,
            Some((_, before)) if before - celsius < MIN_COOLING_CELSIUS => true,
            _ => {
                self.before = Some((now_ms, celsius));
                false
            }
        }
    }
}

impl<P: Ports> Printer<'_, P> {
    /// Waits for a while; ends early when the machine is halted.
    pub(crate) async fn wait_ms(&mut self, milliseconds: u64) -> Result<(), CommandError> {
        let end = self.clock.now_ms().saturating_add(milliseconds);
        loop {
            if self.signals.is_halted() {
                return Err(CommandError::Halted);
            }
            let now = self.clock.now_ms();
            if now >= end {
                return Ok(());
            }
            self.clock.delay_ms((end - now).min(LOOK_MS) as u32).await;
        }
    }

    /// M104, M140.
    pub(crate) fn set_temperature(&mut self, heater: Heater, celsius: f64) -> Result<(), CommandError> {
        let settings = match heater {
            Heater::Nozzle => &self.profile.nozzle,
            Heater::Bed => &self.profile.bed,
        };
        // As the control will have it: rounding may not take it to the maximum.
        let target = celsius as f32;
        if target >= settings.max_celsius || target > settings.max_target_celsius {
            return Err(CommandError::TooHot { celsius, maximum_celsius: settings.max_target_celsius });
        }
        self.needs(self.equipment.heaters || celsius <= 0.0, "heaters")?;
        self.heating.set_target(heater, celsius as f32);
        Ok(())
    }

    /// M109, M190: until the temperature has stayed near its target for the profile's residency time. S waits only
    /// if it has to heat. M108 ends the wait, not the heating.
    pub(crate) async fn wait_for_heat(&mut self, heater: Heater, target: WaitTarget) -> Result<(), CommandError> {
        let cooling_counts = match target {
            WaitTarget::Heating(value) => {
                self.set_temperature(heater, value.to_f64())?;
                false
            }
            WaitTarget::HeatingOrCooling(value) => {
                self.set_temperature(heater, value.to_f64())?;
                true
            }
            WaitTarget::Current => false,
        };
        // An M108 from before this command is not meant for it; one that comes while the motion before it ends is.
        self.signals.take_end_wait();
        self.motion.finish().await?;
        self.signals.set_waiting_for_heat(true);
        let outcome = self.stay_near_target(heater, cooling_counts).await;
        self.signals.set_waiting_for_heat(false);
        outcome
    }

    /// Waits until the temperature has stayed near its target for long enough.
    async fn stay_near_target(&mut self, heater: Heater, cooling_counts: bool) -> Result<(), CommandError> {
        let settings = match heater {
            Heater::Nozzle => self.profile.nozzle,
            Heater::Bed => self.profile.bed,
        };
        let had_target = self.heating.status(heater).target_celsius > 0.0;
        let mut near_since: Option<u64> = None;
        let mut cooling = Cooling::default();
        let mut next_report = self.clock.now_ms() + REPORT_MS;
        loop {
            if self.signals.is_halted() {
                return Err(CommandError::Halted);
            }
            if self.signals.take_end_wait() {
                return Ok(());
            }
            let status = self.heating.status(heater);
            let above = status.celsius - status.target_celsius;
            if had_target && status.target_celsius <= 0.0 {
                // During a wait only a fault or a timeout takes a target away.
                return Err(CommandError::HeatersTimedOut);
            }
            if status.target_celsius <= 0.0 || !cooling_counts && above > settings.residency_window_celsius {
                return Ok(());
            }
            let now = self.clock.now_ms();
            if above.abs() > settings.residency_window_celsius {
                near_since = None;
            }
            let near = above.abs() <= settings.residency_window_celsius;
            if above > settings.residency_window_celsius && cooling.is_over(now, status.celsius) {
                self.say_not_cooling(heater, &status);
                return Ok(());
            }
            let left_ms = near.then(|| {
                let since = *near_since.get_or_insert(now);
                u64::from(settings.residency_ms).saturating_sub(now - since)
            });
            if left_ms == Some(0) {
                return Ok(());
            }
            if now >= next_report {
                next_report = now + REPORT_MS;
                let left_s = left_ms.map(|left| left.div_ceil(1000) as u32);
                self.replies.send(Reply::Waiting(temperatures(&self.heating), left_s));
            }
            self.clock.delay_ms(LOOK_MS as u32).await;
        }
    }

    fn say_not_cooling(&self, heater: Heater, status: &HeaterStatus) {
        let name = heater.name();
        let (celsius, target) = (Real::fixed(status.celsius, 1), Real::short(status.target_celsius, 2));
        let mut text = Text::new();
        let line = self.line;
        let written = core::fmt::write(
            &mut text,
            format_args!(
                "echo:line {line}: the {name} cools no further than {celsius} C, the wait for {target} C ends \
                 (expected a target above the room's temperature)"
            ),
        );
        if written.is_ok() {
            self.replies.send(Reply::Text(&text));
        }
    }
}

/// All temperatures as reports show them.
pub fn temperatures(heating: &impl Heating) -> Temperatures {
    let nozzle = heating.status(Heater::Nozzle);
    let bed = heating.status(Heater::Bed);
    let power = |share: f32| (share * 127.0) as u8;
    Temperatures {
        nozzle: nozzle.celsius,
        nozzle_target: nozzle.target_celsius,
        bed: bed.celsius,
        bed_target: bed.target_celsius,
        nozzle_power: power(nozzle.power),
        bed_power: power(bed.power),
    }
}
