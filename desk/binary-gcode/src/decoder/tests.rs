//! Against an encoder of the tests' own; `tests/converter.rs` has files of Prusa's.
#![allow(clippy::unwrap_used)]

use std::io::Write;

use ferrostep_gcode::meatpack;
use flate2::write::ZlibEncoder;
use proptest::collection::vec;
use proptest::prelude::*;

use super::*;
use crate::{FileForm, Form};

/// Bits, the highest first.
#[derive(Default)]
struct Bits {
    bytes: Vec<u8>,
    count: usize,
}

impl Bits {
    fn put(&mut self, word: usize, count: u8) {
        for place in (0..count).rev() {
            if self.count.is_multiple_of(8) {
                self.bytes.push(0);
            }
            *self.bytes.last_mut().unwrap() |= ((word >> place & 1) as u8) << (7 - self.count % 8);
            self.count += 1;
        }
    }
}

/// Compresses by trying every distance.
fn heatshrink(data: &[u8], window_bits: u8) -> Vec<u8> {
    let mut bits = Bits::default();
    let mut at = 0;
    while at < data.len() {
        let length = |distance: usize| {
            (0..16).take_while(|&i| at + i < data.len() && data[at + i] == data[at + i - distance]).count()
        };
        let best = (1..=at.min(1 << window_bits)).max_by_key(|&distance| length(distance));
        match best.map(|distance| (distance, length(distance))) {
            Some((distance, count)) if count > 2 => {
                bits.put(0, 1);
                bits.put(distance - 1, window_bits);
                bits.put(count - 1, 4);
                at += count;
            }
            _ => {
                bits.put(1, 1);
                bits.put(data[at].into(), 8);
                at += 1;
            }
        }
    }
    bits.bytes
}

fn compressed(data: &[u8], compression: u16) -> Vec<u8> {
    match compression {
        0 => data.to_vec(),
        1 => {
            let mut encoder = ZlibEncoder::new(Vec::new(), flate2::Compression::default());
            encoder.write_all(data).unwrap();
            encoder.finish().unwrap()
        }
        2 => heatshrink(data, 11),
        _ => heatshrink(data, 12),
    }
}

fn header(version: u32, checksum: u16) -> Vec<u8> {
    [&b"GCDE"[..], &version.to_le_bytes(), &checksum.to_le_bytes()].concat()
}

/// A block of data that is compressed already.
fn block(kind: u16, compression: u16, parameters: &[u16], bytes: u32, stored: &[u8], has_checksum: bool) -> Vec<u8> {
    let mut block = [kind.to_le_bytes(), compression.to_le_bytes()].concat();
    block.extend(bytes.to_le_bytes());
    if compression != 0 {
        block.extend((stored.len() as u32).to_le_bytes());
    }
    block.extend(parameters.iter().flat_map(|parameter| parameter.to_le_bytes()));
    block.extend(stored);
    if has_checksum {
        block.extend(CRC.checksum(&block).to_le_bytes());
    }
    block
}

fn gcode_block(data: &[u8], compression: u16, encoding: u16) -> Vec<u8> {
    block(1, compression, &[encoding], data.len() as u32, &compressed(data, compression), true)
}

fn read(file: &[u8], portion: usize, room: usize) -> (Vec<u8>, Result<(), Error>) {
    let mut decoder = Decoder::new(Selection::ALL);
    let (mut output, mut text) = (vec![0; room], Vec::new());
    loop {
        let rest = file.get(decoder.position() as usize..).unwrap_or_default();
        match decoder.advance(&rest[..rest.len().min(portion)], &mut output) {
            Ok(Progress::More) => {}
            Ok(Progress::Contents(_, length)) => text.extend_from_slice(&output[..length]),
            Ok(Progress::End) => return (text, Ok(())),
            Err(error) => return (text, Err(error)),
        }
    }
}

fn refused(file: &[u8]) -> String {
    read(file, 100, 100).1.unwrap_err().to_string()
}

#[test]
fn what_is_wrong_is_named_with_its_place() {
    let start = header(1, 1);
    let good = gcode_block(b"G28\n", 0, 0);
    assert_eq!(read(&[&start[..], &good].concat(), 9, 9), (b"G28\n".to_vec(), Ok(())));
    let after_good = |bytes: &[u8]| refused(&[&start[..], &good, bytes].concat());
    let cases = [
        (refused(b""), "the file ends before its end: copy or export it again"),
        (refused(b"GCD"), "the file ends before its end: copy or export it again"),
        (refused(b"G28\n"), "not binary G-code: the file does not begin with GCDE"),
        (refused(b"G28 X Y Z ; home\n"), "not binary G-code: the file does not begin with GCDE"),
        (refused(&header(2, 1)), "binary G-code of version 2, expected version 1: export the file as text"),
        (refused(&header(1, 2)), "checksums of kind 2, expected 0 (none) or 1 (CRC-32): export the file again"),
        (refused(&start), "the file contains no G-code: export it again"),
        (
            after_good(&block(9, 0, &[0], 0, b"", true)),
            "block 2 at byte 28: a block of kind 9, expected 0 to 5: export the file as text",
        ),
        (
            after_good(&block(1, 4, &[0], 0, b"", true)),
            "block 2 at byte 28: compression 4, expected 0 to 3: export the file as text",
        ),
        (
            after_good(&gcode_block(b"G28\n", 0, 3)),
            "block 2 (G-code) at byte 28: encoding 3 is not known here: export the file as text",
        ),
        (
            after_good(&block(4, 0, &[1], 2, b"{}", true)),
            "block 2 (print metadata) at byte 28: encoding 1 is not known here: export the file as text",
        ),
        (
            after_good(&block(5, 0, &[3, 16, 16], 0, b"", true)),
            "block 2 at byte 28: encoding 3 is not known here: export the file as text",
        ),
        (
            after_good(&block(1, 0, &[0], 9, b"G1 X5\n", false)),
            "block 2 (G-code) at byte 28: the file ends before its end: copy or export it again",
        ),
        (
            after_good(&block(1, 1, &[0], 4, b"G28\n", true)),
            "block 2 (G-code) at byte 28: its compressed bytes are damaged: copy or export the file again",
        ),
        (
            after_good(&block(1, 1, &[0], 4, &[&compressed(b"G28\n", 1)[..], b"\0"].concat(), true)),
            "block 2 (G-code) at byte 28: its compressed bytes are damaged: copy or export the file again",
        ),
        (
            after_good(&block(1, 3, &[0], 3, &compressed(b"G28\n", 3), true)),
            "block 2 (G-code) at byte 28: its contents do not have the 3 bytes that its header says: copy or export \
             the file again",
        ),
        (
            after_good(&block(1, 3, &[0], 5, &compressed(b"G28\n", 3), true)),
            "block 2 (G-code) at byte 28: its contents do not have the 5 bytes that its header says: copy or export \
             the file again",
        ),
    ];
    for (said, expected) in cases {
        assert_eq!(said, expected);
    }
    let mut damaged = [&start[..], &good].concat();
    damaged[20] ^= 1;
    let crc = CRC.checksum(&damaged[10..24]);
    let stored = u32::from_le_bytes(damaged[24..28].try_into().unwrap());
    assert_eq!(
        refused(&damaged),
        format!(
            "block 1 (G-code) at byte 10: damaged: its checksum is {stored:08x}, that of its bytes {crc:08x}: copy or \
             export the file again"
        )
    );
}

/// Everything before a damaged block is returned, nothing from it on.
#[test]
fn blocks_before_a_damaged_one_are_given_out() {
    let file = [header(1, 1), gcode_block(b"G28\n", 3, 0), gcode_block(b"G1 X5\n", 3, 0)].concat();
    let mut damaged = file.clone();
    *damaged.last_mut().unwrap() ^= 1;
    for portion in [1, 1000] {
        assert_eq!(read(&file, portion, 4).0, b"G28\nG1 X5\n");
        let (text, outcome) = read(&damaged, portion, 4);
        assert_eq!(text, b"G28\n");
        assert!(matches!(outcome, Err(Error { block: 2, reason: Reason::Checksum { .. }, .. })));
    }
}

/// A repetition from before the first byte is zeros, as in the C library.
#[test]
fn the_window_is_empty_at_each_block() {
    let mut bits = Bits::default();
    bits.put(0, 1);
    bits.put(4, 12);
    bits.put(2, 4);
    let zeros = block(1, 3, &[0], 3, &bits.bytes, true);
    let file = [header(1, 1), gcode_block(b"G28 X Y Z\n", 3, 0), zeros].concat();
    assert_eq!(read(&file, 10, 10), (b"G28 X Y Z\n\0\0\0".to_vec(), Ok(())));
}

#[test]
fn it_fits_a_board() {
    // The limit excludes Deflate, whose window and tables are the rest.
    let inflate = std::mem::size_of::<Inflate>();
    assert!(std::mem::size_of::<Decoder>() - inflate < 4608);
    assert!(inflate < 48 * 1024);
}

fn text() -> impl Strategy<Value = Vec<u8>> {
    // Lines of a print, which repeat themselves, and bytes that do not.
    let lines =
        vec("G1 X[0-9]{2}\\.[0-9] Y[0-9]{2} E\\.0[0-9]\n", 0..300).prop_map(|lines| lines.concat().into_bytes());
    prop_oneof![lines, vec(any::<u8>(), 0..600), vec(prop_oneof![Just(b'a'), Just(b'b')], 0..9000)]
}

proptest! {
    #[test]
    fn what_is_compressed_comes_back(
        blocks in vec((text(), 0..4_u16), 1..4),
        portion in 1..3000_usize,
        room in 1..5000_usize,
        has_checksums: bool,
    ) {
        let mut file = header(1, has_checksums.into());
        let mut expected = Vec::new();
        for (data, compression) in &blocks {
            file.extend(block(1, *compression, &[0], data.len() as u32, &compressed(data, *compression), has_checksums));
            expected.extend_from_slice(data);
        }
        let (text, outcome) = read(&file, portion, room);
        prop_assert_eq!(outcome, Ok(()));
        prop_assert_eq!(text, expected);
    }

    #[test]
    fn what_is_packed_comes_back(lines in "([GMXYE0-9. ]{1,20}\n){1,30}", compression in 0..4_u16, portion in 1..200_usize) {
        let mut packed = meatpack::BEGIN.to_vec();
        // An empty line after each, as Prusa's packer may leave.
        meatpack::pack(&lines.replace('\n', "\n\n"), |byte| packed.push(byte));
        // The next block begins unpacked.
        let file = [header(1, 1), gcode_block(&packed, compression, 1), gcode_block(lines.as_bytes(), compression, 2)].concat();
        let (text, outcome) = read(&file, portion, portion);
        prop_assert_eq!(outcome, Ok(()));
        prop_assert_eq!(String::from_utf8(text).unwrap(), [&*lines, &*lines].concat());
    }

    #[test]
    fn what_is_written_anew_comes_back(
        (old, new) in (text(), text()),
        lines in "([GMXYE0-9.; \u{e9}]{1,20}\n){1,30}",
        compression in 0..4_u16,
        encoding in 0..3_u16,
        has_checksums: bool,
    ) {
        let header = header(1, has_checksums.into());
        let file = FileForm::of(&header).unwrap();
        let first = block(4, compression, &[0], old.len() as u32, &compressed(&old, compression), has_checksums);
        let form = Form::of(file, &first).unwrap();
        prop_assert_eq!((form.kind(), form.block_bytes()), (BlockKind::PrintMetadata, first.len() as u64));
        prop_assert_eq!(form.contents(&first).unwrap(), old);
        prop_assert_eq!(form.contents(&first[..first.len() - 5]).ok(), None);
        let head = block(1, compression, &[encoding], 0, b"", has_checksums);
        let gcode = Form::of(file, &head).unwrap().block(lines.as_bytes());
        prop_assert_eq!(&gcode[..4], &head[..4]);
        // Bytes that are not UTF-8 are not packed.
        let odd = Form::of(file, &head).unwrap().block(b"; \xff\xff\xfa\n");
        let (text, outcome) = read(&[header, form.block(&new), gcode, odd].concat(), 1000, 1000);
        prop_assert_eq!(outcome, Ok(()));
        prop_assert_eq!(text, [&new, lines.as_bytes(), b"; \xff\xff\xfa\n"].concat());
    }

    #[test]
    fn every_byte_sequence_is_answered(
        bytes in vec(prop_oneof![0..6_u8, any::<u8>()], 0..300),
        has_checksums: bool,
        room in 1..50_usize,
    ) {
        let file = [header(1, has_checksums.into()), bytes].concat();
        let (text, outcome) = read(&file, 64, room);
        // Heatshrink makes 16 bytes of 17 bits at most, Deflate 1032 of one byte,
        // MeatPack doubles them.
        prop_assert!(text.len() <= 2100 * file.len());
        prop_assert_eq!(read(&file, 1, 1000), (text, outcome));
    }
}
