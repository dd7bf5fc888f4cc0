//! Faults of a file and their places.

use core::fmt;

/// A fault of a file.
// R4.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The file does not begin as a GPRE file does.
    Magic,
    /// The file was written by a newer version of the tools.
    NewerVersion {
        /// The file's version.
        version: u16,
        /// The newest version that this reader supports.
        newest: u16,
    },
    /// The file is in an encoding that does not exist.
    Encoding {
        /// Number of the encoding.
        number: u8,
    },
    /// The file is in the wide encoding, which only the desktop tool and the bench image read.
    Wide,
    /// The file was prepared for another machine, or for other settings of this one.
    OtherProfile {
        /// Hash in the file.
        file: u64,
        /// Hash of the machine.
        machine: u64,
    },
    /// The file was planned by another version of the planner, whose rules may differ.
    OtherPlanner {
        /// Version in the file.
        file: u32,
        /// Version of the machine's planner.
        machine: u32,
    },
    /// The file ends in the middle of a part.
    Truncated,
    /// Bytes follow the last frame.
    Trailing,
    /// A frame does not begin with its mark.
    NoFrame,
    /// A frame or header has an impossible length.
    Length {
        /// The stated length, bytes.
        length: u32,
    },
    /// The checksum is wrong: bits have changed.
    Checksum {
        /// Checksum in the file.
        file: u32,
        /// Checksum computed from the bytes.
        computed: u32,
    },
    /// The frames are out of order.
    Sequence {
        /// Number in the file.
        number: u32,
        /// The number expected.
        expected: u32,
    },
    /// The content of a frame is invalid; the text says what was expected.
    Content(&'static str),
}

/// Remedy for a file with wrong bytes.
const AGAIN: &str = ": copy the file, or prepare the job, again";

impl fmt::Display for Fault {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Magic => write!(out, "not a prepared job: its first bytes are not those of GPRE"),
            Self::NewerVersion { version, newest } => {
                write!(out, "written in version {version} of the format, expected at most {newest}")
            }
            Self::Encoding { number } => write!(out, "encoding {number} is unknown, expected 1 (compact) or 2 (wide)"),
            Self::Wide => write!(
                out,
                "in the wide encoding (the packets of Yu 2019), which a printer does not execute: prepare the job with \
                 `ferrostep preprocess --format compact`"
            ),
            Self::OtherProfile { file, machine } => write!(
                out,
                "prepared for another machine (profile {file:016x}), expected this one's profile {machine:016x}: \
                 prepare the job again for this machine"
            ),
            Self::OtherPlanner { file, machine } => write!(
                out,
                "planned by version {file} of the planner, expected version {machine}: prepare the job again"
            ),
            Self::Truncated => write!(out, "the file is cut short{AGAIN}"),
            Self::Trailing => write!(out, "bytes follow the last frame{AGAIN}"),
            Self::NoFrame => write!(out, "damaged: no frame begins here{AGAIN}"),
            Self::Length { length } => write!(out, "damaged: no part of a file has {length} bytes{AGAIN}"),
            Self::Checksum { file, computed } => {
                write!(out, "damaged: its checksum is {file:08x}, that of its bytes {computed:08x}{AGAIN}")
            }
            Self::Sequence { number, expected } => {
                write!(out, "frames out of order: this is number {number}, expected number {expected}{AGAIN}")
            }
            Self::Content(expected) => write!(out, "unreadable content, expected {expected}{AGAIN}"),
        }
    }
}

/// A fault and where it was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReadError {
    /// The fault.
    pub fault: Fault,
    /// Offset of the faulty part in the file, bytes.
    pub offset: u64,
    /// Number of the frame, from 0; `None` before the first.
    pub frame: Option<u32>,
}

impl fmt::Display for ReadError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.frame {
            Some(frame) => write!(out, "frame {frame} at byte {}: {}", self.offset, self.fault),
            None => write!(out, "at byte {}: {}", self.offset, self.fault),
        }
    }
}

impl core::error::Error for ReadError {}
