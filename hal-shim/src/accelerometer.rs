//! Accelerometers that hold samples in their own memory until they are read.

/// Reason why an accelerometer gives no samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AccelerometerFault {
    /// A bus transfer failed.
    Bus,
    /// The identity register holds an unexpected number: the chip is missing or of another type, or
    /// a wire is loose.
    Identity {
        /// Number read from the chip.
        read: u8,
        /// Number of the expected chip.
        expected: u8,
    },
    /// A written setting reads back differently.
    Settings,
    /// The chip reports more samples than its memory holds.
    Count(u8),
    /// The chip answers but takes no samples.
    Silent,
}

/// Samples waiting in an accelerometer's memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WaitingSamples {
    /// Number of samples.
    pub samples: u8,
    /// True if the memory has been full since a sample was last read: samples may be missing after
    /// these.
    pub overflowed: bool,
}

/// A type of accelerometer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AccelerometerType {
    /// Manufacturer's name for the chip.
    pub name: &'static str,
    /// Supported sample rates, Hz, ascending.
    pub rates_hz: &'static [u16],
    /// Supported sample resolutions, bits, ascending.
    pub resolution_bits: &'static [u8],
}

/// An accelerometer with a memory. Each call occupies the bus for roughly ten to a hundred
/// microseconds.
pub trait AccelerometerChip {
    /// Type of the chip.
    const TYPE: AccelerometerType;

    /// Checks the identity of the chip.
    ///
    /// # Errors
    /// The chip's answer is missing or wrong.
    fn check(&mut self) -> Result<(), AccelerometerFault>;

    /// Empties the memory and begins to sample, at a rate and with a resolution of the chip's
    /// [type](Self::TYPE).
    ///
    /// # Errors
    /// The chip's answer is missing or wrong; it may or may not be sampling then.
    fn begin(&mut self, rate_hz: u16, resolution_bits: u8) -> Result<(), AccelerometerFault>;

    /// Ends sampling. A chip that no longer answers counts as ended.
    fn end(&mut self);

    /// Returns the number of samples in the memory.
    ///
    /// # Errors
    /// The chip's answer is missing or wrong.
    fn waiting(&mut self) -> Result<WaitingSamples, AccelerometerFault>;

    /// Takes the oldest sample: accelerations along the chip's x, y and z axes, in millionths of
    /// standard gravity.
    ///
    /// # Errors
    /// A bus transfer failed.
    fn take(&mut self) -> Result<[i32; 3], AccelerometerFault>;
}
