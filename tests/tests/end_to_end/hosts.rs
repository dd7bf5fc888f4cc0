//! The conversation with a host over a serial line.

use ferrostep_gcode::LineReader;
use ferrostep_printer::{Host, Profile};
use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;
use ferrostep_session::record::Observer;
use ferrostep_session::{DeskPrinter, PrintSession, Session};
use ferrostep_testkit::host_side::numbered;

use crate::end_to_end::command::example;
use crate::end_to_end::desk::{profile, rehearse};
use crate::end_to_end::refusals::Collector;
use crate::end_to_end::repeats::Seeded;

/// A machine with a serial line.
pub type Machine = PrintSession<(), Collector>;

/// A machine that has just been switched on.
pub fn machine(profile: &Profile) -> Machine {
    Session::print(*profile, LOOK_AHEAD_BLOCKS, (), Collector::default())
}

/// The host's end of the line, and the printer at the other end.
pub struct Conversation<'a, O: Observer = ()> {
    machine: &'a PrintSession<O, Collector>,
    printer: DeskPrinter<'a>,
    host: Host,
    reader: LineReader,
}

impl<'a, O: Observer> Conversation<'a, O> {
    /// Begins before any line has been sent.
    pub fn new(machine: &'a PrintSession<O, Collector>) -> Self {
        Self { machine, printer: machine.printer(), host: Host::new(), reader: LineReader::new() }
    }

    /// Sends a line and waits until it is answered.
    pub fn say(&mut self, line: &str) -> Vec<String> {
        self.say_bytes(format!("{line}\n").as_bytes())
    }

    /// Sends some bytes and waits until all lines that end in them are answered.
    pub fn say_bytes(&mut self, bytes: &[u8]) -> Vec<String> {
        self.say_while(bytes, |_| {})
    }

    /// The same; `between` is called whenever time has passed.
    pub fn say_while(&mut self, mut bytes: &[u8], mut between: impl FnMut(&PrintSession<O, Collector>)) -> Vec<String> {
        while !bytes.is_empty() {
            let (used, line) = self.reader.feed(bytes);
            bytes = &bytes[used..];
            if let Some(line) = line {
                self.machine.run_with(self.host.answer(&mut self.printer, line), &mut between);
            }
        }
        self.machine.replies().take()
    }

    /// Waits for the end of all motion.
    pub fn finish(&mut self) {
        self.machine.run(self.printer.finish()).unwrap();
    }

    /// X, Y, Z and E as the G-code counts them, mm.
    pub fn position_mm(&self) -> [f64; 4] {
        self.printer.logical_10nm().map(|units| units as f64 / 100_000.0)
    }
}

fn oks(replies: &[String]) -> usize {
    replies.iter().filter(|reply| reply.starts_with("ok")).count()
}

/// The number to which a host is asked to go back.
fn resend(replies: &[String]) -> Option<i64> {
    replies.iter().find_map(|reply| reply.strip_prefix("Resend: ")?.parse().ok())
}

/// Lines of real hosts that connected and printed.
#[test]
fn recorded_host_conversations_are_answered() {
    for (name, text, end) in [
        ("OctoPrint", include_str!("../../data/octoprint.host"), [5.4, 180.0, 0.28, 0.0]),
        ("printcore", include_str!("../../data/printcore.host"), [5.1, 180.0, 0.28, 0.0]),
        ("marlin-host", include_str!("../../data/marlin-host.host"), [5.4, 20.0, 2.0, 0.0]),
        ("pronsole", include_str!("../../data/pronsole.host"), [0.0, 0.0, 0.0, 0.0]),
    ] {
        let machine = machine(&profile("cartesian"));
        let mut conversation = Conversation::new(&machine);
        for line in text.lines() {
            let replies = conversation.say(line);
            assert_eq!(oks(&replies), 1, "{name} says {line:?}: {replies:?}");
            assert_eq!(resend(&replies), None, "{name} says {line:?}: {replies:?}");
            assert!(!replies.iter().any(|reply| reply.contains("rror")), "{name} says {line:?}: {replies:?}");
            let last = replies.last().unwrap();
            if line.contains("M105") {
                assert!(last.starts_with("ok T:"), "{name}: {replies:?}");
            } else {
                assert_eq!(last, "ok", "{name} says {line:?}: {replies:?}");
            }
        }
        conversation.finish();
        let position = conversation.position_mm();
        let [x, y, z, _] = position;
        assert_eq!([x, y, z], end[..3], "{name}: {position:?}");
    }
}

/// The first lines of a sliced file, as a host sends them: without comments and blank lines.
fn lines_to_send() -> Vec<String> {
    let text = String::from_utf8(example("cube.gcode")).unwrap();
    let commands = text.lines().map(|line| line.split(';').next().unwrap_or_default().trim().to_owned());
    commands.filter(|command| !command.is_empty()).take(3000).collect()
}

/// A damaged line: a changed byte, or a missing one.
fn garbled(line: &str, random: &mut Seeded) -> Vec<u8> {
    let mut bytes = line.as_bytes().to_vec();
    let at = random.below(bytes.len());
    if random.below(4) == 0 {
        bytes.remove(at);
    } else {
        // Another printable character.
        bytes[at] = b' ' + (bytes[at] - b' ' + 1 + random.below(93) as u8) % 94;
    }
    bytes.push(b'\n');
    bytes
}

#[test]
fn a_bad_line_changes_only_the_time() {
    let profile = profile("cartesian");
    let lines = lines_to_send();
    let clean = rehearse(&profile, LOOK_AHEAD_BLOCKS, &mut lines.join("\n").as_bytes());
    assert!(clean.outcome.is_ok(), "{:?}", clean.outcome);

    for (seed, one_in) in [(11, usize::MAX), (12, 100), (13, 100), (14, 20)] {
        let mut random = Seeded::new(seed);
        let machine = machine(&profile);
        let mut conversation = Conversation::new(&machine);
        assert_eq!(conversation.say(&numbered(0, "M110 N0")), ["ok"]);
        let (mut next, mut spoilt, mut resent) = (0, 0, 0);
        while next < lines.len() {
            let number = next as i64 + 1;
            let line = numbered(number, &lines[next]);
            let replies = match random.below(one_in) {
                0 => {
                    spoilt += 1;
                    conversation.say_bytes(&garbled(&line, &mut random))
                }
                // A host that has missed an `ok` repeats itself.
                1 => [conversation.say(&line), conversation.say(&line)].concat(),
                _ => conversation.say(&line),
            };
            assert!(oks(&replies) > 0, "{line:?}: {replies:?}");
            match resend(&replies) {
                Some(wanted) => {
                    // A line that lost its number counts as one without, and the next
                    // line shows the gap.
                    assert!(wanted == number || wanted == number - 1, "{line:?}: {replies:?}");
                    let error = replies.iter().find(|reply| reply.starts_with("Error:")).unwrap();
                    assert!(error.ends_with(&format!(", Last Line: {}", wanted - 1)), "{replies:?}");
                    assert_eq!(replies.last().map(String::as_str), Some("ok"), "{replies:?}");
                    resent += 1;
                    next = usize::try_from(wanted - 1).unwrap();
                }
                None => next += 1,
            }
        }
        conversation.finish();
        assert_eq!(spoilt > 0, one_in < usize::MAX);
        assert_eq!(spoilt, resent, "each bad line is asked for once");
        let figures = machine.figures();
        assert_eq!(figures.digests, clean.figures.digests, "one in {one_in}");
        assert_eq!(conversation.position_mm(), clean.logical_10nm.map(|units| units as f64 / 100_000.0));
    }
}

#[test]
fn a_repeated_line_is_answered_but_not_executed_again() {
    let machine = machine(&profile("cartesian"));
    let mut conversation = Conversation::new(&machine);
    for line in ["G91", "G1 X5 F3000", "G1 X5"].iter().zip(1..).map(|(text, number)| numbered(number, text)) {
        assert_eq!(conversation.say(&line), ["ok"]);
    }
    assert_eq!(conversation.say(&numbered(3, "G1 X5")), ["ok"]);
    assert_eq!(conversation.say(&numbered(2, "G1 X5 F3000")), ["ok"]);
    assert_eq!(conversation.position_mm()[0], 10.0);
    assert_eq!(conversation.say(&numbered(4, "G1 X5")), ["ok"]);
    assert_eq!(conversation.position_mm()[0], 15.0);
}

#[test]
fn damaged_lines_are_requested_again() {
    let machine = machine(&profile("cartesian"));
    let mut conversation = Conversation::new(&machine);
    assert_eq!(conversation.say(&numbered(5, "M110 N5")), ["ok"]);
    assert_eq!(conversation.say(&numbered(6, "G91")), ["ok"]);
    for (line, error) in [
        ("N7 G1 X5".to_owned(), "No Checksum with line number"),
        ("N7 G1 X5*1".to_owned(), "checksum mismatch"),
        ("N7 G1 X5*five".to_owned(), "checksum mismatch"),
        (numbered(9, "G1 X5"), "Line Number is not Last Line Number+1"),
        (numbered(4, "G1 X5"), "Line Number is not Last Line Number+1"),
        (numbered(7, &"G1 X5 ".repeat(60)).replace("*", "1*"), "checksum mismatch"),
        (numbered(7, "G1 X5\u{7}").replace("*", "1*"), "checksum mismatch"),
    ] {
        let replies = conversation.say(&line);
        assert_eq!(replies, [format!("Error:{error}, Last Line: 6"), "Resend: 7".into(), "ok".into()], "{line:?}");
    }
    assert_eq!(conversation.position_mm(), [0.0; 4]);
    assert_eq!(conversation.say(&numbered(7, "G1 X5")), ["ok"]);
    assert_eq!(conversation.position_mm()[0], 5.0);
}

/// Unreadable lines that arrived undamaged: a resend would repeat them endlessly.
#[test]
fn lines_that_can_never_be_read_are_refused_once() {
    let machine = machine(&profile("cartesian"));
    let mut conversation = Conversation::new(&machine);
    for (line, says) in [
        (numbered(1, &format!("G1 X5 {}", "X5 ".repeat(200))), "the line is too long, expected at most 256 characters"),
        (numbered(2, "G1 X5\u{7}"), "not text: byte 0x07, expected UTF-8 without control characters"),
    ] {
        let replies = conversation.say(&line);
        assert!(replies.len() == 2 && replies[0].ends_with(says) && replies[1] == "ok", "{replies:?}");
        assert_eq!(conversation.say(&line), ["ok"], "a repeated line");
    }
    // A comment, and a text for people, may have any length.
    let long = "layer ".repeat(100);
    for text in [format!("G1 X5 F3000 ; {long}"), format!("M117 {long}"), format!("M118 {long}"), "G1 X10".to_owned()]
        .iter()
        .zip(3..)
    {
        let replies = conversation.say(&numbered(text.1, text.0));
        assert_eq!(replies.last().map(String::as_str), Some("ok"), "{replies:?}");
        assert_eq!(resend(&replies), None, "{replies:?}");
    }
    assert_eq!(conversation.position_mm()[0], 10.0);
}

#[test]
fn m110_in_every_form() {
    let machine = machine(&profile("cartesian"));
    let mut conversation = Conversation::new(&machine);
    for (line, last) in [
        ("M110".to_owned(), 0),
        (numbered(0, "M110 N0"), 0),
        (numbered(-1, "M110 N-1"), -1),
        (numbered(12, "M110"), 12),
        (numbered(3, "M110 N40"), 40),
        ("M110 N7".to_owned(), 7),
    ] {
        assert_eq!(conversation.say(&line).last().map(String::as_str), Some("ok"), "{line}");
        assert_eq!(conversation.say(&numbered(last + 1, "M110")).last().map(String::as_str), Some("ok"), "{line}");
        assert_eq!(conversation.say("M110"), [format!("Line: {}", last + 1), "ok".into()], "{line}");
        assert_eq!(conversation.say(&numbered(last + 2, "M400")), ["ok"], "{line}");
        let gap = conversation.say(&numbered(last + 9, "M400"));
        assert_eq!(resend(&gap), Some(last + 3), "{line}: {gap:?}");
    }
}

#[test]
fn unnumbered_lines_need_no_checksum() {
    let machine = machine(&profile("cartesian"));
    let mut conversation = Conversation::new(&machine);
    assert_eq!(conversation.say("G91"), ["ok"]);
    assert_eq!(conversation.say("G1 X5 F3000"), ["ok"]);
    assert_eq!(conversation.say_bytes(b"\n\r\n; nothing\n   \n"), [""; 0]);
    let refused = conversation.say("G1 X5 Y1.2.3");
    assert_eq!(refused.len(), 2, "{refused:?}");
    assert!(refused[0].starts_with("echo:line ") && refused[0].contains("Y:") && refused[1] == "ok", "{refused:?}");
    let unreadable = conversation.say_bytes(b"G1 X5 \xff\n");
    assert!(unreadable[0].starts_with("echo:line ") && unreadable[1] == "ok", "{unreadable:?}");
    assert_eq!(conversation.say("M7777"), ["echo:Unknown command: \"M7777\"", "ok"]);
    assert_eq!(conversation.position_mm()[0], 5.0);
}

/// Times at which each line of a text was answered, s of virtual time.
fn answered_at_s(machine: &Machine, lines: &[String]) -> Vec<f64> {
    let mut conversation = Conversation::new(machine);
    let times = lines.iter().map(|line| {
        let replies = conversation.say(line);
        assert!(replies.ends_with(&["ok".to_owned()]) && oks(&replies) == 1, "{line}: {replies:?}");
        machine.clock().now_ns() as f64 * 1e-9
    });
    let times = times.collect();
    conversation.finish();
    times
}

/// The machine stops within the motion that it has when a host stops sending, for any moves; the
/// plan stays that of the file.
#[test]
fn a_hosts_ok_waits_with_seconds_of_motion_at_hand() {
    let profile = profile("cartesian");
    // Moves, how many, and seconds of motion in each: corners in between, a straight
    // line, long lines.
    type Line = fn(usize) -> String;
    let zigzag: Line = |index| format!("G1 X{} Y{} F1200", 20 + index % 2 * 10, 20 + index / 10);
    let straight: Line = |index| format!("G1 X{}.{} F3000", index / 2, index % 2 * 5);
    let long: Line = |index| format!("G1 X{} F1200", 20 + index % 2 * 100);
    let cases = [(zigzag, 200, 0.5), (straight, 390, 0.01), (long, 12, 5.0)];
    for (line, count, seconds) in cases {
        let lines: Vec<String> = (1..=count).map(line).collect();
        let machine = machine(&profile);
        let times = answered_at_s(&machine, &lines);
        // All its motion, or its certain part, the move whose end speed the next one may still
        // change, and the braking.
        let most = f64::max(1.0, 0.5 + seconds) + 0.2;
        for (index, at_s) in times.iter().enumerate() {
            let held = (index + 1) as f64 * seconds - at_s;
            assert!(held <= most, "{}: {held} s of motion, more than {most}", lines[index]);
        }
        assert!(times[count - 1] > count as f64 * seconds - most);
        let file = rehearse(&profile, LOOK_AHEAD_BLOCKS, &mut lines.join("\n").as_bytes());
        assert_eq!(machine.figures().digests, file.figures.digests, "{}", lines[0]);
        let figures = machine.figures();
        assert_eq!((figures.underruns, figures.starvation_flushes), (0, 0));
    }
}
