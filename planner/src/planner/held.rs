//! Moves that wait until it is known whether filament moves on their way ([`crate::on_the_way`]).
//!
//! Held are a retraction, travels, at most [`MOST_LEGS`], and a recovery, in this order, each of
//! them or none. With whatever cannot join them they are planned, part by part: nothing that is
//! planned depends on when the next move comes.

mod parts;

use super::Planner;
use super::block_rules::{MIN_FEED_MM_PER_S, Previous, Travel};
use super::move_error::MoveError;
use super::position::{Position, Target};
use crate::junction::CornerAcceleration;
use crate::kinematics::UNITS_PER_MM;
use crate::limits::larger;
use crate::methods::MotionMethods;
use crate::motion_choice::AccelerationProfile;
use crate::on_the_way::{LEAST_TRAVEL_10NM, Leg, MOST_LEGS, Spread, join};
use crate::path::Path;
use crate::pressure_advance::PressureAdvance;
use crate::ring::{Marker, RingMemory};
use crate::speed_plan::EntrySpeed;

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

/// Target of a travel without filament; its speeds are in the [`Leg`] of the same index.
#[derive(Clone, Copy, Debug)]
struct TravelMove {
    target_10nm: [i32; 3],
    /// Feed as asked for.
    feed_mm_per_s: f32,
    line: u32,
}

/// Moves that are held.
#[derive(Clone, Copy, Debug)]
pub(super) struct Held {
    /// Start of the held moves, and the end of their planned part.
    begin_10nm: [i32; 3],
    from: Position,
    retraction: Option<FilamentMove>,
    /// The first `travels` of these.
    legs: [Leg; MOST_LEGS],
    moves: [TravelMove; MOST_LEGS],
    travels: usize,
    recovery: Option<FilamentMove>,
    /// True if blocks are planned under an S-curve.
    is_s_curve: bool,
    /// Set as soon as no more moves can join.
    spread: Spread,
    next: Next,
}

/// Part to plan next.
#[derive(Clone, Copy, Debug)]
enum Next {
    /// No part has been planned: more moves may join.
    Begin,
    /// A stage of the retraction, counted from 1, after so much of it; or all of it by itself.
    Retraction {
        stage: u8,
        done_100pm: i64,
    },
    /// A leg without filament, from this place, mm; `is_after` a stage of the retraction.
    Leg {
        leg: usize,
        begin_mm: f32,
        is_after: bool,
    },
    /// The extruder's advance ends.
    AdvanceOff,
    /// A stage of the recovery, counted backwards, the last one 1.
    Recovery {
        stage: u8,
        done_100pm: i64,
    },
    AdvanceOn,
    /// The recovery by itself.
    RecoveryAlone,
    Done,
}

/// Part that is planned at once.
#[derive(Clone, Copy, Debug)]
enum Part {
    Move(Travel),
    /// The extruder's advance ends, or begins again: while filament comes back no line is drawn.
    Advance {
        is_on: bool,
    },
}

impl Held {
    /// An empty hold at this place.
    fn nothing(from: Position, is_s_curve: bool) -> Self {
        Self {
            begin_10nm: from.coordinates_10nm,
            from,
            retraction: None,
            legs: [Leg::NONE; MOST_LEGS],
            moves: [TravelMove { target_10nm: [0; 3], feed_mm_per_s: 0.0, line: 0 }; MOST_LEGS],
            travels: 0,
            recovery: None,
            is_s_curve,
            spread: Spread::NONE,
            next: Next::Begin,
        }
    }

    /// True if such a move may join.
    fn admits(&self, kind: Kind) -> bool {
        let is_open = matches!(self.next, Next::Begin) && self.recovery.is_none();
        is_open
            && match kind {
                Kind::Travel => self.travels < MOST_LEGS,
                Kind::Recovery => self.travels > 0,
                Kind::Retraction | Kind::Other => false,
            }
    }

    fn legs(&self) -> &[Leg] {
        self.legs.get(..self.travels).unwrap_or(&[])
    }

    /// Start of leg `leg`: the end of the previous one.
    fn begin_of(&self, leg: usize) -> [i32; 3] {
        let before = leg.checked_sub(1).and_then(|before| self.moves.get(before));
        before.map_or(self.begin_10nm, |before| before.target_10nm)
    }

    /// End of the last leg.
    fn end_10nm(&self) -> [i32; 3] {
        self.begin_of(self.travels)
    }

    /// The path of a leg.
    fn path_of(&self, leg: usize) -> Path {
        let (begin, end) = (self.begin_of(leg), self.begin_of(leg + 1));
        let mut vector_10nm = [0; 3];
        for ((component, begin), end) in vector_10nm.iter_mut().zip(begin).zip(end) {
            *component = end.wrapping_sub(begin);
        }
        Path::along(vector_10nm)
    }

    /// Closes the held moves: no more join them.
    #[inline(never)]
    fn close(&mut self) {
        if let Some(legs) = self.legs.get_mut(..self.travels) {
            join(legs);
        }
        if self.travels > 0 {
            let law = |filament: &Option<FilamentMove>| filament.as_ref().map(|filament| filament.law(self.is_s_curve));
            let (retraction, recovery) = (law(&self.retraction), law(&self.recovery));
            self.spread = Spread::of(self.legs(), retraction.as_ref(), recovery.as_ref());
        }
        self.next = Next::Retraction { stage: 1, done_100pm: 0 };
    }
}

impl<S: RingMemory, M: MotionMethods> Planner<S, M> {
    /// Holds a move back, if filament may move on its way or it is such filament; otherwise what is
    /// held is planned.
    ///
    /// # Errors
    /// [`MoveError::NoRoom`]: the move has not been taken, though some of the held moves may
    /// have been planned.
    #[inline(never)]
    pub(super) fn holds_back(
        &mut self,
        travel: &Travel,
        target: &Target,
        make_room: &mut impl FnMut(&mut Self) -> bool,
    ) -> Result<bool, MoveError> {
        let kind = kind(travel, target);
        let joins = self.held.as_ref().is_some_and(|held| held.admits(kind));
        if !joins || self.flushing {
            self.settle_held(make_room)?;
        }
        if kind == Kind::Other || kind == Kind::Recovery && self.held.is_none() {
            return Ok(false);
        }
        self.hold(kind, travel, target);
        self.position.advance(target);
        Ok(true)
    }

    /// Adds a move of this kind to the held ones.
    #[inline(never)]
    fn hold(&mut self, kind: Kind, travel: &Travel, target: &Target) {
        let Self { held, rules, choice, position, previous, .. } = self;
        let is_s_curve = choice.acceleration == AccelerationProfile::SCurve;
        let held = held.get_or_insert_with(|| Held::nothing(*position, is_s_curve));
        let Travel { filament_100pm, line, ends_move, .. } = *travel;
        let feed_mm_per_s = larger(travel.feed_mm_per_s, MIN_FEED_MM_PER_S as f32);
        if kind != Kind::Travel {
            let (feed_mm_per_s, acceleration_mm_per_s2) = rules.path_limits.of_filament(feed_mm_per_s);
            let alone = FilamentMove { filament_100pm, feed_mm_per_s, acceleration_mm_per_s2, line, ends_move };
            let place = if kind == Kind::Retraction { &mut held.retraction } else { &mut held.recovery };
            *place = Some(alone);
            return;
        }
        let path = Path::along(target.vector_10nm);
        let [x, y, z] = path.vector.map(f32::abs);
        let (feed, acceleration_mm_per_s2) = rules.limits_along(feed_mm_per_s, path.length, [x, y, z, 0.0], false);
        let corner_acceleration = CornerAcceleration::of_mm_per_s2(acceleration_mm_per_s2);
        let before = match held.travels.checked_sub(1).and_then(|number| Some((number, held.legs.get(number)?))) {
            Some((number, before)) => {
                let acceleration = CornerAcceleration::of_mm_per_s2(before.acceleration_mm_per_s2);
                Previous { path: held.path_of(number), acceleration, ..Previous::NONE }
            }
            // A line and its retraction are separated by a stop.
            None if held.retraction.is_some() && previous.path.filament > 0.0 => Previous::NONE,
            None => *previous,
        };
        let entry_mm_per_s = if before.acceleration.is_some() {
            rules.corner(&before, &path, corner_acceleration, travel).mm_per_s_f32()
        } else {
            0.0
        };
        let length_mm = path.length / UNITS_PER_MM as f32;
        let leg = Leg { length_mm, feed_mm_per_s: feed, acceleration_mm_per_s2, entry_mm_per_s };
        let target_10nm = target.coordinates_10nm;
        if let (Some(legs), Some(moves)) = (held.legs.get_mut(held.travels), held.moves.get_mut(held.travels)) {
            (*legs, *moves) = (leg, TravelMove { target_10nm, feed_mm_per_s, line });
            held.travels += 1;
        }
    }

    /// Plans the held moves, then does a flush that waits for them.
    fn settle_held(&mut self, make_room: &mut impl FnMut(&mut Self) -> bool) -> Result<(), MoveError> {
        while !(if self.flushing { self.close_open_block() } else { self.plan_held() }) {
            if !make_room(self) {
                return Err(MoveError::NoRoom);
            }
        }
        Ok(())
    }

    /// Plans the held moves; `false` without room for all of them.
    #[inline(always)]
    pub(super) fn plan_held(&mut self) -> bool {
        self.held.is_none() || self.plan_parts()
    }

    #[cold]
    #[inline(never)]
    fn plan_parts(&mut self) -> bool {
        let Some(held) = &mut self.held else { return true };
        if matches!(held.next, Next::Begin) {
            held.close();
        }
        core::mem::swap(&mut self.position, &mut held.from);
        let is_planned = self.plan_held_parts();
        let Some(held) = &mut self.held else { return true };
        core::mem::swap(&mut self.position, &mut held.from);
        if is_planned {
            self.held = None;
        }
        is_planned
    }

    /// Plans the held parts, and advances the position to the end of the planned ones.
    fn plan_held_parts(&mut self) -> bool {
        while let Some((part, next)) = self.held.as_ref().and_then(Held::next_part) {
            if !self.plan_part(&part) {
                return false;
            }
            if let Some(held) = &mut self.held {
                held.next = next;
            }
        }
        true
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
        // Cannot fail: the part is within moves that were in reach as a whole.
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
        self.advance_position(&target, &planned, travel.part.as_ref().map_or(0.0, |part| part.whole_10nm));
        true
    }
}

/// Role of a move among those that are held.
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
        // A move of 40 cm is not a retraction.
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

/// True if filament may move along it.
fn is_long(vector_10nm: [i32; 3]) -> bool {
    Path::along(vector_10nm).length_10nm() >= LEAST_TRAVEL_10NM
}
