use super::*;
use crate::block::Acceleration;
use crate::block_queue::BlockQueue;
use proptest::prelude::*;

fn block(nominal: f64, acceleration: f64, length_mm: f64) -> Block {
    Block {
        steps: [100, 0, 0],
        extruder_256ths: 0,
        length_10nm: (length_mm * 100_000.0).round() as u32,
        nominal: Speed::from_mm_per_s(nominal),
        acceleration: Acceleration::from_mm_per_s2(acceleration),
        line: 0,
        ends_move: true,
        inner_ends: Default::default(),
    }
}

/// Reference: both passes over the whole list, the plain way.
fn reference(moves: &[(f64, f64, f64, f64)]) -> Vec<f64> {
    let mut entries: Vec<f64> = vec![0.0; moves.len() + 1];
    for i in 1..moves.len() {
        entries[i] = moves[i].3.min(moves[i].0 * moves[i].0).min(moves[i - 1].0 * moves[i - 1].0);
    }
    for i in (0..moves.len()).rev() {
        entries[i] = entries[i].min(entries[i + 1] + 2.0 * moves[i].1 * moves[i].2);
    }
    entries[0] = 0.0;
    for i in 0..moves.len() {
        entries[i + 1] = entries[i + 1].min(entries[i] + 2.0 * moves[i].1 * moves[i].2);
    }
    entries.iter().map(|squared| squared.sqrt()).collect()
}

proptest! {
    #[test]
    fn an_ample_ring_equals_both_passes_over_everything(
        moves in proptest::collection::vec((1.0f64..300.0, 100.0f64..10_000.0, 0.01f64..20.0, 0.0f64..40_000.0), 1..60),
        markers in any::<u64>(),
    ) {
        // Whole units of 10 nm and of 2^-8 mm/s^2, as in a block.
        let whole = |value: f64, per_unit: f64| (value * per_unit).floor() / per_unit;
        let moves: Vec<_> =
            moves.into_iter().map(|(v, a, length, j)| (v, whole(a, 256.0), whole(length, 1e5), j)).collect();
        let mut ring = BlockQueue::<_>::new(vec![Slot::EMPTY; 128]);
        for (i, &(nominal, acceleration, length, junction)) in moves.iter().enumerate() {
            let block = block(nominal, acceleration, length);
            let corner = Speed::from_mm_per_s(junction.sqrt());
            prop_assert!(ring.push(&block, &BlockStart::after_corner(corner, &block)));
            if markers >> (i % 64) & 1 == 1 {
                let pushed = ring.push_marker(Marker::FanPower { fan: 0, power: 7 });
                prop_assert!(pushed);
            }
        }
        prop_assert!(!ring.can_leave());
        ring.flush();
        let expected = reference(&moves);
        let mut at = 0;
        while let Some(left) = ring.pop(Pace::FULL) {
            let Released::Block(planned) = left else { continue };
            prop_assert!((planned.entry.mm_per_s() - expected[at]).abs() < 1e-3);
            prop_assert!((planned.exit.mm_per_s() - expected[at + 1]).abs() < 1e-3);
            at += 1;
        }
        prop_assert_eq!(at, moves.len());
    }

    #[test]
    fn a_small_ring_never_breaks_an_acceleration(
        moves in proptest::collection::vec((1.0f64..300.0, 100.0f64..10_000.0, 0.01f64..20.0, 0.0f64..40_000.0), 1..200),
        capacity in 2usize..16, flushes in any::<u128>(),
    ) {
        let mut ring = BlockQueue::<_>::new(vec![Slot::EMPTY; capacity]);
        let mut left = Vec::new();
        for (i, &(nominal, acceleration, length, junction)) in moves.iter().enumerate() {
            while !ring.has_room() {
                left.extend(ring.pop(Pace::FULL));
            }
            let block = block(nominal, acceleration, length);
            let corner = Speed::from_mm_per_s(junction.sqrt());
            prop_assert!(ring.push(&block, &BlockStart::after_corner(corner, &block)));
            if flushes >> (i % 128) & 7 == 7 {
                ring.release();
                left.extend(ring.pop(Pace::FULL));
            }
        }
        ring.flush();
        while let Some(one) = ring.pop(Pace::FULL) {
            left.push(one);
        }
        let mut speed = Speed::ZERO;
        for one in left {
            let Released::Block(planned) = one else { continue };
            prop_assert_eq!(planned.entry, speed);
            speed = planned.exit;
            let reach = 2.0 * planned.block.acceleration.mm_per_s2() * planned.block.length_mm();
            prop_assert!((planned.exit.squared() - planned.entry.squared()).abs() <= reach + 0.02);
            prop_assert!(planned.entry <= planned.block.nominal && planned.exit <= planned.block.nominal);
        }
        prop_assert_eq!(speed, Speed::ZERO);
    }
}

/// The blocks of some moves as they leave a ring of this many places. After each arrival, final
/// ones may leave if `early` allows.
fn as_they_leave(
    moves: &[(f64, f64, f64, f64)],
    places: usize,
    mut early: impl FnMut(&mut BlockQueue<Vec<Slot>>) -> bool,
) -> Vec<PlannedBlock> {
    let mut ring = BlockQueue::<_>::new(vec![Slot::EMPTY; places]);
    let mut left = Vec::new();
    let mut take = |ring: &mut BlockQueue<_>| {
        while let Some(Released::Block(planned)) = ring.pop(Pace::FULL) {
            left.push(planned);
        }
    };
    for &(nominal, acceleration, length, junction) in moves {
        let block = block(nominal, acceleration, length);
        assert!(ring.push(&block, &BlockStart::after_corner(Speed::from_mm_per_s(junction.sqrt()), &block)));
        if early(&mut ring) {
            ring.release_final();
        }
        take(&mut ring);
    }
    ring.flush();
    take(&mut ring);
    left
}

proptest! {
    /// Final blocks leave with the same speeds at any time, so the plan of a host's moves equals
    /// that of a file's, although the ring is seldom full.
    #[test]
    fn final_blocks_leave_with_the_same_speeds_at_any_time(
        moves in proptest::collection::vec((1.0f64..300.0, 100.0f64..10_000.0, 0.01f64..20.0, 0.0f64..40_000.0), 1..120),
        places in 2usize..40,
        whenever in any::<u128>(),
    ) {
        let patient = as_they_leave(&moves, places, |_| false);
        let mut turn = 0;
        let eager = as_they_leave(&moves, places, |ring| {
            turn += 1;
            let released = ring.is_first_final() && whenever >> (turn % 128) & 1 == 1;
            // The time of releasable blocks is that of the blocks.
            assert_eq!(ring.final_ticks() > 0, ring.is_first_final());
            released
        });
        prop_assert_eq!(eager, patient);
    }
}

#[test]
fn a_block_before_a_slow_corner_is_final_and_the_last_never() {
    let mut left = 0;
    let corners = [(100.0, 1000.0, 20.0, 0.0); 5];
    as_they_leave(&corners, 128, |ring| {
        left += usize::from(ring.is_first_final());
        true
    });
    assert_eq!(left, 4, "each but the first move ends the doubt about the one before");
    // A straight line at a speed from which 20 blocks of a millimetre cannot brake: nothing is
    // final.
    let mut finals = 0;
    as_they_leave(&[(300.0, 1000.0, 1.0, 1e9); 20], 128, |ring| {
        finals += usize::from(ring.is_first_final());
        true
    });
    assert_eq!(finals, 0);
}
