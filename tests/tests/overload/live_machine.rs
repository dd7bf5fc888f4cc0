//! Conversations of the fuzz target `machine`, with bytes that a seed makes.

use ferrostep_tests::live_machine::live_machine;

/// SplitMix64 (Steele, Lea, Flood 2014).
fn bytes(seed: u64, length: usize) -> Vec<u8> {
    let mut state = seed;
    std::iter::repeat_with(move || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut word = state;
        word = (word ^ word >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        word = (word ^ word >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        (word ^ word >> 31).to_le_bytes()
    })
    .flatten()
    .take(length)
    .collect()
}

/// `FERROSTEP_SEEDS=60-1000` tries others.
#[test]
fn whatever_is_said_the_machine_answers_and_knows_where_it_is() {
    let seeds = std::env::var("FERROSTEP_SEEDS").ok();
    let [first, last] = match seeds.as_deref().map(|seeds| seeds.split_once('-')) {
        Some(Some((first, last))) => [first, last].map(|seed| seed.parse().unwrap()),
        _ => [0, 60],
    };
    let mut failed = Vec::new();
    for (name, seed) in (first..last).flat_map(|seed| ["cartesian", "corexy", "prusa-mini"].map(|name| (name, seed))) {
        let profile = ferrostep_profiles::load(name).unwrap();
        let outcome = std::panic::catch_unwind(|| live_machine(&profile, &bytes(seed, 1500)));
        if outcome.is_err() {
            failed.push((name, seed));
        }
    }
    assert!(failed.is_empty(), "{} conversations went wrong: {failed:?}", failed.len());
}
