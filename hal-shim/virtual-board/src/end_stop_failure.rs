//! Failures of the sensors that the virtual board's axes home with.

/// A failure of an axis's end stop, or of the probe at its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EndStopFailure {
    /// The signal never comes: a shorted wire, a switch that hangs, no sheet below a probe, a
    /// driver that never reports a stall. An approach ends at the frame, where the motor
    /// loses its steps.
    NeverTriggers,
    /// The signal is always there: a broken wire of a switch that opens, an input without a sensor.
    AlwaysTriggered,
    /// The pin of a probe does not come out, which raises the probe's alarm. A sensor
    /// without a pin works.
    PinStaysIn,
    /// The pin of a probe does not go in once it is out, which raises the probe's alarm. A sensor
    /// without a pin works.
    PinStaysOut,
}
