//! The step queue and its far end, the interrupt, as the bench uses them.

use core::sync::atomic::{AtomicU16, Ordering};

use cortex_m::peripheral::NVIC;
use ferrostep_hal_shim::StepQueue;
use ferrostep_planner::interpolator::MAX_ENTRIES;
use ferrostep_planner::{Notice, StepEntry, StepKind, StepSink};
use ferrostep_step_player::{BothEdges, MotorPins, Pin, PinMap, Pulses, Signals, StepFeeder, StepPlayer, Stepping};
use ferrostep_stm32f4_board::board::BoardPins;
use ferrostep_stm32f4_board::pac::{Interrupt, Peripherals, RCC};
use ferrostep_stm32f4_board::step_timer::{MotorPort, MotorPorts, MotorQueue, Motors, StepTimer};

use ferrostep_profile_constant::StepSignals;

use crate::span::Counter;

/// Slots of the queue that prints, as in the firmware.
pub const STEP_QUEUE_SLOTS: usize = 2048;

/// Slots of the queues that do not print.
pub const SHORT_QUEUE_SLOTS: usize = 64;

/// Slots of the queues that lines are drawn to: the longest line has 1000 steps.
pub const LINE_QUEUE_SLOTS: usize = 1024;

/// The signals may change as soon as the timer can tell.
const SIGNALS: Signals = Signals { pulse_ticks: 2, direction_setup_ticks: 2 };

/// Any number of ports, all of them the same one.
#[derive(Clone, Copy)]
pub struct Ports(MotorPort);

impl<const PORTS: usize> Motors<PORTS> for Ports {
    fn ports(&self) -> MotorPorts<PORTS> {
        MotorPorts([self.0; PORTS])
    }

    fn enable(&self, _on: u8) {}
}

impl Ports {
    /// Copies of the board's first.
    pub fn new(pins: &BoardPins) -> Self {
        let MotorPorts([port, ..]) = pins.ports();
        Self(port)
    }
}

/// Step and direction pins of the four motors, dealt out to the ports.
fn pin_map<const PORTS: usize>() -> Option<PinMap<PORTS>> {
    PinMap::new([0, 1, 2, 3].map(|number: u8| {
        let pin = |number| Pin { port: usize::from(number) % PORTS, number };
        MotorPins { step: pin(number), direction: Pin { number: number + 4, ..pin(number) } }
    }))
}

/// The queue's near end.
///
/// The one sink of the bench, as the firmware has one: a second type would change what the compiler
/// inlines into the planner. So there are two builds of this program. With the feature `tally`
/// entries are counted instead of queued, so that counting has no part in what queuing costs.
pub struct BenchQueue<M: 'static, const PORTS: usize, const N: usize> {
    queue: MotorQueue<Ports, M, PORTS, N>,
    interrupt: Interrupt,
    tally: Tally,
}

/// The queue that prints: the firmware's.
pub type PrintQueue = BenchQueue<StepSignals, 1, STEP_QUEUE_SLOTS>;

/// A queue that lines are drawn to, which no interrupt plays.
pub type LineQueue<M> = BenchQueue<M, 1, LINE_QUEUE_SLOTS>;

/// One queue of each kind.
pub struct LineQueues {
    /// Queue for drivers that step at both edges.
    pub edges: LineQueue<BothEdges>,
    /// Queue for others.
    pub pulses: LineQueue<Pulses>,
}

/// Amount of work to queue.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    /// Entries.
    pub entries: u32,
    /// Step events in them.
    pub events: u32,
}

/// Starts the timer as the firmware does. The interrupt is at `interrupt` instead of the timer's
/// own place, which has no handler here: events come when they are counted. So the timer may be
/// started for several interrupts.
pub fn start<M: Stepping, const PORTS: usize, const N: usize>(
    rcc: &RCC,
    ports: Ports,
    player: &'static StepPlayer<M, PORTS, N>,
    interrupt: Interrupt,
) -> Option<(StepTimer<M, PORTS, N>, BenchQueue<M, PORTS, N>)> {
    // SAFETY: only one of the interrupts runs at a time, and all of them use the timer alike.
    let Peripherals { TIM2: timer, TIM9: counter, .. } = unsafe { Peripherals::steal() };
    let timer = StepTimer::start(timer, counter, rcc, &ports, player);
    let queue = MotorQueue::new(ports, StepFeeder::new(player, pin_map()?, SIGNALS), None);
    Some((timer, BenchQueue { queue, interrupt, tally: Tally::default() }))
}

/// Number of the interrupt that plays.
static PLAYING: AtomicU16 = AtomicU16::new(0);

/// Returns true if this interrupt plays.
pub fn is_playing(interrupt: Interrupt) -> bool {
    PLAYING.load(Ordering::Relaxed) == interrupt as u16
}

/// An event of the interrupt.
pub struct Event {
    /// Instructions of the interrupt.
    pub instructions: u32,
    /// True if it took a slot from the queue.
    pub is_new: bool,
}

impl<M: Stepping, const PORTS: usize, const N: usize> BenchQueue<M, PORTS, N> {
    /// Takes the amount that has been counted since the last call.
    pub fn take_tally(&mut self) -> Tally {
        core::mem::take(&mut self.tally)
    }

    /// Returns true if the blocks' next entries fit.
    #[inline]
    pub fn has_room(&self) -> bool {
        self.queue.room() >= MAX_ENTRIES
    }

    /// Slots that wait, the one that is held back until its successor comes included.
    pub fn waiting(&self) -> usize {
        self.queue.waiting()
    }

    /// Lets the interrupt take slots; returns the instructions of its start.
    pub fn start(&mut self, counter: &Counter) -> u32 {
        PLAYING.store(self.interrupt as u16, Ordering::Relaxed);
        // The queue calls it, masked; and once more where it is counted.
        NVIC::mask(Interrupt::TIM1_BRK_TIM9);
        self.queue.start();
        NVIC::unpend(Interrupt::TIM1_BRK_TIM9);
        // SAFETY: no critical section relies on the mask.
        unsafe { NVIC::unmask(Interrupt::TIM1_BRK_TIM9) };
        counter.count_handler(Interrupt::TIM1_BRK_TIM9)
    }

    /// Returns true while the interrupt has found no end of the slots.
    pub fn is_running(&self) -> bool {
        self.queue.link().is_running()
    }

    /// Runs the interrupt once.
    pub fn play(&self, counter: &Counter) -> Event {
        let before = self.queue.played();
        let instructions = counter.count_handler(self.interrupt);
        Event { instructions, is_new: self.queue.played() != before }
    }

    /// Adds entries while they are made.
    #[inline(always)]
    pub fn extend(&mut self, entries: impl Iterator<Item = StepEntry>) {
        if cfg!(feature = "tally") {
            entries.for_each(|entry| self.entry(entry));
        } else if self.queue.extend(entries).is_err() {
            refused();
        }
    }

    /// Empties the queue without the interrupt.
    pub fn empty(&mut self) {
        self.queue.request_stop();
        self.queue.drop_all();
    }
}

impl<M: Stepping, const PORTS: usize, const N: usize> StepSink for BenchQueue<M, PORTS, N> {
    #[inline]
    fn entry(&mut self, entry: StepEntry) {
        if cfg!(feature = "tally") {
            self.tally.entries += 1;
            if let StepKind::Stair { count, .. } = entry.kind() {
                self.tally.events += u32::from(count);
            }
        } else if self.queue.push(entry).is_err() {
            refused();
        }
    }

    #[inline]
    fn entries(&mut self, entries: &[StepEntry]) {
        if cfg!(feature = "tally") {
            for entry in entries {
                self.entry(*entry);
            }
        } else if self.queue.push_all(entries).is_err() {
            refused();
        }
    }

    fn notice(&mut self, _notice: Notice) {}
}

/// There was room, and time between the events.
#[cold]
fn refused() -> ! {
    panic!("the queue refuses an entry")
}
