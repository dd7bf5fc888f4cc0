//! Sections in which an image's code masks interrupts, and their maximum duration.
//!
//! A section begins with the instruction that raises BASEPRI, or sets PRIMASK or FAULTMASK, and
//! ends with the one that puts it back. All paths between the two are followed, through
//! branches, tables and calls; a path that ends in a trap does not come back and does not count.
//! Cycles are the most that instructions take from the flash's cache (`cycles`), without the
//! time of interrupts that are not masked. A loop's instructions count once, and the section
//! says that it has one.

use std::collections::{BTreeMap, BTreeSet};

use crate::code::{Code, Instruction, constant};
use crate::cycles::cycles;
use crate::flow::{Flow, flow};
use crate::graph::Graph;

/// Maximum depth of sections within each other that is counted.
const MAX_DEPTH: i32 = 4;

/// Interrupts that a section masks, in rising order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Mask {
    /// BASEPRI, to a priority that travels through a branch or a call.
    Unknown,
    /// BASEPRI: interrupts up to this priority in RTIC's sense, 1 to 15.
    Priority(u32),
    /// PRIMASK or FAULTMASK: all interrupts.
    All,
}

/// A section that masks interrupts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Section {
    /// The instruction that begins it: one that masks, or the call of a function that returns with
    /// interrupts masked.
    pub address: u32,
    /// Name of the function that contains this instruction.
    pub function: String,
    /// Interrupts that it masks.
    pub mask: Mask,
    /// Maximum duration; `None` if it never ends.
    pub time: Option<Time>,
}

/// Maximum duration of a section.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Time {
    /// Cycles of the core.
    pub cycles: u32,
    /// True if it contains a loop, whose instructions are counted once.
    pub has_loop: bool,
    /// True if it calls through a pointer: the called code is not counted.
    pub calls_pointer: bool,
}

/// All sections of an image, by address.
///
/// # Errors
/// Something that can be executed within one is not valid code.
pub fn sections(code: &Code) -> Result<Vec<Section>, String> {
    let all = code.instructions()?;
    let mut sections = Vec::new();
    for register in [Register::Basepri, Register::Primask] {
        let mut paths = Paths { code, register, functions: BTreeMap::new(), open: BTreeSet::new() };
        for (place, instruction) in all.iter().enumerate() {
            let opened = match flow(instruction) {
                // A function that returns with interrupts masked.
                Flow::Call(target) => paths.function(target)?.depths.iter().any(|&depth| depth > 0).then_some(target),
                _ => (register.change(instruction) > 0).then_some(instruction.address),
            };
            let Some(opened) = opened else { continue };
            let walk = paths.walk(instruction, true)?;
            let returns_masked = walk.time.is_none() && walk.returns;
            if returns_masked {
                // Its callers have the section.
                continue;
            }
            let mask = match register {
                Register::Primask => Mask::All,
                Register::Basepri if opened == instruction.address => raised_to(code, &all, place),
                Register::Basepri => called_mask(code, &all, opened),
            };
            let function = code.function(instruction.address);
            sections.push(Section { address: instruction.address, function, mask, time: walk.time });
        }
    }
    sections.sort_by_key(|section| section.address);
    Ok(sections)
}

/// The priority that an instruction raises BASEPRI to, if its function's
/// instructions before it tell.
fn raised_to(code: &Code, all: &[Instruction], place: usize) -> Mask {
    let mask = || {
        let raised = all.get(place)?;
        let start = code.function_start(raised.address)?;
        let first = all.partition_point(|instruction| instruction.address < start);
        constant(all.get(first..place)?, raised.operands.rsplit(' ').next()?)
    };
    // The upper four bits of a byte, 0 being the highest priority.
    mask().map_or(Mask::Unknown, |mask| Mask::Priority(16 - mask / 16))
}

/// The priority of a function that returns with BASEPRI raised.
fn called_mask(code: &Code, all: &[Instruction], function: u32) -> Mask {
    let first = all.partition_point(|instruction| instruction.address < function);
    let own = all.iter().enumerate().skip(first);
    let mut own = own.take_while(|(_, instruction)| code.function_start(instruction.address) == Some(function));
    let raised = own.find(|(_, instruction)| Register::Basepri.change(instruction) > 0);
    raised.map_or(Mask::Unknown, |(place, _)| raised_to(code, all, place))
}

/// The register that masks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Register {
    Basepri,
    /// PRIMASK and FAULTMASK.
    Primask,
}

impl Register {
    /// +1 for an instruction that masks, -1 for one that puts back.
    fn change(self, instruction: &Instruction) -> i32 {
        match (self, instruction.written_register()) {
            (Self::Basepri, Some("basepri_max")) => 1,
            (Self::Basepri, Some("basepri")) => -1,
            (Self::Primask, Some("primask" | "faultmask")) if instruction.name == "cpsid" => 1,
            (Self::Primask, Some("primask" | "faultmask")) => -1,
            (Self::Primask, _) if instruction.name == "cpsie" => -1,
            _ => 0,
        }
    }
}

/// A function, called.
#[derive(Clone, Debug, Default)]
struct Called {
    time: Time,
    /// Changes of the number of open sections until it returns; empty if it does not return.
    depths: BTreeSet<i32>,
}

/// Result of a walk.
struct Walk {
    /// Longest time from its start to its ends; `None` if it has no end.
    time: Option<Time>,
    /// The depths at which it ended.
    depths: BTreeSet<i32>,
    /// True if the function returns within it.
    returns: bool,
}

/// Follows paths, and remembers functions.
struct Paths<'a> {
    code: &'a Code,
    register: Register,
    functions: BTreeMap<u32, Called>,
    /// Functions that are being followed: one that calls itself.
    open: BTreeSet<u32>,
}

impl Paths<'_> {
    /// A function from its first instruction to its returns.
    fn function(&mut self, address: u32) -> Result<Called, String> {
        if let Some(called) = self.functions.get(&address) {
            return Ok(called.clone());
        }
        if !self.open.insert(address) {
            let time = Time { has_loop: true, ..Time::default() };
            return Ok(Called { time, depths: BTreeSet::from([0]) });
        }
        let first = self.code.instruction(address)?;
        let walk = self.walk(&first, false)?;
        let called = Called { time: walk.time.unwrap_or_default(), depths: walk.depths };
        self.open.remove(&address);
        self.functions.insert(address, called.clone());
        Ok(called)
    }

    /// Follows all paths from an instruction on: those of a function to its returns, or those of a
    /// section that begins there to its ends.
    fn walk(&mut self, first: &Instruction, is_section: bool) -> Result<Walk, String> {
        let mut graph = Graph::default();
        let mut numbers = BTreeMap::from([((first.address, 0), graph.add(0))]);
        let mut pending = vec![(first.address, 0)];
        let (mut ends, mut through_pointer) = (Vec::new(), Vec::new());
        let (mut depths, mut returns, mut called_loop) = (BTreeSet::new(), false, Vec::new());
        while let Some((address, depth)) = pending.pop() {
            // After the call of a function that does not return there may be data.
            let Ok(instruction) = self.code.instruction(address) else { continue };
            let after = depth + self.register.change(&instruction);
            let (mut next, mut branches, mut call) = (vec![(instruction.next(), after)], false, None);
            let mut is_return = false;
            match flow(&instruction) {
                Flow::On => {}
                Flow::Branch { target, is_conditional } => {
                    branches = true;
                    if !is_conditional {
                        next.clear();
                    }
                    next.push((target, after));
                }
                Flow::Call(target) => {
                    branches = true;
                    let called = self.function(target)?;
                    next = called.depths.iter().map(|more| (instruction.next(), depth + more)).collect();
                    call = Some(called);
                }
                Flow::ComputedCall => branches = true,
                Flow::Return { is_conditional } => {
                    (branches, is_return) = (true, true);
                    if !is_conditional {
                        next.clear();
                    }
                }
                Flow::Computed => {
                    branches = true;
                    next = self.code.table_targets(&instruction).into_iter().map(|target| (target, after)).collect();
                    // Anything but a table is the call of a function in place of a return.
                    is_return = next.is_empty();
                }
                Flow::Trap => next.clear(),
            }
            let Some(&number) = numbers.get(&(address, depth)) else { continue };
            let own = cycles(&instruction, branches) + call.as_ref().map_or(0, |called| called.time.cycles);
            graph.set_cost(number, own);
            let is_pointer =
                flow(&instruction) == Flow::ComputedCall || flow(&instruction) == Flow::Computed && is_return;
            if is_pointer || call.as_ref().is_some_and(|called| called.time.calls_pointer) {
                through_pointer.push(number);
            }
            if call.as_ref().is_some_and(|called| called.time.has_loop) {
                called_loop.push(number);
            }
            // A store, or the call of a function that puts the mask back.
            let closes = is_section && depth > 0 && next.iter().any(|&(_, depth)| depth <= 0);
            if closes {
                ends.push(number);
                continue;
            }
            if is_return {
                returns = true;
                if !is_section {
                    ends.push(number);
                    depths.insert(after);
                }
            }
            // A task that ends puts the mask back without raising it before, as often as
            // its caller loops.
            for node in next.into_iter().map(|(address, depth)| (address, depth.clamp(-1, MAX_DEPTH))) {
                let to = *numbers.entry(node).or_insert_with(|| {
                    pending.push(node);
                    graph.add(0)
                });
                graph.connect(number, to);
            }
        }
        let leads = graph.leading_to(&ends);
        let time = graph.longest(&ends).map(|longest| Time {
            cycles: longest.cost,
            has_loop: longest.has_loop || called_loop.iter().any(|&number| leads[number]),
            calls_pointer: through_pointer.iter().any(|&number| leads[number]),
        });
        Ok(Walk { time, depths, returns })
    }
}
