//! The parts of the held moves, in the order of time: stages of filament along legs, legs without
//! filament, filament alone.

use super::super::block_rules::{PartLimits, Travel};
use super::{FilamentMove, Held, Next, Part, TravelMove};
use crate::extruder::FILAMENT_UNITS_PER_MM;
use crate::kinematics::UNITS_PER_MM;
use crate::on_the_way::{FilamentLaw, Leg, Ride, Stage, Way};

/// Line that a part of a leg belongs to, and whether the line's move ends there.
#[derive(Clone, Copy, Debug)]
struct LineEnd {
    line: u32,
    ends_move: bool,
}

impl FilamentMove {
    /// The whole filament move by itself, at this place.
    fn alone(&self, target_10nm: [i32; 3]) -> Part {
        let Self { filament_100pm, feed_mm_per_s, line, ends_move, .. } = *self;
        let corner_filament_100pm = filament_100pm;
        Part::Move(Travel {
            target_10nm,
            filament_100pm,
            corner_filament_100pm,
            feed_mm_per_s,
            line,
            ends_move,
            part: None,
        })
    }

    pub(super) fn law(&self, keeps_acceleration: bool) -> FilamentLaw {
        FilamentLaw {
            // Below 2^32.
            filament_mm: self.filament_100pm.unsigned_abs() as u32 as f32 / FILAMENT_UNITS_PER_MM as f32,
            feed_mm_per_s: self.feed_mm_per_s,
            acceleration_mm_per_s2: self.acceleration_mm_per_s2,
            keeps_acceleration,
        }
    }

    /// Next part of the filament move, `filament_mm` long, in units of 0.1 nm, after the parts done
    /// of it; `is_last`: all that is left.
    fn part_100pm(&self, filament_mm: f32, done_100pm: i64, is_last: bool) -> i64 {
        let left_100pm = self.filament_100pm.wrapping_sub(done_100pm);
        if is_last {
            return left_100pm;
        }
        let part_100pm = (filament_mm * FILAMENT_UNITS_PER_MM as f32) as i64;
        if self.filament_100pm < 0 { left_100pm.max(-part_100pm) } else { left_100pm.min(part_100pm) }
    }

    /// Limits of a part of this leg that its filament moves along, or that follows such a part.
    fn limits(&self, leg: &Leg, slowness: f32) -> PartLimits {
        PartLimits {
            feed_mm_per_s: leg.feed_mm_per_s / slowness,
            acceleration_mm_per_s2: leg.acceleration_mm_per_s2 / (slowness * slowness),
            filament_feed_mm_per_s: self.feed_mm_per_s,
            filament_acceleration_mm_per_s2: self.acceleration_mm_per_s2,
            whole_10nm: leg.length_mm * UNITS_PER_MM as f32,
        }
    }
}

impl Held {
    /// The next part and its successor; `None` after the last one.
    #[inline(never)]
    pub(super) fn next_part(&self) -> Option<(Part, Next)> {
        let mut next = self.next;
        loop {
            next = match next {
                Next::Begin => Next::Retraction { stage: 1, done_100pm: 0 },
                Next::Retraction { stage, done_100pm } => match (&self.retraction, &self.spread.retraction) {
                    (Some(filament), Some(ride)) => return self.retract(filament, ride, stage, done_100pm),
                    (Some(filament), None) => {
                        return Some((
                            filament.alone(self.begin_10nm),
                            Next::Leg { leg: 0, begin_mm: 0.0, is_after: false },
                        ));
                    }
                    (None, _) => Next::Leg { leg: 0, begin_mm: 0.0, is_after: false },
                },
                Next::Leg { leg, begin_mm, is_after } => match self.travel(leg, begin_mm, is_after) {
                    Some(part) => return Some(part),
                    None if self.spread.recovery.is_some() => Next::AdvanceOff,
                    None => Next::RecoveryAlone,
                },
                Next::AdvanceOff => {
                    let stage = self.spread.recovery.map_or(0, |ride| ride.stages);
                    return Some((Part::Advance { is_on: false }, Next::Recovery { stage, done_100pm: 0 }));
                }
                Next::Recovery { stage, done_100pm } => match (&self.recovery, &self.spread.recovery) {
                    (Some(filament), Some(ride)) if stage > 0 => {
                        return self.recover(filament, ride, stage, done_100pm);
                    }
                    _ => Next::AdvanceOn,
                },
                Next::AdvanceOn => return Some((Part::Advance { is_on: true }, Next::Done)),
                Next::RecoveryAlone => {
                    return self.recovery.map(|filament| (filament.alone(self.end_10nm()), Next::Done));
                }
                Next::Done => return None,
            };
        }
    }

    /// A stage of the retraction.
    fn retract(&self, filament: &FilamentMove, ride: &Ride, number: u8, done_100pm: i64) -> Option<(Part, Next)> {
        let (stage, filament_mm) = filament.law(self.is_s_curve).stage(&self.way(false), ride, number)?;
        let is_last = number >= ride.stages;
        let filament_100pm = filament.part_100pm(filament_mm, done_100pm, is_last);
        // The retraction's line ends before that of the first leg does.
        let outlasts_first = ride.leg > 0 || ride.ends_leg;
        let is_end = if outlasts_first { number == 1 } else { is_last };
        let own = LineEnd { line: filament.line, ends_move: is_end && filament.ends_move };
        let line_end = if outlasts_first && number > 1 { self.line_of(&stage, stage.ends_leg) } else { own };
        let target_10nm = self.place(stage.leg, stage.end_mm, stage.ends_leg);
        let part = self.along(stage.leg, filament, filament_100pm, target_10nm, line_end);
        let done_100pm = done_100pm.wrapping_add(filament_100pm);
        let next = if is_last {
            let (leg, begin_mm) = if stage.ends_leg { (stage.leg + 1, 0.0) } else { (stage.leg, stage.end_mm) };
            Next::Leg { leg, begin_mm, is_after: true }
        } else {
            Next::Retraction { stage: number + 1, done_100pm }
        };
        Some((part, next))
    }

    /// A stage of the recovery, which is numbered backwards.
    fn recover(&self, filament: &FilamentMove, ride: &Ride, number: u8, done_100pm: i64) -> Option<(Part, Next)> {
        let (mut stage, filament_mm) = filament.law(self.is_s_curve).stage(&self.way(true), ride, number)?;
        stage.leg = self.forwards(stage.leg);
        let filament_100pm = filament.part_100pm(filament_mm, done_100pm, number == 1);
        let own = LineEnd { line: filament.line, ends_move: number == 1 };
        // Seen from its end, it begins where it ends in time. The line of the last leg ends before
        // the recovery's does, where the recovery's end is reported.
        let line_end = if stage.leg + 1 < self.travels || !filament.ends_move {
            self.line_of(&stage, stage.begins_leg)
        } else if stage.ends_leg {
            self.line_of(&stage, true)
        } else {
            own
        };
        let end_mm = self.length_mm(stage.leg) - stage.begin_mm;
        let target_10nm = self.place(stage.leg, end_mm, stage.begins_leg);
        let part = self.along(stage.leg, filament, filament_100pm, target_10nm, line_end);
        let done_100pm = done_100pm.wrapping_add(filament_100pm);
        Some((part, Next::Recovery { stage: number.saturating_sub(1), done_100pm }))
    }

    /// Part of a leg without filament, from `begin_mm` on; `None` at the start of the recovery and
    /// after the last leg.
    fn travel(&self, leg: usize, begin_mm: f32, is_after: bool) -> Option<(Part, Next)> {
        let (until_leg, until_mm) = self.spread.recovery.map_or((self.travels, 0.0), |ride| {
            let leg = self.forwards(ride.leg.into());
            (leg, if ride.ends_leg { 0.0 } else { self.length_mm(leg) - ride.end_mm })
        });
        let is_whole = leg < until_leg;
        let TravelMove { feed_mm_per_s, line, .. } = *self.moves.get(leg)?;
        if !is_whole && !(leg == until_leg && until_mm > begin_mm) {
            return None;
        }
        let slowness = self.spread.slowness;
        // Filament beside a stage within the leg may begin and end as between stages.
        let beside = if is_after || slowness > 1.0 { self.retraction } else { None };
        let beside = beside.or(self.recovery.filter(|_| !is_whole || slowness > 1.0));
        let part = Part::Move(Travel {
            target_10nm: self.place(leg, until_mm, is_whole),
            filament_100pm: 0,
            corner_filament_100pm: 0,
            feed_mm_per_s,
            line,
            ends_move: is_whole || leg + 1 == self.travels,
            part: beside.map(|filament| filament.limits(self.legs.get(leg).unwrap_or(&Leg::NONE), slowness)),
        });
        let next = if is_whole { Next::Leg { leg: leg + 1, begin_mm: 0.0, is_after: false } } else { Next::AdvanceOff };
        Some((part, next))
    }

    /// A part of a leg with this filament.
    fn along(
        &self,
        leg: usize,
        filament: &FilamentMove,
        filament_100pm: i64,
        target_10nm: [i32; 3],
        LineEnd { line, ends_move }: LineEnd,
    ) -> Part {
        let limits = filament.limits(self.legs.get(leg).unwrap_or(&Leg::NONE), self.spread.slowness);
        let feed_mm_per_s = self.moves.get(leg).map_or(filament.feed_mm_per_s, |travel| travel.feed_mm_per_s);
        let corner_filament_100pm = filament_100pm;
        let part = Some(limits);
        Part::Move(Travel { target_10nm, filament_100pm, corner_filament_100pm, feed_mm_per_s, line, ends_move, part })
    }

    /// The whole way, as slow as its filament needs.
    fn way(&self, is_backwards: bool) -> Way<'_> {
        Way { legs: self.legs(), slowness: self.spread.slowness, is_backwards }
    }

    /// The line of a stage's leg.
    fn line_of(&self, stage: &Stage, ends_move: bool) -> LineEnd {
        LineEnd { line: self.moves.get(stage.leg).map_or(0, |travel| travel.line), ends_move }
    }

    /// The number from 0 of a leg that is counted from the end.
    fn forwards(&self, leg: usize) -> usize {
        self.travels.saturating_sub(leg + 1)
    }

    fn length_mm(&self, leg: usize) -> f32 {
        self.legs.get(leg).map_or(0.0, |leg| leg.length_mm)
    }

    /// The place after so much of a leg, or at its end.
    fn place(&self, leg: usize, done_mm: f32, is_end: bool) -> [i32; 3] {
        let (mut place, end) = (self.begin_of(leg), self.begin_of(leg + 1));
        if is_end {
            return end;
        }
        let share = done_mm / self.length_mm(leg);
        for (place, target) in place.iter_mut().zip(end) {
            let done = share_of(i64::from(target) - i64::from(*place), share);
            // The place is between two coordinates.
            *place = place.wrapping_add(done as i32);
        }
        place
    }
}

/// A share, 0 to 1, of a whole number, to 2^-24 of it.
fn share_of(whole: i64, share: f32) -> i64 {
    const BITS: u32 = 24;
    let parts = (share * (1_u32 << BITS) as f32 + 0.5) as i64;
    // Below 2^35: 59 bits.
    whole.wrapping_mul(parts) >> BITS
}
