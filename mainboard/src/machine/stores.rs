//! What the firmware stores to peripherals, for whoever wants to know in which order.

use serde::{Deserialize, Serialize};

/// A store to a peripheral's register.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Store {
    /// When, ns.
    pub at_ns: u64,
    /// The register.
    pub address: u32,
    /// What was stored, as wide as the store was.
    pub value: u32,
}
