//! The arguments of `show`, `compare` and `sweep`.

use std::path::PathBuf;

use ferrostep_analysis::sweep::Values;
use ferrostep_profiles::PlannedBy;

use super::job::{MacroArgument, PlateArgument};
use super::values::{key_and_value, key_and_values, rules};

/// Arguments of `show`.
#[derive(clap::Args)]
pub struct ShowArguments {
    /// The job: G-code, as text or binary (.bgcode), plain or gzip, or a sliced 3MF, or a prepared
    /// job; - is standard input.
    pub file: PathBuf,
    /// The plate of a 3MF.
    #[command(flatten)]
    pub plate: PlateArgument,
    /// The macros that the profile lacks.
    #[command(flatten)]
    pub macros: MacroArgument,
    /// The page to write [default: the file's name with .html, in this folder].
    #[arg(short, value_name = "PAGE.html")]
    pub out: Option<PathBuf>,
    /// The machine: cartesian, corexy, prusa-mini, or the path of a TOML file [default: cartesian,
    /// with the travel and limits in the slicer's comments].
    #[arg(long, value_name = "NAME|PATH")]
    pub profile: Option<String>,
    /// The firmware by whose rules the file is planned [default: that of the profile's
    /// rules.planned_by].
    #[arg(long, value_name = "RULES", value_parser = rules())]
    pub rules: Option<PlannedBy>,
    /// Does not open the page.
    #[arg(long)]
    pub no_open: bool,
    /// Ends with exit status 1 if there are remarks, as `estimate --strict` does.
    #[arg(long)]
    pub strict: bool,
}

/// Arguments of `compare`.
#[derive(clap::Args)]
pub struct CompareArguments {
    /// The first job, A: G-code, as text or binary (.bgcode), plain or gzip, or a sliced 3MF.
    #[arg(value_name = "A")]
    pub file: PathBuf,
    /// The second job, B [default: the first, with another profile or --set].
    #[arg(value_name = "B")]
    pub second: Option<PathBuf>,
    /// The plate of a 3MF.
    #[command(flatten)]
    pub plate: PlateArgument,
    /// The macros that the profile lacks.
    #[command(flatten)]
    pub macros: MacroArgument,
    /// Writes a page with both prints.
    #[arg(short, value_name = "PAGE.html")]
    pub out: Option<PathBuf>,
    /// The machine of both: cartesian, corexy, prusa-mini, or the path of a TOML file [default:
    /// cartesian, with the travel and limits in the slicer's comments].
    #[arg(long, value_name = "NAME|PATH")]
    pub profile: Option<String>,
    /// The machine of A.
    #[arg(long, value_name = "NAME|PATH")]
    pub profile_a: Option<String>,
    /// The machine of B.
    #[arg(long, value_name = "NAME|PATH")]
    pub profile_b: Option<String>,
    /// The firmware by whose rules both are planned [default: that of each profile's
    /// rules.planned_by].
    #[arg(long, value_name = "RULES", value_parser = rules())]
    pub rules: Option<PlannedBy>,
    /// Gives a key of B's profile this value: junction_deviation_mm=0.02. The jobs' own commands
    /// that would hold over it are left out of both. Can be repeated.
    #[arg(long, value_name = "KEY=VALUE", value_parser = key_and_value)]
    pub set: Vec<(String, f64)>,
    /// Frequency of the frame in X, 1 to 1000 Hz: measures the contour error, too
    /// [default: that of Y].
    #[arg(long, value_name = "HZ")]
    pub frequency_x: Option<f64>,
    /// Frequency of the frame in Y [default: that of X].
    #[arg(long, value_name = "HZ")]
    pub frequency_y: Option<f64>,
    /// Prints the result as one JSON object.
    #[arg(long)]
    pub json: bool,
    /// Does not open the page.
    #[arg(long)]
    pub no_open: bool,
}

/// Arguments of `sweep`.
#[derive(clap::Args)]
#[command(group = clap::ArgGroup::new("changed").args(["acceleration", "error_budget", "set"]).required(true))]
pub struct SweepArguments {
    /// The job: G-code, as text or binary (.bgcode), plain or gzip, or a sliced 3MF.
    pub file: PathBuf,
    /// The plate of a 3MF.
    #[command(flatten)]
    pub plate: PlateArgument,
    /// The macros that the profile lacks.
    #[command(flatten)]
    pub macros: MacroArgument,
    /// The machine: cartesian, corexy, prusa-mini, or the path of a TOML file [default:
    /// cartesian, with the travel and limits in the slicer's comments].
    #[arg(long, value_name = "NAME|PATH")]
    pub profile: Option<String>,
    /// Accelerations of printing and travel moves, and the most that X and Y may have, mm/s^2: a
    /// range, each value twice the one before (500..16000), or a list (500,1000,3000).
    #[arg(long, value_name = "VALUES")]
    pub acceleration: Option<Values>,
    /// Error budgets, mm, from which the accelerations of X and Y follow: a range or
    /// a list, as above.
    #[arg(long, value_name = "VALUES")]
    pub error_budget: Option<Values>,
    /// Any other key of the profile that is a number, with its values:
    /// junction_deviation_mm=0.005..0.08. Given more than once, the keys change together.
    #[arg(long, value_name = "KEY=VALUES", value_parser = key_and_values)]
    pub set: Vec<(String, Values)>,
    /// Simulates the error with each value, too: on the profile's frame as it was measured, and as
    /// soft and as stiff as it may be.
    #[arg(long)]
    pub simulate: bool,
    /// The firmware by whose rules the file is planned [default: that of the profile's
    /// rules.planned_by].
    #[arg(long, value_name = "RULES", value_parser = rules())]
    pub rules: Option<PlannedBy>,
    /// Prints the result as one JSON object.
    #[arg(long)]
    pub json: bool,
    /// Draws the time over the values.
    #[arg(long, value_name = "OUT.svg")]
    pub plot: Option<PathBuf>,
}
