//! The units of positions and of filament.

/// Units of 10 nm in a millimetre.
pub const UNITS_PER_MM: i64 = 100_000;

/// Units of filament in a millimetre: 0.1 nm, so that a length of 10 nm times a flow in
/// percent is exact.
pub const FILAMENT_UNITS_PER_MM: i64 = 10_000_000;

/// A unit of filament times a unit of [`crate::StepsPerMm`], a 256th of a step's worth of them.
pub(crate) const UNITS_PER_256TH: u64 = FILAMENT_UNITS_PER_MM as u64 * 100_000 / 256;
