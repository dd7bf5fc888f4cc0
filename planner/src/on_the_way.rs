//! Filament moves on the way: a retraction spread over the first of the travels after it, a
//! recovery over the last of the travels before it, instead of a stop for each.
//!
//! A *way* is the travels between two lines, a lift and a lowering among them, from rest to
//! rest. It keeps the speeds that it has without filament. The filament moves as fast as it can
//! along them: in proportion to the path where the path accelerates or brakes at its stops and
//! corners, at the speed that its own line asks for elsewhere, and at the end of a retraction
//! down to rest by steps of the speed that the extruder may make at once. Where one of these
//! laws changes a *stage* ends: within a stage, filament is in proportion to path. A recovery is
//! a retraction seen backwards.
//!
//! A way that is too short for the filament is slowed down as a whole, if that takes less
//! time than a stop.

mod course;

use crate::limits::{larger, smaller};
use crate::square_root::square_root_f32;

use course::{Course, Phase};
pub(crate) use course::{Leg, Way, join};

/// The shortest travel that filament moves along with, units of 10 nm: what is shorter has no
/// parts worth the name.
pub(crate) const LEAST_TRAVEL_10NM: u32 = 5_000;

/// The most travels of a way: two lifts, for a layer's end has one more, two
/// travels and a lowering.
pub(crate) const MOST_LEGS: usize = 5;

/// Largest change of the extruder's speed at once, mm/s, if the limits set none: the usual "jerk"
/// of the extruder in other firmware, which motors take from standstill.
pub(crate) const EXTRUDER_JUMP_MM_PER_S: f32 = 5.0;

/// Share of the speed of fast filament for the same: more stages would be more blocks.
const LARGEST_JUMP: f32 = 0.2;

/// No stage is planned shorter, s: stages are pieces of the plan, and filters see a
/// limited number of them.
const LEAST_STAGE_S: f32 = 0.003;

/// Factor by which the path's speed grows in a stage in which the filament's speed is constant:
/// from stage to stage the extruder's speed changes by a fifth, [`LARGEST_JUMP`].
const GROWTH: f32 = 1.25;

/// A stage by which the filament's speed rises or falls takes this share of the extruder's largest
/// jump, since the path's speed changes within the stages as well.
const STEP: f32 = 0.75;

/// The most stages of a filament move.
const MOST_STAGES: u8 = 64;

/// Bisections in the search for the end of a filament move.
const HALVINGS: u32 = 8;

/// The most that a way is slowed down.
const MOST_SLOWNESS: f32 = 4.0;

/// Maximum number of times that a way is slowed down further, or a filament move given more time.
const MOST_TRIALS: u32 = 6;

/// Factor by which a filament move is given more time.
const LENGTHENING: f32 = 1.6;

/// Largest change of the filament's speed at once between stages, mm/s, for this feed.
pub(crate) fn stage_jump_mm_per_s(feed_mm_per_s: f32) -> f32 {
    larger(EXTRUDER_JUMP_MM_PER_S, LARGEST_JUMP * feed_mm_per_s)
}

/// Time within a leg in which filament moves: no faster than a ramp from its start, and a
/// ramp to its end.
#[derive(Clone, Copy, Debug)]
struct Window {
    /// Time before the leg's start at which the ramp up starts, s.
    head_s: f32,
    /// Time after the leg's start at which the ramp down ends, s.
    left_s: f32,
    /// End of its last stage, s.
    stop_s: f32,
    /// The ramps are others than the path's in its corners.
    is_head_cut: bool,
    is_end_cut: bool,
}

/// Filament that is drawn back along the start of a way, or pushed along its end
/// and seen backwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FilamentLaw {
    /// Filament to move, mm, above zero.
    pub filament_mm: f32,
    /// The highest speed and acceleration, mm/s, mm/s^2.
    pub feed_mm_per_s: f32,
    pub acceleration_mm_per_s2: f32,
    /// No stage may have less acceleration of the path than its leg: an S-curve takes the least of
    /// several blocks for all of them.
    pub keeps_acceleration: bool,
}

/// A part of a leg along which filament moves in proportion to the path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stage {
    /// The leg, counted from where the filament's law begins.
    pub leg: usize,
    /// Place in the leg where it begins, seen from there too, mm.
    pub begin_mm: f32,
    pub end_mm: f32,
    /// True if the stage begins (ends) where the leg does.
    pub begins_leg: bool,
    pub ends_leg: bool,
    /// Filament that could move along it, mm.
    filament_mm: f32,
    /// Time of the leg's start, and the stage's end within the leg, s.
    leg_begin_s: f32,
    end_s: f32,
}

/// Distribution of a filament move along a way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Ride {
    /// Duration, s.
    end_s: f32,
    /// Share of the movable filament that moves.
    share: f32,
    /// Number of stages.
    pub stages: u8,
    /// The leg of the last one, counted from where the filament's law begins, whether it ends where
    /// the leg does, and where in it, mm.
    pub leg: u8,
    pub ends_leg: bool,
    pub end_mm: f32,
}

impl FilamentLaw {
    /// Duration of the filament move by itself, s.
    fn duration_s(&self) -> f32 {
        let reached = square_root_f32(self.filament_mm * self.acceleration_mm_per_s2);
        let peak = smaller(reached, self.feed_mm_per_s);
        self.filament_mm / peak + peak / self.acceleration_mm_per_s2
    }

    /// Acceleration of the filament along a way: no step of a ramp is shorter than a stage may be.
    fn ramp_mm_per_s2(&self) -> f32 {
        smaller(self.acceleration_mm_per_s2, STEP / LEAST_STAGE_S * stage_jump_mm_per_s(self.feed_mm_per_s))
    }

    /// Duration of a stage while the filament's speed rises or falls by steps, s.
    fn step_s(&self) -> f32 {
        STEP * stage_jump_mm_per_s(self.feed_mm_per_s) / self.ramp_mm_per_s2()
    }

    /// The stage that follows another one, of a law that ends after so long; `None`
    /// after the last one.
    fn next_stage(&self, way: &Way<'_>, before: Option<&Stage>, law_end_s: f32) -> Option<Stage> {
        let (leg, leg_begin_s, begin_s) = match before {
            None => (0, 0.0, 0.0),
            Some(Stage { leg, ends_leg: false, leg_begin_s, end_s, .. }) => (*leg, *leg_begin_s, *end_s),
            Some(Stage { leg, leg_begin_s, end_s, .. }) => (leg + 1, leg_begin_s + end_s, 0.0),
        };
        let left_s = law_end_s - leg_begin_s;
        if leg >= way.legs.len() || begin_s + LEAST_STAGE_S > left_s {
            return None;
        }
        let course = way.course(leg);
        let window = self.window(&course, left_s);
        let end_s = self.stage_end_s(&course, &window, begin_s);
        let ends_leg = end_s >= course.duration_s;
        let begin_mm = if begin_s > 0.0 { course.mm_after(begin_s) } else { 0.0 };
        let end_mm = if ends_leg { course.length_mm } else { course.mm_after(end_s) };
        let filament_mm = self.ratio(&course, &window, begin_s, end_s) * (end_mm - begin_mm);
        let begins_leg = begin_s <= 0.0;
        Some(Stage { leg, begin_mm, end_mm, begins_leg, ends_leg, filament_mm, leg_begin_s, end_s })
    }

    /// Window in which filament moves along a leg, by a law that ends at `left_s`.
    fn window(&self, course: &Course, left_s: f32) -> Window {
        // The rest of the leg would be too short for a stage.
        let ends_inside = left_s < course.duration_s - LEAST_STAGE_S;
        let half_jump_s = 0.5 * stage_jump_mm_per_s(self.feed_mm_per_s) / self.ramp_mm_per_s2();
        let beyond_s = |mm_per_s: f32| mm_per_s / course.acceleration_mm_per_s2;
        let (head_s, tail_s) = (beyond_s(course.begin_mm_per_s), beyond_s(course.end_mm_per_s));
        let is_head_cut = course.begins_apart && head_s > half_jump_s;
        let is_tail_cut = course.ends_apart && tail_s > half_jump_s;
        Window {
            head_s: if is_head_cut { half_jump_s } else { head_s },
            left_s: if ends_inside {
                left_s
            } else {
                course.duration_s + if is_tail_cut { half_jump_s } else { tail_s }
            },
            stop_s: if ends_inside { left_s } else { course.duration_s },
            is_head_cut,
            is_end_cut: ends_inside || is_tail_cut,
        }
    }

    /// The filament of a stage for its path.
    fn ratio(&self, course: &Course, window: &Window, begin_s: f32, end_s: f32) -> f32 {
        let ramp = self.ramp_mm_per_s2();
        let (most_mm_per_s, middle_s) = (course.most_mm_per_s(begin_s, end_s), 0.5 * (begin_s + end_s));
        let phase = course.phase(begin_s);
        let rising = match phase {
            // Not a number if it begins at rest; nothing is then smaller.
            Phase::Up => ramp * (begin_s + window.head_s) / course.mm_per_s_after(begin_s),
            Phase::Even | Phase::Down => ramp * (middle_s + window.head_s) / most_mm_per_s,
        };
        let mut ratio = smaller(self.feed_mm_per_s / most_mm_per_s, rising);
        if phase != Phase::Even || self.keeps_acceleration {
            ratio = smaller(ramp / course.acceleration_mm_per_s2, ratio);
        }
        if window.is_end_cut || phase == Phase::Even {
            ratio = smaller(ratio, ramp * (window.left_s - middle_s) / most_mm_per_s);
        }
        ratio
    }

    /// End of the stage that begins at `begin_s`, s.
    fn stage_end_s(&self, course: &Course, window: &Window, begin_s: f32) -> f32 {
        let (ramp, acceleration) = (self.ramp_mm_per_s2(), course.acceleration_mm_per_s2);
        let Window { head_s, left_s, stop_s, is_head_cut, is_end_cut } = *window;
        // The path's speed up to which the filament's is in proportion to it.
        let base_mm_per_s = self.feed_mm_per_s * acceleration / ramp;
        let mm_per_s = course.mm_per_s_after(begin_s);
        // The filament's speed begins to fall.
        let fall_s = larger(left_s - self.feed_mm_per_s / ramp, 0.5 * (left_s - head_s));
        let phase = course.phase(begin_s);
        let is_slow = course.peak_mm_per_s < base_mm_per_s;
        let risen_mm_per_s = ramp * (begin_s + head_s);
        let rises = match phase {
            Phase::Up => is_head_cut && risen_mm_per_s < smaller(self.feed_mm_per_s, mm_per_s * ramp / acceleration),
            Phase::Even => risen_mm_per_s < self.feed_mm_per_s && !self.keeps_acceleration,
            Phase::Down => false,
        };
        let falls = begin_s + LEAST_STAGE_S > fall_s
            && (is_end_cut || phase == Phase::Even && !(self.keeps_acceleration && is_slow));
        let mut end_s = match phase {
            _ if rises || falls => begin_s + self.step_s(),
            Phase::Up => begin_s + (larger(base_mm_per_s, GROWTH * mm_per_s) - mm_per_s) / acceleration,
            Phase::Even => stop_s,
            Phase::Down if mm_per_s <= base_mm_per_s * GROWTH => stop_s,
            Phase::Down => begin_s + (mm_per_s - larger(base_mm_per_s, mm_per_s / GROWTH)) / acceleration,
        };
        end_s = larger(end_s, begin_s + LEAST_STAGE_S);
        // A stage ends where the law changes.
        for change_s in [course.up_s, course.even_s, fall_s] {
            if change_s > begin_s + LEAST_STAGE_S && end_s + LEAST_STAGE_S > change_s {
                end_s = change_s;
            }
        }
        if end_s + LEAST_STAGE_S > stop_s {
            end_s = stop_s;
        }
        // A whole leg has two stages at least, for two moves may end along it.
        let middle_s = 0.5 * course.duration_s;
        if begin_s < 0.9 * middle_s && end_s > middle_s { middle_s } else { end_s }
    }

    /// The ride that ends after so long, with a share of 1, and what could move along it, mm.
    fn ride_until(&self, way: &Way<'_>, end_s: f32) -> Option<(Ride, f32)> {
        let (mut last, mut stages, mut sum_mm) = (None, 0_u8, 0.0);
        while let Some(stage) = self.next_stage(way, last.as_ref(), end_s) {
            if stages == MOST_STAGES {
                return None;
            }
            stages += 1;
            sum_mm += stage.filament_mm;
            last = Some(stage);
        }
        let Stage { leg, ends_leg, end_mm, .. } = last?;
        Some((Ride { end_s, share: 1.0, stages, leg: leg as u8, ends_leg, end_mm }, sum_mm))
    }

    /// The shortest ride, or how much time it lacks, s.
    fn ride(&self, way: &Way<'_>, way_s: f32) -> Result<Ride, f32> {
        // Tries longer and longer times until one is long enough.
        let (mut short_s, mut long_s) = (0.0, smaller(self.duration_s(), way_s));
        let mut found = Err(0.0);
        for _ in 0..MOST_TRIALS {
            let ride = self.ride_until(way, long_s);
            let moves_mm = ride.map_or(0.0, |(_, moves_mm)| moves_mm);
            found =
                ride.filter(|_| moves_mm >= self.filament_mm).ok_or((self.filament_mm - moves_mm) / self.feed_mm_per_s);
            if found.is_ok() || long_s >= way_s {
                break;
            }
            (short_s, long_s) = (long_s, smaller(LENGTHENING * long_s, way_s));
        }
        let mut found = found?;
        for _ in 0..HALVINGS {
            let middle_s = 0.5 * (short_s + long_s);
            match self.ride_until(way, middle_s) {
                Some(shorter) if shorter.1 >= self.filament_mm => (found, long_s) = (shorter, middle_s),
                _ => short_s = middle_s,
            }
        }
        let (ride, moves_mm) = found;
        Ok(Ride { share: self.filament_mm / moves_mm, ..ride })
    }

    /// Stage `number`, counted from 1, of a ride along a way, and the filament that moves along it,
    /// mm; `None` after the last one.
    pub fn stage(&self, way: &Way<'_>, ride: &Ride, number: u8) -> Option<(Stage, f32)> {
        let mut stage = None;
        for _ in 0..number {
            stage = self.next_stage(way, stage.as_ref(), ride.end_s);
        }
        stage.map(|stage| (stage, ride.share * stage.filament_mm))
    }
}

/// Filament moves that ride along a way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Spread {
    /// Duration of the way as a multiple of its duration without filament.
    pub slowness: f32,
    pub retraction: Option<Ride>,
    /// Backwards.
    pub recovery: Option<Ride>,
}

impl Spread {
    /// No filament move rides.
    pub const NONE: Self = Self { slowness: 1.0, retraction: None, recovery: None };

    /// Fastest distribution along legs that have been [joined](join).
    pub fn of(legs: &[Leg], retraction: Option<&FilamentLaw>, recovery: Option<&FilamentLaw>) -> Self {
        let way_s = Way { legs, slowness: 1.0, is_backwards: false }.duration_s();
        let alone_s = |law: Option<&FilamentLaw>| law.map_or(0.0, FilamentLaw::duration_s);
        let rest_s = |first, last| alone_s(retraction) + alone_s(recovery) - alone_s(first) - alone_s(last);
        let (mut best, mut best_s) = (Self::NONE, way_s + rest_s(None, None));
        for (first, last) in [(retraction, recovery), (retraction, None), (None, recovery)] {
            let Some(spread) = Self::riding(legs, way_s, first, last) else { continue };
            let seconds = spread.slowness * way_s + rest_s(first, last);
            if seconds < best_s {
                (best, best_s) = (spread, seconds);
            }
            // No faster than the way.
            if best_s <= way_s {
                break;
            }
        }
        best
    }

    /// Distribution of these filament moves along a way as slow as they need.
    fn riding(legs: &[Leg], way_s: f32, first: Option<&FilamentLaw>, last: Option<&FilamentLaw>) -> Option<Self> {
        let mut slowness = 1.0;
        for _ in 0..MOST_TRIALS {
            let slow_s = slowness * way_s;
            // The moves need a stage between them.
            let mut lacking_s = LEAST_STAGE_S - slow_s;
            let mut ride = |law: Option<&FilamentLaw>, is_backwards| {
                let ride = law?.ride(&Way { legs, slowness, is_backwards }, slow_s);
                lacking_s += ride.map_or_else(|lacking_s| slow_s + lacking_s, |ride| ride.end_s);
                ride.ok()
            };
            let (retraction, recovery) = (ride(first, false), ride(last, true));
            if lacking_s <= 0.0 && retraction.is_some() == first.is_some() && recovery.is_some() == last.is_some() {
                return Some(Self { slowness, retraction, recovery });
            }
            slowness *= larger(1.02, 1.01 * (slow_s + lacking_s) / slow_s);
            if slowness > MOST_SLOWNESS {
                break;
            }
        }
        None
    }
}

#[cfg(test)]
mod tests;
