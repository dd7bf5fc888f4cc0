//! An axis that its motor moves with play.

/// The play operator, the textbook's model of a drive with backlash (A. Visintin, Differential
/// Models of Hysteresis, Springer 1994, section III.2): the axis stays until the motor reaches the
/// other side of the play, and goes with it from there.
#[derive(Clone, Copy, Debug)]
pub struct Axis {
    play: i64,
    /// Place of the axis: between the motor's place and the play below it.
    pub place: i64,
}

impl Axis {
    /// New axis with the motor at 0, reached from above.
    pub fn new(play: i64) -> Self {
        Self { play, place: 0 }
    }

    /// Moves the motor to a place.
    pub fn follow(&mut self, motor: i64) {
        self.place = self.place.clamp(motor - self.play, motor);
    }
}
