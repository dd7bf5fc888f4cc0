//! Moves that end inside a block: the time at which they are reported, and the
//! motor positions then.

#![allow(clippy::unwrap_used, missing_docs)]

use ferrostep_planner::inner_ends::{InnerEnd, InnerEnds};
use ferrostep_planner::interpolator::Interpolator;
use ferrostep_planner::time_law::TimeLaw;
use ferrostep_planner::{
    Acceleration, Block, Notice, PlannedBlock, Speed, Standard, StepEntry, StepKind, StepSink, TICKS_PER_SECOND,
};
use proptest::prelude::*;

const MINIMUM_INTERVAL: u32 = 168;
const LAST_LINE: u32 = 40;

/// Output, in order.
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

/// Plays two blocks one after the other and returns everything that they become.
fn play(blocks: &[PlannedBlock]) -> Vec<Happened> {
    let mut interpolator = Interpolator::<Standard>::new(MINIMUM_INTERVAL);
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

/// A move of a block: its length, its steps and the extruder's travel.
type Part = (u32, [i32; 3], i32);

/// A block of several moves, of the lines up to [`LAST_LINE`].
fn block_of(parts: &[Part], speeds: [f64; 3], acceleration: f64) -> PlannedBlock {
    let mut planned = block([0; 3], 0, 0, speeds, acceleration);
    let whole = &mut planned.block;
    let first = LAST_LINE + 1 - parts.len() as u32;
    for (index, (line, &(length_10nm, steps, extruder_256ths))) in (first..).zip(parts).enumerate() {
        whole.length_10nm += length_10nm;
        whole.extruder_256ths += extruder_256ths;
        whole.steps.iter_mut().zip(steps).for_each(|(sum, steps)| *sum += steps);
        if index + 1 < parts.len() {
            let end = InnerEnd { length_10nm: whole.length_10nm, steps, extruder_256ths, line, ends_move: true };
            whole.inner_ends = whole.inner_ends.with(end, line + 1).unwrap();
        }
    }
    planned
}

/// t(s) by the textbook, ticks from the block's start.
fn tick_at(planned: &PlannedBlock, length_10nm: f64) -> f64 {
    let (entry, exit) = (planned.entry.mm_per_s(), planned.exit.mm_per_s());
    let (a, s) = (planned.block.acceleration.mm_per_s2(), planned.block.length_mm());
    let here = length_10nm / 100_000.0;
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

/// Every end is noticed once, in order, at its time, with all motors exactly where their own
/// moves end; and between the ends the motor with most steps makes each of them when the path is
/// half a step before it.
fn check(planned: &PlannedBlock, parts: &[Part], happened: &[Happened]) -> Result<(), TestCaseError> {
    for pair in happened.windows(2) {
        prop_assert!(pair[1].tick() >= pair[0].tick(), "{:?}", pair);
        if let [Happened::Ended { .. }, Happened::Event { .. }] = pair {
            prop_assert!(pair[1].tick() > pair[0].tick(), "{:?}", pair);
        }
    }
    // Early by joining the event before, late by events that kept their distance from others, and
    // by the end before.
    let early = -84.0 - f64::from(MINIMUM_INTERVAL);
    let late = 84.0 + 3.0 * f64::from(MINIMUM_INTERVAL);
    let mut happened = happened.iter();
    let (mut length, mut extruder) = (0, 0i64);
    for (line, &(part_10nm, steps, extruder_256ths)) in (LAST_LINE + 1 - parts.len() as u32..).zip(parts) {
        let master = (0..3).max_by_key(|&motor| (steps[motor].unsigned_abs(), 2 - motor)).unwrap();
        let mut made = [0u64; 4];
        let end = loop {
            match happened.next() {
                Some(&Happened::Event { tick, axes }) => {
                    made.iter_mut().enumerate().for_each(|(motor, made)| *made += u64::from(axes >> motor & 1));
                    if axes >> master & 1 == 1 {
                        let share = (made[master] as f64 - 0.5) / f64::from(steps[master].unsigned_abs());
                        let due = tick_at(planned, f64::from(length) + share * f64::from(part_10nm));
                        let off = tick as f64 - due;
                        prop_assert!(
                            off > early && off < late,
                            "step {} of line {}: {} ticks off",
                            made[master],
                            line,
                            off
                        );
                    }
                }
                Some(&Happened::Ended { tick, line: told }) => {
                    prop_assert_eq!(told, line);
                    break tick;
                }
                None => return Err(TestCaseError::fail(format!("line {line} has no end"))),
            }
        };
        let [x, y, z] = steps.map(|steps| u64::from(steps.unsigned_abs()));
        let rounded = |units: i64| (units.abs() + 128) / 256 * units.signum();
        let before = rounded(extruder);
        extruder += i64::from(extruder_256ths);
        prop_assert_eq!(made, [x, y, z, rounded(extruder).abs_diff(before)], "line {}", line);
        length += part_10nm;
        let off = end as f64 - tick_at(planned, f64::from(length));
        prop_assert!(off > -84.0 && off < late, "line {} ends {} ticks off", line, off);
    }
    prop_assert!(happened.next().is_none());
    Ok(())
}

#[test]
fn an_end_in_the_cruise_cuts_the_stair() {
    // 20,000 steps a second: 4,200 ticks a step, the first after half of that.
    let parts = [(1_000, [20, 0, 0], 0), (10, [0; 3], 0), (4_990, [100, 0, 0], 0)];
    let planned = block_of(&parts, [10.0, 10.0, 10.0], 1_000.0);
    let happened = play(&[planned]);
    assert_eq!(happened.len(), 120 + 3);
    assert_eq!(happened[20], Happened::Ended { tick: 20 * 4_200, line: LAST_LINE - 2 });
    assert_eq!(happened[21], Happened::Ended { tick: 20 * 4_200 + 840, line: LAST_LINE - 1 });
    for (index, each) in happened[22..122].iter().enumerate() {
        // A hundred steps in 4,990 units.
        let tick = 84_840.0 + (index as f64 + 0.5) * 4_191.6;
        assert!((each.tick() as f64 - tick).abs() <= 32.0, "{each:?} {tick}");
    }
    assert_eq!(happened[122], Happened::Ended { tick: 504_000, line: LAST_LINE });
}

#[test]
fn a_motor_turns_round_inside_a_block() {
    let parts = [(4_000, [30, 10, 0], 300), (4_000, [30, -10, 0], 300), (4_000, [30, 0, 5], -300)];
    check(&block_of(&parts, [20.0, 20.0, 20.0], 1_000.0), &parts, &play(&[block_of(&parts, [20.0; 3], 1_000.0)]))
        .unwrap();
}

/// Generates up to eight moves of a block.
fn parts() -> impl Strategy<Value = Vec<Part>> {
    let steps = || prop_oneof![2 => Just(0), 1 => -1i32..=1, 3 => -12i32..=12, 1 => -127i32..=127];
    let part = (1u32..8_000, [steps(), steps(), steps()], prop_oneof![Just(0), -200i32..200, -4_000i32..4_000]);
    proptest::collection::vec(part, 1..=8)
}

proptest! {
    #![proptest_config(ferrostep_random_cases::cases(1_000))]

    #[test]
    fn motors_stand_at_every_end_where_their_moves_end(
        parts in parts(), entry in 0.0f64..=1.0, exit in 0.0f64..=1.0, nominal in 0.1f64..200.0,
        acceleration in 100.0f64..10_000.0,
    ) {
        let length_mm = parts.iter().map(|part| f64::from(part.0)).sum::<f64>() / 100_000.0;
        // No motor steps faster than a third of what events may follow each other: three motors
        // with times of their own.
        let rate = f64::from(TICKS_PER_SECOND) / f64::from(MINIMUM_INTERVAL) / 3.0;
        let nominal = parts.iter().fold(nominal, |nominal, (length, steps, extruder)| {
            let most = steps.iter().map(|n| n.unsigned_abs()).max().unwrap().max(extruder.unsigned_abs() / 256 + 1);
            nominal.min(f64::from(*length) / 100_000.0 / f64::from(most) * rate)
        });
        let entry = entry * nominal;
        let reach = 2.0 * acceleration * length_mm * 0.999;
        let slowest = (entry * entry - reach).max(0.0).sqrt();
        let fastest = (entry * entry + reach).sqrt().min(nominal);
        let exit = slowest + (fastest - slowest) * exit;
        let planned = block_of(&parts, [entry, nominal, exit], acceleration);
        check(&planned, &parts, &play(&[planned]))?;
    }
}
