//! A driver between the model and the host: it enumerates as a serial port and echoes its input.
//!
//! It has two styles: the manual's programming model (RM0090 34.17), with endpoint interrupts, and
//! that of the public crate `synopsys-usb-otg`, which follows the receive FIFO's states.

use std::collections::VecDeque;

use super::bench::{Bench, Random};
use super::fields as f;
use super::{Core, Register};
use crate::host::usb::bus::Bus;
use crate::host::usb::{State, UsbHost};

const DEVICE: [u8; 18] = [18, 1, 0, 2, 2, 0, 0, 64, 0x09, 0x12, 1, 0, 0, 1, 1, 2, 0, 1];
const CONFIGURATION: [u8; 67] = [
    9, 2, 67, 0, 2, 1, 0, 0xC0, 50, 9, 4, 0, 0, 1, 2, 2, 1, 0, 5, 0x24, 0, 0x10, 1, 4, 0x24, 2, 2, 5, 0x24, 6, 0, 1, 5,
    0x24, 1, 0, 1, 7, 5, 0x83, 3, 8, 0, 16, 9, 4, 1, 0, 2, 0x0A, 0, 0, 0, 7, 5, 0x81, 2, 64, 0, 0, 7, 5, 0x02, 2, 64,
    0, 0,
];
const LANGUAGES: [u8; 4] = [4, 3, 9, 4];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Style {
    Manual,
    Crate,
}

struct Driver {
    style: Style,
    core: Core,
    setup: Option<[u8; 8]>,
    /// The remaining packets of a control read.
    reply: VecDeque<Vec<u8>>,
    /// The remaining bytes of a control write.
    expected: usize,
    line_coding: Vec<u8>,
    line_state: u8,
    configured: bool,
    echo: VecDeque<u8>,
    resets: u32,
    suspended: bool,
}

impl Driver {
    fn new(style: Style, core: Core) -> Self {
        Self {
            style,
            core,
            setup: None,
            reply: VecDeque::new(),
            expected: 0,
            line_coding: Vec::new(),
            line_state: 0,
            configured: false,
            echo: VecDeque::new(),
            resets: 0,
            suspended: false,
        }
    }

    /// 34.17.1 and 34.17.3.
    fn start(&self, bench: &mut Bench) {
        assert_eq!(bench.get(Register::Grstctl, f::grstctl::AHBIDL), 1);
        bench.write(Register::Grstctl, 1);
        assert_eq!(bench.get(Register::Grstctl, f::grstctl::CSRST), 0);
        bench.set(Register::Gusbcfg, f::gusbcfg::FDMOD, 1);
        bench.set(Register::Dctl, f::dctl::SDIS, 1);
        bench.set(Register::Dcfg, f::dcfg::DSPD, 3);
        let g = [
            f::gintsts::USBRST,
            f::gintsts::ENUMDNE,
            f::gintsts::USBSUSP,
            f::gintsts::WKUPINT,
            f::gintsts::IEPINT,
            f::gintsts::RXFLVL,
            f::gintsts::OEPINT,
        ];
        let mask = g.iter().fold(0, |mask, field| mask | field.mask());
        bench.write(Register::Gintsts, 0xFFFF_FFFF);
        bench.write(Register::Gintmsk, mask);
        bench.write(Register::Gahbcfg, 1);
        if self.core == Core::F446 {
            bench.write(Register::Gotgctl, f::gotgctl::BVALOEN.mask() | f::gotgctl::BVALOVAL.mask());
            bench.write(Register::Gccfg, f::gccfg::PWRDWN.mask());
        } else {
            bench.write(Register::Gccfg, f::gccfg::PWRDWN.mask() | f::gccfg::VBUSBSEN.mask());
        }
        bench.set(Register::Dctl, f::dctl::SDIS, 0);
    }

    /// 34.17.5: endpoints on a USB reset.
    fn on_reset(&mut self, bench: &mut Bench) {
        self.resets += 1;
        *self = Self { resets: self.resets, ..Self::new(self.style, self.core) };
        for endpoint in 0..4 {
            for control in [Register::Diepctl(endpoint), Register::Doepctl(endpoint)] {
                let disable = bench.get(control, f::epctl::EPENA) == 1 && control != Register::Doepctl(0);
                let value = f::epctl::SNAK.set(bench.read(control), 1);
                bench.write(control, f::epctl::EPDIS.set(value, disable.into()));
            }
            bench.write(Register::Diepint(endpoint), 0xFF);
            bench.write(Register::Doepint(endpoint), 0xFF);
        }
        bench.set(Register::Dcfg, f::dcfg::DAD, 0);
        bench.write(Register::Grxfsiz, 96);
        for (fifo, start) in [(0, 96), (1, 112), (2, 160), (3, 176)] {
            bench.write(Register::Dieptxf(fifo), 16 << 16 | start);
        }
        bench.write(Register::Grstctl, 0x10 << 6 | 1 << 5 | 1 << 4);
        bench.write(Register::Daintmsk, 0x0001_0001);
        bench.write(Register::Diepmsk, f::diepmsk::XFRCM.mask());
        bench.write(Register::Doepmsk, f::doepmsk::XFRCM.mask() | f::doepmsk::STUPM.mask());
        bench.write(Register::Doeptsiz(0), 3 << 29 | 1 << 19 | 64);
        bench.set(Register::Doepctl(0), f::epctl::EPENA, 1);
    }

    fn configure(&mut self, bench: &mut Bench) {
        for (endpoint, kind, size) in [(1, 2, 64), (3, 3, 8)] {
            let value = f::epctl::TXFNUM.set(f::epctl::EPTYP.set(f::epctl::USBAEP.set(size, 1), kind), endpoint);
            let value = f::epctl::SD0PID.set(f::epctl::SNAK.set(value, 1), 1);
            bench.write(Register::Diepctl(endpoint as u8), value);
        }
        let value = f::epctl::SD0PID.set(f::epctl::EPTYP.set(f::epctl::USBAEP.set(64, 1), 2), 1);
        bench.write(Register::Doepctl(2), value);
        bench.write(Register::Daintmsk, 1 << 18 | 1 << 16 | 1 << 1 | 1);
        self.configured = true;
        self.arm(2, bench);
    }

    /// Enables an endpoint for one more OUT packet.
    fn arm(&self, endpoint: u8, bench: &mut Bench) {
        match self.style {
            Style::Manual => {
                let setups = if endpoint == 0 { 3 << 29 } else { 0 };
                bench.write(Register::Doeptsiz(endpoint), setups | 1 << 19 | 64);
            }
            Style::Crate => {} // Never writes the size again.
        }
        let control = bench.read(Register::Doepctl(endpoint));
        bench.write(Register::Doepctl(endpoint), control | f::epctl::EPENA.mask() | f::epctl::CNAK.mask());
    }

    fn send(&mut self, endpoint: u8, bytes: &[u8], bench: &mut Bench) {
        assert!(bytes.len().div_ceil(4) as u64 <= bench.read(Register::Dtxfsts(endpoint)));
        bench.arm_in(endpoint, bytes);
    }

    fn pump(&mut self, bench: &mut Bench) {
        if self.configured && !self.echo.is_empty() && bench.get(Register::Diepctl(1), f::epctl::EPENA) == 0 {
            let count = self.echo.len().min(64);
            let bytes: Vec<u8> = self.echo.drain(..count).collect();
            self.send(1, &bytes, bench);
        }
    }

    fn interrupt(&mut self, bench: &mut Bench) {
        let flags = bench.read(Register::Gintsts);
        if f::gintsts::USBRST.is_set(flags) {
            bench.write(Register::Gintsts, f::gintsts::USBRST.mask());
            self.on_reset(bench);
        }
        if f::gintsts::ENUMDNE.is_set(flags) {
            bench.write(Register::Gintsts, f::gintsts::ENUMDNE.mask());
            assert_eq!(bench.get(Register::Dsts, f::dsts::ENUMSPD), 3);
        }
        for (flag, suspended) in [(f::gintsts::USBSUSP, true), (f::gintsts::WKUPINT, false)] {
            if flag.is_set(flags) {
                bench.write(Register::Gintsts, flag.mask());
                self.suspended = suspended;
            }
        }
        if f::gintsts::RXFLVL.is_set(bench.read(Register::Gintsts)) {
            self.receive(bench);
        }
        if f::gintsts::IEPINT.is_set(bench.read(Register::Gintsts)) {
            let endpoints = bench.read(Register::Daint);
            for endpoint in [0, 1] {
                if endpoints >> endpoint & 1 != 0 {
                    bench.write(Register::Diepint(endpoint), f::diepint::XFRC.mask());
                    self.sent(endpoint, bench);
                }
            }
        }
        if f::gintsts::OEPINT.is_set(bench.read(Register::Gintsts)) {
            for endpoint in [0, 2] {
                let flags = bench.read(Register::Doepint(endpoint));
                bench.write(Register::Doepint(endpoint), flags);
                if self.style == Style::Manual {
                    if f::doepint::STUP.is_set(flags) {
                        self.request(bench);
                    }
                    if f::doepint::XFRC.is_set(flags) {
                        self.received(endpoint, bench);
                    }
                }
            }
        }
        self.pump(bench);
    }

    fn receive(&mut self, bench: &mut Bench) {
        let word = bench.read(Register::Grxstsp);
        let endpoint = f::grxsts::EPNUM.get(word) as u8;
        let count = f::grxsts::BCNT.get(word) as usize;
        let status = f::grxsts::PKTSTS.get(word);
        let by_crate = self.style == Style::Crate;
        match status {
            6 => self.setup = Some(bench.drain(8).try_into().unwrap()),
            2 => {
                let bytes = bench.drain(count);
                if endpoint == 0 {
                    self.line_coding.extend(&bytes);
                    self.expected = self.expected.saturating_sub(count);
                } else {
                    self.echo.extend(&bytes);
                }
            }
            _ => {}
        }
        if !by_crate {
            return;
        }
        // The F405 is enabled again after the end of a transfer, the F446 as its data are read.
        let enable = if self.core == Core::F405 { [3, 4] } else { [2, 6] };
        if enable.contains(&status) {
            self.arm(endpoint, bench);
        }
        if status == 6 {
            self.request(bench);
        }
        if status == 2 && endpoint == 0 && !self.line_coding.is_empty() && self.expected == 0 && count > 0 {
            self.send(0, &[], bench);
        }
    }

    /// Follows the end of an OUT transfer in the manual's style.
    fn received(&mut self, endpoint: u8, bench: &mut Bench) {
        if endpoint == 2 {
            self.arm(2, bench);
        } else if self.expected == 0 && self.setup.is_none() && !self.line_coding.is_empty() {
            self.send(0, &[], bench);
            bench.write(Register::Doeptsiz(0), 3 << 29 | 1 << 19 | 64);
        }
    }

    fn sent(&mut self, endpoint: u8, bench: &mut Bench) {
        if endpoint == 0
            && let Some(packet) = self.reply.pop_front()
        {
            self.send(0, &packet, bench);
        }
    }

    fn request(&mut self, bench: &mut Bench) {
        let Some(setup) = self.setup.take() else { return };
        let length = usize::from(u16::from_le_bytes([setup[6], setup[7]]));
        self.line_coding.clear();
        self.expected = 0;
        self.reply.clear();
        let text = |text: &str| {
            let units: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
            [&[units.len() as u8 + 2, 3][..], &units].concat()
        };
        let reply = match (setup[0], setup[1], setup[3]) {
            (0x80, 6, 1) => Some(DEVICE.to_vec()),
            (0x80, 6, 2) => Some(CONFIGURATION.to_vec()),
            (0x80, 6, 3) if setup[2] == 0 => Some(LANGUAGES.to_vec()),
            (0x80, 6, 3) if setup[2] == 1 => Some(text("Maker")),
            (0x80, 6, 3) => Some(text("A port whose name needs more than one packet")),
            (0x00, 5, _) => {
                // 34.17.5 demands the address before the status stage.
                bench.set(Register::Dcfg, f::dcfg::DAD, setup[2].into());
                None
            }
            (0x00, 9, _) => {
                self.configure(bench);
                None
            }
            (0x21, 0x20, _) => None,
            (0x21, 0x22, _) => {
                self.line_state = setup[2];
                None
            }
            (0x02, 1, _) => None,
            _ => {
                bench.set(Register::Diepctl(0), f::epctl::STALL, 1);
                bench.set(Register::Doepctl(0), f::epctl::STALL, 1);
                return;
            }
        };
        if setup[0] & 0x80 == 0 && length > 0 {
            self.expected = length;
            if self.style == Style::Manual {
                self.arm(0, bench);
            }
            return;
        }
        let reply = reply.unwrap_or_default();
        let reply = &reply[..reply.len().min(length)];
        self.reply = reply.chunks(64).map(<[u8]>::to_vec).collect();
        if reply.is_empty() || (reply.len() % 64 == 0 && reply.len() < length) {
            self.reply.push_back(Vec::new());
        }
        if self.style == Style::Manual {
            self.arm(0, bench);
        }
        let packet = self.reply.pop_front().unwrap_or_default();
        self.send(0, &packet, bench);
    }
}

struct Desk {
    bench: Bench,
    host: UsbHost,
    driver: Driver,
    random: Random,
    /// The instant at which the driver handles the interrupt.
    service_ns: Option<u64>,
    latency_ns: u64,
}

impl Desk {
    fn new(core: Core, style: Style, seed: u64, latency_ns: u64) -> Self {
        let mut bench = Bench::new(core);
        let driver = Driver::new(style, core);
        driver.start(&mut bench);
        Self { bench, host: UsbHost::new(), driver, random: Random(seed | 1), service_ns: None, latency_ns }
    }

    /// Runs until `done`, at most for this time.
    fn run(&mut self, for_ns: u64, mut done: impl FnMut(&mut Self) -> bool) -> bool {
        let end_ns = self.bench.now_ns + for_ns;
        while !done(self) {
            if self.bench.line() && self.service_ns.is_none() {
                self.service_ns = Some(self.bench.now_ns + 200 + self.random.next(self.latency_ns));
            }
            let event_ns = rigless::mcu::Operate::next_event(&self.bench.soc).map_or(u64::MAX, |at| at.0);
            let next_ns = self.host.next_event_ns().min(event_ns).min(self.service_ns.unwrap_or(u64::MAX));
            if next_ns > end_ns {
                self.bench.go_to(end_ns);
                return false;
            }
            self.bench.go_to(next_ns.max(self.bench.now_ns));
            if self.service_ns.is_some_and(|at_ns| at_ns <= self.bench.now_ns) {
                self.service_ns = None;
                self.driver.interrupt(&mut self.bench);
            }
            let (host, now_ns) = (&mut self.host, self.bench.now_ns);
            self.bench.bus(|port| host.advance(now_ns, port));
        }
        true
    }

    fn open(&mut self) {
        self.host.plug();
        assert!(self.run(2_000_000_000, |desk| desk.host.state() == State::Open), "{:?}", self.host);
    }

    fn echoes(&mut self, bytes: &[u8]) {
        self.host.write(bytes);
        let mut got = Vec::new();
        let all = self.run(2_000_000_000, |desk| {
            got.extend(desk.host.read());
            got.len() >= bytes.len()
        });
        assert!(all, "{} of {} bytes came back: {:?}", got.len(), bytes.len(), self.host.errors);
        assert_eq!(got, bytes);
    }
}

const WAYS: [(Core, Style); 4] =
    [(Core::F405, Style::Manual), (Core::F446, Style::Manual), (Core::F405, Style::Crate), (Core::F446, Style::Crate)];

#[test]
fn a_driver_enumerates_and_echoes() {
    for (core, style) in WAYS {
        let mut desk = Desk::new(core, style, 1, 5_000);
        desk.open();
        let errors = desk.host.errors;
        assert_eq!((errors.timeouts, errors.stalls, errors.broken, errors.failed_requests), (0, 0, 0, 0), "{core:?}");
        assert_eq!(desk.host.strings()[0], "Maker");
        assert_eq!(desk.host.strings()[1], "A port whose name needs more than one packet");
        assert_eq!(desk.driver.resets, 2);
        assert_eq!(desk.driver.line_coding.len(), 0, "cleared by the request after it");
        assert_eq!(desk.driver.line_state, 3);
        desk.echoes(b"M115\n");
    }
}

#[test]
fn random_streams_are_echoed_completely() {
    for (seed, latency_ns) in [(0x5EED, 1_000), (0xBEEF, 30_000), (77, 400_000)] {
        for (core, style) in WAYS {
            let mut desk = Desk::new(core, style, seed, latency_ns);
            desk.open();
            for _ in 0..12 {
                let length = desk.random.next(700);
                let bytes: Vec<u8> = (0..length).map(|_| desk.random.next(256) as u8).collect();
                let losses = desk.random.next(3) as u32;
                desk.host.lose_handshakes(losses);
                desk.echoes(&bytes);
            }
            assert!(desk.host.errors.repeated_packets + desk.host.errors.timeouts > 0);
            assert_eq!((desk.host.errors.broken, desk.host.errors.stalls), (0, 0));
            let told: Vec<_> = desk.bench.told.iter().filter(|told| !told.contains("PKTCNT 0")).collect();
            assert!(told.iter().all(|told| told.contains("without the global OUT NAK")), "{told:?}");
        }
    }
}

#[test]
fn the_same_seed_gives_the_same_run() {
    let run = || {
        let mut desk = Desk::new(Core::F405, Style::Manual, 42, 20_000);
        desk.open();
        desk.echoes(&[7; 1000]);
        (desk.bench.now_ns, desk.host)
    };
    assert_eq!(run(), run());
}

#[test]
fn the_cable_may_be_unplugged_in_mid_stream() {
    for (core, style) in WAYS {
        let mut desk = Desk::new(core, style, 3, 20_000);
        desk.open();
        for wait_ns in [100_000, 1_234_567, 3_000_000] {
            desk.host.write(&[1; 3000]);
            desk.run(wait_ns, |_| false);
            desk.host.unplug();
            desk.run(5_000_000, |_| false);
            assert_eq!(desk.host.state(), State::Unplugged);
            desk.open();
            desk.host.read();
            desk.echoes(b"again");
        }
        assert!(desk.host.errors.dropped_bytes > 0);
        // A bus reset in mid-transfer, and a suspend.
        desk.host.write(&[2; 3000]);
        desk.run(700_000, |_| false);
        desk.host.reset_bus();
        desk.run(10_000_000, |_| false);
        assert!(desk.run(2_000_000_000, |desk| desk.host.state() == State::Open));
        desk.run(100_000_000, |desk| desk.host.unsent() == 0);
        desk.run(10_000_000, |_| false);
        desk.host.read();
        desk.host.suspend();
        desk.run(50_000_000, |_| false);
        assert!(desk.driver.suspended);
        desk.host.resume();
        assert!(desk.run(2_000_000_000, |desk| desk.host.state() == State::Open));
        desk.echoes(b"awake");
        assert!(!desk.driver.suspended);
    }
}

#[test]
fn a_reset_in_the_middle_of_a_request_is_survived() {
    for (core, style) in WAYS {
        for wait_us in (0..3_000).step_by(37) {
            let mut desk = Desk::new(core, style, wait_us, 30_000);
            desk.host.plug();
            // The first request begins 160 ms after plugging, SET_ADDRESS 60 ms later.
            let from_us = if wait_us % 2 == 0 { 160_000 } else { 220_000 };
            desk.run((from_us + wait_us) * 1_000, |_| false);
            desk.host.reset_bus();
            desk.run(1_000_000, |_| false);
            desk.open();
            desk.echoes(b"M105\n");
            assert_eq!(desk.host.errors.failed_requests, 0, "{core:?} {style:?} {wait_us} us: {:?}", desk.host.errors);
        }
    }
}

#[test]
fn the_host_detects_a_missing_driver() {
    let mut desk = Desk::new(Core::F405, Style::Manual, 9, 5_000);
    desk.open();
    desk.bench.set(Register::Dctl, f::dctl::SDIS, 1);
    desk.run(3_000_000, |_| false);
    assert_eq!(desk.host.state(), State::Waiting);
    assert_eq!(desk.host.errors.disconnects, 1);
    desk.bench.set(Register::Dctl, f::dctl::SDIS, 0);
    assert!(desk.run(2_000_000_000, |desk| desk.host.state() == State::Open));
    desk.bench.bus(|port| port.set_vbus(false));
    desk.run(2_000_000, |_| false);
    assert_eq!(desk.host.errors.disconnects, 2, "VBUS sensing took the pull-up off");
    assert!(desk.run(2_000_000_000, |desk| desk.host.state() == State::Open), "the host gives VBUS again");
}
