//! Files of Prusa's own converter ([where they come from](data/README.md)) are read, whichever way
//! they are compressed and encoded.
#![allow(missing_docs, clippy::unwrap_used)]

use ferrostep_binary_gcode::{
    BlockKind, Decoder, Error, Progress, Reason, Selection, ThumbnailFormat, entries, seconds,
};

const TEXT: &str = include_str!("data/ring.gcode");

fn files() -> Vec<(String, Vec<u8>)> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "bgcode") {
            files.push((path.file_stem().unwrap().to_str().unwrap().to_owned(), std::fs::read(&path).unwrap()));
        }
    }
    assert_eq!(files.len(), 13);
    files
}

/// A block's kind and its contents.
type Block = (BlockKind, Vec<u8>);

/// Reads the selected blocks of a file that comes in portions of `portion` bytes, into output
/// of `room` bytes.
fn read(file: &[u8], selection: Selection, portion: usize, room: usize) -> Result<Vec<Block>, Error> {
    let mut decoder = Decoder::new(selection);
    let mut output = vec![0; room];
    let mut blocks: Vec<Block> = Vec::new();
    loop {
        let rest = file.get(decoder.position() as usize..).unwrap_or_default();
        match decoder.advance(&rest[..rest.len().min(portion)], &mut output)? {
            Progress::More => {}
            Progress::Contents(kind, length) => match blocks.last_mut() {
                Some((last, contents)) if *last == kind => contents.extend_from_slice(&output[..length]),
                _ => blocks.push((kind, output[..length].to_vec())),
            },
            Progress::End => return Ok(blocks),
        }
    }
}

fn gcode(file: &[u8], portion: usize, room: usize) -> String {
    let blocks = read(file, Selection::GCODE, portion, room).unwrap();
    assert!(blocks.iter().all(|(kind, _)| *kind == BlockKind::Gcode));
    String::from_utf8(blocks.into_iter().flat_map(|(_, contents)| contents).collect()).unwrap()
}

/// The commands of a text, without comments; without the spaces of G commands, which
/// MeatPack leaves out.
fn commands(text: &str) -> Vec<String> {
    let mut commands = Vec::new();
    for line in text.lines() {
        let command = line.split(';').next().unwrap_or_default().trim();
        match command.chars().next() {
            Some('G') => commands.push(command.replace(' ', "")),
            Some(_) => commands.push(command.to_owned()),
            None => {}
        }
    }
    commands
}

#[test]
fn every_compression_and_encoding_gives_the_commands() {
    for (name, file) in files() {
        let text = gcode(&file, 512, 128);
        assert_eq!(commands(&text), commands(TEXT), "{name}");
        assert!(text.contains("M117 Layer 1, Extruder E\n"), "{name}");
        let is_packed = name.ends_with('1') || name.ends_with('2');
        assert!(!is_packed || !text.contains("\n\n"), "{name}");
        let has_comments = !name.ends_with('1');
        assert_eq!(text.matches(";LAYER_CHANGE\n").count(), if has_comments { 3 } else { 0 }, "{name}");
        for (portion, room) in [(1, 1), (1, 64), (64, 1), (7, 3), (100_000, 100_000)] {
            assert_eq!(gcode(&file, portion, room), text, "{name}, portions of {portion} and {room} bytes");
        }
    }
}

#[test]
fn metadata_and_pictures() {
    for (name, file) in files() {
        let blocks = read(&file, Selection::DESCRIPTION, 100, 33).unwrap();
        let text = |wanted: BlockKind| {
            let (_, contents) = blocks.iter().find(|(kind, _)| *kind == wanted).unwrap();
            String::from_utf8(contents.clone()).unwrap()
        };
        let value = |wanted, key| entries(&text(wanted)).find(|(at, _)| *at == key).map(|(_, value)| value.to_owned());
        assert_eq!(value(BlockKind::FileMetadata, "Producer").unwrap(), "PrusaSlicer 2.9.2", "{name}");
        assert_eq!(value(BlockKind::PrinterMetadata, "printer_model").unwrap(), "MINI", "{name}");
        assert_eq!(value(BlockKind::SlicerMetadata, "printer_notes").unwrap(), "a = b", "{name}");
        let time = value(BlockKind::PrintMetadata, "estimated printing time (normal mode)").unwrap();
        assert_eq!(seconds(&time), Some(3723), "{name}");
        assert_eq!(value(BlockKind::PrintMetadata, "filament used [mm]").unwrap(), "12.57", "{name}");
        let picture = BlockKind::Thumbnail { format: ThumbnailFormat::Png, width: 16, height: 16 };
        let (_, bytes) = blocks.iter().find(|(kind, _)| *kind == picture).unwrap();
        assert!(bytes.starts_with(b"\x89PNG") && bytes.ends_with(b"IEND\xaeB`\x82"), "{name}");
        // All of it in one go is the same.
        let all = read(&file, Selection::ALL, 4096, 4096).unwrap();
        assert_eq!(all.iter().filter(|(kind, _)| *kind != BlockKind::Gcode).cloned().collect::<Vec<_>>(), blocks);
    }
}

/// Every byte in turn is damaged: with checksums no line of a damaged block comes out, nor is the
/// damage overlooked.
#[test]
fn damage_is_found_before_its_lines_are_given_out() {
    for (name, file) in files() {
        let has_checksums = name != "ring-no-checksum";
        let whole = gcode(&file, 4096, 4096);
        for place in 0..file.len() {
            let mut damaged = file.clone();
            damaged[place] ^= 1 << (place % 8);
            let mut decoder = Decoder::new(Selection::GCODE);
            let (mut output, mut text) = ([0; 256], Vec::new());
            let outcome = loop {
                let rest = damaged.get(decoder.position() as usize..).unwrap_or_default();
                match decoder.advance(rest, &mut output) {
                    Ok(Progress::More) => {}
                    Ok(Progress::Contents(_, length)) => text.extend_from_slice(&output[..length]),
                    Ok(Progress::End) => break Ok(()),
                    Err(error) => break Err(error),
                }
            };
            // The kind of checksum, in the header, is covered by none.
            if has_checksums && place != 8 {
                assert!(outcome.is_err(), "{name}: byte {place}");
                assert!(text.is_empty(), "{name}: byte {place}: the only block of G-code is damaged or not reached");
                assert_eq!(decoder.advance(b"GCDE", &mut output).unwrap_err(), outcome.unwrap_err());
            } else if outcome.is_ok() {
                assert!(text.len() <= 2 * whole.len());
            }
        }
    }
}

#[test]
fn a_file_that_ends_early_says_so() {
    for (name, file) in files() {
        let mut ends_of_blocks = 0;
        for length in 0..file.len() {
            match read(&file[..length], Selection::GCODE, 999, 999) {
                // The last block is the only one of G-code.
                Ok(_) => panic!("{name}: {length} bytes"),
                Err(Error { reason: Reason::Truncated, .. }) => {}
                Err(Error { reason: Reason::NoGcode, .. }) => ends_of_blocks += 1,
                Err(error) => panic!("{name}: {length} bytes: {error}"),
            }
        }
        assert_eq!(ends_of_blocks, 6, "{name}: the header, and the blocks before the G-code");
    }
}
