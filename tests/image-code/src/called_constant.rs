//! Follows a function's address in a register: tells whether it is only called, or may be kept.

use std::collections::BTreeSet;

use crate::code::{Code, Instruction};
use crate::flow::{Flow, flow};

/// Effect of an instruction on a register's value.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Use {
    /// The value is left alone.
    No,
    /// The value is copied to another register.
    Copied(String),
    /// The value is called.
    Call,
    /// Another value takes its place.
    Replaced,
    /// The value is read.
    Read,
}

/// Registers that a call may read and that it leaves changed.
const OF_CALLS: [&str; 5] = ["r0", "r1", "r2", "r3", "ip"];

/// Follows the value that an instruction has put in a register, and returns `true` if it is called
/// on some path and neither read nor returned on any. The compiler calls a function in this way if
/// it calls it often, since that is shorter. An outlined function is followed as part of its
/// caller; `back` is its return address, if the instruction is in one.
pub fn is_only_called(code: &Code, setting: &Instruction, register: &str, back: Option<u32>) -> bool {
    let (mut pending, mut seen, mut is_called) =
        (vec![(setting.next(), register.to_owned(), back)], BTreeSet::new(), false);
    while let Some(place) = pending.pop() {
        if !seen.insert(place.clone()) {
            continue;
        }
        let (address, register, back) = place;
        let is_kept = !OF_CALLS.contains(&register.as_str());
        let Ok(instruction) = code.instruction(address) else { return false };
        let found = use_of(&instruction, &register);
        let calls = found == Use::Call;
        is_called |= calls;
        match found {
            Use::Read => return false,
            Use::Replaced => continue,
            Use::Copied(copy) => pending.push((instruction.next(), copy, back)),
            Use::Call | Use::No => {}
        }
        let next = instruction.next();
        match (flow(&instruction), back) {
            (Flow::On, _) => pending.push((next, register, back)),
            (Flow::Branch { target, is_conditional }, _) => {
                if is_conditional {
                    pending.push((next, register.clone(), back));
                }
                let is_near = code.function_start(target) == code.function_start(address);
                match back {
                    _ if is_near || code.is_outlined(target) => pending.push((target, register, back)),
                    // The last call of an outlined function, which returns for it.
                    Some(back) if is_kept => pending.push((back, register, None)),
                    _ => return false,
                }
            }
            (Flow::Call(target), None) if code.is_outlined(target) => pending.push((target, register, Some(next))),
            // A call may have read the registers that it leaves changed.
            (Flow::Call(_) | Flow::ComputedCall, _) => {
                if !is_kept && !calls {
                    return false;
                }
                pending.push((next, register, back));
            }
            (Flow::Return { is_conditional: false }, Some(back)) => pending.push((back, register, None)),
            (Flow::Computed, Some(back)) if calls && is_kept => pending.push((back, register, None)),
            // Returns with the value still in the register.
            (Flow::Return { .. }, _) => return false,
            (Flow::Trap, _) => {}
            (Flow::Computed, _) => {
                let targets = code.table_targets(&instruction);
                if targets.is_empty() {
                    return false;
                }
                pending.extend(targets.into_iter().map(|target| (target, register.clone(), back)));
            }
        }
    }
    is_called
}

/// Returns `true` for `d8` and `s16`, and `false` for `sb`.
fn is_of_floating_point(register: &str) -> bool {
    let number = register.trim().strip_prefix(['d', 's']);
    number.is_some_and(|number| number.parse::<u8>().is_ok())
}

fn use_of(instruction: &Instruction, register: &str) -> Use {
    let Instruction { name, operands, .. } = instruction;
    let names = |text: &str| text.split(|char: char| !char.is_ascii_alphanumeric()).any(|word| word == register);
    if (name == "blx" || name == "bx") && operands == register {
        return Use::Call;
    }
    if let Some((copy, copied)) = operands.split_once(", ")
        && name == "mov"
        && copied == register
    {
        return if copy == register { Use::No } else { Use::Copied(copy.to_owned()) };
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
        // Without a condition; one with a condition leaves the value at times, and
        // counts as a read.
        "ldr" | "ldrb" | "ldrh" | "mov" | "movs" | "movw" | "adr" | "add" | "adds" | "sub" | "subs" => {
            first == register && !names(rest)
        }
        // Reads the floating-point unit, which has none of these names.
        "vmov" => rest.rsplit(',').next().is_some_and(is_of_floating_point),
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
        assert_eq!(of("bx", "r5"), Use::Call);
        assert_eq!(of("mov", "r0, r5"), Use::Copied("r0".to_owned()));
        assert_eq!(of("bl", "#0x8000108"), Use::No);
        assert_eq!(of("blx", "r4"), Use::No);
        for (name, operands) in [
            ("pop", "{r4, r5, pc}"),
            ("mov", "r5, r6"),
            ("ldrd", "r4, r5, [r0]"),
            ("ldrd", "r5, r0, [sp, #0xd8]"),
            ("ldr", "r5, [r4, #8]"),
            ("movs", "r5, #1"),
            ("vmov", "r5, r6, d10"),
            ("vmov", "r4, r5, d10"),
            ("vmov", "r5, s1"),
        ] {
            assert_eq!(of(name, operands), Use::Replaced, "{name} {operands}");
        }
        for (name, operands) in [
            ("str", "r5, [sp, #4]"),
            ("ldr", "r5, [r5, #4]"),
            ("ldr", "r0, [r1, r5]"),
            ("push", "{r4, r5, lr}"),
            ("moveq", "r5, r6"),
            ("movt", "r5, #0x801"),
            ("ldrd", "r4, r5, [r5]"),
            ("ldrd", "r0, r1, [r5, #4]"),
            ("ldm", "r0, {r4-r6}"),
            ("vmov", "d10, r5, r6"),
            ("vmov", "d10, r5, sb"),
            ("vmov", "s1, r5"),
        ] {
            assert_eq!(of(name, operands), Use::Read, "{name} {operands}");
        }
        assert_eq!(of("ldr", "r0, [r1, #0x50]"), Use::No);
    }
}
