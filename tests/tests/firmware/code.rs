//! The instructions of the image, as its symbols tell them apart from data.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

use capstone::prelude::*;
use object::{Object, ObjectSection, ObjectSymbol, SectionKind, SymbolKind};

/// Where the table of handlers begins: at the start of flash (`memory.x`).
const VECTOR_TABLE: u32 = 0x0800_0000;

/// Entries of the table before the first interrupt.
const EXCEPTIONS: u32 = 16;

/// An instruction.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Instruction {
    /// Its address.
    pub address: u32,
    /// Its length, bytes.
    pub length: u32,
    /// Its name in lower case, without `.w` and `.n`.
    pub name: String,
    /// What it acts on, in lower case.
    pub operands: String,
}

impl fmt::Display for Instruction {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{:#010x}: {} {}", self.address, self.name, self.operands)
    }
}

impl Instruction {
    /// The address of the instruction behind it.
    pub fn next(&self) -> u32 {
        self.address + self.length
    }

    /// The last operand, if it is a constant: where a branch leads to.
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
    /// From each address on: instructions (`true`) or data.
    kinds: BTreeMap<u32, bool>,
    /// Functions by their address; several names may share one.
    functions: BTreeMap<u32, Vec<String>>,
    flash: Vec<(u32, Vec<u8>)>,
}

impl Code {
    /// Reads an image.
    pub fn of(image: &Path) -> Self {
        let bytes = std::fs::read(image).unwrap_or_else(|error| panic!("{}: {error}", image.display()));
        let file = object::File::parse(&*bytes).unwrap();
        let disassembler = Capstone::new()
            .arm()
            .mode(arch::arm::ArchMode::Thumb)
            .extra_mode([arch::arm::ArchExtraMode::MClass].into_iter())
            .build()
            .unwrap();
        let mut sections = Vec::new();
        let mut flash = Vec::new();
        for section in file.sections().filter(|section| section.size() > 0) {
            let place = (section.address() as u32, section.data().unwrap().to_vec());
            match section.kind() {
                SectionKind::Text if section.name() != Ok(".vector_table") => sections.push(place),
                SectionKind::Text | SectionKind::ReadOnlyData => flash.push(place),
                _ => {}
            }
        }
        let (mut kinds, mut functions) = (BTreeMap::new(), BTreeMap::<u32, Vec<String>>::new());
        for symbol in file.symbols() {
            // Bit 0 of a function's address says Thumb.
            let (name, address) = (symbol.name().unwrap_or_default(), symbol.address() as u32 & !1);
            match name.split('.').next().unwrap_or_default() {
                "$t" => drop(kinds.insert(address, true)),
                "$d" => drop(kinds.entry(address).or_insert(false)),
                _ if symbol.kind() == SymbolKind::Text && !name.is_empty() => {
                    functions.entry(address).or_default().push(name.to_owned());
                }
                _ => {}
            }
        }
        Self { disassembler, sections, kinds, functions, flash }
    }

    /// The names of the function that an address is in: the linker joins equal ones, and unused vectors share one.
    pub fn names(&self, address: u32) -> Vec<String> {
        let names = self.functions.range(..=address).next_back().map(|(_, names)| names.as_slice());
        // Without the hash that the compiler adds.
        names.unwrap_or_default().iter().map(|name| format!("{:#}", rustc_demangle::demangle(name))).collect()
    }

    /// The first name of the function that an address is in.
    pub fn function(&self, address: u32) -> String {
        self.names(address).into_iter().next().unwrap_or_else(|| "no function".to_owned())
    }

    /// Where the function begins that an address is in.
    pub fn function_start(&self, address: u32) -> Option<u32> {
        self.functions.range(..=address).next_back().map(|(&start, _)| start)
    }

    /// Addresses of the functions in whose names a text stands.
    pub fn functions_named(&self, part: &str) -> Vec<u32> {
        let names_it = |names: &Vec<String>| names.iter().any(|name| name.contains(part));
        self.functions.iter().filter(|(_, names)| names_it(names)).map(|(&address, _)| address).collect()
    }

    /// The handler of an interrupt, by its number in the reference manual.
    pub fn handler(&self, interrupt: u32) -> u32 {
        let place = VECTOR_TABLE + 4 * (EXCEPTIONS + interrupt);
        let word = self.flash.iter().find_map(|(start, bytes)| {
            let offset = place.checked_sub(*start)? as usize;
            bytes.get(offset..offset + 4)?.try_into().ok().map(u32::from_le_bytes)
        });
        let handler = word.unwrap_or_else(|| panic!("no vector of interrupt {interrupt} at {place:#010x}"));
        assert_eq!(handler & 1, 1, "the vector of interrupt {interrupt} is {handler:#010x}, which is no function");
        handler & !1
    }

    /// The instruction at an address.
    ///
    /// # Errors
    /// There is none, or none that this processor has.
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

    /// Every instruction of the image, in order.
    ///
    /// # Errors
    /// Something that is said to be code is none.
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
