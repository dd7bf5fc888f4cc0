//! An image in the formats of boot loaders and programmers: the bytes of flash, plain
//! or as Intel HEX.

use std::fs;
use std::path::{Path, PathBuf};

use ferrostep_boards::Board;
use ihex::Record;
use object::LittleEndian;
use object::elf::PT_LOAD;
use object::read::elf::{ElfFile32, ProgramHeader};

pub use xtask::images::{IMAGES_VARIABLE, images};

use crate::bbf;
use crate::steps::Failure;

/// Bytes a line of Intel HEX, as programmers write it.
const HEX_BYTES: usize = 16;

/// The contents of flash from an address on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Flash {
    /// The first byte's address.
    pub address: u32,
    /// All bytes; 0xff between the parts, which is what erased flash reads.
    pub bytes: Vec<u8>,
}

impl Flash {
    /// The flash of an ELF file: its segments where they are loaded, which for variables is
    /// not where they run.
    ///
    /// # Errors
    /// The file is not such an ELF file, or has no bytes for flash.
    pub fn of_elf(elf: &[u8]) -> Result<Self, Failure> {
        let shown = |error: object::Error| format!("the image cannot be read: {error}");
        let file = ElfFile32::<LittleEndian>::parse(elf).map_err(shown)?;
        let mut parts = Vec::new();
        for header in file.elf_program_headers() {
            let bytes = header.data(LittleEndian, elf).map_err(|()| "a segment lies outside the image")?;
            if header.p_type(LittleEndian) == PT_LOAD && !bytes.is_empty() {
                parts.push((header.p_paddr(LittleEndian), bytes));
            }
        }
        parts.sort_by_key(|(address, _)| *address);
        let Some((address, _)) = parts.first().copied() else { return Err("the image holds nothing".to_owned()) };
        let mut flash = Self { address, bytes: Vec::new() };
        for (part, bytes) in parts {
            let offset = (part - address) as usize;
            if offset < flash.bytes.len() || offset > 1 << 24 {
                return Err(format!("a segment at {part:#x} overlaps another, or lies far away"));
            }
            flash.bytes.resize(offset, 0xff);
            flash.bytes.extend_from_slice(bytes);
        }
        Ok(flash)
    }

    /// Returns the image as Intel HEX.
    ///
    /// # Errors
    /// An address beyond 32 bits.
    pub fn hex(&self) -> Result<String, Failure> {
        let mut records = Vec::new();
        let mut upper = None;
        for (index, bytes) in self.bytes.chunks(HEX_BYTES).enumerate() {
            let address = self.address + (index * HEX_BYTES) as u32;
            let (high, low) = ((address >> 16) as u16, address as u16);
            if upper.replace(high) != Some(high) {
                records.push(Record::ExtendedLinearAddress(high));
            }
            records.push(Record::Data { offset: low, value: bytes.to_vec() });
        }
        records.push(Record::EndOfFile);
        ihex::create_object_file_representation(&records).map_err(|error| format!("Intel HEX: {error}"))
    }

    /// Checks that it begins where the board's boot loader starts it, and fits the flash.
    ///
    /// # Errors
    /// The image begins elsewhere, or is too long.
    pub fn check(&self, board: &Board) -> Result<(), Failure> {
        let end = u64::from(board.image_address()) + u64::from(board.image_room());
        let wanted = board.image_address();
        if self.address != wanted {
            return Err(format!("the image begins at {:#x}, the board {} wants {wanted:#x}", self.address, board.name));
        }
        if u64::from(self.address) + self.bytes.len() as u64 > end {
            return Err(format!(
                "the image ends beyond the flash that the board {} has for it: settings keep {} bytes at its end",
                board.name,
                board.settings_bytes()
            ));
        }
        Ok(())
    }
}

/// The folder of a board's image. An image with another offset has a separate folder, so that
/// neither is flashed instead of the other.
pub fn folder_of(board: &Board, is_elsewhere: bool) -> PathBuf {
    let place = if is_elsewhere { format!("-at-{:#010x}", board.image_address()) } else { String::new() };
    images().join(format!("{}{place}", board.name))
}

/// Writes an image's files into a folder: `ferrostep.elf`, `ferrostep.hex`, the plain bytes, and
/// Prusa's container if the boot loader takes it. The plain bytes have the name that the boot
/// loader wants, `ferrostep.bin` if it wants none of them. Returns the path of the first.
///
/// # Errors
/// The ELF file is not an image for this board, or a file cannot be written.
pub fn export(elf: &Path, board: &Board, folder: &Path) -> Result<PathBuf, Failure> {
    let bytes = fs::read(elf).map_err(|error| format!("{}: {error}", elf.display()))?;
    let flash = Flash::of_elf(&bytes).map_err(|error| format!("{}: {error}", elf.display()))?;
    flash.check(board)?;
    // A file of an earlier build under another name could be flashed by mistake.
    if folder.exists() {
        fs::remove_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    }
    fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.join(name);
        fs::write(&path, bytes).map_err(|error| format!("{}: {error}", path.display()))?;
        Ok::<_, Failure>(path)
    };
    write("ferrostep.hex", flash.hex()?.as_bytes())?;
    if board.takes_bbf() {
        let name = board.boot_file.as_deref().unwrap_or_default();
        write(name, &bbf::pack(&flash.bytes, env!("CARGO_PKG_VERSION"))?)?;
    }
    let plain = board.boot_file.as_deref().filter(|_| !board.takes_bbf());
    write(plain.unwrap_or("ferrostep.bin"), &flash.bytes)?;
    write("ferrostep.elf", &bytes)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// A 32-bit little-endian ELF file with a loaded segment for each (run at, loaded at, bytes).
    fn elf(segments: &[(u32, u32, &[u8])]) -> Vec<u8> {
        let mut file = vec![0x7f, b'E', b'L', b'F', 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        file.extend([2_u16, 40].map(u16::to_le_bytes).concat());
        file.extend([1_u32, 0, 52, 0, 0].map(u32::to_le_bytes).concat());
        file.extend([52_u16, 32, segments.len() as u16, 40, 0, 0].map(u16::to_le_bytes).concat());
        let mut offset = 52 + 32 * segments.len() as u32;
        for (run, load, bytes) in segments {
            let length = bytes.len() as u32;
            file.extend([1, offset, *run, *load, length, length, 4, 4].map(u32::to_le_bytes).concat());
            offset += length;
        }
        segments.iter().for_each(|(.., bytes)| file.extend_from_slice(bytes));
        file
    }

    #[test]
    fn segments_are_where_they_are_loaded() {
        let file = elf(&[(0x2000_0000, 0x0800_8006, &[7, 8]), (0x0800_8000, 0x0800_8000, &[1, 2, 3]), (0, 0, &[])]);
        let flash = Flash::of_elf(&file).unwrap();
        assert_eq!(flash, Flash { address: 0x0800_8000, bytes: vec![1, 2, 3, 0xff, 0xff, 0xff, 7, 8] });
        assert!(Flash::of_elf(&elf(&[])).is_err());
        assert!(Flash::of_elf(b"\x7fELF").is_err());
        assert!(Flash::of_elf(&elf(&[(0, 0, &[1, 2]), (1, 1, &[3])])).is_err());
        assert!(Flash::of_elf(&elf(&[(0, 0, &[1]), (0, 0x8000_0000, &[3])])).is_err());
    }

    #[test]
    fn hex_reads_back_as_the_same_bytes() {
        let bytes: Vec<u8> = (0..40_u8).collect();
        let flash = Flash { address: 0x0800_fff0, bytes: bytes.clone() };
        let mut read = Vec::new();
        let mut upper = 0_u32;
        for record in ihex::Reader::new(&flash.hex().unwrap()) {
            match record.unwrap() {
                Record::ExtendedLinearAddress(high) => upper = u32::from(high) << 16,
                Record::Data { offset, value } => {
                    assert_eq!(upper + u32::from(offset), 0x0800_fff0 + read.len() as u32);
                    read.extend(value);
                }
                Record::EndOfFile => {}
                other => panic!("{other:?}"),
            }
        }
        assert_eq!(read, bytes);
    }

    #[test]
    fn an_image_for_another_place_is_refused() {
        let octopus = ferrostep_boards::load("btt-octopus-1.1").unwrap();
        let at = |address, bytes: usize| Flash { address, bytes: vec![0; bytes] }.check(&octopus);
        assert_eq!(at(0x0800_8000, 4), Ok(()));
        assert!(at(0x0800_0000, 4).unwrap_err().contains("wants 0x8008000"));
        assert!(at(0x0800_8000, 0x78001).unwrap_err().contains("beyond the flash"));
    }

    #[test]
    fn an_image_in_a_boot_loaders_place_has_a_folder_of_its_own() {
        let buddy = ferrostep_boards::load("prusa-buddy").unwrap();
        assert!(folder_of(&buddy, false).ends_with("images/prusa-buddy"));
        let instead = buddy.at_boot_offset(0).unwrap();
        assert!(folder_of(&instead, true).ends_with("images/prusa-buddy-at-0x08000000"));
        // All of the flash is the image's without a boot loader, up to the sectors of the settings.
        let flash = |address, bytes: usize| Flash { address, bytes: vec![0; bytes] };
        assert_eq!(flash(0x0800_0000, 0xc_0000).check(&instead), Ok(()));
        let longer = flash(0x0800_0000, 0xc_0001).check(&instead).unwrap_err();
        assert!(longer.contains("settings keep 262144 bytes at its end"), "{longer}");
        assert!(flash(0x0802_0200, 4).check(&instead).unwrap_err().contains("wants 0x8000000"));
    }
}
