use super::*;
use proptest::prelude::*;

/// A line or the reason it was refused, free of borrows.
#[derive(Clone, Debug, PartialEq)]
enum Read {
    Line(u32, String, Option<i64>, Checksum),
    Refused(LineError),
}

impl From<Result<Line<'_>, LineError>> for Read {
    fn from(line: Result<Line<'_>, LineError>) -> Self {
        match line {
            Ok(line) => Read::Line(line.line_number, line.text.to_owned(), line.number, line.checksum),
            Err(error) => Read::Refused(error),
        }
    }
}

/// The lines of a stream that comes in these portions, and how many have ended.
fn read_portions<'a>(portions: impl IntoIterator<Item = &'a [u8]>) -> (Vec<Read>, u32) {
    let mut reader = LineReader::new();
    let mut lines = Vec::new();
    for portion in portions {
        let mut rest = portion;
        while !rest.is_empty() {
            let (consumed, line) = reader.feed(rest);
            assert!(consumed > 0, "no progress");
            assert!(line.is_some() || consumed == rest.len(), "bytes left without a line");
            rest = &rest[consumed..];
            lines.extend(line.map(Read::from));
        }
    }
    lines.extend(reader.finish().map(Read::from));
    assert_eq!(reader.finish(), None, "finished twice");
    (lines, reader.lines_ended())
}

fn read(bytes: &[u8]) -> Vec<Read> {
    let (whole, ended) = read_portions([bytes]);
    assert_eq!(read_portions(bytes.chunks(1)), (whole.clone(), ended), "byte by byte");
    whole
}

fn plain(line_number: u32, text: &str) -> Read {
    Read::Line(line_number, text.to_owned(), None, Checksum::Absent)
}

#[test]
fn line_ends_of_all_kinds() {
    let expected = [plain(1, "G28"), plain(2, "G90"), plain(5, "M83"), plain(6, "T0")];
    assert_eq!(read(b"G28\nG90\n\n;c\nM83\nT0"), expected);
    assert_eq!(read(b"G28\r\nG90\r\n\r\n;c\r\nM83\r\nT0\r\n"), expected);
    assert_eq!(read(b"G28\rG90\r\r;c\rM83\rT0\r"), expected);
    assert_eq!(read(b"G28\n\rG90"), [plain(1, "G28"), plain(3, "G90")]);
}

#[test]
fn empty_lines_are_counted() {
    assert_eq!(read_portions([&b""[..]]), (vec![], 0));
    assert_eq!(read_portions([&b"\n\r\n \t\n;\n ; x"[..]]), (vec![], 5));
    assert_eq!(read_portions([&b"  "[..]]), (vec![], 1));
    assert_eq!(read_portions([&b"G28\r"[..], b"\n"]), (vec![plain(1, "G28")], 1));
    assert_eq!(read(b"\n\n  G28\t ; home\n"), [plain(3, "G28")]);
}

#[test]
fn comments_do_not_count_against_the_length() {
    let long = "x".repeat(5000);
    let text = format!("G28 ;{long}\nM117 {}\n;{long}\nG90", "y".repeat(LINE_CAPACITY - 5));
    let lines = read(text.as_bytes());
    assert_eq!(lines.len(), 3);
    assert_eq!(lines[0], plain(1, "G28"));
    assert_eq!(lines[2], plain(4, "G90"));
    // Bytes of a comment are not checked either.
    assert_eq!(read(b"G28 ; \xff\x00\nG90"), [plain(1, "G28"), plain(2, "G90")]);
}

fn too_long(line_number: u32, number: Option<i64>, checksum: Checksum) -> Read {
    Read::Refused(LineError::TooLong { line_number, number, checksum })
}

/// A long line has the checksum of the whole, so that a host is not asked endlessly for a line that
/// has come as it sent it.
#[test]
fn a_long_line_has_its_checksum() {
    let long = "x".repeat(1000);
    let with_checksum = |text: &str| format!("{text}*{}", text.bytes().fold(0, |sum, byte| sum ^ byte));
    for text in [format!("N5 G1 {long}"), format!("N5 G1 {long} ; comment")] {
        assert_eq!(read(with_checksum(&text).as_bytes()), [too_long(1, Some(5), Checksum::Right)], "{text}");
        let wrong = Checksum::Wrong { expected: 1, computed: text.bytes().fold(0, |sum, byte| sum ^ byte) };
        assert_eq!(read(format!("{text}*1").as_bytes()), [too_long(1, Some(5), wrong)], "{text}");
    }
    // A text for people loses its end.
    let kept = |number: &str| format!("M117 {}", &long[..LINE_CAPACITY - number.len() - 5]);
    for checksum in ["", " ; comment"] {
        let text = with_checksum(&format!("N5 M117 {long}{checksum}"));
        assert_eq!(read(text.as_bytes()), [Read::Line(1, kept("N5 "), Some(5), Checksum::Right)]);
    }
    assert_eq!(read(format!("M117 {long}").as_bytes()), [plain(1, &kept(""))]);
    let umlauts = format!("M118 {}", "\u{fc}".repeat(200));
    assert_eq!(read(umlauts.as_bytes()), [plain(1, &format!("M118 {}", "\u{fc}".repeat(125)))]);
}

#[test]
fn long_lines_are_refused_once() {
    let limit = format!("G1 {}", "x".repeat(LINE_CAPACITY - 3));
    for end in ["", "y", "y ; c", &"y".repeat(1000)] {
        let text = format!("{limit}{end}\nG28\nN5 {limit}\n");
        let first = if end.is_empty() { plain(1, &limit) } else { too_long(1, None, Checksum::Absent) };
        let third = too_long(3, Some(5), Checksum::Absent);
        assert_eq!(read(text.as_bytes()), [first, plain(2, "G28"), third]);
    }
    let blanks = " ".repeat(LINE_CAPACITY + 1);
    let refused = too_long(1, None, Checksum::Absent);
    assert_eq!(read(blanks.as_bytes()), std::slice::from_ref(&refused));
    assert_eq!(read(format!("{blanks}\nG28").as_bytes()), [refused, plain(2, "G28")]);
}

/// A number beyond the kept part of a line is not seen, in portions of any size.
#[test]
fn a_line_number_beyond_the_capacity_is_not_seen() {
    for (blanks, number) in [(LINE_CAPACITY - 3, Some(5)), (LINE_CAPACITY, None), (LINE_CAPACITY + 40, None)] {
        let text = format!("{}N5 G1 X1\n", " ".repeat(blanks));
        assert_eq!(read(text.as_bytes()), [too_long(1, number, Checksum::Absent)], "{blanks} blanks");
    }
}

/// The `\n` after a stream that ended with `\r` begins another stream.
#[test]
fn a_finished_stream_leaves_nothing_for_the_next() {
    let mut reader = LineReader::new();
    let (consumed, line) = reader.feed(b"G28\r");
    assert_eq!((consumed, line.map(Read::from)), (4, Some(plain(1, "G28"))));
    assert_eq!(reader.finish().map(Read::from), None);
    let (consumed, line) = reader.feed(b"\nG1 X1\n");
    assert_eq!((consumed, line.map(Read::from)), (7, Some(plain(3, "G1 X1"))));
}

#[test]
fn the_last_line_number_survives() {
    let mut reader = LineReader { lines_ended: u32::MAX - 1, ..LineReader::new() };
    for _ in 0..3 {
        assert_eq!(reader.feed(b"G28\n").1.map(Read::from), Some(plain(u32::MAX, "G28")));
    }
}

#[test]
fn bytes_that_are_not_text_are_refused() {
    let not_text = |line_number, byte, number| {
        Read::Refused(LineError::NotText { line_number, byte, number, checksum: Checksum::Absent })
    };
    assert_eq!(
        read(b"G28\nG1\0X5\nM117 \xc3\xa9\nG28 \xc3\nN7 \x1b\nM117 hot\xc3\xa9\xc3\xff"),
        [
            plain(1, "G28"),
            not_text(2, 0, None),
            plain(3, "M117 \u{e9}"),
            not_text(4, 0xc3, None),
            not_text(5, 0x1b, Some(7)),
            plain(6, "M117 hot\u{e9}"),
        ]
    );
}

#[test]
fn a_byte_order_mark_is_skipped() {
    assert_eq!(read(b"\xef\xbb\xbfG28\n"), [plain(1, "G28")]);
    assert_eq!(read(b"\xef\xbb\xbf; c\nG28\n"), [plain(2, "G28")]);
    assert_eq!(read(b"\n\xef\xbb\xbfG28\n"), [plain(2, "\u{feff}G28")]);
}

#[test]
fn checksums_before_and_in_comments() {
    let numbered = |number, text: &str, checksum| Read::Line(1, text.to_owned(), Some(number), checksum);
    for (text, expected) in [
        ("N3 T0*57 ; c", numbered(3, "T0", Checksum::Right)),
        ("N3 T0*57;c*1", numbered(3, "T0", Checksum::Right)),
        (
            "N3 M201 X1000 Y1000 Z200 E5000 ; sets maximum accelerations, mm/sec^2*3",
            numbered(3, "M201 X1000 Y1000 Z200 E5000", Checksum::Right),
        ),
        (
            "N4 M203 X200 Y200 Z12 E60 ; sets maximum feedrates, mm / sec*90",
            numbered(4, "M203 X200 Y200 Z12 E60", Checksum::Right),
        ),
        (
            "N4 M203 X201 Y200 Z12 E60 ; sets maximum feedrates, mm / sec*90",
            numbered(4, "M203 X201 Y200 Z12 E60", Checksum::Wrong { expected: 90, computed: 91 }),
        ),
        ("N4 T0 ; 2*x", numbered(4, "T0", Checksum::Absent)),
        ("N4 T0 ; 2*3 and more", numbered(4, "T0", Checksum::Absent)),
        ("N4 T0 ; c", numbered(4, "T0", Checksum::Absent)),
        ("N4*122", numbered(4, "", Checksum::Right)),
        ("N4", numbered(4, "", Checksum::Absent)),
        ("T0 ; c*9", plain(1, "T0")),
        ("M117 20*3 ; c", plain(1, "M117 20*3")),
    ] {
        assert_eq!(read(text.as_bytes()), [expected], "{text}");
    }
}

/// Bytes in which line ends, comments, numbers and checksums are frequent.
fn bytes_like_g_code() -> impl Strategy<Value = Vec<u8>> {
    let piece = prop_oneof![
        4 => Just(b"\n".to_vec()),
        2 => Just(b"\r".to_vec()),
        2 => Just(b";".to_vec()),
        2 => Just(b"*".to_vec()),
        2 => Just(b"N1".to_vec()),
        1 => Just(b"\xef\xbb\xbf".to_vec()),
        1 => Just("\u{fc}".as_bytes().to_vec()),
        1 => (200usize..300).prop_map(|length| vec![b'x'; length]),
        1 => Just(b"M117 ".to_vec()),
        4 => "[GMXN 0-9.-]{0,12}".prop_map(String::into_bytes),
        2 => proptest::collection::vec(any::<u8>(), 0..6),
    ];
    proptest::collection::vec(piece, 0..40).prop_map(|pieces| pieces.concat())
}

/// Lines found the slow way: all of the input at hand, split and taken apart.
fn reference(bytes: &[u8]) -> Vec<Read> {
    let mut text = Vec::new();
    for (at, &byte) in bytes.iter().enumerate() {
        match byte {
            b'\n' if at > 0 && bytes[at - 1] == b'\r' => {}
            b'\r' => text.push(b'\n'),
            byte => text.push(byte),
        }
    }
    let mut lines = Vec::new();
    for (index, line) in text.split(|&byte| byte == b'\n').enumerate() {
        let line_number = index as u32 + 1;
        let semicolon = line.iter().position(|&byte| byte == b';').unwrap_or(line.len());
        let before = &line[..semicolon];
        let unmarked = before.strip_prefix(b"\xef\xbb\xbf").filter(|_| index == 0).unwrap_or(before);
        let blank = unmarked.iter().all(|byte| b" \t".contains(byte));
        let kept = &before[..before.len().min(LINE_CAPACITY)];
        let mut in_comment = Checksum::Absent;
        if number_word(kept).is_some() && !before.contains(&b'*') {
            let mut scan = ChecksumScan::new();
            scan.extend(line);
            in_comment = scan.verdict();
            if in_comment == Checksum::Malformed {
                in_comment = Checksum::Absent;
            }
        }
        if before.len() > LINE_CAPACITY {
            let scan = scanned(before);
            let checksum = if before.contains(&b'*') { scan.verdict() } else { in_comment };
            lines.push(take_apart_cut(kept, line_number, checksum).into());
        } else if !blank {
            lines.push(take_apart(unmarked, false, line_number, in_comment).into());
        }
    }
    lines
}

proptest! {
    #[test]
    fn portions_do_not_change_the_lines(
        bytes in bytes_like_g_code(), cuts in proptest::collection::vec(any::<proptest::sample::Index>(), 0..8)
    ) {
        let mut places: Vec<usize> = cuts.iter().map(|cut| cut.index(bytes.len() + 1)).collect();
        places.extend([0, bytes.len()]);
        places.sort_unstable();
        let portions = places.windows(2).map(|pair| &bytes[pair[0]..pair[1]]);
        let (whole, ended) = read_portions([&bytes[..]]);
        prop_assert_eq!(read_portions(portions), (whole.clone(), ended));
        prop_assert_eq!(read_portions(bytes.chunks(1)), (whole.clone(), ended));
        prop_assert_eq!(whole, reference(&bytes));
    }

    #[test]
    fn any_bytes_are_answered(bytes in proptest::collection::vec(any::<u8>(), 0..2000)) {
        for line in read_portions([&bytes[..]]).0 {
            if let Read::Line(_, text, ..) = line {
                // Either answer will do; it must come.
                let _: Result<crate::Command<'_>, _> = crate::parse(&text);
            }
        }
    }

    #[test]
    fn a_flipped_bit_is_found(number in 0i64..100_000, command in "[A-Z0-9 .]{1,40}", bit in 0usize..4096) {
        let text = format!("N{number} {command}");
        let checksum = text.bytes().fold(0, |sum, byte| sum ^ byte);
        let mut bytes = format!("{text}*{checksum}").into_bytes();
        let (byte, bit) = (bit / 8 % text.len(), bit % 8);
        bytes[byte] ^= 1 << bit;
        let intact = read(&bytes).iter().any(|line| {
            matches!(line, Read::Line(_, _, Some(_), Checksum::Right))
        });
        prop_assert!(!intact);
    }
}

#[test]
fn a_broken_line_is_dropped_whole() {
    let mut reader = LineReader::new();
    let incomplete = |line_number, numbered| LineError::Incomplete { line_number, numbered };
    assert_eq!(reader.feed(b"N7 G1 X1"), (8, None));
    assert_eq!(reader.break_off(), incomplete(1, true));
    assert_eq!(reader.feed(b"G92 X1; 2"), (9, None));
    assert_eq!(reader.break_off(), incomplete(2, false));
    assert_eq!(reader.feed(&[b'x'; 300]), (300, None));
    assert_eq!(reader.break_off(), incomplete(3, false));
    let (used, line) = reader.feed(b"M114\n");
    assert!(matches!(line, Some(Ok(line)) if used == 5 && line.text == "M114"), "{line:?}");
    assert_eq!(reader.lines_ended(), 4);
}
