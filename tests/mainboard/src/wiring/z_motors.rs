//! The motors that lift Z, as the profile names them.

use std::collections::BTreeMap;

use serde::Deserialize;

/// A motor that lifts Z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ZMotor {
    /// Place: x and y, mm.
    pub place_mm: Option<[f64; 2]>,
    /// True if it runs the other way round; of `z` the driver's signals say so.
    pub inverted: bool,
}

#[derive(Deserialize, Default)]
pub(super) struct RawZMotors {
    #[serde(default)]
    motors: BTreeMap<String, RawZMotor>,
}

impl RawZMotors {
    /// All of them, by the board's names.
    pub(super) fn all(self) -> BTreeMap<String, ZMotor> {
        self.motors.into_iter().map(|(name, motor)| (name, motor.into())).collect()
    }
}

#[derive(Deserialize)]
struct RawZMotor {
    x: Option<f64>,
    y: Option<f64>,
    #[serde(default)]
    inverted: bool,
}

impl From<RawZMotor> for ZMotor {
    fn from(RawZMotor { x, y, inverted }: RawZMotor) -> Self {
        Self { place_mm: x.zip(y).map(|(x, y)| [x, y]), inverted }
    }
}
