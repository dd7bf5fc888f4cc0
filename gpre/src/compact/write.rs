//! Writes frames.

mod items;
mod lambdas;

use std::borrow::ToOwned;
use std::string::String;
use std::vec::Vec;

use super::{
    CRC_BYTES, FILAMENT_ALL, FILAMENT_NONE, FILAMENT_PREDICTED, HEAD_BYTES, MARK, MAX_PAYLOAD_BYTES, MAX_TEXT_BYTES,
    WAY_NONE, WAY_XY, WAY_XYZ, WAY_Z, prediction,
};
use items::ItemWriter;
use lambdas::lambdas;

use crate::CRC;
use crate::bits::{BitWriter, golomb_bits, zigzag};
use crate::item::{EntrySpeed, Item, ModalState, PreparedMove};

/// A frame is closed when it is about so long; no shorter, for every frame begins with some 40 bytes of its own.
const LONG_ENOUGH_BITS: usize = 8 * 1600;

/// This many more are taken if the job cannot be entered before the next move.
const LONGER_BITS: usize = 8 * 200;

/// Units that X, Y and Z are tried in, of 10 nm, and the filament, of 0.1 nm; or else the largest that divides all.
const UNITS: [i64; 4] = [1000, 100, 10, 1];

/// What waits to be written.
#[derive(Clone, Debug)]
enum Waiting {
    Move(PreparedMove),
    Fan {
        line: u32,
        power: u8,
    },
    Command {
        line: u32,
        text: String,
    },
    /// Settings in force have changed.
    Modal(ModalState),
}

/// Where the machine is between two items.
#[derive(Clone, Copy, Debug)]
struct Place {
    position_10nm: [i64; 3],
    line: u32,
    feed_mm_per_s: f32,
    fan_power: u8,
    modal: ModalState,
    /// What is not yet in E.
    rest_100pm: i64,
}

impl Place {
    fn pass(&mut self, item: &Waiting) {
        match item {
            Waiting::Move(next) => {
                if !next.counts {
                    self.modal.lift_10nm += i64::from(next.target[2].units()) - self.position_10nm[2];
                }
                self.position_10nm = next.target_10nm().map(i64::from);
                self.line = next.line;
                self.feed_mm_per_s = next.feed_mm_per_s;
                if next.counts {
                    let pushed = self.rest_100pm + next.filament_100pm;
                    let flow = i64::from(self.modal.flow_percent.max(1));
                    self.modal.extruder_10nm += pushed / flow;
                    self.rest_100pm = pushed % flow;
                }
            }
            Waiting::Fan { line, power } => (self.line, self.fan_power) = (*line, *power),
            Waiting::Command { line, .. } => self.line = *line,
            Waiting::Modal(modal) => self.modal = *modal,
        }
    }
}

/// Puts items into frames.
#[derive(Clone, Debug)]
pub struct FrameWriter {
    waiting: Vec<Waiting>,
    /// About how many bits they will take.
    bits: usize,
    start: Place,
    /// Behind the last item taken.
    end: Place,
    number: u32,
}

impl FrameWriter {
    /// A writer of a job that begins at a machine position.
    pub fn new(position_10nm: [i64; 3], modal: ModalState) -> Self {
        let start = Place { position_10nm, line: 0, feed_mm_per_s: 1.0, fan_power: 0, modal, rest_100pm: 0 };
        Self { waiting: Vec::new(), bits: 0, start, end: start, number: 0 }
    }

    /// Number of frames so far.
    pub fn frames(&self) -> u32 {
        self.number
    }

    /// Settings in force have changed; the position may have, too (homing).
    pub fn set_modal(&mut self, modal: ModalState, position_10nm: [i64; 3], frames: &mut Vec<u8>) {
        let before = self.end.modal;
        if self.end.position_10nm != position_10nm
            || (before.feed_percent, before.flow_percent) != (modal.feed_percent, modal.flow_percent)
        {
            self.close(frames);
            self.start.position_10nm = position_10nm;
            self.start.modal = modal;
            self.end = self.start;
        } else if modal != before {
            self.take(Waiting::Modal(modal));
        }
    }

    /// Takes an item; appends to `frames` what is complete.
    pub fn add(&mut self, item: &Item<'_>, frames: &mut Vec<u8>) {
        let follows =
            matches!(item, Item::Move(PreparedMove { entry: EntrySpeed::Continues | EntrySpeed::Falling, .. }));
        if self.bits >= LONG_ENOUGH_BITS + if follows { LONGER_BITS } else { 0 } {
            self.close(frames);
        }
        let (bits, waiting) = match *item {
            Item::Move(next) => {
                (if matches!(next.entry, EntrySpeed::Given(_)) { 90 } else { 42 }, Waiting::Move(*next))
            }
            Item::Fan { line, power } => (20, Waiting::Fan { line, power }),
            Item::Command { line, text } => {
                let end = text.floor_char_boundary(MAX_TEXT_BYTES);
                (24 + 8 * end, Waiting::Command { line, text: text[..end].to_owned() })
            }
        };
        self.bits += bits;
        self.take(waiting);
    }

    fn take(&mut self, waiting: Waiting) {
        self.end.pass(&waiting);
        self.waiting.push(waiting);
    }

    /// Appends what waits as a frame, or as several.
    pub fn close(&mut self, frames: &mut Vec<u8>) {
        let waiting = core::mem::take(&mut self.waiting);
        self.write(&waiting, frames);
        self.bits = 0;
    }

    fn write(&mut self, items: &[Waiting], frames: &mut Vec<u8>) {
        if items.is_empty() {
            return;
        }
        if items.iter().all(|item| matches!(item, Waiting::Modal(_))) {
            items.iter().for_each(|item| self.start.pass(item));
            return;
        }
        let payload = Content::new(&self.start, items).payload(can_be_entered(items));
        if payload.len() > MAX_PAYLOAD_BYTES {
            let (first, second) = items.split_at(items.len() / 2);
            self.write(first, frames);
            self.write(second, frames);
            return;
        }
        let begin = frames.len();
        frames.extend_from_slice(&MARK);
        frames.extend_from_slice(&(payload.len() as u16).to_le_bytes());
        frames.extend_from_slice(&self.number.to_le_bytes());
        frames.extend_from_slice(&payload);
        let sum = CRC.checksum(&frames[begin..]);
        frames.extend_from_slice(&sum.to_le_bytes());
        debug_assert_eq!(frames.len() - begin, HEAD_BYTES + payload.len() + CRC_BYTES);
        self.number += 1;
        items.iter().for_each(|item| self.start.pass(item));
    }
}

/// Whether a job can be entered before these items: the first move begins a block, and no speed follows from one before.
/// A bound that follows from the corner before the first move is unknown to a reader that has not read the frame before.
fn can_be_entered(items: &[Waiting]) -> bool {
    let speeds = items.iter().filter_map(|item| if let Waiting::Move(next) = item { Some(next.entry) } else { None });
    let mut blocks = speeds.enumerate().filter(|(index, speed)| *index == 0 || *speed != EntrySpeed::Continues);
    match blocks.next() {
        Some((_, EntrySpeed::Continues | EntrySpeed::Falling)) => false,
        Some((_, EntrySpeed::Bound)) => !matches!(blocks.next(), Some((_, EntrySpeed::Falling))),
        Some((_, EntrySpeed::Given(_))) | None => true,
    }
}

/// A move in the frame's units.
#[derive(Clone, Copy, Debug)]
struct Steps {
    way: [i32; 3],
    filament: i64,
    kind: u8,
}

/// The items of a frame and what is chosen for it.
struct Content<'a> {
    start: &'a Place,
    items: &'a [Waiting],
    unit_10nm: i64,
    filament_unit_100pm: i64,
    /// Of the moves, in their order.
    steps: Vec<Steps>,
    /// The lambda of each move, where it has one.
    lambdas: Vec<f32>,
    orders: [u32; 4],
}

/// The largest of the units that divides all, or the greatest common divisor where that is larger and small enough.
fn unit(all: impl Iterator<Item = i64>) -> i64 {
    let common = all.fold(0i64, |mut a, b| {
        let mut b = b.abs();
        while b != 0 {
            (a, b) = (b, a % b);
        }
        a
    });
    if common == 0 {
        return 1;
    }
    let tried = UNITS.into_iter().find(|unit| common % unit == 0).unwrap_or(1);
    if common <= 1000 { common.max(tried) } else { tried }
}

impl<'a> Content<'a> {
    fn new(start: &'a Place, items: &'a [Waiting]) -> Self {
        let moves = || items.iter().filter_map(|item| if let Waiting::Move(next) = item { Some(next) } else { None });
        let mut position = start.position_10nm;
        let mut ways = Vec::new();
        for next in moves() {
            let target = next.target_10nm().map(i64::from);
            let [x, y, z] = target;
            ways.push([x - position[0], y - position[1], z - position[2]]);
            position = target;
        }
        let unit_10nm = unit(ways.iter().flatten().copied());
        let filament_unit_100pm = unit(moves().map(|next| next.filament_100pm));
        let steps: Vec<_> = ways
            .iter()
            .zip(moves())
            .map(|(way, next)| {
                let kind = match way {
                    [0, 0, 0] => WAY_NONE,
                    [0, 0, _] => WAY_Z,
                    [_, _, 0] => WAY_XY,
                    _ => WAY_XYZ,
                };
                // Within 10 m.
                let way = way.map(|component| (component / unit_10nm) as i32);
                Steps { way, filament: next.filament_100pm / filament_unit_100pm, kind }
            })
            .collect();
        let lambdas = lambdas(&steps);
        let mut content = Self { start, items, unit_10nm, filament_unit_100pm, steps, lambdas, orders: [0; 4] };
        content.choose_orders();
        content
    }

    /// The filament as a move encodes it: its kind, and the number.
    fn filament(steps: &Steps, lambda: f32) -> (u8, i64) {
        if steps.filament == 0 {
            return (FILAMENT_NONE, 0);
        }
        let difference = steps.filament - i64::from(prediction(steps.way, lambda));
        // Filament that is encoded whole has s(12); the difference must be in range of the reader's 32 bits.
        if steps.kind == WAY_NONE || lambda == 0.0 || difference.abs() > 1 << 16 {
            return (FILAMENT_ALL, steps.filament);
        }
        (FILAMENT_PREDICTED, difference)
    }

    fn choose_orders(&mut self) {
        let mut numbers: [Vec<u64>; 4] = Default::default();
        for (steps, &lambda) in self.steps.iter().zip(&self.lambdas) {
            if steps.kind == WAY_XY || steps.kind == WAY_XYZ {
                numbers[0].push(zigzag(steps.way[0].into()));
                numbers[1].push(zigzag(steps.way[1].into()));
            }
            if steps.kind == WAY_Z || steps.kind == WAY_XYZ {
                numbers[2].push(zigzag(steps.way[2].into()));
            }
            if let (FILAMENT_PREDICTED, difference) = Self::filament(steps, lambda) {
                numbers[3].push(zigzag(difference));
            }
        }
        for (order, numbers) in self.orders.iter_mut().zip(&numbers) {
            let bits = |k: u32| numbers.iter().map(|&number| u64::from(golomb_bits(number, k))).sum::<u64>();
            *order = (0..24).min_by_key(|&k| bits(k)).unwrap_or(0);
        }
    }

    fn payload(&self, can_be_entered: bool) -> Vec<u8> {
        let mut bits = BitWriter::default();
        let (start, modal) = (self.start, &self.start.modal);
        bits.bits(can_be_entered.into(), 1);
        for coordinate in start.position_10nm {
            bits.signed(coordinate, 24);
        }
        bits.golomb(start.line.into(), 20);
        bits.bits(start.feed_mm_per_s.to_bits().into(), 32);
        bits.signed(modal.extruder_10nm, 28);
        for offset in modal.offset_10nm {
            bits.signed(offset, 8);
        }
        bits.signed(modal.lift_10nm, 8);
        bits.golomb(modal.nozzle_celsius.into(), 8);
        bits.golomb(modal.bed_celsius.into(), 8);
        bits.golomb(modal.feed_percent.into(), 7);
        bits.golomb(modal.flow_percent.into(), 7);
        bits.bits(start.fan_power.into(), 8);
        bits.bits(modal.limits.is_some().into(), 1);
        for value in modal.limits.iter().flatten() {
            let whole = *value as u32;
            if whole as f32 == *value && whole < 1 << 24 {
                bits.bits(0, 1);
                bits.golomb(whole.into(), 10);
            } else {
                bits.bits(1, 1);
                bits.bits(value.to_bits().into(), 32);
            }
        }
        bits.golomb(self.unit_10nm.unsigned_abs(), 7);
        bits.golomb(self.filament_unit_100pm.unsigned_abs(), 7);
        for order in self.orders {
            bits.bits(order.into(), 5);
        }
        let mut items = ItemWriter::new(self.start);
        let mut moves = self.steps.iter().zip(&self.lambdas);
        for item in self.items {
            match item {
                Waiting::Move(next) => {
                    if let Some((steps, lambda)) = moves.next() {
                        items.add_move(next, steps, *lambda, self.orders);
                    }
                }
                Waiting::Fan { line, power } => {
                    items.begin_other(5);
                    items.bits.golomb(u64::from(line.saturating_sub(items.line)), 1);
                    items.line = *line;
                    items.bits.bits((*power).into(), 8);
                }
                Waiting::Command { line, text } => items.add_command(*line, text),
                Waiting::Modal(_) => {}
            }
        }
        bits.golomb(items.count, 8);
        let length = items.bits.length();
        let bytes = items.bits.into_bytes();
        for index in 0..length {
            bits.bits((bytes[index / 8] >> (7 - index % 8) & 1).into(), 1);
        }
        bits.into_bytes()
    }
}
