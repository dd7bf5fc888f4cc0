#![allow(clippy::unwrap_used)]
use std::cell::{Cell, RefCell};

use super::*;
use crate::gpio::{GPIO, GPIO_STRIDE};

/// The Octopus's, and a bus on two ports.
const PINS: [I2cPins; 2] = [I2cPins { scl: (1, 8), sda: (1, 9) }, I2cPins { scl: (2, 0), sda: (0, 15) }];

/// An event on the wires.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Said {
    Start,
    /// A byte, and whether it was acknowledged.
    Byte(u8, bool),
    Stop,
}
use Said::{Byte, Start, Stop};

/// Two wires with pull-ups, and a part at 0x50 that answers reads with 1, 2, 3, and so on. It
/// listens to the levels only.
struct Wires {
    pins: I2cPins,
    /// The master's outputs: released (true) or pulled low.
    master: [bool; 2],
    part_sda: bool,
    said: Vec<Said>,
    bits: Vec<bool>,
    /// Byte that the part sends when the clock falls next.
    sends: Option<u8>,
    next: u8,
    acknowledges: usize,
    is_addressed: bool,
    /// Clocks until a part that was interrupted releases SDA.
    stuck_sda: u32,
    stuck_scl: bool,
    /// Halves of a period that the part holds the clock after an address.
    holds: u32,
    held_until: u32,
    halves: u32,
    /// Shortest distance of two edges of the clock, halves of a period.
    closest_clock_edges: u32,
    last_clock_edge: u32,
}

impl Wires {
    fn new(pins: I2cPins) -> Self {
        Self {
            pins,
            master: [true; 2],
            part_sda: true,
            said: Vec::new(),
            bits: Vec::new(),
            sends: None,
            next: 1,
            acknowledges: usize::MAX,
            is_addressed: false,
            stuck_sda: 0,
            stuck_scl: false,
            holds: 0,
            held_until: 0,
            halves: 0,
            closest_clock_edges: u32::MAX,
            last_clock_edge: 0,
        }
    }

    fn levels(&self) -> [bool; 2] {
        let holds = self.stuck_scl || self.halves < self.held_until;
        [self.master[0] && !holds, self.master[1] && self.part_sda && self.stuck_sda == 0]
    }

    fn change(&mut self, change: impl FnOnce(&mut Self)) {
        let before = self.levels();
        change(self);
        let now = self.levels();
        if now[0] != before[0] {
            self.closest_clock_edges = self.closest_clock_edges.min(self.halves - self.last_clock_edge);
            self.last_clock_edge = self.halves;
            if now[0] { self.rises(now[1]) } else { self.falls() }
        } else if now[1] != before[1] && now[0] {
            // Data change while the clock is high: a condition.
            self.said.push(if now[1] { Stop } else { Start });
            self.bits.clear();
            self.sends = None;
            self.part_sda = true;
            self.is_addressed = false;
        }
    }

    fn rises(&mut self, sda: bool) {
        self.stuck_sda = self.stuck_sda.saturating_sub(1);
        self.bits.push(sda);
    }

    fn falls(&mut self) {
        let byte = self.bits.iter().take(8).fold(0, |byte, bit| byte << 1 | u8::from(*bit));
        let is_address = matches!(self.said.last(), Some(Start));
        match self.bits.len() {
            8 if self.sends.is_none() => {
                self.is_addressed |= is_address && byte >> 1 == 0x50;
                let answers = self.acknowledges > 0 && self.is_addressed;
                self.part_sda = !answers;
                self.acknowledges -= usize::from(answers);
                if is_address {
                    self.held_until = self.halves + self.holds;
                }
            }
            8 => self.part_sda = true,
            9 => {
                let acknowledged = !self.bits[8];
                self.bits.clear();
                let sent_by_part = self.sends.take().is_some();
                if acknowledged && (sent_by_part || is_address && byte & 1 == 1) {
                    self.sends = Some(self.next);
                    self.next += 1;
                }
                self.said.push(Byte(byte, acknowledged));
                self.part_sda = self.sends.is_none_or(|sent| sent >> 7 == 1);
            }
            sent => {
                if let Some(byte) = self.sends {
                    self.part_sda = byte >> (7 - sent) & 1 == 1;
                }
            }
        }
    }
}

struct Ports<'a>(&'a RefCell<Wires>);

impl Registers for Ports<'_> {
    fn read(&mut self, address: u32) -> u32 {
        assert_eq!((address - GPIO) % GPIO_STRIDE, IDR);
        let port = ((address - GPIO) / GPIO_STRIDE) as u8;
        let wires = self.0.borrow();
        let lines = [wires.pins.scl, wires.pins.sda].into_iter().zip(wires.levels());
        lines
            .filter(|((of, _), high)| *of == port && !high)
            .fold(u32::MAX, |word, ((_, number), _)| word & !(1 << number))
    }

    fn write(&mut self, address: u32, value: u32) {
        assert_eq!(((address - GPIO) % GPIO_STRIDE, value.count_ones()), (BSRR, 1), "one pin alone");
        let port = ((address - GPIO) / GPIO_STRIDE) as u8;
        let pin = (port, value.trailing_zeros() as u8 & 15);
        let mut wires = self.0.borrow_mut();
        let line = [wires.pins.scl, wires.pins.sda].iter().position(|of| *of == pin).unwrap();
        wires.change(|wires| wires.master[line] = value < 1 << 16);
    }
}

struct Halves<'a>(&'a RefCell<Wires>);

impl BusPace for Halves<'_> {
    const HALF_PERIOD_NS: u32 = 5_000;

    fn half_period(&mut self) {
        self.0.borrow_mut().change(|wires| wires.halves += 1);
    }
}

type Bus<'a> = SoftwareI2c<Ports<'a>, Halves<'a>>;

/// Runs an action on wires, and returns its result with the events on the wires.
fn after<T>(change: impl Fn(&mut Wires), act: impl Fn(&mut Bus<'_>) -> T) -> (T, Vec<Said>) {
    let mut results = PINS.map(|pins| {
        let wires = RefCell::new(Wires::new(pins));
        change(&mut wires.borrow_mut());
        let result = act(&mut SoftwareI2c::new(Ports(&wires), pins, Halves(&wires)));
        let wires = wires.into_inner();
        assert_eq!(wires.master, [true; 2], "both lines are released");
        assert!(wires.closest_clock_edges >= 1, "each half of the clock lasts");
        (result, wires.said)
    });
    // The pins make no difference.
    assert_eq!(results[0].1, results[1].1);
    let [first, _] = &mut results;
    let said = std::mem::take(&mut first.1);
    let [(result, _), _] = results;
    (result, said)
}

const ADDRESS_SILENT: I2cFault = I2cFault::NoAcknowledge(NoAcknowledgeSource::Address);

#[test]
fn bytes_go_both_ways() {
    let (written, said) = after(|_| {}, |bus| bus.write(0x50, &[0x12, 0x80, 0xff]));
    assert_eq!(written, Ok(()));
    assert_eq!(said, [Start, Byte(0xa0, true), Byte(0x12, true), Byte(0x80, true), Byte(0xff, true), Stop]);
    let (read, said) = after(
        |wires| wires.next = 0x7f,
        |bus| {
            let mut read = [0; 3];
            bus.write_read(0x50, &[0x0f, 0xe0], &mut read).map(|()| read)
        },
    );
    assert_eq!(read, Ok([0x7f, 0x80, 0x81]));
    // A repeated start, and no acknowledge after the last byte.
    let written = [Start, Byte(0xa0, true), Byte(0x0f, true), Byte(0xe0, true)];
    let rest = [Start, Byte(0xa1, true), Byte(0x7f, true), Byte(0x80, true), Byte(0x81, false), Stop];
    assert_eq!(said, [&written[..], &rest].concat());
}

/// The contract of embedded-hal: operations in one direction are one run of bytes.
#[test]
fn operations_in_one_direction_are_joined() {
    let (read, said) = after(
        |_| {},
        |bus| {
            let (mut first, mut second) = ([0; 2], [0; 1]);
            let mut operations = [
                Operation::Write(&[7]),
                Operation::Write(&[8]),
                Operation::Read(&mut first),
                Operation::Read(&mut second),
            ];
            bus.transaction(0x50, &mut operations).map(|()| (first, second))
        },
    );
    assert_eq!(read, Ok(([1, 2], [3])));
    let bytes = [Byte(0xa1, true), Byte(1, true), Byte(2, true), Byte(3, false), Stop];
    assert_eq!(said, [&[Start, Byte(0xa0, true), Byte(7, true), Byte(8, true), Start][..], &bytes].concat());
}

#[test]
fn a_missing_acknowledge_ends_the_transfer_with_a_stop() {
    let (written, said) = after(|_| {}, |bus| bus.write(0x51, &[1, 2]));
    assert_eq!((written, said), (Err(ADDRESS_SILENT), vec![Start, Byte(0xa2, false), Stop]));
    let (written, said) = after(|wires| wires.acknowledges = 2, |bus| bus.write(0x50, &[1, 2, 3]));
    assert_eq!(written, Err(I2cFault::NoAcknowledge(NoAcknowledgeSource::Data)));
    assert_eq!(said, [Start, Byte(0xa0, true), Byte(1, true), Byte(2, false), Stop]);
    // Afterwards the bus works.
    let (written, _) = after(|_| {}, |bus| bus.write(0x51, &[1]).and(bus.write(0x50, &[1])));
    assert_eq!(written, Err(ADDRESS_SILENT));
    let (written, _) = after(|_| {}, |bus| bus.write(0x51, &[1]).is_err() && bus.write(0x50, &[1]).is_ok());
    assert!(written);
}

/// A part that this chip's reset has interrupted within any bit of any byte is free again, and
/// hears the next address.
#[test]
fn an_interrupted_read_is_ended() {
    for byte in 0..=255 {
        for bits in 0..8 {
            let interrupt = |wires: &mut Wires| {
                wires.sends = Some(byte);
                wires.bits = vec![false; bits];
                wires.part_sda = byte >> (7 - bits) & 1 == 1;
                // The clock, which was low, has risen with the reset.
                wires.bits.push(wires.part_sda);
            };
            let (written, said) = after(interrupt, |bus| bus.write(0x50, &[5]));
            assert_eq!(written, Ok(()), "{byte:#x}, {bits}: {said:?}");
            assert_eq!(said[said.len() - 4..], [Start, Byte(0xa0, true), Byte(5, true), Stop], "{byte:#x}, {bits}");
        }
    }
}

/// A line that is held for up to nine clocks.
#[test]
fn nine_clocks_free_the_bus() {
    for clocks in 1..=9 {
        let (written, said) = after(|wires| wires.stuck_sda = clocks, |bus| bus.write(0x50, &[5]));
        assert_eq!(written, Ok(()), "{clocks}");
        assert_eq!(said[said.len() - 4..], [Start, Byte(0xa0, true), Byte(5, true), Stop], "{clocks}: {said:?}");
    }
}

#[test]
fn a_line_that_stays_low_is_an_error_after_a_bounded_time() {
    let longest = Cell::new(0);
    for change in [|wires: &mut Wires| wires.stuck_sda = u32::MAX, |wires: &mut Wires| wires.stuck_scl = true] {
        for pins in PINS {
            let wires = RefCell::new(Wires::new(pins));
            change(&mut wires.borrow_mut());
            let mut bus = SoftwareI2c::new(Ports(&wires), pins, Halves(&wires));
            assert_eq!(bus.write(0x50, &[1]), Err(I2cFault::Stuck));
            assert_eq!(bus.read(0x50, &mut [0; 40]), Err(I2cFault::Stuck));
            let wires = wires.borrow();
            assert!(!wires.said.contains(&Start), "{:?}", wires.said);
            longest.set(longest.get().max(wires.halves));
        }
    }
    assert!(longest.get() <= 2 * (MAX_HELD + 50), "{}", longest.get());
}

#[test]
fn a_part_may_hold_the_clock_for_a_while() {
    let (written, said) = after(|wires| wires.holds = 50, |bus| bus.write(0x50, &[5]));
    assert_eq!((written, said), (Ok(()), vec![Start, Byte(0xa0, true), Byte(5, true), Stop]));
    let wires = RefCell::new(Wires::new(PINS[0]));
    wires.borrow_mut().holds = 10 * MAX_HELD;
    let mut bus = SoftwareI2c::new(Ports(&wires), PINS[0], Halves(&wires));
    assert_eq!(bus.write(0x50, &[5]), Err(I2cFault::Stuck));
}
