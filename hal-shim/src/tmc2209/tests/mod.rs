//! The drivers' code against model chips: whole datagrams in virtual time, and levels of a wire.

mod bank;
mod wire;

use super::{DriverSettings, DriverWiring, MOTORS};

/// Settings of any driver.
pub(super) const SETTINGS: DriverSettings = DriverSettings {
    current_ma: 600,
    hold_percent: 50,
    microsteps: 16,
    interpolate: true,
    stealth_chop: true,
    stealth_until: 75,
    stall_threshold: 60,
    both_edges: false,
};

/// The Prusa MINI's X.
pub(super) const MINI: DriverSettings = DriverSettings {
    current_ma: 350,
    hold_percent: 100,
    microsteps: 16,
    interpolate: true,
    stealth_chop: true,
    stealth_until: 0,
    stall_threshold: 130,
    both_edges: false,
};

/// Its drivers' addresses on their line.
pub(super) const MINI_WIRING: [DriverWiring; MOTORS] = [
    DriverWiring { line: 0, address: 1, sense_milliohm: 220 },
    DriverWiring { line: 0, address: 3, sense_milliohm: 220 },
    DriverWiring { line: 0, address: 0, sense_milliohm: 220 },
    DriverWiring { line: 0, address: 2, sense_milliohm: 220 },
];
