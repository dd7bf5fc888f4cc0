//! The system clock, with every wait bounded: a board with a broken crystal still prints, and says so.

use cortex_m::peripheral::SCB;
use cortex_m::peripheral::scb::SystemHandler;
use ferrostep_stm32f4::clock_tree::{self, Clock, ClockSource};
use ferrostep_stm32f4::{ClockRegisters, ClockSettings};

use crate::board::{
    APB1_CODE, APB2_CODE, APB2_HZ, CORE_HZ, FAMILY, FERROSTEP_PLL, FLASH_WAIT_STATES, INTERNAL_HZ, TIMER_HZ,
};
use crate::pac::{FLASH, RCC};
use crate::volatile::Volatile;

/// Most looks at a flag. A look takes at least four cycles, so this waits for 1 ms or longer.
const MOST_LOOKS: u32 = 50_000;

/// Starts the best clock there is, whatever a boot loader has left.
pub fn start(_rcc: &RCC, _flash: &FLASH) -> Clock {
    let settings = ClockSettings {
        family: FAMILY,
        pll: FERROSTEP_PLL,
        apb1_code: APB1_CODE,
        apb2_code: APB2_CODE,
        flash_wait_states: FLASH_WAIT_STATES,
    };
    // SAFETY: registers of RCC and flash, which are the caller's, and of the power control, which is used before this only.
    // The numbers are within the limits of the manual (`boards/src/clock.rs` makes and tests them).
    let registers = unsafe { Volatile::new() };
    let source = clock_tree::start_best(&mut ClockRegisters::start_internal(registers, settings));
    match source {
        ClockSource::Crystal | ClockSource::InternalWithPll => {
            Clock { source, core_hz: CORE_HZ, timer_hz: TIMER_HZ, serial_hz: APB2_HZ }
        }
        ClockSource::Internal => Clock { source, core_hz: INTERNAL_HZ, timer_hz: INTERNAL_HZ, serial_hz: INTERNAL_HZ },
    }
}

/// Gives SysTick, the timer of the waits, a priority from 1 to 16 in RTIC's sense. After reset it has the highest, and
/// the step interrupt would have to wait for it.
pub fn set_systick_priority(scb: &mut SCB, priority: u8) {
    // Four bits of priority, in the upper half of the byte, 0 the highest.
    let hardware = (16 - priority.clamp(1, 16)) << 4;
    // SAFETY: called in `init`, before any task or critical section by priority exists.
    unsafe { scb.set_priority(SystemHandler::SysTick, hardware) };
}

/// Whether a flag comes up within [`MOST_LOOKS`].
pub fn comes_true(mut flag: impl FnMut() -> bool) -> bool {
    (0..MOST_LOOKS).any(|_| flag())
}
