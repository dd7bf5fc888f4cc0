//! The addresses of an image's code, variables and handlers, from its ELF file (System V ABI,
//! chapter 4; ARM's supplement).

use std::collections::BTreeSet;
use std::ops::Range;

use crate::wiring::Board;

const SHT_SYMTAB: u32 = 2;
const SHF_ALLOC: u32 = 1 << 1;
const SYMBOL_BYTES: usize = 16;
/// The part of the stack that may be in use, bytes; it lies below the static variables or at the
/// end of the memory.
const STACK_BYTES: u64 = 4096;
/// The first handler in the vector table: entries 0 and 1 are the initial stack
/// pointer and the reset.
const FIRST_HANDLER: u64 = 2;

/// A function or a variable.
#[derive(Debug, Clone)]
struct Symbol {
    address: u64,
    size: u64,
    name: String,
}

/// The memory layout of an image.
#[derive(Debug, Clone, Default)]
pub struct Layout {
    /// Static variables and the stack.
    pub ram: Vec<Range<u64>>,
    /// All of the core coupled memory.
    pub ccm: Vec<Range<u64>>,
    /// The flash that the image occupies.
    pub flash: Vec<Range<u64>>,
    /// Handlers other than the default one: exception number and address.
    pub handlers: Vec<(u64, u32)>,
    symbols: Vec<Symbol>,
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?))
}

fn half(bytes: &[u8], at: usize) -> Option<usize> {
    Some(usize::from(u16::from_le_bytes(bytes.get(at..at + 2)?.try_into().ok()?)))
}

fn size(value: u32) -> Option<usize> {
    usize::try_from(value).ok()
}

fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).into_owned()
}

impl Layout {
    /// Reads a 32-bit little-endian ELF file.
    ///
    /// # Errors
    /// The file is truncated or not such a file.
    pub fn read(board: &Board, elf: &[u8]) -> Result<Self, String> {
        let mut layout = Self::parse(board, elf).ok_or_else(|| {
            format!("truncated or not an ELF file; build it with `cargo xtask firmware --board {}`", board.name)
        })?;
        if board.ccm_bytes > 0 {
            layout.ccm.push(0x1000_0000..0x1000_0000 + u64::from(board.ccm_bytes));
        }
        Ok(layout)
    }

    fn parse(board: &Board, elf: &[u8]) -> Option<Self> {
        let mut layout = Self::default();
        let (sections, entry_size, count) = (size(word(elf, 32)?)?, half(elf, 46)?, half(elf, 48)?);
        let mut vectors = None;
        for index in 0..count {
            let at = sections + index * entry_size;
            let (kind, flags) = (word(elf, at + 4)?, word(elf, at + 8)?);
            let (address, offset, bytes) = (word(elf, at + 12)?, size(word(elf, at + 16)?)?, word(elf, at + 20)?);
            if kind == SHT_SYMTAB {
                let strings = sections + size(word(elf, at + 24)?)? * entry_size;
                let names = elf.get(size(word(elf, strings + 16)?)?..)?;
                layout.symbols = symbols(elf.get(offset..offset + size(bytes)?)?, names);
            }
            if flags & SHF_ALLOC == 0 || bytes == 0 {
                continue;
            }
            let range = u64::from(address)..u64::from(address) + u64::from(bytes);
            match address >> 24 {
                0x08 => {
                    if address == 0x0800_0000 + board.boot_offset {
                        vectors = elf.get(offset..offset + size(bytes)?);
                    }
                    layout.flash.push(range);
                }
                0x20 => layout.ram.push(range),
                _ => {}
            }
        }
        let vectors = vectors?;
        let stack = u64::from(word(vectors, 0)?);
        layout.ram.push(stack.saturating_sub(STACK_BYTES)..stack);
        layout.handlers = handlers(vectors);
        Some(layout)
    }

    /// " in NAME" for the symbol at an address; empty without one.
    #[must_use]
    pub fn symbol(&self, address: u64) -> String {
        self.symbols
            .iter()
            .filter(|symbol| (symbol.address..symbol.address + symbol.size).contains(&address))
            .min_by_key(|symbol| symbol.size)
            .map_or_else(String::new, |symbol| format!(" in {}", symbol.name))
    }
}

fn symbols(table: &[u8], names: &[u8]) -> Vec<Symbol> {
    let mut symbols = Vec::new();
    for entry in table.as_chunks::<SYMBOL_BYTES>().0 {
        let (Some(name), Some(address), Some(bytes)) = (word(entry, 0), word(entry, 4), word(entry, 8)) else {
            continue;
        };
        let name = size(name).and_then(|at| names.get(at..)).map_or_else(String::new, text);
        // The lowest bit of a function's address is the Thumb bit.
        symbols.push(Symbol { address: u64::from(address & !1), size: u64::from(bytes), name });
    }
    symbols
}

/// The handlers of a vector table, except the default one that most exceptions share.
fn handlers(vectors: &[u8]) -> Vec<(u64, u32)> {
    let all: Vec<(u64, u32)> = (0..)
        .zip(vectors.as_chunks::<4>().0)
        .filter_map(|(number, bytes)| Some((number, word(bytes, 0)?)))
        .filter(|(number, address)| *number >= FIRST_HANDLER && *address != 0)
        .collect();
    let count = |wanted: u32| all.iter().filter(|(_, address)| *address == wanted).count();
    let default = all.iter().map(|(_, address)| *address).max_by_key(|address| count(*address));
    let mut seen = BTreeSet::new();
    all.iter()
        .filter(|(_, address)| Some(*address) != default && seen.insert(*address))
        .map(|(number, address)| (*number, address & !1))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_handler_is_listed_once_without_the_default() {
        let words: [u32; 8] = [0x2000_1000, 0x101, 0x201, 0x301, 0x201, 0, 0x401, 0x301];
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        let found = handlers(&bytes);
        // 0x201 and 0x301 appear twice each: the later one counts as the default.
        assert_eq!(found, [(2, 0x200), (6, 0x400)]);
    }

    #[test]
    fn truncated_tables_are_refused() {
        assert!(handlers(&[]).is_empty());
        assert_eq!(word(&[1, 2], 0), None);
    }
}
