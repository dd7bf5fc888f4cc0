//! Reads the form of Marlin's configuration: definitions in C headers, with conditions around some.

use std::collections::HashMap;

use super::ImportError;

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
        let Some(directive) = content.trim().strip_prefix('#') else { continue };
        let directive = directive.trim_start();
        let (word, rest) = directive.split_once(char::is_whitespace).unwrap_or((directive, ""));
        let rest = rest.trim();
        let is_in_force = conditions.iter().all(|condition| condition.holds);
        match word {
            "if" | "ifdef" | "ifndef" => {
                let holds = match word {
                    "ifdef" => definitions.values.contains_key(rest),
                    "ifndef" => !definitions.values.contains_key(rest),
                    _ => condition(rest, definitions),
                };
                conditions.push(Condition { line, holds, has_held: holds });
            }
            "elif" | "else" => {
                if let Some(last) = conditions.last_mut() {
                    last.holds = !last.has_held && (word == "else" || condition(rest, definitions));
                    last.has_held |= last.holds;
                }
            }
            "endif" => {
                conditions.pop();
            }
            "define" if is_in_force => {
                let (name, value) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
                let (name, value) = (name.to_owned(), value.trim().to_owned());
                definitions.values.insert(name.clone(), value.clone());
                definitions.all.push(Definition { file: file.to_owned(), line, name, value });
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

/// The text with spaces where comments are, so that lines keep their numbers.
fn without_comments(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find('/') {
        let (before, comment) = rest.split_at(at);
        out.push_str(before);
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

/// Whether a condition holds: ENABLED(X), ANY(X, Y), `!`, `&&` and `||` are known. What is unknown holds, so that nothing is lost.
fn condition(text: &str, definitions: &Definitions) -> bool {
    text.split("||").any(|all| all.split("&&").all(|part| simple(part.trim(), definitions)))
}

fn simple(text: &str, definitions: &Definitions) -> bool {
    if let Some(inner) = text.strip_prefix('!') {
        return !simple(inner.trim(), definitions);
    }
    let Some((function, names)) = text.split_once('(').and_then(|(f, rest)| Some((f.trim(), rest.strip_suffix(')')?)))
    else {
        return text != "0";
    };
    let mut names = names.split(',').map(|name| definitions.values.contains_key(name.trim()));
    match function {
        "ENABLED" | "defined" | "ALL" | "BOTH" => names.all(|is_defined| is_defined),
        "ANY" | "EITHER" => names.any(|is_defined| is_defined),
        "DISABLED" | "NONE" => names.all(|is_defined| !is_defined),
        _ => true,
    }
}
