//! A serial line that is faster than its reader: whole lines are executed or dropped, never
//! two halves joined.

use std::cell::RefCell;

use ferrostep_printer::Host;
use ferrostep_testkit::host_side::{PortBuffers, numbered};
use ferrostep_usb::{Heard, Incoming, Lines};

use crate::end_to_end::desk::profile;
use crate::end_to_end::hosts::{Machine, machine};
use crate::end_to_end::repeats::Seeded;

/// Sends lines without waiting; the board reads one byte of the ring while `slowness` come. Returns
/// its replies, in order.
fn send(machine: &Machine, lines: &[String], room: usize, slowness: usize, random: &mut Seeded) -> (Vec<String>, u32) {
    let mut ring = PortBuffers { room, ..PortBuffers::default() };
    let (mut incoming, mut reader, mut host) = (Incoming::new(), Lines::new(), Host::new());
    let (mut printer, said) = (machine.printer(), RefCell::new(Vec::new()));
    let mut lost = 0;
    let mut read = |ring: &mut PortBuffers| {
        let Some(byte) = ring.bytes.pop_front() else { return };
        let byte = [byte];
        let line = match reader.feed(&byte).1 {
            Some(Heard::Line(line)) => line,
            Some(Heard::HalfALine(incomplete)) => Err(incomplete),
            None => return,
        };
        machine.run(host.answer(&mut printer, line));
        said.borrow_mut().extend(machine.replies().take());
    };
    for byte in lines.iter().flat_map(|line| line.bytes().chain(*b"\n")) {
        lost += incoming.take_in(&[byte], &mut ring);
        if random.below(slowness) == 0 {
            read(&mut ring);
        }
    }
    while !ring.bytes.is_empty() {
        read(&mut ring);
    }
    // The host's next line is heard, and closes the one that was broken off.
    for byte in *b"M105\n" {
        lost += incoming.take_in(&[byte], &mut ring);
        read(&mut ring);
        read(&mut ring);
    }
    (said.into_inner(), lost)
}

#[test]
fn overflowing_input_never_joins_two_lines() {
    let mut random = Seeded::new(31);
    let mut broken = 0;
    for room in [3, 8, 13, 40, 100] {
        for slowness in [2, 3, 5] {
            let machine = machine(&profile("cartesian"));
            let lines: Vec<String> = (0..300).flat_map(|_| ["G92 X11111", "M114"]).map(str::to_owned).collect();
            let (said, lost) = send(&machine, &lines, room, slowness, &mut random);
            assert!(lost > 0);
            for reply in &said {
                // Only positions 0 and the one that was sent.
                if let Some(position) = reply.strip_prefix("X:") {
                    assert!(position.starts_with("0.00 ") || position.starts_with("11111.00 "), "{reply}");
                }
                let is_known = ["X:", "ok", "echo:line "].iter().any(|start| reply.starts_with(start));
                assert!(is_known && !reply.contains("nknown"), "{reply}");
            }
            broken += said.iter().filter(|reply| reply.contains("part of the line was lost")).count();
            // Each line that was begun is answered once.
            let answers = said.iter().filter(|reply| reply.starts_with("ok")).count();
            let echoes = said.iter().filter(|reply| reply.starts_with("echo:")).count();
            let positions = said.iter().filter(|reply| reply.starts_with("X:")).count();
            assert!(answers > echoes + positions && answers < lines.len(), "{answers} {echoes} {positions}");
        }
    }
    assert!(broken > 100, "{broken}");
}

#[test]
fn a_broken_numbered_line_is_requested_again() {
    let mut random = Seeded::new(32);
    let machine = machine(&profile("cartesian"));
    let lines: Vec<String> = (1..100).map(|number| numbered(number, &format!("G1 X{number} F600"))).collect();
    let (said, lost) = send(&machine, &lines, 30, 4, &mut random);
    assert!(lost > 0);
    // Only requests for the same line follow the first loss.
    let first = said.iter().position(|reply| reply.starts_with("Error:")).unwrap();
    assert!(said[..first].iter().all(|reply| reply == "ok"), "{said:?}");
    let wanted = said.iter().find(|reply| reply.starts_with("Resend: ")).unwrap();
    assert_eq!(*wanted, format!("Resend: {}", first + 1));
    for reply in said[first..].iter().filter(|reply| reply.starts_with("Resend: ")) {
        assert_eq!(reply, wanted);
    }
}
