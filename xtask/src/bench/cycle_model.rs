//! From instructions to events a second: an estimate until a board has been measured.

/// Core clock of the STM32F405 and F407, Hz.
const CLOCK_HZ: f64 = 168e6;

/// Cycles from the interrupt to its handler's first instruction, and from its return to the code below (Cortex-M4
/// technical reference manual, exceptions).
const ENTRY_AND_EXIT_CYCLES: f64 = 12.0 + 10.0;

/// Cycles an instruction. Klipper's step, 33 instructions, takes 46 cycles on an STM32F407 by its own benchmark.
const CYCLES_PER_INSTRUCTION: f64 = 1.4;

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
    fn entering_costs_22_cycles() {
        assert_eq!(events_per_s(100.0), 168e6 / 162.0);
    }
}
