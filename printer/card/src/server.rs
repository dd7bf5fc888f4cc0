//! The card's task: fulfils the mailbox's requests, reads ahead, writes buffered blocks.

use embedded_sdmmc::{Mode, RawFile};
use ferrostep_hal_shim::card::{Block, BlockDevice, CardSlot};

use crate::failure::CardFailure;
use crate::guard::{Guard, Purpose};
use crate::kept::{KEPT_NAME, KeptFile, Stored, blank, compose, locate};
use crate::listing::{Cursor, LongPath, Page, fill_page, resolve};
use crate::mailbox::{Answer, ListFrom, Mailbox, OpenedFile, Request, SharedMailbox, Stream};
use crate::source::{Source, open};
use crate::tables::{first_cluster, free_chain};
use crate::volume::{Manager, Mounted, NoClock, close, find, mount, open_folder, split_file};

/// First number of embedded-sdmmc's handles.
const FIRST_HANDLE: u32 = 1;
/// Number of further attempts to read a block, each after a new start of the card.
const RETRIES: u32 = 2;

/// The open file.
#[derive(Debug)]
enum Open {
    Nothing,
    Reading(RawFile, Source),
    /// The card failed while this file was read.
    Lost(Source),
    Writing(RawFile),
}

/// Serves a slot.
pub struct CardServer<S: CardSlot> {
    manager: Manager<S>,
    mounted: Option<Mounted>,
    open: Open,
    /// Place at which the list continues.
    cursor: Cursor,
    /// The file that keeps a print's place.
    kept: Option<KeptFile>,
}

impl<S: CardSlot> CardServer<S> {
    /// Server of a slot; no card is mounted yet.
    pub fn new(slot: S) -> Self {
        let manager = Manager::new_with_limits(Guard::new(slot), NoClock, FIRST_HANDLE);
        Self { manager, mounted: None, open: Open::Nothing, cursor: Cursor::new(), kept: None }
    }

    /// Calls `act` with the slot.
    pub fn with_slot<T>(&self, act: impl FnOnce(&S) -> T) -> T {
        self.manager.device(|guard| act(guard.slot()))
    }

    /// Does one task of the mailbox; `false` if the mailbox is empty.
    pub fn serve(&mut self, mailbox: &mut impl SharedMailbox) -> bool {
        if let Some(request) = mailbox.with(Mailbox::take_request) {
            // Failures of reading ahead have already been reported.
            self.manager.device(|guard| guard.take_failed());
            let answer = self.fulfil(request, mailbox);
            let answer = self.checked(answer, mailbox);
            mailbox.with(|mailbox| mailbox.answer(answer));
            return true;
        }
        self.read_ahead(mailbox) || self.keep(mailbox) || self.write_behind(mailbox, false).unwrap_or(true)
    }

    /// Returns the answer, unless a block that it needed could not be read and embedded-sdmmc
    /// continued without it.
    fn checked(
        &mut self,
        answer: Result<Answer, CardFailure>,
        mailbox: &mut impl SharedMailbox,
    ) -> Result<Answer, CardFailure> {
        match (self.manager.device(|guard| guard.take_failed()), answer) {
            (Some(error), Ok(_) | Err(CardFailure::NotFound)) => {
                self.forget();
                self.open = Open::Nothing;
                mailbox.with(|mailbox| {
                    mailbox.begin(Stream::Closed, 0);
                    mailbox.set_opened(None);
                });
                Err(error.into())
            }
            (_, answer) => answer,
        }
    }

    /// The volume, and a budget for a task with it.
    fn mounted(&mut self) -> Result<Mounted, CardFailure> {
        let mounted = self.mounted.ok_or(CardFailure::NotMounted)?;
        self.manager.device(|guard| guard.begin(Purpose::Folders, mounted.budget()));
        Ok(mounted)
    }

    fn fulfil(&mut self, request: Request, mailbox: &mut impl SharedMailbox) -> Result<Answer, CardFailure> {
        match request {
            Request::Mount => {
                self.forget();
                self.mounted = Some(mount(&self.manager)?);
                Ok(Answer::Done)
            }
            Request::Release => {
                let finished = self.finish(mailbox);
                self.keep(mailbox);
                self.forget();
                self.open = Open::Nothing;
                mailbox.with(|mailbox| mailbox.begin(Stream::Closed, 0));
                finished
            }
            Request::List(options, from) => {
                if from == ListFrom::Start {
                    self.cursor = Cursor::new();
                }
                let mounted = self.mounted()?;
                let mut page = Page::new();
                let more = fill_page(&self.manager, &mounted, &mut self.cursor, options, &mut page)?;
                mailbox.with(|mailbox| mailbox.page_mut().clone_from(&page));
                Ok(Answer::Page { more })
            }
            Request::Open(path) => {
                self.close(mailbox);
                let mounted = self.mounted()?;
                let (short, long) = resolve(&self.manager, &mounted, &path)?;
                let (file, size) = open(&self.manager, &mounted, &short)?;
                self.open = Open::Reading(file, Source::new(short.clone(), size));
                mailbox.with(|mailbox| {
                    mailbox.begin(Stream::Reading, 0);
                    mailbox.set_opened(Some(OpenedFile { short, long, size }));
                });
                Ok(Answer::Done)
            }
            Request::Reopen => self.reopen(mailbox),
            Request::BeginKeeping { fresh } => self.begin_keeping(fresh),
            Request::OpenKept => self.open_kept(mailbox),
            Request::Seek(offset) => {
                let (Open::Reading(_, source) | Open::Lost(source)) = &mut self.open else {
                    return Err(CardFailure::NoFile);
                };
                source.seek(offset)?;
                let is_lost = matches!(self.open, Open::Lost(_));
                mailbox.with(|mailbox| {
                    mailbox.begin(Stream::Reading, offset);
                    if is_lost {
                        mailbox.fail(CardFailure::NotMounted);
                    }
                });
                Ok(Answer::Done)
            }
            Request::Close => {
                self.close(mailbox);
                Ok(Answer::Done)
            }
            Request::Create(path) => {
                self.close(mailbox);
                let file = self.create(&path)?;
                self.open = Open::Writing(file);
                mailbox.with(|mailbox| mailbox.begin(Stream::Writing, 0));
                Ok(Answer::Done)
            }
            Request::Finish => self.finish(mailbox),
            Request::Delete(path) => {
                self.delete(&path)?;
                Ok(Answer::Done)
            }
            Request::LongPath(path) => {
                let mounted = self.mounted()?;
                let (_, long) = resolve(&self.manager, &mounted, &path)?;
                mailbox.with(|mailbox| {
                    let page = mailbox.page_mut();
                    page.clear();
                    // A page is longer than any path.
                    let _ = page.push_str(&long);
                });
                Ok(Answer::Page { more: false })
            }
        }
    }

    /// Reads a block of the open file, if there is room for one.
    fn read_ahead(&mut self, mailbox: &mut impl SharedMailbox) -> bool {
        let Open::Reading(file, source) = &mut self.open else { return false };
        if !mailbox.with(|mailbox| mailbox.wants_block()) {
            return false;
        }
        let Some(mounted) = self.mounted else { return false };
        let mut block = [0; Block::LEN];
        self.manager.device(|guard| guard.begin(Purpose::Data, mounted.budget()));
        let mut outcome = source.read(&self.manager, *file, &mut block);
        for _ in 0..RETRIES {
            // Even the same card, inserted again, must be checked first: it may hold another file.
            let may_retry = outcome.is_err() && self.manager.device(|guard| guard.slot().is_still_started());
            if may_retry {
                self.manager.device(|guard| guard.begin(Purpose::Data, mounted.budget()));
                outcome = source.read(&self.manager, *file, &mut block);
            }
        }
        match outcome {
            Ok(length) => {
                let bytes = block.get(..length).unwrap_or_default();
                mailbox.with(|mailbox| mailbox.fill(bytes));
            }
            Err(failure) => {
                self.forget();
                mailbox.with(|mailbox| mailbox.fail(failure));
            }
        }
        true
    }

    /// Writes a block; with `all` also a partial one. Returns `false` without a block to write.
    fn write_behind(&mut self, mailbox: &mut impl SharedMailbox, all: bool) -> Result<bool, CardFailure> {
        let Open::Writing(file) = self.open else { return Ok(false) };
        let mut block = [0; Block::LEN];
        let length = mailbox.with(|mailbox| mailbox.take_block(&mut block, all));
        if length == 0 {
            return Ok(false);
        }
        let mounted = self.mounted()?;
        self.manager.device(|guard| guard.begin(Purpose::Data, mounted.budget()));
        let written = self.manager.write(file, block.get(..length).unwrap_or_default());
        let Err(error) = written else { return Ok(true) };
        let is_full = self.manager.device(|guard| guard.take_passed_end())
            || CardFailure::from(error.clone()) == CardFailure::Full;
        let failure = if is_full { CardFailure::Full } else { error.into() };
        if is_full {
            // The written part keeps its clusters until the file is deleted.
            let _ = self.close_written();
        } else {
            self.give_up();
        }
        mailbox.with(|mailbox| mailbox.fail(failure));
        Err(failure)
    }

    /// Writes buffered blocks and closes the file.
    fn finish(&mut self, mailbox: &mut impl SharedMailbox) -> Result<Answer, CardFailure> {
        while self.write_behind(mailbox, true)? {}
        if matches!(self.open, Open::Writing(_)) {
            mailbox.with(|mailbox| mailbox.begin(Stream::Closed, 0));
        }
        self.close_written()?;
        Ok(Answer::Done)
    }

    /// Closes the file being written.
    fn close_written(&mut self) -> Result<(), CardFailure> {
        let Open::Writing(file) = self.open else { return Ok(()) };
        self.open = Open::Nothing;
        let mounted = self.mounted()?;
        self.manager.device(|guard| guard.begin(Purpose::Folders, mounted.budget()));
        Ok(self.manager.close_file(file)?)
    }

    /// Closes the open file, if any.
    fn close(&mut self, mailbox: &mut impl SharedMailbox) {
        // The file is given up: a failure to close it changes nothing.
        let _ = self.finish(mailbox);
        if let Open::Reading(file, _) = core::mem::replace(&mut self.open, Open::Nothing) {
            let _ = self.manager.close_file(file);
        }
        self.manager.device(|guard| guard.take_failed());
        mailbox.with(|mailbox| {
            mailbox.begin(Stream::Closed, 0);
            mailbox.set_opened(None);
        });
    }

    /// Gives up a file that could not be written, and leaves it unchanged.
    fn give_up(&mut self) {
        if let Open::Writing(file) = self.open {
            self.open = Open::Nothing;
            // A budget of 0 prevents all writes, above all to another card.
            self.manager.device(|guard| guard.begin(Purpose::Data, 0));
            let _ = self.manager.close_file(file);
        }
    }

    /// Forgets the volume without writing to it; a file that was read can be opened again.
    fn forget(&mut self) {
        self.kept = None;
        self.give_up();
        self.manager.device(|guard| guard.begin(Purpose::Data, 0));
        self.open = match core::mem::replace(&mut self.open, Open::Nothing) {
            Open::Reading(file, source) => {
                let _ = self.manager.close_file(file);
                Open::Lost(source)
            }
            other => other,
        };
        if let Some(mounted) = self.mounted.take() {
            let _ = self.manager.close_volume(mounted.volume);
        }
    }

    fn reopen(&mut self, mailbox: &mut impl SharedMailbox) -> Result<Answer, CardFailure> {
        let Open::Lost(source) = &self.open else {
            // The file was never lost.
            return if matches!(self.open, Open::Reading(..)) { Ok(Answer::Done) } else { Err(CardFailure::NoFile) };
        };
        let source = source.clone();
        if self.mounted.is_none() {
            self.mounted = Some(mount(&self.manager)?);
        }
        let mounted = self.mounted()?;
        let file = source.reopen(&self.manager, &mounted)?;
        self.open = Open::Reading(file, source);
        mailbox.with(Mailbox::go_on);
        Ok(Answer::Done)
    }

    /// Writes the pending place of a print; returns `false` if none is pending.
    fn keep(&mut self, mailbox: &mut impl SharedMailbox) -> bool {
        if !mailbox.with(|mailbox| mailbox.is_keeping()) {
            return false;
        }
        let source = match &self.open {
            Open::Reading(_, source) => source.known_identity(),
            Open::Nothing | Open::Lost(_) | Open::Writing(_) => None,
        };
        // If the card was pulled out, the place is kept anew when the print continues.
        let next = self.kept.as_ref().map(KeptFile::next);
        let block = mailbox.with(|mailbox| {
            mailbox.has_taken_kept();
            next.map(|(place, sequence)| (compose(sequence, source, mailbox.kept()), place))
        });
        let Some((block, place)) = block else { return true };
        let written = self.manager.device(|guard| {
            guard.begin(Purpose::Data, 1);
            guard.write(&[block], place)
        });
        match (&mut self.kept, written) {
            (Some(kept), Ok(())) => kept.has_written(),
            // A block that may be damaged is not the one to write next.
            (kept, _) => *kept = None,
        }
        // Reading already reports that the card is gone.
        self.manager.device(|guard| guard.take_failed());
        if let Err(error) = written {
            mailbox.with(|mailbox| mailbox.fail_keeping(error.into()));
        }
        true
    }

    fn begin_keeping(&mut self, fresh: bool) -> Result<Answer, CardFailure> {
        let mounted = self.mounted()?;
        let Open::Reading(file, source) = &mut self.open else { return Err(CardFailure::NoFile) };
        source.identity(&self.manager, *file)?;
        self.manager.device(|guard| guard.begin(Purpose::Folders, mounted.budget()));
        let mut kept = match locate(&self.manager, &mounted) {
            Ok((kept, _)) => kept,
            Err(CardFailure::NotFound | CardFailure::OtherFile) => self.create_kept(&mounted)?,
            Err(failure) => return Err(failure),
        };
        if fresh {
            let (place, sequence) = kept.next();
            self.manager.device(|guard| {
                guard.begin(Purpose::Data, 1);
                guard.write(&[blank(sequence)], place)
            })?;
            kept.has_written();
        }
        self.kept = Some(kept);
        Ok(Answer::Done)
    }

    /// Creates the file with both its blocks, so that no table or folder changes while a
    /// print's place is kept.
    fn create_kept(&mut self, mounted: &Mounted) -> Result<KeptFile, CardFailure> {
        let file = self.create(&LongPath::try_from(KEPT_NAME).map_err(|_| CardFailure::BadName)?)?;
        self.manager.device(|guard| guard.begin(Purpose::Data, mounted.budget()));
        let mut written = Ok(());
        for sequence in 0..2 {
            written = written.and_then(|()| self.manager.write(file, &blank(sequence).contents));
        }
        self.manager.device(|guard| guard.begin(Purpose::Folders, mounted.budget()));
        let closed = self.manager.close_file(file);
        if self.manager.device(|guard| guard.take_passed_end()) {
            return Err(CardFailure::Full);
        }
        written.and(closed)?;
        self.manager.device(|guard| guard.begin(Purpose::Folders, mounted.budget()));
        Ok(locate(&self.manager, mounted)?.0)
    }

    fn open_kept(&mut self, mailbox: &mut impl SharedMailbox) -> Result<Answer, CardFailure> {
        self.close(mailbox);
        let mounted = self.mounted()?;
        let found = locate(&self.manager, &mounted);
        let stored = match found {
            Ok((kept, stored)) => {
                self.kept = Some(kept);
                stored.ok_or(CardFailure::NothingKept)?
            }
            Err(CardFailure::NotFound | CardFailure::OtherFile) => return Err(CardFailure::NothingKept),
            Err(failure) => return Err(failure),
        };
        let Stored { path, size, first_crc, place } = stored;
        mailbox.with(|mailbox| {
            let page = mailbox.page_mut();
            page.clear();
            // A page is longer than any path.
            let _ = page.push_str(&path);
            mailbox.kept_mut().clone_from(&place);
        });
        self.manager.device(|guard| guard.begin(Purpose::Folders, mounted.budget()));
        let (file, found_size) = open(&self.manager, &mounted, &path)?;
        let mut source = Source::new(path.clone(), found_size);
        let identity = source.identity(&self.manager, file);
        if identity != Ok((size, first_crc)) {
            let _ = self.manager.close_file(file);
            return Err(identity.err().unwrap_or(CardFailure::OtherFile));
        }
        self.manager.device(|guard| guard.begin(Purpose::Folders, mounted.budget()));
        let long = resolve(&self.manager, &mounted, &path);
        self.open = Open::Reading(file, source);
        let (short, long) = long?;
        mailbox.with(|mailbox| {
            mailbox.begin(Stream::Reading, 0);
            mailbox.set_opened(Some(OpenedFile { short, long, size }));
        });
        Ok(Answer::Done)
    }

    fn create(&mut self, path: &LongPath) -> Result<RawFile, CardFailure> {
        match self.delete(path) {
            Ok(()) | Err(CardFailure::NotFound) => {}
            Err(failure) => return Err(failure),
        }
        let mounted = self.mounted()?;
        let (parent, name) = split_file(path);
        let folder = open_folder(&self.manager, &mounted, parent)?;
        self.manager.device(|guard| guard.set_purpose(Purpose::Folders));
        let created = if is_short_name(name) {
            self.manager.open_file_in_dir(folder, name, Mode::ReadWriteCreate).map_err(CardFailure::from)
        } else {
            Err(CardFailure::BadName)
        };
        close(&self.manager, folder);
        created
    }

    fn delete(&mut self, path: &LongPath) -> Result<(), CardFailure> {
        let mounted = self.mounted()?;
        let (parent, name) = split_file(path);
        let folder = open_folder(&self.manager, &mounted, parent)?;
        let deleted = find(&self.manager, folder, name).and_then(|entry| {
            if entry.attributes.is_directory() {
                return Err(CardFailure::IsFolder);
            }
            if entry.attributes.is_read_only() {
                return Err(CardFailure::ReadOnly);
            }
            let manager = &self.manager;
            let first =
                manager.device(|guard| first_cluster(guard, &mounted, entry.entry_block, entry.entry_offset))?;
            manager.delete_entry_in_dir(folder, entry.name)?;
            manager.device(|guard| {
                guard.set_purpose(Purpose::Data);
                free_chain(guard, &mounted, first)
            })
        });
        close(&self.manager, folder);
        deleted
    }
}

/// True if a file can be created under this name: embedded-sdmmc writes no long names.
fn is_short_name(name: &str) -> bool {
    !name.starts_with('.') && !name.ends_with('.') && name.is_ascii()
}
