//! A planner that is too slow.

use ferrostep_testkit::board_model::{CYCLES_PER_S, Costs};
use ferrostep_testkit::stress_file::stress_file;

use crate::overload::invariants::{Speeds, is_smooth, print, profile};

/// Pieces of the file: 0.3 m, one second at full feed.
const PIECES: u32 = 6_000;

fn slower(times: u64) -> Speeds {
    Speeds { costs: Costs::BOARD.with_slower_planner(times, 0), ..Speeds::ample() }
}

#[test]
fn a_fast_planner_changes_nothing() {
    let text = stress_file(PIECES, 5);
    let ample = print(&profile(), &text, &Speeds::ample());
    let slow = print(&profile(), &text, &slower(3));
    is_smooth(&slow, &profile());
    assert_eq!(slow.figures.planning_slowdowns, 0);
    assert_eq!(slow.figures.order_digest, ample.figures.order_digest);
    assert_eq!(slow.figures.step_digest, ample.figures.step_digest);
}

#[test]
fn steps_stay_exact_with_any_slow_planner() {
    let text = stress_file(PIECES, 5);
    let ample = print(&profile(), &text, &Speeds::ample());
    for times in [8, 16, 32, 64, 256] {
        let slow = print(&profile(), &text, &slower(times));
        assert_eq!(slow.counted_steps, ample.counted_steps);
        assert!(slow.watch.seconds() > ample.watch.seconds());
    }
}

#[test]
fn a_slow_planner_lowers_the_feed() {
    let text = stress_file(PIECES, 5);
    for times in [8, 16, 32, 64] {
        let slow = print(&profile(), &text, &slower(times));
        println!(
            "planner {times} times slower: {:.2} s, {} underruns, {} slowdowns",
            slow.watch.seconds(),
            slow.figures.underruns,
            slow.figures.planning_slowdowns
        );
        is_smooth(&slow, &profile());
        // The planner is slow, and always at work: no more than a third of the time is
        // lost to margins.
        assert!(slow.figures.planning_slowdowns > 0);
        let busy = busy_seconds(times);
        assert!(slow.watch.seconds() < 1.5 * busy, "{} s, of which {busy} are work", slow.watch.seconds());
    }
}

/// The queue holds 43 ms of motion at full feed, and braking takes 30 ms: 90 moves, for which a
/// planner that is 16 times slower needs 40 ms and one that is 32 times slower 80 ms.
#[test]
fn a_planner_that_slows_down_at_speed_brakes_in_time() {
    let text = stress_file(PIECES, 5);
    for (times, most_underruns) in [(8, 0), (16, 0), (32, 1)] {
        for from_ms in [100, 200, 300, 500, 777] {
            let costs = Costs::BOARD.with_slower_planner(times, from_ms);
            let slow = print(&profile(), &text, &Speeds { costs, ..Speeds::ample() });
            let underruns = slow.figures.underruns;
            println!("{times} times slower from {from_ms} ms on: {underruns} underruns");
            assert_eq!(underruns, slow.watch.all_stops_from_speed());
            assert!(underruns <= most_underruns);
            if underruns == 0 {
                is_smooth(&slow, &profile());
            }
        }
    }
}

#[test]
fn an_honest_budget_needs_no_pace() {
    let mut slow_machine = profile();
    // Planning 16 times slower takes 27,600 ticks a move.
    slow_machine.move_cost_ticks = 45_000;
    let slow = print(&slow_machine, &stress_file(PIECES, 5), &slower(16));
    is_smooth(&slow, &slow_machine);
    assert_eq!((slow.figures.slowed_moves, slow.figures.planning_slowdowns), (u64::from(PIECES), 0));
}

/// Minimum time that the file costs, s: its lines, and a move and two entries for each in
/// the planner task.
fn busy_seconds(times: u64) -> f64 {
    let Costs { line, planned_move, entry, .. } = Costs::BOARD;
    (u64::from(PIECES) * (line + (planned_move + 2 * entry) * times)) as f64 / CYCLES_PER_S as f64
}
