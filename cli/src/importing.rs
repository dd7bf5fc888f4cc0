//! `ferrostep import`.

use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use ferrostep::import::{self, ImportError, Imported, Row};
use ferrostep::input;
use ferrostep::output::{Accepted, Output, Protected};
use ferrostep::terminal::{name, one_line};

use crate::outcome::result;

/// Makes a profile, writes it, and lists what was kept.
///
/// # Errors
/// The file is no configuration or of a machine that profiles do not know, or the profile cannot be written.
pub fn run(file: &Path, out: Option<&Path>, json: bool) -> Result<ExitCode, String> {
    let imported = import::read(file, false).map_err(|error| match error {
        ImportError::Unknown | ImportError::Profile(_) | ImportError::Identity(..) => format!("{}: {error}", input::name(file)),
        // These name the file that they mean, which may be an included one.
        ImportError::Read(..) | ImportError::Line(..) | ImportError::Machine(..) => error.to_string(),
    })?;
    if let Some(path) = out {
        let protected = [Protected { path: file, what: "the configuration" }];
        let mut output = Output::create(path, Accepted::File, &protected).map_err(|error| error.to_string())?;
        output.write_all(imported.profile.as_bytes()).map_err(|error| output.failed(error).to_string())?;
        output.keep().map_err(|error| error.to_string())?;
    }
    Ok(result(json.then_some(&imported), || text(file, out, &imported)))
}

/// The list, for people.
fn text(file: &Path, out: Option<&Path>, imported: &Imported) -> String {
    let (kept, lost): (Vec<&Row>, Vec<&Row>) = imported.rows.iter().partition(|row| row.kept.is_some());
    let mut text = format!("kept, {} settings:\n", kept.len());
    for row in &kept {
        let why = if row.why.is_empty() { String::new() } else { format!(" ({})", row.why) };
        let place = row.kept.as_deref().unwrap_or_default();
        text += &format!("  {}:{}: {} = {} -> {place}{why}\n", row.file, row.line, row.key, one_line(&row.value));
    }
    text += &format!("not kept, {} settings:\n", lost.len());
    for row in &lost {
        text += &format!("  {}:{}: {} = {}: {}\n", row.file, row.line, row.key, one_line(&row.value), row.why);
    }
    text += &format!("not said there, {} values; look at each:\n", imported.assumed.len());
    for value in &imported.assumed {
        text += &format!("  {value}\n");
    }
    let next = match out {
        Some(path) => format!(
            "{} was made of {}; try it: `ferrostep print FILE --profile {}`\n",
            name(path),
            name(file),
            name(path)
        ),
        None => "nothing was written: -o PROFILE.toml writes the profile\n".to_owned(),
    };
    text + &next
}
