//! Cycles of the Cortex-M4's instructions, every choice at its dearest (technical reference manual
//! r0p1, table 3-1; of the floating-point unit, table 7-1).

use crate::code::Instruction;

/// Maximum cycles of an instruction, without waiting for flash or a peripheral. `branches`:
/// execution continues elsewhere.
pub fn cycles(instruction: &Instruction, branches: bool) -> u32 {
    let name = instruction.name.as_str();
    let is_one_of = |starts: &[&str]| starts.iter().any(|start| name.starts_with(start));
    let registers = || instruction.operands.split_once('{').map_or(1, |(_, list)| list.split(',').count() as u32);
    // The pipeline takes up to three cycles to fill.
    let refill = if branches { 3 } else { 0 };
    let own = if is_one_of(&["push", "pop", "ldm", "stm", "vpush", "vpop", "vldm", "vstm"]) {
        1 + registers()
    } else if is_one_of(&["ldrd", "strd", "vfma", "vfms", "vfnma", "vfnms", "vmla", "vmls", "vnmla", "vnmls"]) {
        3
    } else if is_one_of(&["ldr", "str", "mrs", "msr", "vldr", "vstr", "mla", "mls", "vmrs", "vmsr"]) {
        2
    } else if is_one_of(&["isb", "dsb", "dmb"]) {
        4
    } else if is_one_of(&["udiv", "sdiv"]) {
        12
    } else if is_one_of(&["vdiv", "vsqrt"]) {
        14
    } else {
        1
    };
    own + refill
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instructions_take_the_cycles_of_the_manual() {
        for (name, operands, branches, expected) in [
            ("movw", "r0, #1", false, 1),
            ("ldr", "r0, [r1]", false, 2),
            ("ldrd", "r0, r1, [r2]", false, 3),
            ("push", "{r4, r6, r7, lr}", false, 5),
            ("pop", "{r4, r6, r7, pc}", true, 8),
            ("bmi", "#0x108", true, 4),
            ("bmi", "#0x108", false, 1),
            ("udiv", "r0, r1, r2", false, 12),
            ("vsqrt.f32", "s0, s1", false, 14),
            ("vpush", "{d8, d9}", false, 3),
        ] {
            let instruction =
                Instruction { address: 0x100, length: 2, name: name.to_owned(), operands: operands.to_owned() };
            assert_eq!(cycles(&instruction, branches), expected, "{name} {operands}");
        }
    }
}
