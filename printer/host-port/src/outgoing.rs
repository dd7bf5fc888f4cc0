//! Output: packets from lines.

use usb_device::Result;

/// Bytes in a packet: the maximum of a bulk endpoint at full speed (USB 2.0, 5.8.3).
pub const PACKET_BYTES: usize = 64;

/// Sending end.
#[derive(Clone, Debug)]
pub(crate) struct Outgoing {
    /// The next packet.
    packet: [u8; PACKET_BYTES],
    length: usize,
    /// The last packet was a full one: the host waits for more until a shorter one comes
    /// (USB 2.0, 5.8.3).
    is_transfer_open: bool,
    /// The last byte that was taken from the ring.
    last_taken: u8,
    /// Last byte given to the host.
    last_sent: u8,
    /// The rest of a line is being dropped, because its beginning was.
    dropping: bool,
}

impl Outgoing {
    pub const fn new() -> Self {
        Self {
            packet: [0; PACKET_BYTES],
            length: 0,
            is_transfer_open: false,
            last_taken: b'\n',
            last_sent: b'\n',
            dropping: false,
        }
    }

    /// Passes bytes from `take` to the controller while it accepts packets.
    pub fn send(&mut self, mut take: impl FnMut() -> Option<u8>, mut write: impl FnMut(&[u8]) -> Result<usize>) {
        loop {
            self.fill(&mut take);
            if self.length == 0 && !self.is_transfer_open {
                return;
            }
            let packet = self.packet.get(..self.length).unwrap_or_default();
            match write(packet) {
                Ok(_) => {
                    self.is_transfer_open = packet.len() == PACKET_BYTES;
                    self.last_sent = packet.last().copied().unwrap_or(self.last_sent);
                    self.length = 0;
                }
                // The last packet is still in transit, or (any other error) the endpoint does not
                // exist yet. Either state ends with an event that leads here again.
                Err(_) => return,
            }
        }
    }

    fn fill(&mut self, take: &mut impl FnMut() -> Option<u8>) {
        while let Some(place) = self.packet.get_mut(self.length) {
            let Some(byte) = take() else { return };
            self.last_taken = byte;
            if self.dropping {
                self.dropping = byte != b'\n';
                continue;
            }
            *place = byte;
            self.length += 1;
        }
    }

    /// Drops unsent output. The next output starts at the beginning of a line, even for the
    /// previous reader (`same_reader`), which may have received half a line.
    pub fn discard(&mut self, mut take: impl FnMut() -> Option<u8>, same_reader: bool) {
        while let Some(byte) = take() {
            self.last_taken = byte;
        }
        // Another task is writing it.
        self.dropping = self.last_taken != b'\n';
        self.length = 0;
        let owes_line_end = same_reader && self.last_sent != b'\n';
        if !same_reader {
            self.is_transfer_open = false;
            self.last_sent = b'\n';
        }
        if owes_line_end && let Some(place) = self.packet.first_mut() {
            *place = b'\n';
            self.length = 1;
        }
    }
}
