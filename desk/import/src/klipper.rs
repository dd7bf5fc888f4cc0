//! Reads the form of Klipper's files: sections, keys with `:` or `=`, values that continue in
//! indented lines, comments, includes.

use std::collections::HashMap;

use crate::error::ImportError;
use crate::includes::{Included, MAX_INCLUDES, beside};

/// A setting.
#[derive(Clone, Debug)]
pub struct Entry {
    /// The entry's file.
    pub file: String,
    /// The entry's line, from 1.
    pub line: usize,
    /// The entry's key, in lower case.
    pub key: String,
    /// The entry's value; lines after the first with a line end before each.
    pub value: String,
    /// The setting is in the part that SAVE_CONFIG has written, and holds only where no other
    /// line sets its key.
    pub is_saved: bool,
}

/// A section. One that occurs again continues, and a later value holds.
#[derive(Clone, Debug)]
pub struct Section {
    /// The section's name in brackets, without spaces around.
    pub name: String,
    /// The file of its first line.
    pub file: String,
    /// The section's first line.
    pub line: usize,
    /// The section's settings.
    pub entries: Vec<Entry>,
    /// The setting of each key that holds, by its place.
    holding: HashMap<String, usize>,
}

impl Section {
    /// The setting of a key that holds: the last one; one that SAVE_CONFIG has written only if
    /// there is no other.
    pub fn entry(&self, key: &str) -> Option<&Entry> {
        crate::effort::count();
        self.entries.get(*self.holding.get(key)?)
    }

    fn push(&mut self, entry: Entry) {
        let has_other = self.entry(&entry.key).is_some_and(|before| !before.is_saved);
        if !(entry.is_saved && has_other) {
            self.holding.insert(entry.key.clone(), self.entries.len());
        }
        self.entries.push(entry);
    }
}

/// A configuration.
#[derive(Clone, Debug, Default)]
pub struct Config {
    /// The configuration's sections, in their order.
    pub sections: Vec<Section>,
    /// Includes that were not found: file, line, name, why.
    pub missing: Vec<(String, usize, String, String)>,
    includes: usize,
    places: HashMap<String, usize>,
}

impl Config {
    /// The section of a name.
    pub fn section(&self, name: &str) -> Option<&Section> {
        crate::effort::count();
        self.sections.get(*self.places.get(name)?)
    }
}

/// Reads a file and those that it includes.
///
/// # Errors
/// A line that does not belong in a configuration.
pub fn parse(name: &str, text: &str, include: &mut dyn FnMut(&str) -> Included) -> Result<Config, ImportError> {
    let mut config = Config::default();
    read(name, text, saved_from(text), include, &mut config)?;
    Ok(config)
}

/// The line at which SAVE_CONFIG's part begins, in comments of a special form. Klipper reads it in
/// the main file only, and only if it contains no other line.
fn saved_from(text: &str) -> usize {
    const NONE: usize = usize::MAX;
    let Some(header) = text.lines().position(|line| line.starts_with("#*# <---") && line.contains(" SAVE_CONFIG "))
    else {
        return NONE;
    };
    let part: Vec<&str> = text.lines().skip(header + 1).collect();
    let end = part.iter().rposition(|line| !line.trim().is_empty()).map_or(0, |last| last + 1);
    let is_saved = |line: &&str| line.starts_with("#*# ") || line.trim_end() == "#*#";
    if part.iter().take(end).all(is_saved) { header } else { NONE }
}

fn read(
    name: &str,
    text: &str,
    saved_from: usize,
    include: &mut dyn FnMut(&str) -> Included,
    config: &mut Config,
) -> Result<(), ImportError> {
    let mut section: Option<usize> = None;
    let mut last: Option<(usize, usize)> = None;
    for (index, raw) in text.lines().enumerate() {
        let line = index + 1;
        let is_saved = index > saved_from;
        let raw = match raw.strip_prefix("#*# ").filter(|_| is_saved) {
            Some(saved) if saved.contains('=') || saved.starts_with(['[', ' ', '\t']) => saved,
            _ => raw,
        };
        let content = without_comment(raw);
        if content.trim().is_empty() {
            continue;
        }
        if content.starts_with([' ', '\t']) {
            if let Some((section, entry)) = last
                && let Some(entry) = config.sections.get_mut(section).and_then(|section| section.entries.get_mut(entry))
            {
                entry.value.push('\n');
                entry.value.push_str(content.trim());
            }
            continue;
        }
        let content = content.trim();
        if let Some(header) = content.strip_prefix('[') {
            let Some((header, _)) = header.rsplit_once(']') else {
                return Err(ImportError::Line(name.to_owned(), line, "a section without ]: close it".to_owned()));
            };
            let header = header.trim();
            last = None;
            if let Some(file) = header.strip_prefix("include ") {
                follow(name, line, file.trim(), include, config)?;
                section = None;
                continue;
            }
            let known = config.places.get(header).copied();
            section = Some(known.unwrap_or_else(|| {
                let (name, file) = (header.to_owned(), name.to_owned());
                config.places.insert(name.clone(), config.sections.len());
                config.sections.push(Section { name, file, line, entries: Vec::new(), holding: HashMap::new() });
                config.sections.len() - 1
            }));
            continue;
        }
        let Some((key, value)) = content.find([':', '=']).map(|at| (&content[..at], &content[at + 1..])) else {
            let what = format!(
                "{:?} is neither a section nor a setting of Klipper's, expected KEY: VALUE; lines that go on are indented",
                crate::text::shown(content)
            );
            return Err(ImportError::Line(name.to_owned(), line, what));
        };
        let Some(index) = section else {
            let what = "a setting before the first section, expected [SECTION]".to_owned();
            return Err(ImportError::Line(name.to_owned(), line, what));
        };
        if let Some(section) = config.sections.get_mut(index) {
            let key = key.trim().to_ascii_lowercase();
            section.push(Entry { file: name.to_owned(), line, key, value: value.trim().to_owned(), is_saved });
            last = Some((index, section.entries.len() - 1));
        }
    }
    Ok(())
}

fn follow(
    name: &str,
    line: usize,
    file: &str,
    include: &mut dyn FnMut(&str) -> Included,
    config: &mut Config,
) -> Result<(), ImportError> {
    let file = &beside(name, file);
    let found = if config.includes < MAX_INCLUDES {
        include(file)
    } else {
        Err(format!("more than {MAX_INCLUDES} files are included: does one include itself?"))
    };
    match found {
        Ok(files) => {
            for (file, text) in files {
                config.includes += 1;
                read(&file, &crate::text::with_line_ends(&text), usize::MAX, include, config)?;
            }
        }
        Err(why) => config.missing.push((name.to_owned(), line, file.to_owned(), why)),
    }
    Ok(())
}

/// A line without its comment: from any `#` on, or from a `;` at its beginning or after a space.
fn without_comment(line: &str) -> &str {
    let is_comment = |(at, byte): (usize, u8)| match byte {
        b'#' => true,
        b';' => at == 0 || line.as_bytes().get(at - 1).is_some_and(u8::is_ascii_whitespace),
        _ => false,
    };
    let end = line.bytes().enumerate().find(|place| is_comment(*place)).map_or(line.len(), |(at, _)| at);
    line.get(..end).unwrap_or(line)
}
