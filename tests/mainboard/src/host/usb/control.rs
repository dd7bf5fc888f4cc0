//! A control transfer on the host's side, USB 2.0 section 8.5.3.

use super::bus::{Answer, Kind};

/// Maximum attempts at a transaction without an answer, USB 2.0 section 8.7.
pub const ATTEMPTS: u8 = 3;

/// The end of a control transfer.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Outcome {
    /// Success, with the bytes from the device; empty for a request without.
    Done(Vec<u8>),
    /// The device refused the request.
    Stalled,
    /// The device answered none of three attempts.
    Unanswered,
    /// The device broke the protocol.
    Broken(String),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
enum Stage {
    Setup,
    Data,
    Status,
}

/// A control transfer in progress.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Control {
    setup: [u8; 8],
    /// Bytes for the device, or those received so far.
    data: Vec<u8>,
    /// Bytes of `data` that the device has accepted.
    sent: usize,
    stage: Stage,
    toggle: bool,
    attempts: u8,
    packet: usize,
    /// A packet arrived twice.
    pub repeated: bool,
}

impl Control {
    /// A request with packets of this size at endpoint 0; `data` goes to the device, empty for the
    /// other direction.
    #[must_use]
    pub fn new(setup: [u8; 8], data: Vec<u8>, packet: u8) -> Self {
        let packet = usize::from(packet);
        Self { setup, data, sent: 0, stage: Stage::Setup, toggle: true, attempts: 0, packet, repeated: false }
    }

    /// The request's eight bytes.
    #[must_use]
    pub fn setup(&self) -> [u8; 8] {
        self.setup
    }

    fn to_host(&self) -> bool {
        self.setup[0] & 0x80 != 0
    }

    fn length(&self) -> usize {
        u16::from_le_bytes([self.setup[6], self.setup[7]]).into()
    }

    /// The bytes of the next OUT packet.
    fn next_out(&self) -> &[u8] {
        let end = self.data.len().min(self.sent + self.packet);
        &self.data[self.sent..end]
    }

    /// The next transaction. Without `acknowledged` the host's handshake to an IN packet is lost.
    #[must_use]
    pub fn next(&self, acknowledged: bool) -> Kind<'_> {
        match (self.stage, self.to_host()) {
            (Stage::Setup, _) => Kind::Setup(self.setup),
            (Stage::Data, true) | (Stage::Status, false) => Kind::In { acknowledged },
            (Stage::Data, false) => Kind::Out { toggle: self.toggle, data: self.next_out() },
            (Stage::Status, true) => Kind::Out { toggle: true, data: &[] },
        }
    }

    /// Processes the answer to that transaction; `Some` ends the transfer.
    pub fn take(&mut self, answer: Answer) -> Option<Outcome> {
        match answer {
            Answer::Silence => {
                self.attempts += 1;
                return (self.attempts >= ATTEMPTS).then_some(Outcome::Unanswered);
            }
            Answer::Stall if self.stage != Stage::Setup => return Some(Outcome::Stalled),
            Answer::Nak if self.stage != Stage::Setup => {
                self.attempts = 0;
                return None;
            }
            _ => self.attempts = 0,
        }
        match (self.stage, answer) {
            (Stage::Setup, Answer::Ack) => {
                self.stage = if self.length() == 0 { Stage::Status } else { Stage::Data };
                self.toggle = true;
                None
            }
            (Stage::Data, Answer::Data { toggle, bytes }) if self.to_host() => self.receive(toggle, &bytes),
            (Stage::Data, Answer::Ack) if !self.to_host() => {
                self.sent += self.next_out().len();
                self.toggle = !self.toggle;
                if self.sent == self.data.len() {
                    self.stage = Stage::Status;
                }
                None
            }
            (Stage::Status, Answer::Ack) if self.to_host() => Some(Outcome::Done(std::mem::take(&mut self.data))),
            (Stage::Status, Answer::Data { toggle: true, bytes }) if !self.to_host() && bytes.is_empty() => {
                Some(Outcome::Done(Vec::new()))
            }
            (stage, answer) => Some(Outcome::Broken(format!("{answer:?} in the stage {stage:?}"))),
        }
    }

    fn receive(&mut self, toggle: bool, bytes: &[u8]) -> Option<Outcome> {
        if toggle != self.toggle {
            self.repeated = true;
            return None;
        }
        self.toggle = !toggle;
        self.data.extend_from_slice(bytes);
        if bytes.len() > self.packet || self.data.len() > self.length() {
            return Some(Outcome::Broken(format!(
                "{} bytes received, {} requested, in packets of {}",
                self.data.len(),
                self.length(),
                self.packet
            )));
        }
        if bytes.len() < self.packet || self.data.len() == self.length() {
            self.stage = Stage::Status;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn data(toggle: bool, bytes: &[u8]) -> Answer {
        Answer::Data { toggle, bytes: bytes.to_vec() }
    }

    #[test]
    fn a_read_ends_with_a_short_packet() {
        let mut control = Control::new([0x80, 6, 0, 1, 0, 0, 18, 0], Vec::new(), 8);
        assert_eq!(control.next(true), Kind::Setup([0x80, 6, 0, 1, 0, 0, 18, 0]));
        assert_eq!(control.take(Answer::Ack), None);
        assert_eq!(control.next(true), Kind::In { acknowledged: true });
        assert_eq!(control.take(Answer::Nak), None);
        assert_eq!(control.take(data(true, &[1; 8])), None);
        assert_eq!(control.take(data(true, &[1; 8])), None, "the packet arrived twice");
        assert!(control.repeated);
        assert_eq!(control.take(data(false, &[2; 3])), None);
        assert_eq!(control.next(true), Kind::Out { toggle: true, data: &[] });
        assert_eq!(control.take(Answer::Ack), Some(Outcome::Done([&[1; 8][..], &[2; 3]].concat())));
    }

    #[test]
    fn a_read_ends_with_the_requested_bytes() {
        let mut control = Control::new([0x80, 6, 0, 1, 0, 0, 16, 0], Vec::new(), 8);
        control.take(Answer::Ack);
        control.take(data(true, &[1; 8]));
        assert_eq!(control.next(true), Kind::In { acknowledged: true });
        control.take(data(false, &[1; 8]));
        assert_eq!(control.next(true), Kind::Out { toggle: true, data: &[] });
    }

    #[test]
    fn a_write_sends_its_bytes_and_reads_the_status() {
        let mut control = Control::new([0x21, 0x20, 0, 0, 0, 0, 7, 0], vec![1, 2, 3, 4, 5, 6, 7], 4);
        control.take(Answer::Ack);
        assert_eq!(control.next(true), Kind::Out { toggle: true, data: &[1, 2, 3, 4] });
        control.take(Answer::Ack);
        assert_eq!(control.next(true), Kind::Out { toggle: false, data: &[5, 6, 7] });
        control.take(Answer::Ack);
        assert_eq!(control.next(true), Kind::In { acknowledged: true });
        assert_eq!(control.take(data(true, &[])), Some(Outcome::Done(Vec::new())));
    }

    #[test]
    fn failures_end_a_transfer() {
        let request = || Control::new([0, 9, 1, 0, 0, 0, 0, 0], Vec::new(), 64);
        let mut control = request();
        assert_eq!((control.take(Answer::Silence), control.take(Answer::Silence)), (None, None));
        assert_eq!(control.take(Answer::Silence), Some(Outcome::Unanswered));
        let mut control = request();
        assert!(matches!(control.take(Answer::Stall), Some(Outcome::Broken(_))), "a SETUP cannot be stalled");
        let mut control = request();
        control.take(Answer::Ack);
        assert_eq!(control.take(Answer::Stall), Some(Outcome::Stalled));
        let mut control = request();
        control.take(Answer::Ack);
        assert!(matches!(control.take(data(false, &[])), Some(Outcome::Broken(_))), "the status is DATA1");
        let mut control = Control::new([0x80, 6, 0, 1, 0, 0, 8, 0], Vec::new(), 64);
        control.take(Answer::Ack);
        assert!(matches!(control.take(data(true, &[0; 9])), Some(Outcome::Broken(_))), "more than requested");
    }
}
