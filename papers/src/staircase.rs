//! s(t) of a block under Li's table: a staircase of constant speeds.

use ferrostep_planner::kinematics::UNITS_PER_MM;
use ferrostep_planner::methods::{OtherLaw, SpeedRule};
use ferrostep_planner::piece::{Anchor, Motion, Piece, PieceEnd};
use ferrostep_planner::real::Real;
use ferrostep_planner::time_units::{FRACTION_BITS, HALF_TICK, UNITS_PER_SECOND};
use ferrostep_planner::{Block, PlannedBlock, Speed};

use crate::plan::Plan;
use crate::table::FrequencyTable;

/// Motion of a block in steps of the motor that has the most.
///
/// The length of the block's path in pulses, whole or fractional. A block without a step has none,
/// is slower than any start frequency, and runs at a constant speed. A block of less than one pulse
/// does not constrain the frequencies after it, so it changes no speed: otherwise every speed next
/// to it would have to be below f0, and the next block could begin at any speed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BlockPulses {
    /// Number of pulses in the block.
    pub(crate) count: f64,
    /// Frequency per unit of [`Speed`], Hz.
    per_speed: f64,
}

impl BlockPulses {
    /// Computes the pulses of a block.
    pub(crate) fn of(block: &Block) -> Self {
        let most_256ths = (block.master_steps().saturating_mul(256)).max(block.extruder_256ths.unsigned_abs());
        let count = f64::from(most_256ths) * (1.0 / 256.0);
        let per_mm = count * UNITS_PER_MM as f64 / f64::from(block.length_10nm.max(1));
        Self { count, per_speed: per_mm * (1.0 / 65_536.0) }
    }

    /// Pulse frequency at a speed, Hz.
    pub(crate) fn frequency(&self, speed: Speed) -> f64 {
        f64::from(speed.0) * self.per_speed
    }

    /// Largest speed that does not exceed a frequency.
    pub(crate) fn speed(&self, frequency_hz: f64) -> Speed {
        if self.per_speed > 0.0 { Speed(Real::to_u32(frequency_hz / self.per_speed)) } else { Speed(u32::MAX) }
    }

    /// Fastest exit speed for an entry at `speed`, or fastest entry speed for an exit at `speed`:
    /// F^-1(F(v) + P). Up to f0 no ramp is needed.
    pub(crate) fn reach(&self, table: &FrequencyTable, speed: Speed) -> Speed {
        if self.count < 1.0 {
            return speed;
        }
        let frequency = table.frequency_after(table.pulses_to(self.frequency(speed)) + self.count);
        self.speed(frequency).max(speed)
    }

    /// Slowest exit speed, at least `wanted`, for an entry at `speed`.
    pub(crate) fn slowest(&self, table: &FrequencyTable, speed: Speed, wanted: Speed) -> Speed {
        if self.count < 1.0 {
            return speed;
        }
        let left = table.pulses_to(self.frequency(speed)) - self.count;
        if left <= 0.0 { wanted } else { self.speed(table.frequency_after(left)).max(wanted).min(speed) }
    }
}

/// Time law of a block under the table. Lengths in units of 10 nm, times in time units, from the
/// block's start.
#[derive(Clone, Copy, Debug)]
pub struct Staircase {
    pub(crate) length: f64,
    table: FrequencyTable,
    plan: Plan,
    /// Length per pulse, units of 10 nm; the whole length of a block without pulses.
    per_pulse: f64,
    /// First and last slices of the acceleration; those of the deceleration follow.
    up: [u32; 2],
    down: [u32; 2],
    /// F at the end of the acceleration; F at the start of the deceleration follows.
    up_end: f64,
    down_start: f64,
    /// Duration of the acceleration and of the cruise, s.
    up_s: f64,
    cruise_s: f64,
    duration_ticks: u64,
}

impl Staircase {
    /// Creates the law of a planned block.
    pub(crate) fn new(planned: &PlannedBlock, table: &FrequencyTable) -> Self {
        let block = &planned.block;
        let length = f64::from(block.length_10nm.max(1));
        let pulses = BlockPulses::of(block);
        let nominal = block.nominal.max(planned.entry).max(planned.exit).max(Speed(1));
        let mut plan = if pulses.count > 0.0 {
            let [start, stop, run] = [planned.entry, planned.exit, nominal].map(|speed| pulses.frequency(speed));
            Plan::new(table, pulses.count, start, stop, run)
        } else {
            // The whole path counts as one pulse.
            Plan::new(table, 1.0, 0.0, 0.0, 0.0)
        };
        let mut per_pulse = length / pulses.count;
        if pulses.count <= 0.0 {
            per_pulse = length;
            plan.run_hz = nominal.mm_per_s() * UNITS_PER_MM as f64 / length;
        }
        let up_end = plan.start + plan.acceleration;
        let down_start = plan.stop + plan.deceleration;
        let [start_s, up_end_s, down_start_s, stop_s] =
            [plan.start, up_end, down_start, plan.stop].map(|pulses| table.time_after(pulses));
        let up_s = if plan.acceleration > 0.0 { up_end_s - start_s } else { 0.0 };
        let down_s = if plan.deceleration > 0.0 { down_start_s - stop_s } else { 0.0 };
        let cruise_s = if plan.cruise > 0.0 { plan.cruise / plan.run_hz } else { 0.0 };
        let duration = Real::to_u64((up_s + cruise_s + down_s) * UNITS_PER_SECOND);
        Self {
            length,
            table: *table,
            plan,
            per_pulse,
            up: [table.slice_of(plan.start), table.slice_of(up_end)],
            down: [table.slice_of(down_start), table.slice_of(plan.stop)],
            up_end,
            down_start,
            up_s,
            cruise_s,
            duration_ticks: duration.saturating_add(HALF_TICK) >> FRACTION_BITS,
        }
    }

    /// Returns the piece with this index; `None` after the last.
    fn piece(&self, index: u32) -> Option<Piece<f64>> {
        let Self { plan, table, .. } = self;
        let [up_first, up_last] = self.up;
        let [down_first, down_last] = self.down;
        let ups = if plan.acceleration > 0.0 { up_last - up_first + 1 } else { 0 };
        let downs = if plan.deceleration > 0.0 { down_first - down_last + 1 } else { 0 };
        // Path pulses and seconds at the start, pulses at the end, frequency.
        let (start, start_s, end, frequency_hz) = if index < ups {
            let slice = table.at(up_first + index);
            let next = if index + 1 < ups { table.at(up_first + index + 1).pulses_before } else { self.up_end };
            let from = if index > 0 { slice.pulses_before } else { plan.start };
            let seconds = table.time_after(from) - table.time_after(plan.start);
            (from - plan.start, seconds, next - plan.start, slice.frequency_hz)
        } else if index == ups {
            (plan.acceleration, self.up_s, plan.acceleration + plan.cruise, plan.run_hz)
        } else if index - ups <= downs {
            let number = index - ups - 1;
            let slice = table.at(down_first - number);
            let from = if number > 0 { table.at(down_first - number + 1).pulses_before } else { self.down_start };
            let to = if number + 1 < downs { slice.pulses_before } else { plan.stop };
            let before = plan.acceleration + plan.cruise;
            let seconds = table.time_after(self.down_start) - table.time_after(from);
            (
                before + (self.down_start - from),
                self.up_s + self.cruise_s + seconds,
                before + (self.down_start - to),
                slice.frequency_hz,
            )
        } else {
            return None;
        };
        let is_last = index == ups + downs;
        Some(Piece {
            anchor: Anchor::Start,
            time: start_s * UNITS_PER_SECOND,
            position: start * self.per_pulse,
            motion: Motion::Constant { path: 1.0, time: UNITS_PER_SECOND / (frequency_hz * self.per_pulse) },
            end: if is_last { PieceEnd::Last } else { PieceEnd::FromStart(end * self.per_pulse) },
        })
    }

    /// Time at a path position within the block, time units from the block's start.
    #[cfg(test)]
    pub(crate) fn time(&self, position: f64) -> f64 {
        let Self { plan, table, .. } = self;
        let pulses = position / self.per_pulse;
        let behind = pulses - plan.acceleration;
        let seconds = if behind < 0.0 {
            table.time_after(plan.start + pulses) - table.time_after(plan.start)
        } else if behind < plan.cruise {
            self.up_s + behind / plan.run_hz
        } else {
            let here = self.down_start - (behind - plan.cruise);
            self.up_s + self.cruise_s + table.time_after(self.down_start) - table.time_after(here)
        };
        seconds * UNITS_PER_SECOND
    }
}

/// The pieces of a staircase, in order.
#[derive(Clone, Copy, Debug)]
pub struct StaircasePieces {
    law: Staircase,
    next: u32,
}

impl Iterator for StaircasePieces {
    type Item = Piece<f64>;

    fn next(&mut self) -> Option<Piece<f64>> {
        let piece = self.law.piece(self.next)?;
        self.next += 1;
        Some(piece)
    }
}

/// Li's table as a law for the machine: block by block, with pulses of the motor that has the most.
impl SpeedRule for FrequencyTable {
    type Pieces = StaircasePieces;

    /// Nominal speed, limited to the table's highest frequency.
    fn nominal(&self, block: &Block) -> Speed {
        block.nominal.min(BlockPulses::of(block).speed(self.top_hz()))
    }

    fn reach(&self, block: &Block, speed: Speed) -> Speed {
        BlockPulses::of(block).reach(self, speed)
    }

    fn slowest(&self, block: &Block, speed: Speed, wanted: Speed) -> Speed {
        BlockPulses::of(block).slowest(self, speed, wanted)
    }

    fn law(&self, planned: &PlannedBlock) -> OtherLaw<StaircasePieces> {
        let law = Staircase::new(planned, self);
        OtherLaw { length: law.length, duration_ticks: law.duration_ticks, pieces: StaircasePieces { law, next: 0 } }
    }
}
