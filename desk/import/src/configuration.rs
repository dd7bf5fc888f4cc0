//! Makes a profile of a configuration, whichever firmware's it is.

use std::path::{Path, PathBuf};

use ferrostep_host::printable::{self, name_of_input};

use crate::definitions::Definitions;
use crate::error::ImportError;
use crate::imported::Imported;
use crate::includes::Included;
use crate::{glob, klipper, klipper_map, marlin, marlin_map, marlin_report, text};

/// Makes a profile of a file, and of those that it includes; `assume` allows the built-in profile's
/// values for the machine's identity.
///
/// # Errors
/// See [`ImportError`]; nothing is made then.
pub fn read(path: &Path, assume: bool) -> Result<Imported, ImportError> {
    let name = name_of(path);
    let text = text::of_file(path).map_err(|error| ImportError::Read(name_of_input(path), error))?;
    let folder = path.parent().map_or_else(PathBuf::new, Path::to_path_buf);
    let imported = of_text_with(&name, &text, &mut |include| files(&folder, include), assume)?;
    Ok(imported)
}

/// Makes a profile of a running Marlin's answers to M115 and M503. A file of its configuration
/// gives the settings that the printer does not report; the printer's numbers hold.
///
/// # Errors
/// The printer is not Marlin or does not report its settings; or as [`read`].
pub fn of_running_marlin(
    name: &str,
    about: &[String],
    settings: &[String],
    file: Option<&Path>,
    assume: bool,
) -> Result<Imported, ImportError> {
    let mut definitions = match file {
        Some(path) => definitions_of(path)?,
        None => Definitions::of_running(marlin_report::running(about)),
    };
    let added = marlin_report::add(about, settings, &mut definitions);
    added.map_err(|error| ImportError::Read(name.to_owned(), error))?;
    marlin_map::map(&definitions, assume)
}

/// The definitions of a file of Marlin's, and of those that it includes.
fn definitions_of(path: &Path) -> Result<Definitions, ImportError> {
    let (name, folder) = (name_of(path), path.parent().map_or_else(PathBuf::new, Path::to_path_buf));
    let text = text::of_file(path).map_err(|error| ImportError::Read(name_of_input(path), error))?;
    let text = text::with_line_ends(&text);
    if !marlin::is_one(&name, &text) {
        let what = "beside a running Marlin, its Configuration.h is expected".to_owned();
        return Err(ImportError::Read(name_of_input(path), what));
    }
    marlin::parse(&name, text.trim_start_matches('\u{feff}'), &mut |include| files(&folder, include))
}

/// The name of a file in rows and messages.
fn name_of(path: &Path) -> String {
    path.file_name().map_or_else(|| name_of_input(path), |name| printable::name(Path::new(name)))
}

/// Reads a text as [`read`] does, with nothing assumed; `include` returns the files of a name,
/// relative to the text's, which may match several.
///
/// # Errors
/// As [`read`].
pub fn of_text(name: &str, text: &str, include: &mut dyn FnMut(&str) -> Included) -> Result<Imported, ImportError> {
    of_text_with(name, text, include, false)
}

/// Reads a text as [`of_text`] does; `assume` allows it to assume what the machine is where the
/// text does not say it.
///
/// # Errors
/// As [`read`].
pub fn of_text_with(
    name: &str,
    text: &str,
    include: &mut dyn FnMut(&str) -> Included,
    assume: bool,
) -> Result<Imported, ImportError> {
    let text = text::with_line_ends(text);
    if marlin::is_one(name, &text) {
        let text = text.trim_start_matches('\u{feff}');
        return marlin_map::map(&marlin::parse(name, text, include)?, assume);
    }
    if text.starts_with('\u{feff}') {
        let what =
            "the file begins with a byte order mark, which Klipper refuses as well: save it as UTF-8 without one";
        return Err(ImportError::Line(name.to_owned(), 1, what.to_owned()));
    }
    let config = klipper::parse(name, &text, include)?;
    if config.section("printer").is_none() {
        return Err(ImportError::Unknown);
    }
    klipper_map::map(&config, assume)
}

/// The files of a name, relative to the folder of the configuration; it may match several.
fn files(folder: &Path, include: &str) -> Included {
    if !glob::is_pattern(include) {
        return Ok(vec![(include.to_owned(), text::of_file(&folder.join(include))?)]);
    }
    let names = glob::matching(folder, include);
    names.into_iter().map(|name| Ok((name.clone(), text::of_file(&folder.join(&name))?))).collect()
}
