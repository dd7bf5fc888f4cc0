//! M301, M303, M304 and M309: the gains of heaters, and their autotune. For a heater with a model,
//! M303 finds the model ([`crate::commands::heater_model`]).

use ferrostep_gcode::{Decimal, GainWords, Real, Reply, TunedHeater};
use ferrostep_hal_shim::Heater;

use crate::error::CommandError;
use crate::heat::gains::PidGains;
use crate::heat::relay::RelayProgress;
use crate::heat::tuning_rule::gains_by_relay;
use crate::part::Part;
use crate::ports::{Heating, Motion, Ports, Replies};
use crate::printer::Printer;
use crate::settings::bounds::{FULL_POWER, in_range};

/// Default targets and cycles of M303, from Marlin.
const NOZZLE_CELSIUS: f64 = 150.0;
const BED_CELSIUS: f64 = 70.0;

/// Marlin's value, 35, is too close to a warm room.
const CHAMBER_CELSIUS: f64 = 50.0;
const CYCLES: u8 = 5;
const MIN_CYCLES: u8 = 3;

/// Minimum target, degrees Celsius: a heater must also cool below it within minutes.
const MIN_CELSIUS: f64 = 40.0;

/// Minimum distance of the target below the maximum, degrees: the relay overshoots it a little.
const NOZZLE_MARGIN_CELSIUS: f32 = 15.0;

/// Minimum distance for a step response, after which the temperature rises further by the slope at
/// full power times the thermistor's lag.
const STEP_MARGIN_CELSIUS: f32 = 40.0;

/// Default target of a nozzle's step response, from Marlin.
const STEP_CELSIUS: f64 = 200.0;
const BED_MARGIN_CELSIUS: f32 = 10.0;

/// Sets a gain from a line's word, if given.
fn set(gain: &mut f32, word: char, value: Option<Decimal>, [low, high]: [f64; 2]) -> Result<(), CommandError> {
    if let Some(value) = value {
        *gain = (in_range(word, value.to_f64(), low * FULL_POWER, high * FULL_POWER)? / FULL_POWER) as f32;
    }
    Ok(())
}

/// A gain in Marlin's units.
fn marlins(gain: f32) -> Real {
    Real::short(f64::from(gain) * FULL_POWER, 4)
}

/// Reports a cycle of the relay. Separate, because in a future's function the compiler keeps every
/// value in memory.
#[inline(never)]
fn tell_cycle(replies: &(impl Replies + ?Sized), ended: u8, of: u8, ends: [f32; 2]) {
    let [lowest, highest] = ends.map(|celsius| Real::fixed(celsius, 2));
    replies.say(format_args!(" cycle: {ended}/{of} min: {lowest} max: {highest}"));
}

/// Reports a part of a step response.
#[inline(never)]
fn tell_step(replies: &(impl Replies + ?Sized), ended: u8, of: u8) {
    replies.say(format_args!(" part: {ended}/{of}"));
}

/// Name of a heater's table in the profile.
pub(crate) const fn table_of(heater: Heater) -> &'static str {
    match heater {
        Heater::Nozzle => "nozzle",
        Heater::Nozzle1 => "tools.t1.nozzle",
        Heater::Bed => "bed",
        Heater::Chamber => "chamber",
    }
}

impl<P: Ports> Printer<'_, P> {
    /// Executes M301, M304 and M309.
    pub(crate) fn heater_gains(&mut self, heater: Heater, words: &GainWords) -> Result<(), CommandError> {
        self.needs(self.fitted.equipment.heaters, "heaters")?;
        if self.has_model(heater) {
            return Err(CommandError::HeaterControl(
                "M301 and M304 are for a PID loop, and a model controls this heater: M306 sets its constants, M306 T finds them",
            ));
        }
        if *words == GainWords::default() {
            self.report_gains(heater, &self.heating.gains(heater));
            return Ok(());
        }
        let mut gains = self.heating.gains(heater);
        set(&mut gains.proportional, 'P', words.proportional, PidGains::PROPORTIONAL)?;
        set(&mut gains.integral, 'I', words.integral, PidGains::INTEGRAL)?;
        set(&mut gains.derivative, 'D', words.derivative, PidGains::DERIVATIVE)?;
        set(&mut gains.fan, 'F', words.fan, PidGains::FAN)?;
        self.heating.set_gains(heater, gains);
        Ok(())
    }

    /// Reports the line that sets these gains.
    #[inline(never)]
    fn report_gains(&self, heater: Heater, gains: &PidGains) {
        let [p, i, d, f] = [gains.proportional, gains.integral, gains.derivative, gains.fan].map(marlins);
        match heater {
            Heater::Nozzle => self.replies.say(format_args!("echo:M301 P{p} I{i} D{d} F{f}")),
            Heater::Nozzle1 => self.replies.say(format_args!("echo:M301 E1 P{p} I{i} D{d} F{f}")),
            Heater::Bed => self.replies.say(format_args!("echo:M304 P{p} I{i} D{d}")),
            Heater::Chamber => self.replies.say(format_args!("echo:M309 P{p} I{i} D{d}")),
        }
    }

    /// The heater that M303 names.
    pub(crate) fn tuned_heater(&self, of: TunedHeater) -> Result<Heater, CommandError> {
        match of {
            TunedHeater::Nozzle(tool) if self.is_for_no_tool(tool) => {
                Err(CommandError::InvalidTool(tool.unwrap_or_default().into()))
            }
            TunedHeater::Nozzle(tool) => self.nozzle_of(tool),
            TunedHeater::Bed => Ok(Heater::Bed),
            TunedHeater::Chamber => self.heated_chamber(),
        }
    }

    /// The chamber, if it has a heater.
    fn heated_chamber(&self) -> Result<Heater, CommandError> {
        match self.heating.chamber_is_heated() {
            Some(true) => Ok(Heater::Chamber),
            Some(false) => Err(CommandError::HeaterControl("the chamber has no heater to tune: the bed warms it")),
            None => Err(CommandError::NotEquipped(Heater::Chamber.name())),
        }
    }

    /// Executes M303: finds the gains by a relay, and leaves the heater off.
    pub(crate) async fn autotune(
        &mut self,
        heater: Heater,
        target: Option<Decimal>,
        cycles: Option<u8>,
        uses: bool,
    ) -> Result<(), CommandError> {
        self.may_autotune()?;
        let (celsius, has_fan) = self.autotune_target(heater, target)?;
        self.may_step(heater, celsius)?;
        self.signals.take_end_wait();
        self.motion.finish().await?;
        self.begin_autotune(heater, celsius, cycles, has_fan);
        let (mut waits, stops) = (self.waits(), self.motion.stops());
        let (heating, motion, replies) = (&self.heating, &self.motion, self.replies);
        let outcome = waits
            .for_autotune(
                heater,
                heating,
                || motion.stops() != stops,
                |ended, of, ends| match ends {
                    Some(ends) => tell_cycle(replies, ended, of, ends),
                    None if <P::Heating as Heating>::Models::PRESENT => tell_step(replies, ended, of),
                    None => {}
                },
            )
            .await;
        self.end_autotune(heater, celsius, uses, outcome)
    }

    /// Begins an autotune by a relay, or, for a heater with a model, by a step response.
    #[inline(never)]
    fn begin_autotune(&mut self, heater: Heater, celsius: f32, cycles: Option<u8>, has_fan: bool) {
        if self.has_model(heater) {
            if cycles.is_some() {
                self.replies.send(Reply::Text("echo:M303: C has no effect, a model is found by one step"));
            }
            self.replies.send(Reply::Text("MPC Autotune start"));
            return self.heating.begin_step(heater, celsius, has_fan);
        }
        self.replies.send(Reply::Text("PID Autotune start"));
        self.heating.begin_relay(heater, celsius, cycles.unwrap_or(CYCLES).max(MIN_CYCLES), has_fan);
    }

    /// Ends an autotune, whatever the reason: switches the heater off.
    #[inline(never)]
    fn end_autotune(
        &mut self,
        heater: Heater,
        celsius: f32,
        uses: bool,
        outcome: Result<(), CommandError>,
    ) -> Result<(), CommandError> {
        let progress = self.heating.relay(heater);
        let step = if self.has_model(heater) { self.heating.step(heater) } else { None };
        self.heating.set_target(heater, 0.0);
        self.modes.targets_celsius[heater.index()] = 0.0;
        outcome?;
        if self.has_model(heater) {
            self.end_step(heater, step, uses);
            return Ok(());
        }
        match progress {
            Some(RelayProgress::Found(findings)) => self.tuned(heater, &gains_by_relay(&findings, celsius), uses),
            _ => self.replies.send(Reply::Text("PID Autotune ended by M108, the gains stay")),
        }
        Ok(())
    }

    /// Refuses an autotune without heaters, or during a print.
    fn may_autotune(&self) -> Result<(), CommandError> {
        self.needs(self.fitted.equipment.heaters, "heaters")?;
        if self.is_paused() || self.is_a_nozzle_on() {
            return Err(CommandError::TunesNoPrint);
        }
        Ok(())
    }

    /// Target of an autotune, degrees Celsius, and true if a fan cools the heater.
    #[inline(never)]
    fn autotune_target(&self, heater: Heater, target: Option<Decimal>) -> Result<(f32, bool), CommandError> {
        let (mut usual, mut margin, has_fan) = match heater {
            Heater::Nozzle | Heater::Nozzle1 => (NOZZLE_CELSIUS, NOZZLE_MARGIN_CELSIUS, self.fitted.equipment.fan),
            Heater::Bed => (BED_CELSIUS, BED_MARGIN_CELSIUS, false),
            Heater::Chamber => (CHAMBER_CELSIUS, BED_MARGIN_CELSIUS, false),
        };
        let settings = self.heater_settings(heater)?;
        let highest = |margin| settings.max_target_celsius.min(settings.max_celsius - margin);
        if heater.is_nozzle() && self.has_model(heater) {
            margin = STEP_MARGIN_CELSIUS;
            usual = STEP_CELSIUS.min(highest(margin).into());
        }
        let highest = highest(margin);
        let celsius = in_range('S', target.map_or(usual, Decimal::to_f64), MIN_CELSIUS, highest.into())?;
        Ok((celsius as f32, has_fan))
    }

    /// Reports gains that were found, in Marlin's form and in the profile's.
    #[inline(never)]
    fn tuned(&mut self, heater: Heater, gains: &PidGains, uses: bool) {
        let name = table_of(heater);
        let marlins_name = if heater.is_nozzle() { "" } else { name };
        self.replies.send(Reply::Text("PID Autotune finished!"));
        for (letter, gain) in [('p', gains.proportional), ('i', gains.integral), ('d', gains.derivative)] {
            self.replies.say(format_args!("#define DEFAULT_{marlins_name}K{letter} {}", marlins(gain)));
        }
        self.report_gains(heater, gains);
        let [p, i, d, f] =
            [gains.proportional, gains.integral, gains.derivative, gains.fan].map(|gain| Real::short(gain, 6));
        self.replies.say(format_args!("echo:{name}: proportional = {p}, integral = {i}, derivative = {d}"));
        if heater.is_nozzle() {
            self.replies.say(format_args!("echo:{name}: fan_gain = {f}"));
        }
        if uses {
            self.heating.set_gains(heater, *gains);
        }
    }
}

#[cfg(test)]
pub(crate) mod tests;
