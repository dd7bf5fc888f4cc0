//! Writes frames.

mod content;
mod items;
mod lambdas;
mod steps;
mod waiting;

use std::borrow::ToOwned;
use std::vec::Vec;

use super::frame::{CRC_BYTES, HEAD_BYTES, MARK, MAX_PAYLOAD_BYTES};
use super::shape::MAX_TEXT_BYTES;
use content::Content;
use waiting::{Place, Waiting};

use crate::checksum::CRC;
use crate::item::{EntrySpeed, Item, ModalState, PreparedMove};

/// A frame is closed at about this length; not earlier, as each frame begins with some 40 bytes.
const LONG_ENOUGH_BITS: usize = 8 * 1600;

/// Additional bits if the job cannot be entered before the next move.
const LONGER_BITS: usize = 8 * 200;

/// Puts items into frames.
#[derive(Clone, Debug)]
pub struct FrameWriter {
    waiting: Vec<Waiting>,
    /// Approximate number of bits that they will take.
    bits: usize,
    start: Place,
    /// Place after the last item taken.
    end: Place,
    number: u32,
}

impl FrameWriter {
    /// Writer of a job that begins at a machine position.
    pub fn new(position_10nm: [i64; 3], modal: ModalState) -> Self {
        let start = Place { position_10nm, line: 0, feed_mm_per_s: 1.0, fan_power: 0, modal, rest_100pm: 0 };
        Self { waiting: Vec::new(), bits: 0, start, end: start, number: 0 }
    }

    /// Number of frames so far.
    pub fn frames(&self) -> u32 {
        self.number
    }

    /// Records changed settings; the position may have changed as well (homing).
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

    /// Takes an item; appends completed frames to `frames`.
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

    /// Appends the waiting items as a frame, or as several.
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

/// True if a job can be entered before these items: the first move begins a block, and no speed
/// follows from an earlier one. A bound that follows from the corner before the first move is
/// unknown to a reader that has not read the frame before.
fn can_be_entered(items: &[Waiting]) -> bool {
    let speeds = items.iter().filter_map(|item| if let Waiting::Move(next) = item { Some(next.entry) } else { None });
    let mut blocks = speeds.enumerate().filter(|(index, speed)| *index == 0 || *speed != EntrySpeed::Continues);
    match blocks.next() {
        Some((_, EntrySpeed::Continues | EntrySpeed::Falling)) => false,
        Some((_, EntrySpeed::Bound)) => !matches!(blocks.next(), Some((_, EntrySpeed::Falling))),
        Some((_, EntrySpeed::Given(_))) | None => true,
    }
}
