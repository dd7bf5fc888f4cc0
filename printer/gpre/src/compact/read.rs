//! Reads the items of a frame.

use super::shape::{
    FILAMENT_ALL, FILAMENT_NONE, FILAMENT_PREDICTED, MAX_TEXT_BYTES, PATH_XY, PATH_XYZ, PATH_Z, PLACES, Shape,
    prediction,
};
use crate::bits::{BitReader, Order, Window};
use crate::error::Fault;
use crate::item::{
    Coordinate, EntrySpeed, FIRST_CORNER_VALUE, Item, LimitValues, ModalState, PreparedMove, SquaredSpeed,
};

/// Largest unit.
const MAX_UNIT: u32 = 1000;

const TOO_FAR: Fault = Fault::Content("coordinates within 5 m");

/// Coordinate moved by this many units; `None` if it is too large.
#[inline(always)]
fn after(coordinate: Coordinate, steps: i32, unit_10nm: i32) -> Option<Coordinate> {
    coordinate.advanced(steps.checked_mul(unit_10nm)?)
}

/// An item other than a move of the same shape whose speed needs no number.
enum Uncommon {
    /// A setting that stays in force.
    StateChange,
    Move(EntrySpeed),
    Fan(u8),
    Command,
}

/// State at the start of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameState {
    /// A job can be entered here: the first move begins a block.
    pub can_be_entered: bool,
    /// Machine position, units of 10 nm.
    pub position_10nm: [i64; 3],
    /// Number of the previous source line.
    pub line: u32,
    /// Feed, mm/s.
    pub feed_mm_per_s: f32,
    /// Fan, 0 to 255.
    pub fan_power: u8,
    /// The settings in force.
    pub modal: ModalState,
}

/// The values encoded last, in places that are taken in turn.
#[derive(Clone, Copy, Debug)]
struct Places<T> {
    places: [T; PLACES],
    next: usize,
}

impl<T: Copy> Places<T> {
    fn new(nothing: T) -> Self {
        Self { places: [nothing; PLACES], next: 0 }
    }

    fn put(&mut self, value: T) {
        if let Some(place) = self.places.get_mut(self.next) {
            *place = value;
        }
        self.next = (self.next + 1) % PLACES;
    }

    fn get(&self, index: u32) -> Option<T> {
        self.places.get(index as usize).copied()
    }
}

/// Reads the items of a frame one after the other.
#[derive(Clone, Debug)]
pub struct Decoder<'a> {
    bits: BitReader<'a>,
    start: FrameState,
    left: u32,
    /// The last move, which also gives the machine's position, feed and source line.
    last: PreparedMove,
    lambda: f32,
    shape: Shape,
    unit_10nm: i32,
    filament_unit_100pm: i32,
    orders: [Order; 4],
    feeds: Places<f32>,
    lambdas: Places<f32>,
    /// Places at which the bits of each command begin.
    commands: Places<usize>,
    text: [u8; MAX_TEXT_BYTES],
}

impl<'a> Decoder<'a> {
    /// Reads the start of a frame.
    pub(super) fn new(payload: &'a [u8]) -> Result<Self, Fault> {
        let mut bits = BitReader::new(payload);
        let can_be_entered = bits.bit()?;
        let mut position = [Coordinate::default(); 3];
        for coordinate in &mut position {
            let read = i32::try_from(bits.signed_long(24)?).ok().and_then(Coordinate::new);
            *coordinate = read.ok_or(TOO_FAR)?;
        }
        let line = bits.golomb(20)?;
        let feed_mm_per_s = feed(&mut bits)?;
        let extruder_10nm = bits.signed_long(28)?;
        let mut offset_10nm = [0; 3];
        for offset in &mut offset_10nm {
            *offset = bits.signed_long(8)?;
        }
        let lift_10nm = bits.signed_long(8)?;
        const PERCENT: Fault = Fault::Content("percentages and temperatures of 16 bits");
        let mut small = |k| u16::try_from(bits.golomb(k)?).map_err(|_| PERCENT);
        let (nozzle_celsius, bed_celsius, feed_percent, flow_percent) = (small(8)?, small(8)?, small(7)?, small(7)?);
        let fan_power = bits.few(8)? as u8;
        let mut limits = None;
        if bits.bit()? {
            let mut values: LimitValues = [0.0; _];
            for (index, value) in values.iter_mut().enumerate() {
                *value = if bits.bit()? { f32::from_bits(bits.many(32)? as u32) } else { bits.golomb(10)? as f32 };
                // A corner's limit may be absent: infinite.
                if !(*value > 0.0 && (value.is_finite() || index >= FIRST_CORNER_VALUE)) {
                    return Err(Fault::Content("limits above zero"));
                }
            }
            limits = Some(values);
        }
        let (unit_10nm, filament_unit_100pm) = (bits.golomb(7)?, bits.golomb(7)?);
        if !(1..=MAX_UNIT).contains(&unit_10nm) || !(1..=MAX_UNIT).contains(&filament_unit_100pm) {
            return Err(Fault::Content("units from 1 to 1000"));
        }
        let mut orders = [Order::new(0); 4];
        for order in &mut orders {
            *order = Order::new(bits.few(5)?);
        }
        let left = bits.golomb(8)?;
        let modal = ModalState {
            nozzle_celsius,
            bed_celsius,
            feed_percent,
            flow_percent,
            extruder_10nm,
            offset_10nm,
            lift_10nm,
            limits,
        };
        let start = FrameState {
            can_be_entered,
            position_10nm: position.map(|coordinate| coordinate.units().into()),
            line,
            feed_mm_per_s,
            fan_power,
            modal,
        };
        Ok(Self {
            bits,
            start,
            left,
            last: PreparedMove {
                target: position,
                filament_100pm: 0,
                feed_mm_per_s,
                line,
                ends_move: Shape::FIRST.ends_move(),
                counts: Shape::FIRST.counts(),
                entry: EntrySpeed::Bound,
            },
            lambda: 0.0,
            shape: Shape::FIRST,
            unit_10nm: unit_10nm as i32,
            filament_unit_100pm: filament_unit_100pm as i32,
            orders,
            feeds: Places::new(feed_mm_per_s),
            lambdas: Places::new(0.0),
            commands: Places::new(usize::MAX),
            text: [0; MAX_TEXT_BYTES],
        })
    }

    /// State at the start of the frame.
    pub fn start(&self) -> &FrameState {
        &self.start
    }

    /// The next item; `None` after the last.
    ///
    /// # Errors
    /// The content is invalid. Drop the decoder after an error.
    pub fn next_item(&mut self) -> Result<Option<Item<'_>>, Fault> {
        // The commonest items are recognised by their first four bits: a move of the same shape,
        // and the source of its speed.
        let (window, length) = loop {
            if self.left == 0 {
                if self.bits.left() >= 8 {
                    return Err(Fault::Content("the frame's end after its last item"));
                }
                return Ok(None);
            }
            self.left -= 1;
            let window = self.bits.window();
            let (length, entry) = match window.first(4) {
                0b0000..=0b0011 => (2, EntrySpeed::Bound),
                0b0100 | 0b0101 => (3, EntrySpeed::Falling),
                0b0110 => (4, EntrySpeed::Continues),
                first => match self.uncommon(first)? {
                    Uncommon::StateChange => continue,
                    Uncommon::Move(entry) => {
                        self.last.entry = entry;
                        break (self.bits.window(), 0);
                    }
                    Uncommon::Fan(power) => return Ok(Some(Item::Fan { line: self.last.line, power })),
                    Uncommon::Command => return self.command().map(Some),
                },
            };
            self.last.entry = entry;
            break (window.behind(length), length);
        };
        let mut bits = self.bits;
        bits.pass_unchecked(length);
        if self.plain_move(bits, window).is_none() {
            self.bits = bits;
            self.any_move()?;
        }
        Ok(Some(Item::Move(&self.last)))
    }

    /// An item that begins with these four bits.
    #[cold]
    #[inline(never)]
    fn uncommon(&mut self, first: u32) -> Result<Uncommon, Fault> {
        if first < 0b1000 {
            self.bits.pass(1)?;
            return self.entry().map(Uncommon::Move);
        }
        self.bits.pass(2)?;
        if first < 0b1100 {
            self.shape = Shape(self.bits.few(Shape::BITS)? as u8);
            (self.last.ends_move, self.last.counts) = (self.shape.ends_move(), self.shape.counts());
            return self.entry().map(Uncommon::Move);
        }
        self.other()
    }

    /// Reads a setting or another item that is not a move.
    fn other(&mut self) -> Result<Uncommon, Fault> {
        match self.bits.few(3)? {
            0 => {
                let place = self.bits.few(3)?;
                self.last.feed_mm_per_s = self.feeds.get(place).unwrap_or(self.last.feed_mm_per_s);
            }
            1 => {
                self.last.feed_mm_per_s = feed(&mut self.bits)?;
                self.feeds.put(self.last.feed_mm_per_s);
            }
            2 => {
                let place = self.bits.few(3)?;
                self.lambda = self.lambdas.get(place).unwrap_or(0.0);
            }
            3 => {
                self.lambda = f32::from_bits(self.bits.few(24)? << 8);
                self.lambdas.put(self.lambda);
            }
            4 => {
                let lines = self.bits.golomb(2)?;
                self.pass_lines(lines)?;
                self.pass_lines(1)?;
            }
            5 => {
                let lines = self.bits.golomb(1)?;
                self.pass_lines(lines)?;
                return Ok(Uncommon::Fan(self.bits.few(8)? as u8));
            }
            6 => {
                let lines = self.bits.golomb(1)?;
                self.pass_lines(lines)?;
                return Ok(Uncommon::Command);
            }
            _ => return Err(Fault::Content("an item of a kind from 0 to 6")),
        }
        Ok(Uncommon::StateChange)
    }

    fn pass_lines(&mut self, lines: u32) -> Result<(), Fault> {
        self.last.line = self.last.line.checked_add(lines).ok_or(Fault::Content("line numbers of 32 bits"))?;
        Ok(())
    }

    /// Decodes the move whose bits begin here and with the window, if it is a move along X and Y
    /// with predicted filament and short numbers. Otherwise returns `None` and changes nothing.
    #[inline(always)]
    fn plain_move(&mut self, mut bits: BitReader<'a>, window: Window) -> Option<()> {
        if !self.shape.is_plain() {
            return None;
        }
        let [order_x, order_y, _, order_filament] = &self.orders;
        let x = bits.signed_in(window, *order_x)?;
        let y = bits.signed_in(bits.window(), *order_y)?;
        let difference = bits.signed_in(bits.window(), *order_filament)?;
        bits.checked().ok()?;
        let [from_x, from_y, _] = self.last.target;
        let (to_x, to_y) = (after(from_x, x, self.unit_10nm)?, after(from_y, y, self.unit_10nm)?);
        let filament = prediction([x, y, 0], self.lambda).checked_add(difference)?;
        let line = self.last.line.checked_add(u32::from(!self.shape.same_line()))?;
        self.bits.go_to(bits);
        [self.last.target[0], self.last.target[1]] = [to_x, to_y];
        self.last.filament_100pm = i64::from(filament).wrapping_mul(i64::from(self.filament_unit_100pm));
        self.last.line = line;
        Some(())
    }

    /// Decodes any move.
    #[inline(never)]
    fn any_move(&mut self) -> Result<(), Fault> {
        let shape = self.shape;
        let [order_x, order_y, order_z, order_filament] = self.orders;
        let mut path = [0; 3];
        let axes = shape.path();
        if axes == PATH_XY || axes == PATH_XYZ {
            path[0] = self.bits.signed(order_x)?;
            path[1] = self.bits.signed(order_y)?;
        }
        if axes == PATH_XYZ || axes == PATH_Z {
            path[2] = self.bits.signed(order_z)?;
        }
        let mut target = self.last.target;
        for (coordinate, steps) in target.iter_mut().zip(path) {
            *coordinate = after(*coordinate, steps, self.unit_10nm).ok_or(TOO_FAR)?;
        }
        let unit = i64::from(self.filament_unit_100pm);
        let filament_100pm = match shape.filament() {
            FILAMENT_NONE => 0,
            FILAMENT_PREDICTED => {
                let difference = self.bits.signed(order_filament)?;
                // 33 bits times 10.
                (i64::from(prediction(path, self.lambda)) + i64::from(difference)) * unit
            }
            FILAMENT_ALL => {
                let filament = self.bits.signed_long(12)?;
                filament.checked_mul(unit).ok_or(Fault::Content("filament of at most 1 m in a move"))?
            }
            _ => return Err(Fault::Content("a filament of a kind from 0 to 2")),
        };
        // A move without path and filament has passed only the bits of its shape.
        self.bits.checked()?;
        if !shape.same_line() {
            self.pass_lines(1)?;
        }
        (self.last.target, self.last.filament_100pm) = (target, filament_100pm);
        Ok(())
    }

    fn entry(&mut self) -> Result<EntrySpeed, Fault> {
        if !self.bits.bit()? {
            return Ok(EntrySpeed::Bound);
        }
        if !self.bits.bit()? {
            return Ok(EntrySpeed::Falling);
        }
        if !self.bits.bit()? {
            return Ok(EntrySpeed::Continues);
        }
        let width = self.bits.few(6)?;
        Ok(EntrySpeed::Given(SquaredSpeed::from_units((1u64 << width | self.bits.many(width)?) - 1)))
    }

    fn command(&mut self) -> Result<Item<'_>, Fault> {
        const UNKNOWN: Fault = Fault::Content("a command of a kind from 0 to 2");
        let place = self.bits.position();
        let length = match self.bits.few(2)? {
            kind @ (0 | 2) => {
                self.commands.put(place);
                let mut bits = self.bits;
                let length = spell(&mut bits, kind, &mut self.text)?;
                self.bits = bits;
                length
            }
            1 => {
                let index = self.bits.few(3)?;
                let place = self.commands.get(index).filter(|place| *place < self.bits.position());
                let mut bits = self.bits.at(place.ok_or(Fault::Content("a command that was encoded before"))?);
                let kind = bits.few(2)?;
                spell(&mut bits, kind, &mut self.text)?
            }
            _ => return Err(UNKNOWN),
        };
        let text = self.text.get(..length).and_then(|bytes| core::str::from_utf8(bytes).ok());
        Ok(Item::Command { line: self.last.line, text: text.ok_or(Fault::Content("a command of UTF-8"))? })
    }
}

fn feed(bits: &mut BitReader<'_>) -> Result<f32, Fault> {
    let feed = f32::from_bits(bits.many(32)? as u32);
    if feed > 0.0 && feed.is_finite() { Ok(feed) } else { Err(Fault::Content("a feed above zero")) }
}

/// Assembles a command's text; returns its length.
fn spell(bits: &mut BitReader<'_>, kind: u32, text: &mut [u8; MAX_TEXT_BYTES]) -> Result<usize, Fault> {
    if kind == 0 {
        let length = bits.few(8)? as usize;
        for byte in text.iter_mut().take(length) {
            *byte = bits.few(8)? as u8;
        }
        return Ok(length);
    }
    if kind != 2 {
        return Err(Fault::Content("a command that was encoded before"));
    }
    let mut text = Spelling { text, length: 0 };
    let letter = match bits.few(2)? {
        0 => b'G',
        1 => b'M',
        2 => b'T',
        _ => return Err(Fault::Content("a command that begins with G, M or T")),
    };
    text.put(letter);
    text.number(bits.golomb(6)?);
    for _ in 0..bits.few(3)? {
        text.put(b' ');
        let letter = bits.few(5)? as u8;
        if letter >= 26 {
            return Err(Fault::Content("a word that begins with a letter"));
        }
        text.put(b'A' + letter);
        if bits.bit()? {
            let value = bits.signed(Order::new(5))?;
            if value < 0 {
                text.put(b'-');
            }
            text.number(value.unsigned_abs());
        }
    }
    Ok(text.length)
}

/// Text under construction. The longest, of a letter and a number and seven words of ten digits
/// with a sign, has 107 bytes.
struct Spelling<'a> {
    text: &'a mut [u8; MAX_TEXT_BYTES],
    length: usize,
}

impl Spelling<'_> {
    fn put(&mut self, byte: u8) {
        if let Some(place) = self.text.get_mut(self.length) {
            *place = byte;
            self.length += 1;
        }
    }

    fn number(&mut self, number: u32) {
        let mut divisor = 1_000_000_000;
        while divisor > 1 && number < divisor {
            divisor /= 10;
        }
        while divisor > 0 {
            self.put(b'0' + (number / divisor % 10) as u8);
            divisor /= 10;
        }
    }
}
