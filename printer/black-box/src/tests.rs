//! Tests of dumps from the board's memories to the desk, and of other input there.

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use ferrostep_step_player::{MAX_EVENTS, Past, PastSlot, PositionMark};
use proptest::prelude::*;

use crate::*;

/// Slots by number, and their played events.
#[derive(Clone, Debug)]
struct Steps {
    past: Past,
    slots: Vec<Option<PastSlot>>,
}

impl StepPast for &Steps {
    fn past(&self) -> Past {
        self.past
    }

    fn slot(&self, number: u32) -> Option<PastSlot> {
        self.slots.get(number.wrapping_sub(self.past.oldest) as usize).copied().flatten()
    }
}

fn any_slot() -> impl Strategy<Value = PastSlot> {
    let reload = prop_oneof![4 => 84_u32..90_000, 1 => 1..=u32::MAX];
    let events = prop_oneof![4 => 1..40_u16, 1 => 1..=MAX_EVENTS];
    (0..16_u8, 0..16_u8, 0..16_u8, 0..16_u8, reload, events).prop_map(
        |(first, then, turned, backwards, reload, events)| PastSlot {
            first,
            then,
            turned,
            backwards: backwards & turned,
            reload,
            events,
        },
    )
}

fn any_position() -> impl Strategy<Value = Option<PositionMark>> {
    prop::option::of(any::<(u32, u32, u32, [i32; 4])>()).prop_map(|position| {
        position.map(|(filled, next, now_ms, motor_steps)| PositionMark { filled, next, now_ms, motor_steps })
    })
}

prop_compose! {
    fn any_steps()(
        slots in prop::collection::vec(any_slot(), 0..300), oldest: u32, begun: prop::sample::Index, left: u16, directions in 0..16_u8,
        is_kept: bool, positions in [any_position(), any_position()],
    ) -> Steps {
        let begun = begun.index(slots.len() + 1);
        let events_left = if begun == 0 { 0 } else { left % slots[begun - 1].events };
        let filled = oldest.wrapping_add(slots.len() as u32);
        let past = Past { oldest, next: oldest.wrapping_add(begun as u32), filled, events_left, directions, is_kept, positions };
        Steps { past, slots: slots.into_iter().map(Some).collect() }
    }
}

const FACTS: Facts<'_> = Facts {
    both_edges: true,
    tick_hz: 84_000_000,
    pulse_ticks: 84,
    now_ms: 123_456,
    names: ["bench", "cartesian", "0.2.0 (commit 0123abc)"],
};

/// The lines, which must be in order and no longer than the others; their bytes.
fn bytes(mut dump: Dump<'_, &Steps>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut line = heapless::String::new();
    let mut number = 0;
    while dump.next_line(&mut line) {
        let contents = line.strip_prefix(PREFIX).unwrap();
        let (place, text) = contents.split_once(':').unwrap();
        if place == END {
            assert_eq!(text.parse::<u32>().unwrap(), number);
            assert!(!dump.next_line(&mut line));
            return bytes;
        }
        assert_eq!(place.parse::<u32>().unwrap(), number);
        number += 1;
        bytes.extend(BASE64_STANDARD.decode(text).unwrap());
    }
    panic!("no end");
}

fn memory(texts: &[Vec<u8>]) -> RecordMemory {
    let memory = RecordMemory::new();
    memory.restart(0);
    for (now_ms, text) in (0..).zip(texts) {
        memory.record(now_ms, 0, &Record::Command { line: now_ms, text });
        memory.record(
            now_ms,
            0,
            &Record::Temperatures([HeaterSample::new(214.96, 215.0, 0.5), HeaterSample::default()]),
        );
        memory.record(now_ms, 0, &Record::Chamber(HeaterSample::new(-1.0, 50.0, 1.0)));
    }
    memory
}

proptest! {
    #![proptest_config(ferrostep_random_cases::cases(256))]
    #[test]
    fn the_desk_reads_what_the_board_has(
        steps in any_steps(), texts in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..60), 0..100),
    ) {
        let memory = memory(&texts);
        let sent = bytes(Dump::new(&steps, &memory, FACTS));
        let contents = Contents::read(&sent).unwrap();
        prop_assert_eq!(format!("{:?}", contents.facts()), format!("{FACTS:?}"));
        prop_assert!(contents.has_memory && !contents.is_damaged);
        prop_assert_eq!(contents.slots.clone().map(Some).collect::<Vec<_>>(), steps.slots.clone());
        // The desk numbers the slots from 0.
        let oldest = steps.past.oldest;
        let from_0 = |number: u32| number.wrapping_sub(oldest);
        let positions = steps.past.positions.map(|position| {
            position.map(|mark| PositionMark { filled: from_0(mark.filled), next: from_0(mark.next), ..mark })
        });
        let expected = Past { oldest: 0, next: from_0(steps.past.next), filled: from_0(steps.past.filled), positions, ..steps.past };
        prop_assert_eq!(contents.past, expected);
        let records: Vec<_> = contents.records.collect::<Option<_>>().unwrap();
        prop_assert!(records.len() >= (3 * texts.len()).min(80));
        for stamped in records {
            match stamped.record {
                Record::Command { line, text } => {
                    let whole = &texts[line as usize];
                    prop_assert_eq!(text, &whole[..whole.len().min(MAX_COMMAND_BYTES)]);
                }
                Record::Temperatures([nozzle, _]) => prop_assert_eq!((nozzle.decicelsius, nozzle.target_decicelsius), (2149, 2150)),
                Record::Chamber(chamber) => prop_assert_eq!(chamber, HeaterSample { decicelsius: -10, target_decicelsius: 500, power: 255 }),
                other => prop_assert!(false, "{other:?}"),
            }
        }
    }

    /// Memory that did not survive the reset: only the slots after it remain.
    #[test]
    fn damaged_slots_are_left_out(mut steps in any_steps(), place: prop::sample::Index) {
        prop_assume!(!steps.slots.is_empty());
        let place = place.index(steps.slots.len());
        steps.slots[place] = None;
        let memory = RecordMemory::new();
        let sent = bytes(Dump::new(&steps, &memory, FACTS));
        let contents = Contents::read(&sent).unwrap();
        prop_assert!(contents.is_damaged && !contents.has_memory);
        prop_assert_eq!(contents.slots.map(Some).collect::<Vec<_>>(), steps.slots[place + 1..].to_vec());
    }

    /// A byte changed in transit is noticed, and so is a missing one.
    #[test]
    fn damage_is_noticed(steps in any_steps(), place: prop::sample::Index, bits in 1_u8..) {
        let memory = memory(&[]);
        let mut sent = bytes(Dump::new(&steps, &memory, FACTS));
        let place = place.index(sent.len());
        sent[place] ^= bits;
        prop_assert!(Contents::read(&sent).is_err());
        sent[place] ^= bits;
        sent.remove(place);
        prop_assert!(Contents::read(&sent).is_err());
    }

    /// Arbitrary bytes with a valid checksum are read without a panic.
    #[test]
    fn anything_can_be_read(begins_well: bool, mut bytes in prop::collection::vec(prop_oneof![Just(0), Just(1), any::<u8>()], 0..400)) {
        if begins_well {
            bytes.splice(..0, *b"FBX1");
        }
        let checksum = crate::dump::CRC.checksum(&bytes);
        bytes.extend(checksum.to_le_bytes());
        if let Ok(contents) = Contents::read(&bytes) {
            let _ = contents.records.count();
            prop_assert_eq!(contents.slots.count(), contents.past.filled as usize);
        }
    }
}

/// Check value from the CRC catalogue.
#[test]
fn the_checksum_is_that_of_its_name() {
    assert_eq!(crate::dump::CRC.checksum(b"123456789"), 0xcbf4_3926);
}
