//! Content of the items of a frame.

use ferrostep_gpre::{EntrySpeed, Fault, PreparedMove, SquaredSpeed};

use super::bits::Bits;
use super::{COUNTS, ENDS_MOVE, FILAMENT, Read, SAME_LINE, Start, WAY, moves, read, refused};
use crate::framed::framed;

/// Adds a move of this shape; the bits of its entry speed and its numbers must follow.
fn shaped(bits: &mut Bits, shape: u64) {
    bits.put(0b10, 2);
    bits.put(shape, 7);
}

/// Adds a move of the same shape as the previous one, as fast as allowed.
fn plain(bits: &mut Bits) {
    bits.put(0b00, 2);
}

/// Adds an item other than a move, of a kind from 0 to 7.
fn other(bits: &mut Bits, kind: u64) {
    bits.put(0b11, 2);
    bits.put(kind, 3);
}

/// Shapes: X and Y, X Y and Z, Z, no path; no filament, its difference from the prediction, all of
/// it.
const XY: u64 = 0 << WAY;
const XYZ: u64 = 1 << WAY;
const Z: u64 = 2 << WAY;
const NO_WAY: u64 = 3 << WAY;
const NO_FILAMENT: u64 = 0 << FILAMENT;
const PREDICTED: u64 = 1 << FILAMENT;
const ALL: u64 = 2 << FILAMENT;

#[test]
fn moves_of_all_shapes_are_read() {
    let frame = Start::default().with(6, |bits| {
        // The first shape: X and Y, and the difference of the filament from the prediction, which
        // is 0 without a lambda.
        plain(bits);
        bits.signed(3, 4);
        bits.signed(-4, 4);
        bits.signed(5, 4);
        shaped(bits, XYZ | NO_FILAMENT | ENDS_MOVE);
        bits.put(0, 1);
        [1, 2, -3].into_iter().for_each(|steps| bits.signed(steps, 4));
        shaped(bits, Z | ALL | SAME_LINE | COUNTS);
        bits.put(0b10, 2);
        bits.signed(-7, 4);
        bits.signed(-1_000_000, 12);
        shaped(bits, NO_WAY | ALL | COUNTS);
        bits.put(0b110, 3);
        bits.signed(11, 12);
        // A squared speed plus one of 6 bits, and the largest.
        shaped(bits, XY | NO_FILAMENT);
        bits.put(0b111, 3);
        bits.put(5, 6);
        bits.put(0b00010, 5);
        [0, 0].into_iter().for_each(|steps| bits.signed(steps, 4));
        shaped(bits, XY | NO_FILAMENT);
        bits.put(0b111, 3);
        bits.put(63, 6);
        bits.put(u64::MAX >> 1, 63);
        [0, 0].into_iter().for_each(|steps| bits.signed(steps, 4));
    });
    let read = moves(&frame);
    let told = |item: &PreparedMove| (item.target_10nm(), item.filament_100pm, item.line, item.ends_move, item.counts);
    let expected = [
        ([1_300, -2_400, 30], 50, 8, true, true),
        ([1_400, -2_200, -270], 0, 9, true, false),
        ([1_400, -2_200, -970], -10_000_000, 9, false, true),
        ([1_400, -2_200, -970], 110, 10, false, true),
        ([1_400, -2_200, -970], 0, 11, false, false),
        ([1_400, -2_200, -970], 0, 12, false, false),
    ];
    assert_eq!(read.iter().map(told).collect::<Vec<_>>(), expected);
    let given = |units| EntrySpeed::Given(SquaredSpeed::from_units(units));
    let entries = [
        EntrySpeed::Bound,
        EntrySpeed::Bound,
        EntrySpeed::Falling,
        EntrySpeed::Continues,
        given(0b10_0001),
        given(u64::MAX - 1),
    ];
    assert_eq!(read.iter().map(|item| item.entry).collect::<Vec<_>>(), entries);
    assert!(read.iter().all(|item| item.feed_mm_per_s == 40.0));
}

/// 3, 4 and 12 steps make a path of 13 steps.
#[test]
fn filament_is_predicted_along_the_way() {
    let frame = Start::default().with(4, |bits| {
        other(bits, 3);
        bits.put(u64::from(2.5_f32.to_bits() >> 8), 24);
        plain(bits);
        [3, 4, 1].into_iter().for_each(|number| bits.signed(number, 4));
        shaped(bits, XYZ | PREDICTED);
        bits.put(0, 1);
        [3, 4, 12, -1].into_iter().for_each(|number| bits.signed(number, 4));
        shaped(bits, Z | PREDICTED);
        bits.put(0, 1);
        [-3, 0].into_iter().for_each(|number| bits.signed(number, 4));
    });
    // 12.5 + 1, 32.5 - 1 and 7.5, cut, in units of 1 nm.
    assert_eq!(moves(&frame).iter().map(|item| item.filament_100pm).collect::<Vec<_>>(), [130, 310, 70]);
}

/// Feeds and lambdas by their place: eight of them, taken in turn.
#[test]
fn what_was_told_before_is_told_by_its_place() {
    let frame = Start::default().with(9 + 2 + 2, |bits| {
        for feed in 1..=9 {
            other(bits, 1);
            bits.float(feed as f32);
        }
        // The ninth is at the place of the first; the second is still there.
        for place in [0, 1] {
            other(bits, 0);
            bits.put(place, 3);
            shaped(bits, NO_WAY | NO_FILAMENT);
            bits.put(0, 1);
        }
    });
    assert_eq!(moves(&frame).iter().map(|item| item.feed_mm_per_s).collect::<Vec<_>>(), [9.0, 2.0]);
    // Each place has the feed of the frame's start, and no lambda, until one is encoded.
    let frame = Start::default().with(3, |bits| {
        other(bits, 0);
        bits.put(7, 3);
        other(bits, 2);
        bits.put(7, 3);
        plain(bits);
        [3, 4, 1].into_iter().for_each(|number| bits.signed(number, 4));
    });
    let [item] = moves(&frame)[..] else { panic!() };
    assert_eq!((item.feed_mm_per_s, item.filament_100pm), (40.0, 10));
}

#[test]
fn a_feed_that_is_none_is_refused() {
    for feed in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        let frame = Start::default().with(2, |bits| {
            other(bits, 1);
            bits.float(feed);
            shaped(bits, NO_WAY | NO_FILAMENT);
            bits.put(0, 1);
        });
        assert_eq!(refused(&frame), (0, Fault::Content("a feed above zero")), "{feed}");
    }
}

#[test]
fn a_move_beyond_five_metres_is_refused() {
    const TOO_FAR: Fault = Fault::Content("coordinates within 5 m");
    for axis in 0..3 {
        for direction in [1, -1] {
            let mut start = Start { unit: 100, filament_unit: 1, ..Start::default() };
            start.position = [0; 3];
            start.position[axis] = 499_999_900 * direction;
            let steps_are = |steps: i64, shape| {
                start.with(1, |bits| {
                    shaped(bits, shape | NO_FILAMENT);
                    bits.put(0, 1);
                    for one in 0..3 {
                        if shape == XYZ || shape == XY && one < 2 || shape == Z && one == 2 {
                            bits.signed(if one == axis { steps } else { 0 }, 4);
                        }
                    }
                })
            };
            for shape in [XYZ, if axis == 2 { Z } else { XY }] {
                let reached = moves(&steps_are(direction, shape))[0].target_10nm()[axis];
                assert_eq!(i64::from(reached), 500_000_000 * direction);
                assert_eq!(refused(&steps_are(2 * direction, shape)), (0, TOO_FAR));
                // Steps whose path has more than 32 bits would give a short path if it were cut to
                // them.
                assert_eq!(refused(&steps_are(42_949_673 * direction, shape)), (0, TOO_FAR));
            }
            // The usual move, by another reader.
            let frame = start.with(1, |bits| {
                plain(bits);
                [0, 1].into_iter().for_each(|one| bits.signed(if one == axis { 2 * direction } else { 0 }, 4));
                bits.signed(0, 4);
            });
            if axis < 2 {
                assert_eq!(refused(&frame), (0, TOO_FAR));
            }
        }
    }
}

#[test]
fn filament_that_has_no_number_is_refused() {
    let frame = |units: i64| {
        Start { filament_unit: 1000, ..Start::default() }.with(1, |bits| {
            shaped(bits, NO_WAY | ALL);
            bits.put(0, 1);
            bits.signed(units, 12);
        })
    };
    let largest = i64::MAX / 1000;
    for units in [largest, -largest] {
        assert_eq!(moves(&frame(units))[0].filament_100pm, units * 1000);
    }
    for units in [largest + 1, -largest - 1] {
        assert_eq!(refused(&frame(units)), (0, Fault::Content("filament of at most 1 m in a move")));
    }
    let frame = Start::default().with(1, |bits| {
        shaped(bits, XY | 3 << FILAMENT);
        bits.put(0, 1);
        [1, 1, 1].into_iter().for_each(|number| bits.signed(number, 4));
    });
    assert_eq!(refused(&frame), (0, Fault::Content("a filament of a kind from 0 to 2")));
}

/// A prediction beyond 32 bits ends at the largest value, as in the writer; the difference is added
/// in a wider type.
#[test]
fn a_prediction_ends_at_its_largest() {
    for (shape, ways) in [(XY, &[3_i64, 4][..]), (XYZ, &[3, 4, 0])] {
        for (difference, filament) in [(0, 2_147_483_647_i64), (1, 2_147_483_648), (-2, 2_147_483_645)] {
            let frame = Start { filament_unit: 1, ..Start::default() }.with(2, |bits| {
                other(bits, 3);
                bits.put(u64::from(1e30_f32.to_bits() >> 8), 24);
                shaped(bits, shape | PREDICTED);
                bits.put(0, 1);
                ways.iter().for_each(|steps| bits.signed(*steps, 4));
                bits.signed(difference, 4);
            });
            assert_eq!(moves(&frame)[0].filament_100pm, filament, "{difference}");
        }
    }
}

#[test]
fn line_numbers_have_32_bits() {
    const LINES: Fault = Fault::Content("line numbers of 32 bits");
    let start = Start { line: (1 << 32) - 2, ..Start::default() };
    // Moves for both readers, and omitted lines, before each kind of item.
    let nothing = |bits: &mut Bits| {
        shaped(bits, NO_WAY | NO_FILAMENT);
        bits.put(0, 1);
    };
    let usual = |bits: &mut Bits| {
        plain(bits);
        bits.signed(0, 4);
        bits.signed(0, 4);
        bits.signed(0, 4);
    };
    let one = |put: fn(&mut Bits)| refused(&start.with(2, |bits| [put, put].into_iter().for_each(|put| put(bits))));
    assert_eq!(one(nothing), (1, LINES));
    assert_eq!(one(usual), (1, LINES));
    let after = |kind: u64, k: u32, lines: u64| {
        start.with(1, |bits| {
            other(bits, kind);
            bits.golomb(lines, k);
            if kind == 5 {
                bits.put(77, 8);
            } else if kind == 6 {
                // G28
                bits.put(0b10, 2);
                bits.put(0, 2);
                bits.golomb(28, 6);
                bits.put(0, 3);
            }
        })
    };
    assert_eq!(read(&after(4, 2, 0)), (vec![], Ok(())));
    assert_eq!(refused(&after(4, 2, 1)), (0, LINES));
    assert_eq!(refused(&after(4, 2, u64::from(u32::MAX))), (0, LINES));
    assert_eq!(read(&after(5, 1, 1)), (vec![Read::Fan(u32::MAX, 77)], Ok(())));
    assert_eq!(refused(&after(5, 1, 2)), (0, LINES));
    assert_eq!(read(&after(6, 1, 1)), (vec![Read::Command(u32::MAX, "G28".to_owned())], Ok(())));
    assert_eq!(refused(&after(6, 1, 2)), (0, LINES));
}

#[test]
fn an_item_of_an_unknown_kind_is_refused() {
    let frame = Start::default().with(1, |bits| other(bits, 7));
    assert_eq!(refused(&frame), (0, Fault::Content("an item of a kind from 0 to 6")));
}

/// A command on the previous line; `put` writes its bits.
fn command(put: impl FnOnce(&mut Bits)) -> Vec<u8> {
    Start::default().with(1, |bits| {
        other(bits, 6);
        bits.golomb(0, 1);
        put(bits);
    })
}

fn text(bits: &mut Bits, text: &[u8]) {
    bits.put(0, 2);
    bits.put(text.len() as u64, 8);
    text.iter().for_each(|byte| bits.put((*byte).into(), 8));
}

#[test]
fn commands_are_texts_or_words() {
    let long = "x".repeat(255);
    for one in ["M117 \u{fc}ber", "", &long] {
        let frame = command(|bits| text(bits, one.as_bytes()));
        assert_eq!(read(&frame), (vec![Read::Command(7, one.to_owned())], Ok(())));
    }
    let frame = command(|bits| {
        bits.put(2, 2);
        bits.put(1, 2);
        bits.golomb(4_294_967_295, 6);
        bits.put(4, 3);
        for (letter, value) in [(0, Some(0)), (25, None), (18, Some(-2_147_483_648)), (23, Some(1_000_000_000))] {
            bits.put(letter, 5);
            bits.put(u64::from(value.is_some()), 1);
            value.into_iter().for_each(|value| bits.signed(value, 5));
        }
    });
    let expected = "M4294967295 A0 Z S-2147483648 X1000000000";
    assert_eq!(read(&frame), (vec![Read::Command(7, expected.to_owned())], Ok(())));
    // Seven words of the longest numbers.
    let frame = command(|bits| {
        bits.put(2, 2);
        bits.put(2, 2);
        bits.golomb(u64::from(u32::MAX), 6);
        bits.put(7, 3);
        for _ in 0..7 {
            bits.put(22, 5);
            bits.put(1, 1);
            bits.signed(-2_147_483_648, 5);
        }
    });
    let expected = format!("T4294967295{}", " W-2147483648".repeat(7));
    assert_eq!(read(&frame), (vec![Read::Command(7, expected)], Ok(())));
}

#[test]
fn a_command_without_a_meaning_is_refused() {
    let frame = command(|bits| bits.put(3, 2));
    assert_eq!(refused(&frame), (0, Fault::Content("a command of a kind from 0 to 2")));
    let frame = command(|bits| {
        bits.put(2, 2);
        bits.put(3, 2);
    });
    assert_eq!(refused(&frame), (0, Fault::Content("a command that begins with G, M or T")));
    for letter in [26, 31] {
        let frame = command(|bits| {
            bits.put(2, 2);
            bits.put(0, 2);
            bits.golomb(1, 6);
            bits.put(1, 3);
            bits.put(letter, 5);
            bits.put(0, 1);
        });
        assert_eq!(refused(&frame), (0, Fault::Content("a word that begins with a letter")));
    }
    for bytes in [&b"M117 \xc3"[..], b"\xff", b"M\x80"] {
        let frame = command(|bits| text(bits, bytes));
        assert_eq!(refused(&frame), (0, Fault::Content("a command of UTF-8")));
    }
}

#[test]
fn a_command_is_repeated_by_its_place() {
    const BEFORE: Fault = Fault::Content("a command that was encoded before");
    let again = |bits: &mut Bits, place: u64| {
        other(bits, 6);
        bits.golomb(1, 1);
        bits.put(1, 2);
        bits.put(place, 3);
    };
    let told = |bits: &mut Bits, number: u64| {
        other(bits, 6);
        bits.golomb(0, 1);
        bits.put(2, 2);
        bits.put(0, 2);
        bits.golomb(number, 6);
        bits.put(0, 3);
    };
    // Nine commands take eight places; a repeated one takes none.
    let frame = Start::default().with(9 + 3, |bits| {
        (1..=9).for_each(|number| told(bits, number));
        [0, 1, 7].into_iter().for_each(|place| again(bits, place));
    });
    let (items, outcome) = read(&frame);
    assert_eq!(outcome, Ok(()));
    let last: Vec<_> =
        [(8, "G9"), (9, "G2"), (10, "G8")].map(|(line, text)| Read::Command(line, text.to_owned())).into();
    assert_eq!(items[9..], last);
    // No command has been encoded yet, then none at that place.
    assert_eq!(refused(&Start::default().with(1, |bits| again(bits, 0))), (0, BEFORE));
    let frame = Start::default().with(2, |bits| {
        told(bits, 1);
        again(bits, 1);
    });
    assert_eq!(refused(&frame), (1, BEFORE));
}

/// Items whose bits are missing, and bits that belong to no item.
#[test]
fn a_frame_ends_with_its_last_item() {
    const OVER: Fault = Fault::Content("the end of the frame after its last item");
    const LEFT: Fault = Fault::Content("the frame's end after its last item");
    // All kinds of moves, each as the last of a frame.
    let usual = |bits: &mut Bits| {
        plain(bits);
        [100, 100, 100].into_iter().for_each(|number| bits.signed(number, 4));
    };
    let any = |bits: &mut Bits| {
        shaped(bits, XYZ | ALL);
        bits.put(0, 1);
        [100, 100, 100].into_iter().for_each(|number| bits.signed(number, 4));
        bits.signed(1000, 12);
    };
    let nothing = |bits: &mut Bits| {
        shaped(bits, NO_WAY | NO_FILAMENT);
        bits.put(0b10, 2);
    };
    for put in [usual as fn(&mut Bits), any, nothing] {
        let mut bits = Start::default().bits(1);
        let before = bits.length();
        put(&mut bits);
        let length = bits.length();
        let bytes = bits.into_bytes();
        // Whole: the rest of the last byte is padding, a byte more is one too many.
        assert_eq!(moves(&framed(&bytes)).len(), 1);
        for more in [1, 2, 100] {
            let longer = [&bytes[..], &vec![0; more]].concat();
            assert_eq!(refused(&framed(&longer)), (1, LEFT));
        }
        for cut in before.div_ceil(8)..length.div_ceil(8) {
            let (count, fault) = refused(&framed(&bytes[..cut]));
            assert!(count == 0 && matches!(fault, Fault::Content(_)), "{fault}");
        }
    }
    // More items than there are.
    let frame = Start::default().with(3, |bits| {
        usual(bits);
        usual(bits);
        bits.put(0, 8);
    });
    let (count, fault) = refused(&frame);
    assert!(count <= 3 && fault == OVER, "{count}: {fault}");
    let frame = Start::default().with(u64::from(u32::MAX), nothing);
    let (count, fault) = refused(&frame);
    assert!(count < 100 && matches!(fault, Fault::Content(_)), "{count}: {fault}");
}

/// The items may need any number of bits of the last byte: the rest is padding, and a whole byte
/// more is rejected.
#[test]
fn less_than_a_byte_may_be_left() {
    let mut rests = [false; 8];
    for short in 0..8 {
        let items = short + 3;
        let mut bits = Start::default().bits(items);
        for index in 0..items {
            shaped(&mut bits, NO_WAY | NO_FILAMENT);
            // An entry speed of two bits, or of one.
            if index < short { bits.put(0b10, 2) } else { bits.put(0, 1) }
        }
        rests[bits.length() % 8] = true;
        let bytes = bits.into_bytes();
        assert_eq!(moves(&framed(&bytes)).len() as u64, items);
        let longer = [&bytes[..], &[0]].concat();
        let expected = (items as usize, Fault::Content("the frame's end after its last item"));
        assert_eq!(refused(&framed(&longer)), expected);
    }
    assert_eq!(rests, [true; 8]);
}
