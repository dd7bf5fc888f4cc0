//! `ferrostep import`.

use std::collections::BTreeMap;
use std::fmt;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use ferrostep_host::printable::{name, one_line};
use ferrostep_host::printer_line::{Address, PrinterLine};
use ferrostep_host::send::{self, Patience};
use ferrostep_import::{ApiKey, ImportError, Imported, Row, Url, is_untouched, place};
use ferrostep_session::input;
use ferrostep_session::output::{Accepted, Output, Protected};

use crate::outcome::result;

/// Exit status if the built-in profile's values are used for the machine's identity.
const ASSUMED: u8 = 3;

/// Examples that the list has of a reason for which settings are not kept.
const EXAMPLES: usize = 3;

/// Source of a configuration.
pub enum Source {
    /// A file.
    File(PathBuf),
    /// A running Klipper, and the key that its server wants.
    Moonraker(Url, Option<ApiKey>),
    /// A running Marlin at a port with a speed, and a file of its configuration.
    Marlin(Address, u32, Option<PathBuf>),
}

impl Source {
    /// The source that arguments name.
    ///
    /// # Errors
    /// The arguments name no source.
    pub fn of(
        file: Option<PathBuf>,
        moonraker: Option<Url>,
        key: Option<ApiKey>,
        marlin: Option<Address>,
        baud: u32,
    ) -> Result<Self, String> {
        match (file, moonraker, marlin) {
            (file, None, Some(address)) => Ok(Self::Marlin(address, baud, file)),
            (None, Some(url), None) => Ok(Self::Moonraker(url, key)),
            (Some(file), None, None) => Ok(Self::File(file)),
            _ => Err("expected a file, --moonraker or --marlin".to_owned()),
        }
    }

    fn file(&self) -> Option<&Path> {
        match self {
            Self::File(file) | Self::Marlin(_, _, Some(file)) => Some(file),
            Self::Moonraker(..) | Self::Marlin(_, _, None) => None,
        }
    }

    fn import(&self, assume: bool) -> Result<Imported, String> {
        match self {
            Self::File(file) => ferrostep_import::read(file, assume).map_err(|error| self.named(&error)),
            Self::Moonraker(url, key) => {
                let imported = ferrostep_import::read_moonraker(url, key.as_ref(), assume);
                imported.map_err(|error| self.named(&error))
            }
            Self::Marlin(address, baud, file) => {
                let mut line = PrinterLine::open(address, *baud).map_err(|error| format!("{address}: {error}"))?;
                let answers = send::ask(&mut line, Patience::DEFAULT, &["M115", "M503"]);
                let answers = answers.map_err(|error| format!("{address}: {error}"))?;
                let [about, settings] = answers.as_slice() else { return Err(format!("{address}: no answers")) };
                let imported =
                    ferrostep_import::of_running_marlin(&address.to_string(), about, settings, file.as_deref(), assume);
                imported.map_err(|error| self.named(&error))
            }
        }
    }

    /// An error with the source's name, where it does not name a file, which may be
    /// an included one.
    fn named(&self, error: &ImportError) -> String {
        match error {
            ImportError::Identity(..) if matches!(self, Self::Marlin(_, _, None)) => {
                format!("{self}: {error}; or give the printer's Configuration.h before --marlin, which says them")
            }
            ImportError::Unknown | ImportError::Profile(_) | ImportError::Identity(..) => format!("{self}: {error}"),
            ImportError::Read(..) | ImportError::Line(..) | ImportError::Machine(..) => error.to_string(),
        }
    }
}

impl fmt::Display for Source {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(file) => out.write_str(&input::name(file)),
            Self::Moonraker(url, _) => url.fmt(out),
            Self::Marlin(address, _, None) => address.fmt(out),
            Self::Marlin(address, _, Some(file)) => write!(out, "{} and {address}", input::name(file)),
        }
    }
}

/// Arguments of the command.
pub struct Arguments<'a> {
    /// The configuration.
    pub source: Source,
    /// The profile to write.
    pub out: Option<&'a Path>,
    /// Everything as JSON.
    pub json: bool,
    /// The list with every setting and value.
    pub all: bool,
    /// Allows the built-in profile's values for the machine's identity.
    pub assume: bool,
}

/// Makes a profile, writes it, and lists the kept settings.
///
/// # Errors
/// The file is not a configuration or is that of a machine that profiles do not know, a printer
/// does not answer, or the profile cannot be written.
pub fn run(arguments: &Arguments<'_>) -> Result<ExitCode, String> {
    let Arguments { ref source, out, json, .. } = *arguments;
    let imported = source.import(arguments.assume)?;
    if let Some(path) = out {
        let protected: Vec<Protected<'_>> =
            source.file().into_iter().map(|path| Protected { path, what: "the configuration" }).collect();
        let is_edited = std::fs::read_to_string(path).is_ok_and(|text| !text.is_empty() && !is_untouched(&text));
        if is_edited {
            return Err(format!(
                "{}: it exists, and was edited or not written by an import: give another name with -o, or remove it",
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
    let Arguments { ref source, out, all, .. } = *arguments;
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
        text += &format!("refused, {} settings, with their values:\n", refused.len());
        for row in &refused {
            text += &format!("  {}: {} = {}: {}\n", place(&row.file, row.line), row.key, one_line(&row.value), row.why);
        }
    }
    text += &format!("assumed of homing and sensors, {} values; look at each:\n", imported.homing.len());
    text += &lines(&imported.homing);
    let sound = imported.rows.iter().filter(|row| !row.refused);
    let (kept, lost): (Vec<&Row>, Vec<&Row>) = sound.partition(|row| row.kept.is_some());
    text += &format!("kept, {} settings:\n", kept.len());
    for row in &kept {
        let why = if row.why.is_empty() { String::new() } else { format!(" ({})", row.why) };
        let kept = row.kept.as_deref().unwrap_or_default();
        text += &format!("  {}: {} = {} -> {kept}{why}\n", place(&row.file, row.line), row.key, one_line(&row.value));
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
        Some(path) => {
            format!("{} was made of {source}; try it: `ferrostep print FILE --profile {}`\n", name(path), name(path))
        }
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
        |row: &&Row| format!("  {}: {} = {}: {}\n", place(&row.file, row.line), row.key, one_line(&row.value), row.why);
    rows.iter().map(line).collect()
}

/// A line for each reason, with how many settings it is of and some of them; those of
/// most settings last.
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
