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

    /// The words that raise the step signals of `up` and lower those of `down`.
    #[inline]
    pub fn steps(&self, up: u8, down: u8) -> [u32; PORTS] {
        self.step.each_ref().map(|masks| {
            let [up, down] = [up, down].map(|axes| u32::from(masks[usize::from(axes & 15)]));
            up | down << RESET_SHIFT
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
