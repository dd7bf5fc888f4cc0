//! Any bytes as a short conversation with a small and fast machine in virtual time: what `machine`
//! does, and checks, in a hundredth of the time.
#![no_main]

use std::cell::OnceCell;

use ferrostep_printer::Profile;
use ferrostep_testkit::live_machine::{small, small_machine};
use libfuzzer_sys::fuzz_target;

thread_local! {
    static PROFILES: OnceCell<[Profile; 3]> = const { OnceCell::new() };
}

fn profiles() -> [Profile; 3] {
    ["cartesian", "corexy", "prusa-mini"]
        .map(|name| small(&ferrostep_profiles::load(name).expect("a built-in profile")))
}

fuzz_target!(|bytes: &[u8]| {
    let Some((&first, rest)) = bytes.split_first() else { return };
    PROFILES.with(|loaded| small_machine(&loaded.get_or_init(profiles)[usize::from(first % 3)], rest));
});
