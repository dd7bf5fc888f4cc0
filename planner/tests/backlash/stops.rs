//! Exactness of the place after a stop, whatever waited for its motors.

use ferrostep_planner::backlash::{Backlash, BacklashCorrection};
use proptest::prelude::*;

use crate::backlash::follows::Axes;
use crate::backlash::machine::{Bench, any_backlash, any_path, plan};

proptest! {
    #![proptest_config(ferrostep_random_cases::cases(300))]

    /// Motion ends before any of the last events; then another path begins there.
    #[test]
    fn stops_lose_nothing(
        (path, then) in (any_path(), any_path()), backlash in any_backlash(),
        part in 0.0..1.0_f64, dropped in 0usize..400,
    ) {
        // Few enough steps that none is forgotten.
        let backlash = Backlash { play_mm: backlash.play_mm.map(|mm| mm / 8.0), ..backlash };
        let portions = plan(&path, false);
        let portions = &portions[..(portions.len() as f64 * part) as usize];
        let (mut plain, mut corrected) = (Bench::new(&Backlash::NONE), Bench::new(&backlash));
        plain.run(portions, false);
        corrected.run(portions, false);
        let events = &corrected.seen.0;
        let made = events.len().saturating_sub(dropped);
        let tick = made.checked_sub(1).map_or(0, |last| events[last].0);
        let plain: Vec<_> = plain.seen.0.into_iter().filter(|event| event.0 <= tick).collect();
        let mut axes = Axes::new(&backlash);
        axes.follow(&plain, &events[..made], &backlash);
        let (mut signed, mut issued) = ([0i32; 4], [0u32; 4]);
        for (_, motors, directions) in &events[made..] {
            for motor in (0..4).filter(|motor| motors >> motor & 1 == 1) {
                issued[motor] += 1;
                signed[motor] += if directions >> motor & 1 == 0 { 1 } else { -1 };
            }
        }
        corrected.ledger.take_back(signed, issued);
        let directions = corrected.ledger.directions();
        let taken_up = corrected.stage.stand(corrected.ledger.issued(), directions);
        prop_assert_eq!(taken_up, axes.taken_up());

        // The plan counts on from here without these steps, and the axes arrive at its places.
        let portions = plan(&then, false);
        let mut plain = Bench::new(&Backlash::NONE);
        plain.run(&portions, false);
        let mut next = Bench::new(&Backlash::NONE);
        std::mem::swap(&mut next.stage, &mut corrected.stage);
        // The step queue's direction signals are the ones from before.
        next.stage.stand([0; 4], 0);
        next.run(&portions, false);
        axes.rest(0);
        axes.follow(&plain.seen.0, &next.seen.0, &backlash);
        prop_assert_eq!(axes.most, 0);
    }
}

#[test]
fn a_new_count_of_the_motors_leaves_their_play_as_it_is() {
    let backlash = Backlash { play_mm: [0.2, 0.0, 0.0], correction: 1.0, smoothing_mm: 1.0 };
    let portions = plan(&[to(5, 1), to(2, 2)], false);
    let mut bench = Bench::new(&backlash);
    bench.run(&portions, false);
    assert_eq!(bench.stage.stand(bench.ledger.issued(), bench.ledger.directions()), [-16, 0, 0]);
    bench.stage.redefined();
    assert_eq!(bench.stage.stand(bench.ledger.issued(), bench.ledger.directions()), [0; 3]);
    // The axis is at the lower side of its motor: only upwards there is play.
    bench.ledger.redefine_motor_steps([2 * 80, 0, 0]);
    let portions = plan(&[to(-1, 1), to(3, 2)], false);
    bench.run(&portions, false);
    assert_eq!(bench.ledger.motor_steps()[0], 5 * 80 + 16);
}

fn to(x: i64, line: u32) -> ferrostep_planner::Move {
    let target_10nm = [x * crate::backlash::machine::MM, 0, 0];
    ferrostep_planner::Move { target_10nm, filament_100pm: 0, feed_mm_per_s: 20.0, line, ends_move: true }
}
