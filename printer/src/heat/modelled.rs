//! A heater that may be controlled by its model.

use super::model::{Cooling, HeaterModel, ModelLoop};
use super::step_response::{StepProgress, StepResponse};

/// A model with its loop, and how it is found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Modelled {
    /// `None`: a PID loop controls the heater.
    model: Option<HeaterModel>,
    control: ModelLoop,
    step: Option<StepResponse>,
}

impl Modelled {
    /// Without a model.
    pub const NONE: Self = Self { model: None, control: ModelLoop::new(), step: None };

    /// Whether it, and no PID loop, controls the heater.
    pub const fn is_in_force(&self) -> bool {
        self.model.is_some()
    }

    /// The model.
    pub const fn model(&self) -> Option<HeaterModel> {
        self.model
    }

    /// Sets the model; what the loop knows of the temperatures stays.
    pub const fn set_model(&mut self, model: HeaterModel) {
        self.model = Some(model);
    }

    /// Begins a step response.
    pub fn begin_step(&mut self, has_fan: bool) {
        self.step = self.model.map(|model| StepResponse::new(model, has_fan));
    }

    /// Forgets a step response.
    pub const fn end_step(&mut self) {
        self.step = None;
    }

    /// Whether there is a step response, at work or at its end.
    pub const fn has_step(&self) -> bool {
        self.step.is_some()
    }

    /// Whether a step response wants the part-cooling fan at full power.
    pub fn wants_fan(&self) -> bool {
        self.step.as_ref().is_some_and(StepResponse::wants_fan)
    }

    /// How far a step response has come.
    pub fn step(&self) -> Option<StepProgress> {
        self.step.as_ref().map(StepResponse::progress)
    }

    /// Power for the next sample, 0 to 1. `power` was that of the last. A step response that ends sets the target to 0.
    pub fn power(&mut self, celsius: f32, target: &mut f32, power: f32, cooling: &Cooling) -> f32 {
        let Some(model) = &self.model else { return 0.0 };
        // The loop goes on beside a step response: what it knows stays true.
        let wanted = self.control.power(model, celsius, *target, power, cooling);
        let Some(step) = &mut self.step else { return wanted };
        let wanted = step.power(celsius, *target, power);
        if step.has_ended() {
            *target = 0.0;
            return 0.0;
        }
        wanted
    }
}
