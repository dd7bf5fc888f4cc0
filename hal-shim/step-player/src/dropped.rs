//! The steps that a stop has dropped.

/// Steps that were in the queue when motion was stopped: signed by direction, and both
/// directions added.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DroppedSteps {
    /// Forwards minus backwards, a motor each.
    pub signed: [i32; 4],
    /// All, a motor each.
    pub issued: [u32; 4],
    /// Ticks of the motion clock that they would have taken, where the queue keeps
    /// that clock; else 0.
    pub ticks: u64,
    /// A command or a fault has stopped motion, not only the sensor that an axis seeks.
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
    /// Both edges: the motors with an odd number of them, whose signals are at the other level.
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
