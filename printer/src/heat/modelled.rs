//! The heaters that are controlled by their models.

use ferrostep_hal_shim::Heater;

use super::filament_speed::FilamentSpeed;
use super::model::{Cooling, HeaterModel, ModelLoop};
use super::step_response::{StepProgress, StepResponse};
use crate::part::Part;

/// A heater that may be controlled by a model.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Modelled {
    /// `None`: a PID loop controls it.
    model: Option<HeaterModel>,
    control: ModelLoop,
}

impl Modelled {
    const NONE: Self = Self { model: None, control: ModelLoop::new() };
}

/// The models of the nozzle, the bed and, with several nozzles (`T`), the second one's; one step
/// response, and the filament.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Models<T: Part> {
    /// The nozzle's and the bed's, by their index.
    usual: [Modelled; 2],
    further: T::Of<Modelled>,
    step: Option<(Heater, StepResponse)>,
    filament: FilamentSpeed,
}

impl<T: Part> Models<T> {
    /// No models in force.
    pub fn none() -> Self {
        Self { usual: [Modelled::NONE; 2], further: T::of(Modelled::NONE), step: None, filament: FilamentSpeed::NONE }
    }

    fn of(&self, heater: Heater) -> Option<&Modelled> {
        match heater {
            Heater::Nozzle1 => T::get(&self.further),
            _ => self.usual.get(heater.index()),
        }
    }

    /// The model that controls a heater.
    pub fn model(&self, heater: Heater) -> Option<HeaterModel> {
        self.of(heater)?.model
    }

    /// Sets the model of a nozzle or the bed. The loop of another model begins anew: its findings
    /// were that model's errors.
    pub fn set_model(&mut self, heater: Heater, model: HeaterModel) {
        if let Some(place) = place::<T>(&mut self.usual, &mut self.further, heater)
            && place.model != Some(model)
        {
            *place = Modelled { model: Some(model), control: ModelLoop::new() };
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

    /// The heater whose step response wants its part-cooling fan at full power.
    pub fn wants_fan(&self) -> Option<Heater> {
        self.step.as_ref().filter(|(_, step)| step.wants_fan()).map(|(heater, _)| *heater)
    }

    /// Progress of a heater's step response.
    pub fn step(&self, heater: Heater) -> Option<StepProgress> {
        self.step.as_ref().filter(|(of, _)| *of == heater).map(|(_, step)| step.progress())
    }

    /// Power for the next sample of a heater with a model, 0 to 1; `None` for another. `power` was
    /// that of the last. Filament takes heat only from a nozzle that is the selected one (`melts`).
    /// A step response that ends sets the target to 0.
    pub fn power(
        &mut self,
        heater: Heater,
        celsius: f32,
        target: &mut f32,
        power: f32,
        (fan_power, melts): (u8, bool),
    ) -> Option<f32> {
        let Modelled { model, control } = place::<T>(&mut self.usual, &mut self.further, heater)?;
        let model = (*model)?;
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

/// The place of a heater's model.
fn place<'a, T: Part>(
    usual: &'a mut [Modelled; 2],
    further: &'a mut T::Of<Modelled>,
    heater: Heater,
) -> Option<&'a mut Modelled> {
    match heater {
        Heater::Nozzle1 => T::get_mut(further),
        _ => usual.get_mut(heater.index()),
    }
}
