//! Writes items as the reader understands them.

use std::borrow::ToOwned;
use std::string::String;
use std::vec::Vec;

use super::steps::Steps;
use super::waiting::Place;
use crate::bits::BitWriter;
use crate::compact::shape::{FILAMENT_ALL, FILAMENT_PREDICTED, PATH_XY, PATH_XYZ, PATH_Z, PLACES, Shape};
use crate::item::{EntrySpeed, PreparedMove};

/// Items as the reader understands them, with what it knows after them.
pub struct ItemWriter {
    /// The items.
    pub bits: BitWriter,
    /// Number of items.
    pub count: u64,
    /// Source line of the last item.
    pub line: u32,
    feed: f32,
    lambda: f32,
    shape: Shape,
    feeds: Vec<Option<f32>>,
    next_feed: usize,
    lambdas: Vec<f32>,
    next_lambda: usize,
    commands: Vec<Option<String>>,
    next_command: usize,
}

impl ItemWriter {
    /// An empty writer of a frame that begins here.
    pub fn new(start: &Place) -> Self {
        Self {
            bits: BitWriter::default(),
            count: 0,
            line: start.line,
            feed: start.feed_mm_per_s,
            lambda: 0.0,
            shape: Shape::FIRST,
            feeds: std::vec![Some(start.feed_mm_per_s); PLACES],
            next_feed: 0,
            lambdas: std::vec![0.0; PLACES],
            next_lambda: 0,
            commands: std::vec![None; PLACES],
            next_command: 0,
        }
    }

    /// Begins an item that is not a move.
    pub fn begin_other(&mut self, kind: u64) {
        self.count += 1;
        self.bits.bits(0b11, 2);
        self.bits.bits(kind, 3);
    }

    /// Adds a move, after the settings that it needs.
    pub fn add_move(&mut self, next: &PreparedMove, steps: &Steps, lambda: f32, orders: [u32; 4]) {
        let lines = next.line.saturating_sub(self.line);
        let same_line = lines == 0;
        if lines > 1 {
            self.begin_other(4);
            self.bits.golomb(u64::from(lines) - 2, 2);
        }
        self.line = next.line;
        if next.feed_mm_per_s != self.feed {
            self.feed = next.feed_mm_per_s;
            if let Some(place) = self.feeds.iter().position(|feed| *feed == Some(self.feed)) {
                self.begin_other(0);
                self.bits.bits(place as u64, 3);
            } else {
                self.begin_other(1);
                self.bits.bits(self.feed.to_bits().into(), 32);
                self.feeds[self.next_feed] = Some(self.feed);
                self.next_feed = (self.next_feed + 1) % PLACES;
            }
        }
        let (kind, filament) = steps.encoded_filament(lambda);
        if kind == FILAMENT_PREDICTED && lambda != self.lambda {
            self.lambda = lambda;
            if let Some(place) = self.lambdas.iter().position(|known| *known == lambda) {
                self.begin_other(2);
                self.bits.bits(place as u64, 3);
            } else {
                self.begin_other(3);
                self.bits.bits(u64::from(lambda.to_bits() >> 8), 24);
                self.lambdas[self.next_lambda] = lambda;
                self.next_lambda = (self.next_lambda + 1) % PLACES;
            }
        }
        // The flag has no meaning without filament.
        let counts = next.counts;
        let shape = Shape(
            steps.kind << 5 | kind << 3 | u8::from(same_line) << 2 | u8::from(next.ends_move) << 1 | u8::from(counts),
        );
        self.count += 1;
        if shape == self.shape {
            self.bits.bits(0, 1);
        } else {
            self.bits.bits(0b10, 2);
            self.bits.bits(shape.0.into(), Shape::BITS);
            self.shape = shape;
        }
        match next.entry {
            EntrySpeed::Bound => self.bits.bits(0, 1),
            EntrySpeed::Falling => self.bits.bits(0b10, 2),
            EntrySpeed::Continues => self.bits.bits(0b110, 3),
            EntrySpeed::Given(squared) => {
                let squared = squared.units().saturating_add(1);
                let width = 63 - squared.leading_zeros();
                self.bits.bits(0b111, 3);
                self.bits.bits(width.into(), 6);
                self.bits.bits(squared, width);
            }
        }
        let [x, y, z] = steps.path;
        if steps.kind == PATH_XY || steps.kind == PATH_XYZ {
            self.bits.signed(x.into(), orders[0]);
            self.bits.signed(y.into(), orders[1]);
        }
        if steps.kind == PATH_Z || steps.kind == PATH_XYZ {
            self.bits.signed(z.into(), orders[2]);
        }
        match kind {
            FILAMENT_PREDICTED => self.bits.signed(filament, orders[3]),
            FILAMENT_ALL => self.bits.signed(filament, 12),
            _ => {}
        }
    }

    /// Adds a command.
    pub fn add_command(&mut self, line: u32, text: &str) {
        self.begin_other(6);
        self.bits.golomb(u64::from(line.saturating_sub(self.line)), 1);
        self.line = line;
        if let Some(place) = self.commands.iter().position(|known| known.as_deref() == Some(text)) {
            self.bits.bits(1, 2);
            self.bits.bits(place as u64, 3);
            return;
        }
        self.commands[self.next_command] = Some(text.to_owned());
        self.next_command = (self.next_command + 1) % PLACES;
        if let Some((letter, number, words)) = as_words(text) {
            self.bits.bits(2, 2);
            self.bits.bits(letter, 2);
            self.bits.golomb(number.into(), 6);
            self.bits.bits(words.len() as u64, 3);
            for (letter, value) in words {
                self.bits.bits(u64::from(letter - b'A'), 5);
                self.bits.bits(value.is_some().into(), 1);
                if let Some(value) = value {
                    self.bits.signed(value.into(), 5);
                }
            }
        } else {
            self.bits.bits(0, 2);
            self.bits.bits(text.len() as u64, 8);
            for byte in text.bytes() {
                self.bits.bits(byte.into(), 8);
            }
        }
    }
}

/// A word of a command: its letter and its number.
type Word = (u8, Option<i32>);

/// A command as letters and whole numbers; `None` if it contains anything else.
fn as_words(text: &str) -> Option<(u64, u32, Vec<Word>)> {
    let mut parts = text.split(' ');
    let first = parts.next()?;
    let letter = match first.as_bytes().first()? {
        b'G' => 0,
        b'M' => 1,
        b'T' => 2,
        _ => return None,
    };
    let number: u32 = first.get(1..)?.parse().ok()?;
    let mut words = Vec::new();
    let mut again = std::format!("{}{number}", &first[..1]);
    for part in parts {
        let letter = *part.as_bytes().first()?;
        if !letter.is_ascii_uppercase() || words.len() == 7 {
            return None;
        }
        let value = match part.get(1..)? {
            "" => None,
            digits => Some(digits.parse::<i32>().ok().filter(|value| value.abs() < 1 << 30)?),
        };
        again += &match value {
            None => std::format!(" {}", char::from(letter)),
            Some(value) => std::format!(" {}{value}", char::from(letter)),
        };
        words.push((letter, value));
    }
    // Only a text that would be read back unchanged: no leading zeros, no plus signs.
    (again == text && number < 1 << 20).then_some((letter, number, words))
}
