//! Moves that end inside a block: when they are told, and where the motors stand then.

#![allow(clippy::unwrap_used, missing_docs)]

use ferrostep_planner::inner_ends::{InnerEnd, InnerEnds};
use ferrostep_planner::interpolator::Interpolator;
use ferrostep_planner::time_law::TimeLaw;
use ferrostep_planner::{
    Acceleration, Block, Notice, PlannedBlock, Speed, StepEntry, StepKind, StepSink, TICKS_PER_SECOND,
};
use proptest::prelude::*;

const MINIMUM_INTERVAL: u32 = 168;
const LAST_LINE: u32 = 40;

/// What came out, in its order.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Happened {
    Event { tick: u64, axes: u8 },
    Ended { tick: u64, line: u32 },
}

impl Happened {
    fn tick(self) -> u64 {
        match self {
            Self::Event { tick, .. } | Self::Ended { tick, .. } => tick,
        }
    }
}

#[derive(Default)]
struct Record {
    tick: u64,
    happened: Vec<Happened>,
}

impl StepSink for Record {
    fn entry(&mut self, entry: StepEntry) {
        match entry.kind() {
            StepKind::Directions { .. } => {}
            StepKind::Wait { interval_ticks } => self.tick += u64::from(interval_ticks),
            StepKind::Stair { interval_ticks, count, axes, added } => {
                for index in 1..=count {
                    self.tick += u64::from(interval_ticks);
                    let axes = if index == count { axes ^ added } else { axes };
                    self.happened.push(Happened::Event { tick: self.tick, axes });
                }
            }
        }
    }

    fn notice(&mut self, notice: Notice) {
        if let Notice::MoveEnded { tick, line } = notice {
            self.happened.push(Happened::Ended { tick, line });
        }
    }
}

/// Everything that two blocks one after the other become.
fn play(blocks: &[PlannedBlock]) -> Vec<Happened> {
    let mut interpolator = Interpolator::new(MINIMUM_INTERVAL);
    let mut record = Record::default();
    for planned in blocks {
        interpolator.begin(planned, &TimeLaw::trapezoid(planned), &mut record);
        while interpolator.is_busy() {
            interpolator.advance(&mut record);
        }
    }
    record.happened
}

fn block(steps: [i32; 3], extruder_256ths: i32, length_10nm: u32, speeds: [f64; 3], acceleration: f64) -> PlannedBlock {
    PlannedBlock {
        block: Block {
            steps,
            extruder_256ths,
            length_10nm,
            nominal: Speed::from_mm_per_s(speeds[1]),
            acceleration: Acceleration::from_mm_per_s2(acceleration),
            line: LAST_LINE,
            ends_move: true,
            inner_ends: InnerEnds::NONE,
        },
        entry: Speed::from_mm_per_s(speeds[0]),
        exit: Speed::from_mm_per_s(speeds[2]),
    }
}

/// With ends at these path positions, of the lines before the block's own.
fn ending_at(mut planned: PlannedBlock, lengths_10nm: &[u32]) -> PlannedBlock {
    let first = LAST_LINE - lengths_10nm.len() as u32;
    for (line, length_10nm) in (first..).zip(lengths_10nm) {
        let end = InnerEnd { length_10nm: *length_10nm, line };
        planned.block.inner_ends = planned.block.inner_ends.with(end, line + 1).unwrap();
    }
    planned
}

/// Steps made by the time the path position is reached, X, Y, Z and the extruder, whose position before is a whole
/// step.
fn standing_at(planned: &PlannedBlock, length_10nm: u32) -> [u64; 4] {
    let (here, whole) = (u64::from(length_10nm), u64::from(planned.block.length_10nm));
    let steps = planned.block.steps.map(|steps| u64::from(steps.unsigned_abs()));
    let master = *steps.iter().max().unwrap();
    // (k - 1/2) S/N <= s
    let made = (1..=master).take_while(|k| (2 * k - 1) * whole <= 2 * master * here).count() as u64;
    // Follower step j comes with the first k that is above (j - 1/2) N/n.
    let [x, y, z] = steps.map(|n| (1..=n).take_while(|j| (2 * j - 1) * master < 2 * n * made).count() as u64);
    let travel = u64::from(planned.block.extruder_256ths.unsigned_abs());
    let e = (1..=travel).take_while(|j| (256 * j - 128) * whole <= travel * here).count() as u64;
    [x, y, z, e]
}

/// t(s) by the textbook, ticks from the block's start.
fn tick_at(planned: &PlannedBlock, length_10nm: u32) -> f64 {
    let (entry, exit) = (planned.entry.mm_per_s(), planned.exit.mm_per_s());
    let (a, s) = (planned.block.acceleration.mm_per_s2(), planned.block.length_mm());
    let here = f64::from(length_10nm) / 100_000.0;
    let peak = (a * s + (entry * entry + exit * exit) / 2.0).sqrt();
    let peak = peak.min(planned.block.nominal.mm_per_s()).max(entry).max(exit);
    let up = (peak * peak - entry * entry) / (2.0 * a);
    let down = (peak * peak - exit * exit) / (2.0 * a);
    let ramp =
        |from: f64, length: f64, a: f64| 2.0 * length / (from + (from * from + 2.0 * a * length).max(0.0).sqrt());
    let seconds = if here <= up {
        ramp(entry, here, a)
    } else if here <= s - down {
        (peak - entry) / a + (here - up) / peak
    } else {
        (peak - entry) / a + (s - up - down).max(0.0) / peak + ramp(peak, here - (s - down), -a)
    };
    seconds * f64::from(TICKS_PER_SECOND)
}

/// Every end is told once, in order, at its time, with the motors where they belong.
fn check(planned: &PlannedBlock, ends: &[u32], start_tick: u64, happened: &[Happened]) -> Result<(), TestCaseError> {
    for pair in happened.windows(2) {
        prop_assert!(pair[1].tick() >= pair[0].tick(), "{:?}", pair);
        if let [Happened::Ended { .. }, Happened::Event { .. }] = pair {
            prop_assert!(pair[1].tick() > pair[0].tick(), "{:?}", pair);
        }
    }
    let mut stand = [0u64; 4];
    let mut told = 0;
    let first = LAST_LINE - ends.len() as u32;
    for each in happened {
        match *each {
            Happened::Event { axes, .. } => {
                for (motor, steps) in stand.iter_mut().enumerate() {
                    *steps += u64::from(axes >> motor & 1);
                }
            }
            Happened::Ended { tick, line } => {
                prop_assert_eq!(line, first + told as u32);
                let length = ends.get(told).copied().unwrap_or(planned.block.length_10nm);
                prop_assert_eq!(stand, standing_at(planned, length), "line {}", line);
                let off = (tick - start_tick) as f64 - tick_at(planned, length);
                // Late by an event that kept its distance from others.
                prop_assert!(off > -84.0 && off < 84.0 + 2.0 * f64::from(MINIMUM_INTERVAL), "{} ticks off", off);
                told += 1;
            }
        }
    }
    prop_assert_eq!(told, ends.len() + 1);
    Ok(())
}

#[test]
fn an_end_in_the_cruise_cuts_the_stair() {
    // 20,000 steps a second: 4,200 ticks a step, the first after half of that.
    let whole = block([1_000, 0, 0], 0, 50_000, [10.0, 10.0, 10.0], 1_000.0);
    let planned = ending_at(whole, &[25_000, 25_010]);
    let happened = play(&[planned]);
    assert_eq!(happened.len(), 1_000 + 3);
    assert_eq!(happened[500], Happened::Ended { tick: 500 * 4_200, line: LAST_LINE - 2 });
    assert_eq!(happened[501], Happened::Ended { tick: 500 * 4_200 + 840, line: LAST_LINE - 1 });
    for (index, each) in happened[502..1_002].iter().enumerate() {
        let tick = (500 + index as u64) * 4_200 + 2_100;
        assert!(each.tick().abs_diff(tick) <= 1, "{each:?}");
    }
    assert_eq!(happened[1_002], Happened::Ended { tick: 4_200_000, line: LAST_LINE });
}

#[test]
fn ends_change_no_step() {
    let whole = block([733, 501, 0], 90_000, 60_000, [3.0, 150.0, 12.0], 2_000.0);
    let events = |planned: PlannedBlock| -> Vec<Happened> {
        play(&[planned]).into_iter().filter(|each| matches!(each, Happened::Event { .. })).collect()
    };
    let (plain, ended) = (events(whole), events(ending_at(whole, &[9_999, 30_000, 52_345])));
    // Where an event joined another across an end, there are now two.
    assert!((plain.len()..=plain.len() + 3).contains(&ended.len()));
    let steps = |events: &[Happened], motor: u8| -> Vec<u64> {
        let stepping =
            events.iter().filter(|each| matches!(each, Happened::Event { axes, .. } if axes >> motor & 1 == 1));
        stepping.map(|each| each.tick()).collect()
    };
    for motor in 0..4 {
        let (plain, ended) = (steps(&plain, motor), steps(&ended, motor));
        assert_eq!(plain.len(), ended.len());
        assert!(plain.iter().zip(&ended).all(|(a, b)| a.abs_diff(*b) <= u64::from(MINIMUM_INTERVAL)));
    }
}

proptest! {
    #![proptest_config(ferrostep_random_cases::cases(1_000))]

    #[test]
    fn motors_stand_at_every_end_where_the_path_position_says(
        steps in proptest::array::uniform3(-2_000i32..2_000), extruder in -400_000i32..400_000, length in 20_000u32..300_000,
        entry in 0.0f64..=1.0, exit in 0.0f64..=1.0, nominal in 1.0f64..200.0, acceleration in 100.0f64..10_000.0,
        ends in proptest::collection::vec(0u32..=65_535, 0..=7), twice in any::<bool>(),
    ) {
        let length_mm = f64::from(length) / 100_000.0;
        let most = steps.iter().map(|n| n.unsigned_abs()).max().unwrap().max(extruder.unsigned_abs() / 256);
        // No motor steps faster than events may follow each other.
        let rate = f64::from(TICKS_PER_SECOND) / f64::from(MINIMUM_INTERVAL);
        let nominal = nominal.min(length_mm / f64::from(most.max(1)) * rate);
        let entry = entry * nominal;
        let reach = 2.0 * acceleration * length_mm * 0.999;
        let slowest = (entry * entry - reach).max(0.0).sqrt();
        let fastest = (entry * entry + reach).sqrt().min(nominal);
        let exit = slowest + (fastest - slowest) * exit;
        let mut ends: Vec<u32> = ends.into_iter().map(|end| end.min(length)).collect();
        ends.sort_unstable();
        let planned = ending_at(block(steps, extruder, length, [entry, nominal, exit], acceleration), &ends);
        check(&planned, &ends, 0, &play(&[planned]))?;
        if twice && extruder % 256 == 0 {
            let happened = play(&[planned, planned]);
            let middle = happened.iter().position(|each| matches!(each, Happened::Ended { line: LAST_LINE, .. })).unwrap();
            check(&planned, &ends, happened[middle].tick(), &happened[middle + 1..])?;
        }
    }
}
