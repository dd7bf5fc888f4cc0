//! The system clock, with every wait bounded: a board with a broken crystal still
//! prints, and reports it.

use cortex_m::peripheral::SCB;
use cortex_m::peripheral::scb::SystemHandler;
use ferrostep_stm32f4::clock_tree::{self, Clock, ClockSource};
use ferrostep_stm32f4::{ClockRegisters, ClockSettings};

use crate::board::{
    APB1_CODE, APB1_HZ, APB2_CODE, APB2_HZ, CORE_HZ, CRYSTAL_HZ, FAMILY, FERROSTEP_PLL, FLASH_WAIT_STATES,
};
use crate::pac::{FLASH, RCC};
use crate::volatile::Volatile;
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::rcc::{Config, Rcc};

/// Maximum number of polls of a flag. A poll takes at least four cycles, so the wait is at least 1
/// ms.
const MAX_LOOKS: u32 = 50_000;

/// Starts the best clock that works, in whatever state a boot loader has left the chip.
///
/// The HAL's own start waits for crystal and PLL without a bound, leaves the voltage scale, the
/// second PLLs and the buses' resets as a boot loader had them, and does not turn clock security on
/// (hazards 1.6, 3.1 and 3.2 in `docs/src/hazards.md`). So this starts the clock first: the HAL's
/// `freeze` then finds every flag set and stores the values that the registers already hold
/// (`config/boards/src/clock.rs` tests that its search finds the same PLL). The HAL's drivers need
/// the value it returns.
pub fn start(rcc: RCC, _flash: &FLASH) -> (Clock, Rcc) {
    let settings = ClockSettings {
        family: FAMILY,
        pll: FERROSTEP_PLL,
        apb1_code: APB1_CODE,
        apb2_code: APB2_CODE,
        flash_wait_states: FLASH_WAIT_STATES,
    };
    // SAFETY: registers of RCC and flash, which are the caller's, and of the power control, which
    // is used before this only. The numbers are within the limits of the manual
    // (`config/boards/src/clock.rs` makes and tests them).
    let registers = unsafe { Volatile::new() };
    let source = clock_tree::start_best(&mut ClockRegisters::start_internal(registers, settings));
    let with_pll =
        |config: Config| config.sysclk(CORE_HZ.Hz()).pclk1(APB1_HZ.Hz()).pclk2(APB2_HZ.Hz()).require_pll48clk();
    let rcc = rcc.freeze(match source {
        ClockSource::Crystal => with_pll(Config::hse(CRYSTAL_HZ.Hz())),
        ClockSource::InternalWithPll => with_pll(Config::hsi()),
        ClockSource::Internal => Config::hsi(),
    });
    let clock = Clock {
        source,
        core: rcc.clocks.hclk(),
        slow_bus: rcc.clocks.pclk1(),
        slow_timers: rcc.clocks.timclk1(),
        fast_bus: rcc.clocks.pclk2(),
        fast_timers: rcc.clocks.timclk2(),
    };
    (clock, rcc)
}

/// Gives SysTick, the timer of the waits, a priority from 1 to 16 in RTIC's sense. After reset it
/// has the highest, and the step interrupt would have to wait for it.
pub fn set_systick_priority(scb: &mut SCB, priority: u8) {
    // Four bits of priority, in the upper half of the byte, 0 the highest.
    let hardware = (16 - priority.clamp(1, 16)) << 4;
    // SAFETY: called in `init`, before any task or critical section by priority exists.
    unsafe { scb.set_priority(SystemHandler::SysTick, hardware) };
}

/// Returns true if a flag comes up within [`MAX_LOOKS`].
pub fn comes_true(mut flag: impl FnMut() -> bool) -> bool {
    (0..MAX_LOOKS).any(|_| flag())
}
