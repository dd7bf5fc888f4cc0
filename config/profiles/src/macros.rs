//! Macros: names for lines of G-code.

use std::collections::BTreeMap;
use std::fmt::Write;

use ferrostep_checked_toml::Section;
use ferrostep_gcode::{CardCommand, Command, NotExecuted, Outcome, PrintClockCommand, parse};
use ferrostep_printer::MACRO_LINE;

/// Maximum number of bytes of all macros of a machine, which an image has in its flash.
const MAX_BYTES: usize = 4096;
/// Longest name of a macro or of a parameter, bytes.
const MAX_NAME: usize = 32;
/// Maximum number of macros that are within each other.
const MAX_DEPTH: usize = 8;
/// Maximum number of lines of a macro, with those of the macros that it calls.
const MAX_LINES: usize = 512;
/// Value of a parameter without a default when its line is read for a trial.
const TRIAL: &str = "1";
/// The keys that name macros at a change of the tool, and the values that they may have.
const KEYS_AT_CHANGE: [&str; 2] = ["tools.before_change", "tools.after_change"];
pub(crate) const A_MACRO: &str = "the name of a macro, as in [macro.NAME]";
/// Parameters that these macros are called with.
const WORDS_AT_CHANGE: [&str; 2] = ["FROM", "TO"];

/// A macro as written in the file.
struct Macro<'r> {
    section: Section<'r>,
    name: &'static str,
    /// Each with its line in the file.
    lines: Vec<(usize, String)>,
}

/// A macro with the lines of those that it calls.
#[derive(Clone, Default)]
struct Flat {
    /// Parameters in the order in which they appear, each with its default.
    parameters: Vec<(String, Option<String>)>,
    /// Place and text; parameters without their defaults.
    lines: Vec<(String, String)>,
}

impl Flat {
    /// Notes a parameter. `Err`: it has another default already.
    fn note(&mut self, key: &str, default: Option<&str>) -> Result<(), String> {
        let Some((_, known)) = self.parameters.iter_mut().find(|(known, _)| known == key) else {
            self.parameters.push((key.to_owned(), default.map(str::to_owned)));
            return Ok(());
        };
        match (&*known, default) {
            (Some(before), Some(default)) if before != default => {
                Err(format!("one default for {key}: an earlier line has {before}"))
            }
            (None, Some(default)) => {
                *known = Some(default.to_owned());
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// Value of a parameter when its line is read for a trial.
    fn trial(&self, key: &str) -> String {
        let known = self.parameters.iter().find(|(known, _)| known == key);
        known.and_then(|(_, default)| default.clone()).unwrap_or_else(|| TRIAL.to_owned())
    }
}

/// The macros in the form that the printer reads; empty if one is wrong, which is noted.
/// `at_change` are the names of those before and after a change of the tool.
pub(crate) fn macros(keys: &Section<'_>, at_change: [Option<&str>; 2]) -> String {
    let sections = keys.named_sections(
        "macro",
        "NAME",
        "no macros",
        "[commands](gcode.md#macros) that stand for lines of G-code",
        "a command of this name",
    );
    let macros: Vec<Macro<'_>> = sections
        .into_iter()
        .map(|(name, section)| {
            let about = "lines of G-code; `{KEY=60}` stands for a word of the call, or for 60 without it; `{KEY}` must be given";
            let lines = section.lines("gcode", "lines of G-code").required(about);
            Macro { section, name, lines }
        })
        .collect();
    let at_change = || KEYS_AT_CHANGE.into_iter().zip(at_change).filter_map(|(key, name)| Some((key, name?)));
    for (key, name) in at_change() {
        if !macros.iter().any(|one| one.name.eq_ignore_ascii_case(name)) {
            keys.refuse(key, A_MACRO);
        }
    }
    if macros.is_empty() {
        return String::new();
    }
    for one in &macros {
        check_name(keys, one);
    }
    let mut done = BTreeMap::new();
    let mut text = String::new();
    for one in &macros {
        let Some(mut flat) = flatten(one, &macros, &mut Vec::new(), &mut done) else { return String::new() };
        check_lines(one, &flat);
        for (key, _) in at_change().filter(|(_, name)| one.name.eq_ignore_ascii_case(name)) {
            check_at_change(keys, key, &mut flat);
        }
        let _ = write!(text, "#{}", one.name);
        for (key, default) in &flat.parameters {
            let _ = match default {
                Some(default) => write!(text, " {key}={default}"),
                None => write!(text, " {key}"),
            };
        }
        text.push('\n');
        for (place, line) in &flat.lines {
            let _ = writeln!(text, "{place} {line}");
        }
    }
    if text.len() > MAX_BYTES {
        keys.refuse(
            "macro",
            format!("at most {MAX_BYTES} bytes, with the lines of macros that others call; these are {}", text.len()),
        );
    }
    text
}

/// Returns true if a text is a valid name of a macro or of a parameter.
fn is_name(name: &str, least: usize) -> bool {
    let is_letter = |byte: u8| byte.is_ascii_uppercase() || byte == b'_';
    (least..=MAX_NAME).contains(&name.len())
        && name.bytes().take(least).all(is_letter)
        && name.bytes().all(|byte| is_letter(byte) || byte.is_ascii_digit())
}

/// A macro may take the place of a name that is known and not executed, such as START_PRINT,
/// but of no command.
fn check_name(keys: &Section<'_>, one: &Macro<'_>) {
    let shown = format!("macro.{}", one.name);
    if !is_name(one.name, 2) {
        let expected = format!("a name of 2 to {MAX_NAME} capitals, digits and _, which begins with two capitals or _");
        return keys.refuse(&shown, expected);
    }
    let is_free = match parse(one.name) {
        Ok(Command::Unknown(_)) => true,
        Ok(_) => {
            NotExecuted::find_named(one.name.as_bytes()).is_some_and(|(_, entry)| entry.outcome == Outcome::Accepted)
        }
        Err(_) => false,
    };
    if !is_free {
        keys.refuse(&shown, "another name: this one is a command of the firmware");
    }
}

/// The part of a line before its comment, trimmed.
fn without_comment(line: &str) -> &str {
    line.split(';').next().unwrap_or_default().trim()
}

/// The parts of a line: text, and in between `KEY` or `KEY=DEFAULT`. `None`: a brace
/// without its other half.
fn parts(line: &str) -> Option<(Vec<&str>, &str)> {
    let (mut parts, mut rest) = (Vec::new(), line);
    while let Some((before, after)) = rest.split_once('{') {
        let (inner, after) = after.split_once('}')?;
        if before.contains('}') || inner.contains('{') {
            return None;
        }
        parts.extend([before, inner]);
        rest = after;
    }
    (!rest.contains('}')).then_some((parts, rest))
}

/// A line with its parameters replaced. `put` says by what.
fn replaced(line: &str, mut put: impl FnMut(&str) -> String) -> String {
    let Some((parts, rest)) = parts(line) else { return line.to_owned() };
    let mut text = String::new();
    for pair in parts.chunks(2) {
        text.push_str(pair[0]);
        text.push_str(&put(pair[1]));
    }
    text + rest
}

/// A macro with the lines of those that it calls in their places. `None`: something is
/// wrong, and noted.
fn flatten<'m>(
    one: &'m Macro<'_>,
    all: &'m [Macro<'_>],
    path: &mut Vec<&'static str>,
    done: &mut BTreeMap<&'static str, Flat>,
) -> Option<Flat> {
    if let Some(flat) = done.get(one.name) {
        return Some(flat.clone());
    }
    path.push(one.name);
    let mut flat = Flat::default();
    for (number, (file_line, line)) in (1..).zip(&one.lines) {
        let line = without_comment(line);
        let refuse = |expected: String| {
            one.section.refuse_line("gcode", *file_line, line, expected);
            None::<Flat>
        };
        if line.is_empty() {
            continue;
        }
        if flat.lines.len() >= MAX_LINES {
            return refuse(format!("at most {MAX_LINES} lines, with those of the macros that it calls"));
        }
        if !line.is_ascii() || line.starts_with('#') {
            return refuse("G-code in ASCII".to_owned());
        }
        let Some((parts, _)) = parts(line) else { return refuse("a } for each {".to_owned()) };
        for inner in parts.iter().skip(1).step_by(2) {
            let (key, default) = inner.split_once('=').map_or((*inner, None), |(key, value)| (key, Some(value)));
            let is_value = |value: &str| !value.is_empty() && value.bytes().all(|byte| byte.is_ascii_graphic());
            if !is_name(key, 1) || default.is_some_and(|default| !is_value(default)) {
                return refuse("{KEY} or {KEY=DEFAULT}, the key in capitals and the default without blanks".to_owned());
            }
            if let Err(expected) = flat.note(key, default) {
                return refuse(expected);
            }
        }
        let plain = replaced(line, |inner| format!("{{{}}}", inner.split('=').next().unwrap_or_default()));
        let (called, words) = plain.split_once([' ', '\t']).unwrap_or((&plain, ""));
        let Some(callee) = all.iter().find(|other| other.name.eq_ignore_ascii_case(called)) else {
            flat.lines.push((number.to_string(), plain));
            continue;
        };
        if path.contains(&callee.name) {
            let chain = path.iter().chain([&callee.name]).copied().collect::<Vec<_>>().join(", ");
            return refuse(format!("no macro that calls itself: {chain}"));
        }
        if path.len() >= MAX_DEPTH {
            return refuse(format!("at most {MAX_DEPTH} levels of nested macros"));
        }
        let inner = flatten(callee, all, path, done)?;
        let mut given = BTreeMap::new();
        for word in words.split_ascii_whitespace() {
            let known = word.split_once('=').map(|(key, value)| (key.to_ascii_uppercase(), value));
            match known
                .filter(|(key, value)| !value.is_empty() && inner.parameters.iter().any(|(known, _)| known == key))
            {
                Some((key, value)) => given.insert(key, value.to_owned()),
                None => {
                    let names: Vec<&str> = inner.parameters.iter().map(|(key, _)| key.as_str()).collect();
                    let names = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
                    return refuse(format!("words that {} knows: {names}", callee.name));
                }
            };
        }
        for (key, default) in &inner.parameters {
            if !given.contains_key(key) {
                let Some(default) = default else { return refuse(format!("{key}=, which {} needs", callee.name)) };
                given.insert(key.clone(), default.clone());
            }
        }
        for (place, line) in &inner.lines {
            let place = if place.contains(':') { place.clone() } else { format!("{}:{place}", callee.name) };
            flat.lines.push((place, replaced(line, |key| given.get(key).cloned().unwrap_or_default())));
        }
    }
    path.pop();
    done.insert(one.name, flat.clone());
    Some(flat)
}

/// Checks a macro that a change of the tool calls with FROM and TO; it then has both as parameters.
fn check_at_change(keys: &Section<'_>, shown: &str, flat: &mut Flat) {
    for key in WORDS_AT_CHANGE {
        if !flat.parameters.iter().any(|(known, _)| known == key) {
            flat.parameters.push((key.to_owned(), Some("0".to_owned())));
        }
    }
    let is_given = |key: &str| WORDS_AT_CHANGE.contains(&key);
    if let Some((key, _)) = flat.parameters.iter().find(|(key, default)| default.is_none() && !is_given(key)) {
        keys.refuse(
            shown,
            format!("a macro that needs no words but FROM and TO: this one needs {key}=, give it a default"),
        );
    }
    let changes_tool = |line: &str| {
        let trial = replaced(line, |key| flat.trial(key));
        matches!(parse(&trial), Ok(Command::SelectTool { tool: Some(_), .. }))
    };
    if let Some((place, line)) = flat.lines.iter().find(|(_, line)| changes_tool(line)) {
        keys.refuse(shown, format!("a macro that does not change the tool itself: its line {place} is \"{line}\""));
    }
}

/// Reads each line for a trial, with the defaults. Lines of other macros have been read there; here
/// their words may be others.
fn check_lines(one: &Macro<'_>, flat: &Flat) {
    for (place, line) in &flat.lines {
        let trial = replaced(line, |key| flat.trial(key));
        let expected = match parse(&trial) {
            _ if trial.len() > MACRO_LINE => format!("at most {MACRO_LINE} characters"),
            Err(error) => format!("what can be executed: {error}"),
            Ok(command) => match refused(&command) {
                Some(expected) => expected.to_owned(),
                None => continue,
            },
        };
        // A line of another macro is found by its call.
        let number = place.parse().unwrap_or(0);
        let own = (1..).zip(&one.lines).find(|(at, _)| *at == number).map(|(_, (file_line, _))| *file_line);
        let first = one.lines.first().map_or(1, |(file_line, _)| *file_line);
        let text = if own.is_some() { trial } else { format!("{place}: {trial}") };
        one.section.refuse_line("gcode", own.unwrap_or(first), &text, expected);
    }
}

/// Reason to refuse a command in a macro: the words that follow "expected"; `None`
/// if it is allowed.
fn refused(command: &Command<'_>) -> Option<&'static str> {
    match command {
        Command::Unknown(_) => Some("a command, or the name of a macro"),
        // Its answer ends a line for the host.
        Command::ReportTemperatures => Some("no M105: a host asks for temperatures by itself"),
        Command::SetLineNumber(_) => Some("no M110: the lines of a macro have no numbers"),
        Command::ReceiveJob { .. } => Some("no M790: a job comes from a host"),
        Command::BlackBox { .. } => Some("no M791: a host asks for the black box"),
        Command::Card(CardCommand::ReportTime) => None,
        Command::Card(_) => Some("no command for the card: its print would go on within the macro"),
        Command::PrintClock(PrintClockCommand::Clear) => Some("no M78 S78: prints would be forgotten each time"),
        _ => None,
    }
}
