//! A test for each row of the model's table.

use rigless::device::{Device, Level};
use rigless::mcu::Operate;
use rigless::soc::Layout;

use super::bench::Bench;
use super::fields as f;
use super::{Core, Otg, Register, WAKEUP};
use crate::host::usb::bus::{Answer, Bus, Kind};

const GET: [u8; 8] = [0x80, 6, 0, 1, 0, 0, 18, 0];
const CORES: [Core; 2] = [Core::F405, Core::F446];

fn data(toggle: bool, bytes: &[u8]) -> Answer {
    Answer::Data { toggle, bytes: bytes.to_vec() }
}

/// Pops GRXSTSP and answers its status, endpoint and bytes.
fn pop(bench: &mut Bench) -> (u64, u64, u64) {
    let word = bench.read(Register::Grxstsp);
    (f::grxsts::PKTSTS.get(word), f::grxsts::EPNUM.get(word), f::grxsts::BCNT.get(word))
}

#[test]
fn registers_reset_as_the_manual_gives_them() {
    let mut bench = Bench::new(Core::F405);
    for (register, value) in [
        (Register::Gotgctl, 0x0001_0000),
        (Register::Gusbcfg, 0x0A00),
        (Register::Grstctl, 0x8000_0000),
        (Register::Gintsts, 0x0400_0020),
        (Register::Grxfsiz, 0x200),
        (Register::Dieptxf(0), 0x200),
        (Register::Dieptxf(1), 0x0200_0400),
        (Register::Gccfg, 0),
        (Register::Dcfg, 0x0220_0000),
        (Register::Dctl, 0),
        (Register::Dsts, 0x10),
        (Register::Diepctl(0), 0x8000),
        (Register::Doepctl(0), 0x8000),
        (Register::Diepctl(1), 0),
        (Register::Diepint(1), 0x80),
        (Register::Pcgcctl, 0),
    ] {
        assert_eq!(bench.read(register), value, "{register:?}");
    }
}

#[test]
fn reserved_bits_stay_zero() {
    let mut bench = Bench::new(Core::F405);
    bench.write(Register::Gahbcfg, 0xFFFF_FFFF);
    assert_eq!(bench.read(Register::Gahbcfg), 0x181);
    bench.write(Register::Daintmsk, 0xFFFF_FFFF);
    assert_eq!(bench.read(Register::Daintmsk), 0xFFFF_FFFF);
    bench.write(Register::Doepctl(0), 0xFFFF_FFFF);
    assert_eq!(bench.get(Register::Doepctl(0), f::doepctl0::EPDIS), 0, "endpoint 0 cannot be disabled");
}

#[test]
fn the_cores_have_their_own_numbers() {
    for (core, id) in [(Core::F405, 0x1200), (Core::F446, 0x2000)] {
        let mut bench = Bench::new(core);
        bench.write(Register::Cid, 7);
        assert_eq!(bench.read(Register::Cid), id);
    }
}

#[test]
fn a_soft_reset_keeps_what_the_manual_lists() {
    let mut bench = Bench::ready(Core::F405);
    bench.open_bulk(1);
    bench.arm_in(1, &[1, 2, 3]);
    bench.set(Register::Dctl, f::dctl::SDIS, 1);
    bench.set(Register::Dcfg, f::dcfg::DAD, 9);
    bench.write(Register::Gintmsk, 0xFF0);
    bench.write(Register::Pcgcctl, 2);
    bench.write(Register::Grstctl, 1);
    assert_eq!(bench.read(Register::Grstctl), 0x8000_0000);
    assert_eq!(bench.get(Register::Dctl, f::dctl::SDIS), 1);
    assert_eq!(bench.get(Register::Dcfg, f::dcfg::DSPD), 3);
    assert_eq!(bench.get(Register::Dcfg, f::dcfg::DAD), 0);
    assert_eq!(bench.read(Register::Gccfg), 1 << 21 | 1 << 16);
    assert_eq!(bench.read(Register::Pcgcctl), 2);
    assert_eq!((bench.read(Register::Gintmsk), bench.read(Register::Diepctl(1))), (0, 0));
    bench.write(Register::Dieptxf(1), 16 << 16 | 128);
    bench.set(Register::Diepctl(1), f::epctl::TXFNUM, 1);
    assert_eq!(bench.read(Register::Dtxfsts(1)), 16, "the FIFO is empty");
}

#[test]
fn flushes_empty_the_fifos_they_name() {
    let mut bench = Bench::ready(Core::F405);
    for endpoint in [1, 2] {
        bench.open_bulk(endpoint);
        bench.fill(endpoint, &[1; 8]);
    }
    let free = |bench: &mut Bench| [1, 2].map(|endpoint| bench.read(Register::Dtxfsts(endpoint)));
    assert_eq!(free(&mut bench), [14, 14]);
    bench.write(Register::Grstctl, 1 << 6 | 1 << 5);
    assert_eq!(bench.read(Register::Grstctl), 0x8000_0040, "cleared by the core, the number stays");
    assert_eq!(free(&mut bench), [16, 14]);
    bench.fill(1, &[1; 4]);
    bench.write(Register::Grstctl, 0x10 << 6 | 1 << 5);
    assert_eq!(free(&mut bench), [16, 16]);
    bench.setup(GET);
    assert_eq!(bench.get(Register::Gintsts, f::gintsts::RXFLVL), 1);
    bench.write(Register::Grstctl, 1 << 4);
    assert_eq!(bench.get(Register::Gintsts, f::gintsts::RXFLVL), 0);
}

#[test]
fn the_line_is_the_masked_flags() {
    let mut bench = Bench::ready(Core::F405);
    bench.setup(GET);
    bench.write(Register::Gintmsk, f::gintsts::RXFLVL.mask());
    assert!(!bench.line());
    bench.write(Register::Gahbcfg, 1);
    assert!(bench.line());
    bench.write(Register::Gintmsk, f::gintsts::ENUMDNE.mask());
    assert!(!bench.line());
    bench.write(Register::Gintmsk, f::gintsts::RXFLVL.mask());
    assert!(bench.line());
    pop(&mut bench);
    assert!(!bench.line(), "the level goes with its cause");
}

#[test]
fn a_bus_reset_is_seen_and_enumerates() {
    let mut bench = Bench::new(Core::F405);
    bench.connect();
    bench.write(Register::Gahbcfg, 1);
    bench.write(Register::Gintmsk, f::gintsts::USBRST.mask() | f::gintsts::ENUMDNE.mask());
    bench.bus(|port| port.set_reset(true));
    bench.pass(2_499);
    assert!(!bench.line());
    bench.pass(1);
    assert!(bench.line());
    bench.write(Register::Gintsts, f::gintsts::USBRST.mask());
    assert!(!bench.line());
    bench.pass(10_000_000);
    assert!(!bench.line(), "not before the end");
    bench.bus(|port| port.set_reset(false));
    assert_eq!(bench.setup(GET), Answer::Silence, "the speed is not known yet");
    bench.pass(super::bus_side::ENUMERATION_NS);
    assert!(bench.line());
    assert_eq!(bench.get(Register::Gintsts, f::gintsts::ENUMDNE), 1);
    assert_eq!(bench.get(Register::Dsts, f::dsts::ENUMSPD), 3);
}

#[test]
fn a_short_reset_is_none() {
    let mut bench = Bench::new(Core::F405);
    bench.connect();
    bench.bus(|port| port.set_reset(true));
    bench.pass(2_000);
    bench.bus(|port| port.set_reset(false));
    bench.pass(1_000_000);
    let flags = bench.read(Register::Gintsts);
    assert_eq!(flags & (f::gintsts::USBRST.mask() | f::gintsts::ENUMDNE.mask()), 0);
}

#[test]
fn a_bus_reset_deactivates_the_endpoints() {
    let mut bench = Bench::ready(Core::F405);
    bench.open_bulk(1);
    bench.set(Register::Dcfg, f::dcfg::DAD, 9);
    bench.bus_reset();
    assert_eq!(bench.get(Register::Diepctl(1), f::epctl::USBAEP), 0);
    assert_eq!(bench.get(Register::Doepctl(1), f::epctl::USBAEP), 0);
    assert_eq!(bench.get(Register::Diepctl(0), f::epctl::USBAEP), 1);
    assert_eq!(bench.get(Register::Dcfg, f::dcfg::DAD), 9, "34.17.5 leaves this to the driver");
    assert_eq!(bench.input(1), Answer::Silence);
}

#[test]
fn suspend_and_resume_are_seen() {
    let mut bench = Bench::ready(Core::F405);
    bench.bus(|port| port.resume());
    assert_eq!(bench.get(Register::Gintsts, f::gintsts::WKUPINT), 0, "it does not sleep");
    bench.bus(|port| port.suspend());
    assert_eq!(bench.get(Register::Gintsts, f::gintsts::USBSUSP), 1);
    assert_eq!(bench.get(Register::Gintsts, f::gintsts::ESUSP), 1);
    assert_eq!(bench.get(Register::Dsts, f::dsts::SUSPSTS), 1);
    bench.bus(|port| port.resume());
    assert_eq!(bench.get(Register::Gintsts, f::gintsts::WKUPINT), 1);
    assert_eq!(bench.get(Register::Dsts, f::dsts::SUSPSTS), 0);
    let pulse: Vec<_> = bench.soc.drain_requests().iter().map(|change| (change.request, change.level)).collect();
    assert_eq!(pulse, [(WAKEUP, Level::High), (WAKEUP, Level::Low)]);
}

#[test]
fn a_start_of_frame_sets_the_frame_number() {
    let mut bench = Bench::ready(Core::F405);
    bench.bus(|port| port.start_of_frame(1234));
    assert_eq!(bench.get(Register::Dsts, f::dsts::FNSOF), 1234);
    assert_eq!(bench.get(Register::Gintsts, f::gintsts::SOF), 1);
    bench.setup(GET);
    assert_eq!(bench.get(Register::Grxstsr, f::grxsts::FRMNUM), 1234 & 0xF);
}

#[test]
fn a_setup_comes_with_its_data_and_its_end() {
    for core in CORES {
        let mut bench = Bench::ready(core);
        bench.arm_out(0, 1);
        assert_eq!(bench.setup(GET), Answer::Ack);
        assert_eq!(bench.get(Register::Grxstsr, f::grxsts::PKTSTS), 6, "a peek takes nothing");
        assert_eq!(pop(&mut bench), (6, 0, 8));
        assert_eq!(bench.drain(8), GET);
        assert_eq!(bench.get(Register::Gintsts, f::gintsts::RXFLVL), 0, "its end is not written yet");
        assert_eq!(bench.input(0), Answer::Nak);
        assert_eq!(bench.get(Register::Doepint(0), f::doepint::STUP), 0);
        assert_eq!(pop(&mut bench), (4, 0, 0));
        assert_eq!(bench.get(Register::Doepint(0), f::doepint::STUP), 1);
        assert_eq!(bench.get(Register::Doepctl(0), f::epctl::EPENA), 0);
        bench.write(Register::Doepint(0), f::doepint::STUP.mask());
        assert_eq!(bench.read(Register::Doepint(0)) & f::doepint::STUP.mask(), 0);
    }
}

#[test]
fn a_setup_is_taken_in_spite_of_nak() {
    let mut bench = Bench::ready(Core::F405);
    bench.set(Register::Doepctl(0), f::epctl::SNAK, 1);
    assert_eq!(bench.setup(GET), Answer::Ack);
    assert_eq!(bench.get(Register::Doepctl(0), f::epctl::NAKSTS), 1);
    assert_eq!(bench.get(Register::Diepctl(0), f::epctl::NAKSTS), 1);
    assert_eq!(bench.get(Register::Doeptsiz(0), f::doeptsiz0::STUPCNT), 2);
    bench.arm_in(0, &[1]);
    assert_eq!(bench.input(0), data(true, &[1]), "the data stage begins with DATA1");
}

#[test]
fn too_many_setups_set_b2bstup() {
    let mut bench = Bench::ready(Core::F405);
    for _ in 0..3 {
        bench.setup(GET);
    }
    assert_eq!(bench.get(Register::Doepint(0), f::doepint::B2BSTUP), 0);
    bench.setup(GET);
    assert_eq!(bench.get(Register::Doepint(0), f::doepint::B2BSTUP), 1);
}

#[test]
fn an_out_packet_is_read_and_ended() {
    let mut bench = Bench::ready(Core::F405);
    bench.open_bulk(2);
    assert_eq!(bench.out(2, false, &[1, 2, 3, 4, 5]), Answer::Nak);
    bench.arm_out(2, 1);
    assert_eq!(bench.out(2, false, &[1, 2, 3, 4, 5]), Answer::Ack);
    assert_eq!(bench.get(Register::Doepctl(2), f::epctl::NAKSTS), 1);
    assert_eq!(bench.out(2, true, &[6]), Answer::Nak, "the transfer is over");
    assert_eq!(bench.get(Register::Doeptsiz(2), f::eptsiz::PKTCNT), 0);
    assert_eq!(bench.get(Register::Doeptsiz(2), f::eptsiz::XFRSIZ), 64, "counts as it is read");
    assert_eq!(pop(&mut bench), (2, 2, 5));
    assert_eq!(bench.get(Register::Doeptsiz(2), f::eptsiz::XFRSIZ), 59);
    assert_eq!(bench.drain(5), [1, 2, 3, 4, 5]);
    assert_eq!(bench.get(Register::Doepint(2), f::doepint::XFRC), 0);
    assert_eq!(bench.get(Register::Doepctl(2), f::epctl::EPENA), 1);
    assert_eq!(pop(&mut bench), (3, 2, 0));
    assert_eq!(bench.get(Register::Doepint(2), f::doepint::XFRC), 1);
    assert_eq!(bench.get(Register::Doepctl(2), f::epctl::EPENA), 0);
}

#[test]
fn a_transfer_of_several_packets_ends_at_its_count() {
    let mut bench = Bench::ready(Core::F405);
    bench.open_bulk(1);
    bench.arm_out(1, 2);
    assert_eq!(bench.out(1, false, &[1; 64]), Answer::Ack);
    assert_eq!(bench.get(Register::Grxstsr, f::grxsts::DPID), 0);
    assert_eq!(pop(&mut bench), (2, 1, 64));
    bench.drain(64);
    assert_eq!(bench.get(Register::Gintsts, f::gintsts::RXFLVL), 0, "one more is to come");
    assert_eq!(bench.out(1, true, &[2; 64]), Answer::Ack);
    assert_eq!(bench.get(Register::Grxstsr, f::grxsts::DPID), 2);
    assert_eq!(pop(&mut bench), (2, 1, 64));
    bench.drain(64);
    assert_eq!(pop(&mut bench), (3, 1, 0));
    // No count: each packet is a transfer, and the run hears of it.
    bench.write(Register::Doeptsiz(1), 0);
    bench.set(Register::Doepctl(1), f::epctl::EPENA, 1);
    bench.set(Register::Doepctl(1), f::epctl::CNAK, 1);
    assert!(bench.told.iter().any(|told| told.contains("PKTCNT 0")));
    assert_eq!(bench.out(1, false, &[3; 64]), Answer::Ack);
    assert_eq!(bench.out(1, true, &[3; 64]), Answer::Nak);
}

#[test]
fn the_f446_may_be_enabled_before_the_end_is_popped() {
    for (core, enabled) in [(Core::F405, 0), (Core::F446, 1)] {
        let mut bench = Bench::ready(core);
        bench.open_bulk(1);
        bench.arm_out(1, 1);
        bench.out(1, false, &[1]);
        assert_eq!(bench.get(Register::Doepctl(1), f::epctl::EPENA), 1 - enabled);
        pop(&mut bench);
        bench.drain(1);
        bench.arm_out(1, 1);
        assert_eq!(pop(&mut bench), (3, 1, 0));
        assert_eq!(bench.get(Register::Doepctl(1), f::epctl::EPENA), enabled, "{core:?}");
    }
}

#[test]
fn an_in_packet_goes_out_once() {
    let mut bench = Bench::ready(Core::F405);
    bench.open_bulk(1);
    bench.write(Register::Dieptsiz(1), 1 << 19 | 6);
    let control = bench.read(Register::Diepctl(1));
    bench.write(Register::Diepctl(1), control | f::epctl::EPENA.mask() | f::epctl::CNAK.mask());
    bench.fill(1, &[1, 2, 3, 4]);
    assert_eq!(bench.input(1), Answer::Nak, "half of it is not a packet");
    assert_eq!(bench.get(Register::Dieptsiz(1), f::eptsiz::XFRSIZ), 6);
    bench.fill(1, &[5, 6]);
    assert_eq!(bench.get(Register::Dieptsiz(1), f::eptsiz::XFRSIZ), 0);
    assert_eq!(bench.get(Register::Dieptsiz(1), f::eptsiz::PKTCNT), 1);
    assert_eq!(bench.input(1), data(false, &[1, 2, 3, 4, 5, 6]));
    assert_eq!(bench.get(Register::Dieptsiz(1), f::eptsiz::PKTCNT), 0);
    assert_eq!(bench.get(Register::Diepint(1), f::diepint::XFRC), 1);
    assert_eq!(bench.get(Register::Diepctl(1), f::epctl::EPENA), 0);
    assert_eq!(bench.input(1), Answer::Nak);
    bench.arm_in(1, &[7]);
    assert_eq!(bench.input(1), data(true, &[7]));
    // With nothing to count, nothing goes.
    bench.write(Register::Dieptsiz(1), 0);
    bench.set(Register::Diepctl(1), f::epctl::EPENA, 1);
    assert_eq!(bench.input(1), Answer::Nak);
    assert!(bench.told.iter().any(|told| told.contains("nothing is sent")));
}

#[test]
fn an_in_transfer_of_several_packets() {
    let mut bench = Bench::ready(Core::F405);
    bench.write(Register::Dieptxf(1), 48 << 16 | 144);
    bench.open_bulk(1);
    let bytes: Vec<u8> = (0..130).collect();
    bench.arm_in(1, &bytes);
    assert_eq!(bench.input(1), data(false, &bytes[..64]));
    assert_eq!(bench.get(Register::Diepint(1), f::diepint::XFRC), 0);
    assert_eq!(bench.input(1), data(true, &bytes[64..128]));
    assert_eq!(bench.input(1), data(false, &bytes[128..]));
    assert_eq!(bench.get(Register::Diepint(1), f::diepint::XFRC), 1);
}

#[test]
fn a_packet_of_no_bytes() {
    let mut bench = Bench::ready(Core::F405);
    bench.open_bulk(1);
    bench.arm_in(1, &[]);
    assert_eq!(bench.input(1), data(false, &[]));
    assert_eq!(bench.get(Register::Diepint(1), f::diepint::XFRC), 1);
    bench.setup([0; 8]);
    pop(&mut bench);
    bench.drain(8);
    bench.arm_out(0, 1);
    assert_eq!(bench.out(0, true, &[]), Answer::Ack);
    assert_eq!(pop(&mut bench), (4, 0, 0));
    assert_eq!(pop(&mut bench), (2, 0, 0));
    assert_eq!(pop(&mut bench), (3, 0, 0));
}

#[test]
fn a_repeated_packet_is_acknowledged_and_dropped() {
    let mut bench = Bench::ready(Core::F405);
    bench.open_bulk(1);
    bench.arm_out(1, 4);
    assert_eq!(bench.out(1, false, &[1; 64]), Answer::Ack);
    assert_eq!(bench.out(1, false, &[1; 64]), Answer::Ack);
    assert_eq!(bench.get(Register::Doeptsiz(1), f::eptsiz::PKTCNT), 3);
    pop(&mut bench);
    bench.drain(64);
    assert_eq!(pop(&mut bench).0, 0, "it came once");
}

#[test]
fn an_unacknowledged_packet_is_sent_again() {
    let mut bench = Bench::ready(Core::F405);
    bench.open_bulk(1);
    bench.arm_in(1, &[9; 10]);
    assert_eq!(bench.transact(0, 1, Kind::In { acknowledged: false }), data(false, &[9; 10]));
    assert_eq!(bench.get(Register::Diepint(1), f::diepint::TOC), 1);
    assert_eq!(bench.get(Register::Diepint(1), f::diepint::XFRC), 0);
    assert_eq!(bench.input(1), data(false, &[9; 10]));
    assert_eq!(bench.get(Register::Diepint(1), f::diepint::XFRC), 1);
}

#[test]
fn toggles_can_be_set() {
    let mut bench = Bench::ready(Core::F405);
    bench.open_bulk(1);
    bench.arm_in(1, &[1]);
    bench.input(1);
    assert_eq!(bench.get(Register::Diepctl(1), f::epctl::DPID), 1);
    bench.set(Register::Diepctl(1), f::epctl::SD0PID, 1);
    assert_eq!(bench.get(Register::Diepctl(1), f::epctl::DPID), 0);
    bench.arm_in(1, &[2]);
    assert_eq!(bench.input(1), data(false, &[2]));
    bench.set(Register::Doepctl(1), f::epctl::SD1PID, 1);
    assert_eq!(bench.get(Register::Doepctl(1), f::epctl::DPID), 1);
    bench.arm_out(1, 1);
    assert_eq!(bench.out(1, true, &[3]), Answer::Ack);
    assert_eq!(pop(&mut bench), (2, 1, 1));
}

#[test]
fn nak_of_an_endpoint() {
    let mut bench = Bench::ready(Core::F405);
    bench.open_bulk(1);
    bench.arm_in(1, &[1]);
    bench.set(Register::Diepctl(1), f::epctl::SNAK, 1);
    assert_eq!(bench.get(Register::Diepctl(1), f::epctl::NAKSTS), 1);
    assert_eq!(bench.get(Register::Diepint(1), f::diepint::INEPNE), 1);
    assert_eq!(bench.input(1), Answer::Nak);
    bench.set(Register::Diepctl(1), f::epctl::CNAK, 1);
    assert_eq!(bench.get(Register::Diepint(1), f::diepint::INEPNE), 0);
    assert_eq!(bench.input(1), data(false, &[1]));
    bench.write(Register::Diepctl(1), f::epctl::SNAK.mask() | f::epctl::CNAK.mask());
    assert_eq!(bench.get(Register::Diepctl(1), f::epctl::NAKSTS), 1);
    assert!(bench.told.iter().any(|told| told.contains("SNAK and CNAK")));
}

#[test]
fn a_stall_is_answered_before_nak() {
    let mut bench = Bench::ready(Core::F405);
    bench.open_bulk(1);
    for (control, token) in [
        (Register::Diepctl(1), Kind::In { acknowledged: true }),
        (Register::Doepctl(1), Kind::Out { toggle: false, data: &[1] }),
    ] {
        bench.set(control, f::epctl::STALL, 1);
        assert_eq!(bench.transact(0, 1, token.clone()), Answer::Stall);
        bench.set(control, f::epctl::STALL, 0);
        assert_eq!(bench.transact(0, 1, token), Answer::Nak);
    }
}

#[test]
fn a_setup_clears_the_stall_of_endpoint_0() {
    let mut bench = Bench::ready(Core::F405);
    bench.set(Register::Diepctl(0), f::epctl::STALL, 1);
    bench.set(Register::Diepctl(0), f::epctl::STALL, 0);
    assert_eq!(bench.input(0), Answer::Stall, "software cannot clear it");
    bench.setup(GET);
    assert_eq!(bench.input(0), Answer::Nak);
}

#[test]
fn an_endpoint_is_disabled() {
    let mut bench = Bench::ready(Core::F405);
    bench.open_bulk(1);
    bench.set(Register::Diepctl(1), f::epctl::EPDIS, 1);
    assert_eq!(bench.get(Register::Diepint(1), f::diepint::EPDISD), 0, "it is not enabled");
    bench.arm_in(1, &[1]);
    bench.set(Register::Diepctl(1), f::epctl::EPDIS, 1);
    assert_eq!(bench.get(Register::Diepint(1), f::diepint::EPDISD), 1);
    assert_eq!(bench.read(Register::Diepctl(1)) >> 30, 0);
    bench.arm_out(1, 1);
    bench.set(Register::Doepctl(1), f::epctl::EPDIS, 1);
    assert_eq!(bench.get(Register::Doepint(1), f::doepint::EPDISD), 1);
    assert!(bench.told.iter().any(|told| told.contains("without the global OUT NAK")));
}

#[test]
fn an_empty_fifo_interrupts_through_its_own_mask() {
    let mut bench = Bench::ready(Core::F405);
    bench.open_bulk(1);
    bench.write(Register::Gahbcfg, 1);
    bench.write(Register::Gintmsk, f::gintsts::IEPINT.mask());
    bench.write(Register::Daintmsk, 2);
    bench.write(Register::Diepmsk, f::diepmsk::XFRCM.mask());
    assert!(!bench.line());
    bench.write(Register::Diepempmsk, 2);
    assert!(bench.line());
    bench.fill(1, &[0; 32]);
    assert!(bench.line(), "half empty");
    bench.fill(1, &[0; 4]);
    assert!(!bench.line());
    assert_eq!(bench.read(Register::Dtxfsts(1)), 7);
    bench.write(Register::Grstctl, 1 << 6 | 1 << 5);
    bench.set(Register::Gahbcfg, f::gahbcfg::TXFELVL, 1);
    assert!(bench.line());
    bench.fill(1, &[0; 4]);
    assert!(!bench.line(), "not wholly empty");
}

#[test]
fn tokens_without_a_transfer_are_flagged() {
    let mut bench = Bench::ready(Core::F405);
    bench.open_bulk(1);
    bench.arm_in(1, &[]);
    bench.input(1);
    assert_eq!(bench.get(Register::Diepint(1), f::diepint::ITTXFE), 0, "no bytes need no FIFO");
    bench.input(1);
    assert_eq!(bench.get(Register::Diepint(1), f::diepint::ITTXFE), 1);
    assert_eq!(bench.out(0, false, &[]), Answer::Nak);
    assert_eq!(bench.get(Register::Doepint(0), f::doepint::OTEPDIS), 1);
}

#[test]
fn the_masks_of_the_endpoints() {
    let mut bench = Bench::ready(Core::F405);
    bench.open_bulk(2);
    bench.arm_in(2, &[1]);
    bench.input(2);
    assert_eq!(bench.read(Register::Daint), 0);
    bench.write(Register::Diepmsk, f::diepmsk::XFRCM.mask());
    assert_eq!(bench.read(Register::Daint), 1 << 2);
    assert_eq!(bench.get(Register::Gintsts, f::gintsts::IEPINT), 0);
    bench.write(Register::Daintmsk, 1 << 2 | 1 << 18);
    assert_eq!(bench.get(Register::Gintsts, f::gintsts::IEPINT), 1);
    bench.write(Register::Diepint(2), f::diepint::XFRC.mask());
    assert_eq!(bench.get(Register::Gintsts, f::gintsts::IEPINT), 0);
    bench.arm_out(2, 1);
    bench.out(2, false, &[1]);
    pop(&mut bench);
    bench.drain(1);
    pop(&mut bench);
    assert_eq!(bench.get(Register::Gintsts, f::gintsts::OEPINT), 0);
    bench.write(Register::Doepmsk, f::doepmsk::XFRCM.mask());
    assert_eq!(bench.read(Register::Daint), 1 << 18);
    assert_eq!(bench.get(Register::Gintsts, f::gintsts::OEPINT), 1);
}

#[test]
fn the_global_naks() {
    let mut bench = Bench::ready(Core::F405);
    bench.open_bulk(1);
    bench.arm_in(1, &[1]);
    bench.arm_out(1, 2);
    bench.set(Register::Dctl, f::dctl::SGINAK, 1);
    assert_eq!(bench.get(Register::Gintsts, f::gintsts::GINAKEFF), 1);
    assert_eq!(bench.get(Register::Dctl, f::dctl::GINSTS), 1);
    assert_eq!(bench.input(1), Answer::Nak);
    bench.set(Register::Dctl, f::dctl::CGINAK, 1);
    assert_eq!(bench.input(1), data(false, &[1]));
    bench.set(Register::Dctl, f::dctl::SGONAK, 1);
    assert_eq!(bench.out(1, false, &[1; 64]), Answer::Nak);
    assert_eq!(bench.get(Register::Gintsts, f::gintsts::GONAKEFF), 0, "not before it is popped");
    assert_eq!(pop(&mut bench).0, 1);
    assert_eq!(bench.get(Register::Gintsts, f::gintsts::GONAKEFF), 1);
    bench.set(Register::Dctl, f::dctl::CGONAK, 1);
    assert_eq!(bench.get(Register::Gintsts, f::gintsts::GONAKEFF), 0);
    assert_eq!(bench.out(1, false, &[1; 64]), Answer::Ack);
    assert_eq!(bench.setup(GET), Answer::Ack);
}

#[test]
fn a_receive_fifo_too_small_naks() {
    let mut bench = Bench::ready(Core::F405);
    bench.open_bulk(1);
    // 10 for SETUP, 1 for the NAK, 2 endpoints, 17 for the packet, 1 for its end.
    bench.write(Register::Grxfsiz, 30);
    bench.arm_out(1, 1);
    assert_eq!(bench.out(1, false, &[1; 64]), Answer::Nak);
    assert!(bench.told.iter().any(|told| told.contains("no room for an OUT packet")));
    bench.write(Register::Grxfsiz, 31);
    assert_eq!(bench.out(1, false, &[1; 64]), Answer::Ack);
    bench.write(Register::Grxfsiz, 20);
    assert_eq!(bench.setup(GET), Answer::Silence);
    assert!(bench.told.iter().any(|told| told.contains("SETUP packet, which is lost")));
}

#[test]
fn a_transmit_fifo_too_small_loses() {
    let mut bench = Bench::ready(Core::F405);
    bench.open_bulk(1);
    bench.write(Register::Dieptxf(1), 2 << 16 | 144);
    bench.arm_in(1, &[1; 12]);
    assert!(bench.told.iter().any(|told| told.contains("the word is lost")));
    assert_eq!(bench.input(1), Answer::Nak);
}

#[test]
fn fifos_that_overlap_are_told() {
    for (start, told) in [(144, false), (127, true), (128, true), (310, true)] {
        let mut bench = Bench::ready(Core::F405);
        bench.open_bulk(1);
        bench.write(Register::Dieptxf(1), 16 << 16 | start);
        bench.arm_in(1, &[1]);
        assert_eq!(bench.told.iter().any(|told| told.contains("overlap")), told, "{start}");
    }
}

#[test]
fn any_word_of_a_window_reaches_the_fifo() {
    let mut bench = Bench::ready(Core::F405);
    bench.open_bulk(1);
    bench.write(Register::Dieptsiz(1), 1 << 19 | 8);
    bench.set(Register::Diepctl(1), f::epctl::EPENA, 1);
    bench.set(Register::Diepctl(1), f::epctl::CNAK, 1);
    bench.write_at(0x2000, 0x0403_0201);
    bench.write_at(0x2FFC, 0x0807_0605);
    assert_eq!(bench.input(1), data(false, &[1, 2, 3, 4, 5, 6, 7, 8]));
    bench.setup(GET);
    pop(&mut bench);
    assert_eq!(bench.read_at(0x1000), 0x0100_0680);
    assert_eq!(bench.read_at(0x1004), 0x0012_0000);
    assert_eq!(bench.read_at(0x1004), 0);
    assert!(bench.told.iter().any(|told| told.contains("no packet popped")));
}

#[test]
fn words_left_unread_are_told() {
    let mut bench = Bench::ready(Core::F405);
    bench.setup(GET);
    bench.setup(GET);
    pop(&mut bench);
    pop(&mut bench);
    assert!(bench.told.iter().any(|told| told.contains("unread")));
}

#[test]
fn the_pull_up_needs_every_condition() {
    let connected = |bench: &mut Bench| bench.bus(|port| port.connected());
    let mut bench = Bench::new(Core::F405);
    assert!(!connected(&mut bench), "the transceiver is off at reset");
    bench.connect();
    assert!(connected(&mut bench));
    for (register, field, value) in [
        (Register::Gccfg, f::gccfg::PWRDWN, 0),
        (Register::Dctl, f::dctl::SDIS, 1),
        (Register::Gccfg, f::gccfg::BIT21, 0),
        (Register::Gusbcfg, f::gusbcfg::FHMOD, 1),
    ] {
        let before = bench.read(register);
        bench.set(register, field, value);
        assert!(!connected(&mut bench), "{register:?} {}", field.name);
        bench.write(register, before);
        assert!(connected(&mut bench));
    }
    for (hz, expected) in [(0, false), (47_000_000, false), (48_000_000, true), (48_200_000, false)] {
        bench.soc.drive(rigless::time::VirtualNanos(0), |otg, registers, context| {
            otg.on_clock(hz, registers, context);
        });
        assert_eq!(connected(&mut bench), expected, "{hz} Hz");
    }
    assert!(!Bench::with(Otg::new(Core::F405)).bus(|port| port.connected()), "no clock tree");
}

#[test]
fn a_session_follows_the_cable() {
    let mut bench = Bench::new(Core::F405);
    bench.write(Register::Gccfg, f::gccfg::PWRDWN.mask() | f::gccfg::VBUSBSEN.mask());
    assert_eq!(bench.get(Register::Gotgctl, f::gotgctl::BSVLD), 0);
    assert!(!bench.bus(|port| port.connected()));
    bench.bus(|port| port.set_vbus(true));
    assert_eq!(bench.get(Register::Gotgctl, f::gotgctl::BSVLD), 1);
    assert_eq!(bench.get(Register::Gintsts, f::gintsts::SRQINT), 1);
    assert!(bench.bus(|port| port.connected()));
    bench.bus(|port| port.set_vbus(false));
    assert_eq!(bench.get(Register::Gintsts, f::gintsts::OTGINT), 1);
    assert_eq!(bench.get(Register::Gotgint, f::gotgint::SEDET), 1);
    bench.write(Register::Gotgint, f::gotgint::SEDET.mask());
    assert_eq!(bench.get(Register::Gintsts, f::gintsts::OTGINT), 0);
}

#[test]
fn the_f446_detects_vbus_in_its_own_way() {
    let mut bench = Bench::new(Core::F446);
    let valid = |bench: &mut Bench| bench.get(Register::Gotgctl, f::gotgctl::BSVLD);
    bench.write(Register::Gccfg, f::gccfg::PWRDWN.mask() | f::gccfg::BIT21.mask());
    assert_eq!(valid(&mut bench), 0, "VBDEN with the cable out");
    bench.bus(|port| port.set_vbus(true));
    assert_eq!(valid(&mut bench), 1);
    bench.set(Register::Gotgctl, f::gotgctl::BVALOEN, 1);
    assert_eq!(valid(&mut bench), 0, "software says no");
    bench.set(Register::Gotgctl, f::gotgctl::BVALOVAL, 1);
    assert_eq!(valid(&mut bench), 1);
}

#[test]
fn a_token_to_another_address_is_not_answered() {
    let mut bench = Bench::ready(Core::F405);
    bench.set(Register::Dcfg, f::dcfg::DAD, 5);
    assert_eq!(bench.setup(GET), Answer::Silence);
    assert_eq!(bench.transact(5, 0, Kind::Setup(GET)), Answer::Ack);
    assert_eq!(bench.transact(5, 1, Kind::In { acknowledged: true }), Answer::Silence, "not active");
    assert_eq!(bench.transact(5, 7, Kind::In { acknowledged: true }), Answer::Silence, "not there");
}

#[test]
fn an_address_counts_after_its_status_stage() {
    let mut bench = Bench::ready(Core::F405);
    bench.setup([0, 5, 5, 0, 0, 0, 0, 0]);
    pop(&mut bench);
    bench.drain(8);
    bench.set(Register::Dcfg, f::dcfg::DAD, 5);
    bench.arm_in(0, &[]);
    assert_eq!(bench.transact(5, 0, Kind::In { acknowledged: true }), Answer::Silence);
    assert_eq!(bench.transact(0, 0, Kind::In { acknowledged: false }), data(true, &[]));
    assert_eq!(bench.input(0), data(true, &[]), "the host missed the first");
    assert_eq!(bench.setup(GET), Answer::Silence);
    assert_eq!(bench.transact(5, 0, Kind::Setup(GET)), Answer::Ack);
    bench.set(Register::Dcfg, f::dcfg::DAD, 0);
    assert_eq!(bench.setup(GET), Answer::Ack, "zero counts at once");
}

#[test]
fn a_gated_clock_answers_nothing() {
    for gate in [f::pcgcctl::STPPCLK, f::pcgcctl::GATEHCLK] {
        let mut bench = Bench::ready(Core::F405);
        bench.set(Register::Pcgcctl, gate, 1);
        assert_eq!(bench.setup(GET), Answer::Silence);
        assert!(bench.bus(|port| port.connected()));
        bench.set(Register::Pcgcctl, gate, 0);
        assert_eq!(bench.setup(GET), Answer::Ack);
    }
}

#[test]
fn the_f405_has_four_endpoints() {
    let mut bench = Bench::ready(Core::F405);
    bench.write(Register::Diepctl(4), 0xFFFF);
    assert_eq!(bench.read(Register::Diepctl(4)), 0);
    assert!(bench.told.iter().any(|told| told.contains("endpoints 0 to 3")));
    let mut bench = Bench::ready(Core::F446);
    bench.write(Register::Dieptxf(5), 16 << 16 | 240);
    bench.open_bulk(5);
    bench.arm_in(5, &[1]);
    assert_eq!(bench.input(5), data(false, &[1]));
    assert_eq!(bench.told, [""; 0]);
}

#[test]
fn host_registers_are_stored_and_flagged() {
    let mut bench = Bench::new(Core::F405);
    bench.write(Register::Host(1), 48_000);
    assert_eq!(bench.read(Register::Host(1)), 48_000);
    assert_eq!(Register::Host(1).spec().name, "HFIR");
    assert_eq!(bench.get(Register::Gintsts, f::gintsts::MMIS), 1);
}

#[test]
fn a_babbling_packet_is_not_answered() {
    let mut bench = Bench::ready(Core::F405);
    bench.set(Register::Diepctl(0), f::diepctl0::MPSIZ, 3);
    assert_eq!(bench.get(Register::Doepctl(0), f::doepctl0::MPSIZ), 3, "it follows the IN side");
    bench.arm_out(0, 1);
    assert_eq!(bench.out(0, false, &[1; 9]), Answer::Silence);
    assert_eq!(bench.out(0, false, &[1; 8]), Answer::Ack);
}

#[test]
fn a_system_reset_forgets_all_but_the_cable() {
    let mut bench = Bench::ready(Core::F405);
    bench.write(Register::Gahbcfg, 1);
    bench.setup(GET);
    bench.soc.reset_every_model();
    assert_eq!(bench.read(Register::Gintsts), 0x0400_0020);
    assert_eq!(bench.setup(GET), Answer::Silence);
    bench.set(Register::Gccfg, f::gccfg::VBUSBSEN, 1);
    assert_eq!(bench.get(Register::Gotgctl, f::gotgctl::BSVLD), 1, "the cable is in");
}

#[test]
fn a_snapshot_keeps_the_state() {
    let mut bench = Bench::ready(Core::F405);
    bench.setup(GET);
    let kept: Otg = serde_json::from_str(&serde_json::to_string(&bench.soc.model).unwrap()).unwrap();
    assert_eq!(format!("{kept:?}"), format!("{:?}", bench.soc.model));
}

#[test]
fn a_peek_changes_nothing() {
    let mut bench = Bench::ready(Core::F405);
    bench.setup(GET);
    let at = rigless::time::VirtualNanos(bench.now_ns);
    let address = super::PERIPHERAL.base + u64::from(Register::Grxstsp.spec().offset);
    let width = rigless::soc::Width::W32;
    let first = bench.soc.peek(at, address, width).unwrap();
    assert_eq!(bench.soc.peek(at, address, width).unwrap(), first);
    assert_eq!(bench.read(Register::Grxstsp), first);
    assert_eq!(bench.soc.peek(at, address, width).unwrap(), 0);
}
