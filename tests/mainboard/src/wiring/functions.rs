//! Converter and timer channels of each pin.
//!
//! Sources: the pin tables and the tables of alternate functions of the data sheets DS8626 (F405,
//! F407: tables 7 and 9) and DS10693 (F446: tables 10 and 11). Left out: complementary outputs
//! (CHxN), and ports H and I, which no package here has.

use std::fmt;

use super::chip::Chip;
use crate::pins::Pin;

/// A converter's channel, such as ADC3_IN9.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Adc {
    /// 1 to 3.
    pub converter: u8,
    /// 0 to 15.
    pub channel: u8,
}

impl Adc {
    /// Reads "ADC1_IN10".
    pub(super) fn parse(text: &str) -> Option<Self> {
        let (converter, channel) = text.strip_prefix("ADC")?.split_once("_IN")?;
        let adc = Self { converter: converter.parse().ok()?, channel: channel.parse().ok()? };
        (adc.to_string() == text).then_some(adc)
    }

    /// The pin of this channel; `None` if no pin has it.
    #[must_use]
    pub fn pin(self) -> Option<Pin> {
        let (port, number) = match (self.converter, self.channel) {
            (1..=3, 0..=3) => ('A', self.channel),
            (1..=3, 10..=13) => ('C', self.channel - 10),
            (1 | 2, 4..=7) => ('A', self.channel),
            (1 | 2, 8 | 9) => ('B', self.channel - 8),
            (1 | 2, 14 | 15) => ('C', self.channel - 10),
            (3, 4..=8) => ('F', self.channel + 2),
            (3, 9) => ('F', 3),
            (3, 14 | 15) => ('F', self.channel - 10),
            _ => return None,
        };
        Some(at(port, number))
    }

    /// All channels at a pin.
    #[must_use]
    pub fn all_at(pin: Pin) -> Vec<Self> {
        (1..=3)
            .flat_map(|converter| (0..=15).map(move |channel| Self { converter, channel }))
            .filter(|adc| adc.pin() == Some(pin))
            .collect()
    }
}

impl fmt::Display for Adc {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "ADC{}_IN{}", self.converter, self.channel)
    }
}

/// A timer's channel, such as TIM3_CH4.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct TimerChannel {
    /// 1 to 5 and 8 to 14.
    pub timer: u8,
    /// 1 to 4.
    pub channel: u8,
}

impl TimerChannel {
    /// Reads "TIM3_CH4".
    pub(super) fn parse(text: &str) -> Option<Self> {
        let (timer, channel) = text.strip_prefix("TIM")?.split_once("_CH")?;
        let timer_channel = Self { timer: timer.parse().ok()?, channel: channel.parse().ok()? };
        (timer_channel.to_string() == text).then_some(timer_channel)
    }

    /// The alternate function that connects a pin to this timer, 1 to 9; `None` for a
    /// timer without pins.
    #[must_use]
    pub fn alternate_function(self) -> Option<u8> {
        match self.timer {
            1 | 2 => Some(1),
            3..=5 => Some(2),
            8..=11 => Some(3),
            12..=14 => Some(9),
            _ => None,
        }
    }

    /// The pins of this channel that the chip's package has.
    #[must_use]
    pub fn pins(self, chip: Chip) -> Vec<Pin> {
        let of_all = CHANNELS.iter();
        let of_f446 = F446_CHANNELS.iter().filter(|_| chip == Chip::F446);
        of_all
            .chain(of_f446)
            .filter(|(timer, channel, ..)| (*timer, *channel) == (self.timer, self.channel))
            .map(|(_, _, port, number)| at(*port, *number))
            .filter(|pin| chip.has_pin(*pin))
            .collect()
    }

    /// All channels at a pin.
    #[must_use]
    pub fn all_at(chip: Chip, pin: Pin) -> Vec<Self> {
        (1..=14)
            .flat_map(|timer| (1..=4).map(move |channel| Self { timer, channel }))
            .filter(|timer_channel| timer_channel.pins(chip).contains(&pin))
            .collect()
    }
}

impl fmt::Display for TimerChannel {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "TIM{}_CH{}", self.timer, self.channel)
    }
}

/// The pins at which USART1 sends.
pub(super) const USART1_TX: [Pin; 2] = [at('A', 9), at('B', 6)];
/// The pins at which USART1 receives.
pub(super) const USART1_RX: [Pin; 2] = [at('A', 10), at('B', 7)];
/// USB's pins, D- and D+.
pub(super) const USB: [Pin; 2] = [at('A', 11), at('A', 12)];
/// The SDIO's pins at alternate function 12: clock, command line, D0 to D3. The F446 has others too
/// (PA6, PB0 to PB2, PB4, PB5), which no board here uses.
pub(super) const SDIO_CK: Pin = at('C', 12);
pub(super) const SDIO_CMD: Pin = at('D', 2);
pub(super) const SDIO_DATA: [Pin; 4] = [at('C', 8), at('C', 9), at('C', 10), at('C', 11)];
/// The pins of the crystal.
pub(super) const CRYSTAL: [Pin; 2] = [at('H', 0), at('H', 1)];

const fn at(port: char, number: u8) -> Pin {
    Pin { port: port as u8 - b'A', number }
}

/// Timer, channel, port and pin, for all three chips.
const CHANNELS: [(u8, u8, char, u8); 53] = [
    (1, 1, 'A', 8),
    (1, 1, 'E', 9),
    (1, 2, 'A', 9),
    (1, 2, 'E', 11),
    (1, 3, 'A', 10),
    (1, 3, 'E', 13),
    (1, 4, 'A', 11),
    (1, 4, 'E', 14),
    (2, 1, 'A', 0),
    (2, 1, 'A', 5),
    (2, 1, 'A', 15),
    (2, 2, 'A', 1),
    (2, 2, 'B', 3),
    (2, 3, 'A', 2),
    (2, 3, 'B', 10),
    (2, 4, 'A', 3),
    (2, 4, 'B', 11),
    (3, 1, 'A', 6),
    (3, 1, 'B', 4),
    (3, 1, 'C', 6),
    (3, 2, 'A', 7),
    (3, 2, 'B', 5),
    (3, 2, 'C', 7),
    (3, 3, 'B', 0),
    (3, 3, 'C', 8),
    (3, 4, 'B', 1),
    (3, 4, 'C', 9),
    (4, 1, 'B', 6),
    (4, 1, 'D', 12),
    (4, 2, 'B', 7),
    (4, 2, 'D', 13),
    (4, 3, 'B', 8),
    (4, 3, 'D', 14),
    (4, 4, 'B', 9),
    (4, 4, 'D', 15),
    (5, 1, 'A', 0),
    (5, 2, 'A', 1),
    (5, 3, 'A', 2),
    (5, 4, 'A', 3),
    (8, 1, 'C', 6),
    (8, 2, 'C', 7),
    (8, 3, 'C', 8),
    (8, 4, 'C', 9),
    (9, 1, 'A', 2),
    (9, 1, 'E', 5),
    (9, 2, 'A', 3),
    (9, 2, 'E', 6),
    (10, 1, 'B', 8),
    (11, 1, 'B', 9),
    (12, 1, 'B', 14),
    (12, 2, 'B', 15),
    (13, 1, 'A', 6),
    (14, 1, 'A', 7),
];

/// Channels that only the F446 has: port F, which the other two packages lack, and
/// three pins of TIM2.
const F446_CHANNELS: [(u8, u8, char, u8); 7] = [
    (2, 1, 'B', 8),
    (2, 2, 'B', 9),
    (2, 4, 'B', 2),
    (10, 1, 'F', 6),
    (11, 1, 'F', 7),
    (13, 1, 'F', 8),
    (14, 1, 'F', 9),
];
