//! The signal of a supply that fails.

/// The signal, as a profile describes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SupplySignal {
    /// True if it is low while the supply fails.
    pub failing_is_low: bool,
    /// Time for which it must report the failure, ms.
    pub debounce_ms: u16,
    /// Rise of the nozzle from the print when its place is kept, units of 10 nm; 0: it stays.
    pub rise_10nm: i64,
}
