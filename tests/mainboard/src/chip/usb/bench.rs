//! A core on a separate bus, for the tests.

use rigless::device::Level;
use rigless::mcu::{Operate, Single};
use rigless::soc::{Bus, Cpu, Endian, FieldSpec, Layout, Region, Width};
use rigless::time::VirtualNanos;

use super::bus_side::Port;
use super::fields as f;
use super::{Core, Otg, PERIPHERAL, Register};
use crate::host::usb::bus::{Answer, Bus as _, Kind, Token};

static MEMORY: [Region; 1] = [Region::ram("sram", 0x2000_0000, 0x1_0000)];

pub struct Bench {
    pub soc: Single<Otg>,
    pub now_ns: u64,
    line: bool,
    pub told: Vec<&'static str>,
}

impl Bench {
    pub fn new(core: Core) -> Self {
        Self::with(Otg::new(core).with_clock(48_000_000))
    }

    pub fn with(otg: Otg) -> Self {
        let builder = Bus::builder(Cpu::new("CM4", true, 96, Endian::Little), &MEMORY, [PERIPHERAL]);
        let soc = Single::new(builder, "OTG_FS_GLOBAL", otg).unwrap();
        Self { soc, now_ns: 0, line: false, told: Vec::new() }
    }

    /// A core that was connected, reset and enumerated, with FIFOs and endpoint 0 set up; DAD is 0.
    pub fn ready(core: Core) -> Self {
        let mut bench = Self::new(core);
        bench.connect();
        bench.bus_reset();
        bench.write(Register::Grxfsiz, 128);
        for (number, start) in [(0, 128), (1, 144), (2, 176), (3, 208)] {
            bench.write(Register::Dieptxf(number), 16 << 16 | start);
        }
        bench.write(Register::Gintsts, 0xFFFF_FFFF);
        bench.write(Register::Doeptsiz(0), 3 << 29 | 1 << 19 | 64);
        bench
    }

    /// Switches the transceiver and the pull-up on, without VBUS sensing.
    pub fn connect(&mut self) {
        self.bus(|port| port.set_vbus(true));
        self.set(Register::Gccfg, f::gccfg::PWRDWN, 1);
        match self.read(Register::Cid) {
            0x1200 => self.set(Register::Gccfg, f::gccfg::BIT21, 1),
            _ => self.set(Register::Gotgctl, f::gotgctl::BVALOEN, 1),
        }
        if self.read(Register::Cid) != 0x1200 {
            self.set(Register::Gotgctl, f::gotgctl::BVALOVAL, 1);
        }
        self.set(Register::Dcfg, f::dcfg::DSPD, 3);
    }

    /// A bus reset of 10 ms.
    pub fn bus_reset(&mut self) {
        self.bus(|port| port.set_reset(true));
        self.pass(10_000_000);
        self.bus(|port| port.set_reset(false));
        self.pass(1_000_000);
    }

    /// An endpoint of 64 bytes for bulk, both directions, NAKing.
    pub fn open_bulk(&mut self, endpoint: u8) {
        let open = f::epctl::SD0PID.set(f::epctl::SNAK.set(f::epctl::USBAEP.set(64, 1), 1), 1);
        let open = f::epctl::EPTYP.set(open, 2);
        self.write(Register::Diepctl(endpoint), f::epctl::TXFNUM.set(open, endpoint.into()));
        self.write(Register::Doepctl(endpoint), open);
    }

    /// Enables an OUT endpoint for this many packets of 64 bytes.
    pub fn arm_out(&mut self, endpoint: u8, packets: u64) {
        let size = f::eptsiz::PKTCNT.set(0, packets) | (64 * packets).min(if endpoint == 0 { 64 } else { 0x7_FFFF });
        self.write(Register::Doeptsiz(endpoint), size);
        let control = self.read(Register::Doepctl(endpoint));
        self.write(Register::Doepctl(endpoint), control | f::epctl::EPENA.mask() | f::epctl::CNAK.mask());
    }

    /// Enables an IN endpoint for one transfer and fills its FIFO.
    pub fn arm_in(&mut self, endpoint: u8, bytes: &[u8]) {
        let packets = bytes.len().div_ceil(64).max(1) as u64;
        self.write(Register::Dieptsiz(endpoint), f::eptsiz::PKTCNT.set(0, packets) | bytes.len() as u64);
        let control = self.read(Register::Diepctl(endpoint));
        self.write(Register::Diepctl(endpoint), control | f::epctl::EPENA.mask() | f::epctl::CNAK.mask());
        self.fill(endpoint, bytes);
    }

    /// Writes a packet to a transmit FIFO.
    pub fn fill(&mut self, endpoint: u8, bytes: &[u8]) {
        for chunk in bytes.chunks(4) {
            let word = chunk.iter().rev().fold(0, |word, byte| word << 8 | u64::from(*byte));
            self.write(Register::Fifo(endpoint), word);
        }
    }

    /// Reads this many bytes from the receive FIFO.
    pub fn drain(&mut self, bytes: usize) -> Vec<u8> {
        let words: Vec<u64> = (0..bytes.div_ceil(4)).map(|_| self.read(Register::Fifo(0))).collect();
        words.iter().flat_map(|word| (*word as u32).to_le_bytes()).take(bytes).collect()
    }

    pub fn read(&mut self, register: Register) -> u64 {
        self.read_at(register.spec().offset)
    }

    pub fn read_at(&mut self, offset: u32) -> u64 {
        let at = VirtualNanos(self.now_ns);
        let value = self.soc.read(at, PERIPHERAL.base + u64::from(offset), Width::W32).unwrap();
        self.follow();
        value
    }

    pub fn write(&mut self, register: Register, value: u64) {
        self.write_at(register.spec().offset, value);
    }

    pub fn write_at(&mut self, offset: u32, value: u64) {
        let at = VirtualNanos(self.now_ns);
        self.soc.write(at, PERIPHERAL.base + u64::from(offset), Width::W32, value).unwrap();
        self.follow();
    }

    /// Reads one field.
    pub fn get(&mut self, register: Register, field: FieldSpec) -> u64 {
        field.get(self.read(register))
    }

    /// Changes one field, like a driver's read, modify and write.
    pub fn set(&mut self, register: Register, field: FieldSpec, value: u64) {
        let old = self.read(register);
        self.write(register, field.set(old, value));
    }

    pub fn bus<T>(&mut self, act: impl FnOnce(&mut Port<'_, '_>) -> T) -> T {
        let at = VirtualNanos(self.now_ns);
        let result = self.soc.drive(at, |otg, registers, context| act(&mut otg.port(registers, context)));
        self.follow();
        result
    }

    pub fn transact(&mut self, address: u8, endpoint: u8, kind: Kind<'_>) -> Answer {
        self.bus(|port| port.transact(&Token { address, endpoint, kind }))
    }

    pub fn setup(&mut self, bytes: [u8; 8]) -> Answer {
        self.transact(0, 0, Kind::Setup(bytes))
    }

    pub fn out(&mut self, endpoint: u8, toggle: bool, data: &[u8]) -> Answer {
        self.transact(0, endpoint, Kind::Out { toggle, data })
    }

    pub fn input(&mut self, endpoint: u8) -> Answer {
        self.transact(0, endpoint, Kind::In { acknowledged: true })
    }

    /// Advances time.
    pub fn pass(&mut self, ns: u64) {
        self.go_to(self.now_ns + ns);
    }

    pub fn go_to(&mut self, at_ns: u64) {
        self.now_ns = at_ns;
        self.soc.advance_to(VirtualNanos(at_ns));
        self.follow();
    }

    /// The level of interrupt 67.
    pub fn line(&self) -> bool {
        self.line
    }

    fn follow(&mut self) {
        for change in self.soc.drain_interrupts() {
            assert_eq!(change.interrupt, 67);
            assert_ne!(self.line, change.level == Level::High, "a level is driven when it changes");
            self.line = change.level == Level::High;
        }
        self.told.extend(self.soc.drain_told().iter().map(|told| told.reason));
    }
}

/// A generator of these tests, independent of changes to a library.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self, below: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % below
    }
}
