//! A host that packs its lines (MeatPack), at a port of a board: from received bytes
//! to executed lines.

use ferrostep_gcode::Emergency;
use ferrostep_gcode::meatpack::{BEGIN, END, pack};
use ferrostep_printer::Host;
use ferrostep_session::DeskPrinter;
use ferrostep_testkit::host_side::{PortBuffers, numbered};
use ferrostep_usb::{Heard, Incoming, Lines};

use crate::end_to_end::desk::profile;
use crate::end_to_end::hosts::{Machine, machine};
use crate::end_to_end::repeats::Seeded;

/// A port with its printer.
struct Port<'a> {
    machine: &'a Machine,
    printer: DeskPrinter<'a>,
    incoming: Incoming,
    ring: PortBuffers,
    lines: Lines,
    host: Host,
}

impl<'a> Port<'a> {
    fn new(machine: &'a Machine) -> Self {
        let (incoming, ring) = (Incoming::new(), PortBuffers::default());
        Self { machine, printer: machine.printer(), incoming, ring, lines: Lines::new(), host: Host::new() }
    }

    /// The printer's answers to these bytes.
    fn say(&mut self, bytes: &[u8]) -> Vec<String> {
        assert_eq!(self.incoming.take_in(bytes, &mut self.ring), 0);
        let received = Vec::from(std::mem::take(&mut self.ring.bytes));
        let mut rest = &received[..];
        while !rest.is_empty() {
            let (used, heard) = self.lines.feed(rest);
            rest = &rest[used..];
            match heard {
                Some(Heard::Line(line)) => self.machine.run(self.host.answer(&mut self.printer, line)),
                Some(Heard::HalfALine(half)) => self.machine.run(self.host.answer(&mut self.printer, Err(half))),
                None => {}
            }
        }
        self.machine.replies().take()
    }
}

fn packed(text: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    pack(text, |byte| bytes.push(byte));
    bytes
}

#[test]
fn packed_lines_are_lines() {
    let machine = machine(&profile("cartesian"));
    let mut port = Port::new(&machine);
    assert_eq!(port.say(b"M115\n").last().unwrap(), "ok");
    assert!(port.say(&BEGIN).is_empty());
    let reports: Vec<String> = port.ring.reports.iter().map(ToString::to_string).collect();
    assert_eq!(reports, ["[MP] PV01 OFF ESP", "[MP] PV01 OFF ESP", "[MP] PV01 ON ESP"]);
    let lines: [(&str, &[&str]); 3] =
        [("M110 N0", &["ok"]), ("G92 X12.5 Y3", &["ok"]), ("M117 Layer 1", &["//action:notification Layer 1", "ok"])];
    for (number, (text, said)) in lines.into_iter().enumerate() {
        assert_eq!(port.say(&packed(&format!("{}\n", numbered(number as i64, text)))), said, "{text}");
    }
    assert!(port.say(&packed("M114\n")).iter().any(|line| line.starts_with("X:12.50 Y:3.00 ")));
    port.say(&END);
    assert_eq!(port.say(b"G92 X1\n"), ["ok"]);
}

/// A changed bit anywhere in a packed line shows in the line's checksum, or leaves no valid line.
/// The line is asked for again, and the next packed line is whole.
#[test]
fn the_checksum_guards_a_packed_line() {
    let mut random = Seeded::new(12);
    for round in 0..400 {
        let machine = machine(&profile("cartesian"));
        let mut port = Port::new(&machine);
        port.say(&BEGIN);
        port.say(&packed(&format!("{}\n", numbered(0, "M110 N0"))));
        let line = format!("{}\n", numbered(1, "G92 X111.5 Y2.5"));
        let mut bytes = packed(&line);
        let place = random.below(bytes.len());
        bytes[place] ^= 1 << random.below(8);
        port.say(&bytes);
        // The host's patience ends, and it sends the line again.
        for _ in 0..3 {
            port.say(&packed(&line));
        }
        let at = port.say(&packed("\nM114\n"));
        let is_place = |line: &&String| line.starts_with("X:");
        let place_said = at.iter().find(is_place).unwrap_or_else(|| panic!("round {round}, byte {place}: {at:#?}"));
        assert!(place_said.starts_with("X:111.50 Y:2.50 "), "round {round}, byte {place}: {place_said}");
        assert!(port.ring.emergencies.is_empty());
    }
}

#[test]
fn m112_acts_packed_and_plain() {
    let machine = machine(&profile("cartesian"));
    let stop = [Emergency::Stop];
    let mut port = Port::new(&machine);
    port.say(&BEGIN);
    port.say(&packed("M105\n"));
    assert!(port.ring.emergencies.is_empty());
    port.incoming.take_in(&packed("M112\n"), &mut port.ring);
    assert_eq!(port.ring.emergencies, stop);
    for typed in [&b"M112\n"[..], b"\nM112\n", b"\nN7 M112*33\n", b"\n  M112 ; now\n"] {
        let mut port = Port::new(&machine);
        port.say(&BEGIN);
        port.incoming.take_in(typed, &mut port.ring);
        assert_eq!(port.ring.emergencies, stop, "{typed:?}");
    }
    // Other commands in plain text do not act: M108 may be part of something.
    let mut port = Port::new(&machine);
    port.say(&BEGIN);
    port.incoming.take_in(b"\nM108\n\nM410\n", &mut port.ring);
    assert!(port.ring.emergencies.is_empty());
}

/// Whole prints, packed, contain no bytes that look like an M112 in plain text.
#[test]
fn no_print_stops_itself() {
    for name in ["cube.gcode", "arcs-corexy.gcode.gz", "firmware-retraction.gcode.gz", "vase.gcode.gz"] {
        let text = String::from_utf8_lossy(&crate::end_to_end::command::example(name)).into_owned();
        let (mut incoming, mut ring) = (Incoming::new(), PortBuffers::default());
        incoming.take_in(&BEGIN, &mut ring);
        for (number, line) in text.lines().enumerate() {
            let command = line.split(';').next().unwrap_or_default().trim();
            incoming.take_in(&packed(&format!("{}\n", numbered(number as i64, command))), &mut ring);
            incoming.take_in(&packed(&format!("{}\n", command.replace(' ', ""))), &mut ring);
        }
        assert!(ring.emergencies.is_empty(), "{name}");
    }
}

#[test]
fn packing_ends_with_the_connection() {
    let machine = machine(&profile("cartesian"));
    let mut port = Port::new(&machine);
    port.say(&BEGIN);
    port.say(&packed("G1 X"));
    port.incoming.break_off();
    let said = port.say(b"M115\n");
    assert!(said.iter().any(|line| line.starts_with("FIRMWARE_NAME:Ferrostep")), "{said:#?}");
}
