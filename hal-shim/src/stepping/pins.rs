//! Which pins the motors hang on, as words for the ports.

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
    /// High = backwards.
    pub direction: Pin,
}

/// The words for every set of motors, on `PORTS` ports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PinMap<const PORTS: usize> {
    step: [[u16; 16]; PORTS],
    direction: [[u16; 16]; PORTS],
}

impl<const PORTS: usize> PinMap<PORTS> {
    /// The map of four motors: X (A), Y (B), Z, extruder. `None` for a port or pin that does not exist.
    pub const fn new(motors: [MotorPins; 4]) -> Option<Self> {
        let mut map = Self { step: [[0; 16]; PORTS], direction: [[0; 16]; PORTS] };
        let mut axes = 0;
        while axes < 16 {
            let mut motor = 0;
            while motor < 4 {
                let MotorPins { step, direction } = motors[motor];
                if step.port >= PORTS || direction.port >= PORTS || step.number > 15 || direction.number > 15 {
                    return None;
                }
                if axes >> motor & 1 == 1 {
                    map.step[step.port][axes] |= 1 << step.number;
                    map.direction[direction.port][axes] |= 1 << direction.number;
                }
                motor += 1;
            }
            axes += 1;
        }
        Some(map)
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

    /// The words that turn the step signals of `axes` to the other level, with `high` the motors whose signals are high.
    #[inline(always)]
    pub fn toggled(&self, axes: u8, high: u8) -> [u32; PORTS] {
        self.step.each_ref().map(|masks| {
            let [axes, high] = [axes, high].map(|motors| u32::from(masks[usize::from(motors & 15)]));
            axes & !high | (axes & high) << RESET_SHIFT
        })
    }

    /// The words that put out these direction signals: bit i = motor i runs backwards.
    pub fn directions(&self, backwards: u8) -> [u32; PORTS] {
        self.direction.each_ref().map(|masks| {
            let [set, reset] = [backwards, !backwards].map(|axes| u32::from(masks[usize::from(axes & 15)]));
            set | reset << RESET_SHIFT
        })
    }
}
