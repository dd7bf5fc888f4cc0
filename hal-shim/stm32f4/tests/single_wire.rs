//! The bank over [`SoftwareSerial`] and a wire, level by level, to chips with separate clocks.
#![allow(clippy::unwrap_used)]

use proptest::prelude::*;

use ferrostep_stm32f4::software_serial::{PinAction, SoftwareSerial, TICKS_A_BIT};
use ferrostep_tmc2209::*;
use ferrostep_virtual_board::DriverChip;

/// Settings of any driver.
const SETTINGS: DriverSettings = DriverSettings {
    current_ma: 600,
    hold_percent: 50,
    microsteps: 16,
    interpolate: true,
    stealth_chop: true,
    spread_cycle_above_mm_per_s: 100,
    steps_per_mm: 100.0,
    stall_threshold: 60,
    both_edges: false,
};

const BAUD: u32 = 19_200;

/// Time in nanoseconds for the wire, in microseconds for the bank.
const NS_A_BIT: f64 = 1e9 / BAUD as f64;

const TIMING: LineTiming = LineTiming::new(1_000_000, BAUD);

/// A chip's own serial port: it samples far more often than the software's, measures the speed in
/// the synchronisation nibble (data sheet, section 4.1), and replies at that speed.
struct ChipPort {
    chip: DriverChip,
    /// Since when the line has been at its level, and the edges of the present datagram, ns.
    level: bool,
    edges: Vec<f64>,
    last_edge: f64,
    reply: Option<(f64, f64, [u8; 8])>,
}

impl ChipPort {
    fn new(address: u8) -> Self {
        Self { chip: DriverChip::new(address), level: true, edges: Vec::new(), last_edge: 0.0, reply: None }
    }

    /// Returns true while it holds the line low.
    fn pulls(&self, now: f64) -> bool {
        let Some((start, bit, bytes)) = self.reply else { return false };
        let index = (now - start) / bit;
        if index < 0.0 {
            return false;
        }
        let index = index as usize;
        match (bytes.get(index / 10), index % 10) {
            (None, _) | (_, 9) => false,
            (_, 0) => true,
            (Some(byte), bit) => byte >> (bit - 1) & 1 == 0,
        }
    }

    /// The line's level now.
    fn hear(&mut self, level: bool, now: f64) {
        if level != self.level {
            self.level = level;
            self.edges.push(now);
            self.last_edge = now;
        }
        if let Some((start, bit, _)) = self.reply {
            if now > start + 84.0 * bit {
                self.reply = None;
                self.edges.clear();
            }
            return;
        }
        // The line has been at rest for a byte's time and more: the datagram is whole.
        let is_whole = level && !self.edges.is_empty() && now - self.last_edge > 11.0 * NS_A_BIT;
        if is_whole {
            let edges = std::mem::take(&mut self.edges);
            if let Some(bit) = measured_bit(&edges) {
                let reply = self.chip.hear(&bytes(&edges, bit));
                // The rest of NODECONF's delay, from the last edge on.
                self.reply = reply.map(|reply| (now + 12.0 * bit, bit, reply));
            }
        }
    }
}

/// A bit, by the time from the first edge to that between bits 2 and 3 of the
/// synchronisation: four bits.
fn measured_bit(edges: &[f64]) -> Option<f64> {
    let bit = (edges.get(4)? - edges.first()?) / 4.0;
    (bit > NS_A_BIT / 2.0 && bit < NS_A_BIT * 2.0).then_some(bit)
}

/// The bytes of a datagram, from its edges: the first is the beginning of the first start bit.
fn bytes(edges: &[f64], bit: f64) -> Vec<u8> {
    let level = |time: f64| edges.iter().filter(|edge| **edge <= time).count() % 2 == 0;
    let mut found = Vec::new();
    let mut start = edges[0];
    loop {
        found.push(
            (0..8).fold(0, |byte, index| byte | u8::from(level(start + (1.5 + f64::from(index)) * bit)) << index),
        );
        // The next start bit is the next falling edge.
        let sample = start + 9.5 * bit;
        let falling = edges.iter().enumerate().find(|(index, edge)| index % 2 == 0 && **edge > sample);
        match falling {
            Some((_, edge)) => start = *edge,
            None => return found,
        }
    }
}

/// The wire: our port and the chips' pull it low, a resistor pulls it high.
struct Wire {
    serial: SoftwareSerial,
    chips: Vec<ChipPort>,
    driven_low: bool,
    /// Error of this side's timer: a factor of its interval, and the most by which a tick may be
    /// early or late, in intervals.
    clock: f64,
    jitter: f64,
    /// Samples in ten thousand that are wrong.
    noise: u32,
    random: u32,
    /// The timer's next call, ns, and how often it was called.
    calls: u64,
    now: f64,
}

impl Wire {
    fn random(&mut self) -> u32 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 17;
        self.random ^= self.random << 5;
        self.random
    }

    /// The timer's next call. The chips look eight times in between.
    fn tick(&mut self) {
        self.calls += 1;
        let interval = NS_A_BIT / f64::from(TICKS_A_BIT) * self.clock;
        let early_or_late = (f64::from(self.random() % 1000) / 500.0 - 1.0) * self.jitter * interval;
        let call = self.calls as f64 * interval + early_or_late;
        let step = (call - self.now) / 8.0;
        for _ in 0..8 {
            self.now += step;
            let level = self.level();
            let now = self.now;
            self.chips.iter_mut().for_each(|chip| chip.hear(level, now));
        }
        let is_wrong = self.random() % 10_000 < self.noise;
        let level = self.level() ^ is_wrong;
        self.driven_low = self.serial.tick(level) == PinAction::Low;
    }

    fn level(&self) -> bool {
        !self.driven_low && !self.chips.iter().any(|chip| chip.pulls(self.now))
    }
}

/// Sets up two drivers on one wire; returns the events within two seconds.
fn set_up(clock: f64, jitter: f64, noise: u32, seed: u32) -> (Vec<DriverEventKind>, [bool; 2]) {
    let wiring = [0, 3].map(|address| DriverWiring { line: 0, address, sense_milliohm: 110 });
    let drivers = [Some((SETTINGS, wiring[0])), None, None, Some((SETTINGS, wiring[1]))];
    let mut bank = DriverBank::new(drivers, TIMING, 0);
    let mut wire = Wire {
        serial: SoftwareSerial::new(),
        chips: wiring.map(|wiring| ChipPort::new(wiring.address)).into(),
        driven_low: false,
        clock,
        jitter,
        noise,
        random: seed | 1,
        calls: 0,
        now: 0.0,
    };
    let mut events = Vec::new();
    while wire.now < 2e9 && events.len() < 2 {
        wire.tick();
        let now_us = (wire.now / 1000.0) as u32;
        events.extend(bank.poll(&mut wire.serial, now_us).map(|event| event.kind));
    }
    let image = RegisterImage::new(&SETTINGS, &wiring[0]).unwrap();
    let holds = |port: &ChipPort| image.writes.iter().all(|(register, value)| port.chip.register(*register) == *value);
    (events, [holds(&wire.chips[0]), holds(&wire.chips[1])])
}

#[test]
fn two_drivers_on_a_wire_are_set_up() {
    assert_eq!(set_up(1.0, 0.0, 0, 1), (vec![DriverEventKind::Confirmed; 2], [true; 2]));
}

proptest! {
    #![proptest_config(ferrostep_random_cases::cases(24))]

    /// Our timer may be 5 % off, for the chips follow it, and each of its calls early or late by a
    /// tenth of an interval.
    #[test]
    fn a_clock_that_is_off_and_calls_that_are_late_do_no_harm(clock in 0.95..1.05, jitter in 0.0..0.1, seed: u32) {
        prop_assert_eq!(set_up(clock, jitter, 0, seed), (vec![DriverEventKind::Confirmed; 2], [true; 2]));
    }

    /// Wrong samples cost repetitions; only drivers that are set up count as confirmed.
    #[test]
    fn noise_is_survived(noise in 0_u32..200, seed: u32) {
        let (events, holds) = set_up(1.0, 0.0, noise, seed);
        for (index, event) in events.iter().enumerate() {
            prop_assert!(matches!(event, DriverEventKind::Confirmed | DriverEventKind::Failed(_)), "{event:?}");
            if events.len() == 2 && events.iter().all(|event| *event == DriverEventKind::Confirmed) {
                prop_assert!(holds[index]);
            }
        }
        prop_assert!(!events.is_empty());
    }
}
