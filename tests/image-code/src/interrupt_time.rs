//! Longest time of the step interrupt, from its instructions.
//!
//! The reload value that it stores at one update rules the gap after the next, so the store must
//! arrive before that one (RM0090 18.3.1: with ARPE set, the preload register becomes the shadow
//! register at each update event). Three bounds follow, each for a gap of a given length:
//!
//! - the store arrives within one gap, although every line of flash has to be fetched;
//! - once flash is in the cache, the whole interrupt fits into one gap, so that lateness dies out;
//! - an interrupt with an empty cache and the next one's store together fit into two gaps.
//!
//! The costs are the Cortex-M4's (`cycles`). Sections that other code of the same or a higher
//! priority could put in front are not in them: the firmware has none while steps are played, which
//! the tests `masks` and `step_interrupt` hold it to.

use std::collections::BTreeSet;
use std::fmt;

use crate::code::{Code, Instruction};
use crate::cycles::cycles;
use crate::flow::{Flow, flow};

/// Cycles from the update to the handler's first instruction, without wait states (technical
/// reference manual, 3.9.1).
const ENTRY_CYCLES: u32 = 12;

/// Cycles from the handler's return to the interrupted code.
const EXIT_CYCLES: u32 = 10;

/// Cycles that fetching 16 bytes of flash, or the vector, adds when they are not in the cache: five
/// wait states (RM0090, table 10: 168 MHz at 3.3 V).
const FLASH_CYCLES: u32 = 5;

/// Bytes of a line of flash.
const FLASH_LINE: u32 = 16;

/// Cycles by which a store to the timer delays the next access to the bus, or its own arrival: two
/// cycles of a bus at a quarter of the core's clock, and their alignment to it.
const TIMER_STORE_CYCLES: u32 = 12;

/// Cycles by which a store to a port does the same: its bus has the core's clock, and a pin toggles
/// every two cycles at the fastest (DS8626, table 50).
const PORT_STORE_CYCLES: u32 = 2;

/// TIM2's number (RM0090, table 61): the step interrupt.
pub const STEP_TIMER: u32 = 28;

/// The handler that replaces it while M798 measures, and calls it.
pub const MEASURED: &str = "step_interrupt_measured";

/// Offset of a timer's status register, which the handler clears first.
const STATUS: &str = "#0x10";

/// Offset of a timer's reload register.
const RELOAD: &str = "#0x2c";

/// The first of the bounds.
const LATE_RELOAD: &str = "the reload value arrives after the next update";

/// Far more instructions than a path through the handler has.
const MAX_INSTRUCTIONS: usize = 400;

/// Cycles of the core, the most that any path takes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cycles {
    /// Cycles if all instructions are in the cache.
    pub cached: u32,
    /// Cycles if no instruction is in the cache.
    pub uncached: u32,
}

impl Cycles {
    fn most(self, other: Self) -> Self {
        Self { cached: self.cached.max(other.cached), uncached: self.uncached.max(other.uncached) }
    }
}

/// The step interrupt's times, from the update that calls it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InterruptTime {
    /// Time to the arrival of its reload value.
    pub to_reload: Cycles,
    /// Time to the continuation of the interrupted code.
    pub whole: Cycles,
    /// The reload store's place: instructions from the first to it, at the most.
    pub reload_instructions: usize,
}

impl fmt::Display for InterruptTime {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { to_reload, whole, reload_instructions } = self;
        write!(
            out,
            "reload stored by instruction {reload_instructions}, arrives after {} cycles ({} with flash to be fetched), whole \
             interrupt {} ({})",
            to_reload.cached, to_reload.uncached, whole.cached, whole.uncached
        )
    }
}

/// Compares the step interrupt of an image, and the one that measures it, with the shortest gap
/// between two updates, cycles of the core. Returns their times.
///
/// The one that measures only has to store its reload value in time with its instructions in the
/// cache: it counts afterwards, and M798 is a tool for the bench, not for a print.
///
/// # Errors
/// A handler is missing, cannot be followed or takes too long; says which bound is broken,
/// with the figures.
pub fn check(code: &Code, gap_cycles: u32) -> Result<[InterruptTime; 2], String> {
    let measured = code.functions_named(MEASURED);
    let [measured] = measured[..] else {
        return Err(format!("not one function is called {MEASURED}, but {}", measured.len()));
    };
    let mut times = [InterruptTime::default(); 2];
    for (time, handler) in times.iter_mut().zip([code.handler(STEP_TIMER)?, measured]) {
        *time = InterruptTime::of(code, handler)?;
    }
    let [time, measured] = times;
    time.fits(gap_cycles).map_err(|error| format!("the step interrupt: {error}"))?;
    if measured.to_reload.cached > gap_cycles {
        let error = measured.broken(gap_cycles, LATE_RELOAD);
        return Err(format!("the step interrupt measured (M798): {error}"));
    }
    Ok(times)
}

impl InterruptTime {
    /// Follows every path through the handler of an interrupt, and through functions that it calls.
    ///
    /// # Errors
    /// The handler does not clear a timer's status register and store to its reload register, has a
    /// loop, or leads to a place that cannot be computed.
    pub fn of(code: &Code, handler: u32) -> Result<Self, String> {
        let mut time = Self::default();
        follow(code, Path::new(handler), &mut time)?;
        if time.reload_instructions == 0 {
            return Err(format!("{}: no store to the timer's reload register was found", code.function(handler)));
        }
        Ok(time)
    }

    /// Holds the times against the shortest gap between two updates, cycles of the core.
    ///
    /// # Errors
    /// Describes the broken bound, with the figures.
    pub fn fits(&self, gap_cycles: u32) -> Result<(), String> {
        let Self { to_reload, whole, .. } = self;
        if to_reload.uncached > gap_cycles {
            Err(self.broken(gap_cycles, LATE_RELOAD))
        } else if whole.cached > gap_cycles {
            Err(self.broken(gap_cycles, "the interrupt takes longer than a gap"))
        } else if whole.uncached + to_reload.cached > 2 * gap_cycles {
            let bound = "after an interrupt with flash to be fetched, the next one's reload value arrives too late";
            Err(self.broken(gap_cycles, bound))
        } else {
            Ok(())
        }
    }

    fn broken(&self, gap_cycles: u32, bound: &str) -> String {
        format!(
            "{bound}: {self}, and the shortest gap is {gap_cycles} cycles. Shorten the interrupt, or raise MIN_GAP_TICKS \
             and with it the pulses and the minimum_event_interval_us of the profiles"
        )
    }
}

/// A path through the handler, up to some instruction.
#[derive(Clone)]
struct Path {
    address: u32,
    instructions: usize,
    cycles: u32,
    lines: BTreeSet<u32>,
    seen: BTreeSet<u32>,
    returns: Vec<u32>,
    /// The register that holds the timer's address, as the store to its status register has it.
    timer: Option<String>,
    is_reloaded: bool,
}

impl Path {
    fn new(address: u32) -> Self {
        Self {
            address,
            instructions: 0,
            cycles: 0,
            lines: BTreeSet::new(),
            seen: BTreeSet::new(),
            returns: Vec::new(),
            timer: None,
            is_reloaded: false,
        }
    }

    /// The time up to here, with some cycles more.
    fn time(&self, more: u32) -> Cycles {
        let cached = ENTRY_CYCLES + self.cycles + more;
        // The vector is fetched from flash as well.
        Cycles { cached, uncached: cached + (1 + self.lines.len() as u32) * FLASH_CYCLES }
    }

    /// Takes an instruction, which may branch, into account.
    fn pass(&mut self, instruction: &Instruction, branches: bool, time: &mut InterruptTime) {
        self.instructions += 1;
        self.cycles += cycles(instruction, branches);
        let last_byte = instruction.next() - 1;
        self.lines.extend([instruction.address / FLASH_LINE, last_byte / FLASH_LINE]);
        let Some((base, offset)) = stored_to(instruction) else { return };
        if self.timer.is_none() && offset == STATUS {
            self.timer = Some(base.to_owned());
        }
        if self.timer.as_deref() == Some(base) {
            self.cycles += TIMER_STORE_CYCLES;
        } else if self.timer.is_some() && !self.is_reloaded {
            // Up to the reload value it stores to the timer and to ports only.
            self.cycles += PORT_STORE_CYCLES;
        }
        if self.timer.as_deref() == Some(base) && offset == RELOAD && !self.is_reloaded {
            self.is_reloaded = true;
            time.to_reload = time.to_reload.most(self.time(0));
            time.reload_instructions = time.reload_instructions.max(self.instructions);
        }
    }
}

/// Base register and offset of a single store.
fn stored_to(instruction: &Instruction) -> Option<(&str, &str)> {
    let is_store = instruction.name == "str";
    let (_, place) = instruction.operands.split_once('[').filter(|_| is_store)?;
    let place = place.strip_suffix(']')?;
    Some(place.split_once(", ").unwrap_or((place, "#0")))
}

/// Follows a path to its ends.
fn follow(code: &Code, mut path: Path, time: &mut InterruptTime) -> Result<(), String> {
    loop {
        let instruction = code.instruction(path.address)?;
        let at = || format!("{instruction}   in {}", code.function(path.address));
        if !path.seen.insert(path.address) || path.instructions > MAX_INSTRUCTIONS {
            return Err(format!("a loop: {}", at()));
        }
        let next = instruction.next();
        match flow(&instruction) {
            Flow::On => {
                path.pass(&instruction, false, time);
                path.address = next;
            }
            Flow::Branch { target, is_conditional } => {
                if is_conditional {
                    let mut other = path.clone();
                    other.pass(&instruction, false, time);
                    other.address = next;
                    follow(code, other, time)?;
                }
                path.pass(&instruction, true, time);
                path.address = target;
            }
            Flow::Call(target) => {
                path.pass(&instruction, true, time);
                path.returns.push(next);
                path.address = target;
            }
            Flow::Return { is_conditional: false } => {
                path.pass(&instruction, true, time);
                match path.returns.pop() {
                    Some(address) => path.address = address,
                    None => {
                        time.whole = time.whole.most(path.time(EXIT_CYCLES));
                        return Ok(());
                    }
                }
            }
            Flow::Return { is_conditional: true } | Flow::ComputedCall | Flow::Computed | Flow::Trap => {
                return Err(format!("cannot be followed: {}", at()));
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn instruction(name: &str, operands: &str) -> Instruction {
        Instruction { address: 0x100, length: 2, name: name.to_owned(), operands: operands.to_owned() }
    }

    #[test]
    fn a_store_has_its_base_and_offset() {
        assert_eq!(stored_to(&instruction("str", "r2, [r3, #0x2c]")), Some(("r3", RELOAD)));
        assert_eq!(stored_to(&instruction("str", "r2, [r3]")), Some(("r3", "#0")));
        assert_eq!(stored_to(&instruction("ldr", "r2, [r3]")), None);
    }

    #[test]
    fn each_bound_is_checked() {
        let time = |to_reload: (u32, u32), whole: (u32, u32)| {
            let [to_reload, whole] = [to_reload, whole].map(|(cached, uncached)| Cycles { cached, uncached });
            InterruptTime { to_reload, whole, reload_instructions: 21 }.fits(168)
        };
        assert_eq!(time((90, 168), (168, 246)), Ok(()));
        assert!(time((90, 169), (100, 180)).unwrap_err().contains("arrives after the next update"));
        assert!(time((90, 168), (169, 180)).unwrap_err().contains("longer than a gap"));
        let error = time((90, 168), (168, 247)).unwrap_err();
        assert!(error.contains("with flash to be fetched") && error.contains("168 cycles"), "{error}");
    }
}
