//! Marlin's sensors.

use toml::Value;

use crate::import::sensor::beta_table;

/// A sensor by Marlin's number.
pub(super) fn sensor(number: f64) -> Option<Value> {
    match number as i64 {
        1 => Some("epcos-100k".into()),
        5 => Some("semitec-104gt-2".into()),
        // Those that Marlin's list says a beta of 3950 of.
        11 | 13 | 30 | 60 | 61 => Some(beta_table(100_000.0, 3950.0)),
        // With a pull-up resistor of 4.7 kilohms, as a profile has it; 1010 is that with 1 kilohm.
        1047 => Some("pt1000".into()),
        _ => None,
    }
}
