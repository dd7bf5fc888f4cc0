//! Times of steps and planning, measured while the machine prints; no cost while switched off.
//!
//! The step interrupt is measured from outside: while it is on, its vector leads to
//! [`step_interrupt_measured`], which calls the handler proper. Planning is measured by
//! [`PlanningMeter`].

use core::sync::atomic::{AtomicBool, AtomicPtr, Ordering};

use cortex_m::peripheral::{DCB, DWT};
use ferrostep_stm32f4::histogram::{Histogram, Summary};

use crate::motion_clock::MotionClock;
use crate::pac::{Interrupt, TIM2, TIM5};
use crate::vector_table::VectorTable;

/// Ticks of the step timer from an update to the first instruction of its interrupt: delays, and
/// the entry itself.
static STEP_LATENCY: Histogram = Histogram::new();
/// Duration of the step interrupt, from its first instruction to its last.
static STEP_DURATION: Histogram = Histogram::new();
/// Planning time of a move.
static PLANNING: Histogram = Histogram::new();

static IS_ON: AtomicBool = AtomicBool::new(false);
/// Address of the counter that times are read from; written once, before anything is measured.
static COUNTER: AtomicPtr<u32> = AtomicPtr::new(core::ptr::null_mut());
static COUNTER_IS_OF_CORE: AtomicBool = AtomicBool::new(false);

/// A named histogram.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Measured {
    /// Name of the measured quantity.
    pub name: &'static str,
    /// Unit of the times: `cycles` of the core, or `ticks` of a timer.
    pub unit: &'static str,
    /// Summary of the values since the last clear.
    pub summary: Summary,
}

/// Returns true if measurement is on.
pub fn is_on() -> bool {
    IS_ON.load(Ordering::Relaxed)
}

/// All histograms.
pub fn all() -> [Measured; 3] {
    // A timer replaces the core's cycle counter if that does not count.
    let unit = if COUNTER_IS_OF_CORE.load(Ordering::Relaxed) { "cycles" } else { "ticks" };
    [
        Measured { name: "step_latency", unit: "ticks", summary: STEP_LATENCY.summary() },
        Measured { name: "step_duration", unit, summary: STEP_DURATION.summary() },
        Measured { name: "planning", unit, summary: PLANNING.summary() },
    ]
}

/// Clears the measured times.
pub fn clear() {
    for histogram in [&STEP_LATENCY, &STEP_DURATION, &PLANNING] {
        histogram.clear();
    }
}

/// Switch for tasks below the step interrupt and the planner. Those two add to the histograms, and
/// never see a half-cleared one in the middle of an addition.
pub struct Switch {
    vectors: VectorTable,
}

impl Switch {
    /// Finds a counter: the core's cycles or, if they do not count (an emulator, or a core without
    /// such a counter), the motion clock, which is already running.
    pub fn new(vectors: VectorTable, mut debug: DCB, mut trace: DWT, _motion_clock: MotionClock) -> Self {
        debug.enable_trace();
        trace.enable_cycle_counter();
        let first = trace.cyccnt.read();
        cortex_m::asm::delay(16);
        let of_core = trace.cyccnt.read() != first;
        let counter = if of_core {
            // SAFETY: the address of a register; it is only read, volatile.
            unsafe { (&raw const (*DWT::PTR).cyccnt).cast::<u32>() }
        } else {
            // SAFETY: as above; its owner was given up to the motion clock, which only
            // reads it as well.
            unsafe { (*TIM5::ptr()).cnt().as_ptr().cast_const() }
        };
        COUNTER_IS_OF_CORE.store(of_core, Ordering::Relaxed);
        COUNTER.store(counter.cast_mut(), Ordering::Relaxed);
        Self { vectors }
    }

    /// Switches the measurement on or off. The histograms keep their values.
    pub fn set(&mut self, on: bool) {
        if on {
            // SAFETY: it calls the handler that it replaces and else only reads two counters and
            // adds to its histograms; the counter was found in `new`.
            unsafe { self.vectors.replace(Interrupt::TIM2, step_interrupt_measured) };
        } else {
            self.vectors.restore();
        }
        IS_ON.store(on, Ordering::Relaxed);
    }
}

/// Current value of the counter.
///
/// # Safety
/// [`Switch::new`] has been called.
#[inline(always)]
unsafe fn now() -> u32 {
    let counter = COUNTER.load(Ordering::Relaxed);
    // SAFETY: a register's address by the contract above; reading it changes nothing.
    unsafe { counter.read_volatile() }
}

/// Replaces the handler of the step interrupt while times are measured. The step timer counts from
/// 0 at each update: its count here is the interrupt's delay.
unsafe extern "C" fn step_interrupt_measured() {
    unsafe extern "C" {
        /// The handler proper, called by its name: a look into the vector table would delay its
        /// reload value.
        fn TIM2();
    }
    // SAFETY: the counter is only read.
    let latency_ticks = unsafe { &*TIM2::ptr() }.cnt().read().bits();
    // SAFETY: this runs by `Switch::set` only.
    let began = unsafe { now() };
    // SAFETY: its interrupt has come, and no other handler has run for it.
    unsafe { TIM2() };
    // SAFETY: as above.
    let ended = unsafe { now() };
    STEP_LATENCY.add(latency_ticks);
    STEP_DURATION.add(ended.wrapping_sub(began));
}

/// Measures the planner's work for each move, including interrupts.
#[derive(Debug, Default)]
pub struct PlanningMeter {
    /// Start of the present portion, if the portion is measured.
    began: Option<u32>,
    /// Time spent on the present move in earlier portions.
    spent: u32,
    /// True if the present portion was the last of the move.
    is_planned: bool,
}

impl PlanningMeter {
    /// Begins a portion of work.
    #[inline]
    pub fn begin(&mut self) {
        // SAFETY: only what `Switch::new` returns switches it on.
        self.began = is_on().then(|| unsafe { now() });
    }

    /// Notes that the last entry of a move has been planned.
    #[inline]
    pub fn move_planned(&mut self) {
        self.is_planned = true;
    }

    /// Ends the portion. A move measured only in part is not counted.
    #[inline]
    pub fn end(&mut self) {
        let is_planned = core::mem::take(&mut self.is_planned);
        let Some(began) = self.began.take() else {
            self.spent = 0;
            return;
        };
        // SAFETY: as in `begin`.
        self.spent = self.spent.saturating_add(unsafe { now() }.wrapping_sub(began));
        if is_planned {
            PLANNING.add(core::mem::take(&mut self.spent));
        }
    }
}
