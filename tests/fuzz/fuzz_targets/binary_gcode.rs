//! Any bytes are binary G-code or an error that can be told; in portions of any size
//! they give the same.
//!
//! A fuzzer does not find checksums: the first byte says whether the blocks' are mended, and
//! whether the input is a whole file or blocks to which a header is added.
#![no_main]

use ferrostep_binary_gcode::{Decoder, Error, Progress, Reason, Selection};
use libfuzzer_sys::fuzz_target;

/// Maximum number of bytes that are read: 100 bytes may repeat themselves endlessly.
const MAX_BYTES: usize = 1 << 20;

fn read(file: &[u8], selection: Selection, portion: usize, room: usize) -> (Vec<u8>, Option<Error>) {
    let mut decoder = Decoder::new(selection);
    let (mut output, mut text) = (vec![0; room], Vec::new());
    loop {
        let before = decoder.position();
        let rest = file.get(decoder.position() as usize..).unwrap_or_default();
        match decoder.advance(&rest[..rest.len().min(portion)], &mut output) {
            // Without bytes it comes to an end.
            Ok(Progress::More) => assert!(!rest.is_empty() || decoder.position() >= before),
            Ok(Progress::Contents(_, length)) => {
                assert!((1..=room).contains(&length));
                text.extend_from_slice(&output[..length]);
                if text.len() > MAX_BYTES {
                    text.truncate(MAX_BYTES);
                    return (text, None);
                }
            }
            Ok(Progress::End) => return (text, None),
            Err(error) => {
                assert!(!error.to_string().is_empty() && error.offset <= file.len() as u64 + 4);
                return (text, Some(error));
            }
        }
    }
}

/// The file with the checksum of each block made right.
fn mended(mut file: Vec<u8>) -> Vec<u8> {
    let u16_at = |file: &[u8], at: usize| file.get(at..at + 2).map(|bytes| u16::from_le_bytes([bytes[0], bytes[1]]));
    let u32_at =
        |file: &[u8], at: usize| file.get(at..at + 4).map(|bytes| u32::from_le_bytes(bytes.try_into().unwrap()));
    let mut start = 10;
    while let (Some(kind), Some(compression)) = (u16_at(&file, start), u16_at(&file, start + 2)) {
        let (head, size) = if compression == 0 { (8, start + 4) } else { (12, start + 8) };
        let Some(size) = u32_at(&file, size) else { break };
        let parameters = if kind == 5 { 6 } else { 2 };
        let end = start + head + parameters + size as usize;
        let Some(block) = file.get(start..end) else { break };
        let sum = crc32fast::hash(block).to_le_bytes();
        let Some(place) = file.get_mut(end..end + 4) else { break };
        place.copy_from_slice(&sum);
        start = end + 4;
    }
    file
}

fuzz_target!(|input: &[u8]| {
    let Some((&mode, bytes)) = input.split_first() else { return };
    let mut file = bytes.to_vec();
    if mode & 1 != 0 {
        let checksums = mode >> 1 & 1;
        file = [&b"GCDE\x01\0\0\0"[..], &[checksums, 0], bytes].concat();
    }
    if mode & 4 != 0 {
        file = mended(file);
    }
    let selection = [Selection::ALL, Selection::GCODE, Selection::DESCRIPTION][usize::from(mode >> 3) % 3];
    let (text, error) = read(&file, selection, 4096, 1000);
    let (portion, room) = (1 + usize::from(mode >> 4), 1 + usize::from(mode >> 5));
    let (other_text, other_error) = read(&file, selection, portion, room);
    if error.is_some_and(|error| error.reason == Reason::Deflate) {
        // Deflate decides how far damaged bytes are read.
        let [shorter, longer] = if text.len() < other_text.len() { [&text, &other_text] } else { [&other_text, &text] };
        assert!(longer.starts_with(shorter) && other_error.is_some());
        return;
    }
    assert_eq!((other_text, other_error), (text, error));
});
