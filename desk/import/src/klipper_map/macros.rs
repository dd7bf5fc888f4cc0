//! Klipper's macros: those of plain lines become the profile's.

use ferrostep_gcode::{Command, parse};

use super::Reading;

/// Maximum number of bytes of all macros that are taken; a profile has room for somewhat more.
const MAX_BYTES: usize = 3500;

const KIND: &str = "gcode_macro ";

impl Reading<'_> {
    /// The macros whose lines are plain G-code, with parameters that have a default or none. Of
    /// others the reason says what they call.
    pub(super) fn macros(&mut self) {
        let mut bytes = 0;
        let names: Vec<&str> = self.config.sections.iter().map(|section| section.name.as_str()).collect();
        for section in names.into_iter().filter(|name| name.starts_with(KIND)) {
            let Some(entry) = self.entry(section, "gcode") else { continue };
            let name = section.trim_start_matches(KIND).trim().to_ascii_uppercase();
            let is_renamed = self.entry(section, "rename_existing").is_some();
            let is_free = matches!(parse(&name), Ok(Command::Unknown(_)))
                || ferrostep_gcode::NotExecuted::find_named(name.as_bytes()).is_some();
            let lines = plain_lines(&entry.value).filter(|_| !is_renamed && is_free && is_name(&name));
            match lines {
                Some(lines) if bytes + lines.len() <= MAX_BYTES => {
                    bytes += lines.len();
                    self.keep(section, "gcode", &[&format!("macro.{name}.gcode")], lines, "");
                }
                Some(_) => self.lose(
                    section,
                    "gcode",
                    "the profile's macros are full: write it by hand, or into the slicer's code",
                ),
                None => {
                    let calls = commands(&entry.value).join(", ");
                    let why = format!(
                        "Klipper's macros are programs: write plain G-code as a macro of the profile, or into the slicer's start and end \
                         code. A file that calls {name} expects what is in it: {calls}"
                    );
                    self.lose(section, "gcode", &why);
                }
            }
        }
    }
}

fn is_name(name: &str) -> bool {
    let mut bytes = name.bytes();
    let is_letter = |byte: u8| byte.is_ascii_uppercase() || byte == b'_';
    (2..=32).contains(&name.len())
        && bytes.by_ref().take(2).all(is_letter)
        && bytes.all(|byte| is_letter(byte) || byte.is_ascii_digit())
}

/// The lines as a profile's macro has them; `None` if one is a program's, or no
/// command that is known.
fn plain_lines(text: &str) -> Option<String> {
    let mut lines = String::from("\n");
    for line in
        text.lines().map(|line| line.split(';').next().unwrap_or_default().trim()).filter(|line| !line.is_empty())
    {
        let (line, trial) = with_parameters(line)?;
        let is_known = parse(&trial).is_ok_and(|command| !matches!(command, Command::Unknown(_)));
        if !is_known || !line.is_ascii() {
            return None;
        }
        lines.push_str(&line);
        lines.push('\n');
    }
    (lines.len() > 1).then_some(lines)
}

/// A line with `{params.BED|default(60)|int}` as `{BED=60}`, and the same with the
/// defaults for a trial.
fn with_parameters(line: &str) -> Option<(String, String)> {
    let (mut out, mut trial, mut rest) = (String::new(), String::new(), line);
    while let Some((before, after)) = rest.split_once('{') {
        let (inner, after) = after.split_once('}')?;
        let mut filters = inner.split('|').map(str::trim);
        let key = filters.next()?.strip_prefix("params.")?.to_ascii_uppercase();
        let is_key = !key.is_empty() && key.bytes().all(|byte| byte.is_ascii_uppercase() || byte == b'_');
        let mut default = None;
        for filter in filters {
            match filter.strip_prefix("default(").and_then(|value| value.strip_suffix(')')) {
                Some(value) => default = Some(value.trim().trim_matches(['"', '\'']).to_owned()),
                None if ["int", "float"].contains(&filter) => {}
                None => return None,
            }
        }
        if !is_key
            || default.as_deref().is_some_and(|value| value.is_empty() || !value.bytes().all(|b| b.is_ascii_graphic()))
        {
            return None;
        }
        let shown = default.as_ref().map_or(key.clone(), |value| format!("{key}={value}"));
        out.push_str(&format!("{before}{{{shown}}}"));
        trial.push_str(&format!("{before}{}", default.as_deref().unwrap_or("1")));
        rest = after;
    }
    if rest.contains('}') {
        return None;
    }
    Some((out + rest, trial + rest))
}

/// The commands that a macro's lines begin with, each once.
fn commands(text: &str) -> Vec<&str> {
    const MOST: usize = 12;
    let mut found: Vec<&str> = Vec::new();
    for word in text.lines().filter_map(|line| line.split_whitespace().next()) {
        let is_command = word.starts_with(|first: char| first.is_ascii_alphabetic())
            && word.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_' || byte == b'.');
        if is_command && !found.contains(&word) && found.len() < MOST {
            found.push(word);
        }
    }
    found
}
