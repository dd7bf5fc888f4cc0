//! Writes packets.

use std::vec::Vec;

use ferrostep_gpre::{Item, ModalState, PreparedMove};
use ferrostep_planner::{PlannedBlock, Speed, SquaredSpeed};
use ferrostep_printer::PreparedPlace;

use super::packet::{Packet, Status, Trajectory};

/// Length units per millimetre.
const PER_MM: f64 = 100_000.0;

/// Writes a job as packets.
pub struct PacketWriter {
    /// Source line of the previous packet.
    line: u32,
    /// Machine position after the moves so far, as far as the packets so far convey it.
    place: PreparedPlace,
    written: PreparedPlace,
    flow_percent: i64,
    rest_100pm: i64,
    /// Number of remaining moves of the last block.
    joined: usize,
    packets: u32,
}

impl PacketWriter {
    /// Creates the writer of a job that begins at a machine position.
    pub fn new(position_10nm: [i64; 3]) -> Self {
        let place = PreparedPlace { position_10nm, ..PreparedPlace::default() };
        Self { line: 0, place, written: place, flow_percent: 100, rest_100pm: 0, joined: 0, packets: 0 }
    }

    fn put(&mut self, packet: Packet, bytes: &mut Vec<u8>) {
        packet.write(bytes);
        self.packets += 1;
    }

    fn status(&mut self, status: Status, bytes: &mut Vec<u8>) {
        self.put(Packet::Status(status), bytes);
    }

    /// Writes the source line of the next packet, unless it is the next line.
    fn begin_line(&mut self, line: u32, bytes: &mut Vec<u8>) {
        if line != self.line.wrapping_add(1) {
            self.status(Status::Line(line), bytes);
        }
        self.line = line;
    }

    /// Writes the machine's position if it is new, but not in the middle of a block, which is
    /// executed as a whole.
    fn write_place(&mut self, bytes: &mut Vec<u8>) {
        if self.written == self.place || self.joined > 0 {
            return;
        }
        self.written = self.place;
        let PreparedPlace { position_10nm: [x, y, z], lift_10nm, extruder_10nm } = self.place;
        let extruder = extruder_10nm as u64;
        let halves = |value: i64| [value as u16, (value >> 16) as u16];
        let position = [x, y, z].into_iter().flat_map(halves);
        let quarters = [extruder, extruder >> 16, extruder >> 32, extruder >> 48].map(|part| part as u16);
        for (part, bits) in (0..).zip(position.chain(quarters).chain(halves(lift_10nm))) {
            self.status(Status::Place { part, bits }, bytes);
        }
    }

    /// Takes a block, whose first move [`Self::take_item`] has taken. `bound` is the maximum speed
    /// that the corner before it allows; `joined` moves of the block are still to come.
    pub fn take_block(&mut self, planned: &PlannedBlock, bound: SquaredSpeed, joined: usize, bytes: &mut Vec<u8>) {
        self.joined = joined;
        self.begin_line(planned.block.line, bytes);
        for end in planned.block.inner_ends.iter(planned.block.line) {
            // All values are within these ranges.
            let (length_10nm, lines) = (end.length_10nm as u16, (planned.block.line - end.line) as u8);
            self.status(Status::InnerEnd { length_10nm, lines_before: lines }, bytes);
            self.status(Status::InnerSteps(end.steps.map(|steps| steps as i8)), bytes);
            let (travel_256ths, ends_move) = (end.extruder_256ths as i16, end.ends_move);
            self.status(Status::InnerExtruder { travel_256ths, ends_move }, bytes);
        }
        self.put(Packet::Trajectory(trajectory(planned, bound)), bytes);
    }

    /// Takes the next item of the job. A move that begins a block is followed by
    /// [`Self::take_block`].
    pub fn take_item(&mut self, item: &Item<'_>, bytes: &mut Vec<u8>) {
        match *item {
            Item::Move(item) => self.take_move(item),
            Item::Fan { line, power } => {
                self.begin_line(line, bytes);
                self.status(Status::Fan(power), bytes);
            }
            Item::Command { line, text } => {
                self.write_place(bytes);
                self.begin_line(line, bytes);
                let (parts, rest) = text.as_bytes().as_chunks::<3>();
                for part in parts {
                    self.status(Status::Text(*part), bytes);
                }
                let mut last = [0; 3];
                last.iter_mut().zip(rest).for_each(|(to, from)| *to = *from);
                self.status(Status::Text(last), bytes);
            }
        }
    }

    fn take_move(&mut self, item: &PreparedMove) {
        self.joined = self.joined.saturating_sub(1);
        let [.., before] = self.place.position_10nm;
        let target_10nm = item.target_10nm().map(i64::from);
        let [.., z] = target_10nm;
        self.place.position_10nm = target_10nm;
        if !item.counts {
            self.place.lift_10nm += z - before;
        } else {
            let pushed = self.rest_100pm + item.filament_100pm;
            self.place.extruder_10nm += pushed / self.flow_percent;
            self.rest_100pm = pushed % self.flow_percent;
        }
    }

    /// Notes changed settings, and possibly a changed position. A reader's machine knows by itself
    /// the effect of a command.
    pub fn set_modal(&mut self, modal: &ModalState, position_10nm: [i64; 3]) {
        self.flow_percent = i64::from(modal.flow_percent.max(1));
        let (lift_10nm, extruder_10nm) = (modal.lift_10nm, modal.extruder_10nm);
        self.place = PreparedPlace { position_10nm, lift_10nm, extruder_10nm };
        if self.joined == 0 {
            self.written = self.place;
        }
    }

    /// Ends the job; returns the number of its packets.
    pub fn end(&mut self, bytes: &mut Vec<u8>) -> u32 {
        self.write_place(bytes);
        self.packets
    }
}

/// Encodes a block in the paper's values.
fn trajectory(planned: &PlannedBlock, bound: SquaredSpeed) -> Trajectory {
    let PlannedBlock { block, entry, exit } = planned;
    let [x, y, z] = block.steps;
    let signed = [x, y, z, block.extruder_256ths];
    let direction_bits = (0..).zip(signed).fold(0, |bits, (axis, steps)| bits | u32::from(steps < 0) << axis);
    let events = f64::from(block.master_steps());
    let length_mm = f64::from(block.length_10nm) / PER_MM;
    let (nominal, acceleration) = (block.nominal.mm_per_s(), block.acceleration.mm_per_s2());
    // Step events per mm.
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
