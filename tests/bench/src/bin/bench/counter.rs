//! The clock that counts instructions.

use cortex_m::peripheral::NVIC;
use ferrostep_stm32f4_board::motion_clock::MotionClock;

use ferrostep_bench::span::{Count, Counter, UNANSWERED};

/// Starts a counter of executed instructions.
///
/// # Errors
/// The clock does not count a handler of known length correctly.
pub fn start(clock: MotionClock) -> Result<Counter, &'static str> {
    let counter = Counter::new(Count::Instructions(clock));
    // SAFETY: nothing relies on its being masked, and its handler touches nothing.
    unsafe { NVIC::unmask(UNANSWERED) };
    let known = counter.count_handler(UNANSWERED);
    NVIC::mask(UNANSWERED);
    if known == KNOWN_INSTRUCTIONS { Ok(counter) } else { Err("a handler of known length is counted wrongly") }
}

/// Instructions of the handler: ten NOPs and the return.
const KNOWN_INSTRUCTIONS: u32 = 11;

/// A handler of known length, of [`UNANSWERED`].
// SAFETY: the name is that of the vector, which is what it is for; it takes no argument and
// changes no register.
#[unsafe(no_mangle)]
#[unsafe(naked)]
extern "C" fn TIM4() {
    core::arch::naked_asm!("nop", "nop", "nop", "nop", "nop", "nop", "nop", "nop", "nop", "nop", "bx lr")
}
