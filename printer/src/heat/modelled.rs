//! The heaters that are controlled by their models.

use ferrostep_hal_shim::Heater;

use super::filament_speed::FilamentSpeed;
use super::model::{Cooling, HeaterModel, ModelLoop};
use super::step_response::{StepProgress, StepResponse};

/// The nozzle's and the bed's models, one step response, and the filament.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Models {
    /// `None`: a PID loop controls the heater.
    models: [Option<HeaterModel>; 2],
    loops: [ModelLoop; 2],
    step: Option<(Heater, StepResponse)>,
    filament: FilamentSpeed,
}

impl Models {
    /// None.
    pub const NONE: Self =
        Self { models: [None; 2], loops: [ModelLoop::new(); 2], step: None, filament: FilamentSpeed::NONE };

    /// The model that controls a heater.
    pub fn model(&self, heater: Heater) -> Option<HeaterModel> {
        self.models.get(heater.index()).copied()?
    }

    /// Sets the model of the nozzle or the bed. The loop of another one begins anew: what it had found is that model's error.
    pub fn set_model(&mut self, heater: Heater, model: HeaterModel) {
        if let (Some(place), Some(control)) = (self.models.get_mut(heater.index()), self.loops.get_mut(heater.index()))
            && *place != Some(model)
        {
            *place = Some(model);
            *control = ModelLoop::new();
        }
    }

    /// Takes where the extruder is, see [`FilamentSpeed::note`].
    pub fn note_filament(&mut self, pushed_um: i32) {
        self.filament.note(pushed_um);
    }

    /// Begins the step response of a heater that has a model.
    pub fn begin_step(&mut self, heater: Heater, has_fan: bool) {
        self.step = self.model(heater).map(|model| (heater, StepResponse::new(model, has_fan)));
    }

    /// Forgets a step response.
    pub const fn end_step(&mut self) {
        self.step = None;
    }

    /// Whether a step response wants the part-cooling fan at full power.
    pub fn wants_fan(&self) -> bool {
        self.step.as_ref().is_some_and(|(_, step)| step.wants_fan())
    }

    /// How far the step response of a heater has come.
    pub fn step(&self, heater: Heater) -> Option<StepProgress> {
        self.step.as_ref().filter(|(of, _)| *of == heater).map(|(_, step)| step.progress())
    }

    /// Power for the next sample of a heater with a model, 0 to 1; `None` for another. `power` was that of the last. Filament takes heat
    /// only from a nozzle that is the selected one (`melts`). A step response that ends sets the target to 0.
    pub fn power(
        &mut self,
        heater: Heater,
        celsius: f32,
        target: &mut f32,
        power: f32,
        (fan_power, melts): (u8, bool),
    ) -> Option<f32> {
        let model = self.model(heater)?;
        let control = self.loops.get_mut(heater.index())?;
        let Some((_, step)) = self.step.as_mut().filter(|(of, _)| *of == heater) else {
            let filament_mm_per_s = if melts { self.filament.mm_per_s() } else { 0.0 };
            let cooling = Cooling { fan_power, filament_mm_per_s };
            return Some(control.power(&model, celsius, *target, power, &cooling));
        };
        let wanted = step.power(control, celsius, *target, power);
        if step.has_ended() {
            *target = 0.0;
            *control = ModelLoop::new();
        }
        Some(wanted)
    }
}
