//! The Prusa MINI's motor drivers, for the tests of the lines to them.

use ferrostep_tmc2209::{DriverSettings, DriverWiring, MOTORS};

/// The Prusa MINI's X.
pub const MINI: DriverSettings = DriverSettings {
    current_ma: 350,
    hold_percent: 100,
    microsteps: 16,
    interpolate: true,
    stealth_chop: true,
    spread_cycle_above_mm_per_s: 0,
    steps_per_mm: 100.0,
    stall_threshold: 130,
    both_edges: false,
};

/// Addresses of the drivers on their line.
pub const MINI_WIRING: [DriverWiring; MOTORS] = [
    DriverWiring { line: 0, address: 1, sense_milliohm: 220 },
    DriverWiring { line: 0, address: 3, sense_milliohm: 220 },
    DriverWiring { line: 0, address: 0, sense_milliohm: 220 },
    DriverWiring { line: 0, address: 2, sense_milliohm: 220 },
];
