//! The maximum stack of an image, from its instructions.
//!
//! A function's frame is the sum of all that its instructions take, as if every one of them were
//! executed: never too little. Calls are followed wherever they can lead. The target of a call
//! through a pointer cannot be read there, so it is assumed to lead to every function of its kind
//! whose address occurs anywhere in the image.

use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;

use crate::called_constant::is_only_called;
use crate::code::{Code, Instruction};

/// Bytes that an exception puts on the stack: eight words of the core, 18 of the floating-point
/// unit, and one to align them (ARMv7-M Architecture Reference Manual, B1.5.6 and B1.5.7).
pub const EXCEPTION_BYTES: u32 = 4 * (8 + 18 + 1);

/// Maximum depth of a text whose arguments are texts with arguments, and so on.
///
/// The longest chain: a reply, the refusal in it, the error in that, a driver's report, its
/// error, a number.
const NESTED_TEXTS: u32 = 6;

/// Number of Ferrostep's types, those with the largest frames, for which the search remembers
/// whether their text is being made.
const TEXTS_IN_MIND: usize = 10;

/// The purpose of a call through a pointer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    /// Writes text: `core::fmt::Write`.
    Writer,
    /// Makes text of a value: `Display`, `Debug` and the like.
    Text,
    /// Everything else.
    Other,
}

/// A function's frame and calls.
#[derive(Default)]
struct Function {
    frame: u32,
    calls: BTreeSet<u32>,
    /// True if it calls through pointers.
    calls_pointers: bool,
}

/// The functions of an image, with the stack that they take.
pub struct StackUse<'a> {
    code: &'a Code,
    functions: BTreeMap<u32, Function>,
    /// Functions whose address occurs, by purpose.
    pointed_to: BTreeMap<Kind, BTreeSet<u32>>,
    /// Functions that make the text of one of Ferrostep's types, those with the largest frames, at
    /// most [`TEXTS_IN_MIND`].
    own_texts: Vec<u32>,
}

/// The greatest depth of a function.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Deepest {
    /// Bytes.
    pub bytes: u32,
    /// The functions on the deepest path, each with its frame.
    pub way: Vec<(u32, u32)>,
}

impl<'a> StackUse<'a> {
    /// Looks through an image.
    ///
    /// # Errors
    /// An instruction moves the stack pointer by an unknown amount, or cannot be decoded.
    pub fn of(code: &'a Code) -> Result<Self, String> {
        let mut functions = BTreeMap::<u32, Function>::new();
        let mut pointers = code.constants();
        let mut literals = code.literals();
        // Constants that are only loaded to be called: for each, whether that holds for all
        // instructions that load it.
        let mut only_called = BTreeMap::<u32, bool>::new();
        let mut lower_halves = BTreeMap::new();
        let mut current = None;
        let all = code.instructions()?;
        let outlined_functions = outlined_functions(code, &all);
        for instruction in &all {
            if code.is_between_functions(instruction.address) {
                continue;
            }
            let Some(start) = code.function_start(instruction.address) else {
                return Err(format!("{instruction}: in no function"));
            };
            if current.replace(start) != Some(start) {
                lower_halves.clear();
            }
            let function = functions.entry(start).or_default();
            function.frame += taken_bytes(instruction).ok_or_else(|| {
                format!("{instruction} in {}: moves the stack pointer by an unknown amount", code.function(start))
            })?;
            if let Some(callee) = callee(instruction).and_then(|target| code.function_start(target)) {
                // A branch within the function is not a call; a recursion is.
                if callee != start || instruction.name == "bl" {
                    function.calls.insert(callee);
                }
            }
            if code.is_outlined(start) {
                continue;
            }
            let part =
                callee(instruction).and_then(|target| outlined_functions.get(&target)).copied().unwrap_or_default();
            // An outlined function's constants belong to each of its callers.
            let back = (instruction.name == "bl").then(|| instruction.next());
            let within = part.iter().map(|instruction| (instruction, back));
            if part.iter().any(is_through_pointer) {
                function.frame += part.iter().filter_map(taken_bytes).sum::<u32>();
            }
            for (instruction, back) in std::iter::once((instruction, None)).chain(within) {
                function.calls_pointers |= is_through_pointer(instruction);
                if let Some((register, place)) = loaded_literal(instruction)
                    && let Some(word) = literals.get(&place)
                {
                    let is_only_called = code.is_function(*word) && is_only_called(code, instruction, register, back);
                    *only_called.entry(place).or_insert(true) &= is_only_called;
                    if is_only_called {
                        function.calls.insert(*word & !1);
                    }
                }
                if let Some(word) = built_constant(instruction, &mut lower_halves) {
                    let register = instruction.operands.split(',').next().unwrap_or_default();
                    if code.is_function(word) && is_only_called(code, instruction, register, back) {
                        function.calls.insert(word & !1);
                    } else {
                        pointers.insert(word);
                    }
                }
            }
        }
        literals.retain(|place, _| !only_called.get(place).copied().unwrap_or(false));
        pointers.extend(literals.into_values());
        let mut pointed_to = BTreeMap::<Kind, BTreeSet<u32>>::new();
        // Bit 0 of a function's address says Thumb.
        for address in pointers.into_iter().filter(|word| word & 1 == 1).map(|word| word & !1) {
            if functions.contains_key(&address) {
                pointed_to.entry(kind(&code.names(address))).or_default().insert(address);
            }
        }
        let own_texts = own_texts(code, &functions);
        Ok(Self { code, functions, pointed_to, own_texts })
    }

    /// The greatest depth of the stack in a function and all that it calls.
    ///
    /// # Errors
    /// A function can call itself without a known end.
    pub fn deepest(&self, start: u32) -> Result<Rc<Deepest>, String> {
        let within = Within { texts_left: NESTED_TEXTS, own_texts: 0 };
        Search { stack_use: self, known: BTreeMap::new(), on_the_way: Vec::new() }.deepest(start, within)
    }

    /// The bytes that a function takes itself.
    pub fn frame(&self, start: u32) -> u32 {
        self.functions.get(&start).map_or(0, |function| function.frame)
    }

    /// Returns true if a function makes the text of a reply to a host.
    fn is_text_of_reply(&self, start: u32) -> bool {
        self.code.names(start).iter().any(|name| name.contains("ferrostep_gcode::reply::Reply as core::fmt::Display"))
    }

    /// The functions that a pointer leads to from a function, and whether that begins a
    /// text within a text.
    fn through_pointers(&self, start: u32) -> Vec<(u32, bool)> {
        let names = self.code.names(start);
        let own = kind(&names);
        // An image keeps no pointer to a function for that function itself.
        let all_of = |kind| self.pointed_to.get(&kind).into_iter().flatten().copied().filter(|&to| to != start);
        let writers = all_of(Kind::Writer).map(|to| (to, false));
        let makes_text_of_all = names.iter().any(|name| name == "core::fmt::write" || name.contains("<&"));
        let is_of_text = own != Kind::Other || names.iter().any(|name| name.contains("core::fmt"));
        if makes_text_of_all {
            writers.chain(all_of(Kind::Text).map(|to| (to, true))).collect()
        } else if is_of_text {
            writers.collect()
        } else {
            writers.chain(all_of(Kind::Other).map(|to| (to, false))).collect()
        }
    }
}

/// The texts that are being made where a function is called.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Within {
    /// Levels of texts that are left.
    texts_left: u32,
    /// A bit for each of [`StackUse::own_texts`] that is being made.
    own_texts: u16,
}

/// A search for the deepest path.
struct Search<'a, 'b> {
    stack_use: &'b StackUse<'a>,
    known: BTreeMap<(u32, Within), Rc<Deepest>>,
    on_the_way: Vec<(u32, Within)>,
}

impl Search<'_, '_> {
    fn deepest(&mut self, start: u32, mut within: Within) -> Result<Rc<Deepest>, String> {
        if let Some(place) = self.stack_use.own_texts.iter().position(|own| *own == start) {
            // No type of Ferrostep's contains itself, for none is on a heap: its text is
            // never in its own.
            if within.own_texts >> place & 1 == 1 {
                return Ok(Rc::default());
            }
            within.own_texts |= 1 << place;
        }
        if let Some(known) = self.known.get(&(start, within)) {
            return Ok(Rc::clone(known));
        }
        let code = self.stack_use.code;
        if self.on_the_way.contains(&(start, within)) {
            let way = self.on_the_way.iter().skip_while(|one| **one != (start, within));
            let names: Vec<String> = way.map(|(function, _)| code.function(*function)).collect();
            return Err(format!("these call each other: {}", names.join(" > ")));
        }
        let Some(function) = self.stack_use.functions.get(&start) else { return Ok(Rc::default()) };
        self.on_the_way.push((start, within));
        let direct = function.calls.iter().map(|&callee| (callee, false));
        let through = if function.calls_pointers { self.stack_use.through_pointers(start) } else { Vec::new() };
        let mut below = Rc::<Deepest>::default();
        for (callee, begins_text) in direct.chain(through) {
            // A reply is a text by itself, never in another.
            if begins_text && within.texts_left < NESTED_TEXTS && self.stack_use.is_text_of_reply(callee) {
                continue;
            }
            let Some(texts_left) = within.texts_left.checked_sub(u32::from(begins_text)) else { continue };
            let deepest = self.deepest(callee, Within { texts_left, ..within })?;
            if deepest.bytes > below.bytes {
                below = deepest;
            }
        }
        self.on_the_way.pop();
        let way = std::iter::once((start, function.frame)).chain(below.way.iter().copied()).collect();
        let deepest = Rc::new(Deepest { bytes: below.bytes + function.frame, way });
        self.known.insert((start, within), Rc::clone(&deepest));
        Ok(deepest)
    }
}

/// The functions that make the text of one of Ferrostep's types, the largest frames first. One that
/// the linker has merged with others is left out.
fn own_texts(code: &Code, functions: &BTreeMap<u32, Function>) -> Vec<u32> {
    let is_own = |start: u32| match &code.names(start)[..] {
        [name] => {
            (name.starts_with("<ferrostep_") || name.starts_with("<&ferrostep_"))
                && name.contains(" as core::fmt::Display>")
        }
        _ => false,
    };
    let mut own: Vec<(u32, u32)> = functions.iter().map(|(start, function)| (function.frame, *start)).collect();
    own.retain(|(_, start)| is_own(*start));
    own.sort_unstable_by(|one, other| other.cmp(one));
    own.into_iter().take(TEXTS_IN_MIND).map(|(_, start)| start).collect()
}

/// The instructions of each outlined function.
fn outlined_functions<'a>(code: &Code, all: &'a [Instruction]) -> BTreeMap<u32, &'a [Instruction]> {
    let parts = all.chunk_by(|one, next| code.function_start(one.address) == code.function_start(next.address));
    let starts = parts.filter_map(|part| Some((part.first()?.address, part)));
    starts.filter(|(start, _)| code.is_outlined(*start)).collect()
}

fn kind(names: &[String]) -> Kind {
    let any = |parts: &[&str]| names.iter().any(|name| parts.iter().any(|part| name.contains(part)));
    if any(&["core::fmt::Write>", "core::fmt::Write::"]) {
        Kind::Writer
    } else if any(&["core::fmt::Display", "core::fmt::Debug", "core::fmt::LowerHex", "core::fmt::UpperHex"]) {
        Kind::Text
    } else {
        Kind::Other
    }
}

/// Number of registers in a list such as `{r4, r5, r6, lr}` or `{d8-d11}`.
fn registers(list: &str) -> Option<u32> {
    let list = list.split_once('{')?.1.split_once('}')?.0;
    list.split(',')
        .map(|item| match item.trim().split_once('-') {
            None => Some(1),
            Some((first, last)) => {
                let number = |register: &str| register.trim().get(1..)?.parse::<u32>().ok();
                Some(number(last)? - number(first)? + 1)
            }
        })
        .sum()
}

/// Bytes that an instruction takes of the stack; `None` if it may take any.
fn taken_bytes(instruction: &Instruction) -> Option<u32> {
    let Instruction { name, operands, .. } = instruction;
    let bytes_of_one = if operands.contains("{d") { 8 } else { 4 };
    let is_push = name == "push" || name == "vpush" || name == "stmdb" && operands.starts_with("sp!");
    if is_push {
        return Some(registers(operands)? * bytes_of_one);
    }
    // The stored register precedes its address: `str r11, [sp, #-4]!`.
    if let Some((_, offset)) = operands.split_once("[sp, #-").filter(|_| operands.ends_with("]!")) {
        return number(offset.trim_end_matches("]!"));
    }
    let first = operands.split(',').next().unwrap_or_default().trim();
    if first != "sp" || !["sub", "subw", "mov", "add", "addw"].iter().any(|one| name == one) {
        return Some(0);
    }
    match (name.as_str(), instruction.target()) {
        ("sub" | "subw", bytes) => bytes,
        ("add" | "addw", Some(_)) => Some(0),
        // The start code sets the stack pointer to its first value.
        ("mov", None) if operands == "sp, r1" => Some(0),
        _ => None,
    }
}

fn number(text: &str) -> Option<u32> {
    match text.strip_prefix("0x") {
        Some(digits) => u32::from_str_radix(digits, 16).ok(),
        None => text.parse().ok(),
    }
}

/// Target of a call or a branch.
fn callee(instruction: &Instruction) -> Option<u32> {
    let name = instruction.name.as_str();
    let is_branch =
        name.starts_with('b') && !name.starts_with("bfc") && !name.starts_with("bic") || name.starts_with("cb");
    if is_branch { instruction.target() } else { None }
}

fn is_through_pointer(instruction: &Instruction) -> bool {
    let Instruction { name, operands, .. } = instruction;
    (name == "blx" || name.starts_with("bx")) && operands != "lr" && instruction.target().is_none()
        || name.starts_with("ldr") && operands.starts_with("pc") && !operands.starts_with("pc, [sp]")
}

/// The register that an instruction loads with a word from between the instructions, and where that
/// lies (ARMv7-M Architecture Reference Manual, A7.7.44: from the next word boundary after the
/// instruction's fourth byte).
fn loaded_literal(instruction: &Instruction) -> Option<(&str, u32)> {
    let (register, offset) = instruction.operands.split_once(", [pc, #")?;
    (instruction.name == "ldr").then_some(())?;
    let offset = number(offset.strip_suffix(']')?)?;
    Some((register, (instruction.address & !3).checked_add(4)?.checked_add(offset)?))
}

/// A constant whose second half an instruction sets.
fn built_constant(instruction: &Instruction, lower_halves: &mut BTreeMap<String, u32>) -> Option<u32> {
    let register = instruction.operands.split(',').next()?.to_owned();
    match instruction.name.as_str() {
        "movw" => drop(lower_halves.insert(register, instruction.target()?)),
        "movt" => return Some(lower_halves.get(&register)? | instruction.target()? << 16),
        _ => {}
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn instruction(name: &str, operands: &str) -> Instruction {
        Instruction { address: 0, length: 2, name: name.to_owned(), operands: operands.to_owned() }
    }

    #[test]
    fn what_instructions_take_of_the_stack() {
        let taken = |name: &str, operands: &str| taken_bytes(&instruction(name, operands));
        assert_eq!(taken("push", "{r4, r5, r6, r7, lr}"), Some(20));
        assert_eq!(taken("push", "{r8, sb, sl, fp}"), Some(16));
        assert_eq!(taken("vpush", "{d8, d9}"), Some(16));
        assert_eq!(taken("vpush", "{d8-d11}"), Some(32));
        assert_eq!(taken("str", "fp, [sp, #-4]!"), Some(4));
        assert_eq!(taken("strd", "r8, sb, [sp, #-0x10]!"), Some(16));
        assert_eq!(taken("sub", "sp, #0x28"), Some(40));
        assert_eq!(taken("sub", "sp, sp, #0x2580"), Some(0x2580));
        assert_eq!(taken("subw", "sp, sp, #0x50c"), Some(0x50c));
        assert_eq!(taken("add", "sp, #0x28"), Some(0));
        assert_eq!(taken("add", "r0, sp, #0x28"), Some(0));
        assert_eq!(taken("sub", "sp, sp, r0"), None);
        assert_eq!(taken("mov", "sp, r7"), None);
    }

    #[test]
    fn where_calls_lead() {
        assert_eq!(callee(&instruction("bl", "#0x8000108")), Some(0x0800_0108));
        assert_eq!(callee(&instruction("bne", "#0x8000108")), Some(0x0800_0108));
        assert_eq!(callee(&instruction("bics", "r0, #0x10")), None);
        assert!(is_through_pointer(&instruction("blx", "r3")));
        assert!(is_through_pointer(&instruction("bx", "ip")));
        assert!(!is_through_pointer(&instruction("bx", "lr")));
        assert!(!is_through_pointer(&instruction("ldr", "pc, [sp], #8")));
        let mut halves = BTreeMap::new();
        assert_eq!(built_constant(&instruction("movw", "r1, #0x1235"), &mut halves), None);
        assert_eq!(built_constant(&instruction("movt", "r1, #0x801"), &mut halves), Some(0x0801_1235));
        assert_eq!(built_constant(&instruction("movt", "r2, #0x801"), &mut halves), None);
    }
}
