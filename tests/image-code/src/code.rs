//! The instructions of a firmware image; its symbols tell them apart from data.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::Path;

use capstone::arch::arm::{ArchExtraMode, ArchMode};
use capstone::prelude::*;
use object::{Object, ObjectSection, ObjectSymbol, SectionKind, SymbolKind};

/// Entries of the table before the first interrupt.
const EXCEPTIONS: u32 = 16;

/// An instruction.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Instruction {
    /// Address.
    pub address: u32,
    /// Length, bytes.
    pub length: u32,
    /// Name in lower case, without `.w` and `.n`.
    pub name: String,
    /// Operands, in lower case.
    pub operands: String,
}

impl fmt::Display for Instruction {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{:#010x}: {} {}", self.address, self.name, self.operands)
    }
}

impl Instruction {
    /// The address of the next instruction.
    pub fn next(&self) -> u32 {
        self.address + self.length
    }

    /// The last operand, if it is a constant: the target of a branch.
    pub fn target(&self) -> Option<u32> {
        let constant = self.operands.rsplit([' ', ',']).next()?.strip_prefix('#')?;
        match constant.strip_prefix("0x") {
            Some(digits) => u32::from_str_radix(digits, 16).ok(),
            None => constant.parse().ok(),
        }
    }

    /// The special register that it writes, in lower case.
    pub fn written_register(&self) -> Option<&str> {
        match self.name.as_str() {
            "msr" => self.operands.split(',').next().map(str::trim),
            // It sets PRIMASK (i), FAULTMASK (f) or both.
            "cpsid" => Some(if self.operands.contains('f') { "faultmask" } else { "primask" }),
            _ => None,
        }
    }
}

/// The image's code.
pub struct Code {
    disassembler: Capstone,
    /// Address and bytes of each section that is executed.
    sections: Vec<(u32, Vec<u8>)>,
    /// Kind of the bytes from each address on: instructions (`true`) or data.
    kinds: BTreeMap<u32, bool>,
    /// Functions by their address; several names may share one.
    functions: BTreeMap<u32, Vec<String>>,
    /// End of each function; bytes between it and the next function are not code.
    ends: BTreeMap<u32, u32>,
    /// Address and bytes of the sections of constants, and of those that RAM is filled with.
    constants: Vec<(u32, Vec<u8>)>,
    /// The words of the table of handlers.
    vectors: Vec<u32>,
}

impl Code {
    /// Reads an image.
    ///
    /// # Errors
    /// The file cannot be read, or is not an ELF file.
    pub fn of(image: &Path) -> Result<Self, String> {
        let bytes = std::fs::read(image).map_err(|error| format!("{}: {error}", image.display()))?;
        let file = object::File::parse(&*bytes).map_err(|error| format!("{}: {error}", image.display()))?;
        let builder = Capstone::new().arm().mode(ArchMode::Thumb).extra_mode([ArchExtraMode::MClass].into_iter());
        let disassembler = builder.build().map_err(|error| error.to_string())?;
        let mut sections = Vec::new();
        let (mut constants, mut vectors) = (Vec::new(), Vec::new());
        for section in file.sections().filter(|section| section.size() > 0) {
            let place = (section.address() as u32, section.data().map_err(|error| error.to_string())?.to_vec());
            match section.kind() {
                _ if section.name() == Ok(".vector_table") => vectors = words(&place.1).collect(),
                SectionKind::Text => sections.push(place),
                SectionKind::ReadOnlyData | SectionKind::Data => constants.push(place),
                _ => {}
            }
        }
        let (mut kinds, mut functions) = (BTreeMap::new(), BTreeMap::<u32, Vec<String>>::new());
        let mut ends = BTreeMap::<u32, u32>::new();
        for symbol in file.symbols() {
            // Bit 0 of a function's address says Thumb.
            let (name, address) = (symbol.name().unwrap_or_default(), symbol.address() as u32 & !1);
            match name.split('.').next().unwrap_or_default() {
                "$t" => drop(kinds.insert(address, true)),
                "$d" => drop(kinds.entry(address).or_insert(false)),
                _ if symbol.kind() == SymbolKind::Text && !name.is_empty() => {
                    functions.entry(address).or_default().push(name.to_owned());
                    let end = ends.entry(address).or_default();
                    *end = (*end).max(address + symbol.size() as u32);
                }
                _ => {}
            }
        }
        Ok(Self { disassembler, sections, kinds, functions, ends, constants, vectors })
    }

    /// The names of the function that an address is in: the linker joins equal ones, and unused
    /// vectors share one.
    pub fn names(&self, address: u32) -> Vec<String> {
        let names = self.functions.range(..=address).next_back().map(|(_, names)| names.as_slice());
        // Without the hash that the compiler adds.
        names.unwrap_or_default().iter().map(|name| format!("{:#}", rustc_demangle::demangle(name))).collect()
    }

    /// The first name of the function that an address is in.
    pub fn function(&self, address: u32) -> String {
        self.names(address).into_iter().next().unwrap_or_else(|| "no function".to_owned())
    }

    /// Start of the function that contains an address.
    pub fn function_start(&self, address: u32) -> Option<u32> {
        self.functions.range(..=address).next_back().map(|(&start, _)| start)
    }

    /// Returns `true` if an outlined function begins at an address: instructions taken out of
    /// several functions, which call it now.
    pub fn is_outlined(&self, address: u32) -> bool {
        let names = self.functions.get(&address);
        names.is_some_and(|names| names.iter().all(|name| name.starts_with("OUTLINED_FUNCTION_")))
    }

    /// Returns true if an address lies after the end of the function that begins before it. A
    /// function without a length, which is not the compiler's, has no end.
    pub fn is_between_functions(&self, address: u32) -> bool {
        let before = self.ends.range(..=address).next_back();
        before.is_none_or(|(&start, &end)| end > start && address >= end)
    }

    /// Addresses of the functions whose names contain a text.
    pub fn functions_named(&self, part: &str) -> Vec<u32> {
        let names_it = |names: &Vec<String>| names.iter().any(|name| name.contains(part));
        self.functions.iter().filter(|(_, names)| names_it(names)).map(|(&address, _)| address).collect()
    }

    /// Initial stack pointer: the start of the stack.
    pub fn initial_stack(&self) -> u32 {
        self.vectors.first().copied().unwrap_or_default()
    }

    /// All handlers of exceptions and interrupts.
    pub fn handlers(&self) -> BTreeSet<u32> {
        // The first word is the stack pointer, and a function's address has bit 0 set.
        self.vectors.iter().skip(1).filter(|word| **word & 1 == 1).map(|handler| handler & !1).collect()
    }

    /// The handler of an interrupt, by its number in the reference manual.
    ///
    /// # Errors
    /// The vector is missing, or leads to no function.
    pub fn handler(&self, interrupt: u32) -> Result<u32, String> {
        match self.vectors.get((EXCEPTIONS + interrupt) as usize) {
            // Bit 0 says Thumb, without which the core would fault.
            Some(handler) if handler & 1 == 1 => Ok(handler & !1),
            Some(handler) => Err(format!("the vector of interrupt {interrupt} is {handler:#010x}, no function")),
            None => Err(format!("no vector of interrupt {interrupt}")),
        }
    }

    /// Every word of the image's constants and of the bytes that RAM is filled with, without the
    /// table of handlers.
    pub fn constants(&self) -> BTreeSet<u32> {
        self.constants.iter().flat_map(|(_, bytes)| words(bytes)).collect()
    }

    /// Returns true if a word is a pointer to a function: bit 0 says Thumb.
    pub fn is_function(&self, word: u32) -> bool {
        word & 1 == 1 && self.function_start(word & !1) == Some(word & !1)
    }

    /// The words between the instructions, by their addresses.
    pub fn literals(&self) -> BTreeMap<u32, u32> {
        let in_section = |(start, bytes): &(u32, Vec<u8>)| {
            let addresses = (*start..).step_by(4);
            let is_data =
                |address: &u32| self.kinds.range(..=*address).next_back().is_some_and(|(_, is_code)| !is_code);
            addresses.zip(words(bytes)).filter(|(address, _)| is_data(address)).collect::<Vec<_>>()
        };
        self.sections.iter().flat_map(in_section).collect()
    }

    /// The instruction at an address.
    ///
    /// # Errors
    /// The bytes are not an instruction of this processor.
    pub fn instruction(&self, address: u32) -> Result<Instruction, String> {
        let in_section = |(start, bytes): &(u32, Vec<u8>)| {
            let offset = address.checked_sub(*start)? as usize;
            bytes.get(offset..).filter(|rest| !rest.is_empty()).map(|rest| rest[..rest.len().min(4)].to_vec())
        };
        let bytes = self.sections.iter().find_map(in_section).ok_or(format!("{address:#010x}: no code is there"))?;
        if self.kinds.range(..=address).next_back().is_none_or(|(_, is_code)| !is_code) {
            return Err(format!("{address:#010x}: data, in {}", self.function(address)));
        }
        let decoded = self.disassembler.disasm_count(&bytes, address.into(), 1).map_err(|error| error.to_string())?;
        let Some(decoded) = decoded.iter().next() else {
            return Err(format!("{address:#010x}: {bytes:02x?} is no instruction, in {}", self.function(address)));
        };
        let name = decoded.mnemonic().unwrap_or_default().to_ascii_lowercase();
        Ok(Instruction {
            address,
            length: decoded.len() as u32,
            name: name.trim_end_matches(".w").trim_end_matches(".n").to_owned(),
            operands: decoded.op_str().unwrap_or_default().to_ascii_lowercase(),
        })
    }

    /// Possible targets of a branch through a table of offsets (`tbb`, `tbh`); empty for any
    /// other instruction.
    pub fn table_targets(&self, instruction: &Instruction) -> BTreeSet<u32> {
        let bytes_each = match (instruction.name.as_str(), instruction.operands.starts_with("[pc")) {
            ("tbb", true) => 1,
            ("tbh", true) => 2,
            _ => return BTreeSet::new(),
        };
        let table = instruction.next();
        // The table is the data up to the next instruction.
        let end = self.kinds.range(table + 1..).find(|(_, is_code)| **is_code).map_or(table, |(&end, _)| end);
        let bytes = self.sections.iter().find_map(|(start, bytes)| {
            bytes.get(table.checked_sub(*start)? as usize..end.checked_sub(*start)? as usize)
        });
        let offsets = bytes.unwrap_or_default().chunks_exact(bytes_each).map(|offset| match *offset {
            [low, high] => u32::from(u16::from_le_bytes([low, high])),
            [low] => u32::from(low),
            _ => 0,
        });
        // Filling of the last word reads as an offset into the table, and constants after the table
        // lead out of the function.
        let function = self.function_start(instruction.address);
        let is_target = |target: &u32| self.function_start(*target) == function && self.instruction(*target).is_ok();
        offsets.map(|offset| table + 2 * offset).filter(is_target).collect()
    }

    /// Every instruction of the image, in order.
    ///
    /// # Errors
    /// Bytes that the file calls code are not valid code.
    pub fn instructions(&self) -> Result<Vec<Instruction>, String> {
        let mut all = Vec::new();
        for (start, bytes) in &self.sections {
            let (mut address, end) = (*start, start + bytes.len() as u32);
            while address < end {
                let is_code = self.kinds.range(..=address).next_back().is_some_and(|(_, is_code)| *is_code);
                let until = self.kinds.range(address + 1..).next().map_or(end, |(&next, _)| next.min(end));
                while is_code && address < until {
                    let instruction = self.instruction(address)?;
                    address = instruction.next();
                    all.push(instruction);
                }
                address = address.max(until);
            }
        }
        Ok(all)
    }
}

/// The words of these bytes, without a rest of less than four.
fn words(bytes: &[u8]) -> impl Iterator<Item = u32> + use<'_> {
    bytes.as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word))
}

/// The constant to which a register was last set by the instructions of a function,
/// taken in their order.
pub fn constant(function: &[Instruction], register: &str) -> Option<u32> {
    let only_reads = |name: &str| {
        matches!(name, "bx" | "blx" | "cbz" | "cbnz" | "cmp" | "cmn" | "tst" | "teq") || name.starts_with("str")
    };
    let is_set = |instruction: &Instruction| {
        instruction.operands.split(',').next() == Some(register) && !only_reads(&instruction.name)
    };
    let place = function.iter().rposition(is_set)?;
    // A value that is loaded or computed is not a constant, whatever the register held before.
    let setting = function.get(place).filter(|setting| setting.name.starts_with("mov"))?;
    setting.target().or_else(|| constant(function.get(..place)?, setting.operands.rsplit(' ').next()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn instruction(name: &str, operands: &str) -> Instruction {
        Instruction { address: 0, length: 2, name: name.to_owned(), operands: operands.to_owned() }
    }

    #[test]
    fn a_constant_is_what_a_register_was_set_to_last() {
        let code = [("movs", "r0, #224"), ("mov", "r11, r0"), ("str", "r11, [sp, #4]"), ("cmp", "r11, #0")];
        let mut function: Vec<Instruction> = code.iter().map(|(name, operands)| instruction(name, operands)).collect();
        assert_eq!(constant(&function, "r11"), Some(224));
        function.push(instruction("ldr", "r11, [sp, #8]"));
        assert_eq!(constant(&function, "r11"), None);
        assert_eq!(constant(&function, "r0"), Some(224));
    }

    #[test]
    fn targets_and_written_registers() {
        assert_eq!(instruction("b", "#0x8000108").target(), Some(0x0800_0108));
        assert_eq!(instruction("cbz", "r0, #0x10").target(), Some(0x10));
        assert_eq!(instruction("movs", "r0, #224").target(), Some(224));
        assert_eq!(instruction("blx", "r3").target(), None);
        assert_eq!(instruction("msr", "basepri_max, r0").written_register(), Some("basepri_max"));
        assert_eq!(instruction("mrs", "r0, basepri").written_register(), None);
        assert_eq!(instruction("cpsid", "i").written_register(), Some("primask"));
        assert_eq!(instruction("cpsid", "if").written_register(), Some("faultmask"));
    }

    #[test]
    fn a_constant_is_found_through_other_registers() {
        let function = [
            instruction("movs", "r4, #0x10"),
            instruction("movs", "r0, #0xc0"),
            instruction("mov", "r1, r4"),
            instruction("movs", "r4, #1"),
            instruction("mov", "r2, r3"),
        ];
        assert_eq!(constant(&function, "r0"), Some(0xc0));
        assert_eq!(constant(&function, "r1"), Some(0x10));
        assert_eq!(constant(&function, "r2"), None);
        assert_eq!(constant(&function, "r5"), None);
    }
}
