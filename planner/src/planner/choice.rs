//! Choice of the methods that make the steps, the filters and the pressure advance.

use crate::kinematics::{Geometry, Kinematics, StepsPerMm};
use crate::limits::ExtruderAdvance;
use crate::look_ahead::SpeedLaw;
use crate::methods::{ChoiceError, MotionMethods};
use crate::motion_choice::{AccelerationProfile, MotionChoice};
use crate::pressure_advance::{AdvanceLaw, PressureAdvance};
use crate::ring::{Marker, RingMemory};
use crate::s_curve::{Jerk, Jerks};
use crate::shaping::{ShaperError, Shaping};
use crate::surface::SurfaceBounds;
use crate::tolerance::PATH_TOLERANCE_MM;

use super::Planner;
use super::move_error::MoveError;

impl<S: RingMemory, M: MotionMethods> Planner<S, M> {
    /// The methods that make the steps.
    pub fn motion_choice(&self) -> &MotionChoice {
        &self.choice
    }

    /// Sets the methods that make the steps.
    ///
    /// # Errors
    /// [`ChoiceError`]; nothing has changed then.
    pub fn set_motion_choice(&mut self, choice: &MotionChoice) -> Result<(), ChoiceError> {
        check_methods::<M>(choice, self.rules.geometry.kinematics)?;
        choice.pressure_advance.check().map_err(ChoiceError::PressureAdvance)?;
        let [least, most] = PATH_TOLERANCE_MM;
        // NaN is in no range.
        if !choice.path_tolerance_mm.is_none_or(|tolerance_mm| tolerance_mm >= least && tolerance_mm <= most) {
            return Err(ChoiceError::Parameter);
        }
        let shaping = self.shaping_of(choice).map_err(ChoiceError::Shaper)?;
        if !self.is_idle() {
            return Err(ChoiceError::InMotion);
        }
        self.choice = *choice;
        self.set_shaping(&shaping);
        self.set_methods()
    }

    /// Sets the filters, as chosen.
    // Kept out of the function that sets the methods: each takes much of the stack.
    #[inline(never)]
    fn set_shaping(&mut self, shaping: &Shaping) {
        let Self { choice, .. } = *self;
        self.shaping = *shaping;
        self.shaped.set_shaping(shaping);
        let is_s_curve = choice.acceleration == AccelerationProfile::SCurve;
        self.rules.set_shaped_for(self.shaped.length_ticks(), is_s_curve, choice.pressure_advance.above.is_some());
        self.rules.set_tolerance(choice.path_tolerance_mm, shaping);
        self.advance_moves_to_come();
        self.shaped.set_advance(self.advance_law());
    }

    /// The step pattern and the law of speeds, as chosen.
    #[inline(never)]
    fn set_methods(&mut self) -> Result<(), ChoiceError> {
        self.rules.pattern = M::pattern(&self.choice, self.rules.geometry.kinematics)?;
        self.interpolator.set_pattern(self.rules.pattern);
        let law = speed_law::<M>(&self.choice)?;
        self.rule = match law {
            SpeedLaw::Other(rule) => Some(rule),
            SpeedLaw::Trapezoid | SpeedLaw::SCurve(_) | SpeedLaw::SCurveBlockByBlock(_) => None,
        };
        self.queue.look_ahead(&law);
        Ok(())
    }

    /// The filters of a choice, if this machine can have them.
    fn shaping_of(&self, choice: &MotionChoice) -> Result<Shaping, ShaperError> {
        let shaping = Shaping::new(&choice.shapers, choice.smooth_time_s, &choice.pressure_advance)?;
        if !shaping.is_active() {
            return Ok(shaping);
        }
        if !choice.is_standard() {
            return Err(ShaperError::Methods);
        }
        if shaping.smooth_ticks > 0 && choice.acceleration == AccelerationProfile::SCurve {
            return Err(ShaperError::SmoothSCurve);
        }
        let Geometry { kinematics, steps_per_mm, .. } = self.rules.geometry;
        let are_equal = |axis: usize| {
            let motors = kinematics.motors_of_axis(axis);
            let mut steps_per_mm = steps_per_mm.iter().enumerate().filter(|(motor, _)| motors >> motor & 1 == 1);
            let first = steps_per_mm.next();
            steps_per_mm.all(|(_, other)| first.is_none_or(|(_, first)| first == other))
        };
        if !(are_equal(0) && are_equal(1)) { Err(ShaperError::UnequalMotors) } else { Ok(shaping) }
    }

    /// Sets how far the extruder runs ahead from the moves taken so far on, without a stop.
    /// `false`, and nothing has changed: it needs other filters or more room in them, and so a
    /// standstill and [`Self::set_motion_choice`]. Of an advance that has been set the average
    /// stays, whatever it is changed to, none included.
    ///
    /// # Errors
    /// [`MoveError::NoRoom`]; nothing has changed then.
    pub fn set_pressure_advance(&mut self, advance: &PressureAdvance) -> Result<bool, MoveError> {
        let present = self.choice.pressure_advance;
        let keeps_filters = self.shaping.advance_ticks > 0 && advance.smooth_time_s == present.smooth_time_s;
        let adds_knee = advance.above.is_some() && present.above.is_none();
        if !keeps_filters || adds_knee || advance.check().is_err() {
            return Ok(false);
        }
        if *advance != present {
            if !(self.close_open_block() && self.queue.push_marker(Marker::PressureAdvance(*advance))) {
                return Err(MoveError::NoRoom);
            }
            self.choice.pressure_advance = *advance;
            self.advance_moves_to_come();
        }
        Ok(true)
    }

    /// Leaves the extruder what its advance needs in the moves to come.
    fn advance_moves_to_come(&mut self) {
        let advance = self.shaping.extruder_advance(&self.choice.pressure_advance);
        self.rules.set_advance(advance.unwrap_or(ExtruderAdvance::NONE));
    }

    /// The present advance, for the extruder of this machine.
    pub(super) fn advance_law(&self) -> AdvanceLaw {
        let [.., steps_per_mm] = self.rules.geometry.steps_per_mm;
        AdvanceLaw::new(&self.choice.pressure_advance, steps_per_mm.to_f64())
    }

    /// Steps of the extruder in a millimetre of filament.
    pub fn extruder_steps_per_mm(&self) -> StepsPerMm {
        let [.., extruder] = self.rules.geometry.steps_per_mm;
        extruder
    }

    /// Sets the steps of the extruder in a millimetre of filament, at standstill: what it has
    /// pushed stays pushed.
    ///
    /// # Errors
    /// [`ChoiceError::InMotion`]; nothing has changed.
    pub fn set_extruder_steps_per_mm(&mut self, steps_per_mm: StepsPerMm) -> Result<(), ChoiceError> {
        if !self.is_idle() {
            return Err(ChoiceError::InMotion);
        }
        self.rules.set_extruder_steps_per_mm(steps_per_mm);
        self.position.extruder.set_steps_per_mm(steps_per_mm);
        self.shaped.set_advance(self.advance_law());
        Ok(())
    }

    /// Limits later moves to what Z needs to follow a surface; `None` while it follows none.
    pub fn set_surface(&mut self, surface: Option<SurfaceBounds>) {
        self.rules.set_surface(surface);
    }

    /// Lets the moves to come follow the plan itself, or the filters again: a move that a sensor
    /// ends is to stop where it is. From the next standstill on.
    pub fn set_unshaped(&mut self, is_unshaped: bool) {
        self.is_unshaped = is_unshaped;
    }

    /// Lets every block begin and end without acceleration under an S-curve instead of giving
    /// neighbours one law, for comparison. Returns `false` and changes nothing if moves are queued
    /// or the profile is another.
    pub fn plan_block_by_block(&mut self) -> bool {
        match speed_law::<M>(&self.choice) {
            Ok(SpeedLaw::SCurve(jerks)) if self.is_idle() => {
                self.queue.look_ahead(&SpeedLaw::SCurveBlockByBlock(jerks));
                true
            }
            _ => false,
        }
    }
}

/// Checks that the chosen methods are compiled in and fit the kinematics.
#[inline(never)]
fn check_methods<M: MotionMethods>(choice: &MotionChoice, kinematics: Kinematics) -> Result<(), ChoiceError> {
    speed_law::<M>(choice)?;
    M::pattern(choice, kinematics)?;
    Ok(())
}

/// Speed law of a choice.
pub(super) fn speed_law<M: MotionMethods>(choice: &MotionChoice) -> Result<SpeedLaw<M::Rule>, ChoiceError> {
    if let Some(rule) = M::rule(choice)? {
        return Ok(SpeedLaw::Other(rule));
    }
    Ok(match choice.acceleration {
        AccelerationProfile::SCurve => {
            let jerk = |mm_per_s3| Jerk::from_mm_per_s3(mm_per_s3).ok_or(ChoiceError::Parameter);
            let (path, filament) = (jerk(choice.jerk_mm_per_s3)?, jerk(choice.filament_jerk_mm_per_s3)?);
            SpeedLaw::SCurve(Jerks { path, filament })
        }
        // The papers' laws have come as a rule.
        AccelerationProfile::Trapezoid | AccelerationProfile::SCurveTable | AccelerationProfile::SCurveFiveSegments => {
            SpeedLaw::Trapezoid
        }
    })
}
