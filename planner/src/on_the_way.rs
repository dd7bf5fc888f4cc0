//! Filament moves on the way: a retraction during the first half of the travel after it, a recovery during the second half of
//! the travel before it, instead of a stop for each.
//!
//! Both keep the law that they have by themselves, a ramp, a cruise and a ramp: the travel is divided where that law's stages
//! begin, in places at which X, Y and Z are then if they accelerate from standstill, and each part pushes the filament of its
//! stage. The ramp down goes by steps of the extruder's speed that it may make at once. Where a half of the travel is
//! shorter than the filament needs, the travel accelerates less.
//!
//! Along a short travel, the lift of the nozzle for one, filament rides: it moves in proportion to the path, as much of it as
//! the extruder can follow, and the rest by itself.

use crate::limits::{larger, smaller};
use crate::square_root::square_root_f32;

/// The shortest travel that filament moves along with, units of 10 nm: what is shorter has no parts worth the name.
pub(crate) const LEAST_TRAVEL_10NM: u32 = 5_000;

/// By how much the extruder's speed may change at once, mm/s, where the limits do not say. What motors of 8 to 16 mm/s a
/// revolution's hundredth take from standstill; other firmware's usual "jerk" of the extruder.
pub(crate) const EXTRUDER_JUMP_MM_PER_S: f32 = 5.0;

/// The most stages of the cruise.
const MOST_CRUISE_STAGES: u32 = 16;

/// The same for fast filament, as a share of its speed: more stages would be more blocks.
pub(crate) const LARGEST_JUMP: f32 = 0.2;

/// By how much a stage of the cruise ends later than it begins: while the filament moves evenly X and Y become faster, by as much.
/// From stage to stage the extruder's speed changes by a fifth, [`LARGEST_JUMP`].
const CRUISE_FACTOR: f32 = 1.25;

/// The most stages of the ramp down.
const MOST_FALL_STAGES: u32 = 6;

/// No stage of a cruise or of a ramp down is shorter, s: the parts of a travel are pieces of the plan, and filters see a limited number of them.
const LEAST_STAGE_S: f32 = 0.003;

/// A filament move by itself: from rest to rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FilamentLaw {
    /// How much moves, mm.
    filament_mm: f32,
    /// The highest speed, mm/s.
    peak_mm_per_s: f32,
    /// How long each ramp takes, and what is between them, s.
    ramp_s: f32,
    cruise_s: f32,
    /// Into how many stages the cruise and the ramp down are divided.
    cruise_stages: u32,
    fall_stages: u32,
}

/// The law of a travel's half, from its stop on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TravelLaw {
    /// The whole travel, mm.
    pub length_mm: f32,
    pub feed_mm_per_s: f32,
    pub acceleration_mm_per_s2: f32,
}

/// How much is done where a stage ends: shares of the filament and of the travel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct StageEnd {
    pub filament: f32,
    pub travel: f32,
    /// The travel's speed there.
    pub mm_per_s: f32,
}

impl StageEnd {
    /// Where the first stage begins.
    pub const NONE: Self = Self { filament: 0.0, travel: 0.0, mm_per_s: 0.0 };
}

impl FilamentLaw {
    /// So much filament (mm, above zero) at this speed and acceleration, whose speed may change by `jump_mm_per_s` at once.
    pub fn new(filament_mm: f32, feed_mm_per_s: f32, acceleration_mm_per_s2: f32, jump_mm_per_s: f32) -> Self {
        let reached = square_root_f32(filament_mm * acceleration_mm_per_s2);
        let peak_mm_per_s = smaller(reached, feed_mm_per_s);
        let ramp_s = peak_mm_per_s / acceleration_mm_per_s2;
        let cruise_s = if reached > feed_mm_per_s { filament_mm / peak_mm_per_s - ramp_s } else { 0.0 };
        let mut law = Self { filament_mm, peak_mm_per_s, ramp_s, cruise_s, cruise_stages: 0, fall_stages: 1 };
        let mut end_s = ramp_s;
        while end_s < ramp_s + cruise_s && law.cruise_stages < MOST_CRUISE_STAGES {
            end_s = law.next_cruise_end_s(end_s);
            law.cruise_stages += 1;
        }
        // A stage goes at its mean speed: one is half the peak from either end.
        if peak_mm_per_s > 2.0 * jump_mm_per_s {
            let stages = smaller(peak_mm_per_s / jump_mm_per_s + 1.0, ramp_s / LEAST_STAGE_S);
            // Casts saturate.
            law.fall_stages = (stages as u32).clamp(1, MOST_FALL_STAGES);
        }
        law
    }

    /// When the stage of the cruise ends that begins then, s.
    fn next_cruise_end_s(&self, begin_s: f32) -> f32 {
        let cruise_end_s = self.ramp_s + self.cruise_s;
        let end_s = larger(begin_s * CRUISE_FACTOR, begin_s + LEAST_STAGE_S);
        if end_s + LEAST_STAGE_S > cruise_end_s { cruise_end_s } else { end_s }
    }

    /// How long it takes, s.
    pub fn duration_s(&self) -> f32 {
        2.0 * self.ramp_s + self.cruise_s
    }

    /// Whether a travel is so short that the filament rides along all of it, rather than along a half that would have to take half as
    /// long again.
    pub fn rides(&self, travel: &TravelLaw) -> bool {
        1.5 * travel.half_s() <= self.duration_s()
    }

    /// Number of stages.
    pub fn stages(&self) -> u32 {
        1 + self.cruise_stages + self.fall_stages
    }

    /// When stage `stage`, counted from 1, ends, s.
    fn stage_end_s(&self, stage: u32) -> f32 {
        let after_ramp = stage.saturating_sub(1);
        if after_ramp < self.cruise_stages {
            return (0..after_ramp).fold(self.ramp_s, |end_s, _| self.next_cruise_end_s(end_s));
        }
        let fallen = after_ramp.saturating_sub(self.cruise_stages);
        self.ramp_s * (1.0 + fallen as f32 / self.fall_stages as f32) + self.cruise_s
    }

    /// The share of the filament that has moved after so long.
    fn share_after(&self, time_s: f32) -> f32 {
        let rising = smaller(time_s, self.ramp_s);
        let falling = time_s - self.ramp_s - self.cruise_s;
        let falling = if falling > 0.0 { falling } else { 0.0 };
        let even = time_s - rising - falling;
        // Speeds as shares of the peak, times.
        let done = 0.5 * rising * rising / self.ramp_s + even + falling - 0.5 * falling * falling / self.ramp_s;
        done * self.peak_mm_per_s / self.filament_mm
    }

    /// What is done at the end of a stage, counted from 1, of a move that begins with the travel (or, seen backwards, ends with it).
    pub fn stage_end(&self, stage: u32, travel: &TravelLaw) -> StageEnd {
        let is_last = stage >= self.stages();
        let time_s = if is_last { self.duration_s() } else { self.stage_end_s(stage) };
        let filament = if is_last { 1.0 } else { self.share_after(time_s) };
        StageEnd { filament, travel: travel.share_after(time_s), mm_per_s: travel.speed_after(time_s) }
    }
}

impl TravelLaw {
    /// How long half of it takes, s.
    pub fn half_s(&self) -> f32 {
        let Self { length_mm, feed_mm_per_s, acceleration_mm_per_s2 } = *self;
        let reached = square_root_f32(length_mm * acceleration_mm_per_s2);
        if reached <= feed_mm_per_s {
            return reached / acceleration_mm_per_s2;
        }
        let ramp_s = feed_mm_per_s / acceleration_mm_per_s2;
        0.5 * length_mm / feed_mm_per_s + 0.5 * ramp_s
    }

    /// The same with so little acceleration that half of it takes a little longer than this: something is left in the middle.
    pub fn lasting(&self, half_s: f32) -> Self {
        let acceleration = smaller(self.acceleration_mm_per_s2, 0.98 * self.length_mm / (half_s * half_s));
        Self { acceleration_mm_per_s2: acceleration, ..*self }
    }

    /// The speed that it reaches at most.
    pub fn peak_mm_per_s(&self) -> f32 {
        smaller(square_root_f32(self.length_mm * self.acceleration_mm_per_s2), self.feed_mm_per_s)
    }

    /// How fast it is after so long.
    fn speed_after(&self, time_s: f32) -> f32 {
        smaller(self.acceleration_mm_per_s2 * time_s, self.feed_mm_per_s)
    }

    /// The most filament, mm, that can ride along all of it, at most this fast.
    pub fn most_filament_mm(&self, feed_mm_per_s: f32, acceleration_mm_per_s2: f32) -> f32 {
        let by_feed = feed_mm_per_s / self.peak_mm_per_s();
        self.length_mm * smaller(by_feed, acceleration_mm_per_s2 / self.acceleration_mm_per_s2)
    }

    /// The share of it that is done after so long.
    fn share_after(&self, time_s: f32) -> f32 {
        let ramp_s = smaller(time_s, self.feed_mm_per_s / self.acceleration_mm_per_s2);
        let even_s = time_s - ramp_s;
        self.acceleration_mm_per_s2 * ramp_s * (0.5 * ramp_s + even_s) / self.length_mm
    }
}

/// Which filament moves go along with a travel: the retraction before it, the recovery after it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Along {
    pub retraction: bool,
    pub recovery: bool,
}

/// How many times as long as half of a travel the filament that goes along with it may take: more would hardly be gained, on a path
/// that has to creep.
const LONGEST_IN_HALVES: f32 = 2.0;

/// The choice that takes the least time, about: a travel has to brake from what it reached while a filament move held it back.
pub(crate) fn choose(travel: &TravelLaw, retraction: Option<&FilamentLaw>, recovery: Option<&FilamentLaw>) -> Along {
    let half_s = travel.half_s();
    let duration_s = |law: Option<&FilamentLaw>| law.map_or(0.0, FilamentLaw::duration_s);
    let (first_s, last_s) = (duration_s(retraction), duration_s(recovery));
    let mut best = (first_s + last_s + 2.0 * half_s, Along { retraction: false, recovery: false });
    let mut consider = |is_possible: bool, seconds: f32, along: Along| {
        if is_possible && seconds < best.0 {
            best = (seconds, along);
        }
    };
    let fits = |law: &FilamentLaw| law.duration_s() <= LONGEST_IN_HALVES * half_s;
    let (has_first, has_last) = (retraction.is_some_and(fits), recovery.is_some_and(fits));
    consider(has_first, last_s + 2.0 * larger(first_s, half_s), Along { retraction: true, recovery: false });
    consider(has_last, first_s + 2.0 * larger(last_s, half_s), Along { retraction: false, recovery: true });
    let both_s = 2.0 * larger(larger(first_s, last_s), half_s);
    consider(has_first && has_last, both_s, Along { retraction: true, recovery: true });
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn stages_follow_the_law(
            filament in 0.05f32..12.0, feed in 5.0f32..120.0, acceleration in 200.0f32..10_000.0, jump in 0.5f32..10.0,
            length in 0.5f32..300.0, travel_feed in 20.0f32..500.0, travel_acceleration in 200.0f32..20_000.0,
        ) {
            let law = FilamentLaw::new(filament, feed, acceleration, jump);
            let whole = TravelLaw { length_mm: length, feed_mm_per_s: travel_feed, acceleration_mm_per_s2: travel_acceleration };
            let travel = whole.lasting(law.duration_s());
            prop_assert!(law.peak_mm_per_s <= feed * 1.000_01);
            prop_assert!((law.share_after(law.duration_s()) - 1.0).abs() < 1e-4);
            let (mut before, mut time_before) = (StageEnd::NONE, 0.0);
            for stage in 1..=law.stages() {
                let (end, time) = (law.stage_end(stage, &travel), law.stage_end_s(stage));
                // Forwards, both, and never faster than the feed on average.
                prop_assert!(end.filament > before.filament && end.travel > before.travel, "{stage}: {before:?} {end:?}");
                let mean = (end.filament - before.filament) * filament / (time - time_before);
                prop_assert!(mean <= feed * 1.01, "{mean}");
                (before, time_before) = (end, time);
            }
            prop_assert_eq!(before.filament, 1.0);
            // Within its half.
            prop_assert!(before.travel <= 0.495, "{before:?}");
        }

        #[test]
        fn what_is_chosen_is_never_slower(
            filament in 0.05f32..12.0, length in 0.5f32..300.0, acceleration in 200.0f32..20_000.0,
        ) {
            let law = FilamentLaw::new(filament, 35.0, 1_500.0, 5.0);
            let travel = TravelLaw { length_mm: length, feed_mm_per_s: 150.0, acceleration_mm_per_s2: acceleration };
            let both = choose(&travel, Some(&law), Some(&law));
            // Two of the same length gain, if the travel is long enough.
            let fits = law.duration_s() <= LONGEST_IN_HALVES * travel.half_s();
            prop_assert_eq!(both, Along { retraction: fits, recovery: fits });
            let one = choose(&travel, Some(&law), None);
            prop_assert!(!one.recovery);
            prop_assert_eq!(one.retraction, law.duration_s() < 2.0 * travel.half_s());
            prop_assert_eq!(choose(&travel, None, None), Along { retraction: false, recovery: false });
        }
    }
}
