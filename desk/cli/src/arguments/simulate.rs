//! The arguments of `simulate`.

use std::path::PathBuf;

use ferrostep_planner::ShaperKind as InputShaperKind;
use ferrostep_profiles::PlannedBy;
use ferrostep_simulator::shapers::ShaperKind;

use super::job::{MacroArgument, PlateArgument};
use super::values::rules;

/// Arguments of `simulate`.
#[derive(clap::Args)]
#[command(group = clap::ArgGroup::new("filtered").args(["compare", "input_shaper"]).multiple(true))]
pub struct SimulateArguments {
    /// A job, which is printed on the virtual board first (G-code, as text or binary, plain or
    /// gzip, or in a sliced 3MF, or a prepared job), or a trace as `print --trace` writes it, of
    /// any firmware; - is standard input.
    pub file: PathBuf,
    /// The plate of a 3MF.
    #[command(flatten)]
    pub plate: PlateArgument,
    /// The macros that the profile lacks.
    #[command(flatten)]
    pub macros: MacroArgument,
    /// The machine of the job: cartesian, corexy, prusa-mini, or the path of a TOML file [default:
    /// cartesian, with the travel and limits in the slicer's comments].
    #[arg(long, value_name = "NAME|PATH")]
    pub profile: Option<String>,
    /// The G-code that a trace or a prepared job was made from: the path to measure against
    /// [default: of G-code its own, of a trace or a prepared job the path that the steps draw].
    #[arg(long, value_name = "FILE", conflicts_with = "path_of_steps")]
    pub path: Option<PathBuf>,
    /// Measures against the path that the steps draw, also for G-code.
    #[arg(long)]
    pub path_of_steps: bool,
    /// Frequency of the frame in X, 1 to 1000 Hz [default: 50].
    #[arg(long, value_name = "HZ")]
    pub frequency_x: Option<f64>,
    /// Frequency of the frame in Y, 1 to 1000 Hz [default: 40].
    #[arg(long, value_name = "HZ")]
    pub frequency_y: Option<f64>,
    /// Moves the frame, not the filters: its frequencies are by this share above (or, with a minus,
    /// below) those that the filters are made for; -50 to 50 %.
    #[arg(long, value_name = "PERCENT", allow_negative_numbers = true)]
    pub detune: Option<f64>,
    /// The input shaper of X and Y, in place of the profile's, and of the compared plan too; it is
    /// made for --shaper-frequency, else for the profile's frequencies, else for the frame's. M593
    /// and SET_INPUT_SHAPER in the job change it as on the board.
    #[arg(long, value_name = "NAME", value_parser = input_shaper)]
    pub input_shaper: Option<InputShaperKind>,
    /// Damping ratio of the frame, 0 to 0.95.
    #[arg(long, value_name = "RATIO", default_value_t = 0.06)]
    pub damping: f64,
    /// Gives the frame a second mode at 1.7 times its frequencies, -12 dB.
    #[arg(long)]
    pub second_mode: bool,
    /// Time constant of the pressure in the nozzle, s: the pressure advance that would undo it.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.04)]
    pub nozzle_time_constant: f64,
    /// Another time constant, s, above a flow, mm^3/s: a nozzle with two slopes.
    #[arg(long, value_name = "SECONDS@FLOW")]
    pub nozzle_second_slope: Option<String>,
    /// The firmware by whose rules the job is planned [default: that of the profile's
    /// rules.planned_by].
    #[arg(long, value_name = "RULES", value_parser = rules())]
    pub rules: Option<PlannedBy>,
    /// Plans the same job by another firmware's rules too, and measures that plan on the same
    /// frame and nozzle.
    #[arg(long, value_name = "RULES", value_enum)]
    pub compare: Option<ComparedRules>,
    /// The compared plan's input shaper: none, zv, mzv, mzv(IMPULSES,PERIODS), zvd, zvdd, ei,
    /// 2hump_ei, 3hump_ei, or one of the last three with _old [default: that of
    /// --input-shaper, else mzv].
    #[arg(long, value_name = "NAME", requires = "compare")]
    pub shaper: Option<ShaperKind>,
    /// The frequencies that the shapers of --input-shaper and of the compared plan are made for, Hz
    /// [default: those of the frame].
    #[arg(long, value_name = "X,Y", value_parser = two_numbers, requires = "filtered")]
    pub shaper_frequency: Option<[f64; 2]>,
    /// The damping ratio that they are made for [default: the profile's for
    /// --input-shaper, else 0.1].
    #[arg(long, value_name = "RATIO", requires = "filtered")]
    pub shaper_damping: Option<f64>,
    /// The compared plan's pressure advance, s [default: the nozzle's time constant].
    #[arg(long, value_name = "SECONDS", value_parser = below_a_second, requires = "compare")]
    pub pressure_advance: Option<f64>,
    /// Time over which the compared plan smooths its pressure advance, s.
    #[arg(long, value_name = "SECONDS", value_parser = below_a_second, default_value_t = 0.04, requires = "compare")]
    pub smooth_time: f64,
    /// The compared plan's square corner velocity, mm/s [default: an imported profile's, else 5].
    #[arg(long, value_name = "MM_PER_S", requires = "compare")]
    pub square_corner_velocity: Option<f64>,
    /// The compared plan's minimum cruise ratio, 0 to less than 1 [default: an imported profile's,
    /// else 0.5].
    #[arg(long, value_name = "RATIO", requires = "compare")]
    pub minimum_cruise_ratio: Option<f64>,
    /// Prints the result as one JSON object.
    #[arg(long)]
    pub json: bool,
    /// Draws the path around the largest contour error, the error against time, and the ringing
    /// after the strongest stop.
    #[arg(long, value_name = "OUT.svg")]
    pub plot: Option<PathBuf>,
}

/// The kind of input shaper of this name.
fn input_shaper(name: &str) -> Result<InputShaperKind, String> {
    InputShaperKind::from_name(name).ok_or_else(|| {
        let names = InputShaperKind::NAMED.map(|(name, _)| name).join(", ");
        format!("expected {names}, or as mzv(5,0.9)")
    })
}

/// A time of less than a second.
fn below_a_second(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds| (0.0..1.0).contains(seconds));
    seconds.ok_or_else(|| "expected 0 to less than 1 s".to_owned())
}

/// Two numbers with a comma between them.
fn two_numbers(text: &str) -> Result<[f64; 2], String> {
    let numbers = text.split_once(',').and_then(|(x, y)| Some([x.trim().parse().ok()?, y.trim().parse().ok()?]));
    numbers.ok_or_else(|| "expected two numbers with a comma between them, as 50,40".to_owned())
}

/// Rules of other firmware to compare with.
#[derive(Clone, Copy, clap::ValueEnum)]
pub enum ComparedRules {
    /// Klipper's, as its documents have them.
    Klipper,
}
