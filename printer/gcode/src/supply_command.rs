//! Commands that switch the power supply.

/// M80 and M81.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SupplyCommand {
    /// M80: on.
    On,
    /// M80 S: a query.
    Report,
    /// M81: off, when motion has ended.
    Off {
        /// S: not before the nozzle has cooled.
        when_cool: bool,
    },
}
