//! Marlin's sensors.

use toml::Value;

use super::Reading;
use crate::sensor::{beta_table, points};

/// Reason for which no sensor is kept.
pub(super) const NO_SENSOR: &str = "no sensor that a profile knows: profiles have thermistors by three points or by beta, and PT1000s at a pull-up resistor";

/// Marlin's sensors that always say the same.
pub(super) fn is_dummy(number: f64) -> bool {
    [998.0, 999.0].contains(&number)
}

impl Reading<'_> {
    /// A sensor by Marlin's number, with its pull-up resistor where that is another than the usual
    /// one; `own` begins the names of definitions of one's own sensor.
    pub(super) fn sensor_of(&mut self, number: f64, own: &str, heater: &str) -> Option<Value> {
        if number == 1000.0 {
            return self.own_sensor(own, heater);
        }
        let number = number as i64;
        let value = sensor(match number {
            51 => 1,
            55 => 5,
            1010 | 1022 => 1047,
            other => other,
        })?;
        let pull_up_ohm = match number {
            51 | 55 | 1010 => Some(1000.0),
            99 => Some(10_000.0),
            1022 => Some(2200.0),
            _ => None,
        };
        if let Some(ohm) = pull_up_ohm {
            self.draft.put(&format!("{heater}.pull_up_ohm"), ohm);
        }
        Some(value)
    }

    /// The sensor that its own definitions describe.
    fn own_sensor(&mut self, own: &str, heater: &str) -> Option<Value> {
        let name = |what: &str| format!("{own}_{what}");
        let beta = self.number(&name("BETA"))?;
        let ohm = self.number(&name("RESISTANCE_25C_OHMS"))?;
        let path = format!("{heater}.sensor");
        let value = beta_table(ohm, beta);
        for what in ["BETA", "RESISTANCE_25C_OHMS"] {
            self.keep(&name(what), &path, value.clone(), "");
        }
        self.keep_number(&name("PULLUP_RESISTOR_OHMS"), &format!("{heater}.pull_up_ohm"), |ohm| ohm);
        Some(value)
    }
}

/// A sensor with the usual pull-up resistor, by Marlin's number.
fn sensor(number: i64) -> Option<Value> {
    Some(match number {
        1 | 331 | 332 => "epcos-100k".into(),
        5 => "semitec-104gt-2".into(),
        // Within 1.3 degrees of their tables.
        11 | 60 => beta_table(100_000.0, 3950.0),
        // Three lines of each table, with which its others agree to 1 degree: beta of the data
        // sheet reads up to 29 degrees too much at 230.
        2 => points([(40.0, 97_700.0), (190.0, 975.5), (240.0, 366.1)]),
        13 => points([(40.0, 52_263.0), (140.0, 2107.0), (250.0, 204.8)]),
        14 => points([(55.0, 26_756.0), (85.0, 8449.7), (125.0, 2195.1)]),
        30 => points([(25.0, 93_520.0), (75.0, 10_247.0), (121.0, 2146.0)]),
        61 => points([(30.0, 79_735.0), (150.0, 1717.0), (250.0, 231.1)]),
        67 => points([(110.0, 28_491.0), (190.0, 4502.3), (310.0, 665.4)]),
        75 => points([(50.0, 36_424.8), (120.0, 3768.0), (140.0, 2218.1)]),
        99 => points([(20.0, 125_374.0), (90.0, 8648.8), (140.0, 2101.1)]),
        // Honeywell's data sheet of 135-104LAG-J01: 100 kilohms, 3974 K. Within 1.3 degrees of
        // Marlin's table up to 220, and 3.4 at 299.
        7 => beta_table(100_000.0, 3974.0),
        // PT1000 with a pull-up resistor of 4.7 kilohms, as a profile has it; 1010 is
        // that with 1 kilohm.
        1047 => "pt1000".into(),
        _ => return None,
    })
}
