//! Reads the form of Klipper's files: sections, keys with `:` or `=`, values that go on in indented lines, comments, includes.

use super::{ImportError, Included, MAX_INCLUDES};

/// A setting.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Its file.
    pub file: String,
    /// Its line, from 1.
    pub line: usize,
    /// Its key, in lower case.
    pub key: String,
    /// Its value; lines after the first with a line end before each.
    pub value: String,
}

/// A section. One that occurs again goes on, and a later value holds.
#[derive(Clone, Debug)]
pub struct Section {
    /// Its name in brackets, without spaces around.
    pub name: String,
    /// The file of its first line.
    pub file: String,
    /// Its first line.
    pub line: usize,
    /// Its settings.
    pub entries: Vec<Entry>,
}

/// A configuration.
#[derive(Clone, Debug, Default)]
pub struct Config {
    /// Its sections, in their order.
    pub sections: Vec<Section>,
    /// Includes that were not found: file, line, name, why.
    pub missing: Vec<(String, usize, String, String)>,
    includes: usize,
}

impl Config {
    /// The section of a name.
    pub fn section(&self, name: &str) -> Option<&Section> {
        self.sections.iter().find(|section| section.name == name)
    }
}

/// Reads a file and those that it includes.
///
/// # Errors
/// A line that is none of a configuration.
pub fn parse(name: &str, text: &str, include: &mut dyn FnMut(&str) -> Included) -> Result<Config, ImportError> {
    let mut config = Config::default();
    read(name, text, include, &mut config)?;
    Ok(config)
}

fn read(
    name: &str,
    text: &str,
    include: &mut dyn FnMut(&str) -> Included,
    config: &mut Config,
) -> Result<(), ImportError> {
    let mut section: Option<usize> = None;
    let mut last: Option<(usize, usize)> = None;
    for (index, raw) in text.lines().enumerate() {
        let line = index + 1;
        // SAVE_CONFIG's part stands in comments of this form, and holds.
        let raw = match raw.strip_prefix("#*# ") {
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
            let Some((header, _)) = header.split_once(']') else {
                return Err(ImportError::Line(name.to_owned(), line, "a section without ]: close it".to_owned()));
            };
            let header = header.trim();
            last = None;
            if let Some(file) = header.strip_prefix("include ") {
                follow(name, line, file.trim(), include, config)?;
                section = None;
                continue;
            }
            let known = config.sections.iter().position(|section| section.name == header);
            section = Some(known.unwrap_or_else(|| {
                let file = name.to_owned();
                config.sections.push(Section { name: header.to_owned(), file, line, entries: Vec::new() });
                config.sections.len() - 1
            }));
            continue;
        }
        let Some((key, value)) = content.find([':', '=']).map(|at| (&content[..at], &content[at + 1..])) else {
            let what = format!("{:?} is neither a section nor a setting, expected KEY: VALUE", super::shown(content));
            return Err(ImportError::Line(name.to_owned(), line, what));
        };
        let Some(index) = section else {
            let what = "a setting before the first section, expected [SECTION]".to_owned();
            return Err(ImportError::Line(name.to_owned(), line, what));
        };
        if let Some(section) = config.sections.get_mut(index) {
            let key = key.trim().to_ascii_lowercase();
            section.entries.push(Entry { file: name.to_owned(), line, key, value: value.trim().to_owned() });
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
    let found = if config.includes < MAX_INCLUDES { include(file) } else { Err("too many includes".to_owned()) };
    match found {
        Ok(files) => {
            for (file, text) in files {
                config.includes += 1;
                read(&file, &text, include, config)?;
            }
        }
        Err(why) => config.missing.push((name.to_owned(), line, file.to_owned(), why)),
    }
    Ok(())
}

/// A line without its comment: from `#` on wherever it stands, from `;` at its beginning or after a space.
fn without_comment(line: &str) -> &str {
    let is_comment = |(at, byte): (usize, u8)| match byte {
        b'#' => true,
        b';' => at == 0 || line.as_bytes().get(at - 1).is_some_and(u8::is_ascii_whitespace),
        _ => false,
    };
    let end = line.bytes().enumerate().find(|place| is_comment(*place)).map_or(line.len(), |(at, _)| at);
    line.get(..end).unwrap_or(line)
}
