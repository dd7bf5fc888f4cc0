//! Moves that have been planned and whose execution has not ended: those of lines, and those that
//! the printer makes itself.
//!
//! A line tells when its move ends. A retraction by G10, a lift, a way to a parking place or to
//! another tool has no such end: it has passed when the nozzle is at the end of its path, or the
//! filament at the end of its.

use std::collections::VecDeque;

use crate::commanded::PlannedMove;

/// Distance from the end of a move's path from which on it has ended, mm: more than motors round.
const END_MM: f64 = 0.02;
/// Path after which a move of filament alone has ended, whatever the extruder's steps say, mm.
const NEXT_MM: f64 = 0.05;

/// A planned move; `P` is a place where it may have ended.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Piece<P> {
    pub line: u32,
    /// Filament to push, mm.
    pub filament_mm: f64,
    /// True if the nozzle moves.
    pub moves: bool,
    /// Place where it has ended, if it does not end its line's move.
    pub ended: Option<P>,
    ends_move: bool,
    /// End of its path, mm from the beginning of all.
    end_mm: f64,
}

/// Planned moves in their order.
#[derive(Debug)]
pub(crate) struct Pieces<P> {
    waiting: VecDeque<Piece<P>>,
    planned_mm: f64,
}

impl<P> Default for Pieces<P> {
    fn default() -> Self {
        Self { waiting: VecDeque::new(), planned_mm: 0.0 }
    }
}

impl<P: Copy> Pieces<P> {
    /// A move has been planned, with a path of this length.
    pub fn plan(&mut self, taken: &PlannedMove, length_mm: f64) {
        self.planned_mm += length_mm;
        self.waiting.push_back(Piece {
            line: taken.line,
            filament_mm: taken.filament_mm,
            moves: length_mm > 0.0,
            ended: None,
            ends_move: taken.ends_move,
            end_mm: self.planned_mm,
        });
    }

    /// The motion so far has been broken off.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// The nozzle is at a place: so far along all of its path, and with so much filament pushed
    /// since the last move ended.
    pub fn pass(&mut self, along_mm: f64, filament_mm: f64, step_mm: f64, place: P) {
        let mut pushed_mm = 0.0;
        for piece in &mut self.waiting {
            if piece.ends_move {
                return;
            }
            pushed_mm += piece.filament_mm;
            if piece.ended.is_some() {
                continue;
            }
            let filament_left_mm = (pushed_mm - filament_mm) * piece.filament_mm.signum();
            let has_ended = if piece.moves {
                along_mm >= piece.end_mm - END_MM
            } else {
                filament_left_mm <= 0.6 * step_mm || along_mm > piece.end_mm + NEXT_MM
            };
            if !has_ended {
                return;
            }
            piece.ended = Some(place);
        }
    }

    /// Takes the moves up to the end of a line's; `None` if none is known.
    pub fn end_line(&mut self) -> Option<Vec<Piece<P>>> {
        let end = self.waiting.iter().position(|piece| piece.ends_move)?;
        Some(self.waiting.drain(..=end).collect())
    }

    /// Takes the moves that have ended before a line's end.
    pub fn end_own(&mut self) -> Vec<Piece<P>> {
        let count = self.waiting.iter().take_while(|piece| piece.ended.is_some()).count();
        self.waiting.drain(..count).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn planned(line: u32, filament_mm: f64, ends_move: bool) -> PlannedMove {
        PlannedMove { line, filament_mm, ends_move, ..PlannedMove::default() }
    }

    #[test]
    fn a_retraction_and_a_lift_end_before_the_line_after_them() {
        let mut pieces = Pieces::default();
        pieces.plan(&planned(2, -0.8, false), 0.0);
        pieces.plan(&planned(2, 0.0, false), 0.4);
        pieces.plan(&planned(3, 0.0, true), 50.0);
        for (at, (along_mm, filament_mm)) in
            [(0.0, -0.3), (0.0, -0.797), (0.2, -0.8), (0.4, -0.8), (9.0, -0.8)].into_iter().enumerate()
        {
            pieces.pass(along_mm, filament_mm, 0.01, at);
        }
        let Some(taken) = pieces.end_line() else { panic!("a line has ended") };
        assert_eq!(taken.iter().map(|piece| piece.ended).collect::<Vec<_>>(), [Some(1), Some(3), None]);
        assert!(pieces.end_line().is_none() && pieces.end_own().is_empty());
    }

    #[test]
    fn moves_that_rest_before_any_line_are_taken_as_far_as_they_have_ended() {
        let mut pieces = Pieces::default();
        pieces.plan(&planned(2, -0.8, false), 0.0);
        pieces.plan(&planned(2, 0.0, false), 80.0);
        pieces.pass(0.0, -0.8, 0.01, 1);
        assert_eq!(pieces.end_own().len(), 1);
        pieces.pass(79.99, -0.8, 0.01, 2);
        assert_eq!(pieces.end_own().iter().map(|piece| piece.ended).collect::<Vec<_>>(), [Some(2)]);
    }
}
