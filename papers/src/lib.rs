//! The papers' other methods of motion, each with its equations, for the planner's two extension
//! points ([`ferrostep_planner::methods`]): no printer needs them, and no printer's image contains
//! them.
//!
//! - *Step patterns*, in addition to step Bresenham: classic Bresenham (Wu 2024, eq. 3), and the
//!   three of the CoreXY paper, point-by-point comparison, minimum deviation and dual-rate
//!   ([`plane`]).
//! - *Time laws*, in addition to trapezoid and S-curve: Li's five segments ([`five_segments`]), and
//!   his table of frequencies ([`table`], [`staircase`]), with his cases of a segment ([`plan`])
//!   and his ring of segments ([`segments`]).
//! - Step Bresenham by Wu's own rules ([`bresenham`]), and Li's S-curve in closed form
//!   ([`closed_form`]).
//! - *The wide encoding* of prepared jobs (Yu 2019): [`wide`].
//!
//! The desktop tool and the bench image plan with [`Papers`]. The feature `tables` reproduces the
//! papers' tables and figures.
#![cfg_attr(not(any(test, feature = "tables", feature = "write")), no_std)]

pub mod bresenham;
pub mod closed_form;
pub mod five_segments;
pub mod plan;
pub mod plane;
pub mod segments;
pub mod staircase;
pub mod table;
#[cfg(feature = "tables")]
pub mod tables;
pub mod wide;

mod curve_error;
mod laws;
mod method;
mod papers;

mod pattern;
mod pulses;
#[cfg(test)]
mod staircase_tests;

pub use curve_error::CurveError;
pub use laws::{PaperPieces, PaperRule};
pub use papers::Papers;
pub use pattern::PaperPattern;
