//! Moves that wait until it is known whether filament moves on their way ([`crate::on_the_way`]).
//!
//! Held are a retraction, a travel and a recovery, in this order, each of them or none. With whatever cannot join them they are
//! planned: nothing that is planned depends on when the next move comes.

use super::Planner;
use super::block_rules::{PartLimits, Travel};
use super::move_error::MoveError;
use super::position::{Position, Target};
use crate::extruder::FILAMENT_UNITS_PER_MM;
use crate::kinematics::UNITS_PER_MM;
use crate::limits::{larger, smaller};
use crate::methods::MotionMethods;
use crate::on_the_way::{
    Along, EXTRUDER_JUMP_MM_PER_S, FilamentLaw, LARGEST_JUMP, LEAST_TRAVEL_10NM, StageEnd, TravelLaw, choose,
};
use crate::path::Path;
use crate::pressure_advance::PressureAdvance;
use crate::ring::{Marker, RingMemory};
use crate::speed_plan::EntrySpeed;

/// What of the time of a filament move the rest of it may take after a part has gone with a travel.
const MOST_OF_DURATION: f32 = 0.9;

/// The filament alone.
#[derive(Clone, Copy, Debug)]
struct FilamentMove {
    /// Below zero where it is drawn back, units of 0.1 nm.
    filament_100pm: i64,
    feed_mm_per_s: f32,
    acceleration_mm_per_s2: f32,
    line: u32,
    ends_move: bool,
}

/// X, Y and Z without filament.
#[derive(Clone, Copy, Debug)]
struct TravelMove {
    target_10nm: [i32; 3],
    length_mm: f32,
    /// As the travel's direction allows.
    feed_mm_per_s: f32,
    acceleration_mm_per_s2: f32,
    /// As it was asked for.
    line_feed_mm_per_s: f32,
    line: u32,
}

/// What is held.
#[derive(Clone, Copy, Debug)]
pub(super) struct Held {
    /// Where it begins, and where what has been planned of it ends.
    begin_10nm: [i32; 3],
    from: Position,
    retraction: Option<FilamentMove>,
    travel: Option<TravelMove>,
    recovery: Option<FilamentMove>,
    /// How many of its parts have been planned.
    parts: u32,
}

/// What is planned of it at once.
#[derive(Clone, Copy, Debug)]
enum Part {
    Move(Travel),
    /// The extruder's advance ends, or begins again: while filament comes back no line is drawn.
    Advance {
        is_on: bool,
    },
}

/// Takes parts in their order, until it returns false: there is no room.
type TakePart<'a> = dyn FnMut(&Part) -> bool + 'a;

impl FilamentMove {
    /// By itself, at this place.
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

    fn length_mm(&self) -> f32 {
        // Below 2^32.
        self.filament_100pm.unsigned_abs() as u32 as f32 / FILAMENT_UNITS_PER_MM as f32
    }

    fn law(&self, jump_mm_per_s: f32) -> FilamentLaw {
        FilamentLaw::new(self.length_mm(), self.feed_mm_per_s, self.acceleration_mm_per_s2, jump_mm_per_s)
    }

    /// What limits a part along which it moves; nothing else does.
    fn limits(&self) -> PartLimits {
        PartLimits {
            feed_mm_per_s: f32::MAX,
            acceleration_mm_per_s2: f32::MAX,
            filament_feed_mm_per_s: self.feed_mm_per_s,
            filament_acceleration_mm_per_s2: self.acceleration_mm_per_s2,
            filament_jump_mm_per_s: larger(EXTRUDER_JUMP_MM_PER_S, LARGEST_JUMP * self.feed_mm_per_s),
        }
    }

    /// This share of it, units of 0.1 nm.
    fn share_100pm(&self, share: f32) -> i64 {
        share_of(self.filament_100pm, share)
    }

    /// What of it can ride along all of a travel, and the rest; `None` where the rest takes nearly as long as all of it.
    fn divide(&self, law: &FilamentLaw, travel: &TravelLaw, jump_mm_per_s: f32) -> Option<(Self, Option<Self>)> {
        let most_mm = travel.most_filament_mm(self.feed_mm_per_s, self.acceleration_mm_per_s2);
        let length_mm = self.length_mm();
        if most_mm >= length_mm {
            return Some((*self, None));
        }
        let riding_100pm = self.share_100pm(most_mm / length_mm);
        let rest_100pm = self.filament_100pm.wrapping_sub(riding_100pm);
        let with = |filament_100pm| Self { filament_100pm, ..*self };
        let rest = with(rest_100pm);
        let is_shorter = rest.law(jump_mm_per_s).duration_s() <= MOST_OF_DURATION * law.duration_s();
        is_shorter.then(|| (with(riding_100pm), Some(rest)))
    }
}

impl Held {
    /// Hands out all of it in parts, in the order of time. The extruder's speed may change by `jump_mm_per_s` at once.
    fn each_part(&self, jump_mm_per_s: f32, take: &mut TakePart<'_>) -> bool {
        let Self { begin_10nm, retraction, recovery, .. } = self;
        let Some(travel) = &self.travel else {
            return retraction.is_none_or(|filament| take(&filament.alone(*begin_10nm)));
        };
        let whole = travel.law();
        let law = |filament: &FilamentMove| filament.law(jump_mm_per_s);
        let (first, last) = (retraction.as_ref().map(law), recovery.as_ref().map(law));
        match (retraction, recovery, first.as_ref().or(last.as_ref())) {
            (Some(filament), None, Some(law)) if law.rides(&whole) => {
                let Some((riding, rest)) = filament.divide(law, &whole, jump_mm_per_s) else {
                    return take(&filament.alone(*begin_10nm)) && take(&travel.rest(travel.target_10nm, None));
                };
                rest.is_none_or(|rest| take(&FilamentMove { ends_move: false, ..rest }.alone(*begin_10nm)))
                    && travel.carry(&riding, *begin_10nm, take)
            }
            (None, Some(filament), Some(law)) if law.rides(&whole) => {
                let Some((riding, rest)) = filament.divide(law, &whole, jump_mm_per_s) else {
                    return take(&travel.rest(travel.target_10nm, None)) && take(&filament.alone(travel.target_10nm));
                };
                let riding = FilamentMove { ends_move: riding.ends_move && rest.is_none(), ..riding };
                take(&Part::Advance { is_on: false })
                    && travel.carry(&riding, *begin_10nm, take)
                    && take(&Part::Advance { is_on: true })
                    && rest.is_none_or(|rest| take(&rest.alone(travel.target_10nm)))
            }
            _ => {
                let along = choose(&whole, first.as_ref(), last.as_ref());
                let first = retraction.as_ref().zip(first.as_ref());
                let last = recovery.as_ref().zip(last.as_ref());
                self.each_stage(travel, along, [first, last], take)
            }
        }
    }

    /// The same for filament that moves along a travel's halves, or by itself.
    fn each_stage(
        &self,
        travel: &TravelMove,
        along: Along,
        [first, last]: [Option<(&FilamentMove, &FilamentLaw)>; 2],
        take: &mut TakePart<'_>,
    ) -> bool {
        let (whole, begin_10nm) = (travel.law(), self.begin_10nm);
        let after = first.filter(|_| along.retraction).map(|(filament, _)| filament);
        if let Some((filament, law)) = first {
            if !along.retraction {
                if !take(&filament.alone(begin_10nm)) {
                    return false;
                }
            } else {
                let slowed = whole.lasting(law.duration_s());
                let mut before = StageEnd::NONE;
                for stage in 1..=law.stages() {
                    let end = law.stage_end(stage, &slowed);
                    let filament_100pm =
                        filament.share_100pm(end.filament).wrapping_sub(filament.share_100pm(before.filament));
                    let ends_move = filament.ends_move && stage == law.stages();
                    let part = FilamentMove { filament_100pm, ends_move, ..*filament };
                    if !take(&travel.stage(&part, &slowed, end.mm_per_s, travel.place(begin_10nm, end.travel))) {
                        return false;
                    }
                    before = end;
                }
            }
        }
        let Some((filament, law)) = last.filter(|_| along.recovery) else {
            return take(&travel.rest(travel.target_10nm, after))
                && last.is_none_or(|(filament, _)| take(&filament.alone(travel.target_10nm)));
        };
        let slowed = whole.lasting(law.duration_s());
        let left = law.stage_end(law.stages(), &slowed).travel;
        if !(take(&travel.rest(travel.place(begin_10nm, 1.0 - left), after)) && take(&Part::Advance { is_on: false })) {
            return false;
        }
        // As it would be drawn back, backwards.
        for stage in (1..=law.stages()).rev() {
            let end = law.stage_end(stage, &slowed);
            let next = if stage == 1 { StageEnd::NONE } else { law.stage_end(stage - 1, &slowed) };
            let filament_100pm = filament.share_100pm(end.filament).wrapping_sub(filament.share_100pm(next.filament));
            let target_10nm = if stage == 1 { travel.target_10nm } else { travel.place(begin_10nm, 1.0 - next.travel) };
            let part = FilamentMove { filament_100pm, ends_move: filament.ends_move && stage == 1, ..*filament };
            if !take(&travel.stage(&part, &slowed, end.mm_per_s, target_10nm)) {
                return false;
            }
        }
        take(&Part::Advance { is_on: true })
    }
}

impl TravelMove {
    fn law(&self) -> TravelLaw {
        let Self { length_mm, feed_mm_per_s, acceleration_mm_per_s2, .. } = *self;
        TravelLaw { length_mm, feed_mm_per_s, acceleration_mm_per_s2 }
    }

    /// Where this share of it is done.
    fn place(&self, begin_10nm: [i32; 3], share: f32) -> [i32; 3] {
        let mut place = begin_10nm;
        for (place, target) in place.iter_mut().zip(self.target_10nm) {
            let done = share_of(i64::from(target) - i64::from(*place), share);
            // Between two coordinates.
            *place = place.wrapping_add(done as i32);
        }
        place
    }

    /// The part of it without filament, at whose end the move ends; after this filament.
    fn rest(&self, target_10nm: [i32; 3], after: Option<&FilamentMove>) -> Part {
        let part = after.map(|filament| PartLimits {
            feed_mm_per_s: self.feed_mm_per_s,
            acceleration_mm_per_s2: self.acceleration_mm_per_s2,
            ..filament.limits()
        });
        let Self { line_feed_mm_per_s: feed_mm_per_s, line, .. } = *self;
        let (filament_100pm, corner_filament_100pm) = (0, 0);
        Part::Move(Travel {
            target_10nm,
            filament_100pm,
            corner_filament_100pm,
            feed_mm_per_s,
            line,
            ends_move: true,
            part,
        })
    }

    /// A part of it along which this filament moves, and in which the law goes at most so fast.
    fn stage(&self, filament: &FilamentMove, law: &TravelLaw, mm_per_s: f32, target_10nm: [i32; 3]) -> Part {
        let FilamentMove { filament_100pm, line, ends_move, .. } = *filament;
        let part = Some(PartLimits {
            // It may begin at the speed of a corner instead of at rest.
            feed_mm_per_s: smaller(self.feed_mm_per_s, 1.25 * mm_per_s),
            acceleration_mm_per_s2: law.acceleration_mm_per_s2,
            ..filament.limits()
        });
        let feed_mm_per_s = self.line_feed_mm_per_s;
        let corner_filament_100pm = filament_100pm;
        Part::Move(Travel { target_10nm, filament_100pm, corner_filament_100pm, feed_mm_per_s, line, ends_move, part })
    }

    /// All of it, and this filament along all of it. In two parts, for two moves end.
    fn carry(&self, filament: &FilamentMove, begin_10nm: [i32; 3], take: &mut TakePart<'_>) -> bool {
        let half_100pm = filament.filament_100pm / 2;
        let other_100pm = filament.filament_100pm.wrapping_sub(half_100pm);
        let law = self.law();
        let (one, other) = if filament.filament_100pm < 0 {
            let one = FilamentMove { filament_100pm: half_100pm, ..*filament };
            (one, FilamentMove { filament_100pm: other_100pm, line: self.line, ends_move: true, ..*filament })
        } else {
            let one = FilamentMove { filament_100pm: half_100pm, line: self.line, ends_move: true, ..*filament };
            (one, FilamentMove { filament_100pm: other_100pm, ..*filament })
        };
        let peak = law.peak_mm_per_s();
        take(&self.stage(&one, &law, peak, self.place(begin_10nm, 0.5)))
            && take(&self.stage(&other, &law, peak, self.target_10nm))
    }
}

/// A share, 0 to 1, of a whole number, to 2^-24 of it.
fn share_of(whole: i64, share: f32) -> i64 {
    const BITS: u32 = 24;
    let parts = (share * (1_u32 << BITS) as f32 + 0.5) as i64;
    // Below 2^35, filament and coordinates alike: 59 bits.
    whole.wrapping_mul(parts) >> BITS
}

impl<S: RingMemory, M: MotionMethods> Planner<S, M> {
    /// Holds a move back, if filament may move on its way or it is such filament; otherwise what is held is planned.
    ///
    /// # Errors
    /// [`MoveError::NoRoom`]: the move has not been taken, though some of what was held may have been planned.
    #[inline(never)]
    pub(super) fn holds_back(
        &mut self,
        travel: &Travel,
        target: &Target,
        make_room: &mut impl FnMut(&mut Self) -> bool,
    ) -> Result<bool, MoveError> {
        let kind = kind(travel, target);
        let is_next = matches!(
            (&self.held, kind),
            (Some(Held { travel: None, .. }), Kind::Travel)
                | (Some(Held { travel: Some(_), recovery: None, parts: 0, .. }), Kind::Recovery)
        );
        if !is_next || self.flushing {
            self.settle_held(make_room)?;
        }
        if kind == Kind::Other || kind == Kind::Recovery && self.held.is_none() {
            return Ok(false);
        }
        let from = self.position;
        let nothing =
            Held { begin_10nm: from.coordinates_10nm, from, retraction: None, travel: None, recovery: None, parts: 0 };
        let held = self.held.get_or_insert(nothing);
        let Travel { filament_100pm, feed_mm_per_s, line, ends_move, .. } = *travel;
        if kind == Kind::Travel {
            let path = Path::along(target.vector_10nm);
            let [x, y, z] = path.vector.map(f32::abs);
            let (feed, acceleration) = self.rules.limits_along(feed_mm_per_s, path.length, [x, y, z, 0.0], false);
            held.travel = Some(TravelMove {
                target_10nm: target.coordinates_10nm,
                length_mm: path.length / UNITS_PER_MM as f32,
                feed_mm_per_s: feed,
                acceleration_mm_per_s2: acceleration,
                line_feed_mm_per_s: feed_mm_per_s,
                line,
            });
        } else {
            let (feed_mm_per_s, acceleration_mm_per_s2) = self.rules.path_limits.of_filament(feed_mm_per_s);
            let alone = FilamentMove { filament_100pm, feed_mm_per_s, acceleration_mm_per_s2, line, ends_move };
            let place = if kind == Kind::Retraction { &mut held.retraction } else { &mut held.recovery };
            *place = Some(alone);
        }
        self.position.advance(target);
        Ok(true)
    }

    /// What is held is planned, and a flush that waits happens.
    fn settle_held(&mut self, make_room: &mut impl FnMut(&mut Self) -> bool) -> Result<(), MoveError> {
        while !(if self.flushing { self.close_open_block() } else { self.plan_held() }) {
            if !make_room(self) {
                return Err(MoveError::NoRoom);
            }
        }
        Ok(())
    }

    /// Plans what is held; `false` without room for all of it.
    #[inline(always)]
    pub(super) fn plan_held(&mut self) -> bool {
        self.held.is_none() || self.plan_parts()
    }

    #[cold]
    #[inline(never)]
    fn plan_parts(&mut self) -> bool {
        let Some(mut held) = self.held else { return true };
        let end = self.position;
        let mut planned = held.parts;
        self.position = held.from;
        let jump_mm_per_s = self.rules.extruder_jump_mm_per_s();
        // Each part is worked out from where all of it begins, so that those that are planned are passed.
        let (begun, mut index) = (held.parts, 0);
        let is_planned = held.each_part(jump_mm_per_s, &mut |part| {
            index += 1;
            if index <= begun {
                return true;
            }
            let is_planned = self.plan_part(part);
            planned += u32::from(is_planned);
            is_planned
        });
        held.parts = planned;
        held.from = self.position;
        self.position = end;
        self.held = if is_planned { None } else { Some(held) };
        is_planned
    }

    /// Plans a part; `false` without room.
    fn plan_part(&mut self, part: &Part) -> bool {
        let travel = match part {
            Part::Move(travel) => travel,
            Part::Advance { .. } if !self.choice.pressure_advance.is_some() => return true,
            Part::Advance { is_on } => {
                let advance = if *is_on { self.choice.pressure_advance } else { PressureAdvance::NONE };
                return self.push_open_block() && self.queue.push_marker(Marker::PressureAdvance(advance));
            }
        };
        // Within the moves that were in reach as a whole.
        let Ok(Some(target)) = self.rules.target(travel, &self.position) else { return true };
        let mut planned = self.rules.plan(travel, &target, &self.previous);
        self.keep_tolerance(&mut planned);
        if self.shares_blocks() && self.open.absorb(&planned) {
            self.tallies.merged_moves += 1;
        } else {
            if !self.push_open_block() {
                return false;
            }
            self.open.begin(&planned, EntrySpeed::Bound, planned.nominal);
        }
        self.advance_position(&target, &planned, travel.part.is_some());
        true
    }
}

/// What a move is to those that are held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Retraction,
    Travel,
    Recovery,
    Other,
}

fn kind(travel: &Travel, target: &Target) -> Kind {
    let stands = target.vector_10nm == [0; 3];
    match travel.filament_100pm {
        0 if travel.ends_move && is_long(target.vector_10nm) => Kind::Travel,
        // 40 cm are no retraction.
        filament if stands && filament.unsigned_abs() >> 32 == 0 => {
            if filament < 0 {
                Kind::Retraction
            } else {
                Kind::Recovery
            }
        }
        _ => Kind::Other,
    }
}

/// Whether filament may move along it.
fn is_long(vector_10nm: [i32; 3]) -> bool {
    Path::along(vector_10nm).length_10nm() >= LEAST_TRAVEL_10NM
}
