//! Settings that were read: checked together, then applied.

use ferrostep_hal_shim::Heater;
use ferrostep_planner::{AxisShaper, MotionChoice, ShaperKind, StepsPerMm, smooth_ticks};
use ferrostep_tmc2209::{SECOND_EXTRUDER, motor_name};

use super::{PartsOf, Stored};
use crate::motion::axis_names::AXIS_NAMES;
use crate::motion::skew::Skew;
use crate::part::Part;
use crate::ports::{Heating, Motion, Ports, Replies};
use crate::printer::Printer;
use crate::settings::stored::values::{ToolValues, Values, advance_of};

impl<P: Ports> Printer<'_, P> {
    /// Replaces values that do not fit each other by the profile's.
    pub(super) fn check(&self, stored: &mut Stored<PartsOf<P>>) {
        let Stored { values, faults, .. } = stored;
        let mut of_profile = self.profile_values();
        let smooth_time_s = self.motion.motion_choice().smooth_time_s;
        let mut mend = |what: &str, name: char| {
            self.replies
                .say(format_args!("echo:settings: {what}{name} as stored is not possible: the profile's is used"));
            *faults = faults.saturating_add(1);
        };
        if !self.are_extruder_steps(0, values.extruder_steps_per_mm) {
            values.extruder_steps_per_mm = of_profile.extruder_steps_per_mm;
            mend("steps_per_mm.", 'e');
        }
        if let (Some(tool), Some(other)) = (values.tool(), of_profile.tool()) {
            if !self.are_extruder_steps(1, tool.extruder_steps_per_mm) {
                tool.extruder_steps_per_mm = other.extruder_steps_per_mm;
                mend("tools.t1.steps_per_mm", ' ');
            }
            if advance_of(&tool.advance).check().is_err() {
                tool.advance = other.advance;
                mend("tools.t1.pressure_advance", ' ');
            }
        }
        if let (Some(ToolValues { driver: Some(driver), .. }), Some(other)) = (values.tool(), of_profile.tool())
            && self.fitted.drivers.is_some_and(|drivers| drivers.check(SECOND_EXTRUDER, driver).is_err())
        {
            *driver = other.driver.unwrap_or(*driver);
            mend("tools.t1.driver", ' ');
        }
        for (axis, (shaper, other)) in values.shapers.iter_mut().zip(of_profile.shapers).enumerate() {
            if !is_possible(shaper, smooth_time_s) {
                *shaper = other;
                mend("input_shaper.", AXIS_NAMES[axis].to_ascii_lowercase());
            }
        }
        if let (Some(backlash), Some(other)) = (values.backlash(), of_profile.backlash())
            && backlash.shared_axis(self.profile.kinematics).is_some()
        {
            backlash.play_mm = other.play_mm;
            mend("backlash.play_mm", ' ');
        }
        let of_nozzle = values.model_of(Heater::Nozzle);
        if let Some(model) = of_nozzle
            && !model.is_possible()
        {
            *model = self.profile.control_models[Heater::Nozzle.index()].unwrap_or(*model);
            mend("nozzle.control_model", ' ');
        }
        if <P::Heating as Heating>::Models::PRESENT
            && let Some(ToolValues { model: Some(model), .. }) = values.tool()
            && !model.is_possible()
        {
            *model = self.profile.control_model(Heater::Nozzle1).unwrap_or(*model);
            mend("tools.t1.nozzle.control_model", ' ');
        }
        if values.pressure_advance().check().is_err() {
            values.advance = of_profile.advance;
            mend("pressure_advance", ' ');
        }
        for (motor, (driver, other)) in values.drivers.iter_mut().zip(of_profile.drivers).enumerate() {
            if let (Some(settings), Some(drivers)) = (&*driver, self.fitted.drivers)
                && drivers.check(motor, settings).is_err()
            {
                *driver = other;
                mend("drivers.", AXIS_NAMES[motor].to_ascii_lowercase());
            }
        }
        if values.probe_offset_10nm.is_some_and(|offset_10nm| self.probe_finds_home(offset_10nm).is_err()) {
            values.probe_offset_10nm = of_profile.probe_offset_10nm;
            mend("homing.probe_offset_mm", ' ');
        }
        let offsets = values.probe_offset_10nm.as_mut().zip(of_profile.probe_offset_10nm);
        if let Some((offset_10nm, other_10nm)) = offsets {
            for (axis, (length_10nm, other_10nm)) in offset_10nm.iter_mut().zip(other_10nm).enumerate() {
                let [least, most] = self.probe_range_10nm(axis);
                // The profile's own value is not checked.
                if !(least..=most).contains(length_10nm) && *length_10nm != other_10nm {
                    *length_10nm = other_10nm;
                    mend("homing.probe_offset_mm.", AXIS_NAMES[axis].to_ascii_lowercase());
                }
            }
        }
    }

    /// Applies checked settings, at standstill. Filters and advance are left out: they are returned
    /// if they change.
    // The parts need much stack, one after the other.
    #[inline(always)]
    pub(super) fn put_in_force(&mut self, values: &Values<PartsOf<P>>) -> Option<MotionChoice> {
        self.put_drivers_in_force(values);
        if let Some(gains) = &values.gains {
            for (heater, gains) in Heater::ALL.iter().zip(gains) {
                self.heating.set_gains(*heater, *gains);
            }
        }
        if let Some(models) = <P::Heating as Heating>::Models::get(&values.models) {
            for (heater, model) in Heater::ALL.iter().zip(models) {
                if let Some(mut model) = *model {
                    if *heater == Heater::Bed {
                        // No fan blows at this heater.
                        model.fanned_loss_w_per_k = model.loss_w_per_k;
                    }
                    self.heating.set_model(*heater, model);
                }
            }
        }
        self.put_motion_in_force(values)
    }

    #[inline(never)]
    fn put_drivers_in_force(&mut self, values: &Values<PartsOf<P>>) {
        let Some(bank) = self.fitted.drivers else { return };
        let of_tool = match <P::Motion as Motion>::Tools::get(&values.tool) {
            Some(Some(ToolValues { driver: Some(driver), .. })) => Some((SECOND_EXTRUDER, *driver)),
            _ => None,
        };
        let usual = values.drivers.iter().enumerate().filter_map(|(motor, settings)| Some((motor, (*settings)?)));
        for (motor, settings) in usual.chain(of_tool) {
            let before = bank.report(motor).map(|report| report.settings);
            if Some(settings) != before && bank.set(motor, settings).is_err() {
                self.replies.say(format_args!("echo:settings: drivers.{} cannot be set", motor_name(motor)));
            }
        }
    }

    #[inline(never)]
    fn put_motion_in_force(&mut self, values: &Values<PartsOf<P>>) -> Option<MotionChoice> {
        let (mut extruder_steps_per_mm, mut pressure_advance) =
            (StepsPerMm::nearest(values.extruder_steps_per_mm), values.pressure_advance());
        if let Some(Some(of_tool)) = <P::Motion as Motion>::Tools::get(&values.tool) {
            let first = (extruder_steps_per_mm, pressure_advance);
            let second = (StepsPerMm::nearest(of_tool.extruder_steps_per_mm), advance_of(&of_tool.advance));
            (extruder_steps_per_mm, pressure_advance) = self.put_tools_in_force(first, second, of_tool.offset_10nm);
            if let Some(gains) = of_tool.gains {
                self.heating.set_gains(Heater::Nozzle1, gains);
            }
            if let Some(model) = of_tool.model {
                self.heating.set_model(Heater::Nozzle1, model);
            }
        }
        // Cannot fail at standstill.
        let _always_works = self.motion.set_extruder_steps_per_mm(extruder_steps_per_mm);
        self.motion.set_limits(values.limits);
        self.interpreter.modal.retraction = values.retraction;
        self.interpreter.modal.set_home_offset(values.home_offset_10nm);
        self.set_skew(Skew::of_factors(values.skew_factors));
        if let Some(Some(backlash)) = <P::Motion as Motion>::Backlash::get(&values.backlash) {
            self.motion.set_backlash(backlash);
        }
        self.modes.filament_10nm = values.filament_10nm;
        if let Some(offset_10nm) = values.probe_offset_10nm {
            self.interpreter.modal.probe_offset_10nm = offset_10nm;
        }
        let choice = self.motion.motion_choice();
        let wanted = MotionChoice { shapers: values.shapers, pressure_advance, ..choice };
        (wanted != choice).then_some(wanted)
    }
}

/// Returns true if the filter is possible, or is off: then only its numbers are stored.
fn is_possible(shaper: &AxisShaper, smooth_time_s: Option<f64>) -> bool {
    shaper.kind == ShaperKind::None || smooth_ticks(smooth_time_s).and_then(|ticks| shaper.kernel_beside(ticks)).is_ok()
}
