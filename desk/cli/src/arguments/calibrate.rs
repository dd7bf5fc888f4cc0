//! The arguments of `calibrate`.

use std::path::PathBuf;

use clap::Subcommand;

/// A measurement of `calibrate`.
#[derive(Subcommand)]
pub enum Calibration {
    /// The frequency of the frame and the input shaper for it: from a record of an accelerometer,
    /// as Klipper's TEST_RESONANCES (raw_data) and RepRapFirmware's M956 write it, or from waves
    /// behind a corner of a print.
    Shaper(CalibrateShaperArguments),
    /// Pressure advance: writes lines of different K to print, and turns the number of the
    /// best one into keys.
    Advance(CalibrateAdvanceArguments),
    /// Flow: writes a tube with one wall to print, and turns the thickness of its walls, and the
    /// height up to which it is whole, into keys.
    Flow(CalibrateFlowArguments),
    /// The motors' limits: writes moves of rising acceleration or speed with marks between them,
    /// and turns the number of the last one without lost steps into keys.
    Speed(CalibrateSpeedArguments),
}

/// Arguments of `calibrate shaper`.
#[derive(clap::Args)]
pub struct CalibrateShaperArguments {
    /// The record (CSV): time, X, Y and Z.
    #[arg(conflicts_with_all = ["waves", "over_mm", "speed"])]
    pub record: Option<PathBuf>,
    /// The axis that was shaken.
    #[arg(long, value_enum, default_value_t = ShakenAxis::X)]
    pub axis: ShakenAxis,
    /// Number of waves counted on a print.
    #[arg(long, value_name = "NUMBER")]
    pub waves: Option<f64>,
    /// The length that they take, mm.
    #[arg(long, value_name = "MM")]
    pub over_mm: Option<f64>,
    /// Uncertainty of that length, mm.
    #[arg(long, value_name = "MM", default_value_t = 0.3)]
    pub reading_mm: f64,
    /// The speed of the nozzle there, mm/s.
    #[arg(long, value_name = "MM_PER_S")]
    pub speed: Option<f64>,
    /// Prints the result as one JSON object.
    #[arg(long)]
    pub json: bool,
    /// Draws the record's spectrum, and what the recommended shaper leaves of it.
    #[arg(long, value_name = "OUT.svg")]
    pub plot: Option<PathBuf>,
}

/// Arguments of `calibrate advance`.
#[derive(clap::Args)]
pub struct CalibrateAdvanceArguments {
    /// The G-code to write.
    #[arg(short, value_name = "LINES.gcode", conflicts_with = "best", required_unless_present = "best")]
    pub out: Option<PathBuf>,
    /// The line that looks best, counted from the front; its K is printed as keys of the profile.
    #[arg(long, value_name = "LINE")]
    pub best: Option<u16>,
    /// The machine: cartesian, corexy, prusa-mini, or the path of a TOML file.
    #[arg(long, value_name = "NAME|PATH", default_value = "cartesian")]
    pub profile: String,
    /// K of the first line, s.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0)]
    pub from: f64,
    /// Difference of K from line to line, s.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.005)]
    pub step: f64,
    /// Number of lines.
    #[arg(long, value_name = "N", default_value_t = 21, value_parser = clap::value_parser!(u16).range(1..=200))]
    pub lines: u16,
    /// Speed at the ends of a line, mm/s.
    #[arg(long, value_name = "MM_PER_S", default_value_t = 20.0)]
    pub slow: f64,
    /// Speed in the middle of a line, mm/s.
    #[arg(long, value_name = "MM_PER_S", default_value_t = 100.0)]
    pub fast: f64,
    #[command(flatten)]
    pub heat: HeatArguments,
}

/// Temperatures of a pattern.
#[derive(Clone, Copy, clap::Args)]
pub struct HeatArguments {
    /// Temperature of the nozzle, degrees Celsius.
    #[arg(long, value_name = "CELSIUS", default_value_t = 210.0)]
    pub nozzle: f64,
    /// Temperature of the bed, degrees Celsius; 0 leaves it off.
    #[arg(long, value_name = "CELSIUS", default_value_t = 60.0)]
    pub bed: f64,
}

/// Arguments of `calibrate flow`.
#[derive(clap::Args)]
#[command(group = clap::ArgGroup::new("does").args(["out", "walls", "whole_to_mm"]).required(true))]
pub struct CalibrateFlowArguments {
    /// The G-code to write.
    #[arg(short, value_name = "TUBE.gcode")]
    pub out: Option<PathBuf>,
    /// Walls of the lowest part as a caliper measures them, mm, at least two; the
    /// extruder's key is printed.
    #[arg(long, value_name = "MM,MM,...", value_delimiter = ',')]
    pub walls: Vec<f64>,
    /// Height up to which the wall is whole, mm; the key for the largest flow is printed.
    #[arg(long, value_name = "MM")]
    pub whole_to_mm: Option<f64>,
    /// The machine: cartesian, corexy, prusa-mini, or the path of a TOML file.
    #[arg(long, value_name = "NAME|PATH", default_value = "cartesian")]
    pub profile: String,
    /// Flow of the lowest part, mm^3/s.
    #[arg(long, value_name = "MM3_PER_S", default_value_t = 4.0)]
    pub from: f64,
    /// Difference of flow from band to band, mm^3/s.
    #[arg(long, value_name = "MM3_PER_S", default_value_t = 1.0)]
    pub step: f64,
    /// Number of bands.
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u16).range(1..=200))]
    pub bands: u16,
    /// Power of the fan above the first layers, %.
    #[arg(long, value_name = "PERCENT", default_value_t = 50.0)]
    pub fan: f64,
    #[command(flatten)]
    pub heat: HeatArguments,
}

/// Arguments of `calibrate speed`.
#[derive(clap::Args)]
pub struct CalibrateSpeedArguments {
    /// The G-code to write.
    #[arg(short, value_name = "MOVES.gcode", conflicts_with = "good", required_unless_present = "good")]
    pub out: Option<PathBuf>,
    /// The last stage whose marks are in line, counted from the left; keys of the
    /// profile are printed.
    #[arg(long, value_name = "STAGE")]
    pub good: Option<u16>,
    /// The limit that rises from stage to stage.
    #[arg(long, value_enum, default_value_t = TriedArgument::Acceleration)]
    pub of: TriedArgument,
    /// The machine: cartesian, corexy, prusa-mini, or the path of a TOML file.
    #[arg(long, value_name = "NAME|PATH", default_value = "cartesian")]
    pub profile: String,
    /// The first stage's acceleration, mm/s^2, or speed, mm/s [default: 1000 or 100].
    #[arg(long, value_name = "VALUE")]
    pub from: Option<f64>,
    /// Difference from stage to stage [default: 1000 or 50].
    #[arg(long, value_name = "VALUE")]
    pub step: Option<f64>,
    /// Number of stages.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u16).range(1..=100))]
    pub stages: u16,
    /// Number of times that a stage makes its moves.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub repeats: u16,
    #[command(flatten)]
    pub heat: HeatArguments,
}

/// A limit that `calibrate speed` tries.
#[derive(Clone, Copy, clap::ValueEnum)]
pub enum TriedArgument {
    /// Acceleration of X and Y, mm/s^2.
    Acceleration,
    /// Speed of X and Y, mm/s.
    Speed,
}

/// An axis with a shaper.
#[derive(Clone, Copy, clap::ValueEnum)]
pub enum ShakenAxis {
    /// X.
    X,
    /// Y.
    Y,
}

impl ShakenAxis {
    /// Its index.
    pub const fn index(self) -> usize {
        match self {
            Self::X => 0,
            Self::Y => 1,
        }
    }
}
