//! The card's task, and views of the state shared with the printer task.

use core::cell::RefCell;

pub use ferrostep_card::Mailbox as BoardMailbox;
use ferrostep_card::{CardPort, Mailbox, SharedMailbox};
use ferrostep_printer::{HostLines, HostText};
use ferrostep_stm32f4::clock_tree::Clock;
use ferrostep_stm32f4_board::motion_clock::MotionClock;
use ferrostep_stm32f4_board::pac::SDIO;
use rtic::Mutex;

use crate::host_line::{self, Port, Reader, Writers};
use crate::job_line::Hosts;
use crate::ports::BoardReplies;

/// The card's task.
pub type BoardCard = ferrostep_card::CardServer<ferrostep_stm32f4_board::card::Slot>;

/// Starts the slot; `None` if the board lacks a slot or the clock for it.
pub fn start(sdio: SDIO, clock: &Clock, motion_clock: MotionClock) -> Option<BoardCard> {
    ferrostep_stm32f4_board::card::start(sdio, clock, motion_clock).map(BoardCard::new)
}

/// The mailbox, as shared with the printer task.
pub struct BoardMailboxLock<M>(pub RefCell<M>);

impl<M: Mutex<T = Mailbox>> CardPort for BoardMailboxLock<M> {
    fn with(&self, act: &mut dyn FnMut(&mut Mailbox)) {
        self.0.borrow_mut().lock(|mailbox| act(mailbox));
    }
}

/// The mailbox, as shared with the card's task.
struct TaskMailbox<'a, M>(&'a mut M);

impl<M: Mutex<T = Mailbox>> SharedMailbox for TaskMailbox<'_, M> {
    fn with<T>(&mut self, act: impl FnOnce(&mut Mailbox) -> T) -> T {
        self.0.lock(act)
    }
}

/// Handles one request of the printer and wakes it; `false` if no request is waiting.
pub fn serve(card: &mut Option<BoardCard>, mailbox: &mut impl Mutex<T = BoardMailbox>) -> bool {
    let served = card.as_mut().is_some_and(|card| card.serve(&mut TaskMailbox(mailbox)));
    if served {
        host_line::arrived(0);
    }
    served
}

/// Maximum number of bytes read from a host at once.
const CHUNK_BYTES: usize = 64;

/// The hosts' lines during a print from the card.
pub struct CardHosts<'a, W> {
    reader: &'a mut Reader,
    hosts: &'a mut Hosts,
    replies: &'a BoardReplies<W>,
    chunk: [u8; CHUNK_BYTES],
    port: Port,
    at: usize,
    end: usize,
}

impl<'a, W> CardHosts<'a, W> {
    /// Creates the view of all hosts.
    pub fn new(reader: &'a mut Reader, hosts: &'a mut Hosts, replies: &'a BoardReplies<W>) -> Self {
        Self { reader, hosts, replies, chunk: [0; CHUNK_BYTES], port: Port::Serial, at: 0, end: 0 }
    }
}

impl<W: Mutex<T = Writers>> HostLines for CardHosts<'_, W> {
    fn next(&mut self) -> HostText<'_> {
        if self.at == self.end {
            let (port, taken) = self.reader.take(&mut self.chunk);
            (self.port, self.at, self.end) = (port, 0, taken.len());
            if self.end == 0 {
                return HostText::Nothing;
            }
        }
        let rest = self.chunk.get(self.at..self.end).unwrap_or_default();
        let (used, said) = self.hosts.feed(self.port, rest, self.replies);
        self.at += used.clamp(1, rest.len());
        match said {
            Some((host, line)) => {
                self.replies.answer(self.port);
                HostText::Line(host, line)
            }
            None => HostText::Part,
        }
    }

    fn tell_all(&mut self) {
        self.replies.answer_all();
    }

    async fn wait(&mut self, idle: bool) {
        self.reader.wait(idle).await;
    }
}
