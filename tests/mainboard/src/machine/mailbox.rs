//! The far end of a serial line: buffers that the run empties and fills.

use std::collections::VecDeque;

use rigless::chip::Timeline;
use rigless::chip::uart::Peer;
use rigless::store;
use rigless::time::VirtualNanos;

/// Words from the chip, and words for it with their times.
#[derive(Debug, Default, serde::Serialize, serde::Deserialize)]
pub struct Mailbox {
    /// Words from the chip, each with the end of its stop bit, ns.
    received: VecDeque<(u64, u16)>,
    /// Words for the chip, each with the earliest instant at which it may begin, ns.
    to_send: VecDeque<(u64, u16)>,
    /// Transmitter and receiver share one wire, so that the chip receives its own words
    /// (RM0090 30.3.10). rigless has no half-duplex mode: here the echo of a word begins
    /// when the word ends.
    one_wire: bool,
}

store!(Mailbox);

impl Mailbox {
    /// A line of two wires, or of one.
    #[must_use]
    pub fn new(one_wire: bool) -> Self {
        Self { one_wire, ..Self::default() }
    }

    /// Takes the words from the chip: end of each word, ns, and the word.
    pub fn take(&mut self) -> impl Iterator<Item = (u64, u16)> + '_ {
        self.received.drain(..)
    }

    /// Queues a word for the chip, to begin at this instant at the earliest.
    pub fn send(&mut self, due_ns: u64, word: u16) {
        self.to_send.push_back((due_ns, word));
    }

    /// The number of words that the chip has not received yet.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.to_send.len()
    }

    /// Drops all words that the chip has not received yet, as when the line is cut.
    pub fn cut(&mut self) {
        self.to_send.clear();
    }
}

impl Peer for Mailbox {
    fn receive(&mut self, word: u16, context: &mut Timeline<'_, '_>) {
        let now = context.now().0;
        self.received.push_back((now, word));
        if self.one_wire {
            // The echo precedes any answer of another device on the line.
            let place = self.to_send.iter().position(|(due, _)| *due > now).unwrap_or(self.to_send.len());
            self.to_send.insert(place, (now, word));
        }
    }

    fn transmit(&mut self, now: VirtualNanos) -> Option<u16> {
        let (due, word) = *self.to_send.front()?;
        if due > now.0 {
            return None;
        }
        self.to_send.pop_front();
        Some(word)
    }
}
