//! Failures of the virtual board's heaters.

/// A failure of a heater or of its thermistor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeaterFailure {
    /// No power reaches the heater: a wire is off, or the cartridge burnt out.
    Dead,
    /// The heater is always at full power: its transistor has failed closed, as they do.
    StuckOn,
    /// The thermistor's circuit is open.
    ThermistorOpen,
    /// The thermistor's circuit is shorted.
    ThermistorShorted,
    /// The thermistor has slipped out of its hole, and soon reads the air.
    ThermistorFellOut,
    /// The reading no longer changes: a converter, or its transfer to memory, has stopped.
    ThermistorFrozen,
}
