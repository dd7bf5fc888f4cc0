//! M280, M401, M402 and BLTOUCH_DEBUG.

use ferrostep_gcode::PinCommand;

use crate::error::CommandError;
use crate::motion::homing::Homing;
use crate::part::Part;
use crate::ports::{Motion, Ports};
use crate::printer::Printer;
use crate::settings::profile::homing::BlTouch;

impl<P: Ports> Printer<'_, P> {
    /// The probe's control pin, if it has one.
    pub(crate) fn pin(&self) -> Option<BlTouch> {
        self.profile.bltouch.filter(|_| <P::Motion as Motion>::Servo::PRESENT)
    }

    /// M280, M401, M402, BLTOUCH_DEBUG, on a machine whose probe has a pin.
    pub(crate) async fn probe_pin(&mut self, command: PinCommand) -> Result<(), CommandError> {
        let Some(pin) = self.pin() else { return Ok(()) };
        self.motion.finish().await?;
        // Earlier manual commands may have put the pin anywhere.
        self.interpreter.modal.z.pin_is_in = false;
        let (motion, interpreter) = (&mut self.motion, &mut self.interpreter);
        Homing { motion, interpreter, drivers: self.fitted.drivers, line: self.lines.number }
            .tell_pin(pin, command)
            .await
    }
}
