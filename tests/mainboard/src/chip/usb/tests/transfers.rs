//! SETUP, OUT and IN, and the effects of an endpoint's control bits.

use super::{GET, data, pop};
use crate::chip::usb::bench::Bench;
use crate::chip::usb::fields as f;
use crate::chip::usb::{Core, Register};
use crate::host::usb::bus::{Answer, Kind};

const CORES: [Core; 2] = [Core::F405, Core::F446];

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
fn a_setup_is_accepted_despite_nak() {
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
    // Without a count each packet is a transfer, and the core reports it.
    bench.write(Register::Doeptsiz(1), 0);
    bench.set(Register::Doepctl(1), f::epctl::EPENA, 1);
    bench.set(Register::Doepctl(1), f::epctl::CNAK, 1);
    assert!(bench.told.iter().any(|told| told.contains("PKTCNT 0")));
    assert_eq!(bench.out(1, false, &[3; 64]), Answer::Ack);
    assert_eq!(bench.out(1, true, &[3; 64]), Answer::Nak);
}

#[test]
fn a_short_packet_ends_a_transfer() {
    let mut bench = Bench::ready(Core::F405);
    bench.open_bulk(1);
    bench.arm_out(1, 4);
    bench.out(1, false, &[1; 64]);
    bench.out(1, true, &[1; 63]);
    assert_eq!(bench.out(1, false, &[1; 64]), Answer::Nak);
    assert_eq!(bench.get(Register::Doeptsiz(1), f::eptsiz::PKTCNT), 2);
    for (status, bytes) in [(2, 64), (2, 63)] {
        assert_eq!(pop(&mut bench), (status, 1, bytes));
        bench.drain(bytes as usize);
    }
    assert_eq!(pop(&mut bench), (3, 1, 0));
    assert_eq!(bench.get(Register::Doeptsiz(1), f::eptsiz::XFRSIZ), 256 - 127);
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
fn an_in_packet_is_sent_once() {
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
    // With a count of 0 the endpoint sends no packet.
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
