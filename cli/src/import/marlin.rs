//! Reads the form of Marlin's configuration: definitions in C headers, with conditions around some.

use std::collections::HashMap;

use super::ImportError;
use super::condition::holds;

/// A definition that is in force.
#[derive(Clone, Debug)]
pub struct Definition {
    /// Its file.
    pub file: String,
    /// Its line, from 1.
    pub line: usize,
    /// Its name.
    pub name: String,
    /// Its value; empty for a switch.
    pub value: String,
}

/// All definitions in force, in their order.
#[derive(Clone, Debug, Default)]
pub struct Definitions {
    /// The definitions.
    pub all: Vec<Definition>,
    /// Values by name.
    pub values: HashMap<String, String>,
}

impl Definitions {
    fn add(&mut self, file: &str, line: usize, name: &str, value: &str) {
        let (name, value) = (name.to_owned(), value.to_owned());
        self.values.insert(name.clone(), value.clone());
        self.all.push(Definition { file: file.to_owned(), line, name, value });
    }

    /// The definition of a name that holds.
    pub fn get(&self, name: &str) -> Option<&Definition> {
        self.all.iter().rev().find(|definition| definition.name == name)
    }
}

/// Whether a text is Marlin's configuration.
pub fn is_one(text: &str) -> bool {
    text.contains("DEFAULT_AXIS_STEPS_PER_UNIT") && text.contains("#define")
}

/// Reads a configuration, and then the files beside it.
///
/// # Errors
/// A condition that is not closed.
pub fn parse(name: &str, text: &str, beside: &[(String, String)]) -> Result<Definitions, ImportError> {
    let mut definitions = Definitions::default();
    read(name, text, &mut definitions)?;
    for (name, text) in beside {
        read(name, text, &mut definitions)?;
    }
    Ok(definitions)
}

/// A condition around lines.
struct Condition {
    line: usize,
    /// Whether the present branch is in force.
    holds: bool,
    /// Whether a branch before was.
    has_held: bool,
}

fn read(file: &str, text: &str, definitions: &mut Definitions) -> Result<(), ImportError> {
    let mut conditions: Vec<Condition> = Vec::new();
    for (index, content) in without_comments(text).lines().enumerate() {
        let line = index + 1;
        let is_in_force = conditions.iter().all(|condition| condition.holds);
        let Some(directive) = content.trim().strip_prefix('#') else {
            if let Some((name, value)) = constant(content).filter(|_| is_in_force) {
                definitions.add(file, line, name, value);
            }
            continue;
        };
        let directive = directive.trim_start();
        let (word, rest) = directive.split_once(char::is_whitespace).unwrap_or((directive, ""));
        let rest = rest.trim();
        match word {
            "if" | "ifdef" | "ifndef" => {
                let holds = match word {
                    "ifdef" => definitions.values.contains_key(rest),
                    "ifndef" => !definitions.values.contains_key(rest),
                    _ => holds(rest, definitions),
                };
                conditions.push(Condition { line, holds, has_held: holds });
            }
            "elif" | "else" => {
                if let Some(last) = conditions.last_mut() {
                    last.holds = !last.has_held && (word == "else" || holds(rest, definitions));
                    last.has_held |= last.holds;
                }
            }
            "endif" => {
                conditions.pop();
            }
            "define" if is_in_force => {
                let (name, value) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
                definitions.add(file, line, name, value.trim());
            }
            "undef" if is_in_force => {
                definitions.values.remove(rest);
                definitions.all.retain(|definition| definition.name != rest);
            }
            _ => {}
        }
    }
    match conditions.last() {
        Some(open) => Err(ImportError::Line(file.to_owned(), open.line, "this #if has no #endif".to_owned())),
        None => Ok(()),
    }
}

/// Where a string ends that a text begins with.
fn string_end(text: &str) -> Option<usize> {
    let mut is_escaped = false;
    for (at, byte) in text.bytes().enumerate().skip(1) {
        if byte == b'"' && !is_escaped {
            return Some(at + 1);
        }
        is_escaped = byte == b'\\' && !is_escaped;
    }
    None
}

/// A setting of Marlin 1: `const bool X_MIN_ENDSTOP_INVERTING = false;`
fn constant(line: &str) -> Option<(&str, &str)> {
    let (declared, value) = line.trim().strip_prefix("const ")?.split_once('=')?;
    let (_, name) = declared.trim().rsplit_once(char::is_whitespace)?;
    Some((name, value.trim().trim_end_matches(';').trim_end()))
}

/// The text with spaces where comments are, so that lines keep their numbers. A `//` in a string stays.
fn without_comments(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find(['/', '"']) {
        let (before, comment) = rest.split_at(at);
        out.push_str(before);
        if comment.starts_with('"') {
            let line = comment.find('\n').unwrap_or(comment.len());
            let end = string_end(comment).filter(|end| *end <= line).unwrap_or(1);
            let (string, after) = comment.split_at(end);
            out.push_str(string);
            rest = after;
            continue;
        }
        let length = if comment.starts_with("//") {
            comment.find('\n').unwrap_or(comment.len())
        } else if comment.starts_with("/*") {
            comment.find("*/").map_or(comment.len(), |end| end + 2)
        } else {
            out.push('/');
            1
        };
        let (passed, after) = comment.split_at(length);
        out.extend(passed.chars().filter(|char| *char == '\n'));
        rest = after;
    }
    out + rest
}
