//! What is known of the card: the file that is selected, its print, what is written.

use ferrostep_card::{CardPort, OpenedFile, Request};

/// A file that was selected (M23). Its names stay with the card's task.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Selected {
    pub(super) size: u32,
    /// It is a prepared job, by its name.
    pub(super) is_prepared: bool,
}

impl From<&OpenedFile> for Selected {
    fn from(file: &OpenedFile) -> Self {
        Self { size: file.size, is_prepared: is_a(file, ".GPR", ".gpre") }
    }
}

/// Whether a file's name ends so: that of 8 characters and 3, or the long one.
pub(super) fn is_a(file: &OpenedFile, short: &str, long: &str) -> bool {
    let end = file.long.len().checked_sub(long.len()).and_then(|start| file.long.get(start..));
    file.short.ends_with(short) || end.is_some_and(|end| end.eq_ignore_ascii_case(long))
}

/// What the print is at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Job {
    /// There is none.
    None,
    /// Lines are read and executed.
    Printing,
    /// It waits for M24.
    Paused,
}

/// Where lines of a host go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Writing {
    /// They are executed.
    Not,
    /// Into a file (M28).
    File,
    /// They were to go into a file, which has failed: nowhere, so that none of them is executed.
    Lost,
    /// Into a file, and they are executed (M928).
    Log,
}

/// The card as commands see it.
pub(crate) struct Card<'a> {
    /// The card's task; `None` where the board has no slot.
    pub(super) port: Option<&'a dyn CardPort>,
    pub(super) selected: Option<Selected>,
    pub(crate) job: Job,
    /// The print is to end (M524).
    pub(super) aborted: bool,
    /// The print is to go on at this byte, which begins the line after so many.
    pub(super) seek: Option<(u32, u32)>,
    /// Place of the next line, or of the next frame.
    pub(super) position: u32,
    pub(super) writing: Writing,
    /// A host has just begun to write.
    pub(super) begun_writing: bool,
    /// Since when it prints, ms, and for how long it has before.
    pub(super) since_ms: Option<u64>,
    pub(super) printed_ms: u64,
}

impl<'a> Card<'a> {
    /// A board without a slot.
    pub(crate) const fn none() -> Self {
        Self {
            port: None,
            selected: None,
            job: Job::None,
            aborted: false,
            seek: None,
            position: 0,
            writing: Writing::Not,
            begun_writing: false,
            since_ms: None,
            printed_ms: 0,
        }
    }

    /// Whether the board has a slot.
    pub(crate) fn is_there(&self) -> bool {
        self.port.is_some()
    }

    /// Hands a request over. By itself, so that it does not stay in the memory of whoever waits.
    #[inline(never)]
    pub(super) fn post(&self, request: Request) -> Option<&'a dyn CardPort> {
        let port = self.port?;
        let mut request = Some(request);
        port.with(&mut |mailbox| {
            if let Some(request) = request.take() {
                mailbox.ask(request);
            }
        });
        Some(port)
    }

    pub(super) fn set_job(&mut self, job: Job, now_ms: u64) {
        if let Some(since_ms) = self.since_ms.take() {
            self.printed_ms += now_ms.saturating_sub(since_ms);
        }
        self.since_ms = (job == Job::Printing).then_some(now_ms);
        self.job = job;
    }
}
