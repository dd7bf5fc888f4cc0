//! Look-ahead under an S-curve: the runs of random blocks keep jerk, acceleration, corners and
//! nominal speeds, and every block makes its steps.
//!
//! [`RUNS_VARIABLE`] sets how many runs are tried.

#![allow(clippy::unwrap_used, missing_docs)]

use ferrostep_planner::block_queue::BlockQueue;
use ferrostep_planner::inner_ends::InnerEnds;
use ferrostep_planner::interpolator::Interpolator;
use ferrostep_planner::look_ahead::{BlockStart, Marker, Part, Released, Slot, SpeedLaw};
use ferrostep_planner::methods::Never;
use ferrostep_planner::s_curve::{Jerk, Jerks, Run};
use ferrostep_planner::time_law::TimeLaw;
use ferrostep_planner::{
    Acceleration, Block, Notice, Pace, PlannedBlock, Speed, StepEntry, StepKind, StepSink, TICKS_PER_SECOND,
};
use ferrostep_random_cases::{Random, Share, SlicerBlock, SlicerBlocks, share_of};

#[path = "../src/s_curve/textbook.rs"]
mod textbook;

use textbook::Ramp;

/// Variable that sets the number of random runs.
const RUNS_VARIABLE: &str = "FERROSTEP_RUNS";

/// Random jobs, of which a test run tries its share: 100,000 runs in all.
const JOBS: u64 = 200;

/// A drawn block for the ring, and the most that the corner before it allows.
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

/// Counts steps and ticks.
#[derive(Default)]
struct Counter {
    directions: u8,
    steps: [i64; 4],
    ticks: u64,
    events: u64,
}

impl Counter {
    fn step(&mut self, axes: u8, count: u16) {
        for (axis, steps) in self.steps.iter_mut().enumerate() {
            let sign = if self.directions >> axis & 1 == 1 { -1 } else { 1 };
            *steps += sign * i64::from(axes >> axis & 1) * i64::from(count);
        }
    }
}

impl StepSink for Counter {
    fn entry(&mut self, entry: StepEntry) {
        match entry.kind() {
            StepKind::Directions { directions } => self.directions = directions,
            StepKind::Wait { interval_ticks } => self.ticks += u64::from(interval_ticks),
            StepKind::Stair { interval_ticks, count, axes, added } => {
                assert!(interval_ticks > 0);
                self.ticks += u64::from(interval_ticks) * u64::from(count);
                self.events += u64::from(count);
                self.step(axes, count - 1);
                self.step(axes ^ added, 1);
            }
        }
    }

    fn notice(&mut self, _: Notice) {}
}

/// The path's, and ten times it for the filament.
fn jerks(mm_per_s3: f64) -> Jerks {
    let [path, filament] = [1.0, FILAMENT].map(|times| Jerk::from_mm_per_s3(mm_per_s3 * times).unwrap());
    Jerks { path, filament }
}

/// Ratio of the filament's jerk to the path's.
const FILAMENT: f64 = 10.0;

/// The executor of the blocks that leave.
struct Stepper {
    interpolator: Interpolator,
    counter: Counter,
    should: [i64; 3],
    extruder_256ths: i64,
}

impl Stepper {
    fn new() -> Self {
        Self { interpolator: Interpolator::new(1), counter: Counter::default(), should: [0; 3], extruder_256ths: 0 }
    }

    /// Runs a block, to the step; its duration in ticks.
    fn run(&mut self, block: &Block, speeds: [Speed; 2], law: &TimeLaw) -> u64 {
        let [entry, exit] = speeds;
        let start = self.interpolator.clock();
        let ticks = self.interpolator.begin(&PlannedBlock { block: *block, entry, exit }, law, &mut self.counter);
        while self.interpolator.is_busy() {
            self.interpolator.advance(&mut self.counter);
        }
        assert_eq!(self.interpolator.clock(), start + ticks, "{block:?}");
        // A step may be a microsecond off, the last one past the end too.
        assert!(self.counter.ticks <= self.interpolator.clock() + 84, "{block:?}");
        for (should, steps) in self.should.iter_mut().zip(block.steps) {
            *should += i64::from(steps);
        }
        self.extruder_256ths += i64::from(block.extruder_256ths);
        assert_eq!(self.counter.steps[..3], self.should, "{block:?}");
        let pushed = (self.counter.steps[3] * 256 - self.extruder_256ths).abs();
        assert!(pushed <= 128, "{pushed} {block:?}");
        ticks
    }
}

/// Compares the blocks that leave with those that may.
struct Checker {
    jerk: f64,
    stepper: Stepper,
    /// Speed and ticks that the present run has reached.
    passes: Speed,
    ticks: u64,
    /// Blocks that went in and have not come out, with the corner before each.
    waiting: std::collections::VecDeque<(Block, Speed)>,
    speed: Speed,
    /// Path of the present run, and the part of it that has arrived.
    run: Option<(Part, u32)>,
    runs: u64,
    blocks: u64,
    /// Runs of several blocks, most blocks of one, and those of the present.
    shared: u64,
    most: u64,
    blocks_of_run: u64,
}

impl Checker {
    fn take(&mut self, left: Released) {
        let Released::Part(part) = left else { return };
        let (block, corner) = self.waiting.pop_front().unwrap();
        assert_eq!(part.block, block);
        self.blocks += 1;
        let run = part.run;
        let start = match self.run {
            Some((before, passed)) if before.run.length_10nm > passed => {
                assert_eq!((before.run, passed), (run, part.offset_10nm));
                self.check_corner(&run, passed, corner);
                passed
            }
            _ => {
                assert_eq!((part.offset_10nm, run.entry), (0, self.speed));
                assert!(run.entry <= corner, "{part:?} {corner:?}");
                self.runs += 1;
                self.check_law(&part);
                (self.passes, self.ticks, self.blocks_of_run) = (run.entry, 0, 0);
                0
            }
        };
        let passed = start + block.length_10nm;
        self.check_steps(&part, passed);
        self.blocks_of_run += 1;
        self.shared += u64::from(self.blocks_of_run == 2);
        self.most = self.most.max(self.blocks_of_run);
        assert!(passed <= run.length_10nm);
        // The fastest place of the block is at one of its ends, or where the run cruises.
        let fastest = [start, passed].map(|at| speed_at(&self.law(&run), &run, at)).into_iter().fold(0.0, f64::max);
        let cruises = {
            let [up, down] = self.law(&run).map(|ramp| ramp.length() * 1e5);
            f64::from(start) <= f64::from(run.length_10nm) - down && f64::from(passed) >= up
        };
        let fastest = if cruises { run.peak.mm_per_s() } else { fastest };
        let allowed = block.nominal.mm_per_s() * (1.0 + 1e-4) + 1e-3;
        assert!(fastest <= allowed, "{fastest} > {allowed}: {part:?}");
        assert!(run.acceleration <= block.acceleration);
        let is_filament = block.master_steps() == 0 && block.extruder_256ths != 0;
        assert!(run.jerk.mm_per_s3() <= self.jerk * if is_filament { FILAMENT } else { 1.0 });
        self.run = Some((part, passed));
        self.speed = run.exit;
    }

    /// Checks that the block makes its steps in the time and between the speeds of the closed form,
    /// to the run's end.
    fn check_steps(&mut self, part: &Part, passed: u32) {
        let run = &part.run;
        let (law, exit) = part.law::<Never>();
        let exact = speed_at(&self.law(run), run, passed);
        assert!((exit.mm_per_s() - exact).abs() <= 1e-3 + 1e-4 * exact, "{exit:?} {exact}: {part:?}");
        self.ticks += self.stepper.run(&part.block, [self.passes, exit], &law);
        self.passes = exit;
        if passed == run.length_10nm {
            let speeds = [run.entry, run.peak.max(Speed(1)), run.exit].map(Speed::mm_per_s);
            let length = f64::from(run.length_10nm) / 1e5;
            let ramps = self.law(run);
            let cruise = length - ramps[0].length() - ramps[1].length();
            let seconds = 2.0 * (ramps[0].half_time_s + ramps[1].half_time_s) + cruise / speeds[1];
            let exact = seconds * f64::from(TICKS_PER_SECOND);
            assert!((self.ticks as f64 - exact).abs() <= 1.0 + 1e-9 * exact, "{} {exact}: {run:?}", self.ticks);
        }
    }

    fn law(&self, run: &Run) -> [Ramp; 2] {
        let ramp = |from: Speed, to: Speed| {
            Ramp::new(from.mm_per_s(), to.mm_per_s(), run.jerk.mm_per_s3(), run.acceleration.mm_per_s2())
        };
        [ramp(run.entry, run.peak), ramp(run.exit, run.peak)]
    }

    /// Checks that a corner inside a run is passed no faster than it may.
    fn check_corner(&self, run: &Run, at: u32, corner: Speed) {
        let speed = speed_at(&self.law(run), run, at);
        let allowed = corner.mm_per_s() * (1.0 + 1e-4) + 1e-3;
        assert!(speed <= allowed, "{speed} > {allowed} at {at}: {run:?}");
    }

    /// Checks that two ramps of the closed form, in f64, with this jerk and acceleration, fit the
    /// run's length as they are.
    fn check_law(&self, part: &Part) {
        let run = &part.run;
        assert!(run.peak >= run.entry && run.peak >= run.exit);
        let [up, down] = self.law(run);
        let length = f64::from(run.length_10nm) / 1e5;
        let needed = up.length() + down.length();
        assert!(needed <= length * (1.0 + 1e-12), "{needed} mm of {length} mm: {run:?}");
    }
}

/// Speed at a place of a run, mm/s, by bisection of s(t).
fn speed_at([up, down]: &[Ramp; 2], run: &Run, at: u32) -> f64 {
    let inside = |ramp: &Ramp, length: f64| {
        let (mut low, mut high) = (0.0, 2.0 * ramp.half_time_s);
        for _ in 0..60 {
            let middle = (low + high) / 2.0;
            if ramp.length_at(middle) < length { low = middle } else { high = middle }
        }
        (ramp.length_at(low + 1e-7) - ramp.length_at(low)) / 1e-7
    };
    let (from_start, to_end) = (f64::from(at) / 1e5, f64::from(run.length_10nm - at) / 1e5);
    if from_start < up.length() {
        inside(up, from_start)
    } else if to_end < down.length() {
        inside(down, to_end)
    } else {
        run.peak.mm_per_s()
    }
}

fn check_a_job(random: &mut Random, blocks: u64, sum: &mut Sum) {
    let jerk = random.magnitude(10.0, 5e6).floor();
    let capacity = if random.bits().is_multiple_of(3) { 128 } else { 2 + random.bits() as usize % 40 };
    let mut ring = BlockQueue::<_>::new(vec![Slot::EMPTY; capacity]);
    ring.look_ahead(&SpeedLaw::SCurve(jerks(jerk)));
    let mut kind = SlicerBlocks::new(random);
    let mut pace = Pace::FULL;
    let starves = random.bits().is_multiple_of(4);
    let overloads = random.bits().is_multiple_of(4);
    let mut checker = Checker {
        jerk,
        stepper: Stepper::new(),
        passes: Speed::ZERO,
        ticks: 0,
        waiting: Default::default(),
        speed: Speed::ZERO,
        run: None,
        runs: 0,
        blocks: 0,
        shared: 0,
        most: 0,
        blocks_of_run: 0,
    };
    let mut stopped = true;
    let mut nominal_before = Speed::ZERO;
    for _ in 0..blocks {
        while !ring.has_room() {
            checker.take(ring.pop(pace).unwrap());
        }
        let (block, corner) = of_slicer(&kind.next(random));
        // Motion has stopped if the ring ran out of blocks.
        let corner = corner.min(block.nominal).min(nominal_before);
        assert!(ring.push(&block, &BlockStart::after_corner(corner, &block)));
        checker.waiting.push_back((block, if stopped { Speed::ZERO } else { corner }));
        nominal_before = block.nominal;
        stopped = false;
        if random.bits().is_multiple_of(50) && ring.has_room() {
            assert!(ring.push_marker(Marker::FanPower { fan: 0, power: 1 }));
        }
        if starves && random.bits().is_multiple_of(10) {
            ring.release();
            if let Some(left) = ring.pop(pace) {
                checker.take(left);
            }
        }
        if overloads && random.bits().is_multiple_of(100) {
            pace = Pace::from_256ths((random.bits() % 300) as u16);
        }
        if random.bits().is_multiple_of(500) {
            ring.flush();
            stopped = true;
        }
    }
    ring.flush();
    while let Some(left) = ring.pop(pace) {
        checker.take(left);
    }
    assert!(ring.is_empty() && checker.waiting.is_empty());
    assert_eq!(checker.speed, Speed::ZERO);
    sum.runs += checker.runs;
    sum.blocks += checker.blocks;
    sum.shared += checker.shared;
    sum.most = sum.most.max(checker.most);
    sum.events += checker.stepper.counter.events;
}

#[test]
fn random_runs_keep_every_limit_and_make_their_steps() {
    let wanted: Option<u64> = std::env::var(RUNS_VARIABLE).ok().map(|text| text.parse().unwrap());
    let jobs = if wanted.is_some() { Share::ALL.cases(u64::MAX) } else { share_of(JOBS) };
    let mut sum = Sum::default();
    for job in jobs {
        let mut random = Random::numbered(job);
        let length = 1 + random.bits() % 2_000;
        check_a_job(&mut random, length, &mut sum);
        let Some(wanted) = wanted else { continue };
        if sum.runs >= wanted {
            break;
        }
        if sum.runs / 100_000 > sum.told {
            sum.told = sum.runs / 100_000;
            eprintln!("{} runs", sum.runs);
        }
    }
    let Sum { runs, blocks, shared, most, events, .. } = sum;
    println!(
        "{blocks} blocks in {runs} runs, {shared} of them of several blocks, of up to {most}; {events} step events"
    );
    assert!(shared > runs / 10 && most > 10, "{shared} of {runs}, {most}");
    // The longest runs are rare: not every share has one.
    if wanted.is_some() || Share::of_this_run().is_all() {
        assert!(most > 50, "{most}");
        assert!(runs >= 100_000 || wanted.is_some(), "{runs}");
    }
}

/// Counts of the checks.
#[derive(Default)]
struct Sum {
    runs: u64,
    blocks: u64,
    /// Runs of more than one block, and most blocks of one.
    shared: u64,
    most: u64,
    events: u64,
    told: u64,
}

/// Blocks that are too short for their speeds: a fast one, a corner without a turn,
/// and one to stop in.
#[test]
fn a_short_block_gets_the_fastest_speed_from_which_it_can_stop() {
    let mut random = Random(5);
    for _ in 0..10_000 {
        let jerk = random.magnitude(100.0, 1e6).floor();
        let acceleration = random.magnitude(50.0, 10_000.0);
        let mut kind = SlicerBlocks::new(&mut random);
        (kind.nominal_mm_per_s, kind.acceleration_mm_per_s2) = (300.0, acceleration);
        let mut block = |length_mm: f64| {
            let (block, _) = of_slicer(&kind.next(&mut random));
            let acceleration = Acceleration::from_mm_per_s2(acceleration);
            Block { length_10nm: (length_mm * 1e5) as u32, nominal: Speed::from_mm_per_s(300.0), acceleration, ..block }
        };
        let long = Ramp::new(0.0, 300.0, jerk, acceleration).length() * 2.0 + 1.0;
        let short = (long / 2.0 * 0.9).min(5.0);
        let blocks = [block(long.min(10_000.0)), block(short)];
        let mut ring = BlockQueue::<_>::new(vec![Slot::EMPTY; 8]);
        // A stop of acceleration at the corner, so that its speed is the law's own.
        ring.look_ahead(&SpeedLaw::SCurveBlockByBlock(jerks(jerk)));
        for block in &blocks {
            assert!(ring.push(block, &BlockStart::after_corner(Speed(u32::MAX), block)));
        }
        ring.flush();
        let runs: Vec<_> = std::iter::from_fn(|| ring.pop(Pace::FULL))
            .map(|left| match left {
                Released::Part(part) => part.run,
                other => panic!("{other:?}"),
            })
            .collect();
        assert_eq!((runs.len(), runs[1].exit), (2, Speed::ZERO));
        assert_eq!((runs[0].exit, runs[0].entry), (runs[1].entry, Speed::ZERO));
        let needed = |speed: f64| Ramp::new(speed, 0.0, runs[1].jerk.mm_per_s3(), acceleration).length();
        let [first, last] = runs.iter().map(|run| f64::from(run.length_10nm) / 1e5).collect::<Vec<_>>()[..] else {
            panic!("{runs:?}")
        };
        let speed = runs[1].entry.mm_per_s();
        assert!(needed(speed) <= last, "{runs:?}");
        let faster = speed * (1.0 + 2e-4) + 1e-3;
        assert!(needed(faster) > last || needed(faster) > first || speed >= 299.9, "{runs:?}");
    }
}
