//! The last steps at which a motor reversed or took up play, in case they never happen.

/// Number of steps remembered. The step queue seldom holds more; if a stop drops more, the oldest
/// count as made, and the position is wrong by these steps, at most by the play.
const MANY: usize = 64;

/// Kind of a remembered step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Change {
    /// First step seen.
    Began,
    /// First step after a reversal.
    Turned,
    /// Step that takes up play.
    TookUp,
}

#[derive(Clone, Copy, Debug)]
struct Remembered {
    /// Number of the motor's step, modulo 2^32.
    step: u32,
    motor: u8,
    change: Change,
}

/// The last changes, in order.
#[derive(Debug)]
pub(super) struct Changes {
    ring: [Option<Remembered>; MANY],
    /// Changes noted so far, modulo 2^32.
    count: u32,
}

impl Changes {
    /// Empty.
    pub(super) const NONE: Self = Self { ring: [None; MANY], count: 0 };

    /// Remembers the change at step number `step` of a motor.
    pub(super) fn note(&mut self, motor: usize, step: u32, change: Change) {
        if let Some(place) = self.ring.get_mut(self.count as usize % MANY) {
            *place = Some(Remembered { step, motor: motor as u8, change });
        }
        self.count = self.count.wrapping_add(1);
    }

    /// Takes the newest change that has not happened, given the steps that the motors have made,
    /// and forgets those after it.
    pub(super) fn take_undone(&mut self, made: [u32; 3]) -> Option<(usize, Change)> {
        for _ in 0..MANY {
            self.count = self.count.wrapping_sub(1);
            let Remembered { step, motor, change } = self.ring.get_mut(self.count as usize % MANY)?.take()?;
            let motor = usize::from(motor);
            if made.get(motor).is_some_and(|made| step.wrapping_sub(*made) as i32 > 0) {
                return Some((motor, change));
            }
        }
        None
    }
}
