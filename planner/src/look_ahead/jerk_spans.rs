//! Look-ahead under an S-curve: neighbouring blocks share one time law.
//!
//! If every block began and ended without acceleration, curves of short blocks would never gain
//! speed. So blocks leave in *runs*, each under one law, and the acceleration is zero at the ends
//! of runs only. Li 2017 plans segment by segment, without runs. The best places for an end are
//! those with the lowest speed, where the acceleration is zero anyway.
//!
//! - *Reverse pass.* Each corner gets the speed from which, without acceleration there, everything
//!   after it is possible: by one ramp to an *anchor*, a later corner whose speed is already known,
//!   over all blocks between and no faster than any of them or of the corners between. The anchor
//!   is kept as long as that gives more than a ramp to the next corner; otherwise the next corner
//!   becomes the anchor.
//! - *A run is settled when its first block leaves.* It ends at the first limiting corner, one
//!   whose own bound limits the speed and that can be reached with that speed; the law is asked
//!   whether the corners between are passed slowly enough. If one is not, the run is made slower,
//!   or ends there, whichever takes less time.
//! - A run is cut where it cruises, if that is at the end of a block: this costs nothing, and later
//!   blocks may still become faster. A run that ends at the last known block and has no such place
//!   is cut in its middle.
//!
//! One thing differs from constant acceleration: slowing down to a small x takes longer than
//! slowing down to a standstill, because the acceleration has to be zero at x
//! ([`crate::s_curve::bounds`]). So a corner's speed could fall when the anchor's rises. It is then
//! kept, with its anchor: speeds possible before remain possible, perhaps with less than the
//! anchor's speed there.

use crate::block::{Acceleration, Block, Speed};
use crate::pace::Pace;
use crate::ring::{Content, Ring, RingMemory, Waiting};
use crate::s_curve::run::Planning;
use crate::s_curve::{Jerk, Jerks, Run};
use crate::speed_plan::{Part, Released};

/// The run whose blocks are leaving.
#[derive(Clone, Copy, Debug)]
struct Leaving {
    run: Run,
    passed_10nm: u32,
    blocks: usize,
}

/// State of look-ahead under an S-curve, besides the ring.
#[derive(Clone, Copy, Debug)]
pub(super) struct Runs {
    jerks: Jerks,
    /// True if blocks share laws.
    joins: bool,
    leaving: Option<Leaving>,
}

/// A corner as the end of a run that begins at the oldest block.
#[derive(Clone, Copy, Debug)]
struct End {
    /// Place of the block after the corner; the ring's length without such a block.
    place: usize,
    /// Number of blocks before the corner, their length, and the smallest of their accelerations
    /// and of their jerks.
    blocks: usize,
    length_10nm: u32,
    acceleration: Acceleration,
    jerk: Jerk,
    /// Largest nominal speed of these blocks.
    fastest: Speed,
    /// Bound of the speed at the corner, and the speed from which everything after it is possible.
    bound: Speed,
    speed: Speed,
    /// Nominal speed of the last of these blocks.
    nominal: Speed,
    /// True if no later block is known.
    is_last: bool,
}

impl End {
    /// Start of the search.
    const NONE: Self = Self {
        place: 0,
        blocks: 0,
        length_10nm: 0,
        acceleration: Acceleration::MAX,
        jerk: Jerk::MAX,
        fastest: Speed::ZERO,
        bound: Speed::ZERO,
        speed: Speed::ZERO,
        nominal: Speed::ZERO,
        is_last: false,
    };
}

/// Speeds of a run up to an end.
#[derive(Clone, Copy, Debug)]
struct Speeds {
    peak: Speed,
    exit: Speed,
}

/// The corner to which a ramp goes from earlier corners.
#[derive(Clone, Copy, Debug)]
struct Anchor {
    place: usize,
    speed: Speed,
    /// Path to the corner, and the smallest acceleration and jerk and the slowest nominal speed or
    /// corner on it.
    length_10nm: u32,
    acceleration: Acceleration,
    jerk: Jerk,
    slowest: Speed,
}

impl Anchor {
    /// The span extended by one earlier block.
    fn with_block_before(&self, block: &Block, jerk: Jerk) -> Self {
        Self {
            length_10nm: self.length_10nm.saturating_add(block.length_10nm),
            acceleration: self.acceleration.min(block.acceleration),
            jerk: self.jerk.min(jerk),
            slowest: self.slowest.min(block.nominal),
            ..*self
        }
    }

    /// Highest speed from which one ramp can reach the anchor.
    fn reach(&self) -> Speed {
        if self.slowest <= self.speed {
            return self.slowest;
        }
        Planning::new(self.jerk, self.acceleration).reach(self.speed, self.length_10nm).min(self.slowest)
    }
}

/// Number of steps in which a run is made slower.
const SLOWER_STEPS: u32 = 8;

impl Runs {
    pub(super) fn new(jerks: Jerks, joins: bool) -> Self {
        Self { jerks, joins, leaving: None }
    }

    pub(super) fn clear(&mut self) {
        self.leaving = None;
    }

    /// Adds a block to a ring that has room.
    pub(super) fn push<S: RingMemory>(&self, ring: &mut Ring<S>, block: &Block, bound: Speed) {
        let newest = ring.len();
        ring.push(Waiting { block: *block, entry_bound: bound.into(), bound_speed: bound, anchor: 1, ..Waiting::NONE });
        self.reverse_pass_over_corners(ring, newest);
    }

    /// Walks backwards from the newest corner to one that already has its highest possible speed.
    fn reverse_pass_over_corners<S: RingMemory>(&self, ring: &mut Ring<S>, newest: usize) {
        let end = Anchor {
            place: newest + 1,
            speed: Speed::ZERO,
            length_10nm: 0,
            acceleration: Acceleration::MAX,
            jerk: Jerk::MAX,
            slowest: Speed(u32::MAX),
        };
        let mut anchor = end;
        // The corner after the present block.
        let mut next = end;
        for place in (0..=newest).rev() {
            let Some(Content::Block(waiting)) = ring.at(place) else { continue };
            if waiting.settled {
                return;
            }
            let jerk = self.jerks.of(&waiting.block);
            anchor = anchor.with_block_before(&waiting.block, jerk);
            next = next.with_block_before(&waiting.block, jerk);
            let mut reach = anchor.reach();
            if anchor.place != next.place {
                let beside = next.reach();
                if beside > reach || !self.joins || anchor.place - place > usize::from(u8::MAX) {
                    anchor = next;
                    reach = beside;
                }
            }
            let entry = reach.min(waiting.bound_speed);
            let before = waiting.entry_speed;
            if entry > before {
                waiting.entry_speed = entry;
                // Only markers can put the next corner further away.
                waiting.anchor = u8::try_from(anchor.place - place).unwrap_or(u8::MAX);
            } else if before == waiting.bound_speed && place != newest {
                return;
            }
            anchor.slowest = anchor.slowest.min(waiting.bound_speed);
            next = Anchor { place, speed: waiting.entry_speed, ..end };
        }
    }

    /// Takes the oldest block or marker, which may leave.
    pub(super) fn pop<S: RingMemory>(&mut self, ring: &mut Ring<S>, pace: Pace) -> Option<Released> {
        let Some(Content::Block(waiting)) = ring.first().copied() else {
            return ring.pop_marker().map(Released::Marker);
        };
        let mut leaving = match self.leaving {
            Some(leaving) => leaving,
            None => self.settle(ring, &waiting, pace),
        };
        ring.pass_block();
        ring.last_nominal = waiting.block.nominal;
        let part = Part { block: waiting.block, run: leaving.run, offset_10nm: leaving.passed_10nm };
        leaving.passed_10nm = leaving.passed_10nm.saturating_add(waiting.block.length_10nm);
        leaving.blocks = leaving.blocks.saturating_sub(1);
        self.leaving = (leaving.blocks > 0).then_some(leaving);
        Some(Released::Part(part))
    }

    /// Settles the law of the next blocks to leave.
    fn settle<S: RingMemory>(&self, ring: &mut Ring<S>, first: &Waiting, pace: Pace) -> Leaving {
        let entry = first.entry_speed;
        let settling = Settling { jerks: self.jerks, joins: self.joins, entry, pace };
        let mut end = settling.first_limit(ring);
        let mut law = None;
        while law.is_none() {
            match settling.law_to(ring, &end) {
                Ok(speeds) => law = Some((end, speeds)),
                Err(Some(nearer)) => end = nearer,
                Err(None) => break,
            }
        }
        let (mut end, mut speeds) = law.unwrap_or_else(|| settling.granted(ring, first));
        let may_grow = end.is_last && !ring.stopped;
        if let Some(cut) = settling.cut_in_cruise(ring, &end, &speeds) {
            // Results of a law hold for that law only.
            end = End { acceleration: end.acceleration, jerk: end.jerk, ..cut };
            speeds.exit = speeds.peak;
        } else if may_grow && let Some((cut, slower)) = settling.cut_in_middle(ring, &end) {
            (end, speeds) = (cut, slower);
        }
        let is_in_ring = end.place < ring.len();
        match ring.at(end.place) {
            Some(Content::Block(waiting)) if is_in_ring => {
                waiting.entry_speed = speeds.exit;
                waiting.settled = true;
            }
            _ => ring.stopped = true,
        }
        let Speeds { peak, exit } = speeds;
        let End { length_10nm, acceleration, jerk, blocks, .. } = end;
        let run = Run { length_10nm, entry, peak, exit, acceleration, jerk };
        Leaving { run, passed_10nm: 0, blocks }
    }
}

/// State at the start of a run.
#[derive(Clone, Copy, Debug)]
struct Settling {
    jerks: Jerks,
    /// True if blocks share laws.
    joins: bool,
    entry: Speed,
    pace: Pace,
}

impl Settling {
    fn planning(&self, end: &End) -> Planning {
        Planning::new(end.jerk, end.acceleration)
    }

    /// Speed at which an end can be reached such that everything after it is possible, and the
    /// highest speed on the way; `None` if no speed qualifies.
    fn exit(&self, end: &End) -> Option<(Speed, Speed)> {
        let planning = self.planning(end);
        let held = if self.pace == Pace::FULL { end.fastest } else { self.pace.of(end.fastest) };
        let length = end.length_10nm;
        let mut exit = planning.exit_within(self.entry, end.speed.min(held), length);
        if exit > end.speed {
            exit = planning.exit_within(self.entry, end.speed, length);
        }
        (exit <= end.speed && planning.fits(self.entry, exit, length)).then_some((exit, held.max(self.entry)))
    }

    /// Visits the corners from the oldest on, the ring's end included, until `look` finds
    /// something.
    fn find_end<S: RingMemory, T>(&self, ring: &Ring<S>, mut look: impl FnMut(&End) -> Option<T>) -> Option<T> {
        let mut end = End::NONE;
        for place in 0..ring.len() {
            let Some(Content::Block(waiting)) = ring.get(place) else { continue };
            let block = &waiting.block;
            if end.blocks > 0 {
                end = End { place, bound: waiting.bound_speed, speed: waiting.entry_speed, ..end };
                if let Some(found) = look(&end) {
                    return Some(found);
                }
            }
            end.blocks += 1;
            // A run is at most 42 m long; beyond that, the result so far must do.
            end.length_10nm = end.length_10nm.checked_add(block.length_10nm)?;
            end.acceleration = end.acceleration.min(block.acceleration);
            end.jerk = end.jerk.min(self.jerks.of(block));
            end.fastest = end.fastest.max(block.nominal);
            end.nominal = block.nominal;
        }
        end = End { place: ring.len(), bound: Speed::ZERO, speed: Speed::ZERO, is_last: true, ..end };
        look(&end)
    }

    /// The first limiting corner that can be reached with its speed, or the last of all.
    fn first_limit<S: RingMemory>(&self, ring: &Ring<S>) -> End {
        let mut last = None;
        let found = self.find_end(ring, |end| {
            last = Some(*end);
            let limits = end.speed == end.bound && self.planning(end).reach(self.entry, end.length_10nm) >= end.speed;
            (end.is_last || limits || !self.joins).then_some(*end)
        });
        found.or(last).unwrap_or(End::NONE)
    }

    /// Speeds of one run to an end, or a better, nearer end; `None` if the end cannot be reached.
    fn law_to<S: RingMemory>(&self, ring: &Ring<S>, end: &End) -> Result<Speeds, Option<End>> {
        let Some((exit, most)) = self.exit(end) else { return Err(None) };
        let planning = self.planning(end);
        let (entry, length) = (self.entry, end.length_10nm);
        let peak = planning.peak(entry, exit, most, length);
        let Some(passed) = self.too_fast(ring, end, &Speeds { peak, exit }) else {
            return Ok(Speeds { peak, exit });
        };
        let least = entry.max(exit);
        if self.too_fast(ring, end, &Speeds { peak: least, exit }).is_some() {
            return Err(Some(passed));
        }
        let (mut low, mut high) = (least, peak);
        for _ in 0..SLOWER_STEPS {
            let middle = Speed(low.0.midpoint(high.0));
            match self.too_fast(ring, end, &Speeds { peak: middle, exit }) {
                None => low = middle,
                Some(_) => high = middle,
            }
        }
        let slower = planning.duration(entry, exit, low, length);
        let parts = self.exit(&passed).map(|(corner, most_before)| {
            let (before, rest) = (passed.length_10nm, length - passed.length_10nm);
            planning.duration(entry, corner, most_before, before)
                + planning.duration(corner, planning.exit_within(corner, exit, rest), most, rest)
        });
        match parts {
            Some(parts) if parts < slower => Err(Some(passed)),
            _ => Ok(Speeds { peak: low, exit }),
        }
    }

    /// The first corner or block that a run would pass too fast, as an end.
    fn too_fast<S: RingMemory>(&self, ring: &Ring<S>, end: &End, speeds: &Speeds) -> Option<End> {
        let hump = self.planning(end).hump(self.entry, speeds.peak, speeds.exit, end.length_10nm);
        let cruise = hump.cruise_10nm();
        let mut before: Option<End> = None;
        self.find_end(ring, |corner| {
            let start = before.map_or(0, |end| end.length_10nm);
            let cruises = start < cruise[1] && corner.length_10nm > cruise[0];
            if speeds.peak > corner.nominal && cruises {
                return Some(before.or((corner.place < end.place).then_some(*corner)));
            }
            if corner.place >= end.place {
                return Some(None);
            }
            before = Some(*corner);
            // Most corners do not limit at all.
            let is_too_fast = speeds.peak > corner.bound && hump.is_faster_at(corner.length_10nm, corner.bound);
            is_too_fast.then_some(Some(*corner))
        })
        .flatten()
    }

    /// The run granted by the reverse pass: one ramp to the anchor, at its speed or as close to it
    /// as possible.
    fn granted<S: RingMemory>(&self, ring: &Ring<S>, first: &Waiting) -> (End, Speeds) {
        let place = usize::from(first.anchor);
        let mut last = None;
        let found = self.find_end(ring, |end| {
            last = Some(*end);
            (end.is_last || end.place >= place).then_some(*end)
        });
        let end = found.or(last).unwrap_or(End::NONE);
        let entry = self.entry;
        // The anchor may have become faster since then; the blocks and corners before it have not.
        let wanted = end.speed.min(entry);
        let exit = self.planning(&end).exit_within(entry, wanted, end.length_10nm).min(wanted);
        (end, Speeds { peak: entry, exit })
    }

    /// The last corner that a run passes while cruising, before it slows down, at a speed that was
    /// granted there.
    fn cut_in_cruise<S: RingMemory>(&self, ring: &Ring<S>, end: &End, speeds: &Speeds) -> Option<End> {
        if speeds.exit >= speeds.peak {
            return None;
        }
        let hump = self.planning(end).hump(self.entry, speeds.peak, speeds.exit, end.length_10nm);
        let [from, to] = hump.cruise_10nm();
        let mut found = None;
        self.find_end(ring, |corner| {
            if corner.place >= end.place {
                return Some(());
            }
            let length = corner.length_10nm;
            if length >= from && length <= to && speeds.peak <= corner.speed {
                found = Some(*corner);
            }
            None
        });
        found
    }

    /// The corner nearest to the middle of a run at which the run can end, or otherwise the one
    /// with the highest end speed.
    fn cut_in_middle<S: RingMemory>(&self, ring: &Ring<S>, end: &End) -> Option<(End, Speeds)> {
        let mut middle: Option<End> = None;
        self.find_end(ring, |corner| {
            let distance = |corner: &End| corner.length_10nm.abs_diff(end.length_10nm / 2);
            if corner.place >= end.place {
                return Some(());
            }
            if middle.is_none_or(|one| distance(corner) < distance(&one)) {
                middle = Some(*corner);
            }
            None
        });
        let middle = middle?;
        if let Ok(speeds) = self.law_to(ring, &middle) {
            return Some((middle, speeds));
        }
        let mut best: Option<(End, Speed)> = None;
        self.find_end(ring, |corner| {
            if corner.place >= end.place {
                return Some(());
            }
            if let Some((exit, _)) = self.exit(corner)
                && best.is_none_or(|(_, one)| exit > one)
            {
                best = Some((*corner, exit));
            }
            None
        });
        let (best, _) = best?;
        self.law_to(ring, &best).ok().map(|speeds| (best, speeds))
    }
}
