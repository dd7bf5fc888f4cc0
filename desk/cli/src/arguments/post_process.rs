//! The arguments of `post-process`.

use std::path::PathBuf;

use ferrostep_profiles::PlannedBy;

use super::values::rules;

/// Arguments of `post-process`.
#[derive(clap::Args)]
pub struct PostProcessArguments {
    /// The G-code, as text or binary. It is replaced when all of the new file is on the disk;
    /// slicers give it as the last argument.
    pub file: PathBuf,
    /// Writes the new text here, and leaves FILE as it is.
    #[arg(short, long, value_name = "OUT")]
    pub out: Option<PathBuf>,
    /// The machine: cartesian, corexy, prusa-mini, or the path of a TOML file [default: cartesian,
    /// with the travel and limits in the slicer's comments].
    #[arg(long, value_name = "NAME|PATH")]
    pub profile: Option<String>,
    /// The firmware by whose rules the file is planned [default: that of the profile's
    /// rules.planned_by].
    #[arg(long, value_name = "RULES", value_parser = rules())]
    pub rules: Option<PlannedBy>,
    /// Adds no M73. Without this, one for each minute is added to a file that has none; those of a
    /// slicer are always corrected.
    #[arg(long)]
    pub no_m73: bool,
    /// Adds this comment at the end of a file that has it nowhere: a host knows by it which files
    /// were corrected.
    #[arg(long, value_name = "TEXT", value_parser = mark)]
    pub mark: Option<String>,
    /// Prints the result as one JSON object.
    #[arg(long)]
    pub json: bool,
}

/// Reads the text of a comment.
fn mark(text: &str) -> Result<String, String> {
    let is_plain = !text.trim().is_empty() && !text.chars().any(char::is_control);
    is_plain.then(|| text.to_owned()).ok_or_else(|| "expected a line of text".to_owned())
}
