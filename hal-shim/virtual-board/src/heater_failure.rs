//! What can fail at a heater of the virtual board.

/// A failure of a heater or of its thermistor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeaterFailure {
    /// No power reaches the heater: a wire is off, or the cartridge burnt out.
    Dead,
    /// The heater is at full power whatever it is told: its transistor has failed as they do, closed.
    StuckOn,
    /// The thermistor's circuit is open.
    ThermistorOpen,
    /// The thermistor's circuit is shorted.
    ThermistorShorted,
    /// The thermistor has slipped out of its hole, and soon reads the air.
    ThermistorFellOut,
    /// The reading no longer changes: a converter, or its transfer to memory, stands still.
    ThermistorFrozen,
}
