//! Any bytes as a printer's memory for settings.

#![allow(clippy::unwrap_used)]

use std::cell::RefCell;

use ferrostep_gcode::Reply;
use ferrostep_printer::{Profile, Replies, SettingsMemory, stored_keys};
use ferrostep_session::Session;
use ferrostep_settings::{Entry, MemoryFlash, RecordWriter, Slot, Store, StoreError, id_of};

const SECTOR: usize = 2048;
const BYTES: usize = 2 * SECTOR;

/// Blocks in the look-ahead ring.
const LOOK_AHEAD: usize = 8;

/// A memory that keeps what it is given.
#[derive(Debug)]
struct Memory(RefCell<Store<MemoryFlash<Vec<u8>, SECTOR>>>);

impl SettingsMemory for Memory {
    fn load<'s>(&self, slot: &'s mut Slot) -> Result<Option<&'s [u8]>, StoreError> {
        self.0.borrow_mut().load(slot)
    }
    fn save(&self, record: &[u8]) -> Result<(), StoreError> {
        self.0.borrow_mut().save(record)
    }
    fn stalls(&self) -> bool {
        true
    }
}

/// Replies of the printer.
#[derive(Debug, Default)]
struct Said(RefCell<Vec<String>>);

impl Replies for Said {
    fn send(&self, reply: Reply<'_>) {
        self.0.borrow_mut().push(reply.to_string());
    }
}

/// A flash with these bytes; or, if the first is odd, with a record of values that are in them,
/// most by names that exist.
fn memory(profile: &Profile, bytes: &[u8]) -> Memory {
    let mut flash = vec![0xff; BYTES];
    let (kind, rest) = bytes.split_first().unwrap_or((&0, &[]));
    if kind % 2 == 0 {
        flash.iter_mut().zip(rest).for_each(|(cell, byte)| *cell = *byte);
        return Memory(RefCell::new(Store::new(MemoryFlash::new(flash)).unwrap()));
    }
    let memory = Memory(RefCell::new(Store::new(MemoryFlash::new(flash)).unwrap()));
    let names: Vec<&str> = stored_keys().map(|(name, _)| name).collect();
    let mut record = RecordWriter::new(profile.name);
    for [name, index, value @ ..] in rest.as_chunks::<6>().0 {
        let id = names.get(usize::from(*name)).map_or(u16::from(*name), |name| id_of(name));
        // A few bits give many values: of both signs, of all magnitudes, infinite,
        // and not a number.
        let value = f64::from(f32::from_le_bytes(*value));
        record.add(Entry { id, index: *index, value });
    }
    memory.save(record.bytes()).unwrap();
    memory
}

/// Switches a machine on with any bytes in its memory. Its settings are always such as commands
/// set: M503's report is accepted when it is sent back, and changes nothing; and M500 stores the
/// settings so that they are the same again.
///
/// # Panics
/// One of these does not hold.
pub fn any_memory(profile: &Profile, bytes: &[u8]) {
    let memory = memory(profile, bytes);
    let session = Session::estimate(*profile, LOOK_AHEAD, Said::default());
    let mut printer = session.printer();
    printer.set_settings_memory(&memory);
    printer.restore_settings();
    let mut say = |line: &str| {
        session.replies().0.borrow_mut().clear();
        let outcome = session.run(printer.execute(1, line));
        assert_eq!(outcome, Ok(()), "{line}");
        session.replies().0.take()
    };
    let reported = say("M503 S0");
    for line in &reported {
        if let Some(command) = line.strip_prefix("echo:  ") {
            say(command);
        }
    }
    assert_eq!(say("M503 S0"), reported);
    assert!(say("M500")[0].starts_with("echo:Settings Stored ("));
    say("M502");
    assert!(say("M501")[0].ends_with("0 faults)"), "what M500 has stored is right");
    assert_eq!(say("M503 S0"), reported);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2_000))]
        #[test]
        fn any_bytes_give_settings_that_commands_can_set(
            name in prop::sample::select(vec!["cartesian", "corexy", "prusa-mini"]),
            values in prop::collection::vec((0..35_u8, 0..5_u8, value()), 0..40),
            bytes in prop::collection::vec(any::<u8>(), 0..200),
            is_record: bool,
        ) {
            let profile = ferrostep_profiles::load(name).unwrap();
            let bytes: Vec<u8> = if is_record {
                let values = values.iter().flat_map(|(name, index, value)| {
                    [*name, *index].into_iter().chain(value.to_le_bytes())
                });
                [1].into_iter().chain(values).collect()
            } else {
                [0].into_iter().chain(bytes).collect()
            };
            any_memory(&profile, &bytes);
        }
    }

    /// Values within the ranges of some settings, and any.
    fn value() -> impl Strategy<Value = f32> {
        prop_oneof![
            any::<f32>(),
            0.0..1.0_f32,
            0.0..500.0_f32,
            (0..1000_u32).prop_map(|whole| whole as f32),
            (300_000..600_000_u32).prop_map(|kind| kind as f32),
        ]
    }
}
