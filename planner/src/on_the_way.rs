//! Filament moves on the way: a retraction spread over the first of the travels after it, a recovery over the last of the
//! travels before it, instead of a stop for each.
//!
//! A *way* is the travels between two lines, a lift and a lowering among them, from rest to rest. It keeps the speeds that it has
//! without filament. The filament moves as fast as it can along them: in proportion to the path where the path accelerates or brakes at its
//! stops and corners, at the speed that its own line asks for elsewhere, and at the end of a retraction down to rest by steps of the
//! speed that the extruder may make at once. Where one of these laws changes a *stage* ends: within a stage, filament is in
//! proportion to path. A recovery is a retraction seen backwards.
//!
//! A way that is too short for the filament is slowed down as a whole, if that takes less time than a stop.

use crate::limits::{larger, smaller};
use crate::square_root::square_root_f32;

/// The shortest travel that filament moves along with, units of 10 nm: what is shorter has no parts worth the name.
pub(crate) const LEAST_TRAVEL_10NM: u32 = 5_000;

/// The most travels of a way: two lifts, for a layer's end has one more, two travels and a lowering.
pub(crate) const MOST_LEGS: usize = 5;

/// By how much the extruder's speed may change at once, mm/s, where the limits do not say. What motors of 8 to 16 mm/s a
/// revolution's hundredth take from standstill; other firmware's usual "jerk" of the extruder.
pub(crate) const EXTRUDER_JUMP_MM_PER_S: f32 = 5.0;

/// The same for fast filament, as a share of its speed: more stages would be more blocks.
const LARGEST_JUMP: f32 = 0.2;

/// No stage is planned shorter, s: stages are pieces of the plan, and filters see a limited number of them.
const LEAST_STAGE_S: f32 = 0.003;

/// By how much the path's speed grows in a stage in which the filament's speed is constant: from stage to stage the extruder's speed
/// changes by a fifth, [`LARGEST_JUMP`].
const GROWTH: f32 = 1.25;

/// A stage by which the filament's speed rises or falls is this share of what the extruder may do at once: within the stages the path's
/// speed changes, too.
const STEP: f32 = 0.75;

/// The most stages of a filament move.
const MOST_STAGES: u32 = 64;

/// How often the end of a filament move is sought in half of the time.
const HALVINGS: u32 = 8;

/// The most that a way is slowed down.
const MOST_SLOWNESS: f32 = 4.0;

/// How often a way is slowed down further, and a filament move is given more time.
const MOST_TRIALS: u32 = 6;

/// How much more time.
const LENGTHENING: f32 = 1.6;

/// By how much the speed of filament with this feed may change at once where stages meet, mm/s.
pub(crate) fn stage_jump_mm_per_s(feed_mm_per_s: f32) -> f32 {
    larger(EXTRUDER_JUMP_MM_PER_S, LARGEST_JUMP * feed_mm_per_s)
}

/// A travel of a way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Leg {
    pub length_mm: f32,
    pub feed_mm_per_s: f32,
    pub acceleration_mm_per_s2: f32,
    /// The speed in the corner before it.
    pub entry_mm_per_s: f32,
}

impl Leg {
    pub const NONE: Self =
        Self { length_mm: 0.0, feed_mm_per_s: 1.0, acceleration_mm_per_s2: 1.0, entry_mm_per_s: 0.0 };

    /// The speed that is reached over its length from this one, or from which it brakes to this one.
    fn most_mm_per_s(&self, other_mm_per_s: f32) -> f32 {
        let squared = other_mm_per_s * other_mm_per_s + 2.0 * self.acceleration_mm_per_s2 * self.length_mm;
        smaller(self.feed_mm_per_s, square_root_f32(squared))
    }
}

/// Lowers the speeds in the corners to those that can be reached, and from which the last leg comes to rest.
pub(crate) fn join(legs: &mut [Leg]) {
    let mut exit_mm_per_s = 0.0;
    for leg in legs.iter_mut().rev() {
        leg.entry_mm_per_s = smaller(leg.entry_mm_per_s, leg.most_mm_per_s(exit_mm_per_s));
        exit_mm_per_s = leg.entry_mm_per_s;
    }
    let mut reached_mm_per_s = f32::MAX;
    for leg in legs {
        leg.entry_mm_per_s = smaller(leg.entry_mm_per_s, reached_mm_per_s);
        reached_mm_per_s = leg.most_mm_per_s(leg.entry_mm_per_s);
    }
}

/// The legs between two stops, in the direction of time or against it.
#[derive(Clone, Copy, Debug)]
struct Way<'a> {
    legs: &'a [Leg],
    /// How many times as long as the legs allow it takes.
    slowness: f32,
    is_backwards: bool,
}

/// How a leg's speed changes: a ramp, an even part, a ramp.
#[derive(Clone, Copy, Debug)]
struct Course {
    length_mm: f32,
    acceleration_mm_per_s2: f32,
    /// At its begin, at most, and at its end.
    begin_mm_per_s: f32,
    peak_mm_per_s: f32,
    end_mm_per_s: f32,
    /// Beyond its begin and its end filament has another proportion to the path, whatever its speed.
    begins_apart: bool,
    ends_apart: bool,
    /// When the first ramp ends, the last one begins, and all of it ends, s.
    up_s: f32,
    even_s: f32,
    duration_s: f32,
}

impl Way<'_> {
    /// Leg `number`, counted from 0 in the way's direction.
    fn course(&self, number: usize) -> Course {
        let leg_at = |index: Option<usize>| index.and_then(|index| self.legs.get(index)).copied().unwrap_or(Leg::NONE);
        let index = if self.is_backwards { self.legs.len().wrapping_sub(number + 1) } else { number };
        let (before, leg, next) = (leg_at(index.checked_sub(1)), leg_at(Some(index)), leg_at(index.checked_add(1)));
        let (entry, exit) = (leg.entry_mm_per_s / self.slowness, next.entry_mm_per_s / self.slowness);
        let (begin, end) = if self.is_backwards { (exit, entry) } else { (entry, exit) };
        let apart = [before, next].map(|other| other.acceleration_mm_per_s2 != leg.acceleration_mm_per_s2);
        let [begins_apart, ends_apart] = if self.is_backwards { [apart[1], apart[0]] } else { apart };
        let acceleration = leg.acceleration_mm_per_s2 / (self.slowness * self.slowness);
        let squares = begin * begin + end * end;
        let reached = square_root_f32(acceleration * leg.length_mm + 0.5 * squares);
        let peak = larger(smaller(leg.feed_mm_per_s / self.slowness, reached), larger(begin, end));
        let ramps_mm = (peak * peak - 0.5 * squares) / acceleration;
        let up_s = (peak - begin) / acceleration;
        let even_s = up_s + larger(leg.length_mm - ramps_mm, 0.0) / peak;
        Course {
            length_mm: leg.length_mm,
            acceleration_mm_per_s2: acceleration,
            begin_mm_per_s: begin,
            peak_mm_per_s: peak,
            end_mm_per_s: end,
            begins_apart,
            ends_apart,
            up_s,
            even_s,
            duration_s: even_s + (peak - end) / acceleration,
        }
    }

    fn duration_s(&self) -> f32 {
        (0..self.legs.len()).fold(0.0, |sum, number| sum + self.course(number).duration_s)
    }
}

impl Course {
    /// The speed after so long.
    fn mm_per_s_after(&self, time_s: f32) -> f32 {
        let rising = self.begin_mm_per_s + self.acceleration_mm_per_s2 * time_s;
        let falling = self.end_mm_per_s + self.acceleration_mm_per_s2 * (self.duration_s - time_s);
        smaller(smaller(rising, falling), self.peak_mm_per_s)
    }

    /// The highest speed between two times.
    fn most_mm_per_s(&self, begin_s: f32, end_s: f32) -> f32 {
        if begin_s < self.even_s && end_s > self.up_s {
            return self.peak_mm_per_s;
        }
        larger(self.mm_per_s_after(begin_s), self.mm_per_s_after(end_s))
    }

    /// How much of it is done after so long, mm.
    fn mm_after(&self, time_s: f32) -> f32 {
        let ramp_mm = |from, time_s| time_s * (from + 0.5 * self.acceleration_mm_per_s2 * time_s);
        if time_s < self.up_s {
            ramp_mm(self.begin_mm_per_s, time_s)
        } else if time_s < self.even_s {
            ramp_mm(self.begin_mm_per_s, self.up_s) + self.peak_mm_per_s * (time_s - self.up_s)
        } else {
            self.length_mm - ramp_mm(self.end_mm_per_s, larger(self.duration_s - time_s, 0.0))
        }
    }
}

/// Filament that is drawn back along the begin of a way, or pushed along its end and seen backwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FilamentLaw {
    /// How much moves, mm, above zero.
    pub filament_mm: f32,
    /// The highest speed and acceleration, mm/s, mm/s^2.
    pub feed_mm_per_s: f32,
    pub acceleration_mm_per_s2: f32,
}

/// A part of a leg along which filament moves in proportion to the path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stage {
    /// The leg, counted from where the filament's law begins.
    pub leg: usize,
    /// Where in it, seen from there too, mm.
    pub begin_mm: f32,
    pub end_mm: f32,
    /// Whether it begins and ends where the leg does.
    pub begins_leg: bool,
    pub ends_leg: bool,
    /// What could move along it, mm.
    filament_mm: f32,
    /// When the leg begins, and the stage within it, s.
    leg_begin_s: f32,
    end_s: f32,
}

/// How a filament move rides along a way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Ride {
    /// How long it takes, s.
    end_s: f32,
    slowness: f32,
    /// The share of what could move that moves.
    share: f32,
    /// In how many stages, and the last of them.
    pub stages: u32,
    pub last: Stage,
}

impl FilamentLaw {
    /// How long it takes by itself, s.
    fn duration_s(&self) -> f32 {
        let reached = square_root_f32(self.filament_mm * self.acceleration_mm_per_s2);
        let peak = smaller(reached, self.feed_mm_per_s);
        self.filament_mm / peak + peak / self.acceleration_mm_per_s2
    }

    /// Its acceleration along a way: a ramp has no more stages than a step by [`LARGEST_JUMP`] for each.
    fn ramp_mm_per_s2(&self) -> f32 {
        smaller(self.acceleration_mm_per_s2, STEP * LARGEST_JUMP / LEAST_STAGE_S * self.feed_mm_per_s)
    }

    /// How long a stage lasts while the filament's speed rises or falls by steps, s.
    fn step_s(&self) -> f32 {
        STEP * stage_jump_mm_per_s(self.feed_mm_per_s) / self.ramp_mm_per_s2()
    }

    /// The stage that follows another one, of a law that ends after so long; `None` after the last one.
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
        // What would be left of the leg is no stage.
        let ends_inside = left_s < course.duration_s - LEAST_STAGE_S;
        let stop_s = if ends_inside { left_s } else { course.duration_s };
        let ramp = self.ramp_mm_per_s2();
        let half_jump_mm_per_s = 0.5 * stage_jump_mm_per_s(self.feed_mm_per_s);
        let left_s = if ends_inside {
            left_s
        } else if course.ends_apart && course.end_mm_per_s > 0.0 {
            // Down to what the corner allows.
            course.duration_s + half_jump_mm_per_s / ramp
        } else {
            larger(left_s, course.duration_s)
        };
        let end_s = self.stage_end_s(&course, begin_s, left_s, stop_s);
        let ends_leg = end_s >= course.duration_s;
        let begin_mm = if begin_s > 0.0 { course.mm_after(begin_s) } else { 0.0 };
        let end_mm = if ends_leg { course.length_mm } else { course.mm_after(end_s) };
        let most_mm_per_s = course.most_mm_per_s(begin_s, end_s);
        let even = smaller(ramp / course.acceleration_mm_per_s2, self.feed_mm_per_s / most_mm_per_s);
        let falling = ramp * (left_s - 0.5 * (begin_s + end_s)) / most_mm_per_s;
        let rising = if course.begins_apart {
            (half_jump_mm_per_s + ramp * begin_s) / course.mm_per_s_after(begin_s)
        } else {
            even
        };
        let filament_mm = smaller(smaller(even, rising), falling) * (end_mm - begin_mm);
        let begins_leg = begin_s <= 0.0;
        Some(Stage { leg, begin_mm, end_mm, begins_leg, ends_leg, filament_mm, leg_begin_s, end_s })
    }

    /// When the stage ends that begins then, of a law that ends at `left_s`; at `stop_s` at the latest. All within a leg, s.
    fn stage_end_s(&self, course: &Course, begin_s: f32, left_s: f32, stop_s: f32) -> f32 {
        let (ramp, acceleration) = (self.ramp_mm_per_s2(), course.acceleration_mm_per_s2);
        // The path's speed up to which the filament's is in proportion to it.
        let base_mm_per_s = self.feed_mm_per_s * acceleration / ramp;
        let most_mm_per_s = smaller(base_mm_per_s, course.peak_mm_per_s);
        // The filament's speed begins to fall.
        let fall_s =
            larger(left_s - most_mm_per_s / acceleration, 0.5 * (left_s - course.begin_mm_per_s / acceleration));
        let mm_per_s = course.mm_per_s_after(begin_s);
        // It has not yet risen to what its feed and the path allow.
        let allowed_mm_per_s = smaller(base_mm_per_s, mm_per_s) * ramp / acceleration;
        let rises =
            course.begins_apart && 0.5 * stage_jump_mm_per_s(self.feed_mm_per_s) + ramp * begin_s < allowed_mm_per_s;
        let mut end_s = if rises || begin_s + LEAST_STAGE_S > fall_s {
            begin_s + self.step_s()
        } else if begin_s + LEAST_STAGE_S < course.up_s {
            let next_mm_per_s = larger(base_mm_per_s, GROWTH * mm_per_s);
            begin_s + (next_mm_per_s - mm_per_s) / acceleration
        } else if begin_s + LEAST_STAGE_S < course.even_s || mm_per_s <= base_mm_per_s * GROWTH {
            stop_s
        } else {
            begin_s + (mm_per_s - larger(base_mm_per_s, mm_per_s / GROWTH)) / acceleration
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
        let (mut last, mut stages, mut sum_mm) = (None, 0, 0.0);
        while let Some(stage) = self.next_stage(way, last.as_ref(), end_s) {
            if stages == MOST_STAGES {
                return None;
            }
            stages += 1;
            sum_mm += stage.filament_mm;
            last = Some(stage);
        }
        last.map(|last| (Ride { end_s, slowness: way.slowness, share: 1.0, stages, last }, sum_mm))
    }

    /// The shortest ride, or how much time it lacks, s.
    fn ride(&self, way: &Way<'_>, way_s: f32) -> Result<Ride, f32> {
        // Until it is long enough.
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

    /// Stage `number`, counted from 1, of a ride along these legs, and the filament that moves along it, mm.
    pub fn stage(&self, legs: &[Leg], ride: &Ride, is_backwards: bool, number: u32) -> (Stage, f32) {
        let way = Way { legs, slowness: ride.slowness, is_backwards };
        let mut stage = None;
        for _ in 0..number {
            stage = self.next_stage(&way, stage.as_ref(), ride.end_s);
        }
        let stage = stage.unwrap_or(ride.last);
        (stage, ride.share * stage.filament_mm)
    }
}

/// Which filament moves ride along a way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Spread {
    /// How many times as long as without filament the way takes.
    pub slowness: f32,
    pub retraction: Option<Ride>,
    /// Backwards.
    pub recovery: Option<Ride>,
}

impl Spread {
    /// Nothing rides.
    pub const NONE: Self = Self { slowness: 1.0, retraction: None, recovery: None };

    /// As much as takes less time than stops, along legs that have been [joined](join).
    pub fn of(legs: &[Leg], retraction: Option<&FilamentLaw>, recovery: Option<&FilamentLaw>) -> Self {
        let way_s = Way { legs, slowness: 1.0, is_backwards: false }.duration_s();
        let alone_s = |law: Option<&FilamentLaw>| law.map_or(0.0, FilamentLaw::duration_s);
        let stops_s = way_s + alone_s(retraction) + alone_s(recovery);
        // Where one does not pay, the other may.
        for (first, last) in [(retraction, recovery), (retraction, None), (None, recovery)] {
            let Some(spread) = Self::riding(legs, way_s, first, last) else { continue };
            let rest_s = stops_s - way_s - alone_s(first) - alone_s(last);
            if spread.slowness * way_s + rest_s < stops_s {
                return spread;
            }
        }
        Self::NONE
    }

    /// These, along a way as slow as they need.
    fn riding(legs: &[Leg], way_s: f32, first: Option<&FilamentLaw>, last: Option<&FilamentLaw>) -> Option<Self> {
        let mut slowness = 1.0;
        for _ in 0..MOST_TRIALS {
            let slow_s = slowness * way_s;
            // With a stage between them.
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
