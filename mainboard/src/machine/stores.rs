//! What the firmware stores to peripherals, in order.

use serde::{Deserialize, Serialize};

/// A store to a peripheral's register, and how often in a row it was repeated: a program that does nothing else than feed its
/// watchdog does so millions of times a second.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Store {
    /// When, ns.
    pub at_ns: u64,
    /// When it was last repeated, ns.
    pub until_ns: u64,
    /// How often, in a row.
    pub times: u32,
    /// The register.
    pub address: u32,
    /// What was stored, as wide as the store was.
    pub value: u32,
}
