//! Whether a function's address in a register is called and nothing else.

use std::collections::BTreeSet;

use crate::code::{Code, Instruction};
use crate::flow::{Flow, flow};

/// What an instruction does with a register's value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Use {
    /// It is left alone.
    No,
    /// It is called.
    Call,
    /// Another value takes its place.
    Replaced,
    /// It is read.
    Read,
}

/// Registers that a call may read and that it leaves changed.
const OF_CALLS: [&str; 5] = ["r0", "r1", "r2", "r3", "ip"];

/// Whether the value that an instruction has put in this register is called, and neither read nor returned, wherever execution goes
/// from there. The compiler calls a function so that it calls often, since that is shorter.
pub fn is_only_called(code: &Code, setting: &Instruction, register: &str) -> bool {
    let (mut pending, mut seen, mut is_called) = (vec![setting.next()], BTreeSet::new(), false);
    while let Some(address) = pending.pop() {
        if !seen.insert(address) {
            continue;
        }
        let Ok(instruction) = code.instruction(address) else { return false };
        match use_of(&instruction, register) {
            Use::Read => return false,
            Use::Replaced => continue,
            Use::Call => is_called = true,
            Use::No => {}
        }
        match flow(&instruction) {
            Flow::On => pending.push(instruction.next()),
            Flow::Branch { target, is_conditional } => {
                if code.function_start(target) != code.function_start(setting.address) {
                    return false;
                }
                pending.push(target);
                if is_conditional {
                    pending.push(instruction.next());
                }
            }
            // What a call leaves changed it may have read before.
            Flow::Call(_) | Flow::ComputedCall => {
                if OF_CALLS.contains(&register) && use_of(&instruction, register) != Use::Call {
                    return false;
                }
                pending.push(instruction.next());
            }
            // With the value still in the register.
            Flow::Return { .. } => return false,
            Flow::Trap => {}
            Flow::Computed => {
                let targets = code.table_targets(&instruction);
                if targets.is_empty() {
                    return false;
                }
                pending.extend(targets);
            }
        }
    }
    is_called
}

fn use_of(instruction: &Instruction, register: &str) -> Use {
    let Instruction { name, operands, .. } = instruction;
    let names = |text: &str| text.split(|char: char| !char.is_ascii_alphanumeric()).any(|word| word == register);
    if name == "blx" && operands == register {
        return Use::Call;
    }
    let is_range = |text: &str| text.contains('-') && text.contains('{');
    if is_range(operands) {
        return Use::Read;
    }
    if !names(operands) {
        return Use::No;
    }
    let (first, rest) = operands.split_once(',').unwrap_or((operands, ""));
    let replaces = match name.as_str() {
        "pop" => true,
        // Without a condition; one with a condition leaves the value at times, and counts as a read.
        "ldr" | "ldrb" | "ldrh" | "mov" | "movs" | "movw" | "adr" | "add" | "adds" | "sub" | "subs" => {
            first == register && !names(rest)
        }
        // Two registers at once.
        "ldrd" => operands.split_once('[').is_some_and(|(loaded, address)| names(loaded) && !names(address)),
        _ => false,
    };
    if replaces { Use::Replaced } else { Use::Read }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_instructions_do_with_a_register() {
        let of = |name: &str, operands: &str| {
            use_of(&Instruction { address: 0, length: 2, name: name.to_owned(), operands: operands.to_owned() }, "r5")
        };
        assert_eq!(of("blx", "r5"), Use::Call);
        assert_eq!(of("bl", "#0x8000108"), Use::No);
        assert_eq!(of("blx", "r4"), Use::No);
        for (name, operands) in [
            ("pop", "{r4, r5, pc}"),
            ("mov", "r5, r6"),
            ("ldrd", "r4, r5, [r0]"),
            ("ldrd", "r5, r0, [sp, #0xd8]"),
            ("ldr", "r5, [r4, #8]"),
            ("movs", "r5, #1"),
        ] {
            assert_eq!(of(name, operands), Use::Replaced, "{name} {operands}");
        }
        for (name, operands) in [
            ("mov", "r0, r5"),
            ("str", "r5, [sp, #4]"),
            ("ldr", "r5, [r5, #4]"),
            ("ldr", "r0, [r1, r5]"),
            ("push", "{r4, r5, lr}"),
            ("moveq", "r5, r6"),
            ("movt", "r5, #0x801"),
            ("ldrd", "r4, r5, [r5]"),
            ("ldrd", "r0, r1, [r5, #4]"),
            ("ldm", "r0, {r4-r6}"),
        ] {
            assert_eq!(of(name, operands), Use::Read, "{name} {operands}");
        }
        assert_eq!(of("ldr", "r0, [r1, #0x50]"), Use::No);
    }
}
