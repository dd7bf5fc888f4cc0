//! The far end of a serial line, as the run empties and fills it.

use std::collections::VecDeque;

use rigless::chip::Timeline;
use rigless::chip::uart::Peer;
use rigless::store;
use rigless::time::VirtualNanos;

/// What the chip has sent, and what it is to hear and when.
#[derive(Debug, Default, serde::Serialize, serde::Deserialize)]
pub struct Mailbox {
    /// Each word that the chip has sent, with the instant at which its stop bit ended, ns.
    received: VecDeque<(u64, u16)>,
    /// Words for the chip, with the instant from which on they may begin, ns.
    to_send: VecDeque<(u64, u16)>,
    /// Whether transmitter and receiver share one wire: the chip hears itself (RM0090 30.3.10; rigless leaves half-duplex
    /// out, so here the echo of a word begins when the word ends).
    one_wire: bool,
}

store!(Mailbox);

impl Mailbox {
    /// A line of two wires, or of one.
    #[must_use]
    pub fn new(one_wire: bool) -> Self {
        Self { one_wire, ..Self::default() }
    }

    /// Takes what the chip has sent: when each word ended, and the word.
    pub fn take(&mut self) -> impl Iterator<Item = (u64, u16)> + '_ {
        self.received.drain(..)
    }

    /// A word for the chip, not before this instant.
    pub fn send(&mut self, due_ns: u64, word: u16) {
        self.to_send.push_back((due_ns, word));
    }

    /// How many words the chip has not heard yet.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.to_send.len()
    }

    /// Forgets what the chip has not heard yet: the line was cut.
    pub fn cut(&mut self) {
        self.to_send.clear();
    }
}

impl Peer for Mailbox {
    fn receive(&mut self, word: u16, context: &mut Timeline<'_, '_>) {
        let now = context.now().0;
        self.received.push_back((now, word));
        if self.one_wire {
            // Before any answer of a chip on the line.
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
