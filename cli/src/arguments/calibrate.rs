//! The arguments of `calibrate`.

use std::path::PathBuf;

use clap::Subcommand;

/// What `calibrate` measures.
#[derive(Subcommand)]
pub enum Calibration {
    /// The frequency of the frame and the input shaper for it: from a record of an accelerometer, as Klipper's TEST_RESONANCES (raw_data)
    /// and RepRapFirmware's M956 write it, or from waves behind a corner of a print.
    Shaper(CalibrateShaperArguments),
    /// Pressure advance: writes lines of different K to print, and turns the number of the best one into keys.
    Advance(CalibrateAdvanceArguments),
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
    /// How many waves were counted on a print.
    #[arg(long, value_name = "NUMBER")]
    pub waves: Option<f64>,
    /// Over which length, mm.
    #[arg(long, value_name = "MM")]
    pub over_mm: Option<f64>,
    /// How well the length was read, mm.
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
    /// How much more each line has, s.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.005)]
    pub step: f64,
    /// How many lines.
    #[arg(long, value_name = "N", default_value_t = 21, value_parser = clap::value_parser!(u16).range(1..=200))]
    pub lines: u16,
    /// Speed at the ends of a line, mm/s.
    #[arg(long, value_name = "MM_PER_S", default_value_t = 20.0)]
    pub slow: f64,
    /// Speed in the middle of a line, mm/s.
    #[arg(long, value_name = "MM_PER_S", default_value_t = 100.0)]
    pub fast: f64,
    /// Temperature of the nozzle, degrees Celsius.
    #[arg(long, value_name = "CELSIUS", default_value_t = 210.0)]
    pub nozzle: f64,
    /// Temperature of the bed, degrees Celsius; 0 leaves it off.
    #[arg(long, value_name = "CELSIUS", default_value_t = 60.0)]
    pub bed: f64,
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
