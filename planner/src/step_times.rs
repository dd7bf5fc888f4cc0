//! When each step of one motor is due: s(t) solved for equally spaced path positions.

mod jerk;
mod pieces;
#[cfg(test)]
mod run_tests;

use crate::real::Real;
use crate::s_curve::law::Along;
use crate::s_curve::staircase::Staircase;
use crate::spacing::Spacing;
use crate::square_root::square_root_f32;
use crate::time_law::{FRACTION_BITS, HALF_TICK, Trapezoid, cruise_time, ramp_time, steps_per_tick};
use jerk::JerkRamp;
use pieces::Pieces;

/// Number of phases of a trapezoid.
const PHASES: usize = 3;

/// How the time advances within a phase.
#[derive(Clone, Copy, Debug)]
enum Pace {
    /// A constant interval.
    Cruise(Cruise),
    /// A constant acceleration.
    Ramp(Ramp),
    /// A constant jerk.
    Jerk(JerkRamp),
}

/// A constant interval between steps.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cruise {
    /// The interval, in time units.
    pub(crate) interval: u64,
    /// What is beyond it, in 2^-16 time units: over millions of steps it adds up.
    pub(crate) beyond: u16,
    /// The interval in whole ticks, the nearest.
    pub(crate) ticks: u32,
    /// By how much those are longer than it, in time units.
    pub(crate) drift: i32,
    /// How many steps at whole ticks add up to [`STAIR_DRIFT`] and [`LONGEST_STAIR_TICKS`] at most; at least 1.
    pub(crate) longest_stair: u32,
}

/// Most that a stair may be off because its one interval is a whole number of ticks, in time units: 31 ticks, 0.4 us.
const STAIR_DRIFT: u32 = 31 << FRACTION_BITS;

/// Most steps of a stair: the players' slots hold as many.
const LONGEST_STAIR: u32 = 1 << 13;

/// Most ticks from a stair's first step to its last, some 25 s: with an interval more, they are still a 32-bit number.
const LONGEST_STAIR_TICKS: u32 = 1 << 31;

impl Cruise {
    const EMPTY: Self = Self { interval: 0, beyond: 0, ticks: 0, drift: 0, longest_stair: 0 };

    #[inline]
    fn new(interval: u64, beyond: u16) -> Self {
        let rounded = interval.saturating_add(HALF_TICK) >> FRACTION_BITS;
        let ticks = rounded as u32;
        // At most half a tick.
        let drift = (ticks << FRACTION_BITS).wrapping_sub(interval as u32) as i32;
        let longest = if rounded > u64::from(u32::MAX) {
            1
        } else {
            (STAIR_DRIFT / drift.unsigned_abs().max(1)).min(LONGEST_STAIR_TICKS / ticks.max(1)).max(1)
        };
        Self { interval, beyond, ticks, drift, longest_stair: longest.min(LONGEST_STAIR) }
    }
}

/// Squared speeds in steps^2/tick^2: at index k from the ramp's slow end, `slow + k * gain`.
///
/// From the slow end, where relative errors would hurt most.
#[derive(Clone, Copy, Debug)]
struct Ramp {
    slow: f32,
    gain: f32,
    /// Speed at the next step.
    speed: f32,
    index: u32,
    /// 1, or -1 as a wrapping number while slowing down.
    direction: u32,
}

/// Time units in two ticks.
const UNITS_IN_TWO_TICKS: f32 = (2u32 << FRACTION_BITS) as f32;

/// What [`Ramp::units_and_half`] gives, as a whole number: the nearest, for cut they would add up.
#[inline(always)]
fn whole_units(units_and_half: f32) -> u64 {
    // One instruction, and enough for all but slow steps.
    let short = units_and_half as u32;
    if short < u32::MAX { u64::from(short) } else { units_and_half.to_u64() }
}

impl Ramp {
    /// Goes on to the next step; how long it takes, in time units, and half of one.
    #[inline(always)]
    fn units_and_half(&mut self) -> f32 {
        self.index = self.index.wrapping_add(self.direction);
        let speed = square_root_f32(self.slow + self.index as f32 * self.gain);
        let units = UNITS_IN_TWO_TICKS / (self.speed + speed);
        self.speed = speed;
        units + 0.5
    }
}

/// Longest ramp that is run: the numbers of its steps are exact in f32.
const LONGEST_RUN: u32 = 1 << 24;

/// Steps of a ramp that are taken one after the other.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RampRun(ferrostep_square_root::Ramp);

impl RampRun {
    /// Takes a step. Time units from it to the next one, cut to 32 bits; no matter what behind a ramp's last step.
    #[inline(always)]
    pub(crate) fn take(&mut self) -> u32 {
        self.0.advance()
    }

    /// What [`Self::take`] has told last.
    #[inline(always)]
    pub(crate) fn short_units(&self) -> u32 {
        self.0.interval_and_half as u32
    }

    /// The same, not cut.
    #[inline(always)]
    pub(crate) fn units(&self) -> u64 {
        whole_units(self.0.interval_and_half)
    }
}

/// The steps of one phase.
#[derive(Clone, Copy, Debug)]
struct Phase {
    count: u32,
    /// When its first step is due.
    first: u64,
    pace: Pace,
}

impl Phase {
    const EMPTY: Self = Self { count: 0, first: 0, pace: Pace::Cruise(Cruise::EMPTY) };

    /// `count` steps of a ramp, told from its slow end, where the speed is `end`: lengths from there to the slowest and
    /// to the first step, and the index of the first from the slowest. And how long it takes from the slow end to the
    /// first step.
    #[inline]
    fn ramp<F: Real>(law: &Trapezoid<F>, steps: &Spacing<F>, end: F, lengths: [F; 2], index: u32) -> (Pace, F) {
        let [to_slowest, to_first] = lengths;
        let end_squared = end * end;
        let steps_per_tick = steps_per_tick(steps.per_spacing);
        let square = steps_per_tick * steps_per_tick;
        let speed = (end_squared + law.gain * to_first).square_root();
        let ramp = Ramp {
            slow: ((end_squared + law.gain * to_slowest) * square).to_f32(),
            gain: (law.gain * steps.spacing * square).to_f32(),
            speed: (speed * steps_per_tick).to_f32(),
            index,
            direction: if index == 0 { 1 } else { u32::MAX },
        };
        (Pace::Ramp(ramp), ramp_time(to_first, end, speed))
    }
}

/// The phases of a trapezoid, worked out before its first step.
#[derive(Clone, Copy, Debug)]
struct Phases {
    phases: [Phase; PHASES],
    /// Those that have steps and are still to come: bit i = phase i.
    to_come: u8,
}

impl Phases {
    const NONE: Self = Self { phases: [Phase::EMPTY; PHASES], to_come: 0 };

    /// Takes the next one that has steps.
    #[inline]
    fn take(&mut self) -> Option<Phase> {
        let phase = self.phases.get(self.to_come.trailing_zeros() as usize).copied();
        // All but the lowest bit.
        self.to_come &= self.to_come.wrapping_sub(1);
        phase
    }
}

/// The step times of a motor along one stretch of a block, in units of 2^-16 tick from the block's start, never
/// decreasing.
///
/// Each phase begins anew from its own time, so that rounding never adds up over more than a phase. Inside a ramp the
/// interval is 2h/(v_k + v_k+1) with v_k = sqrt(v_0^2 + 2 a h k), in f32; inside the cruise it is constant.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StepTimes {
    /// When the next step is due, of those `left`. Without any it has no meaning: [`Self::next`] is the only way to it.
    due: u64,
    /// Steps left in the phase; without any, no step is due any more.
    left: u32,
    pace: Pace,
    /// 2^-16 time units that `due` lacks.
    beyond: u32,
    phases: Phases,
    /// What the phases after those are made of.
    pieces: Pieces,
}

impl StepTimes {
    /// No steps.
    pub(crate) const NONE: Self =
        Self { due: 0, left: 0, pace: Phase::EMPTY.pace, beyond: 0, phases: Phases::NONE, pieces: Pieces::None };

    /// Starts with the steps of a block, none of them due before `earliest`.
    #[inline]
    pub(crate) fn start<F: Real>(&mut self, law: &Trapezoid<F>, steps: &Spacing<F>, earliest: u64) {
        self.phases.to_come = 0;
        if steps.count > 0 {
            self.set_phases(law, steps);
        }
        self.pieces = Pieces::None;
        self.begin(earliest);
    }

    /// The same along a block of a run.
    pub(crate) fn start_run(&mut self, law: &Along, steps: &Spacing<f64>, earliest: u64) {
        self.phases.to_come = 0;
        self.pieces = Pieces::Run { law: *law, steps: *steps, next: 0, done: 0 };
        self.begin(earliest);
    }

    /// The same along a block at the frequencies of a table.
    pub(crate) fn start_staircase(&mut self, law: &Staircase, steps: &Spacing<f64>, earliest: u64) {
        self.phases.to_come = 0;
        self.pieces = Pieces::Staircase { law: *law, steps: *steps, next: 0, done: 0 };
        self.begin(earliest);
    }

    /// Begins with the first phase that has steps. Phases and pieces are those of the new stretch, and every other field is set
    /// here or by [`Self::enter_phase`]: nothing of a block that was abandoned half-way remains.
    #[inline]
    fn begin(&mut self, earliest: u64) {
        self.due = earliest;
        self.left = 0;
        self.beyond = 0;
        self.enter_phase();
    }

    /// How many steps each phase has, and the time of its first.
    #[inline]
    fn set_phases<F: Real>(&mut self, law: &Trapezoid<F>, steps: &Spacing<F>) {
        let &Spacing { count, first, after_last, spacing, per_spacing } = steps;
        // The first step in a length, and as many as spacings fit behind it. Casts saturate.
        let fitting = |length: F| (length * per_spacing + F::from_u32(1)).to_u32();
        let up = if law.up > F::ZERO { fitting(law.up - first).min(count) } else { 0 };
        let down = match (law.down > F::ZERO, law.cruise > F::ZERO) {
            (true, true) => fitting(law.down - after_last).min(count - up),
            // Without a cruise, the ramps share all steps, whatever the rounding.
            (true, false) => count - up,
            (false, _) => 0,
        };
        let up = if law.cruise > F::ZERO || down > 0 { up } else { count };
        let cruise = count - up - down;
        let Phases { phases: [phase_up, phase_cruise, phase_down], to_come } = &mut self.phases;
        if up > 0 {
            *to_come |= 1;
            let (pace, delay) = Phase::ramp(law, steps, law.entry, [first, first], 0);
            *phase_up = Phase { count: up, first: delay.to_u64(), pace };
        }
        if cruise > 0 {
            *to_come |= 2;
            let inside = first + F::from_u32(up) * spacing - law.up;
            let inside = if inside > F::ZERO { inside } else { F::ZERO };
            let delay = law.up_time + cruise_time(inside, law.peak);
            let interval = cruise_time(spacing, law.peak);
            let whole = interval.to_u64();
            let beyond = (interval * F::from_u32(1 << 16)).to_u64() as u16;
            let pace = Pace::Cruise(Cruise::new(whole, beyond));
            *phase_cruise = Phase { count: cruise, first: delay.to_u64(), pace };
        }
        if down > 0 {
            *to_come |= 4;
            let index = down - 1;
            let to_first = after_last + F::from_u32(index) * spacing;
            let (pace, rest) = Phase::ramp(law, steps, law.exit, [after_last, to_first], index);
            *phase_down = Phase { count: down, first: (law.duration - rest).to_u64(), pace };
        }
    }

    /// When the next step is due; `None` after the last.
    #[inline]
    pub(crate) fn next(&self) -> Option<u64> {
        if self.left > 0 { Some(self.due) } else { None }
    }

    /// Ticks from `last`, a whole tick, up to which no step is due; cut to 32 bits.
    #[inline]
    pub(crate) fn ticks_from(&self, last: u64) -> u32 {
        let Some(due) = self.next() else { return u32::MAX };
        let after = due.wrapping_add(HALF_TICK).wrapping_sub(last);
        if after.cast_signed() < 0 { 0 } else { u32::try_from(after >> FRACTION_BITS).unwrap_or(u32::MAX) }
    }

    /// In the cruise: its interval, and how many steps are left in it, the next one included.
    #[inline]
    pub(crate) fn cruise(&self) -> Option<(Cruise, u32)> {
        match self.pace {
            Pace::Cruise(cruise) => Some((cruise, self.left)),
            Pace::Ramp(_) | Pace::Jerk(_) => None,
        }
    }

    /// 2^-16 time units by which the next step is due later.
    #[inline]
    pub(crate) fn beyond(&self) -> u32 {
        self.beyond
    }

    /// In the cruise: `count` steps were taken. The next one of the cruise would be due at `due`, and `beyond` later.
    #[inline]
    pub(crate) fn end_cruise(&mut self, count: u32, due: u64, beyond: u32) {
        self.left = self.left.wrapping_sub(count);
        self.due = due;
        self.beyond = beyond;
        if self.left == 0 {
            // Not before the last one.
            if let Pace::Cruise(cruise) = &self.pace {
                self.due = due.wrapping_sub(cruise.interval);
            }
            self.enter_phase();
        }
    }

    /// In a ramp: its next steps, to be taken one after the other, at most as many as are told.
    #[inline(always)]
    pub(crate) fn run(&self) -> Option<(RampRun, u32)> {
        match self.pace {
            Pace::Ramp(Ramp { slow, gain, speed, index, direction }) if self.left > 0 && index < LONGEST_RUN => {
                let (most, direction) =
                    if direction == 1 { (LONGEST_RUN - index, 1.0) } else { (index.saturating_add(1), -1.0) };
                let run = ferrostep_square_root::Ramp::new(
                    [index as f32, direction],
                    speed,
                    [slow, gain],
                    UNITS_IN_TWO_TICKS,
                );
                Some((RampRun(run), most.min(self.left)))
            }
            _ => None,
        }
    }

    /// Takes over what a run has done, which took `count` steps. The one behind the last would be due at `due` if that
    /// `is_next`; if not, the last one taken was.
    #[inline(always)]
    pub(crate) fn end_run(&mut self, run: &RampRun, count: u32, due: u64, is_next: bool) {
        self.due = due;
        self.left = self.left.wrapping_sub(count);
        if self.left == 0 {
            if is_next && count > 0 {
                // Not before the last one.
                self.due = due.wrapping_sub(run.units());
            }
            self.enter_phase();
            return;
        }
        if let Pace::Ramp(ramp) = &mut self.pace {
            ramp.speed = run.0.speed;
            ramp.index = run.0.index as u32;
        }
        if !is_next {
            self.due = due.wrapping_add(run.units());
        }
    }

    /// Takes `count` steps; more than one only where [`Self::cruise`] has as many.
    #[inline]
    pub(crate) fn take(&mut self, count: u32) {
        self.left = self.left.wrapping_sub(count);
        if self.left == 0 {
            self.enter_phase();
        } else {
            self.pass(count);
        }
    }

    /// The time of the next step in the same phase.
    #[inline]
    fn pass(&mut self, count: u32) {
        match &mut self.pace {
            Pace::Ramp(ramp) => self.due = self.due.wrapping_add(whole_units(ramp.units_and_half())),
            Pace::Jerk(ramp) => self.due = self.due.wrapping_add(ramp.units()),
            Pace::Cruise(cruise) => {
                let beyond = self.beyond.wrapping_add(u32::from(cruise.beyond).wrapping_mul(count));
                self.beyond = beyond & 0xffff;
                let passed = cruise.interval.wrapping_mul(u64::from(count)).wrapping_add(u64::from(beyond >> 16));
                self.due = self.due.wrapping_add(passed);
            }
        }
    }

    /// Begins with the next phase that has steps.
    #[inline(never)]
    fn enter_phase(&mut self) {
        // All phases that are there have steps.
        let Some(phase) = self.phases.take().or_else(|| self.pieces.next_phase()) else { return };
        self.pace = phase.pace;
        self.beyond = 0;
        self.due = self.due.max(phase.first);
        self.left = phase.count;
    }
}
