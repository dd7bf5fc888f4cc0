//! The image of a memory card, read from a file or made of a folder's files.

use std::fs;
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};

use fatfs::{Dir, FileSystem, FormatVolumeOptions, FsOptions};

/// The smallest image that is made, bytes: FAT16, as mkfs.fat makes it of this size.
const MIN_BYTES: u64 = 64 << 20;

/// Files that a folder may have in all, bytes: the image is kept in memory.
const MAX_BYTES: u64 = 512 << 20;

/// Folders within each other that the firmware reads (`docs/src/card.md`).
const MAX_DEPTH: usize = 8;

/// A card for the served printer, and the file to which hosts' changes are written back.
#[derive(Debug)]
pub struct CardImage {
    /// The card's bytes.
    pub bytes: Vec<u8>,
    /// The file to which it is written back; `None` for a folder, which is only read.
    pub written_to: Option<PathBuf>,
}

impl CardImage {
    /// Reads an image, whole, or makes one of a folder. Refuses an image that cannot be written
    /// back at the end.
    ///
    /// # Errors
    /// The path cannot be read, or an image not written; the folder's files do not fit.
    pub fn open(path: &Path) -> Result<Self, String> {
        if path.is_dir() {
            let bytes = of_folder(path).map_err(|error| format!("{}: {error}", path.display()))?;
            return Ok(Self { bytes, written_to: None });
        }
        let fail = |error| {
            let path = path.display();
            format!("{path}: {error}; name a folder of files, or make an image with: mkfs.fat -C {path} 65536")
        };
        fs::OpenOptions::new().write(true).open(path).map_err(fail)?;
        Ok(Self { bytes: fs::read(path).map_err(fail)?, written_to: Some(path.to_owned()) })
    }
}

/// A FAT volume with a folder's files and folders, hidden ones left out.
fn of_folder(folder: &Path) -> Result<Vec<u8>, String> {
    let size = size_bytes(folder, 0)?;
    if size > MAX_BYTES {
        let (mib, most) = (size >> 20, MAX_BYTES >> 20);
        return Err(format!("the folder's files have {mib} MiB, expected {most} at most: choose a smaller folder"));
    }
    // Room for clusters that files do not fill, and for what hosts write.
    let length = (2 * size).max(MIN_BYTES).next_multiple_of(512);
    let length = usize::try_from(length).map_err(|error| error.to_string())?;
    let mut image = Cursor::new(vec![0; length]);
    let describe = |error: std::io::Error| format!("the card's image cannot be made: {error}");
    fatfs::format_volume(&mut image, FormatVolumeOptions::new().volume_label(*b"FERROSTEP  ")).map_err(describe)?;
    image.set_position(0);
    let volume = FileSystem::new(&mut image, FsOptions::new()).map_err(describe)?;
    copy(folder, &volume.root_dir())?;
    volume.unmount().map_err(describe)?;
    Ok(image.into_inner())
}

/// The entries of a folder that are put on a card: files and folders that are not hidden, in the
/// order of their names.
fn entries(folder: &Path) -> Result<Vec<(String, PathBuf)>, String> {
    let fail = |error| format!("{}: {error}", folder.display());
    let mut entries = Vec::new();
    for entry in fs::read_dir(folder).map_err(fail)? {
        let path = entry.map_err(fail)?.path();
        let name = path.file_name().and_then(|name| name.to_str());
        let name = name.ok_or_else(|| format!("{}: rename it: a card's names are UTF-8", path.display()))?.to_owned();
        if !name.starts_with('.') && (path.is_dir() || path.is_file()) {
            entries.push((name, path));
        }
    }
    entries.sort();
    Ok(entries)
}

/// Bytes of all files of a folder and its folders.
fn size_bytes(folder: &Path, depth: usize) -> Result<u64, String> {
    if depth > MAX_DEPTH {
        return Err(format!("{}: folders lie deeper than {MAX_DEPTH}, which no list shows", folder.display()));
    }
    let mut size = 0;
    for (_, path) in entries(folder)? {
        size += if path.is_dir() {
            size_bytes(&path, depth + 1)?
        } else {
            path.metadata().map_err(|error| format!("{}: {error}", path.display()))?.len()
        };
    }
    Ok(size)
}

/// Copies a folder's files and folders.
fn copy(from: &Path, to: &Dir<'_, &mut Cursor<Vec<u8>>>) -> Result<(), String> {
    for (name, path) in entries(from)? {
        let fail = |error| format!("{}: {error}", path.display());
        if path.is_dir() {
            copy(&path, &to.create_dir(&name).map_err(fail)?)?;
        } else {
            let bytes = fs::read(&path).map_err(fail)?;
            to.create_file(&name).and_then(|mut file| file.write_all(&bytes)).map_err(fail)?;
        }
    }
    Ok(())
}
