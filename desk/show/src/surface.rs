//! The measured surface of the bed, which Z follows.

use std::fmt;

/// Height of Z's motor above the plan's Z at a place of the motors, mm: of X, Y and Z, in mm.
pub struct Surface(Box<dyn Fn([f64; 3]) -> f64>);

impl Surface {
    /// A surface by its height at a place.
    pub fn new(height_mm: impl Fn([f64; 3]) -> f64 + 'static) -> Self {
        Self(Box::new(height_mm))
    }

    /// The place that was planned, from the motors' place.
    pub(crate) fn planned_mm(&self, place_mm: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = place_mm;
        [x, y, z - (self.0)(place_mm)]
    }
}

impl fmt::Debug for Surface {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("Surface")
    }
}
