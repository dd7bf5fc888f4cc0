//! G28, M18, M84 and M796.

use ferrostep_gcode::{AxisFlags, Reply};
use ferrostep_planner::{AccelerationProfile, ChoiceError, Interpolation, MotionChoice};

use crate::error::CommandError;
use crate::motion::homing::Homing;
use crate::ports::{Motion, Ports, Replies};
use crate::printer::Printer;

impl<P: Ports> Printer<'_, P> {
    /// G28.
    pub(crate) async fn home(&mut self, axes: AxisFlags) -> Result<(), CommandError> {
        self.needs(self.fitted.equipment.end_stops, "end stops")?;
        // The sensors' positions are measured with T0's nozzle.
        self.leave_tool_offset();
        let (motion, interpreter) = (&mut self.motion, &mut self.interpreter);
        let outcome =
            Homing { motion, interpreter, drivers: self.fitted.drivers, line: self.lines.number }.home(axes).await;
        self.take_tool_offset();
        outcome?;
        if axes.z || !(axes.x || axes.y) {
            self.end_begun_tower();
        }
        self.replies.send(Reply::Position(self.position()));
        Ok(())
    }

    /// Returns the axes that are not homed, among these or, if none is named, among all; `None` if
    /// all are homed.
    pub(crate) fn unhomed(&self, axes: AxisFlags) -> Option<AxisFlags> {
        let all = axes.is_empty();
        let [x, y, z] = self.interpreter.modal.homed;
        let axes = AxisFlags { x: (axes.x || all) && !x, y: (axes.y || all) && !y, z: (axes.z || all) && !z, e: false };
        (!axes.is_empty()).then_some(axes)
    }

    /// Executes M18 and M84: a motor without current may be turned by hand, so its axis is no
    /// longer homed.
    pub(crate) async fn disable_motors(&mut self, motors: u8) -> Result<(), CommandError> {
        self.motion.finish().await?;
        self.motion.set_motors_enabled(motors, false);
        self.interpreter.forget_home(motors);
        Ok(())
    }

    /// M796. Waits for standstill first.
    pub(crate) async fn choose_motion(
        &mut self,
        interpolation: Option<u8>,
        acceleration: Option<u8>,
    ) -> Result<(), CommandError> {
        let mut choice = self.motion.motion_choice();
        let number = |number: Option<u8>| number.map(usize::from);
        if let Some(chosen) = number(interpolation).and_then(|number| Interpolation::ALL.get(number)) {
            choice.interpolation = *chosen;
        }
        if let Some(chosen) = number(acceleration).and_then(|number| AccelerationProfile::ALL.get(number)) {
            choice.acceleration = *chosen;
        }
        if interpolation.is_some() || acceleration.is_some() {
            self.set_motion_choice(&choice).await?.map_err(CommandError::MotionChoice)?;
        } else {
            self.replies.send(Reply::MotionChoice {
                interpolation: choice.interpolation.name(),
                acceleration: choice.acceleration.name(),
            });
        }
        Ok(())
    }
    /// Sets the motion choice at standstill, for which it waits; an impossible choice is refused
    /// first.
    pub(crate) async fn set_motion_choice(
        &mut self,
        choice: &MotionChoice,
    ) -> Result<Result<(), ChoiceError>, CommandError> {
        let chosen = self.motion.set_motion_choice(choice);
        if chosen != Err(ChoiceError::InMotion) {
            return Ok(chosen);
        }
        self.motion.finish().await?;
        Ok(self.motion.set_motion_choice(choice))
    }
}
