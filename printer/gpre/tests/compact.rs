//! Frames: what is written is read back, and malformed frames are rejected.
#![allow(clippy::unwrap_used)]

use ferrostep_gpre::compact::{Decoder, Frame, FrameWriter, HEAD_BYTES, MAX_FRAME_BYTES, frame_length};
use ferrostep_gpre::{Coordinate, EntrySpeed, Fault, Item, ModalState, PreparedMove, SquaredSpeed};
use proptest::prelude::*;

use crate::framed::framed;

/// An item that owns its text.
#[derive(Clone, Debug, PartialEq)]
enum Owned {
    Move(PreparedMove),
    Fan(u32, u8),
    Command(u32, String),
}

impl Owned {
    fn item(&self) -> Item<'_> {
        match self {
            Self::Move(item) => Item::Move(item),
            Self::Fan(line, power) => Item::Fan { line: *line, power: *power },
            Self::Command(line, text) => Item::Command { line: *line, text },
        }
    }
}

impl From<Item<'_>> for Owned {
    fn from(item: Item<'_>) -> Self {
        match item {
            Item::Move(item) => Self::Move(*item),
            Item::Fan { line, power } => Self::Fan(line, power),
            Item::Command { line, text } => Self::Command(line, text.to_owned()),
        }
    }
}

/// The frames of a file, one after the other.
fn frames(bytes: &[u8]) -> Vec<&[u8]> {
    let mut rest = bytes;
    let mut frames = Vec::new();
    while let Some(head) = rest.first_chunk::<HEAD_BYTES>() {
        let (frame, behind) = rest.split_at(frame_length(head).unwrap());
        frames.push(frame);
        rest = behind;
    }
    assert!(rest.is_empty());
    frames
}

fn items(decoder: &mut Decoder<'_>) -> Vec<Owned> {
    let mut items = Vec::new();
    while let Some(item) = decoder.next_item().unwrap() {
        items.push(item.into());
    }
    items
}

fn decoded(bytes: &[u8]) -> Vec<Owned> {
    let mut all = Vec::new();
    for (number, frame) in frames(bytes).into_iter().enumerate() {
        assert!(frame.len() <= MAX_FRAME_BYTES);
        let frame = Frame::read(frame, 0, Some(number as u32)).unwrap();
        all.extend(items(&mut frame.items().unwrap()));
    }
    all
}

fn written(items: &[Owned]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = FrameWriter::new([0; 3], ModalState::START);
    for item in items {
        writer.add(&item.item(), &mut bytes);
    }
    writer.close(&mut bytes);
    assert_eq!(frames(&bytes).len(), writer.frames() as usize);
    bytes
}

fn entry() -> impl Strategy<Value = EntrySpeed> {
    prop_oneof![
        4 => Just(EntrySpeed::Bound),
        2 => Just(EntrySpeed::Falling),
        1 => Just(EntrySpeed::Continues),
        1 => (0u64..1 << 62, 0u32..62).prop_map(|(squared, shift)| EntrySpeed::Given(SquaredSpeed::from_units(squared >> shift))),
    ]
}

/// Coordinates on a grid, filament by a lambda or any, feeds from a few or any.
fn next_move() -> impl Strategy<Value = (Owned, u32)> {
    let coordinate = |grid: i32| (-5_000i32..5_000).prop_map(move |x| x * grid);
    let target = prop_oneof![
        3 => (coordinate(100), coordinate(100)).prop_map(|(x, y)| [x, y, 20_000]),
        1 => (coordinate(1), coordinate(1), coordinate(1)).prop_map(|(x, y, z)| [x, y, z]),
        1 => proptest::array::uniform3(-500_000_000i32..=500_000_000),
    ];
    let filament = prop_oneof![
        2 => Just(0i64),
        3 => (0i64..100_000).prop_map(|filament| filament * 100),
        1 => -10_000_000_000i64..=10_000_000_000,
    ];
    let feed = prop_oneof![Just(30.0f32), Just(80.0), Just(150.0), 0.01f32..1e4];
    let flags = (any::<bool>(), any::<bool>(), 0u32..20);
    (target, filament, feed, flags, entry()).prop_map(|(target_10nm, filament_100pm, feed_mm_per_s, flags, entry)| {
        let target = target_10nm.map(|units: i32| Coordinate::new(units).unwrap());
        let (ends_move, counts, lines) = flags;
        let item = PreparedMove { target, filament_100pm, feed_mm_per_s, line: 0, ends_move, counts, entry };
        (Owned::Move(item), lines / 10)
    })
}

fn command() -> impl Strategy<Value = (Owned, u32)> {
    let text = prop_oneof![
        "[GMT][0-9]{1,4}( [A-Z]-?[0-9]{0,9}){0,8}",
        Just("M204 P800".to_owned()),
        Just("M73 P10 R20".to_owned()),
        "M117 \\PC{0,40}",
    ];
    (text, 0u32..5).prop_map(|(text, lines)| (Owned::Command(0, text), lines))
}

fn job() -> impl Strategy<Value = Vec<Owned>> {
    let item = prop_oneof![
        20 => next_move(),
        2 => command(),
        1 => (any::<u8>(), 0u32..3).prop_map(|(power, lines)| (Owned::Fan(0, power), lines)),
    ];
    proptest::collection::vec(item, 1..900).prop_map(|mut items| {
        let mut number = 0;
        items.iter_mut().for_each(|(item, lines)| {
            number += *lines;
            match item {
                Owned::Move(item) => item.line = number,
                Owned::Fan(line, _) | Owned::Command(line, _) => *line = number,
            }
        });
        items.into_iter().map(|(item, _)| item).collect()
    })
}

proptest! {
    #![proptest_config(ferrostep_random_cases::cases(64))]

    #[test]
    fn a_job_comes_back(job in job()) {
        prop_assert_eq!(decoded(&written(&job)), job);
    }

    /// Frames can be read from any frame on, without the earlier ones.
    #[test]
    fn frames_stand_for_themselves(job in job()) {
        let bytes = written(&job);
        let all = frames(&bytes);
        let mut behind = job.len();
        for frame in all.into_iter().rev() {
            let frame = Frame::read(frame, 0, None).unwrap();
            let mut decoder = frame.items().unwrap();
            let start = *decoder.start();
            let read = items(&mut decoder);
            behind -= read.len();
            prop_assert_eq!(&read[..], &job[behind..behind + read.len()]);
            let before = job[..behind].iter().rev();
            let place = before.clone().find_map(|item| if let Owned::Move(item) = item { Some(item.target_10nm()) } else { None });
            prop_assert_eq!(start.position_10nm, place.unwrap_or([0; 3]).map(i64::from));
            let first = read.iter().find_map(|item| if let Owned::Move(item) = item { Some(item.entry) } else { None });
            if matches!(first, Some(EntrySpeed::Continues | EntrySpeed::Falling)) {
                prop_assert!(!start.can_be_entered);
            }
        }
        prop_assert_eq!(behind, 0);
    }

    /// Every changed bit is found.
    #[test]
    fn a_changed_bit_is_refused(job in job(), place in any::<prop::sample::Index>(), bit in 0u32..8) {
        let mut bytes = written(&job);
        let length = frames(&bytes)[0].len();
        let place = place.index(length);
        bytes[place] ^= 1 << bit;
        let read = bytes
            .first_chunk::<HEAD_BYTES>()
            .map(|head| frame_length(head).map(|length| bytes.get(..length).map(|frame| Frame::read(frame, 77, Some(0)))));
        match read.unwrap() {
            Err(fault) => prop_assert!(matches!(fault, Fault::NoFrame | Fault::Length { .. }), "{}", fault),
            Ok(None) => {}
            Ok(Some(read)) => {
                let error = read.unwrap_err();
                prop_assert!(matches!(error.fault, Fault::Checksum { .. }), "{error}");
                prop_assert_eq!((error.offset, error.frame), (77, Some(0)));
            }
        }
    }

    /// Random content with a valid checksum ends in an item or an error, within its bits.
    #[test]
    fn any_content_ends(payload in proptest::collection::vec(any::<u8>(), 0..600)) {
        let bytes = framed(&payload);
        let frame = Frame::read(&bytes, 0, None).unwrap();
        if let Ok(mut decoder) = frame.items() {
            let mut count = 0;
            while let Ok(Some(_)) = decoder.next_item() {
                count += 1;
                prop_assert!(count <= 8 * payload.len());
            }
        }
    }
}

/// Moves without path or filament have no bits beyond those of their shape and speed.
#[test]
fn moves_that_are_nothing_end_with_the_bits() {
    for filament_100pm in [0, 100] {
        let item = PreparedMove { target: Default::default(), filament_100pm, ..small_move() };
        let bytes = written(&vec![Owned::Move(item); 200]);
        let payload = &bytes[HEAD_BYTES..bytes.len() - 4];
        let bytes = framed(&payload[..payload.len() - 25]);
        let frame = Frame::read(&bytes, 0, None).unwrap();
        let mut decoder = frame.items().unwrap();
        let mut count = 0;
        let ended = loop {
            match decoder.next_item() {
                Ok(Some(_)) => count += 1,
                ended => break ended.map(|_| ()),
            }
        };
        assert!(count < 200, "{count}");
        assert!(ended.is_err());
    }
}

fn small_move() -> PreparedMove {
    PreparedMove {
        target: [1_000_000, 2_000_000, 20_000].map(|units| Coordinate::new(units).unwrap()),
        filament_100pm: 12_300,
        feed_mm_per_s: 30.0,
        line: 1,
        ends_move: true,
        counts: true,
        entry: EntrySpeed::Bound,
    }
}

fn small_job() -> Vec<u8> {
    written(&[Owned::Move(small_move())])
}

#[test]
fn frames_out_of_order_are_told_from_each_other() {
    let bytes = small_job();
    let error = Frame::read(&bytes, 1234, Some(7)).unwrap_err();
    assert_eq!(error.fault, Fault::Sequence { number: 0, expected: 7 });
    assert_eq!(
        error.to_string(),
        "frame 7 at byte 1234: frames out of order: this is number 0, expected number 7: \
         copy the file, or prepare the job, again"
    );
}

#[test]
fn a_truncated_frame_says_so() {
    let bytes = small_job();
    for length in 0..bytes.len() {
        assert_eq!(Frame::read(&bytes[..length], 0, None).unwrap_err().fault, Fault::Truncated, "{length}");
    }
    let longer = [&bytes[..], &[0]].concat();
    assert_eq!(Frame::read(&longer, 0, None).unwrap_err().fault, Fault::Trailing);
}

#[test]
fn the_longest_frame_is_read_and_a_longer_one_refused() {
    let head = |payload: usize| {
        let [low, high] = (payload as u16).to_le_bytes();
        [0xa7, 0x5d, low, high, 0, 0, 0, 0]
    };
    let longest = MAX_FRAME_BYTES - frame_length(&head(0)).unwrap();
    assert_eq!(frame_length(&head(longest)), Ok(MAX_FRAME_BYTES));
    assert_eq!(frame_length(&head(longest + 1)), Err(Fault::Length { length: longest as u32 + 1 }));
}
