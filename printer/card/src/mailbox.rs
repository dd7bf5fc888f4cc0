//! Requests and answers between printer and card task, and blocks that are read ahead or
//! wait to be written.
//!
//! No call of the printer waits for the card: it asks, and polls for the answer.

use ferrostep_hal_shim::card::Block;

use crate::failure::CardFailure;
use crate::kept::Kept;
use crate::listing::{ListOptions, LongPath, Page, ShortPath};

/// A request of the printer to the card's task.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Request {
    /// Start the card and look for its volume.
    Mount,
    /// Forget the volume, so that the card can be pulled out.
    Release,
    /// The first page of the list of files, and those that follow.
    List(ListOptions, ListFrom),
    /// Open a file to be printed; whatever was open is closed.
    Open(LongPath),
    /// Open the file again after a read failed, and continue with it.
    Reopen,
    /// Continue reading at this byte.
    Seek(u32),
    /// Close the file.
    Close,
    /// Create a file to be written, in place of one that has its name.
    Create(LongPath),
    /// Write what waits and close the file.
    Finish,
    /// Delete a file.
    Delete(LongPath),
    /// The path's long names.
    LongPath(LongPath),
    /// Have a file on the card that keeps the place of the print whose file is open; `fresh`: it
    /// begins, and an older print's place is forgotten.
    BeginKeeping {
        /// The print begins.
        fresh: bool,
    },
    /// Open the file of the print whose place is kept ([`Mailbox::kept`]); the page is its path,
    /// even if it cannot be opened.
    OpenKept,
}

/// Page of a list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ListFrom {
    /// The first.
    Start,
    /// The one after the last that was asked for.
    Next,
}

/// The file that was opened last to be printed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OpenedFile {
    /// Path of short names, with a slash before each.
    pub short: ShortPath,
    /// Path of long names.
    pub long: LongPath,
    /// Length, bytes.
    pub size: u32,
}

/// An answer of the card's task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// The task is done.
    Done,
    /// The mailbox has a page of the list, or the path of long names; whether more pages follow.
    Page {
        /// True if more pages follow.
        more: bool,
    },
}

/// The result of taking bytes of the file that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Taken {
    /// Number of bytes that were read.
    Bytes(usize),
    /// The card's task is at work.
    Wait,
    /// The file has ended.
    End,
    /// Reading failed. Everything read before has been taken.
    Failed(CardFailure),
}

/// The result of putting bytes to be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Put {
    /// Number of bytes that were taken.
    Bytes(usize),
    /// The card's task is at work.
    Wait,
    /// An earlier one could not be written.
    Failed(CardFailure),
}

/// The file that is open, as far as the mailbox knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stream {
    /// No file is open.
    Closed,
    /// Blocks are read ahead.
    Reading,
    /// All was read.
    Ended,
    /// Blocks that are full are written.
    Writing,
    /// The card has failed.
    Failed(CardFailure),
}

/// A block and how much of it is in use.
#[derive(Clone, Debug)]
struct Buffer {
    bytes: [u8; Block::LEN],
    filled: usize,
    taken: usize,
}

impl Buffer {
    const EMPTY: Self = Self { bytes: [0; Block::LEN], filled: 0, taken: 0 };

    fn clear(&mut self) {
        (self.filled, self.taken) = (0, 0);
    }
}

/// The mailbox.
#[derive(Debug)]
pub struct Mailbox {
    request: Option<Request>,
    answer: Option<Result<Answer, CardFailure>>,
    page: Page,
    opened: Option<OpenedFile>,
    stream: Stream,
    /// The one that is used now, then the other.
    buffers: [Buffer; 2],
    /// Place in the file of the next byte to be taken or put.
    position: u32,
    kept: Kept,
    /// The place before [`Self::kept`], if that is not to be relied on yet.
    aside: Kept,
    /// [`Self::kept`] must be written.
    keeps: bool,
    /// The place could not be written.
    keep_failure: Option<CardFailure>,
}

impl Default for Mailbox {
    fn default() -> Self {
        Self::new()
    }
}

impl Mailbox {
    /// An empty mailbox.
    pub const fn new() -> Self {
        Self {
            request: None,
            answer: None,
            page: Page::new(),
            opened: None,
            stream: Stream::Closed,
            buffers: [Buffer::EMPTY; 2],
            position: 0,
            kept: Kept::new(),
            aside: Kept::new(),
            keeps: false,
            keep_failure: None,
        }
    }

    /// Place of a print, as the printer writes it: the one read last, or to be written.
    /// Empty without one.
    pub fn kept(&self) -> &Kept {
        &self.kept
    }

    /// Mutable access to it. It is written with [`Self::keep`] only.
    pub fn kept_mut(&mut self) -> &mut Kept {
        &mut self.kept
    }

    /// Keeps the place aside, before it becomes another that may have to be taken back.
    pub fn set_aside(&mut self) {
        self.aside.clone_from(&self.kept);
    }

    /// Takes back the place that was put aside; `false`: no place was.
    pub fn take_aside(&mut self) -> bool {
        core::mem::swap(&mut self.kept, &mut self.aside);
        self.aside.clear();
        !self.kept.is_empty()
    }

    /// Lets the card's task write the place. It never waits: until then the card
    /// keeps the one before.
    pub fn keep(&mut self) {
        self.keeps = true;
    }

    /// True while a place is still to be written: the next must wait.
    pub fn is_keeping(&self) -> bool {
        self.keeps
    }

    /// Takes why the place could not be written. No other is written until
    /// [`Request::BeginKeeping`].
    pub fn take_keep_failure(&mut self) -> Option<CardFailure> {
        self.keep_failure.take()
    }

    /// Takes note that the card's task writes the place now.
    pub(crate) fn has_taken_kept(&mut self) {
        self.keeps = false;
    }

    /// Takes note that the place could not be written.
    pub(crate) fn fail_keeping(&mut self, failure: CardFailure) {
        self.keep_failure = Some(failure);
    }

    /// Asks the card's task, which has answered everything before.
    pub fn ask(&mut self, request: Request) {
        (self.request, self.answer) = (Some(request), None);
    }

    /// The answer, once it is there.
    pub fn take_answer(&mut self) -> Option<Result<Answer, CardFailure>> {
        self.answer.take()
    }

    /// The file that was opened last to be printed, until another one is or it is closed.
    pub fn opened(&self) -> Option<&OpenedFile> {
        self.opened.as_ref()
    }

    pub(crate) fn set_opened(&mut self, opened: Option<OpenedFile>) {
        self.opened = opened;
    }

    /// The page of the list that was asked for last, or the path of long names.
    pub fn page(&self) -> &str {
        &self.page
    }

    /// Place in the file of the next byte that [`Self::take`] gives.
    pub fn position(&self) -> u32 {
        self.position
    }

    /// Takes bytes of the file that is read, in order.
    pub fn take(&mut self, out: &mut [u8]) -> Taken {
        let [first, second] = &mut self.buffers;
        let rest = first.bytes.get(first.taken..first.filled).unwrap_or_default();
        if rest.is_empty() {
            return match self.stream {
                Stream::Reading => Taken::Wait,
                Stream::Ended => Taken::End,
                Stream::Failed(failure) => Taken::Failed(failure),
                Stream::Closed | Stream::Writing => Taken::Failed(CardFailure::NoFile),
            };
        }
        let length = rest.len().min(out.len());
        out.iter_mut().zip(rest).for_each(|(out, byte)| *out = *byte);
        first.taken += length;
        self.position = self.position.saturating_add(length as u32);
        if first.taken == first.filled {
            first.clear();
            core::mem::swap(first, second);
        }
        Taken::Bytes(length)
    }

    /// Hands over bytes of the file that is written.
    pub fn put(&mut self, bytes: &[u8]) -> Put {
        match self.stream {
            Stream::Writing => {}
            Stream::Failed(failure) => return Put::Failed(failure),
            Stream::Closed | Stream::Reading | Stream::Ended => return Put::Failed(CardFailure::NoFile),
        }
        let [first, second] = &mut self.buffers;
        let buffer = if first.filled < Block::LEN { first } else { second };
        let room = buffer.bytes.get_mut(buffer.filled..).unwrap_or_default();
        let length = room.len().min(bytes.len());
        if length == 0 && !bytes.is_empty() {
            return Put::Wait;
        }
        room.iter_mut().zip(bytes).for_each(|(place, byte)| *place = *byte);
        buffer.filled += length;
        self.position = self.position.saturating_add(length as u32);
        Put::Bytes(length)
    }

    /// True if the card's task has something to do.
    pub fn has_work(&self) -> bool {
        self.request.is_some() || self.wants_block() || self.is_block_full() || self.keeps
    }

    pub(crate) fn take_request(&mut self) -> Option<Request> {
        self.request.take()
    }

    pub(crate) fn answer(&mut self, answer: Result<Answer, CardFailure>) {
        self.answer = Some(answer);
    }

    pub(crate) fn page_mut(&mut self) -> &mut Page {
        &mut self.page
    }

    /// Begins a file at a place; both blocks are empty.
    pub(crate) fn begin(&mut self, stream: Stream, position: u32) {
        self.buffers.iter_mut().for_each(Buffer::clear);
        (self.stream, self.position) = (stream, position);
    }

    /// Continues the file after the bytes that were read.
    pub(crate) fn go_on(&mut self) {
        self.stream = Stream::Reading;
    }

    /// True if there is room for a block that is read.
    pub(crate) fn wants_block(&self) -> bool {
        self.stream == Stream::Reading && self.buffers.iter().any(|buffer| buffer.filled == 0)
    }

    /// Takes over the block that was read; an empty one is the end.
    pub(crate) fn fill(&mut self, block: &[u8]) {
        if self.stream != Stream::Reading {
            return;
        }
        if block.is_empty() {
            self.stream = Stream::Ended;
        }
        if let Some(buffer) = self.buffers.iter_mut().find(|buffer| buffer.filled == 0) {
            buffer.bytes.iter_mut().zip(block).for_each(|(place, byte)| *place = *byte);
            (buffer.filled, buffer.taken) = (block.len().min(Block::LEN), 0);
        }
    }

    /// Notes that the card has failed; the bytes already read stay.
    pub(crate) fn fail(&mut self, failure: CardFailure) {
        self.stream = Stream::Failed(failure);
    }

    fn is_block_full(&self) -> bool {
        let [first, _] = &self.buffers;
        self.stream == Stream::Writing && first.filled == Block::LEN
    }

    /// Copies the block that is to be written next and returns its length. `all`: also one
    /// that is not full.
    pub(crate) fn take_block(&mut self, out: &mut [u8; Block::LEN], all: bool) -> usize {
        let [first, second] = &mut self.buffers;
        if self.stream != Stream::Writing || first.filled < if all { 1 } else { Block::LEN } {
            return 0;
        }
        *out = first.bytes;
        let length = first.filled;
        first.clear();
        core::mem::swap(first, second);
        length
    }
}

/// The printer's access to the mailbox.
pub trait CardPort {
    /// Calls `act` with the mailbox. The card's task continues in between.
    fn with(&self, act: &mut dyn FnMut(&mut Mailbox));
}

/// The card task's access to the mailbox.
pub trait SharedMailbox {
    /// Calls `act` with the mailbox.
    fn with<T>(&mut self, act: impl FnOnce(&mut Mailbox) -> T) -> T;
}

impl SharedMailbox for Mailbox {
    fn with<T>(&mut self, act: impl FnOnce(&mut Mailbox) -> T) -> T {
        act(self)
    }
}
