//! The state of the card: the selected file, its print, the file that is being written.

use ferrostep_card::{CardPort, OpenedFile, Request};

/// The file selected by M23. The card's task keeps its names.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Selected {
    pub(super) size: u32,
    /// Whether its name is that of a prepared job.
    pub(super) is_prepared: bool,
}

impl From<&OpenedFile> for Selected {
    fn from(file: &OpenedFile) -> Self {
        Self { size: file.size, is_prepared: is_a(file, ".GPR", ".gpre") }
    }
}

/// Whether a file has this extension: `short` of its short name (8.3), or `long` of its long one.
pub(super) fn is_a(file: &OpenedFile, short: &str, long: &str) -> bool {
    let end = file.long.len().checked_sub(long.len()).and_then(|start| file.long.get(start..));
    file.short.ends_with(short) || end.is_some_and(|end| end.eq_ignore_ascii_case(long))
}

/// The state of the print.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Job {
    /// No print.
    None,
    /// Lines are read and executed.
    Printing,
    /// The print waits for M24.
    Paused,
}

/// What becomes of the lines of a host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Writing {
    /// They are executed.
    Not,
    /// They go into a file (M28).
    File,
    /// Their file has failed: they are dropped, so that none of them is executed.
    Lost,
    /// They go into a file and are executed (M928).
    Log,
}

/// The card as commands see it.
pub(crate) struct Card<'a> {
    /// The card's task; `None` where the board has no slot.
    pub(super) port: Option<&'a dyn CardPort>,
    pub(super) selected: Option<Selected>,
    pub(crate) job: Job,
    /// M524 has asked the print to end.
    pub(super) aborted: bool,
    /// The byte at which the print is to go on, and the number of lines before it.
    pub(super) seek: Option<(u32, u32)>,
    /// Byte at which the next line, or the next frame, begins.
    pub(super) position: u32,
    pub(super) writing: Writing,
    /// A host has just begun to write.
    pub(super) begun_writing: bool,
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
        }
    }

    /// Whether the board has a slot.
    pub(crate) fn is_there(&self) -> bool {
        self.port.is_some()
    }

    /// Hands a request to the card's task. A function of its own, so that the request does not stay in the future that waits.
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
}
