use proptest::prelude::*;

use super::*;

/// Switches packing on.
const ENABLE: [u8; 3] = [255, 255, 251];

/// Packed by the Python code of OctoPrint-MeatPack (its packer, `meatpack.py`), and what it packed:
/// twelve numbered lines, two plain ones, one that it freed of its comment. It takes the spaces out
/// of G commands and makes their checksums anew.
const WITH_SPACES: (&[u8], &str) =
    (include_bytes!("../../tests/data/packed_spaces.bin"), include_str!("../../tests/data/packed_spaces.gcode"));
const WITHOUT_SPACES: (&[u8], &str) =
    (include_bytes!("../../tests/data/packed_no_spaces.bin"), include_str!("../../tests/data/packed_no_spaces.gcode"));

fn unpacked(unpacker: &mut Unpacker, bytes: &[u8]) -> (Vec<u8>, Vec<Settings>) {
    let (mut text, mut reports) = (Vec::new(), Vec::new());
    for &byte in bytes {
        let unpacked = unpacker.feed(byte);
        text.extend_from_slice(unpacked.bytes());
        reports.extend(unpacked.report);
    }
    (text, reports)
}

fn packed(text: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    pack(text, |byte| bytes.push(byte));
    bytes
}

#[test]
fn the_hosts_packer_is_understood() {
    for ((bytes, text), no_spaces) in [(WITH_SPACES, false), (WITHOUT_SPACES, true)] {
        let mut unpacker = Unpacker::new();
        let (out, reports) = unpacked(&mut unpacker, bytes);
        assert_eq!(String::from_utf8_lossy(&out), text);
        let on = Settings { packing: true, no_spaces };
        assert_eq!(reports, [Settings { packing: true, no_spaces: false }, on, Settings::default()]);
        assert_eq!(unpacker.settings(), Settings::default());
    }
}

#[test]
fn ours_packs_like_the_hosts() {
    let (bytes, text) = WITH_SPACES;
    assert_eq!(packed(text), bytes[6..bytes.len() - 3]);
    assert_eq!(bytes[bytes.len() - 3..], END);
    let (text, reports) = unpacked(&mut Unpacker::new(), &[&BEGIN[..], &packed("G1\n")].concat());
    let last = reports.last().map(Settings::to_string);
    assert_eq!((&text[..], last.as_deref()), (&b"G1\n"[..], Some("[MP] PV01 ON ESP")));
}

#[test]
fn every_command_reports() {
    let mut unpacker = Unpacker::new();
    for (command, report) in [
        (248, "[MP] PV01 OFF ESP"),
        (247, "[MP] PV01 OFF NSP"),
        (251, "[MP] PV01 ON NSP"),
        (246, "[MP] PV01 ON ESP"),
        (250, "[MP] PV01 OFF ESP"),
        (251, "[MP] PV01 ON ESP"),
        (247, "[MP] PV01 ON NSP"),
        // A byte that is not a command.
        (253, "[MP] PV01 ON NSP"),
        (0, "[MP] PV01 ON NSP"),
        (249, "[MP] PV01 OFF ESP"),
    ] {
        let (text, reports) = unpacked(&mut unpacker, &[255, 255, command]);
        assert!(text.is_empty());
        assert_eq!(reports.iter().map(Settings::to_string).collect::<Vec<_>>(), [report], "{command}");
    }
}

#[test]
fn a_command_begins_a_new_byte() {
    // Two whole characters were announced, one came; then a held half.
    for start in [&[0xff, b'Y'][..], &[0xff], &[0x0f], &[0xf1]] {
        for again in [&ENABLE[..], &[255, 255, 247, 255, 255, 246]] {
            let mut unpacker = Unpacker::new();
            unpacked(&mut unpacker, &ENABLE);
            unpacked(&mut unpacker, start);
            unpacked(&mut unpacker, again);
            assert_eq!(unpacked(&mut unpacker, &[0x1d, 0x0c]).0, b"G1\n", "{start:x?}");
        }
    }
    // A question changes nothing.
    let mut unpacker = Unpacker::new();
    unpacked(&mut unpacker, &ENABLE);
    let (text, reports) = unpacked(&mut unpacker, &[0x1f, 255, 255, 248, b'Y']);
    assert_eq!((&text[..], reports.len()), (&b"Y1"[..], 1));
    // A third signal byte belongs to the two before.
    let (text, reports) = unpacked(&mut unpacker, &[255, 255, 255, 250]);
    assert_eq!((&text[..], reports), (&b""[..], vec![Settings::default()]));
}

proptest! {
    #[test]
    fn off_passes_every_byte(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
        // Two FF in a row are a command, and the last one waits.
        let mut plain = Vec::new();
        for byte in bytes {
            if byte != 255 || plain.last() != Some(&255) {
                plain.push(byte);
            }
        }
        plain.push(b'\n');
        let (text, reports) = unpacked(&mut Unpacker::new(), &plain);
        prop_assert_eq!(text, plain);
        prop_assert!(reports.is_empty());
    }

    #[test]
    fn what_is_packed_is_unpacked(text in "([ -~]|[0-9.GXYE \n]|\\PC){0,80}", rest in "[GX0-9\n ]{0,20}") {
        let mut unpacker = Unpacker::new();
        unpacked(&mut unpacker, &ENABLE);
        // Each line by itself, as it is sent.
        for line in text.split_inclusive('\n').chain([&*rest]) {
            let line = format!("{line}\n");
            let bytes = packed(&line);
            prop_assert!(!bytes.windows(2).any(|pair| pair == [255, 255]));
            let (out, reports) = unpacked(&mut unpacker, &bytes);
            prop_assert_eq!(String::from_utf8_lossy(&out), line);
            prop_assert!(reports.is_empty());
        }
        prop_assert_eq!(unpacker.settings(), Settings { packing: true, no_spaces: false });
    }

    #[test]
    fn every_byte_sequence_is_answered(bytes in proptest::collection::vec(prop_oneof![Just(255), 246..=251_u8, any::<u8>()], 0..400)) {
        let mut unpacker = Unpacker::new();
        let (text, _) = unpacked(&mut unpacker, &bytes);
        prop_assert!(text.len() <= 2 * bytes.len());
        // Whatever came, a reset makes it plain.
        unpacked(&mut unpacker, &END);
        prop_assert_eq!(unpacked(&mut unpacker, b"G28\n").0, b"G28\n");
    }
}
