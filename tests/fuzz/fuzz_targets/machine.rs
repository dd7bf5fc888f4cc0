//! Any bytes as a conversation with the whole machine in virtual time: it answers, does not panic,
//! and reports the motors' true positions.
#![no_main]

use std::cell::OnceCell;

use ferrostep_printer::Profile;
use ferrostep_testkit::live_machine::live_machine;
use libfuzzer_sys::fuzz_target;

thread_local! {
    static PROFILES: OnceCell<[Profile; 3]> = const { OnceCell::new() };
}

fn profiles() -> [Profile; 3] {
    ["cartesian", "corexy", "prusa-mini"].map(|name| ferrostep_profiles::load(name).expect("a built-in profile"))
}

fuzz_target!(|bytes: &[u8]| {
    let Some((&first, rest)) = bytes.split_first() else { return };
    PROFILES.with(|loaded| live_machine(&loaded.get_or_init(profiles)[usize::from(first % 3)], rest));
});
