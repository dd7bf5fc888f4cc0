//! 2.1: the step interrupt must store the reload value of a gap before the gap begins.

use super::scene::{MS, S, SendLines, Setting, run_scenario};

/// Instructions per second and entry, ns: the mean of the cycle model; two cycles an instruction;
/// two cycles with wait states and an entry of 29 cycles.
const PACES: [(u64, u64); 3] = [(120_000_000, 71), (84_000_000, 71), (60_000_000, 173)];
/// 150 mm/s at 100 steps/mm.
const CRUISE_NS: u64 = 66_667;
/// Minimum gap of a print's steps.
const MIN_GAP_NS: u64 = 1_500;
const MIN_PULSE_NS: u64 = 950;

/// A figure of the reply to M797.
fn figure(text: &str, name: &str) -> Option<u64> {
    let (_, rest) = text.split_once(&format!("{name}:"))?;
    rest.split(|character: char| !character.is_ascii_digit()).next()?.parse().ok()
}

#[test]
fn steps_keep_their_intervals_with_a_slow_interrupt() {
    let mut wrong = Vec::new();
    for pace in PACES {
        let setting = Setting { pace: Some(pace), ..Setting::default() };
        let lines = ["M302 P1", "M83", "G91", "G1 X-30 F9000", "G4 P50", "G1 X30 Y29 E3 F9000", "M400", "M797"];
        let done = run_scenario(&setting, 10 * S, SendLines::lines(&lines));
        assert!(done.operator.ended, "{pace:?}: {}", done.operator.talk.text());
        let text = done.operator.talk.text();
        let mut decoder = done.machine().decoder.clone();
        let smallest = decoder.smallest();
        let events = decoder.finish();
        let rest = events.windows(2).position(|pair| pair[1].at_ns - pair[0].at_ns > 40 * MS).unwrap() + 1;
        let (alone, together) = events.split_at(rest);
        let gaps: Vec<u64> = alone.windows(2).map(|pair| pair[1].at_ns - pair[0].at_ns).collect();
        // 30 mm at 1250 mm/s^2: 12 mm at full speed, in the middle.
        let cruise = &gaps[gaps.len() / 3..gaps.len() * 2 / 3];
        let worst = cruise.iter().map(|gap| gap.abs_diff(CRUISE_NS)).max().unwrap();
        let mean = cruise.iter().sum::<u64>() as f64 / cruise.len() as f64;
        let missed = figure(&text, "missed_updates").or_else(|| figure(&text, "made_up_updates"));
        let moved = |axis: u8| together.iter().filter(|event| event.axes & axis != 0).count();
        let found = format!(
            "{pace:?}: {} steps alone, intervals of {} to {} ns (mean {mean:.0}); together {} events over {:.3} ms, \
             smallest gap {} ns, smallest pulse {} ns, missed updates {missed:?}",
            alone.len(),
            cruise.iter().min().unwrap(),
            cruise.iter().max().unwrap(),
            together.len(),
            (together[together.len() - 1].at_ns - together[0].at_ns) as f64 / 1e6,
            smallest.gap_ns,
            smallest.pulse_ns()
        );
        println!("{found}");
        let is_right = (alone.len(), moved(1), moved(2)) == (3000, 3000, 2900)
            && worst < 500
            && smallest.gap_ns >= MIN_GAP_NS
            && smallest.pulse_ns() >= MIN_PULSE_NS
            && missed == Some(0);
        if !is_right {
            wrong.push(found);
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
