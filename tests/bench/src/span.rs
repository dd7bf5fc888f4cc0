//! Counts of the code that runs between two readings of a clock: a piece of code, or an
//! interrupt's handler.

use core::hint::black_box;
use core::sync::atomic::{Ordering, compiler_fence};

use cortex_m::peripheral::{DWT, NVIC};
use ferrostep_stm32f4_board::motion_clock::MotionClock;
use ferrostep_stm32f4_board::pac::Interrupt;

/// An interrupt that stays masked.
pub const UNANSWERED: Interrupt = Interrupt::TIM4;

/// A count that continues modulo 2^32.
///
/// An enum and not a trait, so that the measured code is compiled once, in this crate, and inlined
/// as in the firmware.
#[derive(Clone, Copy, Debug)]
pub enum Count {
    /// Instructions. The virtual mainboard executes one in two ticks of the motion clock
    /// (`xtask/workbench/src/mainboard.rs`).
    Instructions(MotionClock),
    /// The core's cycles, by its own counter (DWT CYCCNT), which has been started.
    Cycles,
    /// Ticks of the motion clock, where the core counts nothing.
    Ticks(MotionClock),
}

impl Count {
    fn now(self) -> u32 {
        match self {
            Self::Instructions(clock) | Self::Ticks(clock) => clock.now_ticks(),
            Self::Cycles => DWT::cycle_count(),
        }
    }

    /// Count between two readings.
    fn between(self, start: u32, end: u32) -> u32 {
        let difference = end.wrapping_sub(start);
        match self {
            Self::Instructions(_) => difference / 2,
            Self::Cycles | Self::Ticks(_) => difference,
        }
    }
}

/// Counter of the code between two readings.
#[derive(Clone, Copy, Debug)]
pub struct Counter {
    clock: Count,
    /// Count of an empty piece.
    overhead: u32,
    /// Count of pending an interrupt whose handler does not run.
    pending_overhead: u32,
}

impl Counter {
    /// Measures the overheads of this clock. [`UNANSWERED`] is masked.
    pub fn new(clock: Count) -> Self {
        let mut spans = Self { clock, overhead: 0, pending_overhead: 0 };
        spans.overhead = spans.count(|| ()).0;
        // An interrupt without its own handler, and masked: only the same code runs.
        spans.pending_overhead = spans.pend(UNANSWERED);
        NVIC::unpend(UNANSWERED);
        spans
    }

    fn now(&self) -> u32 {
        // The fences keep code on its side of the reading.
        compiler_fence(Ordering::SeqCst);
        let now = self.clock.now();
        compiler_fence(Ordering::SeqCst);
        now
    }

    /// Runs a piece; returns its count and its result.
    #[inline]
    pub fn count<T>(&self, piece: impl FnOnce() -> T) -> (u32, T) {
        let start = self.now();
        let result = black_box(piece());
        let end = self.now();
        (self.clock.between(start, end).saturating_sub(self.overhead), result)
    }

    /// Pends an interrupt that is enabled and more urgent than the caller: from the first
    /// instruction of the vectored function to its return inclusive. The processor's own entry and
    /// exit count if the clock counts cycles, and not if it counts instructions.
    pub fn count_handler(&self, interrupt: Interrupt) -> u32 {
        self.pend(interrupt).saturating_sub(self.pending_overhead)
    }

    /// One copy of this code for every interrupt, so that its share is the same for all.
    #[inline(never)]
    fn pend(&self, interrupt: Interrupt) -> u32 {
        let start = self.now();
        NVIC::pend(interrupt);
        cortex_m::asm::dsb();
        cortex_m::asm::isb();
        let end = self.now();
        self.clock.between(start, end)
    }
}
