//! Input that no host should send, in the middle of a print: the image answers it, and not a
//! single step changes.

use crate::firmware::bench::{Bench, Line};
use crate::firmware::host::Host;
use crate::firmware::job::Job;
use crate::firmware::same_steps::{LINES, assert_printed_as_rehearsed};

/// Lines of the job after which the motors run, with as much motion at hand as the image takes.
const LINES_INTO_THE_PRINT: usize = 100;

/// Line before which the job pauses, so that a silent host does not affect the look-ahead.
const PAUSE: usize = 160;

/// Lines in a burst: as many bytes as the image's receive buffer holds while a
/// command waits for room.
const BURST: usize = 240;

/// Sends lines without numbers and waits for the `ok` of each.
fn answered(host: &mut Host<Line>, bytes: &[u8], lines: usize) {
    host.send_raw(bytes).unwrap();
    for line in 0..lines {
        host.wait_for(&format!("ok {} of {lines}", line + 1), |line| line.starts_with("ok")).unwrap();
    }
}

/// Sends bytes that look like a numbered line and waits for its resend request.
fn resend_requested(host: &mut Host<Line>, bytes: &[u8], number: usize) {
    host.send_raw(bytes).unwrap();
    let resend = format!("Resend: {number}");
    host.wait_for(&resend, |line| line == resend).unwrap();
    host.wait_for("ok", |line| line == "ok").unwrap();
}

/// Lines of bytes that are not text.
fn garbage(lines: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    for line in 0..lines {
        bytes.extend((0..40).map(|index| ((line * 37 + index * 11) % 128) as u8 | 0x80));
        // A NUL, a control character and half of a command.
        bytes.extend(b"\0\x07M1");
        bytes.push(b'\n');
    }
    bytes
}

#[test]
fn nonsense_in_mid_print_is_answered_and_changes_no_step() {
    let mut job = Job::cube(LINES).without_heating().without_homing();
    job.insert(PAUSE, "M400");
    let mut bench = Bench::boot();
    for (index, line) in job.lines().enumerate() {
        let host = &mut bench.host;
        // Lines are numbered from 1, so this is the number of the next line.
        let number = index + 1;
        // The motors keep moving for as long as there is motion at hand: 1 s, which the lines
        // between bring back.
        match index.wrapping_sub(LINES_INTO_THE_PRINT) {
            0 => answered(host, &garbage(20), 20),
            10 => {
                answered(host, &[&[b'x'; 1000], b"\n".as_slice()].concat(), 1);
                resend_requested(host, format!("N{number} {}\n", "G".repeat(1000)).as_bytes(), number);
            }
            20 | 30 => answered(host, &b"M105\n".repeat(BURST / 2), BURST / 2),
            40 => answered(host, &b"\n\r\n;\n".repeat(50), 0),
            _ => {}
        }
        if index == PAUSE + 1 {
            for _ in 0..9 {
                answered(host, &b"M105\n".repeat(BURST), BURST);
            }
            host.send_raw(format!("N{number} G1 X50").as_bytes()).unwrap();
            let heard = host.listen(500).unwrap();
            assert!(!heard.iter().any(|line| line.starts_with("ok")), "half a line was answered: {heard:?}");
            resend_requested(host, b"\n", number);
        }
        host.send(line).unwrap_or_else(|error| panic!("{}: {error}", job.source(number)));
    }
    assert_printed_as_rehearsed(bench, &job);
}
