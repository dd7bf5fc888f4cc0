//! The volume on a card: mounted with care, folders walked by name.

use core::ops::ControlFlow;

use embedded_sdmmc::{
    DirEntry, Error, LfnBuffer, RawDirectory, RawVolume, TimeSource, Timestamp, VolumeIdx, VolumeManager,
};
use ferrostep_hal_shim::card::{Block, BlockDevice, BlockIdx, CardError, CardSlot};

use crate::boot_sector::{Layout, NoVolume, first_partition, has_exfat_partition};
use crate::failure::CardFailure;
use crate::guard::{Guard, Purpose};
use crate::short_name::short_name;

/// A long name has at most 255 characters of at most 3 bytes.
pub const LONG_NAME_BYTES: usize = 768;
/// Maximum depth of nested folders.
pub const MAX_DEPTH: usize = 8;
/// Blocks of folders that one task may read: 65,536 entries.
const FOLDER_BLOCKS: u32 = 4096;
/// Folders open at once: one, and the next on the path.
const OPEN_FOLDERS: usize = 2;

/// A board has no real-time clock: files get the first day of FAT.
pub struct NoClock;

impl TimeSource for NoClock {
    fn get_timestamp(&self) -> Timestamp {
        Timestamp { year_since_1970: 10, zero_indexed_month: 0, zero_indexed_day: 0, hours: 0, minutes: 0, seconds: 0 }
    }
}

/// Files open at once: the one being printed or written, and briefly the one that keeps its place.
const OPEN_FILES: usize = 2;

/// embedded-sdmmc's volumes.
pub type Manager<S> = VolumeManager<Guard<S>, NoClock, OPEN_FOLDERS, OPEN_FILES, 1>;

/// A mounted volume.
#[derive(Clone, Copy, Debug)]
pub struct Mounted {
    /// embedded-sdmmc's handle.
    pub volume: RawVolume,
    /// Layout of the volume.
    pub layout: Layout,
    /// The block at which the volume begins.
    pub start: u32,
}

impl Mounted {
    /// Blocks that one task may read or write.
    pub fn budget(&self) -> u32 {
        // An allocation scans a whole table twice, and both tables are written.
        self.layout.table_blocks.saturating_mul(4).saturating_add(FOLDER_BLOCKS)
    }
}

/// Mounts the first volume of the card in the slot.
///
/// # Errors
/// The slot is empty, or the card has no readable volume.
pub fn mount<S: CardSlot>(manager: &Manager<S>) -> Result<Mounted, CardFailure> {
    const MOUNT_BLOCKS: u32 = 16;
    if !manager.device(|guard| guard.slot().is_inserted()) {
        return Err(CardFailure::Slot(CardError::Missing));
    }
    let (index, start, layout) = manager.device(|guard| {
        guard.slot().start()?;
        guard.begin(Purpose::Data, MOUNT_BLOCKS);
        guard.open_all();
        let mut block = [Block::new()];
        guard.read(&mut block, BlockIdx(0))?;
        let [first] = &block;
        let blocks = guard.num_blocks()?.0;
        match Layout::read(first, blocks) {
            Ok(layout) => {
                guard.set_whole();
                return Ok((0, 1, layout));
            }
            Err(NoVolume::ExFat) => return Err(CardFailure::ExFat),
            Err(_) => {}
        }
        let Some((index, start)) = first_partition(first) else {
            return Err(if has_exfat_partition(first) { CardFailure::ExFat } else { CardFailure::NoVolume });
        };
        guard.read(&mut block, BlockIdx(start))?;
        let [first] = &block;
        match Layout::read(first, blocks.saturating_sub(start)) {
            Ok(layout) => Ok((index, start, layout)),
            Err(NoVolume::ExFat) => Err(CardFailure::ExFat),
            Err(NoVolume::Foreign | NoVolume::Damaged) => Err(CardFailure::NoVolume),
        }
    })?;
    manager.device(|guard| guard.set_volume(layout.tables_at(start), start.saturating_add(layout.blocks)));
    Ok(Mounted { volume: manager.open_raw_volume(VolumeIdx(index))?, layout, start })
}

/// Opens a folder; the caller closes it ([`close`]).
///
/// # Errors
/// A part of the path is missing or is not a folder.
pub fn open_folder<S: CardSlot>(
    manager: &Manager<S>,
    mounted: &Mounted,
    path: &str,
) -> Result<RawDirectory, CardFailure> {
    let mut folder = manager.open_root_dir(mounted.volume)?;
    for (depth, name) in parts(path).enumerate() {
        let next = if depth < MAX_DEPTH { enter(manager, folder, name) } else { Err(CardFailure::NotFound) };
        close(manager, folder);
        folder = next?;
    }
    Ok(folder)
}

/// The names of a path.
pub fn parts(path: &str) -> impl Iterator<Item = &str> {
    path.split('/').filter(|part| !part.is_empty())
}

/// A path's folder and the name of its file.
pub fn split_file(path: &str) -> (&str, &str) {
    path.rsplit_once('/').unwrap_or(("", path))
}

fn enter<S: CardSlot>(manager: &Manager<S>, folder: RawDirectory, name: &str) -> Result<RawDirectory, CardFailure> {
    let found = find(manager, folder, name)?;
    if !found.attributes.is_directory() {
        return Err(CardFailure::NotFound);
    }
    manager.device(|guard| guard.set_purpose(Purpose::Folders));
    Ok(manager.open_dir(folder, found.name)?)
}

/// Closes a folder.
pub fn close<S: CardSlot>(manager: &Manager<S>, folder: RawDirectory) {
    // The folder is open, so this cannot fail.
    let _ = manager.close_dir(folder);
}

/// Calls `visit` with every entry of a folder and its long name, until it breaks off.
///
/// # Errors
/// The card cannot be read.
pub fn walk<S: CardSlot>(
    manager: &Manager<S>,
    folder: RawDirectory,
    visit: impl FnMut(&DirEntry, Option<&str>) -> ControlFlow<()>,
) -> Result<(), CardFailure> {
    let mut name = [0; LONG_NAME_BYTES];
    manager.device(|guard| guard.set_purpose(Purpose::Names));
    let walked = manager.iterate_dir_lfn(folder, &mut LfnBuffer::new(&mut name), visit);
    // Asking for the device drops the cached block, whose names may have been repaired.
    manager.device(|guard| guard.set_purpose(Purpose::Folders));
    Ok(walked?)
}

/// The entry of a folder with this name, short or long.
///
/// # Errors
/// No entry has the name, or the card cannot be read.
pub fn find<S: CardSlot>(manager: &Manager<S>, folder: RawDirectory, name: &str) -> Result<DirEntry, CardFailure> {
    let mut found = None;
    walk(manager, folder, |entry, long| {
        let is_it = !entry.attributes.is_volume()
            && (short_name(entry).eq_ignore_ascii_case(name)
                || long.is_some_and(|long| !long.is_empty() && equal_ignoring_case(long, name)));
        if is_it {
            found = Some(entry.clone());
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    })?;
    found.ok_or(CardFailure::NotFound)
}

fn equal_ignoring_case(one: &str, other: &str) -> bool {
    one.chars().flat_map(char::to_lowercase).eq(other.chars().flat_map(char::to_lowercase))
}

impl From<Error<CardError>> for CardFailure {
    fn from(error: Error<CardError>) -> Self {
        match error {
            Error::DeviceError(error) => Self::Slot(error),
            Error::NotFound => Self::NotFound,
            Error::FilenameError(_) => Self::BadName,
            Error::ReadOnly => Self::ReadOnly,
            Error::NotEnoughSpace | Error::DiskFull => Self::Full,
            Error::OpenedDirAsFile => Self::IsFolder,
            Error::NoSuchVolume | Error::BadBlockSize(_) => Self::NoVolume,
            _ => Self::Slot(CardError::Damaged),
        }
    }
}
