//! Values of several axes at once.

use ferrostep_checked_toml::{Checker, Range};

use crate::ProfileError;
use crate::file::{Xyz, Xyze};

/// What [`Checker`] does for one number, for some.
pub trait CheckAxes {
    /// The values of X, Y and Z.
    fn three(&self, key: &str, values: &Xyz, range: Range) -> Result<[f64; 3], ProfileError>;
    /// The values of X, Y, Z and the extruder.
    fn four(&self, key: &str, values: &Xyze, range: Range) -> Result<[f64; 4], ProfileError>;
}

impl CheckAxes for Checker<'_> {
    fn three(&self, key: &str, values: &Xyz, range: Range) -> Result<[f64; 3], ProfileError> {
        Ok([
            self.number(&format!("{key}.x"), &values.x, range)?,
            self.number(&format!("{key}.y"), &values.y, range)?,
            self.number(&format!("{key}.z"), &values.z, range)?,
        ])
    }

    fn four(&self, key: &str, values: &Xyze, range: Range) -> Result<[f64; 4], ProfileError> {
        Ok([
            self.number(&format!("{key}.x"), &values.x, range)?,
            self.number(&format!("{key}.y"), &values.y, range)?,
            self.number(&format!("{key}.z"), &values.z, range)?,
            self.number(&format!("{key}.e"), &values.e, range)?,
        ])
    }
}
