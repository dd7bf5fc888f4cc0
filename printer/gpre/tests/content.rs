//! Frames with a valid checksum and invalid content: each is rejected with what was expected, and
//! content just inside the limits is read. The frames are written here bit by bit, from the
//! format's page, because the crate's writer cannot write them.
#![allow(clippy::unwrap_used)]

mod bits;
mod items;
mod starts;

use bits::Bits;
use ferrostep_gpre::compact::Frame;
use ferrostep_gpre::{Fault, Item, PreparedMove};

use crate::framed::framed;

/// Start of a frame; fields that a test does not change are valid.
#[derive(Clone, Debug)]
struct Start {
    can_be_entered: bool,
    position: [i64; 3],
    line: u64,
    feed: f32,
    extruder: i64,
    offset: [i64; 3],
    lift: i64,
    /// Nozzle, bed, feed and flow.
    small: [u64; 4],
    fan: u8,
    limits: Option<Vec<Limit>>,
    unit: u64,
    filament_unit: u64,
    /// Orders of the codes of X, Y, Z and the filament.
    orders: [u32; 4],
}

/// A limit, in one of its two forms.
#[derive(Clone, Copy, Debug)]
enum Limit {
    Whole(u64),
    Float(f32),
}

impl Default for Start {
    fn default() -> Self {
        Self {
            can_be_entered: true,
            position: [1_000, -2_000, 30],
            line: 7,
            feed: 40.0,
            extruder: 123,
            offset: [4, 5, -6],
            lift: 8,
            small: [215, 60, 100, 95],
            fan: 200,
            limits: None,
            unit: 100,
            filament_unit: 10,
            orders: [4; 4],
        }
    }
}

/// Places of a shape's parts, and the shape of the first move.
const WAY: u32 = 5;
const FILAMENT: u32 = 3;
const SAME_LINE: u64 = 4;
const ENDS_MOVE: u64 = 2;
const COUNTS: u64 = 1;

impl Start {
    /// Bits of a frame that begins with these fields and announces this many items, whose bits
    /// follow.
    fn bits(&self, items: u64) -> Bits {
        let mut bits = Bits::default();
        bits.put(self.can_be_entered.into(), 1);
        self.position.iter().for_each(|place| bits.signed(*place, 24));
        bits.golomb(self.line, 20);
        bits.float(self.feed);
        bits.signed(self.extruder, 28);
        self.offset.iter().for_each(|offset| bits.signed(*offset, 8));
        bits.signed(self.lift, 8);
        for (value, k) in self.small.iter().zip([8, 8, 7, 7]) {
            bits.golomb(*value, k);
        }
        bits.put(self.fan.into(), 8);
        bits.put(self.limits.is_some().into(), 1);
        for limit in self.limits.iter().flatten() {
            match limit {
                Limit::Whole(value) => {
                    bits.put(0, 1);
                    bits.golomb(*value, 10);
                }
                Limit::Float(value) => {
                    bits.put(1, 1);
                    bits.float(*value);
                }
            }
        }
        bits.golomb(self.unit, 7);
        bits.golomb(self.filament_unit, 7);
        self.orders.iter().for_each(|order| bits.put((*order).into(), 5));
        bits.golomb(items, 8);
        bits
    }

    /// Frame with this many items, whose bits `put` writes.
    fn with(&self, items: u64, put: impl FnOnce(&mut Bits)) -> Vec<u8> {
        let mut bits = self.bits(items);
        put(&mut bits);
        framed(&bits.into_bytes())
    }
}

/// An item that owns its text.
#[derive(Clone, Debug, PartialEq)]
enum Read {
    Move(PreparedMove),
    Fan(u32, u8),
    Command(u32, String),
}

/// Items of a frame, up to its end or its first fault.
fn read(frame: &[u8]) -> (Vec<Read>, Result<(), Fault>) {
    let mut items = Vec::new();
    let frame = Frame::read(frame, 0, Some(0)).unwrap();
    let mut decoder = match frame.items() {
        Ok(decoder) => decoder,
        Err(fault) => return (items, Err(fault)),
    };
    loop {
        match decoder.next_item() {
            Ok(None) => return (items, Ok(())),
            Ok(Some(Item::Move(item))) => items.push(Read::Move(*item)),
            Ok(Some(Item::Fan { line, power })) => items.push(Read::Fan(line, power)),
            Ok(Some(Item::Command { line, text })) => items.push(Read::Command(line, text.to_owned())),
            Err(fault) => return (items, Err(fault)),
        }
    }
}

/// Fault for which a frame is refused, and the number of items read before it.
fn refused(frame: &[u8]) -> (usize, Fault) {
    let (items, outcome) = read(frame);
    (items.len(), outcome.unwrap_err())
}

/// The moves of a frame that is read to its end.
fn moves(frame: &[u8]) -> Vec<PreparedMove> {
    let (items, outcome) = read(frame);
    assert_eq!(outcome, Ok(()));
    items.into_iter().map(|item| if let Read::Move(item) = item { item } else { panic!("{item:?}") }).collect()
}
