//! Step times of S-curves against f64.
#![allow(clippy::unwrap_used)]

use ferrostep_random_cases::{Random, share_of};

use super::StepTimes;
use crate::TICKS_PER_SECOND;
use crate::block::{Acceleration, Speed};
use crate::s_curve::law::{Along, Curve};
use crate::s_curve::run::Planning;
use crate::s_curve::textbook::Ramp;
use crate::s_curve::{Jerk, Run};
use crate::spacing::{MotorSteps, Spacing, Span};
use crate::stretches::Stretch;
use crate::time_law::TimeLaw;
use crate::time_units::FRACTION_BITS;

/// A microsecond.
const MAX_TICKS_OFF: f64 = 84.0;

const MAX_STEPS_PER_S: f64 = 500_000.0;

const UNIT: f64 = 1.0 / (1u64 << FRACTION_BITS) as f64;

fn random_run(random: &mut Random) -> Run {
    loop {
        let jerk = Jerk::from_mm_per_s3(random.magnitude(100.0, 5e6)).unwrap();
        let acceleration = Acceleration::from_mm_per_s2(random.magnitude(20.0, 20_000.0));
        let planning = Planning::new(jerk, acceleration);
        let length_10nm = random.magnitude(1.0, 3e7) as u32 + 1;
        let most = Speed::from_mm_per_s(random.magnitude(0.05, 500.0));
        let entry = match random.bits() % 3 {
            0 => Speed::ZERO,
            _ => Speed((f64::from(most.0) * random.share()) as u32),
        };
        let wanted = Speed((f64::from(most.0) * random.share()) as u32);
        let wanted = if random.bits().is_multiple_of(3) { Speed::ZERO } else { wanted };
        let exit = planning.exit_within(entry, wanted, length_10nm);
        if exit > most || !planning.fits(entry, exit, length_10nm) {
            continue;
        }
        let peak = planning.peak(entry, exit, most, length_10nm);
        let run = Run { length_10nm, entry, peak, exit, acceleration, jerk };
        let law = Along::new(&Curve::new(&run), 0, length_10nm);
        if law.duration_ticks() < 20 * u64::from(TICKS_PER_SECOND) {
            return run;
        }
    }
}

/// t(s) of a run, by bisection of s(t): from its start in the first half of the whole, from its
/// end in the second.
struct Exact {
    up: Ramp,
    down: Ramp,
    cruise_mm: f64,
    cruise_s: f64,
}

impl Exact {
    fn new(run: &Run) -> Self {
        let ramp = |from: Speed, to: Speed| {
            Ramp::new(from.mm_per_s(), to.mm_per_s(), run.jerk.mm_per_s3(), run.acceleration.mm_per_s2())
        };
        let peak = run.peak.max(Speed(1));
        let (up, down) = (ramp(run.entry, peak), ramp(run.exit, peak));
        let cruise_mm = f64::from(run.length_10nm) / 1e5 - up.length() - down.length();
        Self { up, down, cruise_mm, cruise_s: cruise_mm / peak.mm_per_s() }
    }

    fn duration_s(&self) -> f64 {
        2.0 * (self.up.half_time_s + self.down.half_time_s) + self.cruise_s
    }

    /// Time at a place, s.
    fn seconds(&self, from_start: f64, to_end: f64) -> f64 {
        let solve = |ramp: &Ramp, length: f64| {
            let (mut low, mut high) = (0.0, 2.0 * ramp.half_time_s);
            for _ in 0..80 {
                let middle = (low + high) / 2.0;
                if ramp.length_at(middle) < length { low = middle } else { high = middle }
            }
            low
        };
        if from_start < self.up.length() {
            solve(&self.up, from_start)
        } else if to_end < self.down.length() {
            // A deceleration is the acceleration backwards.
            self.duration_s() - solve(&self.down, to_end)
        } else {
            2.0 * self.up.half_time_s + (from_start - self.up.length()) / self.cruise_mm.max(1e-30) * self.cruise_s
        }
    }
}

/// Random places of steps in a block: shares of its length.
fn random_steps(random: &mut Random, length: f64, fastest: f64) -> Option<MotorSteps> {
    let length_mm = length / 1e5;
    let most = (MAX_STEPS_PER_S / fastest * length_mm).min(200_000.0);
    if most < 1.0 {
        return None;
    }
    let count = random.magnitude(1.0, (length_mm * 1_600.0).clamp(1.0, most)) as u32;
    if !random.bits().is_multiple_of(4) {
        return Some(MotorSteps::Even { count });
    }
    let first = (random.bits() % 257) as u32;
    let whole = (first + (random.bits() % 256) as u32 + (count - 1) * 256).max(1);
    Some(MotorSteps::Extruder { whole, first, count })
}

/// Times of all steps against the exact ones: ticks off at most; and the amount by which an
/// interval was, as a share of a tick and a ten-thousandth of it.
fn deviations(
    law: &TimeLaw,
    length: f64,
    motor: MotorSteps,
    random: &mut Random,
    exact: impl Fn(f64, f64) -> f64,
) -> [f64; 2] {
    let stretch = Stretch {
        before_10nm: 0,
        length_10nm: length as u32,
        after_10nm: 0,
        steps: [0; 3],
        extruder_256ths: 0,
        line: 1,
        ends_move: true,
    };
    let steps = Spacing::new(&Span::whole(length, 1.0 / length), &motor);
    let count = steps.count;
    let mut times = StepTimes::NONE;
    times.start(law, &stretch, &motor, 0);
    let (mut worst, mut interval) = (0.0f64, 0.0f64);
    let mut before: Option<(u64, f64)> = None;
    let mut last = 0;
    let sparse = count > 2_000;
    for index in 0..count {
        let time = times.next().unwrap();
        assert!(time >= last, "step {index} of {count}");
        if !sparse || index < 20 || count - index < 20 || random.bits().is_multiple_of(64) {
            let place = steps.first + f64::from(index) * steps.spacing;
            let rest = steps.after_last + f64::from(count - 1 - index) * steps.spacing;
            let tick = exact(place, rest);
            worst = worst.max((time as f64 * UNIT - tick).abs());
            if let Some((before, exact_before)) = before {
                let exact = tick - exact_before;
                let off = ((time - before) as f64 * UNIT - exact).abs();
                interval = interval.max(off / (1.0 + 1e-4 * exact));
            }
            before = Some((time, tick));
        } else {
            before = None;
        }
        last = time;
        times.take(1);
    }
    assert_eq!(times.next(), None);
    [worst, interval]
}

#[test]
fn steps_of_random_runs_are_within_a_microsecond() {
    let (mut worst, mut worst_interval) = (0.0f64, 0.0f64);
    for number in share_of(40_000) {
        let mut random = Random::numbered(number);
        let run = random_run(&mut random);
        let curve = Curve::new(&run);
        let exact = Exact::new(&run);
        let whole = run.length_10nm;
        // All of it, or a block of it.
        let offset = if random.bits().is_multiple_of(2) { 0 } else { (f64::from(whole - 1) * random.share()) as u32 };
        let length = match random.bits() % 3 {
            0 => whole - offset,
            _ => ((f64::from(whole - offset) * random.share()) as u32).max(1),
        };
        let law = Along::new(&curve, offset, length);
        let fastest = run.peak.mm_per_s().max(0.001);
        let Some(steps) = random_steps(&mut random, law.length, fastest) else { continue };
        let rest = whole - offset - length;
        let start_tick = law.start as f64 * UNIT;
        let [off, interval] = deviations(&TimeLaw::Run(law), law.length, steps, &mut random, |place, behind| {
            let (from_start, to_end) = (f64::from(offset) + place, f64::from(rest) + behind);
            exact.seconds(from_start / 1e5, to_end / 1e5) * f64::from(TICKS_PER_SECOND) - start_tick
        });
        assert!(off <= MAX_TICKS_OFF, "{off} ticks off: {run:?} {offset} {length} {steps:?}");
        worst = worst.max(off);
        worst_interval = worst_interval.max(interval);
    }
    println!("{worst:.2} ticks off at most, intervals {worst_interval:.2}");
    assert!(worst_interval <= 2.0, "{worst_interval}");
}

#[test]
fn durations_of_a_run_s_blocks_add_up_to_its_own() {
    let mut random = Random(77);
    for _ in 0..5_000 {
        let run = random_run(&mut random);
        let curve = Curve::new(&run);
        let exact = Exact::new(&run).duration_s() * f64::from(TICKS_PER_SECOND);
        let whole = Along::new(&curve, 0, run.length_10nm).duration_ticks();
        assert!((whole as f64 - exact).abs() <= 1.0 + 1e-9 * exact, "{whole} {exact} {run:?}");
        let (mut offset, mut sum) = (0, 0);
        let mut speed = run.entry;
        while offset < run.length_10nm {
            let length = (random.magnitude(1.0, f64::from(run.length_10nm)) as u32).clamp(1, run.length_10nm - offset);
            let law = Along::new(&curve, offset, length);
            sum += law.duration_ticks();
            let exit = law.exit();
            // No faster than the acceleration allows, from block to block.
            let seconds = (law.duration_ticks() + 2) as f64 / f64::from(TICKS_PER_SECOND);
            let most = run.acceleration.mm_per_s2() * seconds * (1.0 + 1e-3) + 1e-3;
            assert!((exit.mm_per_s() - speed.mm_per_s()).abs() <= most, "{run:?} {offset} {length}");
            speed = exit;
            offset += length;
        }
        assert_eq!(sum, whole);
        assert!(speed.0.abs_diff(run.exit.0) <= 1 + (run.exit.0 >> 20), "{speed:?} {run:?}");
    }
}
