//! The desk's heaters: their models, and the control that runs on every board.

use std::cell::RefCell;

use ferrostep_hal_shim::{FanOutput, Heater, ThermalBoard};
use ferrostep_printer::heat::{HeatControl, HeatFault, HeaterModel, RelayProgress, SAMPLE_MS, StepProgress};
use ferrostep_printer::{FanDemand, FanStatus, HeaterStatus, Heating, PidGains, Profile};
use ferrostep_virtual_board::{HeaterFailure, VirtualHeaters};

use super::heat_at_rest::{HeatAtRest, HeaterSample};

/// Interval of heater control.
const SAMPLE_NS: u64 = SAMPLE_MS as u64 * 1_000_000;

/// Heaters, thermometers, fans, and their control.
pub struct DeskHeat {
    control: HeatControl,
    heaters: VirtualHeaters,
    at_rest: HeatAtRest,
    /// True to step heaters at rest as well; false for estimates, whose cost must not grow with
    /// the print's time.
    steps_at_rest: bool,
    samples: u64,
    next_ns: u64,
}

impl DeskHeat {
    /// Cold heaters.
    pub fn new(profile: &Profile, steps_at_rest: bool) -> Self {
        let mut heaters = profile.virtual_heaters();
        // The first temperatures are there before the first command.
        let mut control: HeatControl = HeatControl::new(profile.heaters(), profile.fans, &mut heaters);
        control.set_models(|heater| profile.control_model(heater));
        control.set_nozzle_fan(profile.tool_fan());
        if let Some(supply) = profile.power_supply {
            control.set_supply(supply.on_at_start);
            heaters.set_supply(supply.on_at_start);
        }
        Self { control, heaters, at_rest: HeatAtRest::default(), steps_at_rest, samples: 0, next_ns: SAMPLE_NS }
    }

    /// The models.
    pub fn heaters(&self) -> &VirtualHeaters {
        &self.heaters
    }

    /// Samples of the models so far. Only they can make an estimate's cost grow with
    /// the print's time.
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// Stops a fan whatever its power, or repairs it.
    pub fn set_fan_stuck(&mut self, fan: FanOutput, is_stuck: bool) {
        self.at_rest.disturb();
        self.heaters.set_fan_stuck(fan, is_stuck);
    }

    /// Makes a heater fail, or mends it.
    pub fn set_failure(&mut self, heater: Heater, failure: Option<HeaterFailure>) {
        self.at_rest.disturb();
        self.heaters.set_failure(heater, failure);
    }

    /// Advances the heaters' time, with this demand for the fans. Failed heaters continue to cool.
    ///
    /// # Errors
    /// A heater or thermometer has failed; all heaters are off.
    pub fn pass_to(&mut self, now_ns: u64, fans: FanDemand) -> Result<(), HeatFault> {
        self.control.set_fan_demand(fans);
        let mut outcome = Ok(());
        while self.next_ns <= now_ns {
            if !self.steps_at_rest {
                // A step response counts samples while it holds its target.
                if Heater::ALL.into_iter().any(|heater| self.control.step(heater).is_some()) {
                    self.at_rest.disturb();
                }
                if self.at_rest.is_at_rest() {
                    self.next_ns += (now_ns - self.next_ns) / SAMPLE_NS * SAMPLE_NS + SAMPLE_NS;
                    break;
                }
                let sample = |heater| HeaterSample {
                    celsius: self.heaters.true_celsius(heater),
                    target_celsius: self.control.status(heater).target_celsius,
                };
                self.at_rest.note(Heater::ALL.map(sample));
            }
            self.next_ns += SAMPLE_NS;
            self.samples += 1;
            self.heaters.advance(SAMPLE_MS as f32 * 1e-3);
            if let Err(fault) = self.control.update(&mut self.heaters) {
                outcome = Err(fault);
            }
        }
        outcome
    }

    /// Switches all heaters off.
    pub fn all_off(&mut self) {
        self.at_rest.disturb();
        self.control.all_off();
        for heater in Heater::ALL {
            self.heaters.set_power(heater, 0.0);
        }
    }

    /// Switches all heaters off, and the power supply if that can be switched.
    pub fn halt(&mut self) {
        self.control.halt();
        self.all_off();
        if let Some(on) = self.control.supply() {
            self.heaters.set_supply(on);
        }
    }
}

/// The desk's heaters, seen from the command side.
#[derive(Clone, Copy)]
pub struct DeskHeating<'a>(pub &'a RefCell<DeskHeat>);

impl Heating for DeskHeating<'_> {
    type Supply = ferrostep_printer::Present;
    type Models = ferrostep_printer::Present;

    fn set_target(&mut self, heater: Heater, celsius: f32) {
        let heat = &mut *self.0.borrow_mut();
        let before = heat.control.status(heater).target_celsius;
        heat.control.set_target(heater, celsius);
        if heat.control.status(heater).target_celsius != before {
            heat.at_rest.disturb();
        }
    }

    fn chamber_is_heated(&self) -> Option<bool> {
        self.0.borrow().control.chamber_is_heated()
    }

    fn nozzle(&self) -> Heater {
        self.0.borrow().control.nozzle()
    }

    fn select_nozzle(&mut self, heater: Heater) {
        self.0.borrow_mut().control.select_nozzle(heater);
    }

    fn has_nozzles(&self) -> bool {
        self.0.borrow().control.has_nozzles()
    }

    fn status(&self, heater: Heater) -> HeaterStatus {
        self.0.borrow().control.status(heater)
    }

    fn all_off(&mut self) {
        self.0.borrow_mut().all_off();
    }

    fn set_supply(&mut self, on: bool) {
        let heat = &mut *self.0.borrow_mut();
        heat.at_rest.disturb();
        heat.control.set_supply(on);
    }

    fn is_supply_on(&self) -> bool {
        self.0.borrow().control.supply().unwrap_or(true)
    }

    fn halt(&mut self) {
        self.0.borrow_mut().halt();
    }

    fn gains(&self, heater: Heater) -> PidGains {
        self.0.borrow().control.gains(heater)
    }

    fn set_gains(&mut self, heater: Heater, gains: PidGains) {
        let heat = &mut *self.0.borrow_mut();
        heat.at_rest.disturb();
        heat.control.set_gains(heater, gains);
    }

    fn begin_relay(&mut self, heater: Heater, celsius: f32, cycles: u8, has_fan: bool) {
        let heat = &mut *self.0.borrow_mut();
        heat.at_rest.disturb();
        heat.control.begin_relay(heater, celsius, cycles, has_fan);
    }

    fn relay(&self, heater: Heater) -> Option<RelayProgress> {
        self.0.borrow().control.relay(heater)
    }

    fn model(&self, heater: Heater) -> Option<HeaterModel> {
        self.0.borrow().control.model(heater)
    }

    fn set_model(&mut self, heater: Heater, model: HeaterModel) {
        let heat = &mut *self.0.borrow_mut();
        heat.at_rest.disturb();
        heat.control.set_model(heater, model);
    }

    fn begin_step(&mut self, heater: Heater, celsius: f32, has_fan: bool) {
        let heat = &mut *self.0.borrow_mut();
        heat.at_rest.disturb();
        heat.control.begin_step(heater, celsius, has_fan);
    }

    fn step(&self, heater: Heater) -> Option<StepProgress> {
        self.0.borrow().control.step(heater)
    }

    fn fan(&self, output: FanOutput) -> FanStatus {
        self.0.borrow().control.fan(output)
    }

    fn stalled_fan(&self) -> Option<FanOutput> {
        self.0.borrow().control.stalled_fan()
    }

    fn restart(&mut self) -> Result<(), HeatFault> {
        let heat = &mut *self.0.borrow_mut();
        heat.at_rest.disturb();
        heat.control.restart()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// Though the heater is at rest while its power is measured.
    #[test]
    fn a_step_response_ends_in_an_estimate_too() {
        let model =
            "[nozzle.control_model]\npower_w = 40\ncapacity_j_per_k = 10\nloss_w_per_k = 0.1\nsensor_per_s = 0.2\n";
        let text = format!("{}\n{model}", ferrostep_profiles::builtin_text("cartesian").unwrap());
        let profile = ferrostep_profiles::parse(&text, "test.toml").unwrap();
        let heat = RefCell::new(DeskHeat::new(&profile, false));
        let mut heating = DeskHeating(&heat);
        heating.begin_step(Heater::Nozzle, 200.0, true);
        for second in 1..900 {
            heat.borrow_mut().pass_to(second * 1_000_000_000, FanDemand::default()).unwrap();
        }
        let Some(StepProgress::Found(found)) = heating.step(Heater::Nozzle) else {
            panic!("{:?}", heating.step(Heater::Nozzle))
        };
        // The built-in profile's nozzle on the virtual board, without a lag.
        assert!((found.capacity_j_per_k / 12.0 - 1.0).abs() < 0.1, "{found:?}");
        assert!((found.fanned_loss_w_per_k / 0.13 - 1.0).abs() < 0.1, "{found:?}");
        assert_eq!(heating.status(Heater::Nozzle).target_celsius, 0.0);
    }
}
