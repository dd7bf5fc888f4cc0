//! Hosts that vanish, sleep, stop reading, or never stop sending.

use ferrostep_gcode::Emergency;
use ferrostep_usb::{BREAK, Heard, Lines};

use crate::usb::device::Device;
use crate::usb::host::PACKET_BYTES;

/// The lines that a reader finds in the ring; `None` for half a line.
pub fn heard(bytes: &[u8]) -> Vec<Option<String>> {
    let (mut lines, mut rest, mut heard) = (Lines::new(), bytes, Vec::new());
    while !rest.is_empty() {
        let (used, what) = lines.feed(rest);
        assert!(used > 0);
        rest = &rest[used..];
        heard.extend(what.map(|what| match what {
            Heard::Line(line) => Some(line.unwrap().text.to_owned()),
            Heard::HalfALine(_) => None,
        }));
    }
    heard
}

fn line(text: &str) -> Option<String> {
    Some(text.to_owned())
}

#[test]
fn a_reset_drops_only_the_unfinished_line() {
    let device = Device::new();
    let mut host = device.host();
    host.plug_in();
    host.send(b"G28\nG1 X1");
    host.plug_in();
    host.send(b"00\nM105\n");
    host.plug_in();
    host.send(b"M114\n");
    assert_eq!(heard(&device.take_received()), [line("G28"), None, line("00"), line("M105"), line("M114")]);
}

#[test]
fn closing_the_port_in_mid_line_drops_that_line() {
    let device = Device::new();
    let mut host = device.host();
    host.plug_in();
    host.set_open(true);
    host.send(b"G1 X1");
    host.set_open(false);
    host.set_open(true);
    host.send(b"00\n");
    assert_eq!(heard(&device.take_received()), [None, line("00")]);
}

#[test]
fn a_reset_forgets_half_an_emergency_command() {
    let device = Device::new();
    let mut host = device.host();
    host.plug_in();
    host.send(b"M11");
    host.plug_in();
    host.send(b"2\n");
    assert_eq!(device.take_emergencies(), []);
    host.send(b"M112\n");
    assert_eq!(device.take_emergencies(), [Emergency::Stop]);
}

#[test]
fn a_suspended_host_resumes() {
    let device = Device::new();
    let mut host = device.host();
    host.plug_in();
    host.set_open(true);
    host.send(b"G1 X1");
    host.suspend();
    device.reply("ok");
    host.resume();
    host.send(b"00\n");
    assert_eq!(heard(&device.take_received()), [line("G1 X100")]);
    assert_eq!(host.read_lines(), ["ok"]);
    // Pulled in its sleep, plugged in again.
    host.send(b"G1 Y1");
    host.suspend();
    host.plug_in();
    host.send(b"M105\n");
    assert_eq!(heard(&device.take_received()), [None, line("M105")]);
}

#[test]
fn a_host_that_does_not_read_blocks_nothing() {
    let device = Device::new();
    let mut host = device.host();
    host.plug_in();
    host.set_open(true);
    let said: Vec<String> = (0..500).map(|number| format!("echo:line {number}")).collect();
    said.iter().for_each(|line| device.reply(line));
    let kept = host.read_lines();
    assert_eq!(kept, said[..kept.len()], "what was kept is whole and in order");
    assert!((100..200).contains(&kept.len()), "{} lines", kept.len());
    device.reply("ok");
    assert_eq!(
        host.read_lines(),
        [format!("echo:usb: nobody read, {} lines dropped", said.len() - kept.len()), "ok".into()]
    );
    device.reply("ok");
    assert_eq!(host.read_lines(), ["ok"]);
}

#[test]
fn reports_leave_room_for_replies() {
    let device = Device::new();
    let mut host = device.host();
    host.plug_in();
    host.set_open(true);
    for _ in 0..1000 {
        device.report(" T:20.00 /0.00 B:20.00 /0.00 @:0 B@:0");
    }
    for _ in 0..200 {
        device.reply("ok");
    }
    let lines = host.read_lines();
    assert_eq!(lines.iter().filter(|line| *line == "ok").count(), 200, "{lines:?}");
    assert!(lines.iter().filter(|line| line.starts_with(" T:")).count() > 10, "{lines:?}");
    assert!(lines.iter().any(|line| line.starts_with("echo:usb: nobody read, ")), "{lines:?}");
}

#[test]
fn unread_output_is_not_sent_to_the_next_program() {
    let device = Device::new();
    let mut host = device.host();
    device.report("start");
    host.plug_in();
    host.plug_in();
    // The first host reads the lines from before it came ...
    host.set_open(true);
    assert_eq!(host.read_lines(), ["start"]);
    // ... the next does not. It begins with a whole line, although the one before had
    // read half of one.
    device.reply(format_args!("ok {}", "x".repeat(PACKET_BYTES)));
    assert_eq!(host.read_packet().map(|packet| packet.len()), Some(PACKET_BYTES));
    assert_eq!(host.read_packet().map(|packet| packet.len()), Some(4));
    device.reply(format_args!("ok {}", "y".repeat(2 * PACKET_BYTES)));
    host.set_open(false);
    device.report("echo:nobody is here");
    host.set_open(true);
    device.reply("ok");
    let lines = host.read_lines();
    assert_eq!(lines.last().map(String::as_str), Some("ok"));
    assert!(lines.len() <= 2 && lines[0].chars().all(|letter| "ok y".contains(letter)), "{lines:?}");
    // After a reset not even the controller's own packet is left.
    device.reply("echo:lost");
    host.plug_in();
    host.set_open(true);
    device.reply("ok");
    assert_eq!(host.read(), b"ok\n");
}

#[test]
fn an_emergency_stop_is_seen_in_a_flood_of_lines() {
    let device = Device::new();
    let mut host = device.host();
    host.plug_in();
    let said: Vec<String> = (0..1000).map(|number| format!("G1 X{number}")).collect();
    for (number, text) in said.iter().enumerate() {
        host.send(format!("{text}\n").as_bytes());
        if number == 800 {
            host.send(b"M112\n");
            assert_eq!(device.take_emergencies(), [Emergency::Stop]);
        }
    }
    let received = device.take_received();
    let sent: usize = said.iter().map(|text| text.len() + 1).sum::<usize>() + 5;
    assert_eq!(received.len() + device.dropped() as usize, sent, "each byte is received or counted");
    // The last of the lines is not whole, which the next byte tells.
    host.send(b"M105\n");
    let rest = device.take_received();
    assert_eq!(rest.first(), Some(&BREAK));
    let lines = heard(&[received, rest].concat());
    let whole = lines.len() - 2;
    assert!(whole > 200, "{whole} lines");
    assert!(lines[..whole].iter().zip(&said).all(|(heard, said)| heard.as_ref() == Some(said)));
    assert_eq!(lines[whole..], [None, line("M105")]);
    host.set_open(true);
}

/// The driver panics at a speed that it does not know, and with it the print would end.
#[test]
fn a_faulty_controller_is_left_alone() {
    let device = Device::new();
    let mut host = device.host();
    host.plug_in();
    host.set_open(true);
    host.send(b"M105\n");
    let before = device.bus().polls();
    device.bus().break_down();
    // Interrupts still come, and lines are still written.
    device.interrupt();
    device.reply("ok");
    device.report("echo:still here");
    assert_eq!(device.bus().polls(), before);
    assert_eq!(heard(&device.take_received()), [line("M105")], "what came before is read");
}
