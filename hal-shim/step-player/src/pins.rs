//! Motor pins as words for the ports.

/// Shift to the upper half of a port's word, which resets the pins that the lower half sets
/// (RM0090 8.4.7, BSRR).
const RESET_SHIFT: u32 = 16;

/// A pin of a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pin {
    /// Index of the board's motor port.
    pub port: usize,
    /// Number within the port, 0 to 15.
    pub number: u8,
}

/// The pins of a motor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MotorPins {
    /// Step pin, whose edge makes a step.
    pub step: Pin,
    /// Direction pin: high = backwards, except after [`PinMap::with_inverted`] and
    /// [`PinMap::with_further`].
    pub direction: Pin,
}

/// The words for every set of motors, on `PORTS` ports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PinMap<const PORTS: usize> {
    step: [[u16; 16]; PORTS],
    direction: [[u16; 16]; PORTS],
    /// Direction pins that are low for backwards.
    inverted: [u16; PORTS],
}

impl<const PORTS: usize> PinMap<PORTS> {
    /// Creates the map of four motors: X (A), Y (B), Z, extruder. `None` if a port or pin does not
    /// exist, or if two signals share one.
    pub const fn new(motors: [MotorPins; 4]) -> Option<Self> {
        let mut map = Self { step: [[0; 16]; PORTS], direction: [[0; 16]; PORTS], inverted: [0; PORTS] };
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

    /// Inverts the direction of these motors (bit i = motor i), on all the pins that they have.
    pub const fn with_inverted(mut self, motors: u8) -> Self {
        let mut port = 0;
        while port < PORTS {
            self.inverted[port] ^= self.direction[port][motors as usize & 15];
            port += 1;
        }
        self
    }

    /// Adds the pins of another motor that makes the steps of `motor`, in the opposite direction if
    /// it is inverted. `None` if a port or pin does not exist, or if another signal uses it.
    pub const fn with_further(mut self, motor: usize, pins: MotorPins, is_inverted: bool) -> Option<Self> {
        let MotorPins { step, direction } = pins;
        if motor > 3 || step.port >= PORTS || direction.port >= PORTS || step.number > 15 || direction.number > 15 {
            return None;
        }
        let (step_bit, direction_bit) = (1 << step.number, 1 << direction.number);
        let taken = (self.step[step.port][15] | self.direction[step.port][15]) & step_bit != 0
            || (self.step[direction.port][15] | self.direction[direction.port][15]) & direction_bit != 0;
        if taken || step.port == direction.port && step_bit == direction_bit {
            return None;
        }
        let mut axes = 0;
        while axes < 16 {
            if axes >> motor & 1 == 1 {
                self.step[step.port][axes] |= step_bit;
                self.direction[direction.port][axes] |= direction_bit;
            }
            axes += 1;
        }
        if is_inverted {
            self.inverted[direction.port] |= direction_bit;
        }
        Some(self)
    }

    /// Removes this step signal, for a motor that is at rest while the others of its axis move.
    pub const fn without_steps(mut self, pin: Pin) -> Self {
        let mut axes = 0;
        while axes < 16 && pin.port < PORTS {
            self.step[pin.port][axes] &= !(1 << (pin.number & 15));
            axes += 1;
        }
        self
    }

    /// The words that raise the step signals of `axes`.
    #[inline(always)]
    pub fn raised(&self, axes: u8) -> [u32; PORTS] {
        self.step.each_ref().map(|masks| u32::from(masks[usize::from(axes & 15)]))
    }

    /// Swaps the halves of a word: the result lowers the pins that the word raises, and vice versa.
    #[inline(always)]
    pub fn turned(word: u32) -> u32 {
        word.rotate_left(RESET_SHIFT)
    }

    /// The words for these direction signals: bit i = motor i runs backwards.
    pub fn directions(&self, backwards: u8) -> [u32; PORTS] {
        self.crossed(self.direction.each_ref().map(|masks| {
            let [set, reset] = [backwards, !backwards].map(|axes| u32::from(masks[usize::from(axes & 15)]));
            set | reset << RESET_SHIFT
        }))
    }

    /// Inverts the levels at the pins of inverted motors.
    fn crossed(&self, mut words: [u32; PORTS]) -> [u32; PORTS] {
        for (word, inverted) in words.iter_mut().zip(self.inverted) {
            let inverted = u32::from(inverted) | u32::from(inverted) << RESET_SHIFT;
            *word = *word & !inverted | Self::turned(*word) & inverted;
        }
        words
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

    /// The motors that these words make run backwards.
    pub fn backwards(&self, words: [u32; PORTS]) -> u8 {
        motors_of(&self.direction, self.crossed(words).map(|word| word & 0xffff))
    }

    /// Returns true if these words change motor pins only.
    pub fn are_motors(&self, words: [u32; PORTS]) -> bool {
        let pins = self.step.iter().zip(&self.direction).map(|(step, direction)| step[15] | direction[15]);
        pins.zip(words).all(|(pins, word)| (word | word >> RESET_SHIFT) as u16 & !pins == 0)
    }
}

/// The motors with a pin in the words, raised or lowered.
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

    /// Z has three motors on three ports, one of them inverted.
    #[test]
    fn further_motors_make_the_steps_of_theirs() {
        let pin = |port, number| Pin { port, number };
        let motors = [0, 1, 2, 3].map(|motor| MotorPins { step: pin(0, motor), direction: pin(1, motor) });
        let one = PinMap::<3>::new(motors).unwrap();
        let second = MotorPins { step: pin(0, 8), direction: pin(2, 1) };
        let third = MotorPins { step: pin(2, 13), direction: pin(0, 9) };
        for inverted in 0..16 {
            let one = one.with_inverted(inverted);
            let z_is_inverted = inverted & 4 != 0;
            let three = one.with_further(2, second, z_is_inverted).unwrap();
            let three = three.with_further(2, third, !z_is_inverted).unwrap();
            for axes in 0..16 {
                let [a, b, c] = one.raised(axes);
                let z = u32::from(axes >> 2 & 1);
                assert_eq!(three.raised(axes), [a | z << 8, b, c | z << 13]);
                assert_eq!(three.stepping(three.raised(axes)), axes);
                let [a, b, c] = one.directions(axes);
                let (high, low) = (1 << (16 * (1 - z)), 1 << (16 * z));
                let (second, third) = if z_is_inverted { (low << 1, high << 9) } else { (high << 1, low << 9) };
                assert_eq!(three.directions(axes), [a | third, b, c | second], "{axes:b}");
                assert_eq!(
                    (three.backwards(three.directions(axes)), three.turning(three.directions(axes))),
                    (axes, 15)
                );
                assert_eq!(three.turning(three.direction_pins(axes)), axes);
            }
            assert!(three.are_motors([1 << 9, 8, 1 << 13]) && !one.are_motors([1 << 9, 8, 1 << 13]));
            // One of them alone: only its steps, but the directions of all.
            let alone = three.without_steps(motors[2].step).without_steps(second.step);
            assert_eq!(alone.raised(0b0110), [2, 0, 1 << 13]);
            assert_eq!((alone.directions(5), alone.stepping([0, 0, 1 << 13])), (three.directions(5), 4));
        }
    }

    #[test]
    fn a_further_motor_has_pins_of_its_own() {
        let pin = |number| Pin { port: 0, number };
        let motors = [0, 1, 2, 3].map(|motor| MotorPins { step: pin(motor), direction: pin(motor + 4) });
        let map = PinMap::<1>::new(motors).unwrap();
        let with = |motor, step, direction| map.with_further(motor, MotorPins { step, direction }, false);
        assert!(with(2, pin(8), pin(15)).is_some());
        for (step, direction) in [
            (pin(3), pin(9)),
            (pin(4), pin(9)),
            (pin(8), pin(0)),
            (pin(8), pin(5)),
            (pin(8), pin(8)),
            (pin(16), pin(8)),
            (Pin { port: 1, number: 8 }, pin(9)),
        ] {
            assert_eq!(with(2, step, direction), None, "{step:?} {direction:?}");
        }
        assert_eq!(with(4, pin(8), pin(9)), None);
    }
}
