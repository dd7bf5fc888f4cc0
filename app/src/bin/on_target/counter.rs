//! Cycles of the core, by its own counter (DWT CYCCNT).

use core::hint::black_box;
use core::sync::atomic::{Ordering, compiler_fence};

use cortex_m::peripheral::{DCB, DWT, NVIC};
use ferrostep_stm32f4::motion_clock::MotionClock;
use ferrostep_stm32f4::pac::Interrupt;

/// Nothing answers this one: it stays masked.
const UNANSWERED: Interrupt = Interrupt::TIM4;

/// Counts cycles; in an emulator, whose core counts none, the motion clock's ticks stand in.
#[derive(Clone, Copy, Debug)]
pub struct Counter {
    /// The clock, where the core does not count.
    stand_in: Option<MotionClock>,
    /// What counting nothing counts.
    overhead: u32,
    /// What pending an interrupt counts that nothing answers.
    pending_overhead: u32,
}

impl Counter {
    /// Starts the count.
    pub fn start(mut debug: DCB, mut trace: DWT, clock: MotionClock) -> Self {
        debug.enable_trace();
        trace.enable_cycle_counter();
        let first = DWT::cycle_count();
        cortex_m::asm::delay(16);
        let counts = DWT::cycle_count() != first;
        let mut counter = Self { stand_in: (!counts).then_some(clock), overhead: 0, pending_overhead: 0 };
        // The second time everything is in the flash's cache, as it is in what is counted.
        for _ in 0..2 {
            counter.overhead = 0;
            counter.overhead = counter.count(|| ()).0;
            counter.pending_overhead = counter.pend(UNANSWERED);
            NVIC::unpend(UNANSWERED);
        }
        counter
    }

    /// Whether it is the core that counts, and not what stands in for it.
    pub fn is_of_core(&self) -> bool {
        self.stand_in.is_none()
    }

    fn now(&self) -> u32 {
        // Nothing moves from one side of the reading to the other.
        compiler_fence(Ordering::SeqCst);
        let now = match self.stand_in {
            None => DWT::cycle_count(),
            Some(clock) => clock.now_ticks(),
        };
        compiler_fence(Ordering::SeqCst);
        now
    }

    /// Runs a piece; how many cycles it took, and its result.
    #[inline]
    pub fn count<T>(&self, piece: impl FnOnce() -> T) -> (u32, T) {
        let start = self.now();
        let result = black_box(piece());
        let end = self.now();
        (end.wrapping_sub(start).saturating_sub(self.overhead), result)
    }

    /// Pends an interrupt that is enabled and more urgent than the caller: the cycles of its handler, and of the core's way
    /// there and back.
    pub fn count_handler(&self, interrupt: Interrupt) -> u32 {
        self.pend(interrupt).saturating_sub(self.pending_overhead)
    }

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
