//! The plan that the filters look at: the path's pieces of each block, in the order of time.

use super::fixed::PartLaw;
use super::path_pieces::{PathPieces, Polynomial};
use super::plan_ring::{PlanPiece, PlanRing};
use crate::block::PlannedBlock;
use crate::pieces::Pieces;
use crate::pressure_advance::AdvanceLaw;
use crate::square_root::square_root_f32;
use crate::stretches::Stretches;
use crate::time_law::TimeLaw;

/// The plan, as far back as a filter sees.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    pub ring: PlanRing,
    /// The plan so far ends at this tick.
    pub end: u64,
    /// Motor positions there.
    pub steps: [i32; 3],
    pub extruder_256ths: i64,
    /// The extruder's advance there, summed over time: 2^-16 steps times ticks, modulo 2^64.
    advance_sum: i64,
    /// Advance of the blocks to come.
    pub advance: AdvanceLaw,
}

impl Plan {
    /// Empty plan, at standstill.
    // No constant: that would be 6 KB of flash, nearly all of it zeros.
    #[inline(always)]
    pub fn new() -> Self {
        Self {
            ring: PlanRing::NEW,
            end: 0,
            steps: [0; 3],
            extruder_256ths: 0,
            advance_sum: 0,
            advance: AdvanceLaw::NONE,
        }
    }

    /// Starts a new plan from standstill.
    pub fn start(&mut self, tick: u64, steps: [i32; 3], extruder_256ths: i64) {
        self.ring.clear();
        self.end = tick;
        self.steps = steps;
        self.extruder_256ths = extruder_256ths;
    }

    /// Adds a block to the plan. Returns its duration in ticks.
    #[inline(never)]
    pub fn add<P: Pieces>(&mut self, planned: &PlannedBlock, law: &TimeLaw<P>) -> u64 {
        let mut pieces = PathPieces::NONE;
        pieces.add(planned, law);
        let duration = pieces.duration_ticks;
        let begins = self.end;
        let mut before = 0;
        for stretch in Stretches::of(&planned.block) {
            let ends_block = stretch.after_10nm == 0;
            let after = if ends_block {
                duration
            } else {
                nearest_tick(law.time_at(stretch.before_10nm.saturating_add(stretch.length_10nm)))
            };
            let [dx, dy, dz] = stretch.steps;
            let line = [dx, dy, dz, stretch.extruder_256ths];
            let advances = self.advance.advances(stretch.extruder_256ths, stretch.length_10nm);
            let per_length = 1.0 / f64::from(stretch.length_10nm);
            let zero = f64::from(stretch.before_10nm);
            let mut is_planned = false;
            for piece in pieces.iter() {
                let start = ((piece.start + 0.5) as u64).max(before);
                let end = ((piece.end + 0.5) as u64).min(after);
                if start >= end {
                    continue;
                }
                let part = piece.path.after(start as f64 - piece.start).scaled(zero, per_length);
                let turns = if advances { self.advance_turns(&line, &part, end - start) } else { 0 };
                if turns > 0 {
                    self.add_part(begins + start, turns, &line, &part, advances);
                }
                let rest = if turns > 0 { part.after(turns as f64) } else { part };
                self.add_part(begins + start + turns, end - start - turns, &line, &rest, advances);
                is_planned = true;
            }
            if !is_planned {
                // A stretch shorter than a tick is passed at once.
                self.add_rest(begins + before);
            }
            self.ring.end_move(stretch.line, stretch.ends_move);
            let [x, y, z] = self.steps;
            self.steps = [x.wrapping_add(dx), y.wrapping_add(dy), z.wrapping_add(dz)];
            self.extruder_256ths = self.extruder_256ths.wrapping_add(i64::from(stretch.extruder_256ths));
            before = after.max(before);
        }
        self.end = begins + duration;
        duration
    }

    /// Adds `ticks` of rest.
    pub fn rest(&mut self, ticks: u32) {
        self.add_rest(self.end);
        self.end += u64::from(ticks);
    }

    /// Piece in which the motors rest at the end of the plan so far, from a tick on.
    fn resting(&self, start: u64) -> PlanPiece {
        PlanPiece::resting(start, self.steps, self.extruder_256ths, self.advance_sum)
    }

    /// Adds a piece of rest.
    fn add_rest(&mut self, start: u64) {
        self.ring.push(self.resting(start));
    }

    /// Adds a piece that lasts `ticks`, in which this part of the line is done.
    #[inline(never)]
    pub(super) fn add_part(&mut self, start: u64, ticks: u64, line: &[i32; 4], part: &Polynomial, advances: bool) {
        let mut piece = self.resting(start).along(*line, PartLaw::new(part, ticks));
        if advances {
            self.add_advance(&mut piece, part, ticks);
        }
        self.ring.push(piece);
    }

    /// Lets the extruder run ahead in a piece that lasts `ticks`, in which this part of
    /// its line is done.
    #[inline(never)]
    fn add_advance(&mut self, piece: &mut PlanPiece, part: &Polynomial, ticks: u64) {
        let [.., extruder] = piece.line;
        piece.advance = self.advance.slope_at(f64::from(extruder) * part.after(0.5 * ticks as f64).speed);
        // The sum continues from the piece before, and is counted from the start of the line.
        let begun = piece.advance_sum_after(piece.part_after(0), 0).wrapping_sub(piece.advance_sum);
        piece.advance_sum = piece.advance_sum.wrapping_sub(begun);
        self.advance_sum = piece.advance_sum_after(piece.part_after(ticks), ticks);
    }

    /// Ticks after which the filament passes the speed at which the advance has another slope: the
    /// piece is to end there. 0 if it does not.
    #[inline(never)]
    fn advance_turns(&self, line: &[i32; 4], part: &Polynomial, ticks: u64) -> u64 {
        let [.., extruder] = line.map(f64::from);
        let knee = self.advance.knee() / extruder;
        if knee.is_infinite() {
            return 0;
        }
        let Polynomial { speed, acceleration, jerk, .. } = *part;
        let (faster, length) = (part.after(ticks as f64).speed > knee, ticks as f64);
        if faster == (speed > knee) {
            return 0;
        }
        // Single precision is enough: a tick more or less changes nothing, since the advance is
        // continuous there.
        let [missing, acceleration, jerk] = [knee - speed, acceleration, jerk].map(|value| value as f32);
        let root = square_root_f32(acceleration * acceleration + 2.0 * jerk * missing);
        let after = 2.0 * missing / (acceleration + if acceleration < 0.0 { -root } else { root });
        let after = f64::from(after);
        if after > 0.0 && after < length { after as u64 } else { 0 }
    }
}

/// The tick nearest to a time of a block, in time units.
fn nearest_tick(units: u64) -> u64 {
    units.saturating_add(crate::time_units::HALF_TICK) >> crate::time_units::FRACTION_BITS
}
