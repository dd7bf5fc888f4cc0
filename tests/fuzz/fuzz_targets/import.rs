//! Any text is another firmware's configuration, or the report of a running one, or an error that
//! can be told; what comes of it has passed the checks of profiles.
#![no_main]

use ferrostep_import::{of_running_marlin, of_text};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| {
    let Ok(text) = std::str::from_utf8(input) else { return };
    let imported = match text.strip_prefix('@') {
        Some(report) => {
            let lines: Vec<String> = report.lines().map(str::to_owned).collect();
            of_running_marlin("any", &lines, &lines, None, true)
        }
        // A file that includes itself.
        None => of_text("any", text, &mut |name| Ok(vec![(name.to_owned(), text.to_owned())])),
    };
    match imported {
        Ok(imported) => assert!(imported.rows.iter().all(|row| row.kept.is_some() || !row.why.is_empty())),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});
