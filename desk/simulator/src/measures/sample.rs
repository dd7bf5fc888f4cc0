//! A nozzle's motion and flow at equal times.

/// Time between two samples, s.
pub const SAMPLE_S: f64 = 0.000_25;

/// Everything at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// When, s.
    pub time_s: f64,
    /// Where the motors put X and Y, mm.
    pub command_mm: [f64; 2],
    /// Where the frame puts the nozzle, mm.
    pub nozzle_mm: [f64; 2],
    /// How fast the nozzle moves, mm/s.
    pub nozzle_mm_per_s: [f64; 2],
    /// Where the extruder's motor puts the filament, mm.
    pub filament_mm: f64,
    /// What has come out since the sample before, mm^3.
    pub out_mm3: f64,
    /// The coordinates were given other numbers since the sample before.
    pub restart: bool,
}
