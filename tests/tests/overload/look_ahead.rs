//! Moves of 0.05 mm at 300 mm/s: the ring is long enough for them.

use ferrostep_testkit::stress_file::{FEED_MM_PER_S, PIECE_MM, stress_file};

use crate::overload::invariants::{Speeds, is_smooth, print, profile};

/// Pieces of the file: 3 m.
const PIECES: u32 = 60_000;

#[test]
fn a_ring_of_128_is_as_fast_as_an_unlimited_one() {
    // Corners of rounding limit the feed at three decimals; at five the file's feed is reached.
    for (decimals, least_feed) in [(3, 0.5), (5, 0.85)] {
        let text = stress_file(PIECES, decimals);
        let whole = Speeds { look_ahead: PIECES as usize + 10, ..Speeds::ample() };
        let unlimited = print(&profile(), &text, &whole);
        let board = print(&profile(), &text, &Speeds::ample());
        assert_eq!(board.figures.issued_steps, unlimited.figures.issued_steps);
        assert_eq!(board.figures.slowed_moves, 0);
        is_smooth(&board, &profile());
        let mean = |seconds: f64| f64::from(PIECES) * PIECE_MM / seconds;
        let (fed, wanted) = (mean(board.watch.seconds()), mean(unlimited.watch.seconds()));
        println!("{decimals} decimals: {fed:.2} mm/s, {wanted:.2} mm/s without end");
        assert!(wanted > least_feed * FEED_MM_PER_S, "{wanted} mm/s is no stress");
        assert!((fed / wanted - 1.0).abs() < 0.02, "{fed} mm/s instead of {wanted}");
    }
}
