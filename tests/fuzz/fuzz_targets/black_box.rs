//! Any bytes are a black box that can be told, or an error; and so are any lines.
#![no_main]

use ferrostep_black_box::Contents;
use ferrostep_host::black_box_lines::from_text;
use ferrostep_session::black_box::BlackBoxReport;

use libfuzzer_sys::fuzz_target;

/// Maximum number of events; more would only take time.
const MAX_EVENTS: u64 = 20_000;

fuzz_target!(|bytes: &[u8]| {
    let _ = from_text(&String::from_utf8_lossy(bytes));
    // The bytes with their right checksum.
    let sealed = [bytes, &crc32fast::hash(bytes).to_le_bytes()].concat();
    let Ok(contents) = Contents::read(&sealed) else { return };
    let slots = contents.slots.clone();
    assert_eq!(slots.clone().count(), contents.past.filled as usize);
    if slots.map(|slot| u64::from(slot.events)).sum::<u64>() <= MAX_EVENTS {
        assert!(!BlackBoxReport::new(&contents, None).to_string().is_empty());
    }
});
