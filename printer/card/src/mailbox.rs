//! Requests and answers between the printer and the card's task, and blocks that were read ahead or
//! wait to be written.
//!
//! No call of the printer waits for the card: the printer asks, and polls for the answer.

use ferrostep_hal_shim::card::Block;

use crate::failure::CardFailure;
use crate::kept::Kept;
use crate::listing::{ListOptions, LongPath, Page, ShortPath};

/// A request from the printer to the card's task.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Request {
    /// Start the card and look for its volume.
    Mount,
    /// Forget the volume, so that the card can be pulled out.
    Release,
    /// The first page of the list of files, and those that follow.
    List(ListOptions, ListFrom),
    /// Open a file for printing; closes any open file.
    Open(LongPath),
    /// Open the file again after a read failed, and continue with it.
    Reopen,
    /// Continue reading at this byte.
    Seek(u32),
    /// Close the file.
    Close,
    /// Create a file for writing, replacing one of the same name.
    Create(LongPath),
    /// Write buffered data and close the file.
    Finish,
    /// Delete a file.
    Delete(LongPath),
    /// The path's long names.
    LongPath(LongPath),
    /// Prepare a file on the card to keep the place of the print whose file is open; `fresh`: the
    /// print begins, and an older print's place is forgotten.
    BeginKeeping {
        /// The print begins.
        fresh: bool,
    },
    /// Open the file of the print whose place is kept ([`Mailbox::kept`]); the page is its path,
    /// even if the file cannot be opened.
    OpenKept,
}

/// Page of a list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ListFrom {
    /// The first.
    Start,
    /// The page after the last requested one.
    Next,
}

/// The file last opened for printing.
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
    /// The request is done.
    Done,
    /// The mailbox has a page of the list, or the path of long names.
    Page {
        /// True if more pages follow.
        more: bool,
    },
}

/// Result of taking bytes of the file being read.
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

/// Result of putting bytes into the file being written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Put {
    /// Number of bytes that were taken.
    Bytes(usize),
    /// The card's task is at work.
    Wait,
    /// Earlier bytes could not be written.
    Failed(CardFailure),
}

/// State of the open file, as far as the mailbox knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stream {
    /// No file is open.
    Closed,
    /// Blocks are read ahead.
    Reading,
    /// Everything was read.
    Ended,
    /// Full blocks are written.
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
    /// The buffer in use, then the other.
    buffers: [Buffer; 2],
    /// Place in the file of the next byte to be taken or put.
    position: u32,
    kept: Kept,
    /// The previous value of [`Self::kept`], while the present one is not reliable yet.
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

    /// Place of a print, as the printer writes it: the one last read, or to be written. Empty
    /// without one.
    pub fn kept(&self) -> &Kept {
        &self.kept
    }

    /// Mutable access to the place. Only [`Self::keep`] has it written.
    pub fn kept_mut(&mut self) -> &mut Kept {
        &mut self.kept
    }

    /// Saves the place before it becomes another that may have to be taken back.
    pub fn set_aside(&mut self) {
        self.aside.clone_from(&self.kept);
    }

    /// Restores the saved place; `false` if none was saved.
    pub fn take_aside(&mut self) -> bool {
        core::mem::swap(&mut self.kept, &mut self.aside);
        self.aside.clear();
        !self.kept.is_empty()
    }

    /// Asks the card's task to write the place. Never waits: until then the card keeps the previous
    /// one.
    pub fn keep(&mut self) {
        self.keeps = true;
    }

    /// True while a place is still to be written; the next must wait.
    pub fn is_keeping(&self) -> bool {
        self.keeps
    }

    /// Takes the reason why the place could not be written. No other place is written until
    /// [`Request::BeginKeeping`].
    pub fn take_keep_failure(&mut self) -> Option<CardFailure> {
        self.keep_failure.take()
    }

    /// Notes that the card's task is writing the place now.
    pub(crate) fn has_taken_kept(&mut self) {
        self.keeps = false;
    }

    /// Notes that the place could not be written.
    pub(crate) fn fail_keeping(&mut self, failure: CardFailure) {
        self.keep_failure = Some(failure);
    }

    /// Sends a request to the card's task, which must have answered every earlier one.
    pub fn ask(&mut self, request: Request) {
        (self.request, self.answer) = (Some(request), None);
    }

    /// Takes the answer, once it is there.
    pub fn take_answer(&mut self) -> Option<Result<Answer, CardFailure>> {
        self.answer.take()
    }

    /// The file last opened for printing, until another one is opened or it is closed.
    pub fn opened(&self) -> Option<&OpenedFile> {
        self.opened.as_ref()
    }

    pub(crate) fn set_opened(&mut self, opened: Option<OpenedFile>) {
        self.opened = opened;
    }

    /// The last requested page of the list, or the path of long names.
    pub fn page(&self) -> &str {
        &self.page
    }

    /// Place in the file of the next byte that [`Self::take`] returns.
    pub fn position(&self) -> u32 {
        self.position
    }

    /// Takes bytes of the file being read, in order.
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

    /// Adds bytes to the file being written.
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

    /// True if the card's task has work.
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

    /// Starts a file at a place; both buffers are empty.
    pub(crate) fn begin(&mut self, stream: Stream, position: u32) {
        self.buffers.iter_mut().for_each(Buffer::clear);
        (self.stream, self.position) = (stream, position);
    }

    /// Continues the file after the bytes that were read.
    pub(crate) fn go_on(&mut self) {
        self.stream = Stream::Reading;
    }

    /// True if there is room to read another block.
    pub(crate) fn wants_block(&self) -> bool {
        self.stream == Stream::Reading && self.buffers.iter().any(|buffer| buffer.filled == 0)
    }

    /// Takes a block that was read; an empty one marks the end of the file.
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

    /// Copies the next block to be written and returns its length. `all`: even one that is not
    /// full.
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
