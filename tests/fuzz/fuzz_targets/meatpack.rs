//! Any bytes are unpacked, whatever they switch on and off, and a reset makes the line plain
//! again; what is packed comes back. What a port receives of them gives lines, and an emergency
//! only where one was sent.
#![no_main]

use ferrostep_gcode::Emergency;
use ferrostep_gcode::meatpack::{BEGIN, END, Settings, Unpacker, pack};
use ferrostep_testkit::host_side::PortBuffers;
use ferrostep_usb::Incoming;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    let (mut unpacker, mut text, mut reports) = (Unpacker::new(), Vec::new(), Vec::new());
    for &byte in input {
        let unpacked = unpacker.feed(byte);
        assert!(unpacked.bytes().is_empty() || unpacked.report.is_none());
        text.extend_from_slice(unpacked.bytes());
        reports.extend(unpacked.report);
    }
    assert!(text.len() <= 2 * input.len());
    if !input.contains(&0xff) {
        assert_eq!(text, input);
    }

    // A port gives the same, whatever the portions; a host's own FF becomes another byte that
    // is not of UTF-8.
    let (mut incoming, mut ring) = (Incoming::new(), PortBuffers::default());
    for portion in input.chunks(7) {
        assert_eq!(incoming.take_in(portion, &mut ring), 0);
    }
    let plain: Vec<u8> = text.iter().map(|&byte| if byte == 0xff { 0xfe } else { byte }).collect();
    assert_eq!((Vec::from(ring.bytes), ring.reports), (plain, reports));
    let has_digits = |bytes: &[u8]| bytes.windows(3).any(|digits| digits == b"112");
    assert!(!ring.emergencies.contains(&Emergency::Stop) || has_digits(&text) || has_digits(input));

    for byte in END {
        unpacker.feed(byte);
    }
    assert_eq!(unpacker.settings(), Settings::default());
    assert_eq!(unpacker.feed(b'G').bytes(), b"G");

    if let Ok(line) = std::str::from_utf8(input) {
        let mut packed = BEGIN.to_vec();
        pack(line, |byte| packed.push(byte));
        let mut back = Vec::new();
        for byte in packed {
            back.extend_from_slice(unpacker.feed(byte).bytes());
        }
        // Half a byte that was over holds a line end.
        assert!(back.strip_prefix(line.as_bytes()).is_some_and(|rest| rest.is_empty() || rest == b"\n"));
    }
});
