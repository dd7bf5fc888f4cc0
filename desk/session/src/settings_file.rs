//! The memory for a served printer's settings: the sectors of a flash, in a file.

use std::cell::RefCell;
use std::fs;
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

use ferrostep_printer::SettingsMemory;
use ferrostep_settings::{MemoryFlash, NOT_WORKING, Slot, Store, StoreError};

/// Bytes of a sector, and how many there are.
const SECTOR_BYTES: usize = 4096;
const SECTORS: usize = 2;
const BYTES: usize = SECTORS * SECTOR_BYTES;

/// The flash of a printer on the desk, written to its file at each M500.
#[derive(Debug)]
pub struct SettingsFile {
    path: PathBuf,
    store: RefCell<Store<MemoryFlash<Vec<u8>, SECTOR_BYTES>>>,
}

impl SettingsFile {
    /// Reads the file; begins an empty memory if it does not exist yet.
    ///
    /// # Errors
    /// The file cannot be read, is something else, or could not be written later.
    pub fn open(path: &Path) -> Result<Self, String> {
        let fail = |error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
        let bytes = match fs::read(path) {
            Ok(bytes) if bytes.len() == BYTES => bytes,
            Ok(bytes) => {
                let length = bytes.len();
                let rest = "name a file that an earlier --settings has made, or one that does not exist yet";
                return Err(fail(&format_args!("{length} bytes, expected {BYTES}: {rest}")));
            }
            Err(error) if error.kind() == ErrorKind::NotFound => vec![0xff; BYTES],
            Err(error) => return Err(fail(&error)),
        };
        let store = Store::new(MemoryFlash::new(bytes)).map_err(|error| fail(&error))?;
        let memory = Self { path: path.to_owned(), store: RefCell::new(store) };
        memory.write().map_err(|error| fail(&error))?;
        Ok(memory)
    }

    /// Replaces the file by a new one.
    fn write(&self) -> io::Result<()> {
        let folder = self.path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut part = tempfile::NamedTempFile::new_in(folder)?;
        part.write_all(self.store.borrow().flash().bytes())?;
        part.persist(&self.path)?;
        Ok(())
    }
}

impl SettingsMemory for SettingsFile {
    fn load<'s>(&self, slot: &'s mut Slot) -> Result<Option<&'s [u8]>, StoreError> {
        self.store.borrow_mut().load(slot)
    }

    fn save(&self, record: &[u8]) -> Result<(), StoreError> {
        self.store.borrow_mut().save(record)?;
        self.write().map_err(|_| StoreError::Memory(NOT_WORKING))
    }

    fn stalls(&self) -> bool {
        // Most boards stall: commands that work here should also work there.
        true
    }
}
