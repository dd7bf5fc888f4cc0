//! Reassembly of packets.

use ferrostep_gpre::compact::MAX_TEXT_BYTES;
use ferrostep_planner::inner_ends::{InnerEnd, InnerEnds, MAX_INNER_ENDS};
use ferrostep_planner::{Acceleration, Block, Speed};
use ferrostep_printer::PreparedPlace;
use heapless::Vec;

use super::block::PreparedBlock;
use super::packet::{PLACE_PARTS, Packet, Status};

/// A request made of one or more packets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PacketRequest<'a> {
    /// A block in which this many moves end.
    Block(PreparedBlock, u32),
    /// The fan.
    Fan {
        /// Source line.
        line: u32,
        /// Power, 0 to 255.
        power: u8,
    },
    /// A command.
    Command {
        /// Source line.
        line: u32,
        /// Text of the command.
        text: &'a [u8],
    },
    /// The machine's position.
    Place(PreparedPlace),
}

/// Reassembles packets.
#[derive(Clone, Debug, Default)]
pub struct PacketReader {
    line: u32,
    next_line: Option<u32>,
    /// Inner ends; a packet encodes their lines as distances before the block's line.
    inner: Vec<InnerEnd, MAX_INNER_ENDS>,
    text: Vec<u8, MAX_TEXT_BYTES>,
    /// True if the text has been handed out and may be dropped.
    text_is_old: bool,
    place: Vec<u16, PLACE_PARTS>,
    /// Last stretch of the previous block.
    before: Option<Block>,
}

impl PacketReader {
    fn begin_line(&mut self) -> u32 {
        self.line = self.next_line.take().unwrap_or(self.line.wrapping_add(1));
        self.line
    }

    /// Takes a packet; returns a request once its last packet has arrived.
    ///
    /// # Errors
    /// The expected data, if the packet has no meaning here.
    pub fn take(&mut self, packet: &Packet) -> Result<Option<PacketRequest<'_>>, &'static str> {
        match *packet {
            Packet::Status(Status::Line(line)) => self.next_line = Some(line),
            Packet::Status(Status::InnerEnd { length_10nm, lines_before }) => {
                let end = InnerEnd {
                    length_10nm: length_10nm.into(),
                    steps: [0; 3],
                    extruder_256ths: 0,
                    line: lines_before.into(),
                    ends_move: true,
                };
                if self.inner.push(end).is_err() {
                    return Err("at most seven moves that end inside a trajectory");
                }
            }
            Packet::Status(Status::InnerSteps(steps)) => self.last_inner()?.steps = steps.map(i32::from),
            Packet::Status(Status::InnerExtruder { travel_256ths, ends_move }) => {
                let end = self.last_inner()?;
                end.extruder_256ths = travel_256ths.into();
                end.ends_move = ends_move;
            }
            Packet::Status(Status::Fan(power)) => {
                return Ok(Some(PacketRequest::Fan { line: self.begin_line(), power }));
            }
            Packet::Status(Status::Text(part)) => {
                let length = part.iter().position(|&byte| byte == 0);
                if core::mem::take(&mut self.text_is_old) {
                    self.text.clear();
                }
                let part = part.get(..length.unwrap_or(part.len())).unwrap_or_default();
                if self.text.extend_from_slice(part).is_err() {
                    return Err("a command of at most 255 bytes");
                }
                if length.is_some() {
                    self.text_is_old = true;
                    let line = self.begin_line();
                    return Ok(Some(PacketRequest::Command { line, text: &self.text }));
                }
            }
            Packet::Status(Status::Place { part, bits }) => {
                if usize::from(part) != self.place.len() {
                    return Err("the parts of a place in their order");
                }
                // The number is one of those that have room.
                let _ = self.place.push(bits);
                if let [x0, x1, y0, y1, z0, z1, e0, e1, e2, e3, lift0, lift1] = *self.place {
                    self.place.clear();
                    let axis = |low: u16, high: u16| i64::from((u32::from(high) << 16 | u32::from(low)) as i32);
                    let extruder = [e3, e2, e1, e0].into_iter().fold(0, |all, part| all << 16 | u64::from(part)) as i64;
                    let position_10nm = [axis(x0, x1), axis(y0, y1), axis(z0, z1)];
                    let place = PreparedPlace { position_10nm, lift_10nm: axis(lift0, lift1), extruder_10nm: extruder };
                    return Ok(Some(PacketRequest::Place(place)));
                }
            }
            Packet::Trajectory(trajectory) => {
                let line = self.begin_line();
                let inner = core::mem::take(&mut self.inner);
                let ended = inner.iter().filter(|end| end.ends_move).count() as u32;
                let moves = ended + (trajectory.nominal_length_flag >> 1);
                let inner_ends = inner_ends(&inner, line, trajectory.millimeters)
                    .ok_or("ends of moves inside a trajectory in their order")?;
                let [x, y, z, extruder_256ths] = trajectory.signed_steps();
                let block = Block {
                    steps: [x, y, z],
                    extruder_256ths,
                    length_10nm: trajectory.millimeters,
                    nominal: Speed(trajectory.nominal_speed),
                    acceleration: Acceleration::from_quantised(trajectory.acceleration),
                    line,
                    ends_move: trajectory.nominal_length_flag >> 1 == 1,
                    inner_ends,
                };
                let (entry, max_entry) = (Speed(trajectory.entry_speed), Speed(trajectory.max_entry_speed));
                let prepared = PreparedBlock { block, entry, max_entry, before: self.before };
                self.before = prepared.last_stretch();
                return Ok(Some(PacketRequest::Block(prepared, moves)));
            }
        }
        Ok(None)
    }

    /// Inner end read last.
    fn last_inner(&mut self) -> Result<&mut InnerEnd, &'static str> {
        self.inner.last_mut().ok_or("the end of a move inside a trajectory before its steps and filament")
    }

    /// Returns true if every request is complete, so that a job may end here.
    pub fn is_complete(&self) -> bool {
        self.inner.is_empty() && (self.text.is_empty() || self.text_is_old) && self.place.is_empty()
    }
}

/// Ends of moves inside a block of this line and length; `None` if they are out of order.
fn inner_ends(inner: &[InnerEnd], line: u32, length_10nm: u32) -> Option<InnerEnds> {
    let mut ends = InnerEnds::NONE;
    let mut before = 0;
    for (index, read) in inner.iter().enumerate() {
        // Each end is encoded relative to the line of the one after it.
        let end = InnerEnd { line: line.checked_sub(read.line)?, ..*read };
        let next = match inner.get(index + 1) {
            Some(next) => line.checked_sub(next.line)?,
            None => line,
        };
        if end.length_10nm <= before || end.length_10nm >= length_10nm {
            return None;
        }
        before = end.length_10nm;
        ends = ends.with(end, next)?;
    }
    Some(ends)
}
