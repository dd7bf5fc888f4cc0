//! The list of a card's files, page by page: lines as M20 answers them.

use core::fmt::{self, Write};
use core::ops::ControlFlow;

use embedded_sdmmc::DirEntry;
use ferrostep_hal_shim::card::CardSlot;

use crate::failure::CardFailure;
use crate::short_name::short_name;
use crate::volume::{MAX_DEPTH, Manager, Mounted, close, open_folder, walk};

/// Bytes of a path of short names: eight folders and the file.
pub const SHORT_PATH_BYTES: usize = 13 * (MAX_DEPTH + 1);
/// Bytes of a path of long names.
pub const LONG_PATH_BYTES: usize = 256;
/// Bytes of a page: more than the longest line.
pub const PAGE_BYTES: usize = 512;
/// Maximum number of files in a list: the folders of a damaged card may contain each other.
const MAX_FILES: u16 = 4096;
/// Maximum number of blocks read for a list; a folder of 1000 files with long names takes 12,000,
/// because every page scans it anew.
const MAX_BLOCKS: u32 = 65_536;

/// A path of short names.
pub type ShortPath = heapless::String<SHORT_PATH_BYTES>;
/// A path of long names.
pub type LongPath = heapless::String<LONG_PATH_BYTES>;
/// Lines, each with its line end.
pub type Page = heapless::String<PAGE_BYTES>;

/// Optional fields of a line, besides the path of short names and the size.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ListOptions {
    /// The path of long names.
    pub long: bool,
    /// Include the time at which each file was written.
    pub time: bool,
}

/// Place at which a list continues.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Cursor {
    /// The folder, each name with a slash after it.
    short: ShortPath,
    long: LongPath,
    /// Entries passed in each folder on the path, from the root on.
    passed: heapless::Vec<u16, { MAX_DEPTH + 1 }>,
    files: u16,
    /// Blocks read for the list.
    blocks: u32,
}

/// Result of searching a folder.
// Only one exists at a time, and there is no heap.
#[allow(clippy::large_enum_variant)]
enum Step {
    /// The page is full.
    Full,
    /// A folder is next.
    Enter(ShortPath, LongPath),
    /// The folder has ended.
    End,
    /// The list has reached its maximum number of files.
    Limit,
}

impl Cursor {
    /// Cursor at the beginning.
    pub fn new() -> Self {
        let mut cursor = Self::default();
        // The list has room for nine.
        let _ = cursor.passed.push(0);
        cursor
    }

    fn leave(&mut self) {
        self.passed.pop();
        truncate_last(&mut self.short);
        truncate_last(&mut self.long);
    }
}

/// Removes a path's last name.
fn truncate_last<const N: usize>(path: &mut heapless::String<N>) {
    let parent = path.strip_suffix('/').unwrap_or(path.as_str());
    path.truncate(parent.rfind('/').map_or(0, |slash| slash + 1));
}

/// A folder's or file's own name.
struct Names {
    short: heapless::String<16>,
    long: LongPath,
}

/// A long name, without characters that end a line or control a terminal.
fn clean(out: &mut LongPath, text: &str) -> fmt::Result {
    text.chars().try_for_each(|char| out.write_char(if char.is_control() || char == '/' { '_' } else { char }))
}

/// Names of an entry; `None` if it is not listed: volume names, hidden files and links to parents.
fn names(entry: &DirEntry, long: Option<&str>) -> Option<Names> {
    let mut names = Names { short: short_name(entry), long: LongPath::new() };
    if entry.attributes.is_volume() || entry.attributes.is_hidden() || names.short.starts_with('.') {
        return None;
    }
    // A name that is too long counts as missing.
    let is_long = long.is_some_and(|long| !long.is_empty() && clean(&mut names.long, long).is_ok());
    if !is_long {
        names.long.clear();
        names.long.push_str(&names.short).ok()?;
    }
    // macOS puts such a file beside each file.
    (!names.long.starts_with('.')).then_some(names)
}

/// True if a file may be printed: extensions that begin with a G, as Marlin lists it (GCO, G, GPR
/// of prepared jobs), and BGC.
fn is_job(entry: &DirEntry) -> bool {
    let extension = entry.name.extension();
    matches!(extension.first(), Some(b'G' | b'g')) || extension.eq_ignore_ascii_case(b"BGC")
}

/// A file's line.
fn write_line(
    page: &mut Page,
    (short, long): (&str, &str),
    entry: &DirEntry,
    names: &Names,
    options: ListOptions,
) -> fmt::Result {
    write!(page, "{short}{} {}", names.short, entry.size)?;
    if options.time {
        let [time_low, time_high, date_low, date_high] = entry.mtime.serialize_to_fat();
        write!(page, " 0x{date_high:02X}{date_low:02X}{time_high:02X}{time_low:02X}")?;
    }
    if options.long {
        write!(page, " {long}{}", names.long)?;
    }
    page.write_char('\n')
}

/// Fills a page with the next lines and moves the cursor; `false` if the list ends with this page.
///
/// # Errors
/// The card cannot be read.
pub fn fill_page<S: CardSlot>(
    manager: &Manager<S>,
    mounted: &Mounted,
    cursor: &mut Cursor,
    options: ListOptions,
    page: &mut Page,
) -> Result<bool, CardFailure> {
    page.clear();
    while let Some(depth) = cursor.passed.len().checked_sub(1) {
        let before = manager.device(|guard| guard.budget());
        let step = look(manager, mounted, cursor, options, page);
        let used = before.saturating_sub(manager.device(|guard| guard.budget()));
        cursor.blocks = cursor.blocks.saturating_add(used);
        let step = step?;
        if cursor.blocks >= MAX_BLOCKS {
            return Ok(false);
        }
        match step {
            Step::Limit => return Ok(false),
            Step::Full => return Ok(true),
            Step::Enter(short, long) if depth < MAX_DEPTH => {
                (cursor.short, cursor.long) = (short, long);
                let _ = cursor.passed.push(0);
            }
            Step::Enter(..) => {}
            Step::End => cursor.leave(),
        }
    }
    Ok(false)
}

/// Lists the cursor's folder from its present entry on.
fn look<S: CardSlot>(
    manager: &Manager<S>,
    mounted: &Mounted,
    cursor: &mut Cursor,
    options: ListOptions,
    page: &mut Page,
) -> Result<Step, CardFailure> {
    let folder = open_folder(manager, mounted, &cursor.short)?;
    let (short, long) = (cursor.short.clone(), cursor.long.clone());
    let Some(passed) = cursor.passed.last_mut() else { return Ok(Step::End) };
    let files = &mut cursor.files;
    let mut at = 0_u16;
    let mut step = Step::End;
    let walked = walk(manager, folder, |entry, long_name| {
        at = at.saturating_add(1);
        if at <= *passed {
            return ControlFlow::Continue(());
        }
        if let Some(names) = names(entry, long_name) {
            if entry.attributes.is_directory() {
                let (mut short, mut long) = (short.clone(), long.clone());
                let fits = write!(short, "{}/", names.short).is_ok() && write!(long, "{}/", names.long).is_ok();
                if fits {
                    step = Step::Enter(short, long);
                    *passed = at;
                    return ControlFlow::Break(());
                }
            } else if is_job(entry) {
                let length = page.len();
                if write_line(page, (&short, &long), entry, &names, options).is_err() {
                    page.truncate(length);
                    // A page has room for any line; if one does not fit all the same, the
                    // file is left out.
                    if length > 0 {
                        step = Step::Full;
                        return ControlFlow::Break(());
                    }
                }
                *files = files.saturating_add(1);
            }
        }
        *passed = at;
        if *files >= MAX_FILES {
            step = Step::Limit;
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    });
    close(manager, folder);
    walked?;
    Ok(step)
}

/// A path's short and long form, each from the root with a slash before every name.
///
/// # Errors
/// The file does not exist, or the card cannot be read.
pub fn resolve<S: CardSlot>(
    manager: &Manager<S>,
    mounted: &Mounted,
    path: &str,
) -> Result<(ShortPath, LongPath), CardFailure> {
    let (mut short, mut long) = (ShortPath::new(), LongPath::new());
    for name in crate::volume::parts(path) {
        let folder = open_folder(manager, mounted, &short)?;
        let mut found = None;
        let entry = crate::volume::find(manager, folder, name);
        let walked = entry.and_then(|entry| {
            walk(manager, folder, |other, long_name| {
                if other.entry_block == entry.entry_block && other.entry_offset == entry.entry_offset {
                    found = names(other, long_name);
                    return ControlFlow::Break(());
                }
                ControlFlow::Continue(())
            })
        });
        close(manager, folder);
        walked?;
        let names = found.ok_or(CardFailure::NotFound)?;
        let fits = write!(short, "/{}", names.short).is_ok() && write!(long, "/{}", names.long).is_ok();
        if !fits {
            return Err(CardFailure::BadName);
        }
    }
    Ok((short, long))
}
