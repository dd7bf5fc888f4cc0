//! Step times against t(s) by the textbook, in f64, of a million random blocks.
#![allow(clippy::unwrap_used)]

use ferrostep_random_cases::{Random, share_of};

use super::StepTimes;
use crate::block::{Acceleration, Block, PlannedBlock, Speed};
use crate::inner_ends::InnerEnds;
use crate::interpolator::{Interpolator, MAX_ENTRIES};
use crate::methods::{Never, Standard};
use crate::spacing::MotorSteps;
use crate::stretches::Stretch;
use crate::time_law::TimeLaw;
use crate::time_units::FRACTION_BITS;
use crate::{EXTRUDER, Notice, StepEntry, StepKind, StepSink, TICKS_PER_SECOND};

/// A microsecond.
const MAX_TICKS_OFF: f64 = 84.0;

/// Events a second, at most.
const MAX_STEPS_PER_S: f64 = 500_000.0;

const MAX_DURATION_S: f64 = 20.0;

/// t(s) of a block, by the textbook.
struct Exact {
    entry: f64,
    peak: f64,
    exit: f64,
    acceleration: f64,
    up: f64,
    down: f64,
    length: f64,
    cruise_start_s: f64,
    down_start_s: f64,
}

impl Exact {
    fn new(planned: &PlannedBlock) -> Self {
        let (entry, exit) = (planned.entry.mm_per_s(), planned.exit.mm_per_s());
        let length = planned.block.length_mm();
        let (v1, v2) = (entry * entry, exit * exit);
        let nominal = planned.block.nominal.mm_per_s().max(entry).max(exit);
        // Ends that differ by a hair more than the acceleration allows make one ramp.
        let acceleration = planned.block.acceleration.mm_per_s2().max((v2 - v1).abs() / (2.0 * length));
        let peak = (acceleration * length + (v1 + v2) / 2.0).sqrt().clamp(entry.max(exit), nominal);
        let up = ((peak - entry) * (peak + entry) / (2.0 * acceleration)).min(length);
        let down = ((peak - exit) * (peak + exit) / (2.0 * acceleration)).min(length - up);
        let cruise = (length - up - down).max(0.0);
        let cruise_start_s = 2.0 * up / (entry + peak);
        let down_start_s = cruise_start_s + cruise / peak;
        Self { entry, peak, exit, acceleration, up, down, length, cruise_start_s, down_start_s }
    }

    fn duration_s(&self) -> f64 {
        self.down_start_s + 2.0 * self.down / (self.peak + self.exit)
    }

    /// Time at a path position, ticks; `to_end` is its distance from the end, which must be exact
    /// near a standstill.
    fn tick(&self, s: f64, to_end: f64) -> f64 {
        let ramp = |end: f64, s: f64| {
            if s > 0.0 { 2.0 * s / (end + (end * end + 2.0 * self.acceleration * s).sqrt()) } else { 0.0 }
        };
        let seconds = if s < self.up {
            ramp(self.entry, s)
        } else if to_end < self.down {
            self.duration_s() - ramp(self.exit, to_end)
        } else {
            self.cruise_start_s + (s - self.up) / self.peak
        };
        seconds * f64::from(TICKS_PER_SECOND)
    }

    /// -1 in the deceleration, 0 in the cruise, 1 in the acceleration.
    fn phase(&self, s: f64) -> i32 {
        if s < self.up {
            1
        } else if s > self.length - self.down {
            -1
        } else {
            0
        }
    }
}

fn random_block(random: &mut Random) -> PlannedBlock {
    // One in 64 is long.
    let longest_mm = if random.bits().is_multiple_of(64) { 2_000.0 } else { 30.0 };
    loop {
        let length_10nm = random.magnitude(1.0, longest_mm * 100_000.0) as u32 + 1;
        let length_mm = f64::from(length_10nm) / 100_000.0;
        let acceleration = random.magnitude(5.0, 20_000.0);
        let nominal = random.magnitude(0.05, 500.0);
        let entry = match random.bits() % 4 {
            0 => 0.0,
            1 => nominal,
            _ => nominal * random.share(),
        };
        let reach = 2.0 * acceleration * length_mm;
        let slowest = (entry * entry - reach).max(0.0).sqrt();
        let fastest = (entry * entry + reach).sqrt().min(nominal);
        let exit = match random.bits() % 4 {
            0 => slowest,
            1 => fastest,
            _ => slowest + (fastest - slowest) * random.share(),
        };
        let block = Block {
            steps: [0; 3],
            extruder_256ths: 0,
            length_10nm,
            nominal: Speed::from_mm_per_s(nominal),
            acceleration: Acceleration::from_mm_per_s2(acceleration),
            line: 1,
            ends_move: true,
            inner_ends: InnerEnds::NONE,
        };
        let planned = PlannedBlock { block, entry: Speed::from_mm_per_s(entry), exit: Speed::from_mm_per_s(exit) };
        if Exact::new(&planned).duration_s() <= MAX_DURATION_S {
            return planned;
        }
    }
}

/// Places of the steps, in 1/256 of the extruder's step or halves of the master's.
struct Steps {
    count: u32,
    /// Path position of the first, and what is after the last, and from one to the next, as
    /// shares of `whole`.
    first: u64,
    spacing: u64,
    whole: u64,
    motor: MotorSteps,
}

fn random_steps(random: &mut Random, planned: &PlannedBlock) -> Steps {
    let length = planned.block.length_mm();
    let fastest = planned.block.nominal.mm_per_s().max(0.001);
    let most = (MAX_STEPS_PER_S / fastest * length).clamp(1.0, 3_000_000.0);
    let count = random.magnitude(1.0, (length * 1_600.0).clamp(1.0, most)) as u32;
    if !random.bits().is_multiple_of(4) {
        return Steps { count, first: 1, spacing: 2, whole: 2 * u64::from(count), motor: MotorSteps::Even { count } };
    }
    let first = (random.bits() % 257) as u32;
    let behind = (random.bits() % 256) as u32;
    let whole = (first + behind + (count - 1) * 256).max(1);
    let motor = MotorSteps::Extruder { whole, first, count };
    Steps { count, first: u64::from(first), spacing: 256, whole: u64::from(whole), motor }
}

/// Largest errors of a block: ticks from f64, and ticks that an interval grew in an acceleration or
/// shrank in a deceleration.
fn check(planned: &PlannedBlock, steps: &Steps, random: &mut Random) -> [f64; 2] {
    let exact = Exact::new(planned);
    let law = TimeLaw::<Never>::trapezoid(planned);
    let mut times = StepTimes::NONE;
    times.start(&law, &Stretch::whole(&planned.block), &steps.motor, 0);
    let every = random.bits().is_multiple_of(16);
    let unit = 1.0 / (1u64 << FRACTION_BITS) as f64;
    let path = |parts: u64| exact.length * (parts as f64 / steps.whole as f64);
    let (mut worst, mut bump) = (0.0f64, 0.0f64);
    let (mut before, mut interval_before, mut phase_before) = (0, None, None);
    let mut done = 0u32;
    while done < steps.count {
        let time = times.next().unwrap();
        assert!(time >= before, "{planned:?} step {done}");
        let position = steps.first + steps.spacing * u64::from(done);
        let s = path(position);
        let phase = exact.phase(s);
        let ends_phase = phase != exact.phase(path(position + steps.spacing)) || Some(phase) != phase_before;
        if every || done == 0 || done + 1 == steps.count || ends_phase || random.bits().is_multiple_of(16) {
            let off = time as f64 * unit - exact.tick(s, path(steps.whole - position));
            worst = worst.max(off.abs());
        }
        let interval = (time - before) as f64 * unit;
        if every && done > 0 && phase != 0 && Some(phase) == phase_before {
            if let Some(interval_before) = interval_before {
                let growth: f64 = interval - interval_before;
                bump = bump.max(growth * f64::from(phase));
            }
            interval_before = Some(interval);
        } else {
            interval_before = None;
        }
        (before, phase_before) = (time, Some(phase));
        // Several steps of a cruise may be taken at once.
        let count = match times.cruise() {
            Some((_, left)) if !every => (1 + (random.bits() % 32) as u32).min(left),
            _ => 1,
        };
        times.take(count);
        done += count;
        if count > 1 {
            before = time;
            phase_before = None;
        }
    }
    assert_eq!(times.next(), None);
    [worst, bump]
}

/// A thousand times a thousand, each thousand by its own seed.
#[test]
fn a_million_random_blocks_are_within_a_microsecond() {
    let (mut worst, mut bump) = (0.0f64, 0.0f64);
    for thousand in share_of(1_000) {
        let mut random = Random::numbered(thousand);
        for _ in 0..1_000 {
            let planned = random_block(&mut random);
            let steps = random_steps(&mut random, &planned);
            let [off, grown] = check(&planned, &steps, &mut random);
            assert!(off <= MAX_TICKS_OFF, "{off} ticks off: {planned:?}, {} steps", steps.count);
            assert!(grown <= 1.0, "an interval is {grown} ticks off its ramp: {planned:?}, {} steps", steps.count);
            worst = worst.max(off);
            bump = bump.max(grown);
        }
    }
    println!("{worst:.2} ticks off at most, intervals monotone to {bump:.4} ticks");
}

/// Checks events against the law of the block that they are of.
struct Events<'a> {
    planned: &'a PlannedBlock,
    exact: Exact,
    /// The block's first tick.
    start: u64,
    tick: u64,
    steps: u32,
    interval: Option<(u64, i32)>,
    is_behind_extruder: bool,
    phase: i32,
    /// Entries of one call.
    entries: usize,
    /// The master's steps: ticks off at most, and ticks by which a step in a ramp was not
    /// as the ramp wants.
    worst: [f64; 2],
}

impl StepSink for Events<'_> {
    fn entry(&mut self, entry: StepEntry) {
        self.entries += 1;
        for event in entry.events() {
            match event.kind() {
                StepKind::Wait { interval_ticks } => self.tick += u64::from(interval_ticks),
                StepKind::Directions { .. } => {}
                StepKind::Stair { interval_ticks, axes, .. } => {
                    assert!(interval_ticks >= MINIMUM_INTERVAL, "{:?}", self.planned);
                    self.tick += u64::from(interval_ticks);
                    if axes & 1 == 0 {
                        self.interval = None;
                        self.is_behind_extruder = true;
                        continue;
                    }
                    let whole = f64::from(self.planned.block.steps[0].unsigned_abs());
                    let share = (f64::from(self.steps) + 0.5) / whole;
                    let to_end = (whole - f64::from(self.steps) - 0.5) / whole;
                    self.steps += 1;
                    let (length, time) = (self.exact.length, self.tick - self.start);
                    let off = time as f64 - self.exact.tick(share * length, to_end * length);
                    self.worst[0] = self.worst[0].max(off.abs());
                    let phase = self.exact.phase(share * length);
                    let interval = u64::from(interval_ticks);
                    // Alone, so that its interval is from the step before.
                    let alone = !std::mem::take(&mut self.is_behind_extruder)
                        && axes & EXTRUDER == 0
                        && interval_ticks > MINIMUM_INTERVAL;
                    if let Some((before, phase_before)) = self.interval
                        && alone
                        && phase_before == phase
                        && self.steps > 1
                    {
                        let growth = interval as f64 - before as f64;
                        self.worst[1] = self.worst[1].max(growth * f64::from(phase));
                    }
                    // Nor the interval at whose start the block was in another phase.
                    self.interval = (alone && phase == self.phase).then_some((interval, phase));
                    self.phase = phase;
                }
            }
        }
    }

    fn notice(&mut self, _notice: Notice) {}
}

const MINIMUM_INTERVAL: u32 = 168;

#[test]
fn events_of_random_blocks_are_within_a_microsecond() {
    let mut random = Random(12_345);
    let mut worst = [0.0f64; 2];
    let mut interpolator = Interpolator::<Standard>::new(MINIMUM_INTERVAL);
    for _ in 0..60_000 {
        let mut planned = random_block(&mut random);
        // Half an interval, after which the first step is due, is then no less than the minimum.
        let most = (MAX_STEPS_PER_S / planned.block.nominal.mm_per_s() * planned.block.length_mm() * 0.45) as u32;
        let count = random_steps(&mut random, &planned).count.min(most);
        if count == 0 {
            continue;
        }
        let share = random.share();
        let extruder = if random.bits().is_multiple_of(2) { 0 } else { (f64::from(count) * share * 256.0) as i32 };
        planned.block.steps = [count as i32, (f64::from(count) * random.share() * 0.99) as i32, 0];
        planned.block.extruder_256ths = extruder;
        let clock = interpolator.clock();
        interpolator.reset_to(clock, 0, interpolator.directions());
        let exact = Exact::new(&planned);
        let mut events = Events {
            planned: &planned,
            exact,
            start: clock,
            tick: clock,
            steps: 0,
            interval: None,
            is_behind_extruder: false,
            phase: 0,
            entries: 0,
            worst: [0.0; 2],
        };
        interpolator.begin(&planned, &TimeLaw::trapezoid(&planned), &mut events);
        while interpolator.is_busy() {
            events.entries = 0;
            interpolator.advance(&mut events);
            assert!(events.entries <= MAX_ENTRIES);
        }
        assert_eq!(events.steps, count);
        let [off, grown] = events.worst;
        // An extruder step that found no room in time can hold up the next one of the master.
        let held_up = if extruder > 0 { f64::from(MINIMUM_INTERVAL) } else { 0.0 };
        assert!(off <= MAX_TICKS_OFF + held_up, "{off} ticks off: {planned:?}");
        worst[0] = worst[0].max(off - held_up);
        if extruder == 0 {
            assert!(grown <= 1.0, "an interval is {grown} ticks off its ramp: {planned:?}");
            worst[1] = worst[1].max(grown);
        }
    }
    println!("{:.2} ticks off at most, intervals monotone to {} ticks", worst[0], worst[1]);
}
