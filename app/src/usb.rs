//! The USB port's interrupt: from packets to the ring that the printer task reads, and back.

use ferrostep_gcode::Emergency;
use ferrostep_hal_shim::clock_tree::Clock;
use ferrostep_stm32f4::pac::RCC;
use ferrostep_stm32f4::usb::{self, Bus, NoUsb, PACKET_WORDS, Registers};
use ferrostep_usb::{Buffers, SerialNumber, UsbSerial};
use heapless::spsc::{Consumer, Producer};
use usb_device::bus::UsbBusAllocator;

use crate::host_line;

/// The board's name, which the host is told.
const PRODUCT: &str = "Ferrostep bench";

/// What lives as long as the program because the device refers to it.
pub struct Memory {
    packets: [u32; PACKET_WORDS],
    bus: Option<UsbBusAllocator<Bus>>,
    serial_number: Option<SerialNumber>,
}

impl Memory {
    /// Nothing yet.
    pub const fn new() -> Self {
        Self { packets: [0; PACKET_WORDS], bus: None, serial_number: None }
    }
}

/// The port.
pub struct Usb {
    port: UsbSerial<'static, Bus>,
    rings: Rings,
}

/// The interrupt's ends of the rings.
pub struct Rings {
    /// Bytes for the printer task.
    pub received: Producer<'static, u8>,
    /// Bytes for the host.
    pub to_send: Consumer<'static, u8>,
    /// What to do about M112 and its like.
    pub act: fn(Emergency),
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
}

impl Usb {
    /// The port, connected to the bus.
    ///
    /// # Errors
    /// See [`NoUsb`].
    pub fn start(
        memory: &'static mut Memory,
        registers: Registers,
        rcc: &RCC,
        clock: &Clock,
        rings: Rings,
    ) -> Result<Self, NoUsb> {
        let Memory { packets, bus, serial_number } = memory;
        let bus = bus.insert(usb::start(registers, rcc, clock, packets)?);
        let serial_number = serial_number.insert(SerialNumber::of(usb::identifier()));
        Ok(Self { port: UsbSerial::new(bus, PRODUCT, serial_number), rings })
    }

    /// An interrupt's work.
    pub fn serve(&mut self) {
        let lost = self.port.serve(&mut self.rings);
        host_line::arrived(lost);
    }
}
