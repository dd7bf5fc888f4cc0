//! How much of the board's memory an image takes.

use std::fmt;

use object::elf::{SHF_ALLOC, SHF_WRITE};
use object::{Object, ObjectSection, SectionFlags, SectionKind};

/// Flash of the STM32F405RG, bytes.
const FLASH_BYTES: u64 = 1024 * 1024;

/// RAM of the STM32F405RG that everything can reach, bytes. Its core-coupled memory is not counted.
const RAM_BYTES: u64 = 128 * 1024;

/// Sizes of an image in bytes, divided as the `size` command does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sizes {
    /// Code and constants: flash only.
    pub text: u64,
    /// Variables with a first value: RAM, and the value in flash.
    pub data: u64,
    /// Variables that begin as zero, or as anything: RAM only.
    pub bss: u64,
}

impl Sizes {
    /// Sizes of the sections of an ELF file that are in memory when it runs.
    ///
    /// # Errors
    /// The reader's error when the bytes are no ELF file.
    pub fn of_elf(bytes: &[u8]) -> Result<Self, object::Error> {
        let file = object::File::parse(bytes)?;
        let mut sizes = Self::default();
        for section in file.sections() {
            let SectionFlags::Elf { sh_flags, .. } = section.flags() else { continue };
            if sh_flags.0 & SHF_ALLOC.0 == 0 {
                continue;
            }
            let total = match section.kind() {
                SectionKind::UninitializedData => &mut sizes.bss,
                _ if sh_flags.0 & SHF_WRITE.0 != 0 => &mut sizes.data,
                _ => &mut sizes.text,
            };
            *total += section.size();
        }
        Ok(sizes)
    }

    /// Bytes of flash.
    pub fn flash(self) -> u64 {
        self.text + self.data
    }

    /// Bytes of RAM; the stack takes what is left.
    pub fn ram(self) -> u64 {
        self.data + self.bss
    }
}

impl fmt::Display for Sizes {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |part: u64, whole: u64| part as f64 * 100.0 / whole as f64;
        let (flash, ram) = (self.flash(), self.ram());
        writeln!(out, "{:>10} {:>10} {:>10} {:>20} {:>20}", "text", "data", "bss", "flash of 1 MiB", "RAM of 128 KiB")?;
        write!(out, "{:>10} {:>10} {:>10}", self.text, self.data, self.bss)?;
        let flash = format!("{flash} ({:.1} %)", percent(flash, FLASH_BYTES));
        write!(out, " {flash:>20} {:>20}", format!("{ram} ({:.1} %)", percent(ram, RAM_BYTES)))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// A 32-bit little-endian ELF file with one section for each (type, flags, size), and a table of names.
    fn elf(sections: &[(u32, u32, u32)]) -> Vec<u8> {
        let mut file = Vec::new();
        file.extend([0x7f, b'E', b'L', b'F', 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        // Type, machine (ARM), version, entry, program headers, section headers, flags.
        file.extend([2_u16, 40].map(u16::to_le_bytes).concat());
        file.extend([1_u32, 0, 0, 52, 0].map(u32::to_le_bytes).concat());
        let names = sections.len() as u16 + 1;
        file.extend([52_u16, 32, 0, 40, names + 1, names].map(u16::to_le_bytes).concat());
        file.extend([0; 40]);
        for &(kind, flags, size) in sections {
            file.extend([0, kind, flags, 0, 0, size, 0, 0, 4, 0].map(u32::to_le_bytes).concat());
        }
        const STRING_TABLE: u32 = 3;
        let contents = file.len() as u32 + 40;
        file.extend([0, STRING_TABLE, 0, 0, contents, 1, 0, 0, 1, 0].map(u32::to_le_bytes).concat());
        // What the sections hold.
        file.extend([0; 64]);
        file
    }

    #[test]
    fn sections_are_sorted_by_where_they_live() {
        const PROGBITS: u32 = 1;
        const NOBITS: u32 = 8;
        const WRITE: u32 = 1;
        const ALLOC: u32 = 2;
        const EXECUTE: u32 = 4;
        let file = elf(&[
            (PROGBITS, ALLOC | EXECUTE, 40),
            (PROGBITS, ALLOC, 8),
            (PROGBITS, ALLOC | WRITE, 16),
            (NOBITS, ALLOC | WRITE, 30_000),
            (PROGBITS, 0, 64),
        ]);
        let sizes = Sizes::of_elf(&file).unwrap();
        assert_eq!(sizes, Sizes { text: 48, data: 16, bss: 30_000 });
        assert_eq!((sizes.flash(), sizes.ram()), (64, 30_016));
    }

    #[test]
    fn what_is_no_image_is_refused() {
        assert!(Sizes::of_elf(b"\x7fELF").is_err());
        assert!(Sizes::of_elf(b"").is_err());
    }

    #[test]
    fn the_table_tells_both_memories() {
        let text = Sizes { text: 104_858, data: 0, bss: 65_536 }.to_string();
        assert!(text.ends_with("104858 (10.0 %)       65536 (50.0 %)"), "{text}");
    }
}
