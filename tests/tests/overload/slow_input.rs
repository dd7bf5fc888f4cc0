//! A host or an executor that is too slow.

use ferrostep_testkit::board_model::{Costs, HostLine, LOOK_AHEAD_BLOCKS};
use ferrostep_testkit::stress_file::stress_file;

use crate::overload::invariants::{Print, Speeds, is_smooth, print, profile};

/// Pieces of the file: 0.3 m, one second at full feed.
const PIECES: u32 = 6_000;

#[track_caller]
fn smooth_print(speeds: &Speeds) -> Print {
    let print = print(&profile(), &stress_file(PIECES, 5), speeds);
    is_smooth(&print, &profile());
    // Planning is fast: only the input is slow.
    assert_eq!((print.figures.slowed_moves, print.figures.planning_slowdowns), (0, 0));
    print
}

#[test]
fn slow_lines_brake_the_machine_on_its_path() {
    let ample = smooth_print(&Speeds::ample());
    // The file ends without a flush, so the ring's last blocks leave because steps run out.
    let at_the_end = ample.figures.starvation_flushes;
    assert!((1..=LOOK_AHEAD_BLOCKS as u64 + 8).contains(&at_the_end), "{at_the_end}");
    for rate in [100, 300, 1_000, 3_000, 10_000, 20_000] {
        for burst in [1, 50] {
            let slow = smooth_print(&Speeds::with_host(HostLine::bursts(rate, burst)));
            let seconds = slow.watch.seconds();
            println!(
                "{rate} lines/s by {burst}: {seconds:.2} s, {} starved, {} idle flushes",
                slow.figures.starvation_flushes, slow.figures.idle_flushes
            );
            assert_eq!(slow.counted_steps, ample.counted_steps);
            if rate >= 10_000 {
                assert_eq!(slow.figures.starvation_flushes, at_the_end);
                assert!((seconds / ample.watch.seconds() - 1.0).abs() < 0.001, "{seconds}");
            } else {
                // Either the motors caught up with the input, or it came in portions with
                // silence between them.
                assert!(slow.figures.starvation_flushes > at_the_end || slow.figures.idle_flushes > 10);
                // The print takes as long as the lines take, except for the moves in ring and
                // queue: up to eight pieces share a block.
                let lines = f64::from(PIECES) / rate as f64;
                let ahead = 8.0 * LOOK_AHEAD_BLOCKS as f64 / rate as f64;
                assert!(seconds > 0.95 * (lines - ahead), "{seconds} s at {rate} lines/s");
                assert!(seconds < 1.05 * lines + 0.2, "{seconds} s at {rate} lines/s");
            }
        }
    }
}

#[test]
fn motion_stops_and_resumes_with_its_input() {
    let ample = smooth_print(&Speeds::ample());
    for before_line in [500, 2_000, 2_001, 3_333, 5_000] {
        let print = smooth_print(&Speeds::with_host(HostLine::steady(20_000).with_silence(before_line, 500)));
        assert_eq!(print.counted_steps, ample.counted_steps);
        let later = print.watch.seconds() - ample.watch.seconds();
        assert!((0.3..0.6).contains(&later), "{later} s later");
        let stands = print.feeds.iter().filter(|&&feed| feed == 0.0).count();
        assert!(stands > 300, "stands for {stands} ms");
    }
}

#[test]
fn a_slow_executor_acts_like_slow_input() {
    for times in [4, 16, 64] {
        let costs = Costs { line: Costs::BOARD.line * times, ..Costs::BOARD };
        let print = smooth_print(&Speeds { costs, ..Speeds::ample() });
        println!("executor {times} times slower: {:.2} s", print.watch.seconds());
    }
}
