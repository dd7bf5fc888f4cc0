//! The steps that a stop has dropped.

/// Steps that were queued when motion was stopped: as a signed sum, and as a total of both
/// directions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DroppedSteps {
    /// Forward minus backward steps, per motor.
    pub signed: [i32; 4],
    /// Total of steps in both directions, per motor.
    pub issued: [u32; 4],
    /// Time that the steps would have taken, in ticks of the motion clock, if the queue keeps that
    /// clock; otherwise 0.
    pub ticks: u64,
    /// True if a command or a fault stopped motion, not only the sensor of a homing axis.
    pub requested: bool,
}

impl DroppedSteps {
    /// Adds `count` events of the same motors: bit i of `axes` = motor i steps, of `directions` =
    /// it runs backwards.
    pub(super) fn add(&mut self, axes: u8, directions: u8, count: u32) {
        for (motor, (signed, issued)) in self.signed.iter_mut().zip(&mut self.issued).enumerate() {
            if axes >> motor & 1 != 0 {
                *issued = issued.wrapping_add(count);
                let backwards = directions >> motor & 1 != 0;
                let count = count as i32;
                *signed = signed.wrapping_add(if backwards { count.wrapping_neg() } else { count });
            }
        }
    }
}

/// Events that have not been played.
#[derive(Default)]
pub(super) struct Left {
    pub(super) dropped: DroppedSteps,
    /// Both edges: motors with an odd number of unplayed events, whose signals are at the other
    /// level.
    pub(super) odd_axes: u8,
}

impl Left {
    /// Both edges: adds `count` events that step these motors.
    pub(super) fn add_edges(&mut self, axes: u8, directions: u8, count: u32) {
        self.dropped.add(axes, directions, count);
        if count & 1 == 1 {
            self.odd_axes ^= axes;
        }
    }
}
