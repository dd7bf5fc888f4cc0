//! Look-ahead under an S-curve: neighbouring blocks become runs, each under one time law.
//!
//! Were every block to begin and end without acceleration, curves of short blocks would never gain speed. So blocks are
//! joined to *runs*, and the acceleration is zero at the ends of those only. Li 2017 plans segment by segment and does not
//! know this.
//!
//! - A new block joins the newest run where the corner between them does not limit, or where holding the whole run to the
//!   corner's speed costs less time than a stop of acceleration there.
//! - Reverse pass, over runs: entry <= reach(exit, length), the S-curve's reach in the place of v^2 + 2as.
//! - A run is settled when its first block leaves. What leaves is cut off where the run cruises, if it does at the end of a
//!   block: that costs nothing, and the rest may still grow. A run that may still grow and has no such place is cut in its
//!   middle, at a speed from which its rest can stop.
//!
//! One thing is not as under a constant acceleration: to slow down to x takes longer than to slow down to a standstill
//! where x is small, since the acceleration has to be gone at x ([`crate::s_curve::bounds`]). A faster exit can therefore
//! make an entry impossible that was possible before. Entries that were once granted are kept: the slower exit, from which
//! everything behind was planned already, is taken then.

use super::{Content, Left, LookAhead, Slot, Waiting};
use crate::block::{Acceleration, Block, Speed, SquaredSpeed};
use crate::pace::Pace;
use crate::s_curve::run::Planning;
use crate::s_curve::{Jerk, Run};

/// A block of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// The block.
    pub block: Block,
    /// The run that it is part of.
    pub run: Run,
    /// Where in the run it begins, units of 10 nm.
    pub offset_10nm: u32,
}

/// What several blocks have in common.
#[derive(Clone, Copy, Debug)]
struct Shape {
    length_10nm: u32,
    /// No faster anywhere: nominal speeds, and corners inside.
    cruise: SquaredSpeed,
    acceleration: Acceleration,
}

impl Shape {
    fn of(block: &Block) -> Self {
        Self { length_10nm: block.length_10nm, cruise: block.nominal.into(), acceleration: block.acceleration }
    }

    /// With one more at the end or the start, and this bound at the corner between; `None` where that is too long.
    fn with(&self, block: &Block, corner: SquaredSpeed) -> Option<Self> {
        Some(Self {
            length_10nm: self.length_10nm.checked_add(block.length_10nm)?,
            cruise: self.cruise.min(corner).min(block.nominal.into()),
            acceleration: self.acceleration.min(block.acceleration),
        })
    }
}

/// The newest run, while it may grow.
#[derive(Clone, Copy, Debug)]
struct Newest {
    shape: Shape,
    /// Number of its first block or marker, since the beginning.
    first: usize,
    /// Bound of the speed at its start, and the speed from which it can stop; settled if the run before has left.
    entry_bound: Speed,
    entry: Speed,
    settled: bool,
}

/// The run whose blocks are leaving.
#[derive(Clone, Copy, Debug)]
struct Leaving {
    run: Run,
    passed_10nm: u32,
    blocks: usize,
}

/// What look-ahead under an S-curve knows besides the ring.
#[derive(Clone, Copy, Debug)]
pub(super) struct Runs {
    jerk: Jerk,
    /// How many have left the ring, blocks and markers; wraps.
    left: usize,
    newest: Option<Newest>,
    leaving: Option<Leaving>,
}

/// The end of what leaves, inside a run.
#[derive(Clone, Copy, Debug)]
struct Cut {
    /// Place of the first block behind it.
    place: usize,
    blocks: usize,
    length_10nm: u32,
    exit: Speed,
}

/// The oldest run.
#[derive(Clone, Copy, Debug)]
struct Oldest {
    shape: Shape,
    blocks: usize,
    /// Place of the run behind it; `None` where it is the newest.
    next: Option<usize>,
}

impl Runs {
    pub(super) fn new(jerk: Jerk) -> Self {
        Self { jerk, left: 0, newest: None, leaving: None }
    }

    pub(super) fn clear(&mut self) {
        *self = Self::new(self.jerk);
    }

    fn planning(&self, shape: &Shape) -> Planning {
        Planning::new(self.jerk, shape.acceleration)
    }

    /// The newest run with one more block, if that is no loss; `bound` is that of the corner between.
    fn joined(&self, newest: &Newest, block: &Block, bound: SquaredSpeed) -> Option<Shape> {
        let before = &newest.shape;
        let whole = before.with(block, bound)?;
        let cruise = whole.cruise.root();
        let planning = self.planning(&whole);
        // What was granted must stay possible.
        if cruise < newest.entry || cruise == Speed::ZERO || planning.reach(Speed::ZERO, whole.length_10nm) < newest.entry
        {
            return None;
        }
        let behind = Shape::of(block);
        if whole.cruise == before.cruise
            && whole.cruise == behind.cruise
            && before.acceleration == behind.acceleration
        {
            return Some(whole);
        }
        // Either way from the same entry to the same exit, as fast as what is known allows.
        let (first, second) = (self.planning(before), self.planning(&behind));
        let corner = bound.min(before.cruise).min(behind.cruise).root();
        let entry = if newest.settled {
            newest.entry
        } else {
            newest.entry_bound.min(cruise).min(first.reach(corner, before.length_10nm)).max(newest.entry)
        };
        let corner = first.exit_within(entry, corner, before.length_10nm);
        let exit = cruise.min(second.reach(corner, behind.length_10nm));
        let exit = second.exit_within(corner, planning.exit_within(entry, exit, whole.length_10nm), behind.length_10nm);
        let apart = first.duration(entry, corner, before.cruise.root(), before.length_10nm)
            + second.duration(corner, exit, block.nominal, behind.length_10nm);
        let together = planning.duration(entry, exit, cruise, whole.length_10nm);
        (together <= apart).then_some(whole)
    }
}

impl<S: AsRef<[Slot]> + AsMut<[Slot]>> LookAhead<S> {
    /// Adds a block, for which there is room.
    pub(super) fn push_to_runs(&mut self, mut runs: Runs, block: &Block, bound: SquaredSpeed) -> Runs {
        let place = self.length;
        if let Some(newest) = runs.newest
            && let Some(shape) = runs.joined(&newest, block, bound)
        {
            self.place_block(Waiting {
                block: *block,
                entry_bound: bound,
                entry: SquaredSpeed::ZERO,
                settled: false,
                starts_run: false,
                run_entry: Speed::ZERO,
            });
            let reach = runs.planning(&shape).reach(Speed::ZERO, shape.length_10nm);
            let entry = newest.entry_bound.min(shape.cruise.root()).min(reach).max(newest.entry);
            let entry = if newest.settled { newest.entry } else { entry };
            runs.newest = Some(Newest { shape, entry, ..newest });
            if entry != newest.entry {
                let first = newest.first.wrapping_sub(runs.left);
                self.set_entry(first, entry);
                self.reverse_pass_over_runs(&runs, first, entry);
            }
            return runs;
        }
        let shape = Shape::of(block);
        // Where all before have left or are leaving, they end with a stop.
        let settled = runs.newest.is_none();
        let entry_bound = bound.root();
        let reach = runs.planning(&shape).reach(Speed::ZERO, shape.length_10nm);
        let entry = if settled { Speed::ZERO } else { entry_bound.min(reach) };
        self.place_block(Waiting {
            block: *block,
            entry_bound: bound,
            entry: SquaredSpeed::ZERO,
            settled,
            starts_run: true,
            run_entry: entry,
        });
        let first = runs.left.wrapping_add(place);
        runs.newest = Some(Newest { shape, first, entry_bound, entry, settled });
        if !settled {
            self.reverse_pass_over_runs(&runs, place, entry);
        }
        runs
    }

    fn set_entry(&mut self, place: usize, entry: Speed) {
        if let Content::Block(waiting) = self.at(place) {
            waiting.run_entry = entry;
        }
    }

    /// From the newest run backwards, until nothing changes any more.
    fn reverse_pass_over_runs(&mut self, runs: &Runs, newest: usize, newest_entry: Speed) {
        let mut exit = newest_entry;
        let mut shape: Option<Shape> = None;
        let mut corner = SquaredSpeed::ZERO;
        for place in (0..newest).rev() {
            let Content::Block(waiting) = self.at(place) else { continue };
            let one = match shape {
                // A run is never longer than what a shape can tell.
                Some(shape) => shape.with(&waiting.block, corner),
                None => Some(Shape::of(&waiting.block)),
            };
            let Some(one) = one else { return };
            if !waiting.starts_run {
                corner = waiting.entry_bound;
                shape = Some(one);
                continue;
            }
            shape = None;
            if waiting.settled {
                return;
            }
            let reach = runs.planning(&one).reach(exit, one.length_10nm);
            let entry = waiting.entry_bound.min(one.cruise).root().min(reach).max(waiting.run_entry);
            if entry == waiting.run_entry {
                return;
            }
            waiting.run_entry = entry;
            exit = entry;
        }
    }

    /// Takes the oldest block or marker, which may leave.
    pub(super) fn pop_from_runs(&mut self, runs: &mut Runs, pace: Pace) -> Option<Left> {
        if let Content::Block(waiting) = *self.at(0)
            && runs.leaving.is_none()
        {
            self.settle(runs, &waiting, pace);
        }
        runs.left = runs.left.wrapping_add(1);
        let waiting = match self.take_first()? {
            Content::Empty => return None,
            Content::Marker(marker) => return Some(Left::Marker(marker)),
            Content::Block(waiting) => waiting,
        };
        self.blocks -= 1;
        self.left_nominal = waiting.block.nominal;
        let leaving = runs.leaving.as_mut()?;
        let part = Part { block: waiting.block, run: leaving.run, offset_10nm: leaving.passed_10nm };
        leaving.passed_10nm = leaving.passed_10nm.saturating_add(waiting.block.length_10nm);
        leaving.blocks = leaving.blocks.saturating_sub(1);
        if leaving.blocks == 0 {
            runs.leaving = None;
        }
        Some(Left::Part(part))
    }

    fn oldest_run(&mut self, first: &Block) -> Oldest {
        let mut oldest = Oldest { shape: Shape::of(first), blocks: 1, next: None };
        let mut seen = 0;
        for place in 0..self.length {
            let Content::Block(waiting) = self.at(place) else { continue };
            seen += 1;
            if seen == 1 {
                continue;
            }
            let grown = oldest.shape.with(&waiting.block, waiting.entry_bound);
            match grown {
                Some(shape) if !waiting.starts_run => {
                    oldest.shape = shape;
                    oldest.blocks += 1;
                }
                _ => {
                    oldest.next = Some(place);
                    break;
                }
            }
        }
        oldest
    }

    /// Settles the law of the oldest run or of its first part.
    fn settle(&mut self, runs: &mut Runs, first: &Waiting, pace: Pace) {
        let oldest = self.oldest_run(&first.block);
        let Oldest { shape, blocks, next } = oldest;
        let planning = runs.planning(&shape);
        let entry = first.run_entry;
        let cruise = shape.cruise.root();
        let held = if pace == Pace::FULL { cruise } else { pace.of(cruise) };
        let most = held.max(entry);
        let most_behind = match next.map(|place| *self.at(place)) {
            Some(Content::Block(waiting)) => waiting.run_entry,
            _ => Speed::ZERO,
        };
        let length = shape.length_10nm;
        let mut exit = planning.exit_within(entry, most_behind.min(held), length);
        if exit > most_behind {
            exit = planning.exit_within(entry, most_behind, length).min(most_behind);
        }
        let peak = planning.peak(entry, exit, most, length);
        let may_grow = next.is_none() && !self.stopped;
        let mut cut = None;
        if peak == most && exit < peak {
            let up = planning.ramp_10nm(entry, peak);
            let down = planning.ramp_10nm(peak, exit);
            cut = self.cut_in_cruise(blocks, up, u64::from(length).saturating_sub(down), peak);
        }
        if cut.is_none() && may_grow {
            cut = self.cut_in_middle(&planning, blocks, length, entry, held);
        }
        let (length_10nm, exit, count) = match cut {
            Some(cut) => (cut.length_10nm, cut.exit, cut.blocks),
            None => (length, exit, blocks),
        };
        let run = Run {
            length_10nm,
            entry,
            peak: planning.peak(entry, exit, most, length_10nm),
            exit,
            acceleration: shape.acceleration,
            jerk: runs.jerk,
        };
        runs.leaving = Some(Leaving { run, passed_10nm: 0, blocks: count });
        match cut.map(|cut| cut.place).or(next) {
            Some(place) => self.begin_run(runs, place, exit, cut.is_some() && next.is_none()),
            None => {
                runs.newest = None;
                self.stopped = true;
            }
        }
    }

    /// A run begins at a place with a speed that is settled; `is_rest` if it is the newest and was cut.
    fn begin_run(&mut self, runs: &mut Runs, place: usize, entry: Speed, is_rest: bool) {
        let Content::Block(waiting) = self.at(place) else { return };
        waiting.run_entry = entry;
        waiting.settled = true;
        waiting.starts_run = true;
        let first = waiting.block;
        let number = runs.left.wrapping_add(place);
        if is_rest {
            let mut shape = Shape::of(&first);
            for place in place + 1..self.length {
                if let Content::Block(waiting) = self.at(place) {
                    shape = shape.with(&waiting.block, waiting.entry_bound).unwrap_or(shape);
                }
            }
            runs.newest = Some(Newest { shape, first: number, entry_bound: entry, entry, settled: true });
        } else if let Some(newest) = &mut runs.newest
            && newest.first == number
        {
            newest.entry = entry;
            newest.settled = true;
        }
    }

    /// The last end of a block of the oldest run that is within these lengths, and not the run's own end.
    fn cut_in_cruise(&mut self, blocks: usize, from_10nm: u64, to_10nm: u64, speed: Speed) -> Option<Cut> {
        let mut found = None;
        self.visit_ends(blocks, |cut| {
            let length = u64::from(cut.length_10nm);
            if length >= from_10nm && length <= to_10nm {
                found = Some(Cut { exit: speed, ..cut });
            }
        });
        found
    }

    /// The end of a block nearest to the middle of the oldest run at which it can be left with a speed from which the rest
    /// can stop; if there is none near, the one with the fastest such speed.
    fn cut_in_middle(
        &mut self,
        planning: &Planning,
        blocks: usize,
        length: u32,
        entry: Speed,
        most: Speed,
    ) -> Option<Cut> {
        let at = |cut: Cut| {
            let stops_from = planning.reach(Speed::ZERO, length - cut.length_10nm);
            let exit = planning.exit_within(entry, stops_from.min(most), cut.length_10nm);
            // Held back by the pace it may be left faster, as long as it can stop.
            let possible = exit <= stops_from && (exit >= entry || planning.fits(entry, exit, cut.length_10nm));
            possible.then_some(Cut { exit, ..cut })
        };
        let mut middle: Option<Cut> = None;
        self.visit_ends(blocks, |cut| {
            let distance = |cut: &Cut| cut.length_10nm.abs_diff(length / 2);
            if middle.is_none_or(|one| distance(&cut) < distance(&one)) {
                middle = Some(cut);
            }
        });
        if let Some(cut) = middle.and_then(at) {
            return Some(cut);
        }
        let mut best: Option<Cut> = None;
        self.visit_ends(blocks, |cut| {
            if let Some(cut) = at(cut)
                && best.is_none_or(|one| cut.exit > one.exit)
            {
                best = Some(cut);
            }
        });
        best
    }

    /// Shows the ends of the oldest run's blocks but the last.
    fn visit_ends(&mut self, blocks: usize, mut look: impl FnMut(Cut)) {
        let mut end = Cut { place: 0, blocks: 0, length_10nm: 0, exit: Speed::ZERO };
        for place in 0..self.length {
            let Content::Block(waiting) = self.at(place) else { continue };
            let length = waiting.block.length_10nm;
            if end.blocks > 0 {
                look(Cut { place, ..end });
            }
            end.blocks += 1;
            if end.blocks == blocks {
                return;
            }
            end.length_10nm = end.length_10nm.saturating_add(length);
        }
    }
}
