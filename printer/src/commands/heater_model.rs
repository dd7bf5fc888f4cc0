//! M306: the models of heaters.

use ferrostep_gcode::{Decimal, HeaterModelWords, Real, Reply};
use ferrostep_hal_shim::Heater;

use crate::commands::tuning::table_of;
use crate::error::CommandError;
use crate::heat::model::HeaterModel;
use crate::heat::step_response::{StepProgress, hottest_start};
use crate::part::Part;
use crate::ports::{Heating, Ports, Replies};
use crate::printer::Printer;
use crate::settings::bounds::in_range;

/// Sets a constant from a line's word, if given.
fn set(constant: &mut f32, word: char, value: Option<Decimal>, [low, high]: [f64; 2]) -> Result<(), CommandError> {
    if let Some(value) = value {
        *constant = in_range(word, value.to_f64(), low, high)? as f32;
    }
    Ok(())
}

/// The constants in the order of their words: P, C, R, A, F, H.
fn shown(model: &HeaterModel) -> [Real; 6] {
    [
        model.power_w,
        model.capacity_j_per_k,
        model.sensor_per_s,
        model.loss_w_per_k,
        model.fanned_loss_w_per_k,
        model.filament_j_per_k_mm,
    ]
    .map(|constant| Real::short(constant, 5))
}

impl<P: Ports> Printer<'_, P> {
    /// Returns true if a model controls a heater.
    pub(crate) fn has_model(&self, heater: Heater) -> bool {
        <P::Heating as Heating>::Models::PRESENT && self.heating.model(heater).is_some()
    }

    /// Executes M306 with these words. Returns the heater whose model is to be measured.
    pub(crate) fn heater_model(&mut self, words: &str) -> Result<Option<Heater>, CommandError> {
        self.needs(self.fitted.equipment.heaters, "heaters")?;
        let words = match HeaterModelWords::read(words) {
            Ok(words) => words,
            Err(error) => {
                self.replies.say(format_args!("echo:M306: {error}"));
                return Err(CommandError::HeaterControl("M306 has unreadable words: nothing has changed"));
            }
        };
        if self.is_for_no_tool(words.tool) {
            return Err(CommandError::InvalidTool(words.tool.unwrap_or_default().into()));
        }
        let heater = if words.of_bed { Heater::Bed } else { self.nozzle_of(words.tool)? };
        let Some(before) = self.heating.model(heater) else {
            return Err(CommandError::HeaterControl(
                "M306: a PID loop controls this heater: M301, M303 and M304, or give it a control_model in the profile",
            ));
        };
        if words.tunes {
            return Ok(Some(heater));
        }
        let mut model = before;
        set(&mut model.power_w, 'P', words.power, HeaterModel::POWER_W)?;
        set(&mut model.capacity_j_per_k, 'C', words.capacity, HeaterModel::CAPACITY_J_PER_K)?;
        set(&mut model.sensor_per_s, 'R', words.sensor, HeaterModel::SENSOR_PER_S)?;
        set(&mut model.loss_w_per_k, 'A', words.loss, HeaterModel::LOSS_W_PER_K)?;
        if heater.is_nozzle() {
            let [_, most] = HeaterModel::LOSS_W_PER_K;
            set(&mut model.fanned_loss_w_per_k, 'F', words.fanned_loss, HeaterModel::LOSS_W_PER_K)?;
            // The fan can only increase the loss.
            in_range('F', model.fanned_loss_w_per_k.into(), model.loss_w_per_k.into(), most)?;
            set(&mut model.filament_j_per_k_mm, 'H', words.filament, HeaterModel::FILAMENT_J_PER_K_MM)?;
        } else if words.fanned_loss.or(words.filament).is_some() {
            return Err(CommandError::HeaterControl("M306: the bed has neither F nor H: no fan, no filament"));
        } else {
            model.fanned_loss_w_per_k = model.loss_w_per_k;
        }
        if words == (HeaterModelWords { of_bed: words.of_bed, tool: words.tool, ..HeaterModelWords::default() }) {
            self.report_model(heater, &model);
        } else {
            self.heating.set_model(heater, model);
        }
        Ok(None)
    }

    /// Reports the line that sets this model.
    fn report_model(&self, heater: Heater, model: &HeaterModel) {
        let [p, c, r, a, f, h] = shown(model);
        match heater {
            Heater::Nozzle | Heater::Nozzle1 => {
                let extruder = u8::from(heater == Heater::Nozzle1);
                self.replies.say(format_args!("echo:M306 E{extruder} P{p} C{c} R{r} A{a} F{f} H{h}"));
            }
            Heater::Bed | Heater::Chamber => self.replies.say(format_args!("echo:M306 E-1 P{p} C{c} R{r} A{a}")),
        }
    }

    /// Refuses a step response if the heater is still hot.
    pub(crate) fn may_step(&self, heater: Heater, target: f32) -> Result<(), CommandError> {
        if self.has_model(heater) && self.heating.status(heater).celsius > hottest_start(target) {
            return Err(CommandError::HeaterControl(
                "M306 T, and M303 of a heater with a model, begin with a cold heater: let it cool (M104 S0, M140 S0), then send it again",
            ));
        }
        Ok(())
    }

    /// Reports the model that a step response has found, as M306 and as keys of the profile, and
    /// uses it if `uses`.
    pub(crate) fn end_step(&mut self, heater: Heater, step: Option<StepProgress>, uses: bool) {
        let Some(StepProgress::Found(model)) = step else {
            return self.replies.send(Reply::Text("MPC Autotune ended by M108, the model stays"));
        };
        self.replies.send(Reply::Text("MPC Autotune finished!"));
        self.report_model(heater, &model);
        let name = table_of(heater);
        let [power, capacity, sensor, loss, fanned, filament] = shown(&model);
        self.replies.say(format_args!("echo:[{name}.control_model]: power_w = {power}, capacity_j_per_k = {capacity}"));
        self.replies.say(format_args!("echo:[{name}.control_model]: loss_w_per_k = {loss}, sensor_per_s = {sensor}"));
        if heater.is_nozzle() {
            self.replies.say(format_args!(
                "echo:[{name}.control_model]: fanned_loss_w_per_k = {fanned}, filament_j_per_k_mm = {filament}"
            ));
        }
        if uses {
            self.heating.set_model(heater, model);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
