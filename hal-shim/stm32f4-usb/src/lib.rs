//! The USB port on the STM32F4's full-speed controller: the device of
//! `ferrostep-usb`, with its rings.
//!
//! A separate crate because it is optimised for size, as the root's `Cargo.toml` says: generic code
//! is compiled where its types are known, and that is here. A packet comes every 50 us at most, a
//! step every 10 us.
#![no_std]
#![deny(clippy::undocumented_unsafe_blocks)]

mod controller;

use core::mem::MaybeUninit;

use ferrostep_gcode::{Emergency, meatpack};
use ferrostep_stm32f4::clock_tree::Clock;
use ferrostep_stm32f4_board::board;
use ferrostep_stm32f4_board::identifier::identifier;
use ferrostep_stm32f4_board::pac::RCC;
use ferrostep_stm32f4_board::usb_guard::UsbGuard;
use ferrostep_usb::{Buffers, SerialNumber, UsbSerial};
use heapless::spsc::{Consumer, Producer};
use usb_device::bus::UsbBusAllocator;

use controller::{Bus, PACKET_WORDS};
pub use controller::{NoUsb, Registers};

/// Memory of the port, and of the parts that it refers to. Made in place: on the way through `init`
/// it would be copied several times, and all copies would be on the stack when the first tasks
/// begin. Parts that are not made yet have no value at all: an `Option` would be a kilobyte of
/// initial values in flash.
pub struct Memory {
    packets: [u32; PACKET_WORDS],
    bus: MaybeUninit<UsbBusAllocator<Bus>>,
    serial_number: MaybeUninit<SerialNumber>,
    usb: MaybeUninit<Usb>,
}

impl Memory {
    /// Memory before the start, with no port in it.
    pub const fn new() -> Self {
        Self {
            packets: [0; PACKET_WORDS],
            bus: MaybeUninit::uninit(),
            serial_number: MaybeUninit::uninit(),
            usb: MaybeUninit::uninit(),
        }
    }
}

impl Default for Memory {
    fn default() -> Self {
        Self::new()
    }
}

/// The interrupt's ends of the rings, and its actions for commands that do not wait their turn.
pub struct Rings {
    /// Bytes for the printer.
    pub received: Producer<'static, u8>,
    /// Bytes for the host.
    pub to_send: Consumer<'static, u8>,
    /// M112 and its like.
    pub act: fn(Emergency),
    /// A host has sent a line, which may have to wait its turn.
    pub note_line: fn(),
    /// The host has said how it packs its bytes, and waits for this report.
    pub report_packing: fn(meatpack::Settings),
}

impl Buffers for Rings {
    fn put(&mut self, byte: u8) -> bool {
        self.received.enqueue(byte).is_ok()
    }

    fn take(&mut self) -> Option<u8> {
        self.to_send.dequeue()
    }

    fn emergency(&mut self, emergency: Emergency) {
        (self.act)(emergency);
    }

    fn note_line(&mut self) {
        (self.note_line)();
    }

    fn report_packing(&mut self, settings: meatpack::Settings) {
        (self.report_packing)(settings);
    }
}

/// The port.
pub struct Usb {
    port: UsbSerial<'static, Bus>,
    rings: Rings,
    guard: UsbGuard,
}

/// The result of an interrupt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Served {
    /// Received bytes that were dropped for lack of room.
    pub dropped: u32,
    /// The controller has reported a speed that it does not have, and the port has left
    /// the bus for good.
    pub has_failed: bool,
}

impl Usb {
    /// The port, connected to the bus. To be called in `init`.
    ///
    /// # Errors
    /// The board has no plug, there is no clock for the controller, or it does not answer
    /// in bounded time.
    #[inline(never)]
    pub fn start(
        memory: &'static mut Memory,
        registers: Registers,
        rcc: &RCC,
        clock: &Clock,
        rings: Rings,
    ) -> Result<&'static mut Self, NoUsb> {
        let Memory { packets, bus, serial_number, usb } = memory;
        let (allocator, guard) = controller::start(registers, rcc, clock, packets)?;
        let bus = bus.write(allocator);
        let serial_number = serial_number.write(SerialNumber::of(identifier()));
        Ok(usb.write(Self { port: UsbSerial::new(bus, board::TITLE, serial_number), rings, guard }))
    }

    /// An interrupt's work.
    #[inline(never)]
    pub fn serve(&mut self) -> Served {
        let was_off = self.guard.is_off();
        let dropped = self.port.serve(&mut self.rings, || self.guard.is_sound());
        self.guard.complete();
        Served { dropped, has_failed: self.guard.is_off() && !was_off }
    }
}
