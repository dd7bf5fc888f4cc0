//! The firmware's side of the port: its rings, and their use by the interrupt and the printer task.

use std::cell::{Cell, RefCell};
use std::fmt::Display;

use ferrostep_gcode::Emergency;
use ferrostep_usb::{Buffers, LineWriter, SerialNumber, UsbSerial};
use heapless::spsc::{Consumer, Producer, Queue};
use usb_device::bus::UsbBusAllocator;

use crate::usb::bus::Bus;
use crate::usb::host::Host;

/// The ring's size in the firmware, each way.
const RING_BYTES: usize = 2048;

/// The product string.
pub const PRODUCT: &str = "bench";

/// The chip's identifier.
pub const IDENTIFIER: [u32; 3] = [0x0030_0041, 0x3436_5110, 0x3032_3532];

/// The device and a host's end of its cable.
pub struct Device {
    bus: Bus,
    port: RefCell<UsbSerial<'static, Bus>>,
    interrupt: RefCell<Interrupt>,
    received: RefCell<Consumer<'static, u8>>,
    writer: RefCell<LineWriter<'static>>,
    dropped: Cell<u32>,
}

/// The interrupt's ends of the rings.
struct Interrupt {
    received: Producer<'static, u8>,
    to_send: Consumer<'static, u8>,
    emergencies: Vec<Emergency>,
}

impl Buffers for Interrupt {
    fn put(&mut self, byte: u8) -> bool {
        self.received.enqueue(byte).is_ok()
    }

    fn take(&mut self) -> Option<u8> {
        self.to_send.dequeue()
    }

    fn emergency(&mut self, emergency: Emergency) {
        self.emergencies.push(emergency);
    }
}

/// Leaks a value, because a device lives until the end of the test.
fn forever<T>(value: T) -> &'static mut T {
    Box::leak(Box::new(value))
}

impl Device {
    /// A device that has just been switched on.
    pub fn new() -> Self {
        let bus = Bus::default();
        let allocator = forever(UsbBusAllocator::new(bus.clone()));
        let serial_number = forever(SerialNumber::of(IDENTIFIER));
        let port = RefCell::new(UsbSerial::new(allocator, PRODUCT, serial_number));
        let (producer, received) = forever(Queue::<u8, RING_BYTES>::new()).split();
        let (to_write, to_send) = forever(Queue::<u8, RING_BYTES>::new()).split();
        Self {
            bus,
            port,
            interrupt: RefCell::new(Interrupt { received: producer, to_send, emergencies: Vec::new() }),
            received: RefCell::new(received),
            writer: RefCell::new(LineWriter::new(to_write)),
            dropped: Cell::new(0),
        }
    }

    /// A host that plugs it in.
    pub fn host(&self) -> Host<'_> {
        Host::new(&self.bus, self)
    }

    /// The controller.
    pub fn bus(&self) -> &Bus {
        &self.bus
    }

    /// Runs the interrupt as often as it has work.
    pub fn interrupt(&self) {
        for _ in 0..4 {
            let dropped = self.port.borrow_mut().serve(&mut *self.interrupt.borrow_mut(), || self.bus.is_sound());
            self.dropped.set(self.dropped.get() + dropped);
        }
    }

    /// Takes what has been received, as bytes of the ring.
    pub fn take_received(&self) -> Vec<u8> {
        let mut received = self.received.borrow_mut();
        std::iter::from_fn(|| received.dequeue()).collect()
    }

    /// Takes the commands that did not wait their turn.
    pub fn take_emergencies(&self) -> Vec<Emergency> {
        std::mem::take(&mut self.interrupt.borrow_mut().emergencies)
    }

    /// Bytes that were received and dropped so far.
    pub fn dropped(&self) -> u32 {
        self.dropped.get()
    }

    /// Returns true if a host has configured the device.
    pub fn is_configured(&self) -> bool {
        self.port.borrow().is_configured()
    }

    /// Sends a line that answers the host.
    pub fn reply(&self, text: impl Display) {
        self.writer.borrow_mut().reply(format_args!("{text}"));
        self.interrupt();
    }

    /// Sends an unsolicited line.
    pub fn report(&self, text: impl Display) {
        self.writer.borrow_mut().report(format_args!("{text}"));
        self.interrupt();
    }
}
