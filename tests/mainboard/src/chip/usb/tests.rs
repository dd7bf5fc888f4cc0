//! A test for each row of the model's table, except the rows of transfers: see `transfers`.

use rigless::device::{Device, Level};
use rigless::mcu::Operate;
use rigless::soc::Layout;

use super::bench::Bench;
use super::fields as f;
use super::{Core, Otg, Register, WAKEUP};
use crate::host::usb::bus::{Answer, Bus, Kind};

mod transfers;

const GET: [u8; 8] = [0x80, 6, 0, 1, 0, 0, 18, 0];

fn data(toggle: bool, bytes: &[u8]) -> Answer {
    Answer::Data { toggle, bytes: bytes.to_vec() }
}

/// Pops GRXSTSP; returns its status, endpoint and byte count.
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
fn a_short_reset_is_ignored() {
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
fn overlapping_fifos_are_reported() {
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
fn unread_words_are_reported() {
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
    bench.bus_reset();
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
        assert_eq!(bench.setup(GET), Answer::Silence, "it waits for a reset again");
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
fn an_address_takes_effect_after_its_status_stage() {
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
    bench.bus_reset();
    bench.set(Register::Dcfg, f::dcfg::DAD, 6);
    assert_eq!(bench.transact(6, 0, Kind::Setup(GET)), Answer::Ack, "a reset ends the transfer");
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
fn a_system_reset_keeps_only_the_cable() {
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
