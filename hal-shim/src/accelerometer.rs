//! An accelerometer whose samples wait in its own memory until they are read.

/// Reason why an accelerometer gives no samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AccelerometerFault {
    /// The chip's bus has failed.
    Bus,
    /// The identity register holds another number: the chip is missing or another one, or
    /// a wire is loose.
    Identity {
        /// The number that was read.
        read: u8,
        /// The chip's.
        expected: u8,
    },
    /// A setting that was written reads otherwise.
    Settings,
    /// The chip reports more samples than its memory holds.
    Count(u8),
    /// The chip answers, and takes no samples.
    Silent,
}

/// Samples that wait in an accelerometer's memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WaitingSamples {
    /// Number of samples.
    pub samples: u8,
    /// The memory has been full since a sample was read last: samples may be missing after these.
    pub overflowed: bool,
}

/// A type of accelerometer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AccelerometerType {
    /// Name by its maker.
    pub name: &'static str,
    /// Samples a second that it can take, rising.
    pub rates_hz: &'static [u16],
    /// Bits that a sample can have, rising.
    pub resolution_bits: &'static [u8],
}

/// An accelerometer with a memory. Each call takes some ten to a hundred microseconds on its bus.
pub trait AccelerometerChip {
    /// Type of the chip.
    const TYPE: AccelerometerType;

    /// Asks for its identity.
    ///
    /// # Errors
    /// It does not answer as it should.
    fn check(&mut self) -> Result<(), AccelerometerFault>;

    /// Empties its memory and begins to sample, at a rate and with a resolution of its
    /// [type](Self::TYPE).
    ///
    /// # Errors
    /// It does not answer as it should; then it may be sampling or not.
    fn begin(&mut self, rate_hz: u16, resolution_bits: u8) -> Result<(), AccelerometerFault>;

    /// Ends sampling. A chip that is gone has ended as well.
    fn end(&mut self);

    /// Returns the number of samples in its memory.
    ///
    /// # Errors
    /// The chip does not answer as it should.
    fn waiting(&mut self) -> Result<WaitingSamples, AccelerometerFault>;

    /// Takes the oldest sample: accelerations along the chip's x, y and z, millionths of
    /// standard gravity.
    ///
    /// # Errors
    /// Its bus has failed.
    fn take(&mut self) -> Result<[i32; 3], AccelerometerFault>;
}
