//! Any text is another firmware's configuration or an error that can be told; what comes of it has passed the checks of profiles.
#![no_main]

use ferrostep::import::of_text;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    let Ok(text) = std::str::from_utf8(input) else { return };
    // A file that includes itself.
    match of_text("any", text, &mut |name| Ok(vec![(name.to_owned(), text.to_owned())])) {
        Ok(imported) => assert!(imported.rows.iter().all(|row| row.kept.is_some() || !row.why.is_empty())),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});
