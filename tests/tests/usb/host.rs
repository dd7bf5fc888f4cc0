//! A host: its requests to a device, and the serial port that it offers to a program.

use crate::usb::bus::{Answer, Bus};
use crate::usb::device::Device;

/// Address that the host gives the device.
const ADDRESS: u8 = 9;

/// Bytes in a packet of the control endpoint, as the device descriptor must say.
pub const CONTROL_BYTES: usize = 64;

/// Bytes in a bulk packet.
pub const PACKET_BYTES: usize = 64;

/// The bulk IN endpoint, as the configuration descriptor must say.
pub const BULK_IN: usize = 2;
/// The bulk OUT endpoint.
pub const BULK_OUT: usize = 1;

/// A refused request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stalled;

/// The host.
pub struct Host<'a> {
    bus: &'a Bus,
    device: &'a Device,
    address: u8,
    /// Bytes of a transfer that has not ended.
    partial: Vec<u8>,
    /// The received part of a line.
    line: String,
}

/// A request's first bytes (USB 2.0, table 9-2).
fn request(kind: u8, request: u8, value: u16, index: u16, length: usize) -> [u8; 8] {
    let ([v0, v1], [i0, i1]) = (value.to_le_bytes(), index.to_le_bytes());
    let [l0, l1] = u16::try_from(length).unwrap().to_le_bytes();
    [kind, request, v0, v1, i0, i1, l0, l1]
}

impl<'a> Host<'a> {
    /// A host that sees the device for the first time.
    pub fn new(bus: &'a Bus, device: &'a Device) -> Self {
        Self { bus, device, address: 0, partial: Vec::new(), line: String::new() }
    }

    /// Resets the bus.
    pub fn reset(&mut self) {
        self.bus.signal_reset();
        self.address = 0;
        self.partial.clear();
        self.line.clear();
        self.device.interrupt();
    }

    /// Sizes of the packets of two endpoints, IN and OUT.
    pub fn packet_sizes(&self, endpoint_in: usize, endpoint_out: usize) -> (usize, usize) {
        self.bus.packet_sizes(endpoint_in, endpoint_out)
    }

    /// Leaves the bus idle.
    pub fn suspend(&self) {
        self.bus.signal_suspend();
        self.device.interrupt();
    }

    /// Wakes the bus.
    pub fn resume(&self) {
        self.bus.signal_resume();
        self.device.interrupt();
    }

    /// Asks again while the device says NAK; a device may not do so endlessly.
    fn insist(&self, mut transaction: impl FnMut() -> Answer) -> Answer {
        for _ in 0..10 {
            let answer = transaction();
            self.device.interrupt();
            if answer != Answer::Nak {
                return answer;
            }
        }
        panic!("the device says NAK for ever");
    }

    /// Makes a request that asks for data.
    pub fn ask(&self, kind: u8, number: u8, value: u16, index: u16, length: usize) -> Result<Vec<u8>, Stalled> {
        assert_eq!(self.setup(request(kind | 0x80, number, value, index, length)), Answer::Ack);
        let mut data = Vec::new();
        loop {
            match self.insist(|| self.bus.read(self.address, 0)) {
                Answer::Data(packet) => {
                    data.extend_from_slice(&packet);
                    assert!(data.len() <= length, "{} bytes where {length} were asked for", data.len());
                    if packet.len() < CONTROL_BYTES || data.len() == length {
                        break;
                    }
                }
                Answer::Stall => return Err(Stalled),
                other => panic!("{other:?} to request {number}"),
            }
        }
        // The status stage.
        assert_eq!(self.insist(|| self.bus.write(self.address, 0, &[])), Answer::Ack);
        Ok(data)
    }

    /// Makes a request with data, or without.
    pub fn tell(&self, kind: u8, number: u8, value: u16, index: u16, data: &[u8]) -> Result<(), Stalled> {
        assert_eq!(self.setup(request(kind, number, value, index, data.len())), Answer::Ack);
        for packet in data.chunks(CONTROL_BYTES) {
            match self.insist(|| self.bus.write(self.address, 0, packet)) {
                Answer::Ack => {}
                Answer::Stall => return Err(Stalled),
                other => panic!("{other:?} to data of request {number}"),
            }
        }
        match self.insist(|| self.bus.read(self.address, 0)) {
            Answer::Data(status) => assert!(status.is_empty(), "status of request {number}: {status:?}"),
            Answer::Stall => return Err(Stalled),
            other => panic!("{other:?} as status of request {number}"),
        }
        Ok(())
    }

    fn setup(&self, bytes: [u8; 8]) -> Answer {
        let answer = self.bus.setup(self.address, bytes);
        self.device.interrupt();
        answer
    }

    /// Makes any request with any data; the outcome does not matter.
    pub fn try_request(&self, [kind, number, low, high]: [u8; 4], index: u16, length: usize) {
        self.setup(request(kind, number, u16::from_le_bytes([low, high]), index, length));
        for _ in 0..length / CONTROL_BYTES + 2 {
            if kind & 0x80 == 0 {
                self.bus.write(self.address, 0, &[0; CONTROL_BYTES][..length.min(CONTROL_BYTES)]);
                self.device.interrupt();
            }
            self.bus.read(self.address, 0);
            self.device.interrupt();
        }
        self.bus.write(self.address, 0, &[]);
        self.device.interrupt();
    }

    /// Reads a descriptor (GET_DESCRIPTOR); `length` is the maximum that is wanted.
    pub fn descriptor(&self, kind: u8, index: u8, length: usize) -> Result<Vec<u8>, Stalled> {
        let language = if kind == 3 && index > 0 { 0x0409 } else { 0 };
        self.ask(0x00, 6, u16::from_be_bytes([kind, index]), language, length)
    }

    /// SET_ADDRESS; from its end on the device has another address.
    pub fn set_address(&mut self) {
        self.tell(0x00, 5, ADDRESS.into(), 0, &[]).unwrap();
        let before = std::mem::replace(&mut self.address, ADDRESS);
        assert_eq!(self.bus.setup(before, request(0x80, 0, 0, 0, 2)), Answer::Silence, "it has its old address");
    }

    /// SET_CONFIGURATION.
    pub fn configure(&self, value: u16) {
        self.tell(0x00, 9, value, 0, &[]).unwrap();
    }

    /// Plugs the device in as a host does.
    pub fn plug_in(&mut self) {
        self.reset();
        self.set_address();
        self.configure(1);
        assert!(self.device.is_configured());
    }

    /// SET_CONTROL_LINE_STATE: a program opens the port or closes it.
    pub fn set_open(&self, is_open: bool) {
        self.tell(0x21, 0x22, if is_open { 0b11 } else { 0 }, 0, &[]).unwrap();
    }

    /// Sends bytes in one packet. Returns whether the device took it.
    pub fn send_packet(&self, packet: &[u8]) -> bool {
        let answer = self.bus.write(self.address, BULK_OUT, packet);
        match answer {
            Answer::Ack => {
                self.device.interrupt();
                true
            }
            Answer::Nak => false,
            other => panic!("{other:?} to bulk data"),
        }
    }

    /// Sends bytes in packets as large as may be.
    pub fn send(&self, bytes: &[u8]) {
        for packet in bytes.chunks(PACKET_BYTES) {
            assert_eq!(self.insist(|| self.bus.write(self.address, BULK_OUT, packet)), Answer::Ack);
        }
    }

    /// A packet of the device, if it has one.
    pub fn read_packet(&self) -> Option<Vec<u8>> {
        match self.bus.read(self.address, BULK_IN) {
            Answer::Data(packet) => {
                self.device.interrupt();
                Some(packet)
            }
            Answer::Nak => None,
            other => panic!("{other:?} to a bulk read"),
        }
    }

    /// Reads as a program does: its driver asks for much more than a packet, and hands on what has
    /// come when a packet is not full.
    pub fn read(&mut self) -> Vec<u8> {
        let mut bytes = Vec::new();
        while let Some(packet) = self.read_packet() {
            self.partial.extend_from_slice(&packet);
            if packet.len() < PACKET_BYTES {
                bytes.append(&mut self.partial);
            }
        }
        bytes
    }

    /// Lines that a program reads, without the empty ones.
    pub fn read_lines(&mut self) -> Vec<String> {
        let text = String::from_utf8(self.read()).unwrap();
        self.line.push_str(&text);
        let Some(end) = self.line.rfind('\n') else { return Vec::new() };
        let rest = self.line.split_off(end + 1);
        let whole = std::mem::replace(&mut self.line, rest);
        whole.lines().filter(|line| !line.is_empty()).map(str::to_owned).collect()
    }
}
