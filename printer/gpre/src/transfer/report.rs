//! The board's lines.

use core::fmt;
use core::fmt::Write;

use crate::checksum::CRC;

/// Subject of a report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Word {
    /// `have`: all bytes before the first number have arrived, those before the second may be sent.
    Have,
    /// `again`: as `have`, and the byte of the first number is missing: the host resumes there.
    Again,
    /// `done`: the job has been executed, to a standstill. The numbers are its
    /// bytes and its frames.
    Done,
    /// `refused`: nothing of the job will be executed; the line before says why. The numbers are
    /// those of `stopped`.
    Refused,
    /// `stopped`: the job ended early, in a standstill on its path; the line before says why. The
    /// numbers are the place in the file and the frame's number.
    Stopped,
    /// `none`: no job is being received.
    None,
}

impl Word {
    const ALL: [(Self, &'static str); 6] = [
        (Self::Have, "have"),
        (Self::Again, "again"),
        (Self::Done, "done"),
        (Self::Refused, "refused"),
        (Self::Stopped, "stopped"),
        (Self::None, "none"),
    ];
}

/// A line from the board about a transfer.
///
/// ```
/// use ferrostep_gpre::transfer::{Report, Word};
///
/// let report = Report { word: Word::Have, numbers: [1280, 2304] };
/// assert_eq!(report.to_string(), "gpre:have 1280 2304 *81cafb60");
/// assert_eq!(Report::parse("gpre:have 1280 2304 *81cafb60"), Some(report));
/// assert_eq!(Report::parse("gpre:have 1281 2304 *81cafb60"), None);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Report {
    /// Subject of the report.
    pub word: Word,
    /// Numbers of the report.
    pub numbers: [u32; 2],
}

impl Report {
    /// Report if no job has been received.
    pub const NONE: Self = Self { word: Word::None, numbers: [0; 2] };

    /// Reads a line; `None` if it is not a report, or was changed in transit.
    pub fn parse(line: &str) -> Option<Self> {
        let (text, sum) = line.trim_end().rsplit_once(" *")?;
        if sum.len() != 8 || u32::from_str_radix(sum, 16).ok()? != CRC.checksum(text.as_bytes()) {
            return None;
        }
        let mut words = text.strip_prefix("gpre:")?.split(' ');
        let name = words.next()?;
        let (word, _) = Word::ALL.into_iter().find(|(_, known)| *known == name)?;
        let mut number = || words.next()?.parse().ok();
        Some(Self { word, numbers: [number()?, number()?] })
    }
}

impl fmt::Display for Report {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = Word::ALL.into_iter().find(|(word, _)| *word == self.word).map_or("", |(_, name)| name);
        let [first, second] = self.numbers;
        let mut summed = Summed { out, digest: CRC.digest() };
        write!(summed, "gpre:{name} {first} {second}")?;
        let sum = summed.digest.finalize();
        write!(out, " *{sum:08x}")
    }
}

/// Passes text on and adds it to the checksum.
struct Summed<'a, 'b> {
    out: &'a mut fmt::Formatter<'b>,
    digest: crc::Digest<'static, u32, crc::Table<1>>,
}

impl Write for Summed<'_, '_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.digest.update(text.as_bytes());
        self.out.write_str(text)
    }
}
