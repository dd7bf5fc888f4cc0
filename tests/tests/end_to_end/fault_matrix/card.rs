//! The memory card is pulled out of its slot.

use std::io::Read;

use embedded_hal_async::delay::DelayNs;
use ferrostep_card::{CardPort, LocalCard, Put, Request};
use ferrostep_gcode::LineReader;
use ferrostep_hal_shim::Heater;
use ferrostep_printer::{Host, HostLines, HostText, Profile};
use ferrostep_session::DeskPrinter;
use ferrostep_virtual_board::{VirtualCard, VirtualDelay};

use super::At;
use super::trial::LONG_S;
use crate::end_to_end::command::repository;
use crate::end_to_end::hosts::{Machine, machine};

type Card = LocalCard<VirtualCard<Vec<u8>>>;

fn now_s(machine: &Machine) -> f64 {
    machine.clock().now_ns() as f64 * 1e-9
}

/// A card with one file.
fn card(text: &str) -> Card {
    let mut image = Vec::new();
    let file = std::fs::File::open(repository().join("printer/card/tests/images/fat16.img.gz")).unwrap();
    flate2::read::GzDecoder::new(file).read_to_end(&mut image).unwrap();
    let card = Card::new(VirtualCard::new(image));
    let ask = |request: Request| {
        card.with(&mut |mailbox| mailbox.ask(request.clone()));
        card.with(&mut |mailbox| {
            mailbox.take_answer().unwrap().unwrap();
        });
    };
    ask(Request::Mount);
    ask(Request::Create("PRINT.GCO".try_into().unwrap()));
    let mut rest = text.as_bytes();
    while !rest.is_empty() {
        card.with(&mut |mailbox| match mailbox.put(rest) {
            Put::Bytes(length) => rest = &rest[length..],
            Put::Wait => {}
            Put::Failed(failure) => panic!("{failure}"),
        });
    }
    ask(Request::Finish);
    ask(Request::Release);
    card
}

/// The card, and a person who puts it back when the print has been paused for a while, and
/// continues the print.
struct Person<'a> {
    machine: &'a Machine,
    card: &'a Card,
    host: Host,
    reader: LineReader,
    pulls_at_s: f64,
    /// Time of the print's last pause or resume, s.
    paused_s: Option<f64>,
    /// Number of attempts to continue the print before the card is back.
    tries_without_it: u32,
    bytes: &'static [u8],
}

impl Person<'_> {
    fn look(&mut self) {
        if now_s(self.machine) >= self.pulls_at_s {
            self.pulls_at_s = f64::INFINITY;
            self.card.with_slot(VirtualCard::pull);
        }
    }
}

impl HostLines for Person<'_> {
    fn next(&mut self) -> HostText<'_> {
        self.look();
        if self.paused_s.is_some_and(|since_s| now_s(self.machine) > since_s + LONG_S) {
            self.paused_s = None;
            if self.tries_without_it > 0 {
                self.tries_without_it -= 1;
            } else {
                self.card.with_slot(VirtualCard::insert);
            }
            self.bytes = b"M24\n";
        }
        let (used, line) = self.reader.feed(self.bytes);
        self.bytes = &self.bytes[used..];
        match line {
            Some(line) => HostText::Line(&mut self.host, line),
            None => HostText::Nothing,
        }
    }

    fn tell_all(&mut self) {}

    async fn wait(&mut self, _idle: bool) {
        // Only a paused print waits here.
        self.paused_s.get_or_insert(now_s(self.machine));
        let mut clock = VirtualDelay(self.machine.clock());
        clock.delay_ms(100).await;
    }
}

/// Outcome for the machine, as the table has it. The card `prints` the job of this state, or is
/// only in its slot.
pub fn outcome(profile: &Profile, at: At, prints: bool) -> String {
    if prints && at == At::Idle {
        // An idle printer has no print.
        return outcome(profile, at, false);
    }
    let mut text = at.command().map_or(String::new(), |(line, _)| format!("{line}\n"));
    let lines = if at.is_hot() { 100 } else { 20 };
    for line in 0..lines {
        // The card is read ahead: the comments are more than that.
        let words = if at.is_hot() { "E0.5 " } else { "" };
        text += &format!("G1 X{} {words}F900 ; {}\n", 50 + 60 * (line % 2), "comment ".repeat(20));
    }
    let card = card(&text);
    let machine = machine(profile);
    let mut printer: DeskPrinter<'_> = machine.printer();
    printer.set_card(&card);
    let mut said = Vec::new();
    for line in at.lines_before().into_iter().chain(["M21"]) {
        machine.run(printer.execute_for_host(1, line, false)).unwrap();
    }
    machine.replies().take();
    let begun_s = now_s(&machine);
    let mut person = Person {
        machine: &machine,
        card: &card,
        host: Host::new(),
        reader: LineReader::new(),
        pulls_at_s: begun_s + at.command().map_or(5.0, |(_, seconds)| seconds),
        paused_s: None,
        tries_without_it: u32::from(at == At::Paused),
        bytes: b"",
    };
    if prints {
        for line in ["M23 PRINT.GCO", "M24"] {
            machine.run(printer.execute_for_host(1, line, false)).unwrap();
        }
        let mut room = vec![0; 8192];
        machine.run(printer.print_from_card(&mut person, &mut room));
        said.extend(machine.replies().take());
        assert_eq!(said.last().map(String::as_str), Some("Done printing file"), "{at:?}: {said:#?}");
    } else {
        for line in text.lines().take(1 + usize::from(at == At::Printing) * lines) {
            let line = line.split(';').next().unwrap_or_default();
            if at == At::Idle {
                break;
            }
            let done = machine.run_with(printer.execute_for_host(1, line, true), |machine| {
                if now_s(machine) >= person.pulls_at_s {
                    person.look();
                }
                if machine.signals().is_paused_for_user() && now_s(machine) > begun_s + LONG_S {
                    machine.signals().end_wait();
                }
            });
            done.unwrap_or_else(|failure| panic!("{at:?}: {line}: {failure}"));
        }
        machine.run_with(async { VirtualDelay(machine.clock()).delay_ms(10_000).await }, |_| person.look());
        said.extend(machine.replies().take());
        // Only the card is missing.
        machine.run(printer.execute_for_host(1, "M21", false)).unwrap();
        assert!(machine.replies().take().contains(&"echo:No SD card".to_owned()), "{at:?}");
    }
    assert_eq!(person.pulls_at_s, f64::INFINITY, "{at:?}: it has not happened");
    let has_heat = |heater: &Heater| machine.heaters().power(*heater) > 0.0;
    assert!(at == At::Idle || Heater::ALL.iter().any(has_heat), "{at:?}: {said:#?}");
    assert!(!machine.signals().is_halted(), "{at:?}");
    let is_told = said.iter().any(|line| line.starts_with("echo:card: no card is in the slot; the print is paused"));
    let own_pauses = usize::from(at == At::Paused);
    let pauses = said.iter().filter(|line| *line == "//action:paused").count();
    match (is_told, pauses - own_pauses) {
        (true, 1) => "pauses".to_owned(),
        (false, 0) => "none".to_owned(),
        _ => panic!("{at:?}: {said:#?}"),
    }
}
