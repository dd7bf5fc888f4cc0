//! The packet memory of the OTG_FS core, RM0090 section 34.11: one receive FIFO, and a transmit
//! FIFO for each endpoint.

use std::collections::VecDeque;

/// Words of packet memory in both cores: 1.25 Kbytes, RM0090 34.2 and RM0390 31.2.
pub const MEMORY_WORDS: u32 = 320;
/// Words of the receive FIFO reserved for SETUP packets: four for each control endpoint
/// and six, 34.11.1.
const SETUP_WORDS: u32 = 10;
/// Words reserved for the global OUT NAK, 34.11.1.
const GLOBAL_NAK_WORDS: u32 = 1;

/// GRXSTSR.PKTSTS of a device, 34.16.2.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Status {
    /// The global OUT NAK has reached the front.
    GlobalOutNak,
    /// An OUT packet.
    Out,
    /// An OUT transfer ended.
    OutComplete,
    /// The SETUP stage ended.
    SetupComplete,
    /// A SETUP packet.
    Setup,
}

impl Status {
    /// The code in GRXSTSR.
    #[must_use]
    pub fn code(self) -> u64 {
        match self {
            Self::GlobalOutNak => 1,
            Self::Out => 2,
            Self::OutComplete => 3,
            Self::SetupComplete => 4,
            Self::Setup => 6,
        }
    }
}

/// An entry of the receive FIFO: a status word and its data.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Entry {
    /// The kind.
    pub status: Status,
    /// The endpoint.
    pub endpoint: u8,
    /// DATA1 rather than DATA0.
    pub toggle: bool,
    /// Low bits of the frame number at reception.
    pub frame: u16,
    /// The data; empty except for packets.
    pub bytes: Vec<u8>,
}

impl Entry {
    fn words(&self) -> u32 {
        1 + words_of(self.bytes.len())
    }
}

/// Number of words that hold this many bytes.
#[must_use]
pub fn words_of(bytes: usize) -> u32 {
    u32::try_from(bytes.div_ceil(4)).unwrap_or(u32::MAX)
}

/// The receive FIFO.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub struct Receive {
    entries: VecDeque<Entry>,
    /// Unread words of the packet whose status was popped last.
    open: VecDeque<u32>,
}

impl Receive {
    /// The entry at the front.
    #[must_use]
    pub fn front(&self) -> Option<&Entry> {
        self.entries.front()
    }

    /// Removes the front entry; its data are read next. The second value is true if words of the
    /// packet before it were left unread, which are lost.
    pub fn pop(&mut self) -> Option<(Entry, bool)> {
        let entry = self.entries.pop_front()?;
        let left_unread = !self.open.is_empty();
        self.open = entry.bytes.chunks(4).map(word).collect();
        Some((entry, left_unread))
    }

    /// The next word of the popped packet.
    pub fn read(&mut self) -> Option<u32> {
        self.open.pop_front()
    }

    /// The word that [`Receive::read`] would return.
    #[must_use]
    pub fn peek(&self) -> Option<u32> {
        self.open.front().copied()
    }

    /// Adds an entry; the caller has checked that it fits.
    pub fn push(&mut self, entry: Entry) {
        self.entries.push_back(entry);
    }

    /// True if an OUT packet of this many bytes fits in a FIFO of `depth` words: with its status
    /// and the entry that ends its transfer, without the words reserved for SETUP packets, the
    /// global NAK and the end entries of `transfers` other endpoints.
    #[must_use]
    pub fn takes_packet(&self, bytes: usize, depth: u32, transfers: u32) -> bool {
        let kept = SETUP_WORDS + GLOBAL_NAK_WORDS + transfers;
        let setup: u32 = self.entries.iter().filter(|entry| entry.status == Status::Setup).map(Entry::words).sum();
        self.used() - setup + 1 + words_of(bytes) + 1 + kept <= depth
    }

    /// True if a SETUP packet fits: three words, and one for its end.
    #[must_use]
    pub fn takes_setup(&self, depth: u32) -> bool {
        self.used() + 4 <= depth
    }

    /// Words in use.
    #[must_use]
    pub fn used(&self) -> u32 {
        let open = u32::try_from(self.open.len()).unwrap_or(u32::MAX);
        self.entries.iter().map(Entry::words).sum::<u32>() + open
    }

    /// Empties the FIFO.
    pub fn flush(&mut self) {
        *self = Self::default();
    }
}

/// A transmit FIFO.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub struct Transmit {
    words: VecDeque<u32>,
}

impl Transmit {
    /// Adds a word to a FIFO of `depth` words; false if the FIFO was full and the word is lost.
    pub fn push(&mut self, value: u32, depth: u32) -> bool {
        let fits = self.used() < depth;
        if fits {
            self.words.push_back(value);
        }
        fits
    }

    /// Copies the first bytes; `None` if fewer are in the FIFO.
    #[must_use]
    pub fn peek_packet(&self, bytes: usize) -> Option<Vec<u8>> {
        if words_of(bytes) > self.used() {
            return None;
        }
        Some(self.words.iter().flat_map(|word| word.to_le_bytes()).take(bytes).collect())
    }

    /// Drops the words of a packet of this many bytes, which the host has acknowledged.
    pub fn drop_packet(&mut self, bytes: usize) {
        self.words.drain(..bytes.div_ceil(4).min(self.words.len()));
    }

    /// Words in use.
    #[must_use]
    pub fn used(&self) -> u32 {
        u32::try_from(self.words.len()).unwrap_or(u32::MAX)
    }

    /// Empties the FIFO.
    pub fn flush(&mut self) {
        self.words.clear();
    }
}

/// Up to four bytes as a word of the FIFO, the first byte lowest.
fn word(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |word, byte| word << 8 | u32::from(*byte))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn packet(length: usize) -> Entry {
        Entry { status: Status::Out, endpoint: 1, toggle: false, frame: 0, bytes: vec![7; length] }
    }

    #[test]
    fn words_carry_the_first_byte_lowest() {
        assert_eq!(word(&[1, 2, 3, 4]), 0x0403_0201);
        assert_eq!(word(&[1, 2]), 0x0201);
    }

    #[test]
    fn a_packet_leaves_room_for_setup_and_endings() {
        // 11 reserved, 2 transfers, status, 16 words, its own end entry.
        let fifo = Receive::default();
        assert!(fifo.takes_packet(64, 31, 2));
        assert!(!fifo.takes_packet(64, 30, 2));
        let mut fifo = fifo;
        fifo.push(Entry { status: Status::Setup, ..packet(8) });
        assert!(fifo.takes_packet(64, 31, 2), "a SETUP packet uses the reserved words");
        fifo.push(packet(0));
        assert!(!fifo.takes_packet(64, 31, 2));
        assert!(fifo.takes_packet(64, 32, 2));
    }

    #[test]
    fn a_packet_in_the_fifo_takes_its_words_until_it_is_read() {
        let mut fifo = Receive::default();
        fifo.push(packet(6));
        assert_eq!(fifo.used(), 3);
        assert!(!fifo.pop().unwrap().1);
        assert_eq!(fifo.used(), 2);
        assert_eq!((fifo.read(), fifo.read(), fifo.read()), (Some(0x0707_0707), Some(0x0707), None));
        assert_eq!(fifo.used(), 0);
    }

    #[test]
    fn words_left_unread_are_reported() {
        let mut fifo = Receive::default();
        fifo.push(packet(8));
        fifo.push(packet(4));
        fifo.pop();
        fifo.read();
        assert!(fifo.pop().unwrap().1);
    }

    #[test]
    fn a_full_transmit_fifo_refuses_words() {
        let mut fifo = Transmit::default();
        assert!(fifo.push(0x0403_0201, 2) && fifo.push(0x0605, 2));
        assert!(!fifo.push(0, 2));
        assert_eq!(fifo.peek_packet(6).unwrap(), [1, 2, 3, 4, 5, 6]);
        assert_eq!(fifo.peek_packet(9), None);
        fifo.drop_packet(6);
        assert_eq!(fifo.used(), 0);
    }
}
