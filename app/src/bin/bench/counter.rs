//! The clock that counts instructions, and interrupts between two of its readings.

use core::hint::black_box;
use core::sync::atomic::{Ordering, compiler_fence};

use cortex_m::peripheral::NVIC;
use ferrostep_stm32f4::motion_clock::MotionClock;
use ferrostep_stm32f4::pac::Interrupt;

/// Counts executed instructions.
pub struct Counter {
    clock: MotionClock,
    /// What counting nothing counts.
    overhead: u32,
    /// What pending an interrupt counts whose handler does not run.
    pending_overhead: u32,
}

impl Counter {
    /// A counter on a clock that advances once an instruction.
    ///
    /// # Errors
    /// It counts something else than the length of a handler that is known.
    pub fn start(clock: MotionClock) -> Result<Self, &'static str> {
        let mut counter = Self { clock, overhead: 0, pending_overhead: 0 };
        counter.overhead = counter.count(|| ()).0;
        // An interrupt without a handler of its own, and masked: the same code runs, and nothing else.
        counter.pending_overhead = counter.pend(KNOWN_INTERRUPT);
        NVIC::unpend(KNOWN_INTERRUPT);
        // SAFETY: nothing relies on its being masked, and its handler touches nothing.
        unsafe { NVIC::unmask(KNOWN_INTERRUPT) };
        let known = counter.count_handler(KNOWN_INTERRUPT);
        NVIC::mask(KNOWN_INTERRUPT);
        if known == KNOWN_INSTRUCTIONS { Ok(counter) } else { Err("a handler of known length is counted wrongly") }
    }

    fn now(&self) -> u32 {
        // Nothing moves from one side of the reading to the other.
        compiler_fence(Ordering::SeqCst);
        let now = self.clock.now_ticks();
        compiler_fence(Ordering::SeqCst);
        now
    }

    /// Runs a piece; how many instructions it took, and its result.
    #[inline]
    pub fn count<T>(&self, piece: impl FnOnce() -> T) -> (u32, T) {
        let start = self.now();
        let result = black_box(piece());
        let end = self.now();
        (end.wrapping_sub(start).saturating_sub(self.overhead), result)
    }

    /// Pends an interrupt that is enabled and more urgent than the caller: the instructions of its handler, from the
    /// first of the vectored function to its return inclusive. The processor's own entry and exit are not instructions.
    pub fn count_handler(&self, interrupt: Interrupt) -> u32 {
        self.pend(interrupt).saturating_sub(self.pending_overhead)
    }

    /// One copy of this code for every interrupt, so that its own share is the same for all.
    #[inline(never)]
    fn pend(&self, interrupt: Interrupt) -> u32 {
        let start = self.now();
        NVIC::pend(interrupt);
        cortex_m::asm::dsb();
        cortex_m::asm::isb();
        let end = self.now();
        end.wrapping_sub(start)
    }
}

/// The interrupt of the handler that checks the counter.
const KNOWN_INTERRUPT: Interrupt = Interrupt::TIM4;

/// Ten NOPs and the return.
const KNOWN_INSTRUCTIONS: u32 = 11;

/// A handler of known length.
// SAFETY: the name is that of the vector, which is what it is for; it takes no argument and changes no register.
#[unsafe(no_mangle)]
#[unsafe(naked)]
extern "C" fn TIM4() {
    core::arch::naked_asm!("nop", "nop", "nop", "nop", "nop", "nop", "nop", "nop", "nop", "nop", "bx lr")
}
