//! Whoever follows the motion of a plan by another firmware's rules.

use crate::limit_shares::Phase;

/// A straight move as it is executed.
#[derive(Clone, Copy, Debug)]
pub struct Piece {
    /// Number of its line.
    pub line: u32,
    /// The piece's start, machine coordinates, mm.
    pub start_mm: [f64; 3],
    /// Displacement of X, Y, Z and the filament, mm.
    pub displacement_mm: [f64; 4],
    /// The speed that its line asks for, mm/s.
    pub feed_mm_per_s: f64,
    /// True for the last piece of a move of its line.
    pub ends_move: bool,
    /// The phases one after the other. Speeds are those of the path, or of the filament where
    /// only that moves.
    pub phases: [Phase; 3],
}

/// Follows the motion of a plan.
pub trait PlanObserver {
    /// A move is executed, after those before it.
    fn ran(&mut self, piece: &Piece);
    /// The machine is at another place from a tick of the motion clock on, mm, as after homing.
    fn stands(&mut self, tick: u64, position_mm: [f64; 3]);
}
