//! M955 and M956: an accelerometer, and its records for a host.

use core::fmt;

use ferrostep_gcode::Real;

use crate::error::CommandError;
use crate::ports::{Ports, Replies};
use crate::printer::Printer;

/// An accelerometer at the nozzle or the bed. Machines may do without. Whoever owns it samples at its rate, whatever commands do,
/// and sends the events as lines.
pub trait Accelerometer: fmt::Debug {
    /// Sets the rate, the nearest that it has, and the resolution, where they are given; returns what is in force. A change ends a
    /// record.
    ///
    /// # Errors
    /// [`CommandError::OutOfRange`]; nothing has changed.
    fn set(&self, rate_hz: Option<u16>, resolution_bits: Option<u8>) -> Result<AccelerometerSettings, CommandError>;
    /// Begins a record of this many samples, now or when X, Y or Z moves next, and ends the one before; of 0 only that.
    fn record(&self, samples: u16, at_next_move: bool);
    /// Takes the next event of the record.
    fn take_event(&self) -> Option<RecordEvent>;
}

/// What an accelerometer is and does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AccelerometerSettings {
    /// Its type.
    pub name: &'static str,
    /// Samples a second.
    pub rate_hz: u16,
    /// Bits of a sample.
    pub resolution_bits: u8,
}

/// A line of a record, in RepRapFirmware's form, which `ferrostep calibrate shaper` reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecordEvent {
    /// A record begins.
    Begun,
    /// A sample.
    Sample {
        /// Counted from 0.
        number: u16,
        /// Accelerations of X, Y and Z, millionths of standard gravity.
        micro_g: [i32; 3],
    },
    /// A record has ended.
    Ended {
        /// Samples a second.
        rate_hz: u16,
        /// Samples that were lost because they were not taken in time.
        overflows: u32,
    },
}

impl fmt::Display for RecordEvent {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Begun => out.write_str("Sample,X,Y,Z"),
            Self::Sample { number, micro_g: [x, y, z] } => {
                let [x, y, z] = [x, y, z].map(|micro_g| Real::fixed(f64::from(*micro_g) / 1e6, 5));
                write!(out, "{number},{x},{y},{z}")
            }
            Self::Ended { rate_hz, overflows } => write!(out, "Rate {rate_hz}, overflows {overflows}"),
        }
    }
}

impl<'a, P: Ports> Printer<'a, P> {
    /// The machine has an accelerometer.
    pub fn set_accelerometer(&mut self, accelerometer: &'a dyn Accelerometer) {
        self.accelerometer = Some(accelerometer);
    }

    /// The accelerometer.
    pub(crate) fn needed_accelerometer(&self) -> Result<&'a dyn Accelerometer, CommandError> {
        let what = "accelerometer (the virtual board of `serve` has one where its profile has frame.x and frame.y)";
        self.accelerometer.ok_or(CommandError::NotEquipped(what))
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
