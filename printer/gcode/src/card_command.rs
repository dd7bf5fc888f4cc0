//! Commands for the files on a memory card.

/// M20 to M34, M413, M524, M928, M1000.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CardCommand<'a> {
    /// M20: the list of files.
    List {
        /// L: with long names.
        long: bool,
        /// T: with the time of writing.
        time: bool,
    },
    /// M21: look for the card.
    Mount,
    /// M22: forget it, so that it can be pulled out.
    Release,
    /// M23: the file to be printed.
    Select(&'a str),
    /// M24: prints, or continues; S begins at this byte.
    Start {
        /// S.
        position: Option<u32>,
    },
    /// M25: pause.
    Pause,
    /// M26 S: continues at this byte.
    SetPosition(u32),
    /// M27: how far the print is.
    ReportProgress,
    /// M27 C: the file's name.
    ReportFile,
    /// M27 S: seconds between reports of how far it is, 0 = off.
    AutoReport {
        /// S.
        seconds: u8,
    },
    /// M28: write the lines that follow into this file.
    Write(&'a str),
    /// M29: the file is complete.
    EndWrite,
    /// M30: delete a file.
    Delete(&'a str),
    /// M31: the time of this print so far.
    ReportTime,
    /// M32: select and print.
    SelectAndStart {
        /// Path between `!` and `#`.
        path: &'a str,
        /// S.
        position: Option<u32>,
    },
    /// M33: a path's long names.
    ReportLongPath(&'a str),
    /// M34: sorting, which changes nothing: files are listed as they lie in their folders.
    Sort,
    /// M524: end the print.
    Abort,
    /// M413: whether a print's place is kept on the card against a power cut; without S a query.
    KeepPlace(Option<bool>),
    /// M1000: the interrupted print.
    Interrupted(InterruptedPrint),
    /// M928: write the lines that follow into this file, and execute them.
    Log(&'a str),
}

/// Treatment of a print that a power cut has interrupted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InterruptedPrint {
    /// The interrupted print continues.
    Resume,
    /// S: the printer reports it, and how to continue.
    Report,
    /// C: it is forgotten.
    Discard,
}
