//! The moves that end inside the block that is being executed.

use crate::block::Block;
use crate::block_law::BlockLaw;
use crate::inner_ends::MAX_INNER_ENDS;
use crate::real::Real;
use crate::spacing::ExtruderTravel;

/// A move's end inside a block.
#[derive(Clone, Copy, Debug)]
pub(crate) struct End {
    /// Its source line.
    pub(crate) line: u32,
    /// When it is, in time units from the block's start.
    pub(crate) time: u64,
    /// Steps of the master up to it, from the block's start.
    pub(crate) master_steps: u32,
    /// Steps of the extruder up to it, from the block's start.
    pub(crate) extruder_steps: u32,
}

impl End {
    const NONE: Self = Self { line: 0, time: 0, master_steps: 0, extruder_steps: 0 };
}

/// The ends inside a block, in the order of the path.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Inside {
    ends: [End; MAX_INNER_ENDS],
    count: usize,
    passed: usize,
}

impl Inside {
    /// None.
    pub(crate) const NONE: Self = Self { ends: [End::NONE; MAX_INNER_ENDS], count: 0, passed: 0 };

    /// Those of a block.
    #[inline]
    pub(crate) fn start<F: Real>(
        &mut self,
        block: &Block,
        law: &impl BlockLaw<F>,
        master: u32,
        extruder: &ExtruderTravel,
    ) {
        self.count = 0;
        self.passed = 0;
        if !block.inner_ends.is_empty() {
            self.fill(block, law, master, extruder);
        }
    }

    #[cold]
    fn fill<F: Real>(&mut self, block: &Block, law: &impl BlockLaw<F>, master: u32, extruder: &ExtruderTravel) {
        let whole = u64::from(block.length_10nm.max(1));
        for (place, end) in self.ends.iter_mut().zip(block.inner_ends.iter(block.line)) {
            let length = u64::from(end.length_10nm).min(whole);
            // Step k of N is due at (k - 1/2) S/N.
            let master_steps = (2 * u64::from(master) * length + whole) / (2 * whole);
            let travel = u64::from(extruder.whole) * length / whole;
            let extruder_steps = match travel.checked_sub(u64::from(extruder.first)) {
                Some(behind_first) => (behind_first / 256 + 1).min(u64::from(extruder.count)),
                None => 0,
            };
            *place = End {
                line: end.line,
                time: law.time_at(length as u32),
                // Both are at most the block's own, which have 32 bits.
                master_steps: master_steps as u32,
                extruder_steps: extruder_steps as u32,
            };
            self.count += 1;
        }
    }

    /// Steps of master and extruder up to the next end; all where there is none.
    pub(crate) fn steps_to_next(&self) -> [u32; 2] {
        let before = match self.passed.checked_sub(1).and_then(|index| self.ends.get(index)) {
            Some(end) => [end.master_steps, end.extruder_steps],
            None => [0, 0],
        };
        match self.ends.get(self.passed) {
            Some(end) if self.passed < self.count => {
                [end.master_steps.saturating_sub(before[0]), end.extruder_steps.saturating_sub(before[1])]
            }
            _ => [u32::MAX; 2],
        }
    }

    /// Whether there are ends still to be passed.
    #[inline]
    pub(crate) fn is_over(&self) -> bool {
        self.passed >= self.count
    }

    /// Passes the next end; `None` behind the last.
    pub(crate) fn pass(&mut self) -> Option<End> {
        if self.is_over() {
            return None;
        }
        let end = self.ends.get(self.passed).copied();
        self.passed += 1;
        end
    }
}
