//! Checks whether an image fits a board: its addresses, stack pointer and first instruction.
//!
//! Sources: the ELF format (Tool Interface Standard, version 1.2: ELF header, program header); the
//! memory maps of RM0090 (2.3) and RM0390 (2.2.2); the vector table of PM0214 (2.3.4).

use super::board::Board;
use super::refusal::Refusal;

/// Start of flash.
const FLASH: u64 = 0x0800_0000;
/// Start of SRAM.
const RAM: u64 = 0x2000_0000;
/// Start of core coupled memory.
const CCM: u64 = 0x1000_0000;
/// A program header's kind for bytes to load.
const LOAD: u32 = 1;
/// ELF's number for 32-bit ARM.
const ARM: u16 = 40;

/// Addresses of an image that fits its board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Image {
    /// The address of the vector table, the image's first byte in flash.
    pub start: u32,
    /// The address after the image's last byte in flash.
    pub end: u32,
    /// The stack pointer at reset.
    pub stack_pointer: u32,
    /// The address of the first instruction.
    pub entry: u32,
}

/// Checks that an image (ELF) can run on a board; `file` is its name in errors.
///
/// # Errors
/// The file is not an ELF file for a 32-bit ARM chip, starts at another address than the board's
/// boot loader jumps to, exceeds the board's memories, or its stack pointer or first instruction
/// is outside them.
pub fn check_image(board: &Board, file: &str, elf: &[u8]) -> Result<Image, Refusal> {
    let refuse = |key: &str, problem: String, mend: &str| Refusal::new(file, key, problem, mend);
    let short = || {
        let mend = "build the image again: `cargo xtask firmware --board NAME`";
        refuse("", "is truncated: its headers point past its end".to_owned(), mend)
    };
    if elf.get(..6) != Some(b"\x7fELF\x01\x01".as_slice()) || half(elf, 18) != Some(ARM) {
        let mend = "pass the .elf file, not the .bin or .bbf";
        return Err(refuse("", "is not an ELF file for a 32-bit ARM chip".to_owned(), mend));
    }
    let segments = segments(elf).ok_or_else(short)?;
    let flash_end = FLASH + u64::from(board.flash_bytes);
    let start = FLASH + u64::from(board.boot_offset);
    let rebuild = format!("build it for this board: `cargo xtask firmware --board {}`", board.name);

    let stored = || segments.iter().filter(|segment| !segment.bytes.is_empty());
    let Some(first) = stored().min_by_key(|segment| segment.load_at) else {
        return Err(refuse("", "is empty: it has no segment to load into flash".to_owned(), &rebuild));
    };
    if first.load_at != start {
        let problem =
            format!("starts at {:#x}, but the boot loader of {} jumps to {start:#x}", first.load_at, board.name);
        return Err(refuse("boot_offset", problem, &rebuild));
    }
    let end = stored().map(Segment::load_end).max().unwrap_or(start);
    if end > flash_end {
        let problem = format!("ends at {end:#x}, past the end of the flash of {} at {flash_end:#x}", board.name);
        return Err(refuse("flash_kib", problem, &rebuild));
    }
    let memories =
        [(FLASH, flash_end), (RAM, RAM + u64::from(board.ram_bytes)), (CCM, CCM + u64::from(board.ccm_bytes))];
    for segment in &segments {
        let (from, to) = (segment.runs_at, segment.runs_at + segment.memory);
        if segment.memory > 0 && !memories.iter().any(|(start, end)| (*start..=*end).contains(&from) && to <= *end) {
            let problem = format!("uses {from:#x} to {to:#x}, where {} has no memory", board.name);
            return Err(refuse("ram_kib", problem, &rebuild));
        }
    }
    let stack_pointer = word(first.bytes, 0).ok_or_else(short)?;
    let reset = word(first.bytes, 4).ok_or_else(short)?;
    let pointer = u64::from(stack_pointer);
    if !memories[1..].iter().any(|(start, end)| pointer > *start && pointer <= *end) || stack_pointer % 4 != 0 {
        let problem = format!("has its stack pointer at {stack_pointer:#x}, outside the RAM of {}", board.name);
        return Err(refuse("ram_kib", problem, &rebuild));
    }
    let entry = reset & !1;
    if reset & 1 == 0 || !(start..end).contains(&u64::from(entry)) {
        let problem = format!("has its first instruction at {reset:#x}, which is not Thumb code of this image");
        return Err(refuse("", problem, &rebuild));
    }
    // `end` fits in 32 bits: it is at most the end of flash.
    Ok(Image { start: start as u32, end: end as u32, stack_pointer, entry })
}

/// A program header of kind LOAD.
struct Segment<'a> {
    load_at: u64,
    runs_at: u64,
    memory: u64,
    bytes: &'a [u8],
}

impl Segment<'_> {
    fn load_end(&self) -> u64 {
        self.load_at + self.bytes.len() as u64
    }
}

/// All segments to load; `None` if the file is too short for them.
fn segments(elf: &[u8]) -> Option<Vec<Segment<'_>>> {
    let table = word(elf, 28)? as usize;
    let size = usize::from(half(elf, 42)?);
    let count = usize::from(half(elf, 44)?);
    let mut segments = Vec::new();
    for index in 0..count {
        let header = elf.get(table.checked_add(size.checked_mul(index)?)?..)?;
        if word(header, 0)? != LOAD {
            continue;
        }
        let offset = word(header, 4)? as usize;
        let bytes = elf.get(offset..offset.checked_add(word(header, 16)? as usize)?)?;
        segments.push(Segment {
            runs_at: u64::from(word(header, 8)?),
            load_at: u64::from(word(header, 12)?),
            memory: u64::from(word(header, 20)?),
            bytes,
        });
    }
    Some(segments)
}

fn half(bytes: &[u8], at: usize) -> Option<u16> {
    bytes.get(at..at.checked_add(2)?)?.try_into().ok().map(u16::from_le_bytes)
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..at.checked_add(4)?)?.try_into().ok().map(u32::from_le_bytes)
}
