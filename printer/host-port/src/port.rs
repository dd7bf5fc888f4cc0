//! The device and its port.

use usb_device::bus::{UsbBus, UsbBusAllocator};
use usb_device::device::{StringDescriptors, UsbDevice, UsbDeviceBuilder, UsbDeviceState, UsbRev, UsbVidPid};
use usbd_serial::{CdcAcmClass, USB_CLASS_CDC};

use crate::buffers::Buffers;
use crate::identity::{MANUFACTURER, PRODUCT_ID, SerialNumber, VENDOR_ID};
use crate::incoming::Incoming;
use crate::outgoing::{Outgoing, PACKET_BYTES};

/// Packet size in the controller's type.
const PACKET_SIZE: u16 = PACKET_BYTES as u16;

/// Bytes in a packet of control transfers.
const CONTROL_PACKET_BYTES: u8 = 64;

/// Maximum number of packets taken at a time. A host sends 19 in a millisecond at most (USB
/// 2.0, table 5-9).
const PACKETS_AT_ONCE: u32 = 4;

/// A USB device with one serial port.
///
/// Baud rate, stop bits and parity (`SET_LINE_CODING`) are stored and reported without effect.
/// DTR means that a program has opened the port: when it changes, half a line that was received
/// is dropped, and so is what had not been sent. Some programs never set it; then the first
/// bytes open the port.
pub struct UsbSerial<'a, B: UsbBus> {
    device: UsbDevice<'a, B>,
    class: CdcAcmClass<'a, B>,
    incoming: Incoming,
    outgoing: Outgoing,
    is_configured: bool,
    dtr: bool,
    /// A program has the port open: it has set DTR or sent something.
    is_open: bool,
    /// A program had the port open before. Output before the first program is kept for it.
    was_open: bool,
}

impl<'a, B: UsbBus> UsbSerial<'a, B> {
    /// The device, connected to the bus. Its product string is the board's name.
    pub fn new(bus: &'a UsbBusAllocator<B>, product: &'a str, serial_number: &'a SerialNumber) -> Self {
        let class = CdcAcmClass::new(bus, PACKET_SIZE);
        let strings = StringDescriptors::default()
            .manufacturer(MANUFACTURER)
            .product(product)
            .serial_number(serial_number.as_str());
        let plain = || {
            UsbDeviceBuilder::new(bus, UsbVidPid(VENDOR_ID, PRODUCT_ID))
                .device_class(USB_CLASS_CDC)
                .usb_rev(UsbRev::Usb200)
                .self_powered(true)
        };
        // Neither call fails: one language fits, and 64 is a valid packet size.
        let builder = plain().strings(&[strings]).and_then(|builder| builder.max_packet_size_0(CONTROL_PACKET_BYTES));
        let builder = builder.unwrap_or_else(|_| plain());
        let mut device = builder.build();
        device.set_self_powered(true);
        Self {
            device,
            class,
            incoming: Incoming::new(),
            outgoing: Outgoing::new(),
            is_configured: false,
            dtr: false,
            is_open: false,
            was_open: false,
        }
    }

    /// Handles all pending work: answers the host's requests, takes its packets, sends waiting
    /// output. Call it on the controller's interrupts and when there is something to send. Returns
    /// the number of received bytes dropped.
    ///
    /// `is_sound` is checked each time before the controller's driver is called; once it is false
    /// the driver is left alone.
    pub fn serve(&mut self, buffers: &mut impl Buffers, mut is_sound: impl FnMut() -> bool) -> u32 {
        let mut dropped = 0;
        for _ in 0..PACKETS_AT_ONCE {
            if !is_sound() {
                return dropped;
            }
            let has_event = self.device.poll(&mut [&mut self.class]);
            self.follow(buffers);
            let mut packet = [0; PACKET_BYTES];
            if let Ok(length) = self.class.read_packet(&mut packet) {
                if !self.is_open {
                    self.open(buffers);
                }
                dropped += self.incoming.take_in(packet.get(..length).unwrap_or_default(), buffers);
            }
            if !has_event {
                break;
            }
        }
        if self.is_open && self.device.state() == UsbDeviceState::Configured {
            self.outgoing.send(|| buffers.take(), |packet| self.class.write_packet(packet));
        }
        dropped
    }

    /// Notices that a connection has begun or ended.
    fn follow(&mut self, buffers: &mut impl Buffers) {
        match self.device.state() {
            UsbDeviceState::Default | UsbDeviceState::Addressed if self.is_configured => {
                self.is_configured = false;
                self.dtr = false;
                self.close(buffers, false);
            }
            UsbDeviceState::Configured => self.is_configured = true,
            // A suspended host continues as before, or resets the bus.
            UsbDeviceState::Default | UsbDeviceState::Addressed | UsbDeviceState::Suspend => {}
        }
        let dtr = self.class.dtr();
        match (core::mem::replace(&mut self.dtr, dtr), dtr) {
            (false, true) => self.open(buffers),
            (true, false) => self.close(buffers, true),
            _ => {}
        }
    }

    fn open(&mut self, buffers: &mut impl Buffers) {
        if self.was_open {
            self.close(buffers, true);
        }
        self.is_open = true;
        self.was_open = true;
    }

    fn close(&mut self, buffers: &mut impl Buffers, same_reader: bool) {
        self.is_open = false;
        if self.was_open {
            self.incoming.break_off();
            self.outgoing.discard(|| buffers.take(), same_reader);
        }
    }

    /// True if a host has configured the device.
    pub fn is_configured(&self) -> bool {
        self.is_configured
    }
}
