//! Cycles of the core, by its own counter (DWT CYCCNT).

use cortex_m::peripheral::{DCB, DWT};
use ferrostep_stm32f4_board::motion_clock::MotionClock;

use ferrostep_bench::span::{Count, Counter};

/// The core's counter; an emulator's core counts nothing, and the motion clock is read instead.
#[derive(Clone, Copy, Debug)]
pub struct Cycles {
    stand_in: Option<MotionClock>,
}

impl Cycles {
    /// Starts the count.
    pub fn start(mut debug: DCB, mut trace: DWT, clock: MotionClock) -> Self {
        debug.enable_trace();
        trace.enable_cycle_counter();
        let first = DWT::cycle_count();
        cortex_m::asm::delay(16);
        Self { stand_in: (DWT::cycle_count() == first).then_some(clock) }
    }

    /// Returns true if the core counts, and not the motion clock that replaces it.
    pub fn are_of_core(&self) -> bool {
        self.stand_in.is_none()
    }
}

/// Makes a counter of these. The second one is kept: everything is then in the flash's cache, as it
/// is in what is counted.
pub fn start(cycles: Cycles) -> Counter {
    let count = cycles.stand_in.map_or(Count::Cycles, Count::Ticks);
    Counter::new(count);
    Counter::new(count)
}
