//! `ferrostep import`.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use ferrostep::import::{self, ImportError, Imported, Row, is_untouched};
use ferrostep::input;
use ferrostep::output::{Accepted, Output, Protected};
use ferrostep::terminal::{name, one_line};

use crate::outcome::result;

/// The exit status where the built-in profile stands in for what the machine is.
const ASSUMED: u8 = 3;

/// Examples that the list has of a reason for which settings are not kept.
const EXAMPLES: usize = 3;

/// Arguments of the command.
pub struct Arguments<'a> {
    /// The configuration.
    pub file: &'a Path,
    /// The profile to write.
    pub out: Option<&'a Path>,
    /// Everything as JSON.
    pub json: bool,
    /// The list with every setting and value.
    pub all: bool,
    /// The built-in profile stands in for what the machine is.
    pub assume: bool,
}

/// Makes a profile, writes it, and lists what was kept.
///
/// # Errors
/// The file is no configuration or of a machine that profiles do not know, or the profile cannot be written.
pub fn run(arguments: &Arguments<'_>) -> Result<ExitCode, String> {
    let Arguments { file, out, json, .. } = *arguments;
    let imported = import::read(file, arguments.assume).map_err(|error| match error {
        ImportError::Unknown | ImportError::Profile(_) | ImportError::Identity(..) => {
            format!("{}: {error}", input::name(file))
        }
        // These name the file that they mean, which may be an included one.
        ImportError::Read(..) | ImportError::Line(..) | ImportError::Machine(..) => error.to_string(),
    })?;
    if let Some(path) = out {
        let protected = [Protected { path: file, what: "the configuration" }];
        let is_edited = std::fs::read_to_string(path).is_ok_and(|text| !text.is_empty() && !is_untouched(&text));
        if is_edited {
            return Err(format!(
                "{}: it is there and has been edited since an import wrote it, or is none: give another name with -o, or remove it",
                name(path)
            ));
        }
        let mut output = Output::create(path, Accepted::File, &protected).map_err(|error| error.to_string())?;
        output.write_all(imported.profile.as_bytes()).map_err(|error| output.failed(error).to_string())?;
        output.keep().map_err(|error| error.to_string())?;
    }
    let status = result(json.then_some(&imported), || text(arguments, &imported));
    Ok(if imported.by_permission.is_empty() { status } else { ExitCode::from(ASSUMED) })
}

/// The list, for people: what needs a look first.
fn text(arguments: &Arguments<'_>, imported: &Imported) -> String {
    let Arguments { file, out, all, .. } = *arguments;
    let mut text = String::new();
    let lines = |values: &[String]| values.iter().map(|value| format!("  {value}\n")).collect::<String>();
    if !imported.unread.is_empty() {
        text += &format!("not read, {} files; what they say is missing:\n", imported.unread.len());
        text += &lines(&imported.unread);
    }
    if !imported.by_permission.is_empty() {
        text += &format!("what the machine is, {} parts, assumed by --assume:\n", imported.by_permission.len());
        text += &lines(&imported.by_permission);
    }
    let refused: Vec<&Row> = imported.refused().collect();
    if !refused.is_empty() {
        text += &format!("refused, {} settings, and what stands there:\n", refused.len());
        for row in &refused {
            text += &format!("  {}:{}: {} = {}: {}\n", row.file, row.line, row.key, one_line(&row.value), row.why);
        }
    }
    text += &format!("assumed of homing and sensors, {} values; look at each:\n", imported.homing.len());
    text += &lines(&imported.homing);
    let sound = imported.rows.iter().filter(|row| !row.refused);
    let (kept, lost): (Vec<&Row>, Vec<&Row>) = sound.partition(|row| row.kept.is_some());
    text += &format!("kept, {} settings:\n", kept.len());
    for row in &kept {
        let why = if row.why.is_empty() { String::new() } else { format!(" ({})", row.why) };
        let place = row.kept.as_deref().unwrap_or_default();
        text += &format!("  {}:{}: {} = {} -> {place}{why}\n", row.file, row.line, row.key, one_line(&row.value));
    }
    text += &format!("not kept, {} settings{}:\n", lost.len(), if all { "" } else { ", by reason; each with --all" });
    text += &if all { each(&lost) } else { by_reason(&lost) };
    text += &format!(
        "not said there, {} values: {} are the built-in profile's, the others follow from settings or are the other firmware's own{}\n",
        imported.assumed.len(),
        imported.built_in.len(),
        if all { ":" } else { "; each with --all" }
    );
    if all {
        text += &lines(&imported.assumed);
    }
    text += &match out {
        Some(path) => format!(
            "{} was made of {}; try it: `ferrostep print FILE --profile {}`\n",
            name(path),
            name(file),
            name(path)
        ),
        None => "nothing was written: -o PROFILE.toml writes the profile\n".to_owned(),
    };
    let look = [imported.unread.len(), imported.by_permission.len(), refused.len(), imported.homing.len()];
    let [unread, assumed, refused, homing] = look;
    text + &format!(
        "{} need a look before the machine moves: {unread} files not read, {assumed} parts of the machine assumed, {refused} settings \
         refused, {homing} values of homing and sensors assumed\n",
        look.iter().sum::<usize>()
    )
}

fn each(rows: &[&Row]) -> String {
    let line =
        |row: &&Row| format!("  {}:{}: {} = {}: {}\n", row.file, row.line, row.key, one_line(&row.value), row.why);
    rows.iter().map(line).collect()
}

/// A line for each reason, with how many settings it is of and some of them; those of most settings last.
fn by_reason(rows: &[&Row]) -> String {
    let mut reasons: BTreeMap<&str, Vec<&Row>> = BTreeMap::new();
    for row in rows {
        reasons.entry(&row.why).or_default().push(row);
    }
    let mut reasons: Vec<_> = reasons.into_iter().collect();
    reasons.sort_by_key(|(_, rows)| rows.len());
    let line = |(why, rows): (&str, Vec<&Row>)| {
        let shown: Vec<&str> = rows.iter().take(EXAMPLES).map(|row| row.key.as_str()).collect();
        let more = if rows.len() > EXAMPLES { ", …" } else { "" };
        format!("  {}: {why}: {}{more}\n", rows.len(), shown.join(", "))
    };
    reasons.into_iter().map(line).collect()
}
