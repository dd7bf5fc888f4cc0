//! Look-ahead under an S-curve: the runs of random blocks keep jerk, acceleration, corners and nominal speeds.

#![allow(clippy::unwrap_used, missing_docs)]

use ferrostep_planner::inner_ends::InnerEnds;
use ferrostep_planner::look_ahead::{Left, LookAhead, Marker, Part, Slot, SpeedLaw};
use ferrostep_planner::s_curve::{Jerk, Ramp, Run};
use ferrostep_planner::{Acceleration, Block, Pace, Speed, SquaredSpeed};

/// Marsaglia's xorshift.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn share(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn magnitude(&mut self, from: f64, to: f64) -> f64 {
        from * (to / from).powf(self.share())
    }

    fn one_in(&mut self, count: u64) -> bool {
        self.next().is_multiple_of(count)
    }
}

/// Blocks as slicers make them: stretches of alike ones, of which some differ, with corners of all kinds.
struct Blocks {
    length_mm: f64,
    nominal: f64,
    acceleration: f64,
    curved: bool,
}

impl Blocks {
    fn new(random: &mut Random) -> Self {
        Self {
            length_mm: random.magnitude(0.001, 50.0),
            nominal: random.magnitude(0.5, 500.0),
            acceleration: random.magnitude(20.0, 20_000.0),
            curved: random.one_in(2),
        }
    }

    fn next(&mut self, random: &mut Random) -> (Block, SquaredSpeed) {
        if random.one_in(40) {
            *self = Self::new(random);
        }
        let length_mm = self.length_mm * if random.one_in(3) { random.magnitude(0.1, 3.0) } else { 1.0 };
        let nominal = self.nominal * if random.one_in(10) { random.magnitude(0.2, 1.5) } else { 1.0 };
        let acceleration = self.acceleration * if random.one_in(30) { random.magnitude(0.5, 2.0) } else { 1.0 };
        let block = Block {
            steps: [1 + (length_mm * 80.0) as i32, 0, 0],
            extruder_256ths: 0,
            length_10nm: ((length_mm * 1e5) as u32).max(1),
            nominal: Speed::from_mm_per_s(nominal).max(Speed(1)),
            acceleration: Acceleration::from_mm_per_s2(acceleration),
            line: 1,
            ends_move: true,
            inner_ends: InnerEnds::NONE,
        };
        let corner = match (self.curved, random.one_in(20)) {
            (true, false) => f32::INFINITY,
            _ if random.one_in(10) => 0.0,
            _ => random.magnitude(1.0, 2.0 * nominal * nominal + 2.0) as f32,
        };
        (block, SquaredSpeed::from_mm2_per_s2(corner))
    }
}

/// What leaves, against what may.
struct Checker {
    jerk: f64,
    /// Blocks that went in and have not come out, with the corner before each.
    waiting: std::collections::VecDeque<(Block, SquaredSpeed)>,
    speed: Speed,
    /// Of the present run: path of it, and how much has come.
    run: Option<(Part, u32)>,
    runs: u64,
    blocks: u64,
}

impl Checker {
    fn take(&mut self, left: Left) {
        let Left::Part(part) = left else { return };
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
                assert!(SquaredSpeed::from(run.entry) <= corner, "{part:?} {corner:?}");
                self.runs += 1;
                self.check_law(&part);
                0
            }
        };
        let passed = start + block.length_10nm;
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
        self.run = Some((part, passed));
        self.speed = run.exit;
    }

    fn law(&self, run: &Run) -> [Ramp; 2] {
        let ramp = |from: Speed, to: Speed| {
            Ramp::new(from.mm_per_s(), to.mm_per_s(), self.jerk, run.acceleration.mm_per_s2()).unwrap()
        };
        [ramp(run.entry, run.peak), ramp(run.exit, run.peak)]
    }

    /// A corner inside a run is passed no faster than it may.
    fn check_corner(&self, run: &Run, at: u32, corner: SquaredSpeed) {
        let speed = speed_at(&self.law(run), run, at);
        let allowed = corner.root().mm_per_s() * (1.0 + 1e-4) + 1e-3;
        assert!(speed <= allowed, "{speed} > {allowed} at {at}: {run:?}");
    }

    /// Two ramps of the closed form, in f64, with this jerk and acceleration, fit the run's length as they are.
    fn check_law(&self, part: &Part) {
        let run = &part.run;
        assert!(run.peak >= run.entry && run.peak >= run.exit);
        let [up, down] = self.law(run);
        let length = f64::from(run.length_10nm) / 1e5;
        let needed = up.length() + down.length();
        assert!(needed <= length * (1.0 + 1e-12), "{needed} mm of {length} mm: {run:?}");
        for ramp in [up, down] {
            assert!(ramp.jerk().abs() <= self.jerk * (1.0 + 1e-9));
            assert!(ramp.peak_acceleration().abs() <= run.acceleration.mm_per_s2() * (1.0 + 1e-9));
        }
    }
}

/// Speed at a place of a run, mm/s, by bisection of s(t).
fn speed_at([up, down]: &[Ramp; 2], run: &Run, at: u32) -> f64 {
    let inside = |ramp: &Ramp, length: f64| {
        let (mut low, mut high) = (0.0, 2.0 * ramp.half_time_s());
        for _ in 0..60 {
            let middle = (low + high) / 2.0;
            if ramp.at(middle).length < length { low = middle } else { high = middle }
        }
        ramp.at(low).speed
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

fn check_a_job(random: &mut Random, blocks: u64) -> (u64, u64) {
    let jerk = random.magnitude(10.0, 5e6).floor();
    let capacity = if random.one_in(3) { 128 } else { 2 + random.next() as usize % 40 };
    let mut ring = LookAhead::new(vec![Slot::EMPTY; capacity]);
    ring.set_law(&SpeedLaw::SCurve(Jerk::from_mm_per_s3(jerk).unwrap()));
    let mut kind = Blocks::new(random);
    let mut pace = Pace::FULL;
    let starves = random.one_in(4);
    let overloads = random.one_in(4);
    let mut checker = Checker { jerk, waiting: Default::default(), speed: Speed::ZERO, run: None, runs: 0, blocks: 0 };
    let mut stopped = true;
    let mut nominal_before = Speed::ZERO;
    for _ in 0..blocks {
        while !ring.has_room() {
            checker.take(ring.pop(pace).unwrap());
        }
        let (block, corner) = kind.next(random);
        // Where the ring had nothing more to go on with, motion has stopped.
        let corner = corner.min(block.nominal.into()).min(nominal_before.into());
        assert!(ring.push(&block, corner));
        checker.waiting.push_back((block, if stopped { SquaredSpeed::ZERO } else { corner }));
        nominal_before = block.nominal;
        stopped = false;
        if random.one_in(50) && ring.has_room() {
            assert!(ring.push_marker(Marker::FanPower { power: 1 }));
        }
        if starves && random.one_in(10) {
            ring.release();
            if let Some(left) = ring.pop(pace) {
                checker.take(left);
            }
        }
        if overloads && random.one_in(100) {
            pace = Pace::from_256ths((random.next() % 300) as u16);
        }
        if random.one_in(500) {
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
    (checker.runs, checker.blocks)
}

#[test]
fn a_million_random_blocks_keep_every_limit() {
    let mut random = Random(20_170_801);
    let (mut runs, mut blocks) = (0, 0);
    while blocks < 1_000_000 {
        let length = 1 + random.next() % 2_000;
        let (more_runs, more_blocks) = check_a_job(&mut random, length);
        runs += more_runs;
        blocks += more_blocks;
    }
    assert!(runs > 100_000, "{runs}");
    println!("{blocks} blocks in {runs} runs");
}
