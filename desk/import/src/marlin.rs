//! Reads the form of Marlin's configuration: definitions in C headers, with conditions around some.

use std::path::Path;

use crate::c_tokens::is_of_name;
use crate::condition::holds;
use crate::definitions::Definitions;
use crate::error::ImportError;
use crate::includes::{Included, MAX_INCLUDES, beside};

/// The name of the second file of a configuration.
const SECOND_FILE: &str = "Configuration_adv.h";

/// Marks a line end that a backslash takes away.
const CONTINUED: char = '\u{1a}';

/// Returns true if a file is one of Marlin's configuration: a header, or a text with one of
/// its definitions.
pub fn is_one(name: &str, text: &str) -> bool {
    let is_header = Path::new(name).extension().is_some_and(|end| end.eq_ignore_ascii_case("h"));
    is_header
        || text.lines().any(|line| {
            let mut words = line.split_whitespace();
            words.next() == Some("#define") && words.next() == Some("DEFAULT_AXIS_STEPS_PER_UNIT")
        })
}

/// Reads a configuration, the files that it includes, and the second file beside it.
///
/// # Errors
/// A condition that is not closed, or a file that is not a machine's configuration.
pub fn parse(name: &str, text: &str, include: &mut dyn FnMut(&str) -> Included) -> Result<Definitions, ImportError> {
    let mut definitions = Definitions::default();
    if name.rsplit('/').next() == Some(SECOND_FILE) {
        let what =
            "this is the second file of a configuration: import Configuration.h, which reads it as well".to_owned();
        return Err(ImportError::Line(name.to_owned(), 1, what));
    }
    read(name, text, include, &mut definitions)?;
    if !definitions.files.iter().any(|file| file == SECOND_FILE) {
        for (name, text) in include(SECOND_FILE).unwrap_or_default() {
            read(&name, &crate::text::with_line_ends(&text), include, &mut definitions)?;
        }
    }
    Ok(definitions)
}

/// A condition around lines.
struct Condition {
    line: usize,
    /// True if the present branch is in force.
    holds: bool,
    /// True if an earlier branch was in force.
    has_held: bool,
}

fn read(
    file: &str,
    text: &str,
    include: &mut dyn FnMut(&str) -> Included,
    definitions: &mut Definitions,
) -> Result<(), ImportError> {
    let mut conditions: Vec<Condition> = Vec::new();
    definitions.files.push(file.to_owned());
    let mut next_line = 1;
    for content in without_comments(&with_continued_lines(text)).lines() {
        let line = next_line;
        next_line += 1 + content.matches(CONTINUED).count();
        let content = &*content.replace(CONTINUED, " ");
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
            "elif" | "else" => match conditions.last_mut() {
                Some(last) => {
                    last.holds = !last.has_held && (word == "else" || holds(rest, definitions));
                    last.has_held |= last.holds;
                }
                None => return Err(ImportError::Line(file.to_owned(), line, format!("this #{word} has no #if"))),
            },
            "endif" => {
                if conditions.pop().is_none() {
                    return Err(ImportError::Line(file.to_owned(), line, "this #endif has no #if".to_owned()));
                }
            }
            "define" if is_in_force => {
                let end = rest.find(|char| !is_of_name(char)).unwrap_or(rest.len());
                let (name, value) = rest.split_at(end);
                match value.strip_prefix('(').and_then(|value| value.split_once(')')) {
                    Some((parameters, body)) => {
                        let parameters = parameters.split(',').map(|name| name.trim().to_owned()).collect();
                        definitions.functions.insert(name.to_owned(), (parameters, body.trim().to_owned()));
                    }
                    None => definitions.add(file, line, name, value.trim()),
                }
            }
            "include" if is_in_force => {
                let name = rest.strip_prefix('"').and_then(|rest| rest.split('"').next());
                if let Some(name) = name {
                    follow(file, line, name, include, definitions)?;
                }
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

/// Reads an included file; one that says `#pragma once` is read once.
fn follow(
    file: &str,
    line: usize,
    name: &str,
    include: &mut dyn FnMut(&str) -> Included,
    definitions: &mut Definitions,
) -> Result<(), ImportError> {
    let name = &beside(file, name);
    let found = if definitions.files.len() < MAX_INCLUDES {
        include(name)
    } else {
        Err(format!("more than {MAX_INCLUDES} files are included: does one include itself?"))
    };
    match found {
        Ok(files) => {
            for (name, text) in files {
                let is_again = definitions.files.contains(&name) && text.contains("#pragma once");
                if !is_again {
                    read(&name, &crate::text::with_line_ends(&text), include, definitions)?;
                }
            }
        }
        Err(why) => definitions.missing.push((file.to_owned(), line, name.clone(), why)),
    }
    Ok(())
}

/// The text with a sign instead of each line end that has a backslash before it.
fn with_continued_lines(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for line in text.lines() {
        match line.trim_end().strip_suffix('\\') {
            Some(start) => {
                out.push_str(start);
                out.push(CONTINUED);
            }
            None => {
                out.push_str(line);
                out.push('\n');
            }
        }
    }
    out
}

/// Returns the end of the string that a text begins with.
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

/// The text with spaces where comments are, so that lines keep their numbers. A `//`
/// in a string stays.
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
        out.extend(passed.chars().filter(|char| ['\n', CONTINUED].contains(char)));
        rest = after;
    }
    out + rest
}
