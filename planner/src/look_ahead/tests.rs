use super::*;
use crate::block::Acceleration;
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

/// Both passes over the whole list, the plain way.
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
        // Whole units of 10 nm, as in a block.
        let moves: Vec<_> = moves.into_iter().map(|(v, a, length, j)| (v, a, f64::floor(length * 1e5) / 1e5, j)).collect();
        let mut ring = BlockQueue::<_>::new(vec![Slot::EMPTY; 128]);
        for (i, &(nominal, acceleration, length, junction)) in moves.iter().enumerate() {
            let block = block(nominal, acceleration, length);
            let corner = Speed::from_mm_per_s(junction.sqrt());
            prop_assert!(ring.push(&block, &BlockStart::after_corner(corner, &block)));
            if markers >> (i % 64) & 1 == 1 {
                let pushed = ring.push_marker(Marker::FanPower { power: 7 });
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
