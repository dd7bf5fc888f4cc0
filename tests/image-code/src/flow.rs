//! Destinations of an instruction.

use crate::code::Instruction;

/// Flow of control after an instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flow {
    /// Continues with the next instruction.
    On,
    /// Jumps to another instruction, and if there is a condition also continues with the next one.
    Branch {
        /// Address of the other instruction.
        target: u32,
        /// True if it may continue with the next one instead.
        is_conditional: bool,
    },
    /// Calls a function, which returns.
    Call(u32),
    /// Calls a function whose address is computed, which returns.
    ComputedCall,
    /// Returns to the caller.
    Return {
        /// True if it may continue with the next one instead.
        is_conditional: bool,
    },
    /// Jumps to an address that is computed.
    Computed,
    /// Ends in the core's hard fault, without a return: a check that has failed.
    Trap,
}

/// Names of conditions.
const CONDITIONS: [&str; 16] =
    ["eq", "ne", "hs", "cs", "lo", "cc", "mi", "pl", "vs", "vc", "hi", "ls", "ge", "lt", "gt", "le"];

/// Returns `Some(true)` if `name` is `base` with a condition, `Some(false)` if it has none.
fn with_condition(name: &str, base: &str) -> Option<bool> {
    match name.strip_prefix(base)? {
        "" => Some(false),
        condition => CONDITIONS.contains(&condition).then_some(true),
    }
}

/// Flow of control after this instruction.
pub fn flow(instruction: &Instruction) -> Flow {
    let (name, operands) = (instruction.name.as_str(), instruction.operands.as_str());
    if name == "udf" || name == "trap" {
        return Flow::Trap;
    }
    if ["bl", "blx"].iter().any(|base| with_condition(name, base).is_some()) && name != "bls" && name != "blt" {
        return instruction.target().map_or(Flow::ComputedCall, Flow::Call);
    }
    if let Some(is_conditional) = with_condition(name, "bx") {
        return if operands == "lr" { Flow::Return { is_conditional } } else { Flow::Computed };
    }
    if name == "cbz" || name == "cbnz" {
        return instruction.target().map_or(Flow::Computed, |target| Flow::Branch { target, is_conditional: true });
    }
    if let Some(is_conditional) = with_condition(name, "b") {
        return instruction.target().map_or(Flow::Computed, |target| Flow::Branch { target, is_conditional });
    }
    if let Some(is_conditional) = with_condition(name, "pop") {
        return if operands.contains("pc") { Flow::Return { is_conditional } } else { Flow::On };
    }
    let pops_return = name.starts_with("ldm") && operands.contains("pc");
    let loads_return = name.starts_with("ldr") && operands.starts_with("pc, [sp]");
    if pops_return || loads_return {
        return Flow::Return { is_conditional: false };
    }
    // Table branches, and everything else that writes the program counter.
    if name.starts_with("tb") || operands.split(',').next().is_some_and(|first| first.trim() == "pc") {
        return Flow::Computed;
    }
    Flow::On
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flow_of(name: &str, operands: &str) -> Flow {
        flow(&instruction(name, operands))
    }

    fn instruction(name: &str, operands: &str) -> Instruction {
        Instruction { address: 0x100, length: 2, name: name.to_owned(), operands: operands.to_owned() }
    }

    #[test]
    fn branches_calls_and_returns_are_told_apart() {
        let branch = |is_conditional| Flow::Branch { target: 0x108, is_conditional };
        assert_eq!(flow_of("b", "#0x108"), branch(false));
        assert_eq!(flow_of("bls", "#0x108"), branch(true));
        assert_eq!(flow_of("blt", "#0x108"), branch(true));
        assert_eq!(flow_of("cbnz", "r0, #0x108"), branch(true));
        assert_eq!(flow_of("bl", "#0x108"), Flow::Call(0x108));
        assert_eq!(flow_of("blx", "r3"), Flow::ComputedCall);
        assert_eq!(flow_of("bx", "lr"), Flow::Return { is_conditional: false });
        assert_eq!(flow_of("bxeq", "lr"), Flow::Return { is_conditional: true });
        assert_eq!(flow_of("bx", "r3"), Flow::Computed);
        assert_eq!(flow_of("pop", "{r4, pc}"), Flow::Return { is_conditional: false });
        assert_eq!(flow_of("pop", "{r4, r5}"), Flow::On);
        assert_eq!(flow_of("ldr", "pc, [sp], #4"), Flow::Return { is_conditional: false });
        assert_eq!(flow_of("ldr", "pc, [r0, r1, lsl #2]"), Flow::Computed);
        assert_eq!(flow_of("tbb", "[pc, r0]"), Flow::Computed);
        assert_eq!(flow_of("bic", "r0, r1"), Flow::On);
        assert_eq!(flow_of("bfi", "r0, r1, #4, #8"), Flow::On);
    }
}
