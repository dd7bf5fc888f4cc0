//! The driver's end of the serial line: its reactions to bytes.

use super::Tmc2209;
use super::datagram::{BYTE_BITS, Datagram, Reply};

impl Tmc2209 {
    /// True if the next byte would begin a datagram, so that its sync nibble sets the bit time.
    pub fn expects_sync(&self, start_ns: u64) -> bool {
        self.receiver.expects_sync(start_ns)
    }

    /// Receives a byte whose start bit began at `start_ns`, with bits of this length; returns
    /// the driver's reply.
    pub fn receive_byte(&mut self, start_ns: u64, bit_ns: u64, byte: u8) -> Option<Reply> {
        if !self.listens(start_ns) {
            return None;
        }
        if !self.bit_time_fits(bit_ns) {
            self.receiver.garbled(start_ns + BYTE_BITS * bit_ns);
            return None;
        }
        let now_ns = start_ns + BYTE_BITS * bit_ns;
        match self.receiver.byte(start_ns, bit_ns, byte)? {
            Datagram::Read { node, register } if node == self.node() => {
                let start_ns = now_ns + self.registers.send_delay_bits() * bit_ns;
                let reply = Reply::new(start_ns, bit_ns, register, self.read(now_ns, register));
                self.transmits_until_ns = reply.end_ns();
                Some(reply)
            }
            Datagram::Write { node, register, value } if node == self.node() => {
                self.write(now_ns, register, value);
                None
            }
            _ => None,
        }
    }

    /// Reports activity on the line that is not a byte; the line was busy until `end_ns`.
    pub fn receive_garbled(&mut self, end_ns: u64) {
        if self.listens(end_ns) {
            self.receiver.garbled(end_ns);
        }
    }

    /// Receives another driver's reply. With SENDDELAY of 0 or 1 the driver takes it for a
    /// failed datagram (5.1,
    /// NODECONF: not allowed with several nodes) and needs silence after it;
    /// otherwise it ignores it.
    pub fn overhear(&mut self, reply: &Reply) {
        if self.listens(reply.start_ns) && self.registers.send_delay_bits() < 24 {
            self.receiver.garbled(reply.end_ns());
        }
    }

    /// True if the driver takes part in the line: supplied and not mute.
    pub fn receives(&self) -> bool {
        self.supplied && !self.mute
    }

    fn listens(&self, at_ns: u64) -> bool {
        self.receives() && at_ns >= self.transmits_until_ns
    }

    /// True if a bit has 16 to 2222 clocks: down to 9000 baud with the fastest clock
    /// of 20 MHz (4.1.1).
    fn bit_time_fits(&self, bit_ns: u64) -> bool {
        let clocks = bit_ns * u64::from(self.config.clock_hz) / 1_000_000_000;
        (16..=2222).contains(&clocks)
    }
}
