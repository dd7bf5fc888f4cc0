//! One loop for all heaters and fans, and the checks that switch everything off.

use ferrostep_hal_shim::{FanOutput, Fans, Heater, ThermalBoard};

use super::channel::{Channel, Loop};
use super::gains::PidGains;
use super::model::HeaterModel;
use super::modelled::Models;
use super::relay::{Relay, RelayProgress};
use super::report::{FanStatus, HeatFault, HeaterStatus};
use super::safety::Safety;
use super::step_response::StepProgress;
use crate::heat::fans::{FanControl, FanDemand, FanTable, Heated};
use crate::part::{Part, Present};
use crate::settings::profile::heaters::HeaterSettings;

/// Nozzles of further tools.
#[derive(Clone, Copy, Debug, PartialEq)]
struct FurtherNozzle {
    /// `None` if the tools share a nozzle.
    channel: Option<Channel>,
    /// True if this is the nozzle of the selected tool.
    is_selected: bool,
    /// The fan that blows at the nozzle.
    fan: FanOutput,
}

/// Number of heaters of every machine, without those of further tools: the first ones in the order
/// of their index.
const USUAL: usize = Heater::Nozzle1.index();

/// Control of all heaters and fans. `M` says whether heaters may be controlled by a model, `T`
/// whether there may be several nozzles.
#[derive(Clone, Copy, Debug)]
pub struct HeatControl<M: Part = Present, T: Part = Present> {
    /// `None` for a heater that the machine does not have.
    channels: [Option<Channel>; USUAL],
    further: T::Of<FurtherNozzle>,
    /// Models in force, for the heaters that have them.
    models: M::Of<Models<T>>,
    fault: Option<HeatFault>,
    pub(crate) fan_table: FanTable,
    fans: FanControl,
    /// Powers of the fans while there is no fault.
    fan_demand: FanDemand,
    /// True while the power supply is on; `None` if it cannot be switched.
    pub(crate) supply: Option<bool>,
    /// The machine was halted, until [`Self::restart`].
    is_halted: bool,
}

impl<M: Part, T: Part> HeatControl<M, T> {
    /// Control with all heaters off. Takes as many readings as the median needs, so that
    /// temperatures are known from the start. The hot end's fan turns until the first
    /// [`Self::update`]: after a reset the nozzle may be hot.
    pub fn new(
        heaters: [Option<HeaterSettings>; Heater::COUNT],
        fan_table: FanTable,
        board: &mut (impl ThermalBoard + Fans),
    ) -> Self {
        board.set_fan_power(FanOutput::HotEnd, u8::MAX);
        let mut channel = |heater: Heater| {
            heaters[heater.index()].map(|settings| {
                board.set_power(heater, 0.0);
                Channel::new(settings, core::array::from_fn(|_| board.reading(heater)))
            })
        };
        let channels = [Heater::Nozzle, Heater::Bed, Heater::Chamber].map(&mut channel);
        let further = if T::PRESENT { channel(Heater::Nozzle1) } else { None };
        Self {
            channels,
            further: T::of(FurtherNozzle { channel: further, is_selected: false, fan: FanOutput::Part }),
            models: M::of(Models::none()),
            fault: None,
            fan_table,
            fans: FanControl::new(),
            fan_demand: FanDemand::default(),
            supply: None,
            is_halted: false,
        }
    }

    /// Takes a sample of every thermometer and sets every heater; call it every
    /// [`super::SAMPLE_MS`].
    ///
    /// # Errors
    /// A heater or thermometer has failed: all heaters are off and all fans on, until
    /// [`Self::restart`], and a switchable supply is off, until [`Self::set_supply`]. Reported
    /// once.
    pub fn update(&mut self, board: &mut (impl ThermalBoard + Fans)) -> Result<(), HeatFault> {
        let mut found = None;
        for (heater, channel) in channels::<T>(&mut self.channels, &mut self.further) {
            let outcome = channel.sample(board.reading(heater));
            found = found.or(outcome.err().map(|trip| HeatFault { heater, trip }));
        }
        let told = self.fault.is_some();
        self.fault = self.fault.or(found);
        let mut demand = self.fan_demand;
        let wanting = channels::<T>(&mut self.channels, &mut self.further)
            .find(|(_, channel)| matches!(&channel.control, Loop::Relay(relay) if relay.wants_fan()))
            .map(|(heater, _)| heater);
        if let Some(heater) = wanting.or_else(|| self.models().and_then(Models::wants_fan)) {
            demand.powers[self.fan_at(heater).index()] = u8::MAX;
        }
        let heated = Heated {
            nozzle_celsius: self.hottest_nozzle(),
            bed_is_on: self.channel(Heater::Bed).is_some_and(|bed| bed.target > 0.0),
            // A transistor that has failed closed cannot be switched off; without a switchable
            // supply, only moving air can cool its heater.
            has_fault: self.fault.is_some(),
            is_halted: self.is_halted || self.fault.is_some(),
            has_supply: self.has_supply(),
        };
        let part_power = self.fans.update(&self.fan_table, &demand, &heated, board);
        match self.fault {
            Some(_) => self.halt(),
            None => {
                let melting = self.nozzle();
                let power_at_further = self.fans.power(self.fan_at(Heater::Nozzle1));
                for (heater, channel) in channels::<T>(&mut self.channels, &mut self.further) {
                    let (celsius, power) = (channel.celsius, channel.power);
                    let fan_power = if heater == Heater::Nozzle1 { power_at_further } else { part_power };
                    let modelled = M::get_mut(&mut self.models).and_then(|models| {
                        models.power(heater, celsius?, &mut channel.target, power, (fan_power, heater == melting))
                    });
                    match modelled {
                        Some(power) => channel.power = power,
                        None => channel.control(fan_power),
                    }
                }
            }
        }
        for (heater, channel) in channels::<T>(&mut self.channels, &mut self.further) {
            board.set_power(heater, channel.power);
        }
        if let Some(on) = self.supply {
            board.set_supply(on);
        }
        match self.fault {
            Some(fault) if !told => Err(fault),
            _ => Ok(()),
        }
    }

    /// The fault that keeps all heaters off, if any.
    pub fn fault(&self) -> Option<HeatFault> {
        self.fault
    }

    /// Sets a target, degrees Celsius; any value not above 0 switches the heater off. Ends an
    /// autotune of the heater. Ignored after a fault, and while the power supply is off.
    pub fn set_target(&mut self, heater: Heater, celsius: f32) {
        if self.fault.is_some() || !self.has_supply() {
            return;
        }
        let Some(channel) = self.channel_mut(heater) else { return };
        if matches!(channel.control, Loop::Relay(_)) {
            channel.off();
        }
        channel.target = if celsius > 0.0 { celsius } else { 0.0 };
        if self.step(heater).is_some() {
            self.end_step();
        }
    }

    /// The gains of a heater.
    pub fn gains(&self, heater: Heater) -> PidGains {
        self.channel(heater).map_or_else(PidGains::default, |channel| channel.settings.gains)
    }

    /// Sets the gains of a heater, from the next [`Self::update`] on. The caller keeps them
    /// within their ranges.
    pub fn set_gains(&mut self, heater: Heater, gains: PidGains) {
        if let Some(channel) = self.channel_mut(heater) {
            channel.settings.gains = gains;
        }
    }

    /// Tunes a heater at a target by a relay that counts `cycles`, and `cycles` again with the
    /// part-cooling fan at full power if `has_fan`. All checks continue; after the last cycle the
    /// heater is off. [`Self::set_target`], a fault and [`Self::all_off`] end the autotune. Ignored
    /// after a fault.
    pub fn begin_relay(&mut self, heater: Heater, celsius: f32, cycles: u8, has_fan: bool) {
        self.set_target(heater, celsius);
        if self.fault.is_none()
            && self.has_supply()
            && let Some(channel) = self.channel_mut(heater)
        {
            channel.control = Loop::Relay(Relay::new(cycles, has_fan));
        }
    }

    fn models(&self) -> Option<&Models<T>> {
        M::get(&self.models)
    }

    fn end_step(&mut self) {
        if let Some(models) = M::get_mut(&mut self.models) {
            models.end_step();
        }
    }

    /// The fan that blows at a heater.
    fn fan_at(&self, heater: Heater) -> FanOutput {
        match T::get(&self.further) {
            Some(further) if heater == Heater::Nozzle1 => further.fan,
            _ => FanOutput::Part,
        }
    }

    /// Assigns this part-cooling fan to the second nozzle, instead of the first nozzle's.
    pub fn set_nozzle_fan(&mut self, fan: FanOutput) {
        if let Some(further) = T::get_mut(&mut self.further) {
            further.fan = fan;
        }
    }

    /// The model that controls a heater; `None` if a PID loop does.
    pub fn model(&self, heater: Heater) -> Option<HeaterModel> {
        self.models()?.model(heater)
    }

    /// Makes models control the heaters that have one.
    pub fn set_models(&mut self, model: impl Fn(Heater) -> Option<HeaterModel>) {
        for heater in Heater::ALL {
            if let Some(model) = model(heater) {
                self.set_model(heater, model);
            }
        }
    }

    /// Makes a model control a nozzle or the bed from the next [`Self::update`] on, or changes it.
    /// The caller keeps it within its ranges.
    pub fn set_model(&mut self, heater: Heater, model: HeaterModel) {
        if let Some(models) = M::get_mut(&mut self.models) {
            models.set_model(heater, model);
        }
    }

    /// Starts a step response up to a target to find the model of a heater that has one and is not
    /// hotter than [`super::hottest_start`], with the part-cooling fan at full power if `has_fan`.
    /// All checks continue; afterwards the heater is off. [`Self::set_target`], a fault and
    /// [`Self::all_off`] end the step response. Ignored after a fault.
    pub fn begin_step(&mut self, heater: Heater, celsius: f32, has_fan: bool) {
        self.set_target(heater, celsius);
        if self.fault.is_none()
            && self.has_supply()
            && let Some(models) = M::get_mut(&mut self.models)
        {
            models.begin_step(heater, has_fan);
        }
    }

    /// Progress of a heater's step response; `None` without one.
    pub fn step(&self, heater: Heater) -> Option<StepProgress> {
        self.models()?.step(heater)
    }

    /// Takes the filament that the extruder has pushed since some moment, thousandths of a
    /// millimetre; call it before each [`Self::update`] on a machine whose nozzle melts filament.
    pub fn note_filament(&mut self, pushed_um: i32) {
        if let Some(models) = M::get_mut(&mut self.models) {
            models.note_filament(pushed_um);
        }
    }

    /// Progress of a heater's autotune; `None` without one.
    pub fn relay(&self, heater: Heater) -> Option<RelayProgress> {
        match &self.channel(heater)?.control {
            Loop::Pid(_) => None,
            Loop::Relay(relay) => Some(relay.progress()),
        }
    }

    /// Sets the demand on fans from the next [`Self::update`] on. After a fault all
    /// have full power.
    pub fn set_fan_demand(&mut self, demand: FanDemand) {
        self.fan_demand = demand;
    }

    /// Power and speed of a fan.
    pub fn fan(&self, output: FanOutput) -> FanStatus {
        FanStatus { power: self.fans.power(output), rpm: self.fans.rpm(output) }
    }

    /// The first fan that turns too slowly at full power
    /// ([`crate::heat::fans::FanSettings::least_rpm`]).
    pub fn stalled_fan(&self) -> Option<FanOutput> {
        self.fans.stalled()
    }

    /// Switches all heaters off; the next [`Self::update`] sets the board's outputs.
    pub fn all_off(&mut self) {
        channels::<T>(&mut self.channels, &mut self.further).for_each(|(_, channel)| channel.off());
        self.end_step();
    }

    /// Switches the power supply; switching it off also switches off all heaters. The next
    /// [`Self::update`] sets the board's output. A fault keeps the supply off.
    pub fn set_supply(&mut self, on: bool) {
        self.supply = Some(on && self.fault.is_none());
        if !on {
            self.all_off();
        }
    }

    /// Returns true if the power supply is on; `None` if it was never switched, which means that it
    /// cannot be.
    pub const fn supply(&self) -> Option<bool> {
        self.supply
    }

    /// Returns true if heaters have power.
    const fn has_supply(&self) -> bool {
        !matches!(self.supply, Some(false))
    }

    /// Halts heating: switches off all heaters, and the power supply if that can be switched, so
    /// that even a heater whose transistor has failed closed is off. The next [`Self::update`] sets
    /// the board's outputs. [`Self::restart`] ends the halt, and leaves the supply off.
    pub fn halt(&mut self) {
        self.all_off();
        self.supply = self.supply.map(|_| false);
        self.is_halted = true;
    }

    /// Clears the fault (M999), so that heaters may be switched on again; fails if the fault needs
    /// a reset, or if the last readings show a fault.
    ///
    /// # Errors
    /// The fault; everything stays off.
    pub fn restart(&mut self) -> Result<(), HeatFault> {
        self.all_off();
        if let Some(fault) = self.fault
            && fault.trip.needs_reset()
        {
            return Err(fault);
        }
        self.fault = None;
        self.is_halted = false;
        for (heater, channel) in channels::<T>(&mut self.channels, &mut self.further) {
            channel.safety = Safety::new();
            if let Err(trip) = channel.safety.check(&channel.settings, channel.thermometer.celsius(), 0.0, 0.0, false) {
                self.fault = self.fault.or(Some(HeatFault { heater, trip }));
            }
        }
        self.fault.map_or(Ok(()), Err)
    }

    /// Temperature, target and power of a heater. The temperature is the last one; before the first
    /// it is 0, too cold to extrude.
    pub fn status(&self, heater: Heater) -> HeaterStatus {
        let Some(channel) = self.channel(heater) else { return HeaterStatus::default() };
        let celsius = channel.celsius.unwrap_or(0.0);
        HeaterStatus { celsius, target_celsius: channel.target, power: channel.power }
    }

    /// Returns true if the chamber has a heater besides its thermometer; `None` without either.
    pub fn chamber_is_heated(&self) -> Option<bool> {
        self.channel(Heater::Chamber).map(|chamber| chamber.settings.is_heated)
    }

    /// Returns true if a further tool has a separate nozzle.
    pub fn has_nozzles(&self) -> bool {
        T::PRESENT && self.channel(Heater::Nozzle1).is_some()
    }

    /// The heater of the selected tool's nozzle.
    pub fn nozzle(&self) -> Heater {
        match T::get(&self.further) {
            Some(FurtherNozzle { is_selected: true, .. }) => Heater::Nozzle1,
            _ => Heater::Nozzle,
        }
    }

    /// Makes this heater the selected tool's nozzle from now on.
    pub fn select_nozzle(&mut self, heater: Heater) {
        if let Some(further) = T::get_mut(&mut self.further) {
            further.is_selected = heater == Heater::Nozzle1;
        }
    }

    /// Temperature of the hottest nozzle, degrees Celsius; `None` if one is unknown: the fan then
    /// turns.
    fn hottest_nozzle(&self) -> Option<f32> {
        let celsius = |nozzle: &Channel| nozzle.thermometer.celsius().ok();
        let first = self.channel(Heater::Nozzle).and_then(celsius);
        match self.channel(Heater::Nozzle1).filter(|_| T::PRESENT) {
            None => first,
            Some(second) => first.zip(celsius(second)).map(|(first, second)| first.max(second)),
        }
    }

    fn channel(&self, heater: Heater) -> Option<&Channel> {
        match self.channels.get(heater.index()) {
            Some(channel) => channel.as_ref(),
            None => T::get(&self.further)?.channel.as_ref(),
        }
    }

    fn channel_mut(&mut self, heater: Heater) -> Option<&mut Channel> {
        match self.channels.get_mut(heater.index()) {
            Some(channel) => channel.as_mut(),
            None => T::get_mut(&mut self.further)?.channel.as_mut(),
        }
    }
}

/// The heaters that the machine has.
fn channels<'a, T: Part>(
    channels: &'a mut [Option<Channel>; USUAL],
    further: &'a mut T::Of<FurtherNozzle>,
) -> impl Iterator<Item = (Heater, &'a mut Channel)> {
    let further = T::get_mut(further).map(|further| &mut further.channel);
    let all = Heater::ALL.into_iter().zip(channels.iter_mut().chain(further));
    all.filter_map(|(heater, channel)| Some((heater, channel.as_mut()?)))
}
