//! Memory of the board that an image takes.

use std::fmt;

use ferrostep_boards::Board;
use ferrostep_boards::constants::STACK_KIB;
use object::elf::{SHF_ALLOC, SHF_WRITE};
use object::{Object, ObjectSection, SectionFlags, SectionKind};

/// Share of a chip's RAM that an image may use: more than an eighth stays free after the stack,
/// whose depth is measured but not proved.
const RAM_SHARE: (u64, u64) = (17, 20);

/// Ports of the motors' signals for whose step queue that share has room, and the bytes of the
/// queue for each further port: two words in 1024 slots. The size is known when an image is linked,
/// and does not grow while it runs.
const USUAL_PORTS: usize = 2;
const PORT_BYTES: u64 = 2 * 4 * 1024;

/// Bytes of the stack in that share.
const STACK_BYTES: u64 = STACK_KIB as u64 * 1024;

/// Addresses of core-coupled memory.
const CCM: std::ops::Range<u64> = 0x1000_0000..0x1001_0000;

/// The memory that an image may use, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Budget {
    /// Flash after the boot loader, all of it: its contents are known when it is linked, and
    /// nothing grows while it runs.
    pub flash: u64,
    /// RAM with the stack. Core-coupled memory is not counted.
    pub ram: u64,
}

impl Budget {
    /// The budget of a board.
    pub fn of(board: &Board) -> Self {
        let (part, whole) = RAM_SHARE;
        let further_ports = board.motor_ports().len().saturating_sub(USUAL_PORTS) as u64;
        let ram = u64::from(board.ram_kib) * 1024 * part / whole + further_ports * PORT_BYTES;
        Self { flash: u64::from(board.image_room()), ram }
    }
}

/// Sizes of an image in bytes, divided as the `size` command does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sizes {
    /// Code and constants: flash only.
    pub text: u64,
    /// Variables with a first value: RAM, and the value in flash.
    pub data: u64,
    /// Variables that begin as zero, or uninitialised: RAM only.
    pub bss: u64,
    /// Variables in core-coupled memory, uninitialised.
    pub ccm: u64,
}

impl Sizes {
    /// Sizes of the sections of an ELF file that are in memory when it runs.
    ///
    /// # Errors
    /// The reader's error if the bytes are not an ELF file.
    pub fn of_elf(bytes: &[u8]) -> Result<Self, object::Error> {
        let file = object::File::parse(bytes)?;
        let mut sizes = Self::default();
        for section in file.sections() {
            let SectionFlags::Elf { sh_flags, .. } = section.flags() else { continue };
            if sh_flags.0 & SHF_ALLOC.0 == 0 {
                continue;
            }
            let total = match section.kind() {
                _ if CCM.contains(&section.address()) => &mut sizes.ccm,
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

    /// Bytes of RAM, the stack included.
    pub fn ram(self) -> u64 {
        self.data + self.bss + STACK_BYTES
    }

    /// Checks that the image is within its budget.
    ///
    /// # Errors
    /// The image is larger.
    pub fn check(self, budget: Budget) -> Result<(), String> {
        for (what, bytes, most) in [("flash", self.flash(), budget.flash), ("RAM", self.ram(), budget.ram)] {
            if bytes > most {
                return Err(format!("the image takes {bytes} bytes of {what}, expected at most {most}"));
            }
        }
        Ok(())
    }
}

/// The sizes of an image as a row of a table in Markdown.
#[derive(Clone, Copy, Debug)]
pub struct Row<'a> {
    /// The image.
    pub name: &'a str,
    /// Sizes of the image.
    pub sizes: Sizes,
    /// Memory that the image may take.
    pub budget: Budget,
}

impl Row<'_> {
    /// The table's head.
    pub const HEAD: &'static str = "| board | text | data | bss | flash, of the budget | RAM with 23 KiB of stack, of the budget |\n\
                                    |---|---|---|---|---|---|\n";
}

impl fmt::Display for Row<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, sizes, budget } = self;
        // Thousands apart, as in the rest of the book.
        let number = |bytes: u64| {
            if bytes < 1000 { bytes.to_string() } else { format!("{} {:03}", bytes / 1000, bytes % 1000) }
        };
        let share = |bytes: u64, whole: u64| format!("{:.1} %", bytes as f64 * 100.0 / whole as f64);
        write!(
            out,
            "| {name} | {} | {} | {} | {} | {} |",
            number(sizes.text),
            number(sizes.data),
            number(sizes.bss),
            share(sizes.flash(), budget.flash),
            share(sizes.ram(), budget.ram)
        )
    }
}

/// The sizes of an image beside its budget, as a table.
#[derive(Clone, Copy, Debug)]
pub struct Table(pub Sizes, pub Budget);

impl fmt::Display for Table {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(sizes, budget) = self;
        let kib = |bytes: u64| bytes / 1024;
        let of = |bytes: u64, whole: u64| format!("{bytes} ({:.1} %)", bytes as f64 * 100.0 / whole as f64);
        let [text, data, bss, ccm] = ["text", "data", "bss", "CCM"];
        let (flash, ram) = (format!("flash of {} KiB", kib(budget.flash)), format!("RAM of {} KiB", kib(budget.ram)));
        writeln!(out, "{text:>9} {data:>9} {bss:>9} {ccm:>7} {flash:>20} {ram:>20}")?;
        write!(out, "{:>9} {:>9} {:>9} {:>7}", sizes.text, sizes.data, sizes.bss, sizes.ccm)?;
        write!(out, " {:>20} {:>20}", of(sizes.flash(), budget.flash), of(sizes.ram(), budget.ram))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// A 32-bit little-endian ELF file with one section for each (type, flags, address, size), and
    /// a table of names.
    fn elf(sections: &[(u32, u32, u32, u32)]) -> Vec<u8> {
        let mut file = Vec::new();
        file.extend([0x7f, b'E', b'L', b'F', 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        // Type, machine (ARM), version, entry, program headers, section headers, flags.
        file.extend([2_u16, 40].map(u16::to_le_bytes).concat());
        file.extend([1_u32, 0, 0, 52, 0].map(u32::to_le_bytes).concat());
        let names = sections.len() as u16 + 1;
        file.extend([52_u16, 32, 0, 40, names + 1, names].map(u16::to_le_bytes).concat());
        file.extend([0; 40]);
        for &(kind, flags, address, size) in sections {
            file.extend([0, kind, flags, address, 0, size, 0, 0, 4, 0].map(u32::to_le_bytes).concat());
        }
        const STRING_TABLE: u32 = 3;
        let contents = file.len() as u32 + 40;
        file.extend([0, STRING_TABLE, 0, 0, contents, 1, 0, 0, 1, 0].map(u32::to_le_bytes).concat());
        // Contents of the sections.
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
            (PROGBITS, ALLOC | EXECUTE, 0x0800_0000, 40),
            (PROGBITS, ALLOC, 0x0800_0028, 8),
            (PROGBITS, ALLOC | WRITE, 0x2000_4000, 16),
            (NOBITS, ALLOC | WRITE, 0x2000_4010, 30_000),
            (NOBITS, ALLOC | WRITE, 0x1000_0000, 500),
            (PROGBITS, 0, 0, 64),
        ]);
        let sizes = Sizes::of_elf(&file).unwrap();
        assert_eq!(sizes, Sizes { text: 48, data: 16, bss: 30_000, ccm: 500 });
        assert_eq!((sizes.flash(), sizes.ram()), (64, 30_016 + STACK_BYTES));
    }

    #[test]
    fn files_that_are_not_images_are_refused() {
        assert!(Sizes::of_elf(b"\x7fELF").is_err());
        assert!(Sizes::of_elf(b"").is_err());
    }

    #[test]
    fn a_row_has_thousands_apart_and_shares() {
        let sizes = Sizes { text: 355_900, data: 124, bss: 80_972, ccm: 0 };
        let budget = Budget { flash: 838_860, ram: 104_857 };
        let row = Row { name: "bench", sizes, budget }.to_string();
        assert_eq!(row, "| bench | 355 900 | 124 | 80 972 | 42.4 % | 99.8 % |");
    }

    #[test]
    fn the_table_shows_both_memories() {
        let sizes = Sizes { text: 131_072, data: 0, bss: 49_152 - STACK_BYTES, ccm: 64 };
        let text = Table(sizes, Budget { flash: 262_144, ram: 98_304 }).to_string();
        assert!(text.ends_with("     64      131072 (50.0 %)       49152 (50.0 %)"), "{text}");
    }

    #[test]
    fn an_oversized_image_is_refused() {
        let sizes = Sizes { text: 256 * 1024 - 8, data: 8, bss: 98_304 - STACK_BYTES - 8, ccm: 65_536 };
        let budget = Budget { flash: 262_144, ram: 98_304 };
        assert_eq!(sizes.check(budget), Ok(()));
        let refused = |sizes: Sizes| sizes.check(budget).unwrap_err();
        assert!(refused(Sizes { text: sizes.text + 1, ..sizes }).contains("of flash, expected at most 262144"));
        assert!(refused(Sizes { bss: sizes.bss + 1, ..sizes }).contains("of RAM, expected at most 98304"));
    }
}
