//! Samples of a nozzle's motion and flow at equal times.

/// Time between two samples, s.
pub const SAMPLE_S: f64 = 0.000_25;

/// All quantities at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// Time, s.
    pub time_s: f64,
    /// Position of X and Y that the motors command, mm.
    pub command_mm: [f64; 2],
    /// Position of the nozzle on the frame, mm.
    pub nozzle_mm: [f64; 2],
    /// Speed of the nozzle, mm/s.
    pub nozzle_mm_per_s: [f64; 2],
    /// Position of the filament that the extruder's motor commands, mm.
    pub filament_mm: f64,
    /// Volume that has come out since the previous sample, mm^3.
    pub out_mm3: f64,
    /// True if the origin of the coordinates has changed since the previous sample.
    pub restart: bool,
}
