//! The tables of the book's page "Against Klipper's rules", measured and drawn.

pub mod chart;
pub mod table;
