//! M955 and M956: the records of an accelerometer.

use crate::error::CommandError;
use crate::ports::accelerometer::{Accelerometer, AccelerometerSettings};
use crate::ports::{Ports, Replies};
use crate::printer::Printer;

impl<'a, P: Ports> Printer<'a, P> {
    /// Gives the machine an accelerometer.
    pub fn set_accelerometer(&mut self, accelerometer: &'a dyn Accelerometer) {
        self.fitted.accelerometer = Some(accelerometer);
    }

    /// The accelerometer, or an error without one.
    pub(crate) fn needed_accelerometer(&self) -> Result<&'a dyn Accelerometer, CommandError> {
        let what = "accelerometer: a board has one where its file has the table [accelerometer], the printer of `serve` where its \
                    profile has frame.x and frame.y";
        self.fitted.accelerometer.ok_or(CommandError::NotEquipped(what))
    }

    /// M955.
    pub(crate) fn accelerometer_settings(
        &self,
        rate_hz: Option<u16>,
        resolution_bits: Option<u8>,
    ) -> Result<(), CommandError> {
        let settings = self.needed_accelerometer()?.set(rate_hz, resolution_bits)?;
        let AccelerometerSettings { name, rate_hz, resolution_bits } = settings;
        self.replies.say(format_args!(
            "Accelerometer 0 type {name} with orientation 20 samples at {rate_hz}Hz with {resolution_bits}-bit resolution"
        ));
        Ok(())
    }
}
