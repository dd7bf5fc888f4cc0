//! State of the ring over a stop and a release, and the rounding of times: single values whose
//! errors do not show in whole prints.
#![allow(clippy::unwrap_used)]

use ferrostep_planner::block_queue::BlockQueue;
use ferrostep_planner::look_ahead::{BlockStart, Marker, Released, Slot};
use ferrostep_planner::methods::Never;
use ferrostep_planner::time_law::TimeLaw;
use ferrostep_planner::{Acceleration, Block, Pace, PlannedBlock, Speed};

/// A block along X; lengths in units of 10 nm, speeds in mm/s.
fn block(length_10nm: u32, nominal: f64) -> Block {
    Block {
        steps: [100, 0, 0],
        extruder_256ths: 0,
        length_10nm,
        nominal: Speed::from_mm_per_s(nominal),
        acceleration: Acceleration::from_mm_per_s2(1000.0),
        line: 1,
        ends_move: true,
        inner_ends: Default::default(),
    }
}

fn ring() -> BlockQueue<[Slot; 8]> {
    BlockQueue::new([Slot::EMPTY; 8])
}

/// Blocks of 10 mm at 100 mm/s that continue each other.
fn push(ring: &mut BlockQueue<[Slot; 8]>, count: usize) {
    for _ in 0..count {
        let block = block(1_000_000, 100.0);
        assert!(ring.push(&block, &BlockStart::after_corner(Speed::from_mm_per_s(100.0), &block)));
    }
}

fn pop(ring: &mut BlockQueue<[Slot; 8]>) -> PlannedBlock {
    match ring.pop(Pace::FULL) {
        Some(Released::Block(planned)) => planned,
        other => panic!("{other:?}"),
    }
}

/// A block in motion when the ring is cleared has no successor.
#[test]
fn after_a_stop_the_next_block_starts_from_standstill() {
    // All that waits is forgotten, or nothing waited: the block in motion was the last.
    for waiting in 0..4 {
        let mut ring = ring();
        push(&mut ring, 3 + waiting);
        for _ in 0..2 {
            ring.release();
            let left = pop(&mut ring);
            assert!(left.exit > Speed::ZERO);
        }
        ring.clear();
        assert!(ring.is_empty() && !ring.can_leave());
        push(&mut ring, 2);
        ring.flush();
        let (first, second) = (pop(&mut ring), pop(&mut ring));
        assert_eq!(first.entry, Speed::ZERO, "after a stop with {waiting} waiting");
        assert_eq!((second.entry, second.exit), (first.exit, Speed::ZERO));
    }
}

/// Releasing more than waits does not let later blocks leave early.
#[test]
fn no_more_is_released_than_waits() {
    let mut ring = ring();
    ring.release();
    push(&mut ring, 1);
    assert!(!ring.can_leave(), "released before it was there");
    for _ in 0..5 {
        ring.release();
    }
    pop(&mut ring);
    push(&mut ring, 3);
    assert!(!ring.can_leave(), "released with the one before");
    // One for each time, markers included.
    assert!(ring.push_marker(Marker::FanPower { fan: 0, power: 9 }));
    ring.release();
    ring.release();
    pop(&mut ring);
    pop(&mut ring);
    assert!(!ring.can_leave() && ring.len() == 2);
    // Nor with what was there before a stop.
    ring.flush();
    ring.clear();
    push(&mut ring, 1);
    assert!(!ring.can_leave());
}

/// 840 / v ticks a unit of 10 nm, whole ones, the nearest: in single precision and, beyond a
/// quarter of a second, in double.
#[test]
fn durations_are_rounded_to_the_nearest_tick() {
    let mut rounded_up = 0;
    for length in (1_000..1_040).chain(3_000_000..3_000_040) {
        let planned = PlannedBlock {
            block: block(length, 100.0),
            entry: Speed::from_mm_per_s(100.0),
            exit: Speed::from_mm_per_s(100.0),
        };
        let tenths = u64::from(length) * 84;
        let nearest = (tenths + 5) / 10;
        rounded_up += u32::from(nearest > tenths / 10);
        // No length lies half-way: 84 is even, and a half would be 5 tenths.
        assert_eq!(TimeLaw::<Never>::trapezoid(&planned).duration_ticks(), nearest, "{length}");
    }
    assert!(rounded_up > 20, "{rounded_up}");
}
