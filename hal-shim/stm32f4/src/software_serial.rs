//! A serial line of one wire by software: the bit machine, without registers.
//!
//! A timer calls [`SoftwareSerial::tick`] [`TICKS_A_BIT`] times a bit, passes the level of the pin,
//! and drives the pin as it returns. 8 bits, no parity, one stop bit, lowest bit first; the line is
//! high at rest. While no byte is sent or awaited the timer may be stopped
//! ([`SoftwareSerial::is_quiet`]).
//!
//! Two of three samples around the middle of a bit decide its value, so that a disturbance shorter
//! than a sample's interval does no harm. Every byte is timed from its own start bit, which is
//! found to within a quarter of a bit: the last sample of a byte may drift by half a bit less that
//! quarter in ten bits, 2.5 %, before a bit is read wrongly (1.8 % if the timer itself is a tenth
//! of its interval early or late). The chip replies at the speed that it measured in the request
//! (TMC2209 data sheet, section 4.1), so the remaining error is its clock's resolution, 1/625 of a
//! bit at 19,200 baud.

use ferrostep_tmc2209::{LineBusy, LineBytes, SingleWireUart};

/// Calls of [`SoftwareSerial::tick`] a bit.
pub const TICKS_A_BIT: u8 = 4;

/// Bits of a byte: start, eight, stop.
const BITS: u8 = 10;

/// Drive of the pin until the next tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PinAction {
    /// Drive it low.
    Low,
    /// Drive it high.
    High,
    /// Release it: a pull-up holds it high, or the other side drives it.
    Release,
}

/// The line's state.
#[derive(Clone, Copy, Debug, Default)]
pub struct SoftwareSerial {
    line: u8,
    bytes: LineBytes,
    /// Ticks since the present byte's start bit began.
    sent_ticks: u8,
    receiver: Receiver,
    damaged: u32,
}

#[derive(Clone, Copy, Debug, Default)]
struct Receiver {
    /// Ticks since a start bit began; `None` while the line is high.
    ticks: Option<u8>,
    /// The bits so far, the first lowest.
    bits: u16,
    /// Samples of the present bit that were high.
    high: u8,
}

/// The result of a sample.
enum Heard {
    Byte(u8),
    /// A byte without its stop bit.
    Damaged,
}

impl Receiver {
    fn sample(&mut self, level: bool) -> Option<Heard> {
        let Some(ticks) = self.ticks else {
            if !level {
                *self = Self { ticks: Some(1), bits: 0, high: 0 };
            }
            return None;
        };
        self.ticks = Some(ticks + 1);
        // The first sample of a bit is near its edge: three remain, around its middle.
        if ticks % TICKS_A_BIT == 0 {
            self.high = 0;
            return None;
        }
        self.high += u8::from(level);
        let bit = self.high >= 2;
        // A stop bit is over as soon as it is sure: a fast sender's next byte may begin with
        // the next sample.
        let is_sure = bit && ticks / TICKS_A_BIT == BITS - 1;
        if ticks % TICKS_A_BIT != TICKS_A_BIT - 1 && !is_sure {
            return None;
        }
        match ticks / TICKS_A_BIT {
            // Shorter than a start bit: a disturbance.
            0 if bit => {
                self.ticks = None;
                None
            }
            index if index == BITS - 1 => {
                self.ticks = None;
                Some(if bit { Heard::Byte((self.bits >> 1) as u8) } else { Heard::Damaged })
            }
            index => {
                self.bits |= u16::from(bit) << index;
                None
            }
        }
    }
}

impl SoftwareSerial {
    /// A line at rest.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            line: 0,
            bytes: LineBytes::new(),
            sent_ticks: 0,
            receiver: Receiver { ticks: None, bits: 0, high: 0 },
            damaged: 0,
        }
    }

    /// A quarter of a bit has passed: `level` is the pin's now. The returned drive holds
    /// until the next tick.
    pub fn tick(&mut self, level: bool) -> PinAction {
        match self.receiver.sample(level) {
            None => {}
            Some(Heard::Byte(byte)) => self.bytes.keep(byte),
            Some(Heard::Damaged) => self.damaged = self.damaged.wrapping_add(1),
        }
        self.next_action()
    }

    fn next_action(&mut self) -> PinAction {
        let Some(byte) = self.bytes.to_send() else { return PinAction::Release };
        let bit = self.sent_ticks / TICKS_A_BIT;
        self.sent_ticks += 1;
        if self.sent_ticks >= BITS * TICKS_A_BIT {
            self.sent_ticks = 0;
            self.bytes.has_sent();
        }
        // After the start bit, 0, come the byte's and the stop bit, 1.
        let level = (u16::from(byte) | 0x100) << 1;
        if level >> bit & 1 == 1 { PinAction::High } else { PinAction::Low }
    }

    /// Returns true while something is being sent.
    #[must_use]
    pub const fn is_sending(&self) -> bool {
        self.bytes.has_more()
    }

    /// Returns true if nothing is being sent or received at this moment.
    #[must_use]
    pub const fn is_quiet(&self) -> bool {
        !self.is_sending() && self.receiver.ticks.is_none()
    }

    /// Line in use, whose pin is sampled and driven.
    #[must_use]
    pub const fn line(&self) -> u8 {
        self.line
    }

    /// Bytes that came without a stop bit.
    #[must_use]
    pub const fn damaged(&self) -> u32 {
        self.damaged
    }
}

impl SingleWireUart for SoftwareSerial {
    fn send(&mut self, line: u8, bytes: &[u8], _now_ticks: u32) -> Result<(), LineBusy> {
        if self.is_sending() {
            return Err(LineBusy);
        }
        *self = Self { line, damaged: self.damaged, ..Self::new() };
        self.bytes.begin(bytes);
        Ok(())
    }

    fn receive(&mut self, _now_ticks: u32) -> Option<u8> {
        self.bytes.take()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use proptest::prelude::*;

    /// Level of an ideal sender at a time in bits: it begins at `start`, its bits
    /// are `length` long.
    fn level_at(bytes: &[u8], start: f64, length: f64, time: f64) -> bool {
        let bit = (time - start) / length;
        if bit < 0.0 {
            return true;
        }
        let bit = bit as usize;
        match (bytes.get(bit / 10), bit % 10) {
            (None, _) | (_, 9) => true,
            (_, 0) => false,
            (Some(byte), index) => byte >> (index - 1) & 1 == 1,
        }
    }

    fn all(serial: &mut SoftwareSerial) -> Vec<u8> {
        std::iter::from_fn(|| serial.receive(0)).collect()
    }

    #[test]
    fn a_byte_bit_for_bit_and_its_echo() {
        let mut serial = SoftwareSerial::new();
        assert!(serial.is_quiet());
        serial.send(2, &[0x05, 0xff], 0).unwrap();
        assert_eq!((serial.line(), serial.send(1, &[1], 0)), (2, Err(LineBusy)));
        let mut level = true;
        let mut levels = Vec::new();
        for _ in 0..100 {
            let action = serial.tick(level);
            level = action != PinAction::Low;
            levels.push(action);
        }
        let expected: Vec<_> = [0, 1, 0, 1, 0, 0, 0, 0, 0, 1, 0, 1, 1, 1, 1, 1, 1, 1, 1, 1]
            .into_iter()
            .flat_map(|bit| [if bit == 1 { PinAction::High } else { PinAction::Low }; 4])
            .collect();
        assert_eq!(levels[..80], expected);
        assert!(levels[80..].iter().all(|action| *action == PinAction::Release));
        assert_eq!(all(&mut serial), [0x05, 0xff]);
        assert!(serial.is_quiet());
    }

    #[test]
    fn nobody_waits_for_a_line_that_is_held_low() {
        let mut serial = SoftwareSerial::new();
        serial.send(0, &[0x55; 4], 0).unwrap();
        for _ in 0..1000 {
            serial.tick(false);
        }
        assert!(!serial.is_sending());
        assert_eq!(all(&mut serial), []);
        assert!(serial.damaged() > 10);
    }

    #[test]
    fn what_nobody_takes_is_bounded() {
        let mut serial = SoftwareSerial::new();
        let bytes: Vec<u8> = (0..40).collect();
        for tick in 0..1800 {
            serial.tick(level_at(&bytes, 0.0, 1.0, f64::from(tick) / 4.0));
        }
        assert_eq!(all(&mut serial), bytes[..16]);
    }

    proptest! {
        /// 1.8 % off, each sample up to a tenth of its interval early or late, any phase.
        #[test]
        fn a_sender_with_another_clock_is_understood(
            bytes in proptest::collection::vec(any::<u8>(), 1..12),
            length in 0.982..1.018,
            phase in 0.0..1.0,
            jitter in proptest::collection::vec(-0.025..0.025, 560),
        ) {
            let mut serial = SoftwareSerial::new();
            for (tick, jitter) in (0_u16..).zip(&jitter) {
                serial.tick(level_at(&bytes, 3.0 + phase, length, f64::from(tick) / 4.0 + jitter));
            }
            prop_assert_eq!(all(&mut serial), bytes);
            prop_assert_eq!(serial.damaged(), 0);
        }

        #[test]
        fn a_single_wrong_sample_a_bit_does_no_harm(
            bytes in proptest::collection::vec(any::<u8>(), 1..12),
            wrong in proptest::collection::vec(0_u16..3, 130),
        ) {
            let mut serial = SoftwareSerial::new();
            // In phase: the sender's edges are right before the first sample of a bit.
            for tick in 0..520_u16 {
                let level = level_at(&bytes, 3.0, 1.0, f64::from(tick) / 4.0 + 0.01);
                let inside = tick >= 12 && tick < 12 + bytes.len() as u16 * 40;
                // A wrong sample right before a start bit is taken for its edge, which only a clean
                // start bit makes good.
                let before_start = (tick - tick.min(12)) % 40 == 39;
                let disturbed = inside && tick % 4 == 1 + wrong[usize::from(tick / 4)] && !before_start;
                serial.tick(level ^ disturbed);
            }
            prop_assert_eq!(all(&mut serial), bytes);
        }

        #[test]
        fn noise_ends_in_bytes_or_nothing(levels in proptest::collection::vec(any::<bool>(), 0..2000)) {
            let mut serial = SoftwareSerial::new();
            serial.send(0, &[1, 2, 3, 4], 0).unwrap();
            for level in levels {
                serial.tick(level);
            }
            prop_assert!(all(&mut serial).len() <= 16);
        }
    }

    #[test]
    fn a_clock_that_is_too_far_off_is_not_understood() {
        let wrong = (0..40).any(|phase| {
            let mut serial = SoftwareSerial::new();
            for tick in 0..60_u16 {
                serial.tick(level_at(&[0x80], 1.0 + f64::from(phase) / 40.0, 1.08, f64::from(tick) / 4.0));
            }
            all(&mut serial) != [0x80]
        });
        assert!(wrong);
    }
}
