//! The motors' pins, as words for the ports.

/// In a port's word the upper half resets what the lower half sets (RM0090 8.4.7, BSRR).
const RESET_SHIFT: u32 = 16;

/// A pin of a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pin {
    /// Which of the board's motor ports, by index.
    pub port: usize,
    /// Number within the port, 0 to 15.
    pub number: u8,
}

/// The pins of a motor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MotorPins {
    /// A step is its edge.
    pub step: Pin,
    /// High = backwards, but for [`PinMap::with_inverted`].
    pub direction: Pin,
}

/// The words for every set of motors, on `PORTS` ports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PinMap<const PORTS: usize> {
    step: [[u16; 16]; PORTS],
    direction: [[u16; 16]; PORTS],
    /// Motors whose direction signal is low for backwards.
    inverted: u8,
}

impl<const PORTS: usize> PinMap<PORTS> {
    /// The map of four motors: X (A), Y (B), Z, extruder. `None` for a port or pin that does not exist, or that two signals
    /// share.
    pub const fn new(motors: [MotorPins; 4]) -> Option<Self> {
        let mut map = Self { step: [[0; 16]; PORTS], direction: [[0; 16]; PORTS], inverted: 0 };
        let mut taken = [0u16; PORTS];
        let mut axes = 0;
        while axes < 16 {
            let mut motor = 0;
            while motor < 4 {
                let MotorPins { step, direction } = motors[motor];
                if step.port >= PORTS || direction.port >= PORTS || step.number > 15 || direction.number > 15 {
                    return None;
                }
                let (step_bit, direction_bit) = (1 << step.number, 1 << direction.number);
                if axes == 0 {
                    // A pin must identify its motor.
                    if taken[step.port] & step_bit != 0 {
                        return None;
                    }
                    taken[step.port] |= step_bit;
                    if taken[direction.port] & direction_bit != 0 {
                        return None;
                    }
                    taken[direction.port] |= direction_bit;
                }
                if axes >> motor & 1 == 1 {
                    map.step[step.port][axes] |= step_bit;
                    map.direction[direction.port][axes] |= direction_bit;
                }
                motor += 1;
            }
            axes += 1;
        }
        Some(map)
    }

    /// The same pins, with motors (bit i = motor i) that run the other way round.
    pub const fn with_inverted(self, motors: u8) -> Self {
        Self { inverted: motors, ..self }
    }

    /// The words that raise the step signals of `axes`.
    #[inline(always)]
    pub fn raised(&self, axes: u8) -> [u32; PORTS] {
        self.step.each_ref().map(|masks| u32::from(masks[usize::from(axes & 15)]))
    }

    /// A word that lowers what the other raises, and the other way round.
    #[inline(always)]
    pub fn turned(word: u32) -> u32 {
        word.rotate_left(RESET_SHIFT)
    }

    /// The words for these direction signals: bit i = motor i runs backwards.
    pub fn directions(&self, backwards: u8) -> [u32; PORTS] {
        let backwards = backwards ^ self.inverted;
        self.direction.each_ref().map(|masks| {
            let [set, reset] = [backwards, !backwards].map(|axes| u32::from(masks[usize::from(axes & 15)]));
            set | reset << RESET_SHIFT
        })
    }

    /// The direction pins of motors, as words that raise them.
    pub fn direction_pins(&self, axes: u8) -> [u32; PORTS] {
        self.direction.each_ref().map(|masks| u32::from(masks[usize::from(axes & 15)]))
    }

    /// The motors whose step signals these words change.
    pub fn stepping(&self, words: [u32; PORTS]) -> u8 {
        motors_of(&self.step, words)
    }

    /// The motors whose direction signals these words change.
    pub fn turning(&self, words: [u32; PORTS]) -> u8 {
        motors_of(&self.direction, words)
    }

    /// The motors that these words let run backwards.
    pub fn backwards(&self, words: [u32; PORTS]) -> u8 {
        let raised = motors_of(&self.direction, words.map(|word| word & 0xffff));
        (raised ^ self.inverted) & self.turning(words)
    }

    /// Whether these words change pins of motors only.
    pub fn are_motors(&self, words: [u32; PORTS]) -> bool {
        let pins = self.step.iter().zip(&self.direction).map(|(step, direction)| step[15] | direction[15]);
        pins.zip(words).all(|(pins, word)| (word | word >> RESET_SHIFT) as u16 & !pins == 0)
    }
}

/// The motors with a pin in the words, up or down.
fn motors_of<const PORTS: usize>(masks: &[[u16; 16]; PORTS], words: [u32; PORTS]) -> u8 {
    let mut motors = 0;
    for (masks, word) in masks.iter().zip(words) {
        let pins = (word | word >> RESET_SHIFT) as u16;
        for motor in 0..4 {
            motors |= u8::from(masks[1 << motor] & pins != 0) << motor;
        }
    }
    motors
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn inverted_motors_have_the_other_level_of_direction_and_the_same_steps() {
        let pin = |number| Pin { port: 0, number };
        let motors = [0, 1, 2, 3].map(|motor| MotorPins { step: pin(motor), direction: pin(motor + 4) });
        let usual = PinMap::<1>::new(motors).unwrap();
        let inverted = usual.with_inverted(0b0101);
        // Bits 4 to 7 set, and 20 to 23 reset.
        assert_eq!(usual.directions(0b0011), [0b0011 << 4 | 0b1100 << 20]);
        assert_eq!(inverted.directions(0b0011), [0b0110 << 4 | 0b1001 << 20]);
        assert_eq!(inverted.directions(0), [0b0101 << 4 | 0b1010 << 20]);
        assert_eq!(inverted.raised(0b1001), usual.raised(0b1001));
        assert_eq!(inverted.turning(inverted.direction_pins(0b0110)), 0b0110);
        for pins in [usual, inverted] {
            for backwards in 0..16 {
                assert_eq!(pins.backwards(pins.directions(backwards)), backwards);
            }
            assert!(pins.are_motors([0x00ff_00ff]) && !pins.are_motors([1 << 8]) && !pins.are_motors([1 << 24]));
        }
    }
}
