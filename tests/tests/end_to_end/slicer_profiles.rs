//! The commands of PrusaSlicer's and Cura's printer profiles: the outcome of each, in a file
//! and from a host.
//!
//! `tests/data/slicer-commands.py` tells their sources. Their outcomes are in
//! `tests/data/slicer-profiles.md`, and set by set in `tests/data/slicer-outcomes.tsv`; both are
//! compared here, and `FERROSTEP_REFRESH=1` writes them anew.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;

use ferrostep_checked_toml::book;
use ferrostep_gcode::{NOT_EXECUTED, NotExecuted, Outcome};
use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;
use ferrostep_session::job::JobError;

use crate::end_to_end::command::repository;
use crate::end_to_end::desk::{profile, rehearse};
use crate::end_to_end::hosts::{Conversation, machine};
use crate::end_to_end::papers::REFRESH_VARIABLE;

const COMMANDS: &str = include_str!("../../data/slicer-commands.tsv");
const OUTCOMES: &str = "tests/data/slicer-outcomes.tsv";
const PAGE: &str = "tests/data/slicer-profiles.md";

/// Machines whose profiles hold the same commands.
struct Set {
    machines: usize,
    /// Slicer and name of the first profile.
    first: &'static str,
    commands: Vec<&'static str>,
}

fn sets() -> impl Iterator<Item = Set> {
    COMMANDS.lines().map(|line| {
        let [machines, first, commands] = line.split('\t').collect::<Vec<_>>().try_into().unwrap();
        Set { machines: machines.parse().unwrap(), first, commands: commands.split(" | ").collect() }
    })
}

/// Outcome of a line, by the printer's answer.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Fate {
    /// The line is executed without a remark.
    Done,
    /// A remark names the words that are ignored or have no effect.
    Remarked(String),
    /// The line is unknown; a remark gives its meaning, if that is known.
    Unknown(String),
    /// The line is refused, which ends the job of a file.
    Refused(String),
}

impl Fate {
    fn word(&self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::Remarked(_) => "said",
            Self::Unknown(_) => "unknown",
            Self::Refused(_) => "refused",
        }
    }

    fn says(&self) -> &str {
        match self {
            Self::Done => "",
            Self::Remarked(says) | Self::Unknown(says) | Self::Refused(says) => says,
        }
    }
}

/// Commands that wait for a person, who answers at once in these tests.
const PAUSES: [&str; 7] = ["M0", "M1", "M125", "M226", "M600", "M601", "PAUSE"];

/// Sends each command once, as a host does, to a printer that has just been switched on.
fn fates() -> BTreeMap<&'static str, Fate> {
    let profile = profile("cartesian");
    let commands: BTreeSet<_> = sets().flat_map(|set| set.commands).collect();
    commands
        .into_iter()
        .map(|command| {
            let machine = machine(&profile);
            let pauses = PAUSES.contains(&code_of(command).as_str());
            let replies = Conversation::new(&machine).say_while(format!("{command}\n").as_bytes(), |machine| {
                if pauses {
                    machine.signals().end_wait();
                }
            });
            let (last, before) = replies.split_last().unwrap();
            assert!(last == "ok" || last.starts_with("ok T:"), "{command}: {replies:?}");
            assert!(!before.iter().any(|reply| reply.starts_with("ok")), "{command}: {replies:?}");
            let echoes: Vec<_> = before.iter().filter_map(|reply| reply.strip_prefix("echo:")).collect();
            let is_unknown = echoes.iter().any(|echo| echo.starts_with("Unknown command"));
            let lines = echoes.iter().filter_map(|echo| Some(echo.strip_prefix("line ")?.split_once(": ")?.1));
            let said: Vec<_> = lines
                .map(|line| match line.strip_suffix(" (said once a job)") {
                    Some(remark) => Ok(remark.split_once("\": ").unwrap().1),
                    None => Err(line),
                })
                .collect();
            let fate = match said[..] {
                [Err(refusal)] => Fate::Refused(refusal.to_owned()),
                [] if is_unknown => Fate::Unknown(String::new()),
                [Ok(remark)] if is_unknown => Fate::Unknown(remark.to_owned()),
                [] => Fate::Done,
                [Ok(remark)] => Fate::Remarked(remark.to_owned()),
                _ => panic!("{command}: {replies:?}"),
            };
            (command, fate)
        })
        .collect()
}

/// Runs a set as a file.
fn as_a_file(set: &Set) -> Result<(), (String, String)> {
    // Starts at home, whatever moves come first in alphabetical order.
    let text = format!("G28\n{}", set.commands.join("\n"));
    match rehearse(&profile("cartesian"), LOOK_AHEAD_BLOCKS, &mut text.as_bytes()).outcome {
        Ok(()) => Ok(()),
        Err(JobError::Line { text, message, .. }) => Err((text, message)),
        Err(error) => panic!("{}: {error}", set.first),
    }
}

/// Outcomes set by set, and the book's table.
#[derive(Default)]
struct Tables {
    outcomes: String,
    machines: usize,
    stopped: BTreeMap<(String, String), (usize, &'static str)>,
}

fn tables(fates: &BTreeMap<&str, Fate>) -> Tables {
    let mut tables = Tables::default();
    for set in sets() {
        let stop = as_a_file(&set);
        let refused = set.commands.iter().find(|&&command| matches!(fates[command], Fate::Refused(_)));
        assert_eq!(stop.is_err(), refused.is_some(), "{}: a file stops where a host is refused: {stop:?}", set.first);
        tables.machines += set.machines;
        let outcome = match stop {
            Ok(()) => "runs through".to_owned(),
            Err((command, message)) => {
                let stops = format!("stops at {command}: {message}");
                let first = tables.stopped.entry((command, message)).or_insert((0, set.first));
                first.0 += set.machines;
                stops
            }
        };
        writeln!(tables.outcomes, "set\t{}\t{}\t{outcome}", set.machines, set.first).unwrap();
    }
    for (command, fate) in fates {
        let machines: usize = sets().filter(|set| set.commands.contains(command)).map(|set| set.machines).sum();
        writeln!(tables.outcomes, "command\t{machines}\t{command}\t{}\t{}", fate.word(), fate.says()).unwrap();
    }
    tables
}

/// The effect of a command in the firmware that it is for, for commands that no table of
/// Ferrostep's has.
const MACROS: [(&str, &str); 4] = [
    ("T?", "select the extruder that the person chooses (Prusa's multi-material unit)"),
    ("Tc", "load filament to the nozzle (Prusa's multi-material unit)"),
    ("Tx", "load filament to the extruder's gears (Prusa's multi-material unit)"),
    ("T-1", "put the tool away (tool changers)"),
];

/// The code at the start of a line, `M900`, or its first word.
fn code_of(command: &str) -> String {
    let digits = |at: usize| command.bytes().skip(at).take_while(u8::is_ascii_digit).count();
    if command.starts_with(['G', 'M']) && digits(1) > 0 {
        return command[..=digits(1)].to_owned();
    }
    command.split(' ').next().unwrap_or_default().to_owned()
}

/// The firmware's entry of [`code_of`].
fn entry_of(code: &str) -> Option<&'static NotExecuted> {
    if let Some((_, entry)) = NotExecuted::find_named(code.as_bytes()) {
        return Some(entry);
    }
    let (letter, number) = code.split_at_checked(1)?;
    NotExecuted::find(letter.as_bytes()[0], number.parse().ok()?).map(|(_, entry)| entry)
}

/// The book's table of commands without effect, with their meaning.
fn without_effect(fates: &BTreeMap<&str, Fate>) -> String {
    let mut codes: BTreeMap<String, (BTreeSet<&str>, &Fate)> = BTreeMap::new();
    for (command, fate) in fates {
        let not_executed = match fate {
            Fate::Unknown(_) | Fate::Refused(_) => true,
            Fate::Remarked(says) => says.starts_with("not executed"),
            Fate::Done => false,
        };
        if not_executed {
            codes.entry(code_of(command)).or_insert((BTreeSet::new(), fate)).0.insert(command);
        }
    }
    let mut rows: Vec<_> = codes
        .into_iter()
        .map(|(code, (commands, fate))| {
            let is_in = |set: &Set| set.commands.iter().any(|command| commands.contains(command));
            let machines: usize = sets().filter(is_in).map(|set| set.machines).sum();
            let entry = entry_of(&code);
            let own = MACROS.iter().find(|(name, _)| *name == code).map(|(_, meaning)| *meaning);
            let meaning = own.or(entry.map(|entry| entry.meaning)).unwrap_or("a macro or command of another firmware");
            let here = match (fate, entry) {
                (Fate::Refused(says), _) => format!("**refused**: {says}"),
                (Fate::Unknown(_), Some(entry)) => format!("unknown: {}", entry.why),
                (Fate::Unknown(_), None) => "unknown".to_owned(),
                (_, Some(entry)) => format!("no effect: {}", entry.why),
                (_, None) => "no effect".to_owned(),
            };
            // Names of macros are not names of code.
            let code = if code.contains('_') { code.replace('_', "\\_") } else { format!("`{code}`") };
            (machines, format!("| {machines} | {code} | {meaning} | {here} |"))
        })
        .collect();
    rows.sort_by(|(a, a_row), (b, b_row)| b.cmp(a).then(a_row.cmp(b_row)));
    let rows: Vec<_> = rows.into_iter().map(|(_, row)| row).collect();
    format!("| machines | command | would have done | here |\n|---|---|---|---|\n{}\n", rows.join("\n"))
}

fn stops(tables: &Tables) -> String {
    let stopped: usize = tables.stopped.values().map(|(machines, _)| machines).sum();
    let (whole, through) = (tables.machines, tables.machines - stopped);
    let mut text = format!(
        "Of {whole} machines, {through} run through ({} %). The others stop, with these words:\n\n\
         | machines | such as | stops at | because |\n|---|---|---|---|\n",
        through * 100 / whole
    );
    let mut stops: Vec<_> = tables.stopped.iter().collect();
    stops.sort_by_key(|((command, _), (machines, _))| (usize::MAX - machines, command.clone()));
    for ((command, message), (machines, first)) in stops {
        writeln!(text, "| {machines} | {first} | `{command}` | {message} |").unwrap();
    }
    text
}

/// All sets: only jobs for several extruders stop, and every command has an answer.
#[test]
fn slicers_default_commands_run_through() {
    let fates = fates();
    let tables = tables(&fates);
    for ((command, message), (machines, first)) in &tables.stopped {
        assert!(command.starts_with('T'), "{machines} machines, such as {first}, stop at {command}: {message}");
    }
    for (command, fate) in &fates {
        if let Fate::Refused(says) = fate {
            assert!(tables.stopped.keys().any(|(stop, _)| stop == command), "{command}: {says}");
        }
    }
    let page = repository().join(PAGE);
    book::keep(&page, "stops", &stops(&tables)).unwrap();
    book::keep(&page, "without effect", &without_effect(&fates)).unwrap();
    let kept = repository().join(OUTCOMES);
    if std::env::var_os(REFRESH_VARIABLE).is_some() {
        fs::write(kept, tables.outcomes).unwrap();
    } else {
        let same = fs::read_to_string(kept).unwrap() == tables.outcomes;
        assert!(same, "{OUTCOMES} is not current: look at the difference, then set {REFRESH_VARIABLE}=1 to keep it");
    }
}

/// The table of all commands that are not executed.
#[test]
fn the_table_of_commands_without_effect() {
    let mut text = "| command | would do | here | because |\n|---|---|---|---|\n".to_owned();
    for entry in NOT_EXECUTED {
        let here = match entry.outcome {
            Outcome::Accepted => "no effect",
            Outcome::Unknown => "unknown",
            Outcome::Refused => "refused",
        };
        let name = entry.name.replace('_', "\\_").replace('*', "\\*");
        writeln!(text, "| {name} | {} | {here} | {} |", entry.meaning, entry.why).unwrap();
    }
    book::keep(&repository().join("tests/data/not-executed.md"), "not executed", &text).unwrap();
}

/// Every command of the parser that is executed has its row in the book, and every row is executed.
#[test]
fn the_books_table_of_commands_has_them_all() {
    use ferrostep_gcode::{Command, Remarks, parse_with_remarks};

    let page = fs::read_to_string(repository().join("docs/src/gcode.md")).unwrap();
    let (_, commands) = page.split_once("\n## Commands\n").unwrap();
    let (commands, _) = commands.split_once("\n## Commands that are not executed\n").unwrap();
    let mut listed = BTreeSet::new();
    for row in commands.lines().filter(|line| line.starts_with("| ")).skip(1) {
        let first = row.split('|').nth(1).unwrap();
        let mut before = None;
        for word in first.split([' ', ',']).filter(|word| !word.is_empty()) {
            let code = word.strip_prefix(['G', 'M']).and_then(|number| number.parse::<u16>().ok());
            match (code, before) {
                (Some(last), Some((first, "to"))) => {
                    listed.extend((first..=last).map(|number| format!("{}{number}", &word[..1])))
                }
                (Some(_), _) => _ = listed.insert(word.to_owned()),
                (None, _) => {}
            }
            before = Some((code.unwrap_or(before.map_or(0, |(number, _)| number)), word));
        }
    }
    let mut executed = BTreeSet::new();
    for (letter, number) in ["G", "M"].iter().flat_map(|letter| (0..2000).map(move |number| (letter, number))) {
        let code = format!("{letter}{number}");
        let mut remarks = Remarks::NONE;
        match parse_with_remarks(&code, &mut remarks) {
            Ok(Command::Unknown(_)) => {}
            Ok(Command::Accepted) if NotExecuted::find(letter.as_bytes()[0], number).is_some() => {}
            Err(error) if error.to_string().contains("not supported") => {}
            _ => _ = executed.insert(code),
        }
    }
    let missing: Vec<_> = executed.difference(&listed).collect();
    let surplus: Vec<_> = listed.difference(&executed).collect();
    assert!(missing.is_empty() && surplus.is_empty(), "without a row: {missing:?}; rows of no command: {surplus:?}");
}
