//! The heaters and their control.

use core::sync::atomic::{AtomicI32, Ordering};

use ferrostep_hal_shim::{FanOutput, Heater, ThermalBoard};
use ferrostep_printer::heat::{HeatControl, HeatFault, HeaterModel, RelayProgress, StepProgress};
use ferrostep_printer::{Equipment, FanDemand, FanRule, FanSettings, FanStatus, HeaterStatus, PidGains, Profile};
use ferrostep_stm32f4::clock_tree::Clock;
use ferrostep_stm32f4_board::board::THERMAL;
use ferrostep_stm32f4_board::thermal::{self, Converters, Heaters};

use ferrostep_profile_constant::PROFILE;

use crate::part::PartIf;
use crate::ports::BoardMachine;

/// Parts of the board that the firmware can use.
pub const EQUIPMENT: Equipment = Equipment {
    heaters: THERMAL.is_some(),
    end_stops: true,
    fan: match THERMAL {
        Some(pins) => pins.fans[0].is_some(),
        None => false,
    },
};

/// True if the power supply can be switched.
const HAS_SUPPLY: bool = PROFILE.power_supply.is_some();

/// True if the chamber has a heater as well as a thermometer; `None` if it has neither.
pub const CHAMBER_IS_HEATED: Option<bool> = match PROFILE.chamber {
    Some(chamber) => Some(chamber.heater.is_some()),
    None => None,
};

/// True if a further tool has its own nozzle.
pub const HAS_NOZZLES: bool = PROFILE.tool_heater().is_some();

/// Type of the further tools' nozzles, on machines that have them.
type NozzlesPart = PartIf<HAS_NOZZLES>;

/// True if the machine has outputs that are not fans.
pub const HAS_OUTPUTS: bool = {
    let (mut at, mut has) = (0, false);
    while at < FanOutput::COUNT {
        if let Some(FanSettings { rule: FanRule::Output { .. }, .. }) = PROFILE.fans[at] {
            has = true;
        }
        at += 1;
    }
    has
};

/// Type of the switched power supply, on machines that have one.
pub type SupplyPart = PartIf<HAS_SUPPLY>;

/// True if a model may control any heater.
const HAS_MODELS: bool = MELTS_BY_MODEL || PROFILE.control_model(Heater::Bed).is_some();

/// True if a model may control a nozzle: the model needs to know how fast filament is melted.
const MELTS_BY_MODEL: bool =
    PROFILE.control_model(Heater::Nozzle).is_some() || PROFILE.control_model(Heater::Nozzle1).is_some();

/// Type of the heater models, on machines whose profile uses them.
pub type ModelsPart = PartIf<HAS_MODELS>;

/// Position of the extruder at the end of the queue, thousandths of a millimetre; the number wraps.
static PUSHED_UM: AtomicI32 = AtomicI32::new(0);

/// Notes the extruder's position.
pub fn note_filament(machine: &BoardMachine) {
    if MELTS_BY_MODEL {
        let [.., steps] = machine.motor_steps();
        let pushed_um = steps as f64 * 1e3 / machine.extruder_steps_per_mm().to_f64();
        PUSHED_UM.store(pushed_um as i64 as i32, Ordering::Relaxed);
    }
}

/// The heaters that the firmware can use.
pub struct Heat(Option<Controlled>);

/// The control, and the heaters that it controls.
struct Controlled {
    control: HeatControl<ModelsPart, NozzlesPart>,
    parts: Heaters,
}

impl Heat {
    /// Creates cold heaters with their first readings, so that the first command finds
    /// temperatures.
    pub fn new(profile: &Profile, converters: Converters, clock: &Clock) -> Self {
        let has_fans = profile.fans.map(|fan| fan.is_some());
        Self(thermal::start(has_fans, converters, clock).map(|mut parts| {
            let mut control = HeatControl::new(profile.heaters(), profile.fans, &mut parts);
            if HAS_MODELS {
                control.set_models(|heater| profile.control_model(heater));
            }
            if HAS_NOZZLES {
                control.set_nozzle_fan(profile.tool_fan());
            }
            if let Some(supply) = profile.power_supply {
                control.set_supply(supply.on_at_start);
            }
            Controlled { control, parts }
        }))
    }

    /// Runs one sample of control, every [`SAMPLE_MS`].
    ///
    /// # Errors
    /// A heater or thermometer has failed: all heaters are off and all fans on. Reported once.
    pub fn update(&mut self, fans: FanDemand) -> Result<(), HeatFault> {
        let Some(Controlled { control, parts }) = &mut self.0 else { return Ok(()) };
        control.set_fan_demand(fans);
        if MELTS_BY_MODEL {
            control.note_filament(PUSHED_UM.load(Ordering::Relaxed));
        }
        parts.tick();
        control.update(parts)
    }

    /// Returns the fault that keeps the heaters off until M999 or a reset, if any.
    pub fn fault(&self) -> Option<HeatFault> {
        self.0.as_ref().and_then(|heat| heat.control.fault())
    }

    /// Sets a target, degrees Celsius; 0 is off. No effect without heaters: [`EQUIPMENT`] makes the
    /// printer refuse any other target.
    pub fn set_target(&mut self, heater: Heater, celsius: f32) {
        if let Some(heat) = &mut self.0 {
            heat.control.set_target(heater, celsius);
        }
    }

    /// Temperature, target and power of a heater.
    pub fn status(&self, heater: Heater) -> HeaterStatus {
        self.0.as_ref().map_or_else(HeaterStatus::default, |heat| heat.control.status(heater))
    }

    /// Heater of the selected tool's nozzle.
    pub fn nozzle(&self) -> Heater {
        self.0.as_ref().map_or(Heater::Nozzle, |heat| heat.control.nozzle())
    }

    /// Selects the heater of the selected tool's nozzle.
    pub fn select_nozzle(&mut self, heater: Heater) {
        if let Some(heat) = &mut self.0 {
            heat.control.select_nozzle(heater);
        }
    }

    /// The gains of a heater.
    pub fn gains(&self, heater: Heater) -> PidGains {
        self.0.as_ref().map_or_else(PidGains::default, |heat| heat.control.gains(heater))
    }

    /// Sets the gains of a heater.
    pub fn set_gains(&mut self, heater: Heater, gains: PidGains) {
        if let Some(heat) = &mut self.0 {
            heat.control.set_gains(heater, gains);
        }
    }

    /// Starts a heater's autotune, see [`HeatControl::begin_relay`].
    pub fn begin_relay(&mut self, heater: Heater, celsius: f32, cycles: u8, has_fan: bool) {
        if let Some(heat) = &mut self.0 {
            heat.control.begin_relay(heater, celsius, cycles, has_fan);
        }
    }

    /// Progress of a heater's autotune.
    pub fn relay(&self, heater: Heater) -> Option<RelayProgress> {
        self.0.as_ref().and_then(|heat| heat.control.relay(heater))
    }

    /// The model that controls a heater.
    pub fn model(&self, heater: Heater) -> Option<HeaterModel> {
        self.0.as_ref().and_then(|heat| heat.control.model(heater))
    }

    /// Sets the model of a heater.
    pub fn set_model(&mut self, heater: Heater, model: HeaterModel) {
        if let Some(heat) = &mut self.0 {
            heat.control.set_model(heater, model);
        }
    }

    /// Starts to determine the model of a heater, see [`HeatControl::begin_step`].
    pub fn begin_step(&mut self, heater: Heater, celsius: f32, has_fan: bool) {
        if let Some(heat) = &mut self.0 {
            heat.control.begin_step(heater, celsius, has_fan);
        }
    }

    /// Progress of a heater's step response.
    pub fn step(&self, heater: Heater) -> Option<StepProgress> {
        self.0.as_ref().and_then(|heat| heat.control.step(heater))
    }

    /// Power and speed of a fan.
    pub fn fan(&self, output: FanOutput) -> FanStatus {
        self.0.as_ref().map_or_else(FanStatus::default, |heat| heat.control.fan(output))
    }

    /// The first fan at full power that turns too slowly.
    pub fn stalled_fan(&self) -> Option<FanOutput> {
        self.0.as_ref().and_then(|heat| heat.control.stalled_fan())
    }

    /// Switches all heaters off immediately.
    pub fn all_off(&mut self) {
        if let Some(Controlled { control, parts }) = &mut self.0 {
            control.all_off();
            for heater in Heater::ALL {
                parts.set_power(heater, 0.0);
            }
        }
    }

    /// Switches all heaters off immediately, and the power supply if it can be switched.
    pub fn halt(&mut self) {
        self.all_off();
        if let Some(Controlled { control, parts }) = &mut self.0 {
            control.halt();
            if HAS_SUPPLY {
                parts.set_supply(false);
            }
        }
    }

    /// Switches the power supply.
    pub fn set_supply(&mut self, on: bool) {
        if let Some(heat) = &mut self.0
            && HAS_SUPPLY
        {
            heat.control.set_supply(on);
        }
    }

    /// True if the power supply is on.
    pub fn is_supply_on(&self) -> bool {
        !HAS_SUPPLY || self.0.as_ref().and_then(|heat| heat.control.supply()).unwrap_or(true)
    }

    /// Restarts after a fault (M999).
    ///
    /// # Errors
    /// A fault persists, and all heaters stay off.
    pub fn restart(&mut self) -> Result<(), HeatFault> {
        self.0.as_mut().map_or(Ok(()), |heat| heat.control.restart())
    }
}
