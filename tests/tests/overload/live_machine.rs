//! Conversations of the fuzz target `machine`, with bytes that a seed makes.

use ferrostep_gcode::Emergency;
use ferrostep_step_player::Pulses;
use ferrostep_testkit::board_model::{CYCLES_A_MS, Costs, with_board};
use ferrostep_testkit::live_machine::live_machine;

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

/// Sixty seeds: a run tries its share; `FERROSTEP_SEEDS=60-1000` tries others.
#[test]
fn hostile_conversations_are_answered_and_positions_stay_exact() {
    let seeds = std::env::var("FERROSTEP_SEEDS").ok();
    let seeds: Vec<u64> = match seeds.as_deref().map(|seeds| seeds.split_once('-')) {
        Some(Some((first, last))) => (first.parse().unwrap()..last.parse().unwrap()).collect(),
        _ => ferrostep_random_cases::share_of(60).collect(),
    };
    let mut failed = Vec::new();
    let names = ["cartesian", "corexy", "prusa-mini"];
    for (name, seed) in seeds.into_iter().flat_map(|seed| names.map(|name| (name, seed))) {
        let profile = ferrostep_profiles::load(name).unwrap();
        let outcome = std::panic::catch_unwind(|| live_machine(&profile, &bytes(seed, 1500)));
        if outcome.is_err() {
            failed.push((name, seed));
        }
    }
    let again = "FERROSTEP_SEEDS=SEED-END cargo test -p ferrostep-tests hostile_conversations, with END after SEED";
    assert!(failed.is_empty(), "{} conversations went wrong: {failed:?}; again: {again}", failed.len());
}

/// The chords that were taken before a stop have been pushed, the others have not; E says both.
#[test]
fn e_is_exact_after_a_stop_in_an_arc() {
    let profile = ferrostep_profiles::load("cartesian").unwrap();
    let mut stopped = 0;
    for after_ms in (1..60).map(|k| k * 97) {
        with_board::<Pulses, _>(&profile, 3, Costs::BOARD, |board| {
            let mut printer = board.printer();
            for line in ["M302 P1", "M82", "G92 E3"] {
                board.execute(&mut printer, 1, line).unwrap();
            }
            board.act_at(board.now() + after_ms * CYCLES_A_MS, Emergency::QuickStop);
            stopped += u32::from(board.execute(&mut printer, 1, "G2 I10 J0 E23 F900").is_err());
            board.stay_silent(5_000);
            board.execute(&mut printer, 1, "M410").unwrap();
            let [.., extruder] = board.counted_steps();
            let [.., extruder_10nm] = printer.logical_10nm();
            let pushed_mm = extruder as f64 / profile.steps_per_mm[3].to_f64();
            let told_mm = extruder_10nm as f64 / 1e5 - 3.0;
            assert!(
                (pushed_mm - told_mm).abs() < 0.02,
                "after {after_ms} ms: {pushed_mm} mm pushed, {told_mm} mm told"
            );
            let tally_mm = printer.tally().filament_100pm as f64 / 1e7;
            assert!(
                (pushed_mm - tally_mm).abs() < 0.02,
                "after {after_ms} ms: {pushed_mm} mm pushed, {tally_mm} mm counted"
            );
        });
    }
    assert!(stopped > 20, "{stopped}");
}

/// A firmware retraction does not count in E, however far it was when the machine was stopped.
#[test]
fn e_is_exact_after_a_stop_in_a_firmware_retraction() {
    let profile = ferrostep_profiles::load("cartesian").unwrap();
    let (mut before, mut within, mut after) = (0, 0, 0);
    for after_ms in (1..140).map(|k| k * 10) {
        with_board::<Pulses, _>(&profile, 8, Costs::BOARD, |board| {
            let mut printer = board.printer();
            for line in ["M302 P1", "M83", "G1 X20 E2 F3000", "G10", "G1 X40"] {
                board.execute(&mut printer, 1, line).unwrap();
            }
            board.act_at(board.now() + after_ms * CYCLES_A_MS, Emergency::QuickStop);
            let _ = board.execute(&mut printer, 1, "M400");
            board.execute(&mut printer, 1, "M410").unwrap();
            let [x, _, _, e] = board.counted_steps();
            let [.., extruder_10nm] = printer.logical_10nm();
            let told_mm = extruder_10nm as f64 / 1e5;
            let pushed_mm = e as f64 / profile.steps_per_mm[3].to_f64();
            if x < 1_600 {
                before += 1;
                assert!((pushed_mm - told_mm).abs() < 0.02, "after {after_ms} ms: {pushed_mm} pushed, {told_mm} told");
            } else {
                within += u32::from(x == 1_600 && pushed_mm > -0.99);
                after += u32::from(x > 1_600);
                assert!((told_mm - 2.0).abs() < 0.02, "after {after_ms} ms: {told_mm} told");
            }
            let tally_mm = printer.tally().filament_100pm as f64 / 1e7;
            assert!((pushed_mm - tally_mm).abs() < 0.02, "after {after_ms} ms: {pushed_mm} pushed, {tally_mm} counted");
        });
    }
    assert!(before > 10 && within > 3 && after > 10, "{before} {within} {after}");
}
