//! An accelerometer, and its records for a host.

pub(crate) mod recorder;

use core::fmt;
use ferrostep_hal_shim::{AccelerometerFault, AccelerometerType};

use crate::error::CommandError;

/// An accelerometer at the nozzle or the bed. Machines may do without. Whoever owns it samples at
/// its rate, whatever commands do, and sends the events as lines.
pub trait Accelerometer: fmt::Debug {
    /// Sets rate and resolution, the nearest that it has, where they are given; returns those in
    /// force. A change ends a record.
    ///
    /// # Errors
    /// [`CommandError::OutOfRange`], [`CommandError::Accelerometer`]; the settings are unchanged.
    fn set(&self, rate_hz: Option<u16>, resolution_bits: Option<u8>) -> Result<AccelerometerSettings, CommandError>;
    /// Begins a record of this many samples, now or when X, Y or Z moves next, and ends the one
    /// before; of 0 only that.
    ///
    /// # Errors
    /// [`CommandError::Accelerometer`]; the record before has ended.
    fn record(&self, samples: u16, at_next_move: bool) -> Result<(), CommandError>;
}

/// Type and settings of an accelerometer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AccelerometerSettings {
    /// Type of the chip.
    pub name: &'static str,
    /// Samples a second.
    pub rate_hz: u16,
    /// Bits of a sample.
    pub resolution_bits: u8,
}

impl AccelerometerSettings {
    /// Settings of a type that has not been set: the values nearest to these.
    pub fn new(of: &AccelerometerType, rate_hz: u16, resolution_bits: u8) -> Self {
        let unset = Self { name: of.name, rate_hz, resolution_bits };
        unset.nearest(of, Some(rate_hz), Some(resolution_bits))
    }

    /// Returns the settings with another rate and resolution, the nearest that the type has,
    /// where they are given.
    ///
    /// # Errors
    /// [`CommandError::OutOfRange`]: beyond the type's least and most.
    pub fn changed(
        self,
        of: &AccelerometerType,
        rate_hz: Option<u16>,
        resolution_bits: Option<u8>,
    ) -> Result<Self, CommandError> {
        in_range('S', rate_hz.map(f64::from), of.rates_hz.iter().copied().map(f64::from))?;
        in_range('R', resolution_bits.map(f64::from), of.resolution_bits.iter().copied().map(f64::from))?;
        Ok(self.nearest(of, rate_hz, resolution_bits))
    }

    fn nearest(self, of: &AccelerometerType, rate_hz: Option<u16>, resolution_bits: Option<u8>) -> Self {
        let rate = rate_hz.and_then(|asked| of.rates_hz.iter().copied().min_by_key(|known| known.abs_diff(asked)));
        let bits = resolution_bits
            .and_then(|asked| of.resolution_bits.iter().copied().min_by_key(|known| known.abs_diff(asked)));
        Self { rate_hz: rate.unwrap_or(self.rate_hz), resolution_bits: bits.unwrap_or(self.resolution_bits), ..self }
    }
}

/// Refuses a value outside the range of the available ones.
fn in_range(word: char, value: Option<f64>, known: impl Iterator<Item = f64> + Clone) -> Result<(), CommandError> {
    match (value, known.clone().next(), known.last()) {
        (Some(value), Some(minimum), Some(maximum)) if !(minimum..=maximum).contains(&value) => {
            Err(CommandError::OutOfRange { word, value, minimum, maximum })
        }
        _ => Ok(()),
    }
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
        /// Samples that were lost because they were not taken in time, or at least how
        /// often some were.
        overflows: u32,
    },
    /// A record has ended before its time and is of no use.
    Failed(RecordFault),
}

/// Reason why a record has ended before its time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecordFault {
    /// The chip gives no samples.
    Chip(AccelerometerFault),
    /// The host has not read its lines.
    Unread,
}

/// Text of the reason why an accelerometer gives no samples, and the cure.
pub(crate) struct FaultText(pub AccelerometerFault);

impl fmt::Display for FaultText {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("the accelerometer ")?;
        match self.0 {
            AccelerometerFault::Bus => out.write_str("cannot be asked, its bus has failed")?,
            AccelerometerFault::Identity { read, expected } => {
                write!(out, "does not answer: its identity reads {read:#04x}, expected {expected:#04x}")?;
            }
            AccelerometerFault::Settings => out.write_str("does not keep its settings")?,
            AccelerometerFault::Count(samples) => write!(out, "does not answer: it says that {samples} samples wait")?,
            AccelerometerFault::Silent => out.write_str("takes no samples")?,
        }
        out.write_str(": check its plug, its wires and its supply")
    }
}

/// Millionths of standard gravity as g with five decimals. In integers: a board writes ten
/// thousand a second.
struct Gravities(i32);

impl fmt::Display for Gravities {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let units = (self.0.unsigned_abs() + 5) / 10;
        let sign = if self.0 < 0 && units > 0 { "-" } else { "" };
        write!(out, "{sign}{}.{:05}", units / 100_000, units % 100_000)
    }
}

impl fmt::Display for RecordEvent {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Begun => out.write_str("Sample,X,Y,Z"),
            Self::Sample { number, micro_g: [x, y, z] } => {
                write!(out, "{number},{},{},{}", Gravities(*x), Gravities(*y), Gravities(*z))
            }
            Self::Ended { rate_hz, overflows } => write!(out, "Rate {rate_hz}, overflows {overflows}"),
            Self::Failed(RecordFault::Chip(fault)) => write!(out, "echo:record ended: {}", FaultText(*fault)),
            Self::Failed(RecordFault::Unread) => {
                out.write_str("echo:record ended: its lines were not read, send M956 again")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_g_with_five_decimals() {
        for (micro_g, expected) in [
            ([0, 4, -4], "7,0.00000,0.00000,0.00000"),
            ([5, -5, 3_906], "7,0.00001,-0.00001,0.00391"),
            ([1_000_000, -999_995, 15_996_094], "7,1.00000,-1.00000,15.99609"),
            ([-16_000_000, i32::MAX, i32::MIN], "7,-16.00000,2147.48365,-2147.48365"),
        ] {
            assert_eq!(RecordEvent::Sample { number: 7, micro_g }.to_string(), expected);
        }
    }
}
