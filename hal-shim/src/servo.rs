//! Servo signal that commands a probe with a pin (BLTouch).

/// Pulses for a servo: one every 20 ms; the width of the pulse is the command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServoPulses {
    /// Width of each pulse, microseconds: 1 to 10,000.
    pub width_us: u16,
    /// Number of pulses.
    pub count: u16,
}

impl ServoPulses {
    /// Time from the start of one pulse to the start of the next, microseconds.
    pub const PERIOD_US: u16 = 20_000;

    /// Returns pulses that fill this time: their number is rounded up and is at least one.
    pub const fn lasting_ms(width_us: u16, ms: u16) -> Self {
        let count = ms.div_ceil(Self::PERIOD_US / 1000);
        Self { width_us, count: if count == 0 { 1 } else { count } }
    }

    /// Width and count in one word, which is never 0: a task stores it in one access, and an
    /// interrupt counts it down.
    pub const fn word(self) -> u32 {
        (self.count as u32) << 16 | self.width_us as u32
    }

    /// Reads the pulses from a word of [`Self::word`]; `None` if no pulse is left.
    pub const fn from_word(word: u32) -> Option<Self> {
        match (word >> 16) as u16 {
            0 => None,
            count => Some(Self { width_us: word as u16, count }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pulses_fill_a_time_and_fit_a_word() {
        assert_eq!(ServoPulses::lasting_ms(650, 680), ServoPulses { width_us: 650, count: 34 });
        assert_eq!(ServoPulses::lasting_ms(650, 681).count, 35);
        assert_eq!(ServoPulses::lasting_ms(650, 0).count, 1);
        let pulses = ServoPulses::lasting_ms(2_190, u16::MAX);
        assert_eq!(ServoPulses::from_word(pulses.word()), Some(pulses));
        assert_eq!(ServoPulses::from_word(2_190), None);
    }
}
