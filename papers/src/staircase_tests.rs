//! Step times of staircases against f64.
#![allow(clippy::unwrap_used)]

use ferrostep_planner::inner_ends::InnerEnds;
use ferrostep_planner::methods::SpeedRule;
use ferrostep_planner::stretches::Stretch;
use ferrostep_planner::time_units::FRACTION_BITS;
use ferrostep_planner::{Acceleration, Block, MotorSteps, PlannedBlock, Speed};
use ferrostep_random_cases::Random;

use crate::laws::PaperRule;
use crate::pulses::{Law, Times};
use crate::staircase::{BlockPulses, Staircase};
use crate::table::FrequencyTable;

/// Tolerance of a step time, ticks: one microsecond.
const MAX_TICKS_OFF: f64 = 84.0;

const MAX_STEPS_PER_S: f64 = 500_000.0;

const UNIT: f64 = 1.0 / (1u64 << FRACTION_BITS) as f64;

/// Random steps of a motor, with the position of the first one and the distance between steps, as
/// shares of the block's length.
fn random_steps(random: &mut Random, length_mm: f64, fastest: f64) -> Option<(MotorSteps, u32, [f64; 2])> {
    let most = (MAX_STEPS_PER_S / fastest * length_mm).min(200_000.0);
    if most < 1.0 {
        return None;
    }
    let count = random.magnitude(1.0, (length_mm * 1_600.0).clamp(1.0, most)) as u32;
    if !random.bits().is_multiple_of(4) {
        let spacing = 1.0 / f64::from(count);
        return Some((MotorSteps::Even { count }, count, [0.5 * spacing, spacing]));
    }
    let first = (random.bits() % 257) as u32;
    let whole = (first + (random.bits() % 256) as u32 + (count - 1) * 256).max(1);
    let shares = [f64::from(first), 256.0].map(|travel| travel / f64::from(whole));
    Some((MotorSteps::Extruder { whole, first, count }, count, shares))
}

#[test]
fn steps_of_random_staircases_are_within_a_microsecond() {
    let mut worst = 0.0f64;
    for number in ferrostep_random_cases::share_of(20_000) {
        let mut random = Random::numbered(number);
        let start_hz = random.magnitude(100.0, 3_000.0);
        let top_hz = start_hz * random.magnitude(1.01, 80.0);
        let table = FrequencyTable::new(start_hz, top_hz, random.magnitude(2e4, 5e7)).unwrap();
        let steps = random.magnitude(1.0, 30_000.0) as i32;
        let block = Block {
            steps: [steps, 0, 0],
            extruder_256ths: 0,
            length_10nm: (f64::from(steps) * random.magnitude(100.0, 2_000.0)) as u32,
            nominal: Speed::from_mm_per_s(random.magnitude(0.5, 400.0)),
            acceleration: Acceleration::from_mm_per_s2(1.0),
            line: 1,
            ends_move: true,
            inner_ends: InnerEnds::NONE,
        };
        let pulses = BlockPulses::of(&block);
        let nominal = block.nominal.min(pulses.speed(top_hz)).max(Speed(1));
        let entry = Speed((f64::from(nominal.0) * random.share()) as u32);
        let exit = pulses.reach(&table, entry).min(Speed((f64::from(nominal.0) * random.share()) as u32));
        let exit = exit.max(pulses.slowest(&table, entry, Speed::ZERO));
        let planned = PlannedBlock { block, entry, exit };
        let exact = Staircase::new(&planned, &table);
        let length = f64::from(block.length_10nm);
        let Some((motor, count, [first, spacing])) = random_steps(&mut random, length / 1e5, nominal.mm_per_s()) else {
            continue;
        };
        let mut times = Times::NONE;
        times.start(&Law::Other(PaperRule::Table(table).law(&planned)), &Stretch::whole(&block), &motor, 0);
        let mut last = 0;
        for index in 0..count {
            let time = times.next().unwrap();
            assert!(time >= last, "step {index} of {count}");
            if count <= 2_000 || index < 20 || count - index < 20 || random.bits().is_multiple_of(64) {
                let place = length * (first + spacing * f64::from(index));
                let off = (time as f64 - exact.time(place)).abs() * UNIT;
                assert!(off <= MAX_TICKS_OFF, "{off} ticks off: {planned:?} {table:?}");
                worst = worst.max(off);
            }
            last = time;
            times.take(1);
        }
        assert_eq!(times.next(), None);
    }
    println!("{worst:.2} ticks off at most");
}
