//! The moves of a job on their way through another firmware's planner.

use std::collections::VecDeque;
use std::rc::Rc;

use ferrostep_gcode::Command;
use ferrostep_planner::extruder::FILAMENT_UNITS_PER_MM;
use ferrostep_planner::kinematics::UNITS_PER_MM;
use ferrostep_planner::{Move, TICKS_PER_SECOND};
use ferrostep_rules::arcs::{Arc, ArcCut, MarlinArcs};
use ferrostep_rules::{Move as RulesMove, MoveError, PlannedMove};

use super::changes;
use super::observer::{Piece, PlanObserver};
use super::refusals::Refusals;
use super::settings::ByRules;
use crate::desk::LineEnds;
use crate::limit_shares::{RulesReport, Settled, Shares};

/// An arc whose chords arrive. The other firmware gets it whole, and cuts it in its own way.
#[derive(Clone, Copy, Debug)]
struct Begun {
    centre_mm: [f64; 2],
    is_clockwise: bool,
    start_10nm: [i64; 3],
    filament_100pm: i64,
}

/// A move that waits in the planner.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    start_mm: [f64; 3],
    displacement_mm: [f64; 4],
    feed_mm_per_s: f64,
    ends_move: bool,
}

/// Planner and sums of a job.
pub(super) struct Plan {
    by: ByRules,
    arc: Option<Begun>,
    /// Kept for its memory.
    released: Vec<PlannedMove>,
    shares: Shares,
    seconds: f64,
    /// Ticks of this firmware's own motion before these moves.
    own_ticks: u64,
    /// The ends of lines, if someone follows them.
    line_ends: Option<Rc<LineEnds>>,
    observer: Option<Box<dyn PlanObserver>>,
    /// Commands of the present line that the firmware does not have or refuses.
    refusals: Rc<Refusals>,
    /// The planner's moves, for the observer.
    waiting: VecDeque<Waiting>,
    /// Moves that are too short for the firmware, and that it makes with the next one.
    carried: Option<Waiting>,
}

impl Plan {
    /// A plan without moves.
    pub fn new(by: ByRules) -> Self {
        Self {
            by,
            arc: None,
            released: Vec::new(),
            shares: Shares::default(),
            seconds: 0.0,
            own_ticks: 0,
            line_ends: None,
            observer: None,
            refusals: Rc::default(),
            waiting: VecDeque::new(),
            carried: None,
        }
    }

    /// Commands of the present line that the firmware does not have or refuses.
    pub fn refusals(&self) -> Rc<Refusals> {
        Rc::clone(&self.refusals)
    }

    /// Tells an observer of all motion from now on; none has been planned.
    pub fn observe(&mut self, observer: Box<dyn PlanObserver>) {
        self.observer = Some(observer);
    }

    /// Gives access to the observer.
    pub fn with_observer(&mut self, act: impl FnOnce(&mut dyn PlanObserver)) {
        if let Some(observer) = &mut self.observer {
            act(observer.as_mut());
        }
    }

    /// Notes from now on where the motion of each line ends.
    pub fn follow_lines(&mut self, ends: Rc<LineEnds>) {
        self.line_ends = Some(ends);
    }

    /// Takes a command.
    pub fn see(&mut self, command: &Command<'_>, unit_mm: f64) {
        if let Some((name, effect)) = changes::see(&mut self.by.planner, &self.by.scale, command, unit_mm) {
            self.refusals.note(name, self.by.rules.firmware(), effect);
        }
    }

    /// The moves up to the one that ends its line are chords of an arc from here.
    pub fn begin_arc(&mut self, start_10nm: [i64; 3], centre_mm: [f64; 2], is_clockwise: bool) {
        self.arc = Some(Begun { centre_mm, is_clockwise, start_10nm, filament_100pm: 0 });
    }

    /// Takes a move that begins at a place, after this firmware's own motion (`own_ticks`).
    ///
    /// # Errors
    /// The rules have no plan for it.
    pub fn add(&mut self, one: &Move, from_10nm: [i64; 3], own_ticks: u64) -> Result<(), MoveError> {
        self.own_ticks = own_ticks;
        let (tag, feed_mm_per_s) = (u64::from(one.line), f64::from(one.feed_mm_per_s) * self.by.scale.asked_speed);
        match &mut self.arc {
            None => {
                let displacement_mm = displacement(from_10nm, one.target_10nm, one.filament_100pm);
                let straight = RulesMove::straight(tag, displacement_mm, feed_mm_per_s);
                self.push(&straight, millimetres(from_10nm), one.ends_move)?;
            }
            Some(begun) => {
                begun.filament_100pm += one.filament_100pm;
                let Begun { centre_mm, is_clockwise, start_10nm, filament_100pm } = *begun;
                if !one.ends_move {
                    return Ok(());
                }
                self.arc = None;
                let displacement_mm = displacement(start_10nm, one.target_10nm, filament_100pm);
                let arc = Arc { displacement_mm, centre_mm, is_clockwise };
                let mut at_mm = millimetres(start_10nm);
                let mut chords = arc.chords(&self.arc_cut(), feed_mm_per_s);
                while let Some(chord) = chords.next() {
                    let chord_move =
                        RulesMove { tag, displacement_mm: chord.displacement_mm, feed_mm_per_s, arc: chord.hint };
                    self.push(&chord_move, at_mm, chords.len() == 0)?;
                    at_mm = std::array::from_fn(|axis| at_mm[axis] + chord.displacement_mm[axis]);
                }
            }
        }
        Ok(())
    }

    /// Hands the planner a move that starts at a place, and counts those that are planned by then.
    fn push(&mut self, one: &RulesMove, start_mm: [f64; 3], ends_move: bool) -> Result<(), MoveError> {
        let planner = &mut self.by.planner;
        let before = planner.queued();
        planner.push(one, &mut self.released)?;
        if self.observer.is_some() {
            let RulesMove { mut displacement_mm, feed_mm_per_s, .. } = *one;
            let carried = self.carried.take();
            for (part, carried) in displacement_mm.iter_mut().zip(carried.map_or([0.0; 4], |one| one.displacement_mm)) {
                *part += carried;
            }
            let start_mm = carried.map_or(start_mm, |one| one.start_mm);
            let waiting = Waiting { start_mm, displacement_mm, feed_mm_per_s, ends_move };
            if planner.queued() + self.released.len() > before {
                self.waiting.push_back(waiting);
            } else {
                self.carried = Some(waiting);
            }
        }
        self.count();
        Ok(())
    }

    /// Plans all moves to their end at rest.
    pub fn flush(&mut self) {
        self.arc = None;
        self.by.planner.flush(&mut self.released);
        self.count();
        if let Some(settled) = self.shares.rest() {
            self.settle(&settled);
        }
    }

    /// Ticks of the moves that are planned.
    pub fn ticks(&self) -> u64 {
        ticks(self.seconds)
    }

    /// Time of the moves that are planned, s.
    pub const fn seconds(&self) -> f64 {
        self.seconds
    }

    /// The rules, and the shares of their limits.
    pub fn report(&self) -> RulesReport {
        RulesReport { name: self.by.rules.name(), limits: self.shares.shares() }
    }

    fn arc_cut(&self) -> ArcCut {
        let chord_mm = self.by.arc_chord_mm;
        match self.by.planner.arc_cut() {
            ArcCut::Klipper { .. } => ArcCut::Klipper { resolution_mm: chord_mm },
            ArcCut::Marlin(arcs) => ArcCut::Marlin(MarlinArcs { max_segment_mm: chord_mm, ..arcs }),
            ArcCut::Rrf => ArcCut::Rrf,
        }
    }

    fn count(&mut self) {
        let mut released = std::mem::take(&mut self.released);
        for planned in released.drain(..) {
            if let Some(settled) = self.shares.add(&planned) {
                self.settle(&settled);
            }
        }
        self.released = released;
    }

    /// A move is executed: its time passes.
    fn settle(&mut self, settled: &Settled) {
        let line = settled.planned.tag as u32;
        self.seconds += settled.planned.duration_s();
        if let Some(ends) = &self.line_ends {
            ends.note(line, self.own_ticks + ticks(self.seconds));
        }
        if let (Some(observer), Some(waiting)) = (&mut self.observer, self.waiting.pop_front()) {
            let Waiting { start_mm, displacement_mm, feed_mm_per_s, ends_move } = waiting;
            let phases = settled.phases();
            observer.ran(&Piece { line, start_mm, displacement_mm, feed_mm_per_s, ends_move, phases });
        }
    }
}

/// A time in ticks.
fn ticks(seconds: f64) -> u64 {
    (seconds * f64::from(TICKS_PER_SECOND)) as u64
}

/// A place, mm.
pub(super) fn millimetres(position_10nm: [i64; 3]) -> [f64; 3] {
    position_10nm.map(|units| units as f64 / UNITS_PER_MM as f64)
}

/// A displacement of X, Y, Z and the filament, mm.
fn displacement(from_10nm: [i64; 3], to_10nm: [i64; 3], filament_100pm: i64) -> [f64; 4] {
    let [x, y, z] = millimetres(std::array::from_fn(|axis| to_10nm[axis] - from_10nm[axis]));
    [x, y, z, filament_100pm as f64 / FILAMENT_UNITS_PER_MM as f64]
}
