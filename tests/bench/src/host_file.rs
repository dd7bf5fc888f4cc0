//! A file on the machine that runs the emulator, read by semihosting.

use core::ffi::CStr;

use cortex_m_semihosting::{nr, syscall};

/// A file that is open for reading, until the program ends.
pub struct HostFile {
    handle: usize,
}

impl HostFile {
    /// Opens a file, by its name from the emulator's working folder.
    ///
    /// # Errors
    /// The file does not exist.
    pub fn open(name: &CStr) -> Result<Self, &'static str> {
        let length = name.to_bytes().len();
        // SAFETY: address and length are the name's, which ends with a zero, as Arm's semihosting
        // specification asks of SYS_OPEN.
        let handle = unsafe { syscall!(OPEN, name.as_ptr(), nr::open::R_BINARY, length) };
        if handle == usize::MAX { Err("the file to print cannot be opened") } else { Ok(Self { handle }) }
    }

    /// Reads as much as the buffer takes; nothing at the end of the file.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn read<'a>(&mut self, buffer: &'a mut [u8]) -> Result<&'a [u8], &'static str> {
        // SAFETY: address and length are the buffer's, which only SYS_READ uses meanwhile.
        let not_read = unsafe { syscall!(READ, self.handle, buffer.as_mut_ptr(), buffer.len()) };
        let read = buffer.len().checked_sub(not_read).ok_or("the file to print cannot be read")?;
        buffer.get(..read).ok_or("the file to print cannot be read")
    }
}
