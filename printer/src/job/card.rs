//! The state of the card: the selected file, its print, the file that is being written.

use ferrostep_card::{CardPort, OpenedFile, Request};

/// The file selected by M23. The card's task keeps its names.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Selected {
    pub(crate) size: u32,
    /// True if its name is that of a prepared job.
    pub(crate) is_prepared: bool,
}

impl From<&OpenedFile> for Selected {
    fn from(file: &OpenedFile) -> Self {
        Self { size: file.size, is_prepared: is_a(file, ".GPR", ".gpre") }
    }
}

/// Returns true if a file has this extension: `short` of its short name (8.3), or `long`
/// of its long one.
pub(crate) fn is_a(file: &OpenedFile, short: &str, long: &str) -> bool {
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

/// Destination of a host's lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Writing {
    /// The lines are executed.
    Not,
    /// The lines go into a file (M28).
    File,
    /// The file of the lines has failed: they are dropped, so that none of them is executed.
    Lost,
    /// The lines go into a file and are executed (M928).
    Log,
}

/// The card as commands see it.
pub(crate) struct Card<'a> {
    /// The card's task; `None` where the board has no slot.
    pub(crate) port: Option<&'a dyn CardPort>,
    pub(crate) selected: Option<Selected>,
    pub(crate) job: Job,
    /// M524 has asked the print to end.
    pub(crate) aborted: bool,
    /// The byte at which the print is to be resumed, and the number of lines before it.
    pub(crate) seek: Option<(u32, u32)>,
    /// Byte at which the next line, or the next frame, begins.
    pub(crate) position: u32,
    pub(crate) writing: Writing,
    /// Number of times that M410 in the file has stopped motion: the print continues then.
    pub(crate) own_stops: u32,
    /// A host has just begun to write.
    pub(crate) begun_writing: bool,
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
            own_stops: 0,
            begun_writing: false,
        }
    }

    /// Notes that M410 in the file has stopped motion: `stops` is 0 or 1.
    pub(crate) fn note_own_stops(&mut self, stops: u32) {
        self.own_stops = self.own_stops.wrapping_add(stops.min(1));
    }

    /// Returns true if the board has a slot.
    pub(crate) fn is_there(&self) -> bool {
        self.port.is_some()
    }

    /// The card's task.
    pub(crate) fn port(&self) -> Option<&'a dyn CardPort> {
        self.port
    }

    /// Returns true if the selected file is a prepared job.
    pub(crate) fn prints_prepared(&self) -> bool {
        self.selected.is_some_and(|selected| selected.is_prepared)
    }

    /// Place at which a paused print resumes: the byte, and the number of lines before it.
    /// `line` was read last.
    pub(crate) fn place(&self, line: u32) -> (u32, u32) {
        self.seek.unwrap_or((self.position, line))
    }

    /// Returns true if a file is selected.
    pub(crate) fn has_selected(&self) -> bool {
        self.selected.is_some()
    }

    /// No file is selected any more.
    pub(crate) fn deselect(&mut self) {
        self.selected = None;
    }

    /// Selects a file, which is open.
    pub(crate) fn select(&mut self, selected: Selected) {
        (self.position, self.seek, self.aborted, self.selected) = (0, None, false, Some(selected));
    }

    /// Returns true if a host's lines go into a file.
    pub(crate) fn is_written(&self) -> bool {
        self.writing != Writing::Not
    }

    /// Sets the place at which an interrupted print is resumed, once the machine is ready for it.
    pub(crate) fn wait_at(&mut self, (offset, lines): (u32, u32)) {
        (self.position, self.seek) = (offset, Some((offset, lines)));
    }

    /// Hands a request to the card's task. A separate function, so that the request does not stay
    /// in the future that waits.
    #[inline(never)]
    pub(crate) fn post(&self, request: Request) -> Option<&'a dyn CardPort> {
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
