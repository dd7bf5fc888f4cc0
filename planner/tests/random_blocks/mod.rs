//! Random blocks as slicers make them.

use ferrostep_planner::inner_ends::InnerEnds;
use ferrostep_planner::{Acceleration, Block, Speed};

use crate::random::Random;

/// Blocks as slicers make them: stretches of alike ones, of which some differ, with corners of all kinds.
pub struct Blocks {
    length_mm: f64,
    /// Nominal speed, mm/s.
    pub nominal: f64,
    /// Acceleration, mm/s^2.
    pub acceleration: f64,
    curved: bool,
    /// Steps of Y for one of X, and of the extruder for a millimetre.
    slope: f64,
    filament: f64,
}

impl Blocks {
    /// Of one kind, to begin with.
    pub fn new(random: &mut Random) -> Self {
        Self {
            length_mm: random.magnitude(0.001, 50.0),
            nominal: random.magnitude(0.5, 500.0),
            acceleration: random.magnitude(20.0, 20_000.0),
            curved: random.next().is_multiple_of(2),
            slope: 2.0 * random.share() - 1.0,
            filament: if random.next().is_multiple_of(3) { 0.0 } else { 30.0 * random.share() - 10.0 },
        }
    }

    /// The next block, and the most that the corner before it allows.
    pub fn next(&mut self, random: &mut Random) -> (Block, Speed) {
        if random.next().is_multiple_of(40) {
            *self = Self::new(random);
        }
        let length_mm = self.length_mm * if random.next().is_multiple_of(3) { random.magnitude(0.1, 3.0) } else { 1.0 };
        let nominal = self.nominal * if random.next().is_multiple_of(10) { random.magnitude(0.2, 1.5) } else { 1.0 };
        let acceleration =
            self.acceleration * if random.next().is_multiple_of(30) { random.magnitude(0.5, 2.0) } else { 1.0 };
        let block = Block {
            // Some have no step.
            steps: [1.0, self.slope, -0.05].map(|share| (length_mm * 80.0 * share + random.share()).floor() as i32),
            extruder_256ths: (length_mm * 256.0 * self.filament) as i32,
            length_10nm: ((length_mm * 1e5) as u32).max(1),
            nominal: Speed::from_mm_per_s(nominal).max(Speed(1)),
            acceleration: Acceleration::from_mm_per_s2(acceleration),
            line: 1,
            ends_move: true,
            inner_ends: InnerEnds::NONE,
        };
        let corner = match (self.curved, random.next().is_multiple_of(20)) {
            (true, false) => f32::INFINITY,
            _ if random.next().is_multiple_of(10) => 0.0,
            _ => random.magnitude(1.0, 2.0 * nominal * nominal + 2.0) as f32,
        };
        (block, Speed::from_mm_per_s(f64::from(corner).sqrt()))
    }
}
