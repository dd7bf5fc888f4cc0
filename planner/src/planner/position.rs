//! Position of the machine, in every unit that planning needs.

use crate::block::Block;
use crate::extruder::{Extruder, ExtruderPosition, rounded_steps};
use crate::kinematics::{Geometry, MAX_COORDINATE_10NM};

/// Position of the machine at the end of the last move taken.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Position {
    /// X, Y and Z, units of 10 nm.
    pub coordinates_10nm: [i32; 3],
    /// The motors of X, Y and Z.
    pub motor_steps: [i32; 3],
    pub extruder: Extruder,
}

/// Target of a move.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Target {
    pub coordinates_10nm: [i32; 3],
    pub motor_steps: [i32; 3],
    pub extruder: ExtruderPosition,
    /// X, Y and Z from the position before, units of 10 nm.
    pub vector_10nm: [i32; 3],
    /// Steps of the motors of X, Y and Z from the position before.
    pub steps: [i32; 3],
    /// Travel of the extruder from the position before, 1/256 steps.
    pub extruder_256ths: i32,
}

impl Position {
    /// All at zero.
    pub fn new(geometry: &Geometry) -> Self {
        let [.., extruder] = geometry.steps_per_mm;
        Self { coordinates_10nm: [0; 3], motor_steps: [0; 3], extruder: Extruder::new(extruder) }
    }

    /// Advances the position by a move.
    #[inline(always)]
    pub fn advance(&mut self, target: &Target) {
        self.coordinates_10nm = target.coordinates_10nm;
        self.motor_steps = target.motor_steps;
        self.extruder.set(target.extruder);
    }

    /// Sets the machine to these coordinates, units of 10 nm, each of which is held within reach.
    pub fn set(&mut self, position_10nm: [i64; 3], geometry: &Geometry) {
        self.coordinates_10nm = position_10nm.map(within_reach);
        self.motor_steps = geometry.motor_steps(self.coordinates_10nm.map(i64::from));
    }

    /// Sets the motors to these steps (X, Y, Z, extruder); the coordinates become the nearest to
    /// them. Returns the filament that was taken and not pushed, units of 0.1 nm.
    pub fn reset_to(&mut self, motor_steps: [i64; 4], geometry: &Geometry) -> i64 {
        let [x, y, z, extruder] = motor_steps;
        self.coordinates_10nm = geometry.position_10nm([x, y, z]).map(within_reach);
        self.motor_steps = [x, y, z].map(|steps| steps as i32);
        self.extruder.reset_to(extruder)
    }

    /// The motors at this position.
    pub fn motors(&self) -> MotorPosition {
        MotorPosition { steps: self.motor_steps, extruder_256ths: self.extruder.position_256ths() }
    }
}

/// The nearest coordinate within 5 m.
fn within_reach(coordinate_10nm: i64) -> i32 {
    coordinate_10nm.clamp(-MAX_COORDINATE_10NM, MAX_COORDINATE_10NM) as i32
}

/// Motor positions at the end of the last block that left look-ahead.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MotorPosition {
    /// X, Y and Z.
    pub steps: [i32; 3],
    pub extruder_256ths: i64,
}

impl MotorPosition {
    /// Advances the position by a block.
    #[inline(always)]
    pub fn advance(&mut self, block: &Block) {
        let ([x, y, z], [dx, dy, dz]) = (self.steps, block.steps);
        // Both sums stay within 31 and 63 bits, as do those of the moves taken.
        self.steps = [x.wrapping_add(dx), y.wrapping_add(dy), z.wrapping_add(dz)];
        self.extruder_256ths = self.extruder_256ths.wrapping_add(i64::from(block.extruder_256ths));
    }

    /// Steps of all four motors.
    pub fn motor_steps(&self) -> [i64; 4] {
        let [x, y, z] = self.steps.map(i64::from);
        [x, y, z, rounded_steps(self.extruder_256ths)]
    }
}
