//! Frames of a transfer: whatever comes on the line, only bytes that were sent as such are taken,
//! and the host is answered.
#![no_main]

use ferrostep_gpre::parts::{Part, Parts};
use ferrostep_gpre::transfer::{Event, Kind, Receiver, Report, to_wire};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    // The file is the payload of its frames; between the frames come the fuzzer's bytes.
    let file: Vec<u8> = (0..2000u32).map(|index| (index * 7 + (index >> 3)) as u8).collect();
    let mut receiver = Receiver::new(file.len() as u32);
    let mut buffer = vec![0; file.len()];
    let mut filled = 0;
    let mut take = |line: &[u8]| {
        for &byte in line {
            if let Event::Bytes(length) = receiver.take(byte, &mut buffer[filled..]) {
                filled += length;
            }
            let Report { numbers: [next, limit], .. } = receiver.report(file.len() - filled);
            assert!(next as usize == filled && next <= limit && limit as usize <= file.len());
        }
    };
    for noise in bytes.chunks(90) {
        let place = noise.iter().map(|&byte| usize::from(byte)).sum::<usize>() % file.len();
        let end = file.len().min(place + 100);
        let mut frame = to_wire(Kind::Data, place as u32, &file[place..end]);
        let at = place % frame.len();
        if noise[0] & 1 == 0 {
            frame[at] ^= noise[noise.len() - 1];
        }
        take(&frame);
        take(noise);
    }
    assert!(buffer[..filled] == file[..filled]);
    // The same bytes as a file's.
    let (mut parts, mut rest) = (Parts::new(), bytes);
    while let Ok(part) = parts.next(rest, true) {
        let used = match part {
            Part::More | Part::End => break,
            Part::Passed(length) | Part::Header(length, _) | Part::Frame { length, .. } => length,
        };
        assert!(used > 0 && used <= rest.len());
        rest = &rest[used..];
    }
});
