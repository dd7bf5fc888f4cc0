#![allow(clippy::unwrap_used)]

use std::time::Duration;

use super::*;
use crate::send::scripted::{Scripted, echo};

/// Creates a printer that answers the opening handshake, then the job with `answer`.
fn printer<'a>(
    mut answer: impl FnMut(&str, usize) -> Vec<&'a str>,
) -> Scripted<impl FnMut(&str, usize) -> Vec<String>> {
    Scripted::new(move |line: &str, times| {
        echo(line).unwrap_or_else(|| answer(line, times).into_iter().map(str::to_owned).collect())
    })
}

/// Filters the lines of the job and strips their checksums.
fn sent(heard: Vec<String>) -> Vec<String> {
    let of_job = heard.into_iter().filter(|line| !line.contains("M110") && !line.contains("M118"));
    of_job.map(|line| line.split('*').next().unwrap().to_owned()).collect()
}

/// Sends two commands and a comment; returns the outcome and the lines of the job.
fn send(answer: impl FnMut(&str, usize) -> Vec<&'static str>) -> (Result<Outcome, SendError>, Vec<String>) {
    let mut port = printer(answer);
    let mut lines = ["G28 ; home", "", "; hop", "  G1 X5"].into_iter().map(|line| Ok(line.as_bytes().to_vec()));
    let outcome =
        send_lines(&mut port, Packing::Plain, || lines.next(), Frame::PLAIN, Patience::DEFAULT, &mut |_: &str| {});
    (outcome, sent(port.heard))
}

const WHOLE: [&str; 3] = ["N1 G28", "N2 G1 X5", "N3 M400"];

fn done(resends: u32) -> Outcome {
    Outcome { file_line: 4, sent: 2, resends, stop: None }
}

#[test]
fn commands_are_sent_one_by_one_with_number_and_checksum() {
    let (outcome, sent) = send(|line, _| {
        let (text, sum) = line.rsplit_once('*').unwrap();
        assert_eq!(text.bytes().fold(0, |sum, byte| sum ^ byte).to_string(), sum);
        vec!["echo:busy: processing", " T:20.0 /0.0", "ok"]
    });
    assert_eq!(outcome.unwrap(), done(0));
    assert_eq!(sent, WHOLE);
}

#[test]
fn a_line_is_sent_again_where_the_printer_asks() {
    let wrong = ["Error:checksum mismatch, Last Line: 1", "Resend: 2", "ok"];
    let (outcome, sent) =
        send(|line, times| if line.starts_with("N2") && times == 0 { wrong.to_vec() } else { vec!["ok"] });
    assert_eq!(outcome.unwrap(), done(1));
    assert_eq!(sent, ["N1 G28", "N2 G1 X5", "N2 G1 X5", "N3 M400"]);
    // The line has arrived but its answer was lost: when the line comes again, the printer asks for
    // the next one.
    let had = ["Error:Line Number is not Last Line Number+1, Last Line: 2", "Resend: 3", "ok"];
    let (outcome, sent) = send(|line, times| match (line.starts_with("N2"), times) {
        (true, 0) => vec![],
        (true, _) => had.to_vec(),
        _ => vec!["ok"],
    });
    assert_eq!(outcome.unwrap().resends, 1);
    assert_eq!(sent, ["N1 G28", "N2 G1 X5", "N2 G1 X5", "N3 M400"]);
}

/// Continuing would execute an answered line twice, or skip a line.
#[test]
fn a_printer_that_counts_from_another_number_ends_the_job() {
    for (asked, at) in [("Resend: N1", 2), ("Resend: 0", 2), ("Resend: 3", 2), ("rs 1000", 2), ("Resend: 1", 3)] {
        let (outcome, sent) = send(|line, _| {
            if line.starts_with(&format!("N{at} ")) { vec!["Error:Line Number", asked, "ok"] } else { vec!["ok"] }
        });
        let outcome = outcome.unwrap();
        let number = asked.trim_start_matches(|byte: char| !byte.is_ascii_digit()).parse().unwrap();
        assert_eq!(outcome.stop, Some(Stop::OtherCount(number, at)), "{asked}");
        assert_eq!(sent.len() as u32, at, "{asked}");
    }
}

#[test]
fn a_line_that_never_arrives_ends_the_job() {
    let (outcome, sent) =
        send(|line, _| if line.starts_with("N2") { vec!["Error:checksum", "Resend: 2", "ok"] } else { vec!["ok"] });
    assert_eq!(outcome.unwrap().stop, Some(Stop::NeverArrives(2)));
    assert_eq!(sent.len(), 1 + MOST_TIMES as usize);
}

#[test]
fn numbers_of_the_file_are_not_those_of_the_conversation() {
    let mut port = printer(|_, _| vec!["ok"]);
    let mut lines = ["N10 G28", "M110 N0", "N0 M110 N0*125", "N20 G1 X5"].into_iter().map(|line| Ok(line.into()));
    let watch = &mut |_: &str| {};
    let outcome = send_lines(&mut port, Packing::Plain, || lines.next(), Frame::PLAIN, Patience::DEFAULT, watch);
    assert_eq!(outcome.unwrap(), done(0));
    assert_eq!(sent(port.heard), WHOLE);
    let mut port = printer(|_, _| vec!["ok"]);
    let mut lines = ["N3 T0*57", "N3 T0*56", "G1 X5"].into_iter().map(|line| Ok(line.into()));
    let outcome =
        send_lines(&mut port, Packing::Plain, || lines.next(), Frame::PLAIN, Patience::DEFAULT, watch).unwrap();
    assert!(matches!(outcome.stop, Some(Stop::Damaged(_))), "{outcome:?}");
    assert_eq!((outcome.file_line, sent(port.heard)), (1, vec!["N1 T0".to_owned()]));
}

#[test]
fn a_line_that_gets_lost_is_sent_again_after_a_while() {
    let (outcome, sent) = send(|line, times| if line.starts_with("N2") && times == 0 { vec![] } else { vec!["ok"] });
    assert_eq!(outcome.unwrap(), done(0));
    assert_eq!(sent, ["N1 G28", "N2 G1 X5", "N2 G1 X5", "N3 M400"]);
    let (outcome, _) = send(|line, _| if line.starts_with("N2") { vec![] } else { vec!["ok"] });
    assert!(matches!(outcome, Err(SendError::Silent(_))));
}

#[test]
fn a_printer_that_is_busy_is_not_asked_again() {
    let minutes = vec!["echo:busy: processing"; 100];
    let (outcome, sent) =
        send(|line, _| if line.starts_with("N1 ") { [&minutes[..], &["ok"]].concat() } else { vec!["ok"] });
    assert_eq!(outcome.unwrap(), done(0));
    assert_eq!(sent, WHOLE);
}

/// A file is written between M28 and M29, and only if the printer confirms that it writes:
/// otherwise it would execute the lines.
#[test]
fn an_upload_sends_nothing_that_would_be_executed() {
    const UPLOAD: Frame<'static> = Frame { opening: &["M28 A.GCO"], closing: &["M29"], is_upload: true };
    let upload = |lines: &[&str], begin: Vec<&'static str>, end: Vec<&'static str>| {
        let answer = |line: &str, times: usize| match line.split([' ', '*']).nth(1) {
            Some("M28") => begin.clone(),
            // The first answer is lost.
            Some("M29") if times == 0 => vec![],
            Some("M29") => end.clone(),
            _ => vec!["ok"],
        };
        let mut port = printer(answer);
        let mut lines = lines.iter().map(|line| Ok(line.as_bytes().to_vec()));
        let mut watch = |_: &str| {};
        let outcome =
            send_lines(&mut port, Packing::Plain, || lines.next(), UPLOAD, Patience::DEFAULT, &mut watch).unwrap();
        (outcome.stop, sent(port.heard))
    };
    let writes = vec!["echo:Now fresh file: A.GCO", "Writing to file: A.GCO", "ok"];
    let written = vec!["Done saving file.", "ok"];
    let (stop, sent) = upload(&["G28", "G1 X5 ; there"], writes.clone(), written.clone());
    assert_eq!(
        (stop, sent),
        (None, ["N1 M28 A.GCO", "N2 G28", "N3 G1 X5", "N4 M29", "N4 M29"].map(str::to_owned).into())
    );
    let (stop, sent) = upload(&["G28"], vec!["open failed, File: A.GCO.", "ok"], written.clone());
    let expected = "the printer refuses M28 A.GCO: open failed, File: A.GCO.";
    assert_eq!((stop.unwrap().to_string().as_str(), sent.len()), (expected, 1));
    for command in ["M29", "m112 now", "M112"] {
        let (stop, sent) = upload(&["G28", command, "G1 X5"], writes.clone(), written.clone());
        assert_eq!((stop, sent.len()), (Some(Stop::NotForCard(command.to_owned())), 2), "{command}");
    }
    let mut port = printer(|line, times| match (line.split([' ', '*']).nth(1), times) {
        (Some("M28"), _) => writes.clone(),
        (Some("G28"), 0) => vec![],
        (Some("G28"), _) => vec!["ok", "ok"],
        (Some("M29"), _) => written.clone(),
        _ => vec!["ok"],
    });
    let mut lines = ["G28"].into_iter().map(|line: &str| Ok(line.as_bytes().to_vec()));
    let mut watch = |_: &str| {};
    let slow = send_lines(&mut port, Packing::Plain, || lines.next(), UPLOAD, Patience::DEFAULT, &mut watch).unwrap();
    assert_eq!((slow.stop, port.unheard()), (None, 0), "a second answer is not that to M29");
    let lost = vec!["echo:card: the file is incomplete, delete it with M30", "ok"];
    let (stop, _) = upload(&["G28"], writes.clone(), lost.clone());
    assert_eq!(stop, Some(Stop::NotWritten(vec![lost[0].to_owned()])));
}

#[test]
fn what_ends_a_job_ends_it() {
    for (said, stop) in [
        ("Error:Heating failed, system stopped! Heater_ID: E0", None),
        ("!! STOP called because of unhomed error - restart with M999", None),
        ("//action:cancel", Some(Stop::Cancelled)),
        ("start", Some(Stop::Reset)),
    ] {
        let (outcome, sent) = send(|line, _| if line.starts_with("N2") { vec![said] } else { vec!["ok"] });
        let outcome = outcome.unwrap();
        assert_eq!(outcome.stop, Some(stop.unwrap_or_else(|| Stop::Error(said.to_owned()))));
        assert_eq!((outcome.file_line, sent.len()), (1, 2), "{said}");
    }
    let (outcome, _) =
        send(|line, _| if line.starts_with("N2") { vec!["Error:Printer halted. kill() called!"] } else { vec!["ok"] });
    assert!(matches!(outcome, Err(SendError::Halted(_))));
}

#[test]
fn a_start_before_the_first_answer_is_no_reset() {
    let (outcome, _) =
        send(|line, _| if line.contains("M110") { vec!["start", "echo:board: x", "ok"] } else { vec!["ok"] });
    assert_eq!(outcome.unwrap(), done(0));
}

/// The answer to an earlier host's unfinished line comes before the first answer to this host.
/// Taken for the answer to M110, it would put the host one line ahead: done before the printer is.
#[test]
fn an_answer_to_an_earlier_host_is_not_taken_for_ours() {
    let mut port =
        printer(|line, times| if line.contains("M110") && times == 0 { vec!["ok", "ok"] } else { vec!["ok"] });
    let mut lines = ["G28"].into_iter().map(|line| Ok(line.as_bytes().to_vec()));
    let watch = &mut |_: &str| {};
    let outcome = send_lines(&mut port, Packing::Plain, || lines.next(), Frame::PLAIN, Patience::DEFAULT, watch);
    assert_eq!((outcome.unwrap().sent, port.unheard()), (1, 0));
}

/// A slow printer answers a line as often as it was sent. A host that took the second answer for
/// the answer to the next line would be done before the printer is.
#[test]
fn a_slow_printer_is_waited_for_to_its_last_answer() {
    let mut port = printer(|line, times| match (line.starts_with("N1 G28"), times) {
        (true, 0) => vec![],
        (true, _) => vec!["ok", "ok"],
        _ => vec!["ok"],
    });
    let mut lines = ["G28", "G1 X5"].into_iter().map(|line| Ok(line.as_bytes().to_vec()));
    let watch = &mut |_: &str| {};
    let outcome = send_lines(&mut port, Packing::Plain, || lines.next(), Frame::PLAIN, Patience::DEFAULT, watch);
    assert_eq!((outcome.unwrap().sent, port.unheard()), (2, 0));
}

/// Records when a job is held, and wants the end after some polls.
struct Holding(Vec<bool>, u32);

impl Watch for Holding {
    fn hear(&mut self, _: &str) {}

    fn held(&mut self, is_held: bool) {
        self.0.push(is_held);
    }

    fn wants_end(&mut self) -> bool {
        self.1 -= 1;
        self.1 == 0
    }
}

#[test]
fn a_held_job_waits_as_long_as_it_takes_and_can_be_ended() {
    let answer = |line: &str, _: usize| match line.split(' ').next() {
        Some("N1") => vec!["//action:paused", "ok"],
        _ => vec!["ok"],
    };
    let mut port = printer(answer);
    let begun = port.now;
    let mut lines = ["G28", "G1 X5"].into_iter().map(|line| Ok(line.as_bytes().to_vec()));
    let mut watch = Holding(Vec::new(), 1000);
    let outcome =
        send_lines(&mut port, Packing::Plain, || lines.next(), Frame::PLAIN, Patience::DEFAULT, &mut watch).unwrap();
    assert_eq!(outcome.stop, Some(Stop::Asked));
    assert_eq!(watch.0, [true]);
    assert_eq!(sent(port.heard), ["N1 G28"]);
    assert!(port.now - begun > Duration::from_secs(60));
}

/// Inserts a person's commands between two of the file, and ends the printer's pause.
struct Between {
    commands: Vec<&'static str>,
    is_held: bool,
    ended: u32,
}

impl Watch for Between {
    fn hear(&mut self, _: &str) {}

    fn held(&mut self, is_held: bool) {
        self.is_held = is_held;
    }

    fn command_between(&mut self) -> Option<String> {
        self.commands.pop().map(str::to_owned)
    }

    fn wants_wait_ended(&mut self) -> bool {
        self.ended += u32::from(self.is_held);
        std::mem::take(&mut self.is_held)
    }
}

/// M601 gets its `ok` when the pause ends, and M108, which ends the pause, gets its own: the host
/// is not one line ahead afterwards.
#[test]
fn a_person_pauses_between_two_lines_and_goes_on() {
    let answer = |line: &str, _: usize| match line.split(['*', ' ']).nth(1) {
        Some("M601") => vec!["//action:paused"],
        _ if line == "M108" => vec!["//action:resumed", "ok", "ok"],
        _ => vec!["ok"],
    };
    let mut port = printer(answer);
    let mut lines = ["G28", "G1 X5"].into_iter().map(|line| Ok(line.as_bytes().to_vec()));
    let mut watch = Between { commands: vec!["M601", "M105"], is_held: false, ended: 0 };
    let outcome =
        send_lines(&mut port, Packing::Plain, || lines.next(), Frame::PLAIN, Patience::DEFAULT, &mut watch).unwrap();
    assert_eq!((outcome.stop, outcome.sent, watch.ended, port.unheard()), (None, 2, 1, 0));
    assert_eq!(sent(port.heard), ["N1 M105", "N2 M601", "M108", "N3 G28", "N4 G1 X5", "N5 M400"]);
}

/// A host that the printer has asked to hold its job (`//action:pause`) continues by itself: no
/// line is waiting in the printer.
#[test]
fn a_job_that_its_host_holds_goes_on_without_m108() {
    let mut port = printer(|line, _| match line.split(' ').next() {
        Some("N1") => vec!["//action:pause", "ok"],
        _ => vec!["ok"],
    });
    let mut lines = ["G28", "G1 X5"].into_iter().map(|line| Ok(line.as_bytes().to_vec()));
    let mut watch = AfterAnswer::default();
    let outcome =
        send_lines(&mut port, Packing::Plain, || lines.next(), Frame::PLAIN, Patience::DEFAULT, &mut watch).unwrap();
    assert_eq!((outcome.stop, port.unheard()), (None, 0));
    assert_eq!(sent(port.heard), ["N1 G28", "N2 G1 X5", "N3 M400"]);
}

/// Asks to continue the job once the line that held it is answered.
#[derive(Default)]
struct AfterAnswer {
    is_held: bool,
    is_wanted: bool,
}

impl Watch for AfterAnswer {
    fn hear(&mut self, line: &str) {
        self.is_wanted = self.is_held && line == "ok";
    }

    fn held(&mut self, is_held: bool) {
        self.is_held = is_held;
    }

    fn wants_wait_ended(&mut self) -> bool {
        std::mem::take(&mut self.is_wanted)
    }
}

/// Printer that also reports its temperatures every two seconds (M155).
struct Reporting<P>(P, Instant, u32);

impl<P: Port> Port for Reporting<P> {
    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.0.send(bytes)
    }

    fn receive(&mut self, until: Instant) -> io::Result<Option<String>> {
        let said = self.0.receive(until)?;
        if said.is_none() && self.0.now() >= self.1 {
            self.1 = self.0.now() + Duration::from_secs(2);
            self.2 += 1;
            assert!(self.2 < 1000, "the host waits for ever");
            return Ok(Some(" T:20.00 /0.00 B:20.00 /0.00 @:0 B@:0".to_owned()));
        }
        Ok(said)
    }

    fn now(&mut self) -> Instant {
        self.0.now()
    }
}

/// Temperature reports do not answer a line, so they do not show that the printer is working on
/// one.
#[test]
fn a_lost_answer_is_noticed_in_spite_of_reports() {
    let answer = |line: &str, times: usize| if line.starts_with("N1") && times == 0 { vec![] } else { vec!["ok"] };
    let printer = printer(answer);
    let now = printer.now;
    let mut port = Reporting(printer, now, 0);
    let mut lines = ["G28", "G1 X5"].into_iter().map(|line: &str| Ok(line.as_bytes().to_vec()));
    let mut watch = |_: &str| {};
    let outcome =
        send_lines(&mut port, Packing::Plain, || lines.next(), Frame::PLAIN, Patience::DEFAULT, &mut watch).unwrap();
    assert_eq!((outcome.stop, outcome.sent), (None, 2));
    assert_eq!(sent(port.0.heard), ["N1 G28", "N1 G28", "N2 G1 X5", "N3 M400"]);
}
