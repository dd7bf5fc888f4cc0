//! Estimate of events a second from instructions, until a board has been measured.

/// Core clock of the STM32F405 and F407, Hz.
const CLOCK_HZ: f64 = 168e6;

/// Cycles from the interrupt to its handler's first instruction, and from its return to the code
/// below (Cortex-M4 technical reference manual, exceptions).
const ENTRY_AND_EXIT_CYCLES: f64 = 12.0 + 10.0;

/// Cycles an instruction. Klipper's step, 33 instructions, takes 46 cycles on an STM32F407 by
/// its own benchmark.
const CYCLES_PER_INSTRUCTION: f64 = 1.4;

/// Cycles that a square root and a division take beyond two such instructions: 14 each (the same
/// manual, floating point).
const ROOT_AND_DIVISION_MORE_CYCLES: f64 = 2.0 * (14.0 - CYCLES_PER_INSTRUCTION);

/// Share of the processor, percent, that `per_s` steps a second take. Each is solved for by a root
/// and a division, and is a separate interrupt.
pub fn solved_steps_percent(per_s: f64, instructions: f64, interrupt_instructions: f64) -> f64 {
    let cycles = ROOT_AND_DIVISION_MORE_CYCLES
        + ENTRY_AND_EXIT_CYCLES
        + CYCLES_PER_INSTRUCTION * (instructions + interrupt_instructions);
    100.0 * per_s * cycles / CLOCK_HZ
}

/// Share of the processor, percent, of something that is done `per_s` times a second.
pub fn percent(per_s: f64, instructions: f64) -> f64 {
    100.0 * per_s * CYCLES_PER_INSTRUCTION * instructions / CLOCK_HZ
}

/// Maximum of events a second for a processor that only steps and enters its handler anew for each.
pub fn events_per_s(instructions: f64) -> f64 {
    CLOCK_HZ / (ENTRY_AND_EXIT_CYCLES + CYCLES_PER_INSTRUCTION * instructions)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cycles_an_instruction_are_those_of_klippers_benchmark() {
        // 33 instructions a step, 3652 k steps a second, without entering anew for each.
        assert!((CLOCK_HZ / (CYCLES_PER_INSTRUCTION * 33.0) / 3_652e3 - 1.0).abs() < 0.01);
    }

    #[test]
    fn shares_of_the_processor_are_in_percent() {
        // 22 to enter and leave, 25.2 for root and division, 1.4 for each of 120: 215.2 cycles, a
        // 168,000th of a second's each.
        assert!((solved_steps_percent(1_000.0, 86.0, 34.0) - 0.1 * 215.2 / 168.0).abs() < 1e-9);
        assert!((percent(1_000.0, 120.0) - 0.1).abs() < 1e-9);
    }

    #[test]
    fn entering_costs_22_cycles() {
        assert_eq!(events_per_s(100.0), 168e6 / 162.0);
    }
}
