//! The moves of a job on their way through another firmware's planner.

use std::rc::Rc;

use ferrostep_gcode::Command;
use ferrostep_planner::extruder::FILAMENT_UNITS_PER_MM;
use ferrostep_planner::kinematics::UNITS_PER_MM;
use ferrostep_planner::{Move, TICKS_PER_SECOND};
use ferrostep_rules::arcs::{Arc, ArcCut, MarlinArcs};
use ferrostep_rules::{Move as RulesMove, MoveError, PlannedMove, Rules};

use super::changes;
use super::settings::ByRules;
use crate::desk::LineEnds;
use crate::limit_shares::{RulesReport, Shares};

/// An arc whose chords arrive. The other firmware gets it whole, and cuts it in its own way.
#[derive(Clone, Copy, Debug)]
struct Begun {
    centre_mm: [f64; 2],
    is_clockwise: bool,
    start_10nm: [i64; 3],
    filament_100pm: i64,
}

/// Planner and sums of a job.
#[derive(Debug)]
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
        }
    }

    /// Notes from now on where the motion of each line ends.
    pub fn follow_lines(&mut self, ends: Rc<LineEnds>) {
        self.line_ends = Some(ends);
    }

    /// Takes a command.
    pub fn see(&mut self, command: &Command<'_>, unit_mm: f64) {
        changes::see(&mut self.by.planner, command, unit_mm);
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
        let (tag, feed_mm_per_s) = (u64::from(one.line), f64::from(one.feed_mm_per_s));
        match &mut self.arc {
            None => {
                let displacement_mm = displacement(from_10nm, one.target_10nm, one.filament_100pm);
                self.by.planner.push(&RulesMove::straight(tag, displacement_mm, feed_mm_per_s), &mut self.released)?;
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
                for chord in arc.chords(&self.arc_cut(), feed_mm_per_s) {
                    let chord_move =
                        RulesMove { tag, displacement_mm: chord.displacement_mm, feed_mm_per_s, arc: chord.hint };
                    self.by.planner.push(&chord_move, &mut self.released)?;
                    self.count();
                }
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
        self.shares.rest();
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
        let has_jerk = matches!(self.by.rules, Rules::MarlinClassicJerk | Rules::Rrf);
        RulesReport { name: self.by.rules.name(), has_jerk, limits: self.shares.shares() }
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
        for planned in self.released.drain(..) {
            self.seconds += planned.duration_s();
            self.shares.add(&planned);
            if let Some(ends) = &self.line_ends {
                ends.note(planned.tag as u32, self.own_ticks + ticks(self.seconds));
            }
        }
    }
}

/// A time in ticks.
fn ticks(seconds: f64) -> u64 {
    (seconds * f64::from(TICKS_PER_SECOND)) as u64
}

/// A displacement of X, Y, Z and the filament, mm.
fn displacement(from_10nm: [i64; 3], to_10nm: [i64; 3], filament_100pm: i64) -> [f64; 4] {
    let [x, y, z] = [0, 1, 2].map(|axis| (to_10nm[axis] - from_10nm[axis]) as f64 / UNITS_PER_MM as f64);
    [x, y, z, filament_100pm as f64 / FILAMENT_UNITS_PER_MM as f64]
}
