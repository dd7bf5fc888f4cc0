//! The arguments of commands that execute or plan one job.

use std::path::PathBuf;

/// The plate of a sliced 3MF.
#[derive(clap::Args)]
pub struct PlateArgument {
    /// The plate of a sliced 3MF (.gcode.3mf) that holds several.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub plate: Option<u32>,
}

/// The treatment of macros that the profile lacks.
#[derive(clap::Args)]
pub struct MacroArgument {
    /// Gives macros that the profile lacks no effect, and refuses commands that only the desk
    /// executes, as a board does. Otherwise a macro at the beginning of the file is taken for the
    /// machine's start: homed and heated.
    #[arg(long)]
    pub strict_macros: bool,
}

/// Arguments that `print`, `preprocess` and `estimate` share.
#[derive(clap::Args)]
pub struct JobArguments {
    /// The job: G-code, as text or binary (.bgcode), plain or gzip, or a sliced 3MF; `print` also
    /// takes a prepared job; - is standard input.
    pub file: PathBuf,
    /// The plate of a 3MF.
    #[command(flatten)]
    pub plate: PlateArgument,
    /// The machine: cartesian, corexy, prusa-mini, or the path of a TOML file [default: cartesian,
    /// with the travel and limits in the slicer's comments].
    #[arg(long, value_name = "NAME|PATH")]
    pub profile: Option<String>,
    /// Prints the result as one JSON object.
    #[arg(long)]
    pub json: bool,
    /// Ends with exit status 1 if there are remarks: lines without effect, or executed
    /// differently from their text, moves before homing or outside the travel, pauses, too much
    /// flow, heaters left on.
    #[arg(long)]
    pub strict: bool,
}

/// The encodings of a prepared job.
#[derive(Clone, Copy, clap::ValueEnum)]
pub enum Format {
    /// About five bytes a move, with checksums.
    Compact,
    /// Packets of 84 bytes, as in Yu 2019; for comparison.
    Wide,
}
