//! Blocks between planning and interpolation: they wait in a ring until their speeds are final.

use crate::block::{Block, PlannedBlock, Speed, SquaredSpeed};
use crate::given_speeds::GivenSpeeds;
use crate::look_ahead::{LookAhead, SpeedLaw};
use crate::methods::{Never, SpeedRule};
use crate::pace::Pace;
use crate::ring::{Content, Marker, Ring, RingMemory};
use crate::speed_plan::{BlockStart, PlanFault, Released, SpeedPlan};
use crate::time_law::TimeLaw;

#[derive(Clone, Copy, Debug)]
enum Speeds<R> {
    LookAhead(LookAhead<R>),
    Given(GivenSpeeds),
}

/// The first fault of a prepared job. Until the motors' position is known again, no more of the job
/// is accepted.
#[derive(Clone, Copy, Debug)]
struct JobFault {
    fault: PlanFault,
    is_reported: bool,
}

/// The look-ahead ring, and the source of its blocks' speeds.
///
/// The plan depends only on the order of the blocks, not on the time of their arrival.
#[derive(Debug)]
pub struct BlockQueue<S, R = Never> {
    ring: Ring<S>,
    speeds: Speeds<R>,
    fault: Option<JobFault>,
    /// Blocks with the other source of speeds wait until the ring is empty.
    pub(crate) is_switching: bool,
}

impl<S: RingMemory, R: SpeedRule> BlockQueue<S, R> {
    /// A queue with look-ahead under trapezoids in the given memory; at least two places are needed
    /// for it to be useful.
    pub fn new(slots: S) -> Self {
        let speeds = Speeds::LookAhead(LookAhead::new(&SpeedLaw::Trapezoid));
        Self { ring: Ring::new(slots), speeds, fault: None, is_switching: false }
    }

    /// Makes look-ahead plan the speeds of later blocks, under this law; the ring must be empty.
    pub fn look_ahead(&mut self, law: &SpeedLaw<R>) {
        self.speeds = Speeds::LookAhead(LookAhead::new(law));
        self.ring.clear();
    }

    /// Makes the queue accept blocks with given speeds from now on; the ring must be empty.
    pub fn take_given_speeds(&mut self) {
        self.speeds = Speeds::Given(GivenSpeeds::default());
    }

    /// True if blocks come with their speeds already planned.
    pub fn has_given_speeds(&self) -> bool {
        matches!(self.speeds, Speeds::Given(_))
    }

    /// True if another block or marker fits.
    pub fn has_room(&self) -> bool {
        self.ring.has_room()
    }

    /// True if the ring is empty.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of blocks and markers in the ring.
    pub fn len(&self) -> usize {
        self.ring.len()
    }

    /// Nominal speed of the block that left last, before the pace was applied.
    pub fn last_nominal(&self) -> Speed {
        self.ring.last_nominal
    }

    /// True if the oldest block or marker may leave.
    pub fn can_leave(&self) -> bool {
        self.ring.can_leave()
    }

    /// True if the oldest place is final: no later block can change its speeds. Only
    /// look-ahead by single blocks knows final places; under an S-curve and with given speeds
    /// this is always `false`.
    pub fn is_first_final(&self) -> bool {
        self.ring.is_first_final()
    }

    /// Forwards to `LookAhead::foresee`.
    pub fn foresee(&mut self, block: &Block, corner: Speed) {
        if let Speeds::LookAhead(plan) = &self.speeds {
            plan.foresee(&mut self.ring, block, corner);
        }
    }

    /// Duration of the blocks in final places, ticks.
    pub fn final_ticks(&mut self) -> u64 {
        self.ring.final_ticks(|waiting, exit| {
            let (entry, exit) = (waiting.entry.root(), exit.root());
            let planned = PlannedBlock { block: waiting.block, entry, exit };
            TimeLaw::<Never>::trapezoid(&planned).duration_ticks()
        })
    }

    /// The first block that is not final.
    pub fn first_not_final(&self) -> Option<&Block> {
        self.ring.first_not_final().map(|waiting| &waiting.block)
    }

    /// Releases the final places although the ring is not full. This never changes a speed.
    pub fn release_final(&mut self) {
        self.ring.release_final();
    }

    /// Adds a block; `false` without room. A block whose given speed cannot be followed is dropped,
    /// the blocks before it end at standstill, and [`Self::report_fault`] gives the reason.
    #[inline(always)]
    pub fn push(&mut self, block: &Block, start: &BlockStart) -> bool {
        if !self.has_room() {
            return false;
        }
        let pushed = match &mut self.speeds {
            Speeds::LookAhead(plan) => plan.push(&mut self.ring, block, start),
            Speeds::Given(plan) => plan.push(&mut self.ring, block, start),
        };
        if let Err(fault) = pushed {
            self.fault = Some(JobFault { fault, is_reported: false });
            self.flush();
        }
        true
    }

    /// Adds a marker; `false` without room.
    pub fn push_marker(&mut self, marker: Marker) -> bool {
        self.ring.push_marker(marker)
    }

    /// Takes the oldest block or marker if it may leave.
    #[inline]
    pub fn pop(&mut self, pace: Pace) -> Option<Released> {
        if !self.can_leave() {
            return None;
        }
        match &mut self.speeds {
            Speeds::LookAhead(plan) => plan.pop(&mut self.ring, pace),
            Speeds::Given(plan) => plan.pop(&mut self.ring, pace),
        }
    }

    /// Stops motion after the newest block; all blocks and markers may leave.
    pub fn flush(&mut self) {
        self.ring.flush();
    }

    /// Releases one more block although the ring is not full, because steps run out.
    pub fn release(&mut self) {
        self.ring.release();
    }

    /// Discards all waiting blocks, and a job's fault; the next block starts from standstill.
    pub fn clear(&mut self) {
        let Self { ring, speeds, fault, is_switching } = self;
        ring.clear();
        match speeds {
            Speeds::LookAhead(plan) => plan.clear(),
            Speeds::Given(plan) => plan.clear(),
        }
        *fault = None;
        *is_switching = false;
    }

    /// Notes a fault of a prepared job that is reported at once. The caller flushes: a held block
    /// may still have to enter the ring.
    pub fn note_reported_fault(&mut self, fault: PlanFault) {
        self.fault = Some(JobFault { fault, is_reported: true });
    }

    /// Returns the prepared job's fault, which counts as reported from now on.
    #[inline(always)]
    pub fn report_fault(&mut self) -> Option<PlanFault> {
        let JobFault { fault, is_reported } = self.fault.as_mut()?;
        *is_reported = true;
        Some(*fault)
    }

    /// Returns and reports the plan's fault, unless it has been reported.
    pub fn take_unreported_fault(&mut self) -> Option<PlanFault> {
        if self.fault?.is_reported { None } else { self.report_fault() }
    }

    /// Bound of the oldest block and planned entry of the next one (zero if missing), as squared
    /// speeds, for a recorder. `None` if the oldest place holds no block.
    pub(crate) fn oldest_bound_and_next_entry(&self) -> Option<(SquaredSpeed, SquaredSpeed)> {
        let Some(Content::Block(oldest)) = self.ring.first() else { return None };
        let next = self.ring.second_block().map_or(SquaredSpeed::ZERO, |next| next.entry);
        Some((oldest.entry_bound, next))
    }
}
