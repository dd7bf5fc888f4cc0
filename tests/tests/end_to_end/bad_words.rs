//! Every command that takes words, with one of them missing, malformed or out of its range: the
//! printer names it, and a refused line changes nothing.

use ferrostep_planner::StepDigests;
use ferrostep_printer::Profile;
use ferrostep_session::Session;
use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;

use crate::end_to_end::desk::profile;
use crate::end_to_end::refusals::Collector;

/// Commands with valid words.
const COMMANDS: [&str; 34] = [
    "G0 X40 Y50 Z4 F2400",
    "G1 X40 Y50 Z4 E1 F2400",
    "G2 X40 Y30 Z3 E1 I10 J0 F1200",
    "G3 X40 Y30 R12",
    "G4 P5 S0",
    "G92 X1 Y2 Z3 E4",
    "M18 S60",
    "M84 S60",
    "M86 S60",
    "M104 S150 T0",
    "M109 S0 R0",
    "M140 S50",
    "M190 S0 R0",
    "M106 S100 P0",
    "M107 P0",
    "M113 S5",
    "M155 S5",
    "M201 X500 Y500 Z50 E500",
    "M203 X50 Y50 Z5 E20",
    "M204 P500 R500 T500 S500",
    "M205 J0.05 X5 Y5 Z0.3 E2",
    "M207 S2 F1800 Z0.3",
    "M208 S0.1 F600",
    "M211 S0",
    "M220 S80",
    "M221 S90",
    "M290 Z0.05 S0.05 P0",
    "M302 S160 P1",
    "M593 X Y F45 D0.15",
    "M593 F45 S0.15",
    "M600 X40 Y50 Z4 U20 L20",
    "M601 X40 Y50 Z4",
    "M795 S1 H0.2 W0.4 D1.75",
    "M796 I1 A1",
];

/// The same for a machine with drivers and a probe.
const WITH_DRIVERS: [&str; 6] =
    ["M569 S1 X", "M851 X-29 Y-3 Z-1", "M906 X300 Y300 Z300 E300", "M913 X100 Y100", "M914 X100 Y100", "M290 Z0.05 P1"];

/// Texts that are not numbers.
const MALFORMED: [&str; 6] = ["-", ".", "1.2.3", "--1", "nan", "99999999999"];

/// Numbers that are out of the range of most words.
const EXTREME: [&str; 7] = ["-1", "-0.001", "0", "0.5", "256", "70000", "999999999"];

const BEFORE: [&str; 6] = ["M302 P1", "G28", "G1 X10 Y20 Z3 F3000", "G1 X20 Y30 E2", "M207 S1 F1200", "M106 S80"];

/// Lines that show the state: moves at all kinds of limits, and every query.
const AFTER: [&str; 23] = [
    "M114",
    "M105",
    "M220",
    "M221",
    "M86",
    "M113",
    "M302",
    "M211",
    "M290",
    "M593",
    "M795",
    "M796",
    "G1 X40 E3",
    "G1 X45 Y60 Z3.5 E4",
    "G10",
    "G0 X10 Y10",
    "G11",
    "G1 E5",
    "G2 X20 Y20 I5 J5 E6",
    "G1 X250 Y1 F60000",
    "M114",
    "G4 S3",
    "M105",
];

/// A machine's steps and replies after some lines.
#[derive(Debug, PartialEq)]
struct Done {
    digests: StepDigests,
    motion_time_s: f64,
    logical_10nm: [i64; 4],
    said: Vec<String>,
}

/// Executes [`BEFORE`], a line and [`AFTER`]. Returns also the answer to the line, and
/// whether it was refused.
fn execute(profile: &Profile, line: Option<&str>) -> (Done, Vec<String>, bool) {
    let session = Session::print(*profile, LOOK_AHEAD_BLOCKS, (), Collector::default());
    let mut printer = session.printer();
    let mut run = |number: u32, text: &str| {
        let refused = session.run(printer.execute(number, text)).is_err();
        let said = session.replies().take();
        assert_eq!(said.iter().filter(|reply| reply.starts_with("ok")).count(), 1, "{text}: {said:?}");
        (said, refused)
    };
    let mut said = Vec::new();
    BEFORE.iter().for_each(|text| said.extend(run(1, text).0));
    let (of_line, refused) = line.map_or((Vec::new(), false), |text| run(2, text));
    AFTER.iter().for_each(|text| said.extend(run(3, text).0));
    session.run(printer.finish()).unwrap();
    let logical_10nm = printer.logical_10nm();
    let figures = session.figures();
    let done = Done { digests: figures.digests, motion_time_s: figures.motion_time_s, logical_10nm, said };
    (done, of_line, refused)
}

/// The command with another number in one of its words.
fn with(command: &str, word: usize, number: &str) -> String {
    let words = command.split(' ').enumerate().map(|(at, own)| match at == word {
        true => format!("{}{number}", &own[..1]),
        false => own.to_owned(),
    });
    words.collect::<Vec<_>>().join(" ")
}

/// Returns true if an answer names the word, or its meaning.
fn names(said: &[String], letter: char) -> bool {
    // An arc that does not fit is one of its centre or radius with its end; a dwell counts as P,
    // in milliseconds.
    let others = ["the target is too far", "I, J: the arc", "R: an arc", "R: the arc", "P: 999999999000"];
    let is_named = |text: &str| text.contains(letter) || others.iter().any(|other| text.contains(other));
    said.iter().any(|text| text.starts_with("echo:") && is_named(text))
}

/// Tries each number in each word of a command. Returns the failures.
fn faults(profile: &Profile, unharmed: &Done, command: &str) -> Vec<String> {
    let mut faults = Vec::new();
    for (at, word) in command.split(' ').enumerate().skip(1) {
        let letter = word.chars().next().unwrap();
        // In M569 and M593 axes are flags.
        let is_flag = ["M569", "M593"].iter().any(|code| command.starts_with(code)) && matches!(letter, 'X' | 'Y');
        let malformed = MALFORMED.iter().map(|number| (number, true));
        for (number, is_malformed) in malformed.chain(EXTREME.iter().chain(&[""]).map(|number| (number, false))) {
            let line = with(command, at, number);
            let (done, said, refused) = execute(profile, Some(&line));
            if is_malformed && !refused {
                faults.push(format!("{line} is taken: {said:?}"));
            }
            if (refused || number.is_empty() && !is_flag) && !names(&said, letter) {
                faults.push(format!("{line}: the word is not named: {said:?}"));
            }
            if refused && &done != unharmed {
                faults.push(format!("{line} is refused and has changed something: {said:?}"));
            }
        }
    }
    faults
}

fn check(name: &str, commands: &[&str]) {
    let profile = profile(name);
    let (unharmed, ..) = execute(&profile, None);
    let faults: Vec<_> = commands.iter().flat_map(|command| faults(&profile, &unharmed, command)).collect();
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn bad_words_are_named_and_change_nothing() {
    check("cartesian", &COMMANDS);
}

#[test]
fn bad_words_for_drivers_and_probe_change_nothing() {
    check("prusa-mini", &WITH_DRIVERS);
}

/// Checks the test itself: the comparison notices every valid word.
#[test]
fn the_good_words_do_change_something() {
    let cartesian = profile("cartesian");
    let (unharmed, ..) = execute(&cartesian, None);
    for command in COMMANDS {
        let (done, said, refused) = execute(&cartesian, Some(command));
        let is_seen = done != unharmed || said.len() > 1;
        // No query reports the idle time or the fan's power; a wait for 0 degrees ends at once.
        let unseen = ["G4", "M18", "M84", "M109", "M190", "M106", "M107"].iter().any(|code| command.starts_with(code));
        assert!(is_seen || unseen, "{command}: {said:?}");
        assert!(!refused, "{command}: {said:?}");
    }
}
