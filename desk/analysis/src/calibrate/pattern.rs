//! Common parts of the patterns that are printed to be looked at or measured.

use std::f64::consts::PI;
use std::fmt::{self, Write};
use std::ops::RangeInclusive;

use ferrostep_planner::kinematics::UNITS_PER_MM;
use ferrostep_printer::Profile;

/// Free space around a pattern, mm.
pub const MARGIN_MM: f64 = 10.0;

/// The nozzle of a profile that does not name it, mm.
const USUAL_NOZZLE_MM: f64 = 0.4;

/// Filament pulled back on the way to the next part, mm.
pub const RETRACTED_MM: f64 = 0.8;
/// Speed of that retraction, mm/s.
pub const RETRACTION_MM_PER_S: f64 = 30.0;

/// Reason why a pattern cannot be printed, or its measurement means nothing.
#[derive(Clone, Debug, PartialEq)]
pub enum PatternError {
    /// A value: its option, the given text, the range.
    Value(&'static str, f64, String),
    /// The bed is narrower than this, mm.
    Narrow(f64),
    /// No measurement was given: the options to give.
    Nothing(&'static str),
}

impl fmt::Display for PatternError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Value(option, value, expected) => write!(out, "{option} {value}: expected {expected}"),
            Self::Narrow(needed_mm) => write!(out, "the bed is narrower than the {needed_mm:.0} mm of the pattern"),
            Self::Nothing(expected) => write!(out, "expected {expected}"),
        }
    }
}

impl std::error::Error for PatternError {}

/// Refuses what is not in a range; NaN is in none.
///
/// # Errors
/// [`PatternError::Value`].
pub fn in_range(option: &'static str, value: f64, range: RangeInclusive<f64>, unit: &str) -> Result<(), PatternError> {
    if range.contains(&value) {
        return Ok(());
    }
    Err(PatternError::Value(option, value, format!("{} to {} {unit}", range.start(), range.end())))
}

/// Temperatures for printing a pattern.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Temperatures {
    /// The nozzle, degrees Celsius.
    pub nozzle_celsius: f64,
    /// The bed, degrees Celsius; 0 leaves it off.
    pub bed_celsius: f64,
}

impl Temperatures {
    /// Checks that the machine can reach the temperatures and that the nozzle melts filament.
    ///
    /// # Errors
    /// [`PatternError::Value`].
    pub fn check(&self, profile: &Profile) -> Result<(), PatternError> {
        let [nozzle, bed] = [profile.nozzle.max_target_celsius, profile.bed.max_target_celsius].map(f64::from);
        in_range("--nozzle", self.nozzle_celsius, f64::from(profile.min_extrusion_celsius)..=nozzle, "C")?;
        in_range("--bed", self.bed_celsius, 0.0..=bed, "C")
    }

    /// Heats, homes, and raises the nozzle a little.
    pub fn begin(&self, out: &mut String) {
        let Self { nozzle_celsius, bed_celsius } = self;
        if *bed_celsius > 0.0 {
            let _ = writeln!(out, "M140 S{bed_celsius}\nM104 S{nozzle_celsius}\nM190 S{bed_celsius}");
        }
        let _ = writeln!(out, "M109 S{nozzle_celsius}\nG21\nG90\nM83\nG28\nG1 Z5 F600");
    }
}

/// Pulls the filament back, raises the nozzle and switches everything off.
pub fn end(out: &mut String, raised_to_mm: f64) {
    let speed = 60.0 * RETRACTION_MM_PER_S;
    let _ = writeln!(out, "G1 E-{RETRACTED_MM} F{speed}\nG1 Z{raised_to_mm:.3} F600\nM107\nM104 S0\nM140 S0\nM84");
}

/// A bead of plastic: a rectangle with round ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bead {
    /// Layer height, mm.
    pub height_mm: f64,
    /// Width of the line, mm.
    pub width_mm: f64,
}

impl Bead {
    /// A bead whose height and width are given in nozzle diameters.
    pub fn of_nozzle(nozzle_mm: f64, height: f64, width: f64) -> Self {
        Self { height_mm: height * nozzle_mm, width_mm: width * nozzle_mm }
    }

    /// Cross section, mm^2.
    pub fn area_mm2(&self) -> f64 {
        (self.width_mm - self.height_mm) * self.height_mm + 0.25 * PI * self.height_mm * self.height_mm
    }

    /// Filament for a mm of it, mm.
    pub fn filament_per_mm(&self, profile: &Profile) -> f64 {
        self.area_mm2() / (0.25 * PI * mm(profile.extrusion.filament_diameter_10nm).powi(2))
    }
}

/// The nozzle's diameter, mm.
pub fn nozzle_mm(profile: &Profile) -> f64 {
    profile.nozzle_diameter_mm.map_or(USUAL_NOZZLE_MM, f64::from)
}

/// A length of a profile, mm.
pub fn mm(units_10nm: i64) -> f64 {
    units_10nm as f64 / UNITS_PER_MM as f64
}
