//! Sliced 3MF files, which Bambu Studio and OrcaSlicer export: zip archives with the G-code
//! of their plates.

use std::ffi::OsStr;
use std::io::Write;
use std::path::Path;

use flate2::write::DeflateEncoder;
use flate2::{Compression, Crc};

use crate::end_to_end::command::{Outcome, directory, ferrostep};

/// Form in which an entry is written.
#[derive(Clone, Copy, PartialEq)]
enum Packed {
    Stored,
    Deflated,
    /// Marked as packed by another method, which the program does not know.
    Zstd,
    Encrypted,
    /// Deflated, with a wrong checksum.
    Damaged,
    /// Deflated, with one byte less in its given length than in its contents.
    Longer,
}

/// A zip archive of these entries: paths, contents.
fn archive(entries: &[(&str, &[u8], Packed)]) -> Vec<u8> {
    let (mut out, mut directory) = (Vec::new(), Vec::new());
    for &(path, contents, packed) in entries {
        let data = if packed == Packed::Stored {
            contents.to_vec()
        } else {
            let mut encoder = DeflateEncoder::new(Vec::new(), Compression::best());
            encoder.write_all(contents).unwrap();
            encoder.finish().unwrap()
        };
        let mut crc = Crc::new();
        crc.update(contents);
        let sum = crc.sum() ^ u32::from(packed == Packed::Damaged);
        let method: u16 = match packed {
            Packed::Stored => 0,
            Packed::Zstd => 93,
            _ => 8,
        };
        let length = contents.len() as u32 - u32::from(packed == Packed::Longer);
        // Version, flags, method, time, date, checksum, sizes, lengths of name and extra fields.
        let mut common = vec![20, 0, u8::from(packed == Packed::Encrypted), 0];
        common.extend(method.to_le_bytes());
        common.extend([0; 4]);
        for number in [sum, data.len() as u32, length] {
            common.extend(number.to_le_bytes());
        }
        common.extend((path.len() as u16).to_le_bytes());
        common.extend([0; 2]);
        let offset = out.len() as u32;
        out.extend([b"PK\x03\x04", &common[..], path.as_bytes(), &data].concat());
        directory.extend([b"PK\x01\x02\x14\0", &common[..], &[0; 10], &offset.to_le_bytes(), path.as_bytes()].concat());
    }
    let count = (entries.len() as u16).to_le_bytes();
    let sizes = [directory.len() as u32, out.len() as u32].map(u32::to_le_bytes);
    [&out[..], &directory, b"PK\x05\x06\0\0\0\0", &count, &count, &sizes[0], &sizes[1], &[0; 2]].concat()
}

const TYPES: (&str, &[u8], Packed) = ("[Content_Types].xml", b"<Types/>", Packed::Deflated);
const MODEL: (&str, &[u8], Packed) = ("3D/3dmodel.model", b"<model/>", Packed::Deflated);

fn run(command: &str, path: &Path, more: &[&str]) -> Outcome {
    let arguments = [OsStr::new(command), path.as_os_str()];
    ferrostep(arguments.into_iter().chain(more.iter().map(OsStr::new)))
}

/// Prints an archive.
fn print(bytes: &[u8], more: &[&str]) -> Outcome {
    let directory = directory();
    let path = directory.path().join("sliced.gcode.3mf");
    std::fs::write(&path, bytes).unwrap();
    run("print", &path, &[&["--json"], more].concat())
}

#[track_caller]
fn ends_at(outcome: &Outcome, x: f64) {
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    assert_eq!(outcome.json()["position_mm"]["x"], x);
}

#[track_caller]
fn is_refused(outcome: &Outcome, says: &str) {
    assert_eq!(outcome.status, Some(2), "{outcome:#?}");
    assert!(outcome.stderr.contains(says), "{outcome:#?}");
}

#[test]
fn the_only_plate_is_the_job() {
    for (path, packed) in [
        ("Metadata/plate_1.gcode", Packed::Deflated),
        ("Metadata/plate_2.gcode", Packed::Stored),
        ("/Metadata/plate_17.gcode", Packed::Deflated),
    ] {
        let plate: (&str, &[u8], Packed) = (path, b"G28\nG1 X20 F3000\n", packed);
        let sum: (&str, &[u8], Packed) = ("Metadata/plate_1.gcode.md5", b"0", Packed::Deflated);
        ends_at(&print(&archive(&[TYPES, MODEL, plate, sum]), &[]), 20.0);
    }
}

#[test]
fn one_of_several_plates_is_chosen() {
    let plates = archive(&[
        TYPES,
        ("Metadata/plate_3.gcode", b"G28\nG1 X30 F3000\n", Packed::Deflated),
        ("Metadata/plate_1.gcode", b"G28\nG1 X10 F3000\n", Packed::Deflated),
    ]);
    ends_at(&print(&plates, &["--plate", "1"]), 10.0);
    ends_at(&print(&plates, &["--plate", "3"]), 30.0);
    is_refused(&print(&plates, &[]), "this is a sliced 3MF with 2 plates (1, 3): choose one with --plate N");
    is_refused(&print(&plates, &["--plate", "2"]), "without a plate 2, expected --plate with one of 1, 3");
    is_refused(&print(b"G28\n", &["--plate", "1"]), "--plate is for a sliced 3MF");
    let directory = directory();
    let path = directory.path().join("two.gcode.3mf");
    std::fs::write(&path, &plates).unwrap();
    let out = directory.path().join("two.gpre");
    let prepared = run("preprocess", &path, &["--plate", "3", "-o", out.to_str().unwrap()]);
    assert_eq!(prepared.status, Some(0), "{prepared:#?}");
    ends_at(&run("print", &out, &["--json"]), 30.0);
    ends_at(&run("estimate", &path, &["--plate", "1", "--json"]), 10.0);
}

#[test]
fn a_thousand_plates_are_listed_by_the_first_and_the_last() {
    let names: Vec<String> = (1..=1000).map(|plate| format!("Metadata/plate_{plate}.gcode")).collect();
    let entries: Vec<_> =
        names.iter().map(|name| (name.as_str(), &b"G28\nG1 X20 F3000\n"[..], Packed::Stored)).collect();
    let plates = archive(&entries);
    is_refused(&print(&plates, &[]), "with 1000 plates (1, 2, 3, 4, 5, 6, 7, 8, 9, 10 ... 1000)");
    ends_at(&print(&plates, &["--plate", "777"]), 20.0);
}

#[test]
fn archives_without_gcode_say_what_to_do() {
    is_refused(&print(&archive(&[TYPES, MODEL]), &[]), "3MF project, which holds a model and no G-code: slice it");
    let other = archive(&[("cube.gcode", b"G28\n", Packed::Deflated)]);
    is_refused(&print(&other, &[]), "this is a zip archive: unpack it");
    is_refused(&print(&archive(&[]), &[]), "this is a zip archive");
}

#[test]
fn damaged_and_malicious_archives_are_refused_before_a_line_is_executed() {
    let plate = |contents: &[u8], packed| archive(&[TYPES, ("Metadata/plate_1.gcode", contents, packed)]);
    let gcode = b"G28\nG1 X20 F3000\n";
    is_refused(&print(&plate(gcode, Packed::Encrypted), &[]), "plate 1 of this sliced 3MF is encrypted");
    is_refused(&print(&plate(gcode, Packed::Zstd), &[]), "not packed by Deflate");
    for packed in [Packed::Damaged, Packed::Longer] {
        is_refused(
            &print(&plate(gcode, packed), &[]),
            "damaged 3MF or zip archive (plate 1: wrong checksum or length)",
        );
    }
    let twice = ("Metadata/plate_1.gcode", &gcode[..], Packed::Stored);
    is_refused(&print(&archive(&[twice, twice]), &[]), "plate 1 is in it twice");
    let bomb = vec![b'\n'; 20 << 20];
    is_refused(&print(&plate(&bomb, Packed::Deflated), &[]), "more than a job can be");
    // An archive within an archive is not a job.
    is_refused(&print(&plate(&plate(gcode, Packed::Stored), Packed::Stored), &[]), "not a text file");
    is_refused(&print(&plate(b"", Packed::Stored), &[]), "the file is empty");
    // Cut off anywhere, or with any byte changed: an error or the same job, never another one.
    let whole = plate(gcode, Packed::Deflated);
    let mut printed = 0;
    for place in (0..whole.len()).step_by(5) {
        let outcome = print(&whole[..place], &[]);
        assert!(matches!(outcome.status, Some(1 | 2)) && !outcome.stderr.contains("panicked"), "{place}: {outcome:#?}");
        let mut changed = whole.clone();
        changed[place] ^= 0x21;
        let outcome = print(&changed, &[]);
        assert!(!outcome.stderr.contains("panicked"), "{place}: {outcome:#?}");
        if outcome.status == Some(0) {
            ends_at(&outcome, 20.0);
            printed += 1;
        }
    }
    assert!(printed > 0);
}
