#![allow(clippy::unwrap_used)]

use super::*;
use crate::parts::tmc2209::datagram::checksum;
use crate::parts::tmc2209::registers::address;
use crate::parts::tmc2209::{Config, Fault};
use proptest::prelude::*;

fn drivers(nodes: &[u8]) -> Vec<Tmc2209> {
    let made = nodes.iter().map(|node| {
        let mut driver = Tmc2209::new(Config { ms1: node & 1 != 0, ms2: node & 2 != 0, ..Config::default() });
        driver.set_supply(0, true);
        driver
    });
    made.collect()
}

fn request(node: u8, register: u8, value: Option<u32>) -> Vec<u8> {
    let mut bytes = vec![0x05, node, register];
    if let Some(value) = value {
        bytes[2] |= 0x80;
        bytes.extend(value.to_be_bytes());
    }
    bytes.push(checksum(&bytes));
    bytes
}

/// A host that drives a pin, without access to the wire's internals.
struct Host {
    now_ns: f64,
    bit_ns: f64,
}

impl Host {
    fn send(&mut self, wire: &mut Wire, drivers: &mut [Tmc2209], bytes: &[u8]) {
        wire.set_master(drivers, self.now_ns as u64, Some(true));
        for &byte in bytes {
            let frame = u16::from(byte) << 1 | 1 << 9;
            for bit in 0..10 {
                wire.set_master(drivers, self.now_ns as u64, Some(frame >> bit & 1 != 0));
                self.now_ns += self.bit_ns;
            }
        }
        wire.set_master(drivers, self.now_ns as u64, None);
    }

    /// Samples the pin until a reply has arrived or none can arrive.
    fn receive(&mut self, wire: &mut Wire, drivers: &mut [Tmc2209]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let until_ns = self.now_ns + 400.0 * self.bit_ns;
        while self.now_ns < until_ns && bytes.len() < 8 {
            let step_ns = self.bit_ns / 16.0;
            wire.advance(drivers, self.now_ns as u64);
            if wire.level() {
                self.now_ns += step_ns;
                continue;
            }
            let mut frame = 0_u16;
            for bit in 0..10 {
                wire.advance(drivers, (self.now_ns + self.bit_ns * (f64::from(bit) + 0.5)) as u64);
                frame |= u16::from(wire.level()) << bit;
            }
            assert_eq!(frame & 0x201, 0x200);
            bytes.push((frame >> 1) as u8);
            self.now_ns += self.bit_ns * 9.6;
        }
        self.now_ns += 20.0 * self.bit_ns;
        wire.advance(drivers, self.now_ns as u64);
        bytes
    }
}

fn wire(members: usize) -> Wire {
    Wire::new(Bus::new((0..members).collect(), 1), BitTime::Measured)
}

proptest! {
    #[test]
    fn round_trip_at_any_baud_rate(baud in 9_600.0_f64..500_000.0, value: u32, start in 0.0_f64..1e6) {
        let (mut drivers, mut wire) = (drivers(&[0]), wire(1));
        let mut host = Host { now_ns: 1e6 + start, bit_ns: 1e9 / baud };
        host.send(&mut wire, &mut drivers, &request(0, address::CHOPCONF, Some(value)));
        host.send(&mut wire, &mut drivers, &request(0, address::CHOPCONF, None));
        let reply = host.receive(&mut wire, &mut drivers);
        prop_assert_eq!(reply.len(), 8);
        prop_assert_eq!(reply[3..7].to_vec(), value.to_be_bytes().to_vec());
        prop_assert_eq!(reply[7], checksum(&reply[..7]));
        prop_assert_eq!((drivers[0].registers().ifcnt, wire.conflicts(), wire.driven()), (1, 0, None));
    }

    #[test]
    fn a_given_bit_time_tolerates_some_per_cent(off in -0.035_f64..0.035, value: u32) {
        let mut drivers = drivers(&[0]);
        let mut wire = Wire::new(Bus::new(vec![0], 1), BitTime::Given(10_000));
        let mut host = Host { now_ns: 1e6, bit_ns: 10_000.0 * (1.0 + off) };
        host.send(&mut wire, &mut drivers, &request(0, address::PWMCONF, Some(value)));
        wire.advance(&mut drivers, host.now_ns as u64);
        prop_assert_eq!((drivers[0].registers().ifcnt, drivers[0].registers().pwmconf), (1, value));
    }
}

#[test]
fn a_given_bit_time_does_not_tolerate_8_per_cent() {
    let mut drivers = drivers(&[0]);
    let mut wire = Wire::new(Bus::new(vec![0], 1), BitTime::Given(10_000));
    let mut host = Host { now_ns: 1e6, bit_ns: 10_800.0 };
    host.send(&mut wire, &mut drivers, &request(0, address::PWMCONF, Some(0x55AA_55AA)));
    assert_eq!(drivers[0].registers().ifcnt, 0);
}

#[test]
fn drivers_share_a_wire_by_address() {
    let (mut drivers, mut wire) = (drivers(&[0, 1, 2, 3]), wire(4));
    let mut host = Host { now_ns: 1e6, bit_ns: 8_680.6 };
    for node in 0..4 {
        host.send(&mut wire, &mut drivers, &request(node, address::NODECONF, Some(2 << 8)));
    }
    for node in 0..4_u8 {
        let value = 0x100 + u32::from(node);
        host.send(&mut wire, &mut drivers, &request(node, address::CHOPCONF, Some(value)));
        host.send(&mut wire, &mut drivers, &request(node, address::CHOPCONF, None));
        let reply = host.receive(&mut wire, &mut drivers);
        assert_eq!(reply[3..7], value.to_be_bytes());
    }
    assert!(drivers.iter().all(|driver| driver.registers().ifcnt == 2 && driver.line_errors() == 0));
}

#[test]
fn two_drivers_with_one_address_answer_together() {
    let (mut drivers, mut bus) = (drivers(&[1, 1]), Bus::new(vec![0, 1], 1));
    drivers[0].set_enable_pin(0, false);
    drivers[1].set_step_pin(0, true);
    let mut reply = None;
    for (index, byte) in request(1, address::IOIN, None).into_iter().enumerate() {
        reply = bus.byte(&mut drivers, index as u64 * 100_000, 10_000, byte);
    }
    // One sends 0x44, the other 0xC5 (STEP, EN, MS1, PDN_UART): a low wins.
    assert_eq!(reply.unwrap().bytes[..7], [0x05, 0xFF, 0x06, 0x21, 0x00, 0x00, 0x44]);
}

#[test]
fn a_neighbour_with_a_short_send_delay_misses_the_request_after_a_reply() {
    for (setting, accepted) in [(0, 1), (2, 2)] {
        let (mut drivers, mut bus) = (drivers(&[0, 1]), Bus::new(vec![0, 1], 1));
        let mut now_ns = 1_000_000;
        let mut reply_end_ns = 0;
        let mut send = |bus: &mut Bus, drivers: &mut [Tmc2209], bytes: &[u8], from_ns: u64| {
            now_ns = now_ns.max(from_ns);
            for &byte in bytes {
                if let Some(reply) = bus.byte(drivers, now_ns, 10_000, byte) {
                    reply_end_ns = reply.end_ns();
                }
                now_ns += 100_000;
            }
            reply_end_ns
        };
        send(&mut bus, &mut drivers, &request(1, address::NODECONF, Some(setting << 8)), 0);
        let end_ns = send(&mut bus, &mut drivers, &request(0, address::IOIN, None), 0);
        assert!(end_ns > 0);
        send(&mut bus, &mut drivers, &request(1, address::SGTHRS, Some(1)), end_ns + 40_000);
        assert_eq!(drivers[1].registers().ifcnt, accepted);
    }
}

#[test]
fn a_low_stop_bit_spoils_a_byte() {
    for low in [false, true] {
        let (mut drivers, mut wire) = (drivers(&[0]), wire(1));
        let bytes = request(0, address::SGTHRS, Some(7));
        let mut host = Host { now_ns: 1e6, bit_ns: 10_000.0 };
        host.send(&mut wire, &mut drivers, &bytes[..7]);
        for bit in 0..10 {
            let level = if bit == 9 { !low } else { (u16::from(bytes[7]) << 1) >> bit & 1 != 0 };
            wire.set_master(&mut drivers, host.now_ns as u64, Some(level));
            host.now_ns += 10_000.0;
        }
        wire.set_master(&mut drivers, host.now_ns as u64, None);
        assert_eq!(drivers[0].registers().ifcnt, u8::from(!low));
    }
}

#[test]
fn releases_the_wire_four_bits_after_its_reply() {
    let (mut drivers, mut wire) = (drivers(&[0]), wire(1));
    let mut host = Host { now_ns: 1e6, bit_ns: 10_000.0 };
    host.send(&mut wire, &mut drivers, &request(0, address::GSTAT, None));
    let mut edges = Vec::new();
    while let Some(at_ns) = wire.next_event_ns() {
        if wire.advance(&mut drivers, at_ns) {
            edges.push((at_ns, wire.driven()));
        }
    }
    // The request's 40 bits, SENDDELAY's 8, then 80, then 4.
    assert_eq!(edges[0], (1_000_000 + 48 * 10_000, Some(false)));
    assert_eq!(edges[edges.len() - 1], (1_000_000 + 132 * 10_000, None));
}

#[test]
fn a_missing_stop_bit_spoils_the_datagram() {
    let (mut drivers, mut wire) = (drivers(&[0]), wire(1));
    let bytes = request(0, address::SGTHRS, Some(7));
    let mut host = Host { now_ns: 1e6, bit_ns: 10_000.0 };
    host.send(&mut wire, &mut drivers, &bytes[..2]);
    // A break: low for 15 bits.
    wire.set_master(&mut drivers, host.now_ns as u64, Some(false));
    host.now_ns += 150_000.0;
    wire.set_master(&mut drivers, host.now_ns as u64, Some(true));
    host.now_ns += 10_000.0;
    host.send(&mut wire, &mut drivers, &bytes[2..]);
    assert_eq!(drivers[0].registers().ifcnt, 0);
    assert!(drivers[0].line_errors() > 0);
    host.now_ns += 700_000.0;
    host.send(&mut wire, &mut drivers, &bytes);
    assert_eq!(drivers[0].registers().ifcnt, 1);
}

#[test]
fn a_spike_spoils_a_datagram_within_12_bit_times() {
    for (before_ns, accepted) in [(10_000, 0), (119_000, 0), (121_000, 1), (1_000_000, 1)] {
        let (mut drivers, mut wire) = (drivers(&[0]), wire(1));
        let mut host = Host { now_ns: 2e6, bit_ns: 10_000.0 };
        wire.set_master(&mut drivers, 2_000_000 - before_ns, Some(false));
        wire.set_master(&mut drivers, 2_000_300 - before_ns, Some(true));
        host.send(&mut wire, &mut drivers, &request(0, address::SGTHRS, Some(7)));
        assert_eq!(drivers[0].registers().ifcnt, accepted, "{before_ns}");
        host.now_ns += 200_000.0;
        host.send(&mut wire, &mut drivers, &request(0, address::SGTHRS, Some(7)));
        assert_eq!(drivers[0].registers().ifcnt, accepted + 1);
    }
}

#[test]
fn a_mute_driver_does_not_disturb_the_others() {
    let (mut drivers, mut wire) = (drivers(&[0, 1]), wire(2));
    drivers[0].set_fault(0, Fault::Mute, true);
    let mut host = Host { now_ns: 1e6, bit_ns: 10_000.0 };
    host.send(&mut wire, &mut drivers, &request(1, address::IOIN, None));
    assert_eq!(host.receive(&mut wire, &mut drivers).len(), 8);
}

#[test]
fn bytes_sent_without_supply_are_lost() {
    let (mut drivers, mut wire) = (drivers(&[0]), wire(1));
    drivers[0].set_supply(0, false);
    let mut host = Host { now_ns: 1e6, bit_ns: 10_000.0 };
    host.send(&mut wire, &mut drivers, &[0x00, 0x00]);
    drivers[0].set_supply(host.now_ns as u64, true);
    host.send(&mut wire, &mut drivers, &request(0, address::SGTHRS, Some(7)));
    assert_eq!(drivers[0].registers().ifcnt, 1);
}

#[test]
fn garbles_with_its_probability() {
    let mut accepted = 0;
    for seed in 0..200 {
        let mut drivers = drivers(&[0]);
        let mut bus = Bus::new(vec![0], seed);
        bus.set_fault(LineFault { garble: 0.01, mute: false });
        for (index, byte) in request(0, address::SGTHRS, Some(7)).into_iter().enumerate() {
            bus.byte(&mut drivers, index as u64 * 100_000, 10_000, byte);
        }
        accepted += u32::from(drivers[0].registers().ifcnt);
    }
    // 0.99 to the power of 80 bits is 0.45.
    assert!((60..120).contains(&accepted), "{accepted}");
}

#[test]
fn a_mute_line_and_a_mute_driver_answer_nothing() {
    for line in [true, false] {
        let (mut drivers, mut wire) = (drivers(&[0]), wire(1));
        if line {
            wire.bus_mut().set_fault(LineFault { garble: 0.0, mute: true });
        } else {
            drivers[0].set_fault(0, Fault::Mute, true);
        }
        let mut host = Host { now_ns: 1e6, bit_ns: 10_000.0 };
        host.send(&mut wire, &mut drivers, &request(0, address::IOIN, None));
        assert!(host.receive(&mut wire, &mut drivers).is_empty());
    }
}
