//! The step queue and its far end, the interrupt: all that the bench knows of either.

use ferrostep_hal_shim::StepOutput;
use ferrostep_hal_shim::step_player::StepLink;
use ferrostep_hal_shim::step_ring::StepRing;
use ferrostep_planner::interpolator::MAX_ENTRIES;
use ferrostep_planner::{Notice, StepEntry, StepKind, StepSink};
use ferrostep_stm32f4::bench::BenchPins;
use ferrostep_stm32f4::pac::{Interrupt, RCC, TIM2};
use ferrostep_stm32f4::step_timer::{StepQueue, StepTimer};

use crate::counter::Counter;

/// Entries in the step queue, as in the firmware.
const STEP_QUEUE_ENTRIES: usize = 2048;

static STEPS: StepRing<STEP_QUEUE_ENTRIES> = StepRing::new();
static STEP_LINK: StepLink = StepLink::new();

/// What the interrupt owns.
pub type BenchTimer = StepTimer<BenchPins, STEP_QUEUE_ENTRIES>;

/// The queue's near end.
///
/// The one sink of the bench, as the firmware has one: a second type would change what the compiler inlines into the
/// planner. So there are two builds of this program. With the feature `tally` entries are counted instead of queued,
/// so that counting has no part in what queuing costs.
pub struct BenchQueue {
    queue: StepQueue<BenchPins, STEP_QUEUE_ENTRIES>,
    tally: Tally,
}

/// How much there is to queue.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    /// Entries.
    pub entries: u32,
    /// Step events in them.
    pub events: u32,
}

/// Starts the timer as the firmware does, then forbids it to interrupt: events come when they are counted. The step
/// signals' length is no work, so none is waited for.
pub fn start(timer: TIM2, rcc: &RCC, pins: &'static BenchPins) -> (BenchTimer, BenchQueue) {
    let timer = StepTimer::start(timer, rcc, pins, &STEPS, &STEP_LINK, 0);
    // SAFETY: the handler, which owns the timer, does not run yet and does not use this register.
    unsafe { &*TIM2::ptr() }.dier().write(|w| w.uie().clear_bit());
    (timer, BenchQueue { queue: StepQueue::new(pins, &STEPS, &STEP_LINK), tally: Tally::default() })
}

/// An event of the interrupt.
pub struct Event {
    /// Its instructions.
    pub instructions: u32,
    /// Whether it took an entry from the queue.
    pub is_new: bool,
}

impl BenchQueue {
    /// What has been counted since the last call.
    pub fn take_tally(&mut self) -> Tally {
        core::mem::take(&mut self.tally)
    }

    /// Whether the blocks' next entries fit.
    #[inline]
    pub fn has_room(&self) -> bool {
        self.queue.room() >= MAX_ENTRIES
    }

    /// Entries that wait.
    pub fn waiting(&self) -> usize {
        self.queue.waiting()
    }

    /// Lets the interrupt take entries.
    pub fn start(&self) {
        self.queue.link().start();
    }

    /// Whether the interrupt has events to play.
    pub fn is_busy(&self) -> bool {
        self.queue.link().is_busy()
    }

    /// Runs the interrupt once.
    pub fn play(&self, counter: &Counter) -> Event {
        let before = self.waiting();
        let instructions = counter.count_handler(Interrupt::TIM2);
        Event { instructions, is_new: self.waiting() != before }
    }

    /// Empties the queue without the interrupt.
    pub fn empty(&mut self) {
        while STEPS.pop().is_some() {}
    }
}

impl StepSink for BenchQueue {
    #[inline]
    fn entry(&mut self, entry: StepEntry) {
        if cfg!(feature = "tally") {
            self.tally.entries += 1;
            if let StepKind::Stair { count, .. } = entry.kind() {
                self.tally.events += u32::from(count);
            }
        } else {
            self.queue.push(entry);
        }
    }

    fn notice(&mut self, _notice: Notice) {}
}
