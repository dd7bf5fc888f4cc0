//! The paper's packets of a job: what is written, and what is executed.

use ferrostep_gpre::wide::{PLACE_PARTS, Packet, Status, Trajectory};
use ferrostep_planner::inner_ends::{InnerEnd, InnerEnds};
use ferrostep_planner::{Acceleration, Block, PlannedBlock, PreparedBlock, Speed, SquaredSpeed};

use super::script::Ready;

/// Units of length in a millimetre.
const PER_MM: f64 = 100_000.0;

/// Where the machine is, units of 10 nm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// Machine position.
    pub position_10nm: [i64; 3],
    /// What of Z is the lift of a firmware retraction.
    pub lift_10nm: i64,
    /// E of the G-code.
    pub extruder_10nm: i64,
}

/// Puts a job into packets.
pub struct PacketWriter {
    /// Source line of the packet before.
    line: u32,
    /// Where the machine is after the moves so far, and what has been told of it.
    place: Place,
    told: Place,
    flow_percent: i64,
    rest_100pm: i64,
    /// Moves of the last block that are still to come.
    joined: usize,
    packets: u32,
}

impl PacketWriter {
    /// A writer of a job that begins at a machine position.
    pub fn new(position_10nm: [i64; 3]) -> Self {
        let place = Place { position_10nm, ..Place::default() };
        Self { line: 0, place, told: place, flow_percent: 100, rest_100pm: 0, joined: 0, packets: 0 }
    }

    fn put(&mut self, packet: Packet, bytes: &mut Vec<u8>) {
        packet.write(bytes);
        self.packets += 1;
    }

    fn status(&mut self, status: Status, bytes: &mut Vec<u8>) {
        self.put(Packet::Status(status), bytes);
    }

    /// The source line of the next packet that has one.
    fn begin_line(&mut self, line: u32, bytes: &mut Vec<u8>) {
        if line != self.line.wrapping_add(1) {
            self.status(Status::Line(line), bytes);
        }
        self.line = line;
    }

    /// Where the machine is, if that has not been told, and not in the middle of a block: that is executed as a whole.
    fn tell_place(&mut self, bytes: &mut Vec<u8>) {
        if self.told == self.place || self.joined > 0 {
            return;
        }
        self.told = self.place;
        let Place { position_10nm: [x, y, z], lift_10nm, extruder_10nm } = self.place;
        let extruder = extruder_10nm as u64;
        let halves = |value: i64| [value as u16, (value >> 16) as u16];
        let position = [x, y, z].into_iter().flat_map(halves);
        let quarters = [extruder, extruder >> 16, extruder >> 32, extruder >> 48].map(|part| part as u16);
        for (part, bits) in (0..).zip(position.chain(quarters).chain(halves(lift_10nm))) {
            self.status(Status::Place { part, bits }, bytes);
        }
    }

    /// Takes a part of the job.
    pub fn take(&mut self, ready: &Ready, bytes: &mut Vec<u8>) {
        if let Ready::First { item, .. } | Ready::Joined(item) = ready {
            let [.., before] = self.place.position_10nm;
            let [.., z] = item.target_10nm;
            self.place.position_10nm = item.target_10nm;
            if !item.counts {
                self.place.lift_10nm += z - before;
            } else {
                let pushed = self.rest_100pm + item.filament_100pm;
                self.place.extruder_10nm += pushed / self.flow_percent;
                self.rest_100pm = pushed % self.flow_percent;
            }
        }
        match ready {
            Ready::First { planned, bound, joined, .. } => {
                self.joined = *joined;
                self.begin_line(planned.block.line, bytes);
                for end in planned.block.inner_ends.iter(planned.block.line) {
                    // Both have these ranges.
                    let (length_10nm, lines) = (end.length_10nm as u16, (planned.block.line - end.line) as u8);
                    self.status(Status::InnerEnd { length_10nm, lines_before: lines }, bytes);
                }
                self.put(Packet::Trajectory(trajectory(planned, *bound)), bytes);
            }
            Ready::Joined(_) => self.joined = self.joined.saturating_sub(1),
            Ready::Fan { line, power } => {
                self.begin_line(*line, bytes);
                self.status(Status::Fan(*power), bytes);
            }
            Ready::Command { line, text } => {
                self.tell_place(bytes);
                self.begin_line(*line, bytes);
                let mut text = text.as_bytes();
                while text.len() >= 3 {
                    let (&part, rest) = text.split_first_chunk::<3>().unwrap_or((&[0; 3], &[]));
                    self.status(Status::Text(part), bytes);
                    text = rest;
                }
                let mut last = [0; 3];
                last[..text.len()].copy_from_slice(text);
                self.status(Status::Text(last), bytes);
            }
            Ready::State { modal, position_10nm } => {
                self.flow_percent = i64::from(modal.flow_percent.max(1));
                // What a command does to it the machine knows by itself.
                let (lift_10nm, extruder_10nm) = (modal.lift_10nm, modal.extruder_10nm);
                self.place = Place { position_10nm: *position_10nm, lift_10nm, extruder_10nm };
                if self.joined == 0 {
                    self.told = self.place;
                }
            }
        }
    }

    /// The job has ended; how many packets it has.
    pub fn end(&mut self, bytes: &mut Vec<u8>) -> u32 {
        self.tell_place(bytes);
        self.packets
    }
}

/// A block in the paper's values.
fn trajectory(planned: &PlannedBlock, bound: SquaredSpeed) -> Trajectory {
    let PlannedBlock { block, entry, exit } = planned;
    let [x, y, z] = block.steps;
    let signed = [x, y, z, block.extruder_256ths];
    let direction_bits = (0..).zip(signed).fold(0, |bits, (axis, steps)| bits | u32::from(steps < 0) << axis);
    let events = f64::from(block.master_steps());
    let length_mm = f64::from(block.length_10nm) / PER_MM;
    let (nominal, acceleration) = (block.nominal.mm_per_s(), block.acceleration.mm_per_s2());
    // Step events in a mm.
    let density = events / length_mm;
    let ramp = |speed: Speed| (block.nominal.squared() - speed.squared()) / (2.0 * acceleration) * density;
    let (mut up, mut down) = (ramp(*entry), events - ramp(*exit));
    if up > down {
        // No cruise.
        let peak = ((exit.squared() - entry.squared()) / (2.0 * acceleration) + length_mm) / 2.0 * density;
        (up, down) = (peak, peak);
    }
    let events_in = |events_before: f64| events_before.clamp(0.0, events).round() as u32;
    let rate = |speed: f64| (speed * density).round() as u32;
    let reached = nominal * nominal <= 2.0 * acceleration * length_mm;
    Trajectory {
        steps: signed.map(i32::unsigned_abs),
        step_event_count: block.master_steps(),
        accelerate_until: events_in(up),
        decelerate_after: events_in(down),
        direction_bits,
        nominal_speed: block.nominal.0,
        entry_speed: entry.0,
        max_entry_speed: bound.root().min(block.nominal).max(*entry).0,
        millimeters: block.length_10nm,
        acceleration: block.acceleration.quantised(),
        nominal_length_flag: u32::from(reached) | u32::from(block.ends_move) << 1,
        nominal_rate: rate(nominal),
        initial_rate: rate(entry.mm_per_s()),
        final_rate: rate(exit.mm_per_s()),
        extruder_rate: (f64::from(block.extruder_256ths.unsigned_abs()) / length_mm * nominal).round() as u32,
        acceleration_st: rate(acceleration),
    }
}

/// What packets ask for.
pub enum Asked {
    /// A block in which so many moves end.
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
        /// Its text.
        text: Vec<u8>,
    },
    /// The machine is here.
    Place(Place),
}

/// Puts packets together again.
#[derive(Default)]
pub struct PacketReader {
    line: u32,
    next_line: Option<u32>,
    inner: Vec<(u16, u8)>,
    text: Vec<u8>,
    place: Vec<u16>,
}

impl PacketReader {
    fn begin_line(&mut self) -> u32 {
        self.line = self.next_line.take().unwrap_or(self.line.wrapping_add(1));
        self.line
    }

    /// Takes a packet; returns what is asked for when it is complete.
    ///
    /// # Errors
    /// What was expected where the packet has no meaning here.
    pub fn take(&mut self, packet: &Packet) -> Result<Option<Asked>, &'static str> {
        match *packet {
            Packet::Status(Status::Line(line)) => self.next_line = Some(line),
            Packet::Status(Status::InnerEnd { length_10nm, lines_before }) => {
                self.inner.push((length_10nm, lines_before));
                if self.inner.len() > ferrostep_planner::inner_ends::MAX_INNER_ENDS {
                    return Err("at most seven moves that end inside a trajectory");
                }
            }
            Packet::Status(Status::Fan(power)) => return Ok(Some(Asked::Fan { line: self.begin_line(), power })),
            Packet::Status(Status::Text(part)) => {
                let length = part.iter().position(|&byte| byte == 0);
                self.text.extend_from_slice(&part[..length.unwrap_or(part.len())]);
                if self.text.len() > ferrostep_gpre::compact::MOST_TEXT_BYTES {
                    return Err("a command of at most 255 bytes");
                }
                if length.is_some() {
                    let text = std::mem::take(&mut self.text);
                    return Ok(Some(Asked::Command { line: self.begin_line(), text }));
                }
            }
            Packet::Status(Status::Place { part, bits }) => {
                if usize::from(part) != self.place.len() {
                    return Err("the parts of a place in their order");
                }
                self.place.push(bits);
                if self.place.len() == PLACE_PARTS {
                    let parts = std::mem::take(&mut self.place);
                    let axis = |index: usize| {
                        let [low, high] = [parts[2 * index], parts[2 * index + 1]].map(u32::from);
                        i64::from((high << 16 | low) as i32)
                    };
                    let extruder = parts[6..10].iter().rev().fold(0, |all, &part| all << 16 | u64::from(part)) as i64;
                    let position_10nm = [axis(0), axis(1), axis(2)];
                    let place = Place { position_10nm, lift_10nm: axis(5), extruder_10nm: extruder };
                    return Ok(Some(Asked::Place(place)));
                }
            }
            Packet::Trajectory(trajectory) => {
                let line = self.begin_line();
                let inner = std::mem::take(&mut self.inner);
                let moves = inner.len() as u32 + (trajectory.nominal_length_flag >> 1);
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
                return Ok(Some(Asked::Block(PreparedBlock { block, entry, max_entry }, moves)));
            }
        }
        Ok(None)
    }

    /// Whether nothing waits for packets that do not come.
    pub fn is_complete(&self) -> bool {
        self.inner.is_empty() && self.text.is_empty() && self.place.is_empty()
    }
}

/// The ends of moves inside a block of this line and length; `None` where they are in no order.
fn inner_ends(inner: &[(u16, u8)], line: u32, length_10nm: u32) -> Option<InnerEnds> {
    let mut ends = InnerEnds::NONE;
    let mut before = 0;
    for (index, &(length, lines)) in inner.iter().enumerate() {
        // Each is told by the line of the one after it.
        let end = InnerEnd { length_10nm: length.into(), line: line.checked_sub(lines.into())? };
        let next = match inner.get(index + 1) {
            Some(&(_, lines)) => line.checked_sub(lines.into())?,
            None => line,
        };
        if end.length_10nm <= before && index > 0 || end.length_10nm > length_10nm {
            return None;
        }
        before = end.length_10nm;
        ends = ends.with(end, next)?;
    }
    Some(ends)
}
