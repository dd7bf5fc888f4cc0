//! Recorded stores of the firmware to peripherals, in order.

use serde::{Deserialize, Serialize};

/// A store to a peripheral's register and its immediate repetitions: a program that only feeds its
/// watchdog stores millions of times a second.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Store {
    /// First store, ns.
    pub at_ns: u64,
    /// Last repetition, ns.
    pub until_ns: u64,
    /// Number of stores in a row.
    pub times: u32,
    /// The register's address.
    pub address: u32,
    /// The value, as wide as the store.
    pub value: u32,
}
