//! Random blocks as slicers make them, in plain numbers: the planner's own tests use them, so they
//! know nothing of the planner.

use crate::Random;

/// A block before it is planned.
#[derive(Clone, Copy, Debug)]
pub struct SlicerBlock {
    /// Steps of X, Y and Z; some blocks have none.
    pub steps: [i32; 3],
    /// Steps of the extruder, in 256ths.
    pub extruder_256ths: i32,
    /// Length, in units of 10 nm; at least one.
    pub length_10nm: u32,
    /// Nominal speed.
    pub nominal_mm_per_s: f64,
    /// Acceleration.
    pub acceleration_mm_per_s2: f64,
    /// Speed limit of the corner before it; infinity if the path continues straight.
    pub corner_mm_per_s: f64,
}

/// Blocks as slicers make them: stretches of equal ones with some that differ, and
/// corners of all kinds.
#[derive(Clone, Debug)]
pub struct SlicerBlocks {
    length_mm: f64,
    /// Nominal speed.
    pub nominal_mm_per_s: f64,
    /// Acceleration.
    pub acceleration_mm_per_s2: f64,
    curved: bool,
    /// Steps of Y for one of X, and of the extruder for a millimetre.
    slope: f64,
    filament: f64,
}

impl SlicerBlocks {
    /// Starts with blocks of one kind.
    pub fn new(random: &mut Random) -> Self {
        Self {
            length_mm: random.magnitude(0.001, 50.0),
            nominal_mm_per_s: random.magnitude(0.5, 500.0),
            acceleration_mm_per_s2: random.magnitude(20.0, 20_000.0),
            curved: random.bits().is_multiple_of(2),
            slope: 2.0 * random.share() - 1.0,
            filament: if random.bits().is_multiple_of(3) { 0.0 } else { 30.0 * random.share() - 10.0 },
        }
    }

    /// The next block.
    pub fn next(&mut self, random: &mut Random) -> SlicerBlock {
        if random.bits().is_multiple_of(40) {
            *self = Self::new(random);
        }
        let length_mm = self.length_mm * if random.bits().is_multiple_of(3) { random.magnitude(0.1, 3.0) } else { 1.0 };
        let nominal_mm_per_s =
            self.nominal_mm_per_s * if random.bits().is_multiple_of(10) { random.magnitude(0.2, 1.5) } else { 1.0 };
        let acceleration_mm_per_s2 = self.acceleration_mm_per_s2
            * if random.bits().is_multiple_of(30) { random.magnitude(0.5, 2.0) } else { 1.0 };
        let steps = [1.0, self.slope, -0.05].map(|share| (length_mm * 80.0 * share + random.share()).floor() as i32);
        let corner_squared = match (self.curved, random.bits().is_multiple_of(20)) {
            (true, false) => f32::INFINITY,
            _ if random.bits().is_multiple_of(10) => 0.0,
            _ => random.magnitude(1.0, 2.0 * nominal_mm_per_s * nominal_mm_per_s + 2.0) as f32,
        };
        SlicerBlock {
            steps,
            extruder_256ths: (length_mm * 256.0 * self.filament) as i32,
            length_10nm: ((length_mm * 1e5) as u32).max(1),
            nominal_mm_per_s,
            acceleration_mm_per_s2,
            corner_mm_per_s: f64::from(corner_squared).sqrt(),
        }
    }
}
