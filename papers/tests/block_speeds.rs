//! Speeds of random blocks under the papers' laws: each block changes its speed within its law.

#![allow(clippy::unwrap_used, missing_docs)]

use ferrostep_papers::closed_form::Ramp;
use ferrostep_papers::five_segments::FiveSegments;
use ferrostep_papers::table::FrequencyTable;
use ferrostep_planner::block_queue::BlockQueue;
use ferrostep_planner::inner_ends::InnerEnds;
use ferrostep_planner::look_ahead::{BlockStart, Released, Slot, SpeedLaw};
use ferrostep_planner::methods::SpeedRule;
use ferrostep_planner::{Acceleration, Block, Pace, PlannedBlock, Speed};
use ferrostep_random_cases::{Random, SlicerBlock, SlicerBlocks};

/// Converts a drawn block to one for the ring, with the maximum speed of the corner before it.
fn of_slicer(drawn: &SlicerBlock) -> (Block, Speed) {
    let block = Block {
        steps: drawn.steps,
        extruder_256ths: drawn.extruder_256ths,
        length_10nm: drawn.length_10nm,
        nominal: Speed::from_mm_per_s(drawn.nominal_mm_per_s).max(Speed(1)),
        acceleration: Acceleration::from_mm_per_s2(drawn.acceleration_mm_per_s2),
        line: 1,
        ends_move: true,
        inner_ends: InnerEnds::NONE,
    };
    (block, Speed::from_mm_per_s(drawn.corner_mm_per_s))
}

/// Sends random blocks through look-ahead, and checks every one that leaves: it begins as fast as
/// the one before ended.
fn check_blocks<R: SpeedRule>(random: &mut Random, rule: R, pace: Pace, mut check: impl FnMut(&PlannedBlock)) {
    let mut ring = BlockQueue::new(vec![Slot::EMPTY; 2 + random.bits() as usize % 40]);
    ring.look_ahead(&SpeedLaw::Other(rule));
    let mut kind = SlicerBlocks::new(random);
    let mut speed = Speed::ZERO;
    let mut leave = |left: Released| {
        let Released::Block(planned) = left else { panic!("{left:?}") };
        assert_eq!(planned.entry, speed);
        speed = planned.exit;
        let fastest = planned.block.nominal.mm_per_s() * (1.0 + 1e-9);
        assert!(speed.mm_per_s() <= fastest, "{planned:?}");
        check(&planned);
    };
    for _ in 0..300 {
        while !ring.has_room() {
            leave(ring.pop(pace).unwrap());
        }
        let (block, corner) = of_slicer(&kind.next(random));
        assert!(ring.push(&block, &BlockStart::after_corner(corner.min(block.nominal), &block)));
    }
    ring.flush();
    while let Some(left) = ring.pop(pace) {
        leave(left);
    }
    assert_eq!(speed, Speed::ZERO);
}

/// Speeds join under a table, and a block changes them only through its pulses.
#[test]
fn blocks_under_a_table_never_jump() {
    let mut random = Random(300);
    for _ in 0..300 {
        let start_hz = random.magnitude(100.0, 3_000.0);
        let top_hz = start_hz * random.magnitude(1.5, 40.0);
        let table = FrequencyTable::new(start_hz, top_hz, random.magnitude(2e4, 5e7)).unwrap();
        check_blocks(&mut random, table, Pace::FULL, |planned| {
            let block = &planned.block;
            let pulses = f64::from((block.master_steps() * 256).max(block.extruder_256ths.unsigned_abs())) / 256.0;
            if pulses < 1.0 {
                assert_eq!(planned.entry, planned.exit);
            }
            let per_mm = pulses / block.length_mm();
            let [start, stop] = [planned.entry, planned.exit].map(|speed| table.pulses_to(speed.mm_per_s() * per_mm));
            assert!((stop - start).abs() <= pulses * (1.0 + 1e-4) + 1e-3, "{planned:?} {start} {stop}");
        });
    }
}

/// Li's ramps fit their blocks, even if corners become faster later, or the pace changes.
#[test]
fn ramps_of_five_segments_fit_their_blocks() {
    let (mut tried, mut ramps) = (0u32, 0u32);
    for number in ferrostep_random_cases::share_of(600) {
        let (mut random, number) = (Random::numbered(number), number as u16);
        tried += 1;
        let jerk = random.magnitude(100.0, 5e6).floor();
        let pace = if number % 3 == 0 { Pace::from_256ths(40 + number % 200) } else { Pace::FULL };
        check_blocks(&mut random, FiveSegments::new(jerk).unwrap(), pace, |planned| {
            let PlannedBlock { block, entry, exit } = planned;
            let [from, to] = [entry, exit].map(|speed| speed.mm_per_s());
            let ramp = Ramp::new(from, to, jerk, block.acceleration.mm_per_s2()).unwrap();
            // A unit of speed is 2^-16 mm/s.
            let slack = 1e-6 * block.length_mm() + 1e-5 + (from + to) * 1e-5;
            assert!(ramp.length() <= block.length_mm() + slack, "{planned:?} {}", ramp.length());
            ramps += u32::from(from != to);
        });
    }
    assert!(ramps > 17 * tried, "{ramps} in {tried} rows of blocks");
}
