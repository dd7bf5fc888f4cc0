//! The packets, byte by byte.
//!
//! After the header come packets without gaps, each framed by a start code and an end code, all
//! numbers u32, little-endian. A *line trajectory* has 84 bytes:
//!
//! | byte | value | unit here |
//! |---|---|---|
//! | 0 | start code, [`TRAJECTORY_START`] | |
//! | 4, 8, 12 | 1 StepX, 2 StepY, 3 StepZ | steps of the motors, without sign |
//! | 16 | 4 StepE | 1/256 step, without sign |
//! | 20 | 5 StepEventCount | the largest of 1 to 3 |
//! | 24, 28 | 6 AccelerateUntil, 7 DecelerateAfter | step events from the start |
//! | 32 | 8 DirectionBits | bit i: axis i goes backwards |
//! | 36, 40, 44 | 9 NominalSpeed, 10 EntrySpeed, 11 MaxEntrySpeed | 2^-16 mm/s |
//! | 48 | 12 Millimeters | 10 nm |
//! | 52 | 13 Acceleration | 2^-8 mm/s^2 |
//! | 56 | 14 NominalLengthFlag | bit 0: nominal speed can be reached from standstill and back; bit 1: a move ends here |
//! | 60, 64, 68 | 15 NominalRate, 16 InitialRate, 17 FinalRate | step events/s |
//! | 72 | 18 ExtruderRate | 1/256 steps/s at nominal speed |
//! | 76 | 19 AccelerationSt | step events/s^2 |
//! | 80 | end code, [`TRAJECTORY_END`] | |
//!
//! Values 5 to 7 and 14 to 19 follow from the others; a board that steps by them needs no
//! arithmetic. Ferrostep computes its steps from the integers of the block, which are the others.
//!
//! A *status or auxiliary command* has 12 bytes: start code [`STATUS_START`], a kind (byte 4) and
//! three further bytes, end code [`STATUS_END`]:
//!
//! | kind | bytes 5 to 7 |
//! |---|---|
//! | 1 | u24: the source line of the next trajectory, fan or text, where it is not the next line |
//! | 2 | u16, u8: a move ends inside the next trajectory: units of 10 nm from its start, lines before its own |
//! | 3 | u8: the fan, 0 to 255 |
//! | 4 | up to three bytes of a command's text, zeros after it; the first zero ends it, at the latest in a separate packet |
//! | 5 | u8, u16: a part of where the machine is: 0 to 5 = X, Y, Z, 6 to 9 = E of the G-code, 10 and 11 = how far Z is lifted by a firmware retraction; the least first, units of 10 nm |
//! | 6 | 3 i8: signed steps of X, Y and Z that lead to the inner end before |
//! | 7 | i16, u8: travel of the extruder that leads there, 1/256 steps; 1 where the line's move ends there, 0 inside an arc |

use ferrostep_gpre::Fault;

/// Start code of a line trajectory: `GPRE`.
const TRAJECTORY_START: u32 = u32::from_le_bytes(*b"GPRE");
/// End code of a line trajectory: `ERPG`.
const TRAJECTORY_END: u32 = u32::from_le_bytes(*b"ERPG");
/// Start code of a status command: `STAT`.
const STATUS_START: u32 = u32::from_le_bytes(*b"STAT");
/// End code of a status command: `TATS`.
const STATUS_END: u32 = u32::from_le_bytes(*b"TATS");

/// Length of a line trajectory, bytes.
pub const TRAJECTORY_BYTES: usize = 84;

/// Length of a status command, bytes.
pub const STATUS_BYTES: usize = 12;

/// Length of a code, bytes.
const CODE_BYTES: usize = 4;

/// A block as the paper has it; the module's table gives the units.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Trajectory {
    /// StepX, StepY, StepZ, StepE.
    pub steps: [u32; 4],
    /// StepEventCount.
    pub step_event_count: u32,
    /// AccelerateUntil.
    pub accelerate_until: u32,
    /// DecelerateAfter.
    pub decelerate_after: u32,
    /// DirectionBits.
    pub direction_bits: u32,
    /// NominalSpeed.
    pub nominal_speed: u32,
    /// EntrySpeed.
    pub entry_speed: u32,
    /// MaxEntrySpeed.
    pub max_entry_speed: u32,
    /// Millimeters, in units of 10 nm.
    pub millimeters: u32,
    /// Acceleration.
    pub acceleration: u32,
    /// NominalLengthFlag, and whether a move ends here.
    pub nominal_length_flag: u32,
    /// NominalRate.
    pub nominal_rate: u32,
    /// InitialRate.
    pub initial_rate: u32,
    /// FinalRate.
    pub final_rate: u32,
    /// ExtruderRate.
    pub extruder_rate: u32,
    /// AccelerationSt.
    pub acceleration_st: u32,
}

/// A status or auxiliary command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The source line of the following packets.
    Line(u32),
    /// The end of a move, or of a part of an arc, inside the next trajectory. Packets with its
    /// steps and its filament follow.
    InnerEnd {
        /// Path position from the trajectory's start, units of 10 nm.
        length_10nm: u16,
        /// Number of lines by which the inner end precedes the trajectory's line.
        lines_before: u8,
    },
    /// Signed steps of X, Y and Z (CoreXY: A, B, Z) from the previous inner end to this one.
    InnerSteps([i8; 3]),
    /// Remaining data of an inner end: its filament, and the end of a move.
    InnerExtruder {
        /// Signed travel of the extruder, 1/256 steps.
        travel_256ths: i16,
        /// True if the line's move ends there.
        ends_move: bool,
    },
    /// The fan, 0 to 255.
    Fan(u8),
    /// A part of a command's text.
    Text([u8; 3]),
    /// A part of the machine's position.
    Place {
        /// Number of the part, 0 to 11.
        part: u8,
        /// Bits of the part.
        bits: u16,
    },
}

/// Number of parts in a [`Status::Place`].
pub const PLACE_PARTS: usize = 12;

/// A packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Packet {
    /// A line trajectory.
    Trajectory(Trajectory),
    /// A status command.
    Status(Status),
}

fn number(bytes: &[u8], index: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(4 * index..4 * index + 4)?.try_into().ok()?))
}

impl Packet {
    /// Returns the length of a packet that begins with these bytes.
    ///
    /// # Errors
    /// No packet begins with these bytes.
    pub fn length(start: [u8; CODE_BYTES]) -> Result<usize, Fault> {
        match u32::from_le_bytes(start) {
            TRAJECTORY_START => Ok(TRAJECTORY_BYTES),
            STATUS_START => Ok(STATUS_BYTES),
            _ => Err(Fault::NoFrame),
        }
    }

    /// Reads a packet of length [`Self::length`].
    ///
    /// # Errors
    /// Too few bytes, a wrong end code, or impossible values.
    pub fn read(bytes: &[u8]) -> Result<Self, Fault> {
        let start = *bytes.first_chunk::<CODE_BYTES>().ok_or(Fault::Truncated)?;
        let bytes = bytes.get(..Self::length(start)?).ok_or(Fault::Truncated)?;
        let (before, end) = bytes.split_last_chunk::<CODE_BYTES>().ok_or(Fault::Truncated)?;
        let end = u32::from_le_bytes(*end);
        if u32::from_le_bytes(start) == TRAJECTORY_START {
            let trajectory = Trajectory::from_numbers(before).ok_or(Fault::Truncated)?;
            if end != TRAJECTORY_END {
                return Err(Fault::Content("the end code of a trajectory"));
            }
            trajectory.check()?;
            return Ok(Self::Trajectory(trajectory));
        }
        if end != STATUS_END {
            return Err(Fault::Content("the end code of a status command"));
        }
        let [.., kind, a, b, c] = *before else { return Err(Fault::Truncated) };
        Ok(Self::Status(match kind {
            1 => Status::Line(u32::from_le_bytes([a, b, c, 0])),
            2 => Status::InnerEnd { length_10nm: u16::from_le_bytes([a, b]), lines_before: c },
            3 => Status::Fan(a),
            4 => Status::Text([a, b, c]),
            5 if usize::from(a) < PLACE_PARTS => Status::Place { part: a, bits: u16::from_le_bytes([b, c]) },
            6 => Status::InnerSteps([a, b, c].map(u8::cast_signed)),
            7 => Status::InnerExtruder { travel_256ths: i16::from_le_bytes([a, b]), ends_move: c & 1 == 1 },
            _ => return Err(Fault::Content("a status command of a kind from 1 to 7")),
        }))
    }

    /// Appends the packet.
    #[cfg(feature = "write")]
    pub fn write(&self, bytes: &mut std::vec::Vec<u8>) {
        match self {
            Self::Trajectory(trajectory) => {
                bytes.extend_from_slice(&TRAJECTORY_START.to_le_bytes());
                for number in trajectory.numbers() {
                    bytes.extend_from_slice(&number.to_le_bytes());
                }
                bytes.extend_from_slice(&TRAJECTORY_END.to_le_bytes());
            }
            Self::Status(status) => {
                let own = match *status {
                    Status::Line(line) => {
                        let [a, b, c, _] = line.to_le_bytes();
                        [1, a, b, c]
                    }
                    Status::InnerEnd { length_10nm, lines_before } => {
                        let [a, b] = length_10nm.to_le_bytes();
                        [2, a, b, lines_before]
                    }
                    Status::InnerSteps(steps) => {
                        let [x, y, z] = steps.map(i8::cast_unsigned);
                        [6, x, y, z]
                    }
                    Status::InnerExtruder { travel_256ths, ends_move } => {
                        let [a, b] = travel_256ths.to_le_bytes();
                        [7, a, b, ends_move.into()]
                    }
                    Status::Fan(power) => [3, power, 0, 0],
                    Status::Text([a, b, c]) => [4, a, b, c],
                    Status::Place { part, bits } => {
                        let [a, b] = bits.to_le_bytes();
                        [5, part, a, b]
                    }
                };
                bytes.extend_from_slice(&STATUS_START.to_le_bytes());
                bytes.extend_from_slice(&own);
                bytes.extend_from_slice(&STATUS_END.to_le_bytes());
            }
        }
    }
}

impl Trajectory {
    fn from_numbers(bytes: &[u8]) -> Option<Self> {
        let at = |index| number(bytes, index);
        Some(Self {
            steps: [at(1)?, at(2)?, at(3)?, at(4)?],
            step_event_count: at(5)?,
            accelerate_until: at(6)?,
            decelerate_after: at(7)?,
            direction_bits: at(8)?,
            nominal_speed: at(9)?,
            entry_speed: at(10)?,
            max_entry_speed: at(11)?,
            millimeters: at(12)?,
            acceleration: at(13)?,
            nominal_length_flag: at(14)?,
            nominal_rate: at(15)?,
            initial_rate: at(16)?,
            final_rate: at(17)?,
            extruder_rate: at(18)?,
            acceleration_st: at(19)?,
        })
    }

    /// The values in the paper's order.
    pub fn numbers(&self) -> [u32; 19] {
        let [x, y, z, e] = self.steps;
        [
            x,
            y,
            z,
            e,
            self.step_event_count,
            self.accelerate_until,
            self.decelerate_after,
            self.direction_bits,
            self.nominal_speed,
            self.entry_speed,
            self.max_entry_speed,
            self.millimeters,
            self.acceleration,
            self.nominal_length_flag,
            self.nominal_rate,
            self.initial_rate,
            self.final_rate,
            self.extruder_rate,
            self.acceleration_st,
        ]
    }

    /// Signed steps; the check of [`Packet::read`] keeps them in range.
    pub fn signed_steps(&self) -> [i32; 4] {
        let mut signed = self.steps.map(|steps| steps as i32);
        for (axis, steps) in signed.iter_mut().enumerate() {
            if self.direction_bits >> axis & 1 == 1 {
                *steps = steps.wrapping_neg();
            }
        }
        signed
    }

    fn check(&self) -> Result<(), Fault> {
        let [x, y, z, e] = self.steps;
        if x.max(y).max(z) > 1 << 28 || e > i32::MAX as u32 {
            return Err(Fault::Content("at most 2^28 steps"));
        }
        if self.step_event_count != x.max(y).max(z) {
            return Err(Fault::Content("as many step events as the longest axis has steps"));
        }
        if self.direction_bits > 0b1111 || self.nominal_length_flag > 0b11 {
            return Err(Fault::Content("flags of four axes, and two of a trajectory"));
        }
        if self.millimeters == 0 || self.acceleration == 0 || self.nominal_speed == 0 {
            return Err(Fault::Content("a length, a speed and an acceleration above zero"));
        }
        if self.entry_speed > self.max_entry_speed || self.max_entry_speed > self.nominal_speed {
            return Err(Fault::Content("an entry speed within its bound, and that within the nominal speed"));
        }
        Ok(())
    }
}
