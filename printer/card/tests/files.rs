//! Cards written by mkfs.fat and mtools are read as mtools reads them. For the other direction see
//! `tests/outside`.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::Path;

use ferrostep_card::{Answer, CardFailure, ListOptions, Request};
use ferrostep_hal_shim::card::CardError;
use ferrostep_virtual_board::VirtualCard;

use crate::common::{self, Card, IMAGES, ask, image, lines_file, list, mounted, path, read, write};

/// Lines of M20 L T, made of mtools' list.
fn expected(name: &str) -> Vec<String> {
    let list = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/images/{name}.mdir")));
    let list = list.unwrap();
    let mut short_of = std::collections::HashMap::from([(String::new(), String::new())]);
    let mut folder = String::new();
    let mut lines = Vec::new();
    for line in list.lines() {
        if let Some(path) = line.strip_prefix("Directory for ::/") {
            folder = if path.is_empty() { String::new() } else { format!("{path}/") };
            continue;
        }
        let chars: Vec<char> = line.chars().collect();
        if chars.len() < 40 || chars[8] != ' ' || line.starts_with(' ') || line.starts_with('.') {
            continue;
        }
        let text = |range: std::ops::Range<usize>| chars.iter().skip(range.start).take(range.len()).collect::<String>();
        let (base, extension) = (text(0..8).trim().to_string(), text(9..12).trim().to_string());
        let short = if extension.is_empty() { base } else { format!("{base}.{extension}") };
        let short: String = short.chars().map(|char| if char.is_ascii() { char } else { '_' }).collect();
        let long = text(42..400).trim().to_string();
        let long = if long.is_empty() { short.clone() } else { long };
        let path = format!("{}{short}", short_of[&folder]);
        if text(12..26).contains("<DIR>") {
            short_of.insert(format!("{folder}{long}/"), format!("{path}/"));
            continue;
        }
        let is_listed = short.ends_with(".GCO") || short.ends_with(".G");
        // `make.sh` has hidden one file; another is what macOS leaves beside each.
        if !is_listed || short == "HIDDEN.GCO" || long.starts_with('.') {
            continue;
        }
        let size: String = text(12..22).chars().filter(char::is_ascii_digit).collect();
        let number = |range: std::ops::Range<usize>| text(range).trim().parse::<u16>().unwrap();
        let date = (number(23..27) - 1980) << 9 | number(28..30) << 5 | number(31..33);
        // mdir shows no seconds; `make.sh` has set 56.
        let time = number(35..37) << 11 | number(38..40) << 5 | (56 / 2);
        lines.push(format!("{path} {size} 0x{date:04X}{time:04X} {folder}{long}"));
    }
    lines.sort();
    lines
}

#[test]
fn a_list_is_that_of_mtools() {
    for name in IMAGES {
        let mut lines = list(&mounted(name), ListOptions { long: true, time: true }).unwrap();
        lines.sort();
        let expected = expected(name);
        assert!(expected.len() > 45, "{name}: {}", expected.len());
        assert_eq!(lines, expected, "{name}");
    }
}

#[test]
fn a_list_ends_with_its_4096th_file() {
    let mut image = std::io::Cursor::new(vec![0; 16 << 20]);
    fatfs::format_volume(&mut image, fatfs::FormatVolumeOptions::new()).unwrap();
    let volume = fatfs::FileSystem::new(&mut image, fatfs::FsOptions::new()).unwrap();
    // The largest number is reached in the second folder, so the third and the root would follow.
    for (folder, files) in [("A", 2048), ("B", 2048), ("C", 3)] {
        let folder = volume.root_dir().create_dir(folder).unwrap();
        for number in 0..files {
            folder.create_file(&format!("{number:04}.G")).unwrap();
        }
    }
    volume.root_dir().create_file("LAST.G").unwrap();
    volume.unmount().unwrap();
    let card = Card::new(VirtualCard::new(image.into_inner()));
    assert_eq!(ask(&card, Request::Mount), Ok(Answer::Done));
    let lines = list(&card, ListOptions::default()).unwrap();
    assert_eq!(lines.len(), 4096);
    assert_eq!(lines.last().unwrap(), "B/2047.G 0");
}

#[test]
fn files_are_found_by_short_and_long_names_in_any_case() {
    for name in IMAGES {
        let card = mounted(name);
        for file in [
            "ACUBEW~1.GCO",
            "/acubew~1.gco",
            "A cube with a long name.gcode",
            "/a CUBE with a long name.GCODE",
            "PARTS/ONE.GCO",
            "/Parts of the machine/left side/Bracket, thick.gcode",
            "PARTSO~1/LEFTSI~1/BRACKE~1.GCO",
            "MANY/GAPS.GCO",
        ] {
            assert_eq!(read(&card, file).unwrap(), lines_file(), "{name}: {file}");
        }
        assert_eq!(read(&card, "Würfel größer 中文 und noch mehr Text.gcode").unwrap(), lines_file()[..1000]);
        assert_eq!(read(&card, "empty.g").unwrap(), b"");
        ask(&card, Request::Open(path("partso~1/leftsi~1/bracke~1.gco"))).unwrap();
        let ferrostep_card::OpenedFile { short, long, size } = common::opened(&card);
        assert_eq!((short.as_str(), size), ("/PARTSO~1/LEFTSI~1/BRACKE~1.GCO", 7092));
        assert_eq!(long, "/Parts of the machine/Left side/Bracket, thick.gcode");
    }
}

#[test]
fn what_is_no_file_is_refused() {
    let card = mounted("fat16");
    let opened = |file: &str| ask(&card, Request::Open(path(file)));
    assert_eq!(opened("NONE.GCO"), Err(CardFailure::NotFound));
    assert_eq!(opened("NONE/A.GCO"), Err(CardFailure::NotFound));
    assert_eq!(opened("A.GCO/A.GCO"), Err(CardFailure::NotFound));
    assert_eq!(opened("PARTS"), Err(CardFailure::IsFolder));
    assert_eq!(opened(&"PARTS/DEEP/../".repeat(6)), Err(CardFailure::NotFound));
    assert_eq!(ask(&card, Request::Seek(1)), Err(CardFailure::NoFile));
    let blank = Card::new(VirtualCard::new(vec![0; 1 << 20]));
    assert_eq!(ask(&blank, Request::Mount), Err(CardFailure::NoVolume));
    assert_eq!(ask(&blank, Request::Open(path("A.GCO"))), Err(CardFailure::NotMounted));
    blank.with_slot(VirtualCard::pull);
    assert_eq!(ask(&blank, Request::Mount), Err(CardFailure::Slot(CardError::Missing)));
    let mut exfat = image("fat16");
    exfat[3..11].copy_from_slice(b"EXFAT   ");
    assert_eq!(ask(&Card::new(VirtualCard::new(exfat)), Request::Mount), Err(CardFailure::ExFat));
}

#[test]
fn reading_begins_where_it_is_told_to() {
    let whole = lines_file();
    let card = mounted("fat32");
    for at in [0, 1, 511, 512, 513, 5000, 7091, 7092] {
        ask(&card, Request::Open(path("MANY/GAPS.GCO"))).unwrap();
        ask(&card, Request::Seek(at)).unwrap();
        assert_eq!(common::take_all(&card).unwrap(), whole[at as usize..], "{at}");
    }
    assert_eq!(ask(&card, Request::Seek(7093)), Err(CardFailure::NotFound));
}

#[test]
fn what_is_written_is_read_again() {
    for name in IMAGES {
        let card = mounted(name);
        let long: Vec<u8> = (0..40_000_u32).map(|at| ((at * at) >> 8) as u8).collect();
        write(&card, "NEW.GCO", &long).unwrap();
        write(&card, "/PARTS/new2.g", b"G28\n").unwrap();
        write(&card, "MANY/EMPTY.GCO", b"").unwrap();
        assert_eq!(read(&card, "new.gco").unwrap(), long);
        // Overwritten, twice.
        write(&card, "NEW.GCO", &long[..700]).unwrap();
        assert_eq!(read(&card, "NEW.GCO").unwrap(), long[..700]);
        assert_eq!(ask(&card, Request::Delete(path("MANY/GAPS.GCO"))), Ok(Answer::Done));
        assert_eq!(ask(&card, Request::Delete(path("LOCKED.GCO"))), Err(CardFailure::ReadOnly));
        assert_eq!(ask(&card, Request::Delete(path("PARTS"))), Err(CardFailure::IsFolder));
        assert_eq!(ask(&card, Request::Create(path("LOCKED.GCO"))), Err(CardFailure::ReadOnly));
        assert_eq!(ask(&card, Request::Create(path("a long name.gcode"))), Err(CardFailure::BadName));
        assert_eq!(ask(&card, Request::Create(path("NONE/A.GCO"))), Err(CardFailure::NotFound));
        assert_eq!(read(&card, "PARTS/NEW2.G").unwrap(), b"G28\n");
        assert_eq!(ask(&card, Request::Release), Ok(Answer::Done));
    }
}

#[test]
fn a_full_card_says_so() {
    let card = mounted("fat16");
    let written = write(&card, "HUGE.GCO", &vec![b'x'; 5 << 20]);
    assert_eq!(written, Err(CardFailure::Full));
    // Older files are unchanged.
    assert_eq!(read(&card, "MANY/GAPS.GCO").unwrap(), lines_file());
}

#[test]
fn a_card_that_cannot_be_written_says_so() {
    let card = mounted("fat16");
    card.with_slot(|slot| slot.set_fault(Some(ferrostep_virtual_board::CardFault::Unwritable)));
    assert_eq!(write(&card, "A.GCO", b"G28\n"), Err(CardFailure::Slot(CardError::Silent)));
    card.with_slot(|slot| slot.set_fault(None));
    ask(&card, Request::Mount).unwrap();
    assert_eq!(read(&card, "A.GCO").unwrap(), b"G28\nM105\n");
}
