//! The papers' time laws as one type.

use ferrostep_planner::methods::{OtherLaw, SpeedRule};
use ferrostep_planner::piece::Piece;
use ferrostep_planner::{Block, PlannedBlock, Speed};

use crate::five_segments::{FiveSegments, SegmentPieces};
use crate::staircase::StaircasePieces;
use crate::table::FrequencyTable;

/// A time law from the papers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PaperRule {
    /// Li's table of frequencies.
    Table(FrequencyTable),
    /// Li's ramps in closed form, segment by segment.
    FiveSegments(FiveSegments),
}

/// Pieces of a block under one of these laws.
#[derive(Clone, Copy, Debug)]
pub enum PaperPieces {
    /// Pieces of a staircase of constant speeds.
    Staircase(StaircasePieces),
    /// Pieces of the five segments.
    Segments(SegmentPieces),
}

impl Iterator for PaperPieces {
    type Item = Piece<f64>;

    fn next(&mut self) -> Option<Piece<f64>> {
        match self {
            Self::Staircase(pieces) => pieces.next(),
            Self::Segments(pieces) => pieces.next(),
        }
    }
}

impl SpeedRule for PaperRule {
    type Pieces = PaperPieces;

    fn nominal(&self, block: &Block) -> Speed {
        match self {
            Self::Table(rule) => rule.nominal(block),
            Self::FiveSegments(rule) => rule.nominal(block),
        }
    }

    fn reach(&self, block: &Block, speed: Speed) -> Speed {
        match self {
            Self::Table(rule) => rule.reach(block, speed),
            Self::FiveSegments(rule) => rule.reach(block, speed),
        }
    }

    fn slowest(&self, block: &Block, speed: Speed, wanted: Speed) -> Speed {
        match self {
            Self::Table(rule) => rule.slowest(block, speed, wanted),
            Self::FiveSegments(rule) => rule.slowest(block, speed, wanted),
        }
    }

    fn law(&self, planned: &PlannedBlock) -> OtherLaw<PaperPieces> {
        match self {
            Self::Table(rule) => with_pieces(rule.law(planned), PaperPieces::Staircase),
            Self::FiveSegments(rule) => with_pieces(rule.law(planned), PaperPieces::Segments),
        }
    }
}

fn with_pieces<P>(law: OtherLaw<P>, pieces: impl Fn(P) -> PaperPieces) -> OtherLaw<PaperPieces> {
    OtherLaw { pieces: pieces(law.pieces), length: law.length, duration_ticks: law.duration_ticks }
}
