//! Shaped motion: every step of random plans is where the filtered law, worked out apart in f64, puts it.
//!
//! [`PLANS_VARIABLE`] sets how many plans are tried.

#![allow(clippy::unwrap_used, missing_docs)]

use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::{
    AXES, AccelerationProfile, AxisShaper, Geometry, Kinematics, Limits, MotionChoice, Move, Notice, PlannedBlock,
    Planner, PressureAdvance, Progress, SecondSlope, ShaperKind, StepEntry, StepKind, StepSink, StepsPerMm,
    TICKS_PER_SECOND,
};
use ferrostep_simulator::law::{Law, Piece, ShapedLaw};
use ferrostep_simulator::motion::Motion;
use ferrostep_simulator::shapers::{Impulse, Shaper};

#[path = "../src/random.rs"]
mod random;

use random::Random;

/// More or fewer random plans.
const PLANS_VARIABLE: &str = "FERROSTEP_PLANS";

/// The default.
const PLANS: u64 = 300;

/// What every step keeps to, ticks.
const MOST_TICKS: f64 = 20.0;

/// ... or part of a step. Where a motor turns, or hardly moves, the least part of a step takes many ticks: its acceleration is a
/// sum in single precision, and 6e-8 of a hundred steps are passed in 20 ticks above 30 steps/s only.
const MOST_STEPS: f64 = 1e-5;

/// All step events in order: tick, axes, directions; and where motion ends.
#[derive(Default)]
struct Events {
    tick: u64,
    directions: u8,
    events: Vec<(u64, u8, u8)>,
    ended: Option<(u64, [i64; 4])>,
    lines: Vec<(u64, u32)>,
}

impl StepSink for Events {
    fn entry(&mut self, entry: StepEntry) {
        match entry.kind() {
            StepKind::Directions { directions } => self.directions = directions,
            StepKind::Wait { interval_ticks } => self.tick += u64::from(interval_ticks),
            StepKind::Stair { interval_ticks, count, axes, added } => {
                for index in 1..=count {
                    self.tick += u64::from(interval_ticks);
                    let axes = if index == count { axes ^ added } else { axes };
                    self.events.push((self.tick, axes, self.directions));
                }
            }
        }
    }

    fn notice(&mut self, notice: Notice) {
        match notice {
            Notice::BlockEnded { tick, motor_steps } => self.ended = Some((tick, motor_steps)),
            Notice::MoveEnded { tick, line } => self.lines.push((tick, line)),
            Notice::FanPower { .. } => {}
        }
    }
}

fn geometry(kinematics: Kinematics, minimum_event_interval_ticks: u32) -> Geometry {
    let steps = |value: f64| StepsPerMm::from_f64(value).unwrap();
    Geometry {
        kinematics,
        steps_per_mm: [steps(80.0), steps(80.0), steps(400.0), steps(140.0)],
        minimum_event_interval_ticks,
        event_cost_ticks: 0,
        move_cost_ticks: 0,
    }
}

fn limits(acceleration: f64) -> Limits {
    Limits {
        max_feed_mm_per_s: [400.0, 400.0, 20.0, 100.0],
        max_acceleration_mm_per_s2: [20_000.0, 20_000.0, 500.0, 10_000.0],
        print_acceleration_mm_per_s2: acceleration,
        travel_acceleration_mm_per_s2: acceleration,
        retract_acceleration_mm_per_s2: 3_000.0,
        junction_deviation_mm: 0.05,
        instantaneous_corner_velocity_mm_per_s: [f64::INFINITY; AXES],
    }
}

/// A machine, its shapers and its moves.
#[derive(Clone, Debug)]
struct Case {
    geometry: Geometry,
    limits: Limits,
    shapers: [AxisShaper; 2],
    pressure_advance: PressureAdvance,
    /// Under an S-curve of this jerk, mm/s^3; there is one move then, as long as its speed needs.
    jerk_mm_per_s3: Option<f64>,
    moves: Vec<Move>,
}

impl Case {
    fn planner(&self) -> Planner<Vec<Slot>> {
        let mut planner = Planner::new(self.geometry, self.limits, vec![Slot::EMPTY; 64]);
        let mut choice =
            MotionChoice { shapers: self.shapers, pressure_advance: self.pressure_advance, ..MotionChoice::DEFAULT };
        if let Some(jerk_mm_per_s3) = self.jerk_mm_per_s3 {
            choice = MotionChoice { acceleration: AccelerationProfile::SCurve, jerk_mm_per_s3, ..choice };
        }
        planner.set_motion_choice(&choice).unwrap();
        planner
    }

    /// The blocks with their speeds.
    fn blocks(&self) -> Vec<PlannedBlock> {
        let mut planner = self.planner();
        let mut blocks = Vec::new();
        for one in &self.moves {
            while planner.add(one).is_err() {
                blocks.push(planner.next_planned().unwrap());
            }
        }
        planner.flush();
        while let Some(block) = planner.next_planned() {
            blocks.push(block);
        }
        blocks
    }

    /// What is executed.
    fn events(&self) -> Events {
        let (mut planner, mut events) = (self.planner(), Events::default());
        for one in &self.moves {
            while planner.add(one).is_err() {
                planner.advance(&mut events);
            }
        }
        planner.flush();
        while planner.advance(&mut events) == Progress::Worked {}
        assert!(planner.is_idle() && !planner.is_in_motion());
        events
    }
}

/// A part of a block at a constant acceleration: ticks, speed at its start (10 nm/tick) and acceleration.
fn textbook(planned: &PlannedBlock) -> Vec<[f64; 3]> {
    let unit = 100_000.0 / f64::from(TICKS_PER_SECOND);
    let [entry, nominal, exit] =
        [planned.entry, planned.block.nominal, planned.exit].map(|speed| speed.mm_per_s() * unit);
    let length = f64::from(planned.block.length_10nm);
    let mut a = planned.block.acceleration.mm_per_s2() * unit / f64::from(TICKS_PER_SECOND);
    if (entry * entry - exit * exit).abs() >= 2.0 * a * length {
        a = (entry * entry - exit * exit).abs() / (2.0 * length);
    }
    let meet = (a * length + 0.5 * (entry * entry + exit * exit)).sqrt();
    let peak = nominal.max(entry).max(exit).min(meet.max(entry).max(exit));
    let (up, down) = ((peak - entry) / a, (peak - exit) / a);
    let ramps = 0.5 * (entry + peak) * up + 0.5 * (peak + exit) * down;
    let cruise = ((length - ramps) / peak).max(0.0);
    [[up, entry, a], [cruise, peak, 0.0], [down, peak, -a]].into_iter().filter(|[ticks, ..]| *ticks > 0.0).collect()
}

/// The parts of a line from rest to rest under an S-curve that reaches its speed, each so short that its acceleration is as
/// good as constant.
fn s_curve(planned: &PlannedBlock, jerk_mm_per_s3: f64) -> Vec<[f64; 3]> {
    const PARTS: usize = 4_000;
    let second = f64::from(TICKS_PER_SECOND);
    let [speed, a, jerk] = [
        planned.block.nominal.mm_per_s() * 1e5 / second,
        planned.block.acceleration.mm_per_s2() * 1e5 / second.powi(2),
        jerk_mm_per_s3 * 1e5 / second.powi(3),
    ];
    let rise = (speed / jerk).sqrt().min(a / jerk);
    let held = speed / (jerk * rise) - rise;
    let cruise = (f64::from(planned.block.length_10nm) - speed * (2.0 * rise + held)) / speed;
    assert!(cruise >= 0.0, "{planned:?}");
    let mut parts = Vec::new();
    let mut now = 0.0;
    for (duration, [from, to]) in [
        (rise, [0.0, jerk * rise]),
        (held, [jerk * rise; 2]),
        (rise, [jerk * rise, 0.0]),
        (cruise, [0.0; 2]),
        (rise, [0.0, -jerk * rise]),
        (held, [-jerk * rise; 2]),
        (rise, [-jerk * rise, 0.0]),
    ] {
        let count = if from == to { 1 } else { PARTS };
        let ticks = duration / count as f64;
        for part in 0..count {
            let acceleration = from + (to - from) * (part as f64 + 0.5) / count as f64;
            parts.push([ticks, now, acceleration]);
            now += acceleration * ticks;
        }
    }
    parts.retain(|[ticks, ..]| *ticks > 0.0);
    parts
}

/// The advance while the filament moves at a constant acceleration from this speed on, summed over time from `sum` on: steps times
/// ticks. Two pieces where the filament passes the speed at which the slope changes.
fn advance_pieces(
    advance: &PressureAdvance,
    start: f64,
    lasts: f64,
    speed: f64,
    acceleration: f64,
    sum: &mut f64,
) -> Vec<Piece> {
    let second = f64::from(TICKS_PER_SECOND);
    let knee = advance.above.map_or(f64::INFINITY, |above| above.filament_mm_per_s * 140.0 / second);
    let slow = (advance.seconds * second).round();
    let fast = advance.above.map_or(slow, |above| (above.seconds * second).round());
    let crossing = (knee - speed) / acceleration;
    let turns = if crossing > 0.0 && crossing < lasts { crossing } else { lasts };
    let mut pieces = Vec::new();
    for (from, to) in [(0.0, turns), (turns, lasts)] {
        if to <= from {
            continue;
        }
        let speed_at = |time: f64| speed + acceleration * time;
        let is_fast = speed_at(0.5 * (from + to)) > knee;
        let (slope, constant) = if is_fast { (fast, (slow - fast) * knee) } else { (slow, 0.0) };
        let motion = Motion {
            position_mm: *sum,
            speed_mm_per_s: slope * speed_at(from) + constant,
            acceleration_mm_per_s2: slope * acceleration,
        };
        let piece = Piece { start_s: start + from, duration_s: to - from, motion };
        *sum = piece.at(piece.end_s()).position_mm;
        pieces.push(piece);
    }
    pieces
}

/// The laws of X, Y, Z (of CoreXY half the sum and difference of A and B), the extruder, and its advance summed over time, in
/// steps and ticks.
fn laws(case: &Case, blocks: &[PlannedBlock]) -> Option<([Law; 5], u64)> {
    let mut pieces: [Vec<Piece>; 5] = Default::default();
    let mut advance_sum = 0.0;
    let mut places = [0.0f64; 4];
    let mut clock = 0u64;
    for planned in blocks {
        let mut parts = match case.jerk_mm_per_s3 {
            None => textbook(planned),
            Some(jerk_mm_per_s3) => s_curve(planned, jerk_mm_per_s3),
        };
        // A block lasts a whole number of ticks.
        let whole: f64 = parts.iter().map(|[ticks, ..]| ticks).sum();
        let faster = if case.jerk_mm_per_s3.is_some() { 1.0 } else { whole / whole.round() };
        for [ticks, speed, acceleration] in &mut parts {
            *ticks /= faster;
            *speed *= faster;
            *acceleration *= faster * faster;
        }
        let block = &planned.block;
        let mut ends: Vec<(f64, [f64; 4])> = Vec::new();
        let mut rest = [block.steps.map(f64::from).as_slice(), &[f64::from(block.extruder_256ths) / 256.0]].concat();
        for end in block.inner_ends.iter(block.line) {
            let [x, y, z] = end.steps.map(f64::from);
            let steps = [x, y, z, f64::from(end.extruder_256ths) / 256.0];
            rest.iter_mut().zip(steps).for_each(|(rest, steps)| *rest -= steps);
            ends.push((f64::from(end.length_10nm), steps));
        }
        ends.push((f64::from(block.length_10nm), rest.try_into().unwrap()));
        let (mut before, mut part, mut into) = (0.0, 0, 0.0);
        let mut time = 0.0;
        for (end, steps) in ends {
            let length = end - before;
            let mut done = 0.0;
            // The parts of the law along this stretch.
            while part < parts.len() && (length - done > 1e-9 * length || end == f64::from(block.length_10nm)) {
                let [ticks, speed, acceleration] = parts[part];
                let here = speed + acceleration * into;
                let left = ticks - into;
                let path = left * (here + 0.5 * acceleration * left);
                let is_last_stretch = end == f64::from(block.length_10nm);
                let (lasts, path, ends_part) = if path <= length - done || is_last_stretch {
                    (left, path, true)
                } else {
                    let wanted = length - done;
                    let root = (here * here + 2.0 * acceleration * wanted).max(0.0).sqrt();
                    (2.0 * wanted / (here + root), wanted, false)
                };
                let per = steps.map(|steps| steps / length);
                // Filament that a line of plastic does not take has no advance.
                let is_line = per[3] * 1e5 / 140.0 <= 0.5;
                if lasts > 0.0 {
                    let share = if per[3] > 0.0 && is_line { per[3] } else { 0.0 };
                    let (start, speed) = (clock as f64 + time, share * here);
                    let advance = &case.pressure_advance;
                    let new = advance_pieces(advance, start, lasts, speed, share * acceleration, &mut advance_sum);
                    pieces[4].extend(new);
                }
                for axis in 0..4 {
                    let [a, b] = [per[0], per[1]];
                    let (share, place) = match (case.geometry.kinematics, axis) {
                        (Kinematics::CoreXy, 0) => (0.5 * (a + b), 0.5 * (places[0] + places[1] + (a + b) * done)),
                        (Kinematics::CoreXy, 1) => (0.5 * (a - b), 0.5 * (places[0] - places[1] + (a - b) * done)),
                        _ => (per[axis], places[axis] + per[axis] * done),
                    };
                    if lasts > 0.0 {
                        let motion = Motion {
                            position_mm: place,
                            speed_mm_per_s: share * here,
                            acceleration_mm_per_s2: share * acceleration,
                        };
                        pieces[axis].push(Piece { start_s: clock as f64 + time, duration_s: lasts, motion });
                    }
                }
                time += lasts;
                done += path;
                if ends_part {
                    (part, into) = (part + 1, 0.0);
                } else {
                    into += lasts;
                }
            }
            places.iter_mut().zip(steps).for_each(|(place, steps)| *place += steps);
            before = end;
        }
        clock += time.round() as u64;
    }
    // The joints of blocks are at whole ticks: the times are in ticks here, and a law's joints must be exact.
    for list in &mut pieces {
        for index in 1..list.len() {
            let next = list[index].start_s;
            list[index - 1].duration_s = next - list[index - 1].start_s;
        }
        list.retain(|piece| piece.duration_s > 0.0);
    }
    let [x, y, z, e, a] = pieces;
    let laws = [Law::new(x).ok()?, Law::new(y).ok()?, Law::new(z).ok()?, Law::new(e).ok()?, Law::new(a).ok()?];
    Some((laws, clock))
}

/// Impulses in ticks, as late as the later of two shapers, and those of the advance's sum.
fn impulses(case: &Case) -> [Vec<Impulse>; 5] {
    let shaper = |axis: usize| {
        let AxisShaper { kind, frequency_hz, damping } = case.shapers[axis];
        match kind {
            ShaperKind::None => Shaper::identity(),
            kind => Shaper::new(kind.name().parse().unwrap(), frequency_hz, damping).unwrap(),
        }
    };
    let second = f64::from(TICKS_PER_SECOND);
    let in_ticks = |shaper: Shaper| -> Vec<Impulse> {
        shaper.impulses().iter().map(|one| Impulse { delay_s: (one.delay_s * second).round(), ..*one }).collect()
    };
    let centroid = |impulses: &[Impulse]| impulses.iter().map(|one| one.weight * one.delay_s).sum::<f64>();
    let [x, y] = [in_ticks(shaper(0)), in_ticks(shaper(1))];
    let variance = |impulses: &[Impulse]| {
        let centroid = centroid(impulses);
        impulses.iter().map(|one| one.weight * (one.delay_s - centroid).powi(2)).sum::<f64>()
    };
    let PressureAdvance { smooth_time_s, .. } = case.pressure_advance;
    let spread = 0.9 * f64::from(((6.0 * (variance(&x) + variance(&y))) as f32).sqrt());
    let average = smooth_time_s.map_or(spread.max(0.008 * second), |time_s| time_s * second);
    let half = if case.pressure_advance.is_some() { (0.5 * average).round() } else { 0.0 };
    let late = centroid(&x).max(centroid(&y)).max(half);
    let moved = |impulses: &[Impulse], share: f64| -> Vec<Impulse> {
        let by = (late - centroid(impulses)).round();
        impulses.iter().map(|one| Impulse { weight: share * one.weight, delay_s: one.delay_s + by }).collect()
    };
    let z = vec![Impulse { weight: 1.0, delay_s: late.round() }];
    let weight = 0.5 / half;
    let advance = if half == 0.0 {
        Vec::new()
    } else {
        let [sooner, later] = [late.round() - half, late.round() + half];
        vec![Impulse { weight, delay_s: sooner }, Impulse { weight: -weight, delay_s: later }]
    };
    [moved(&x, 1.0), moved(&y, 1.0), z, [moved(&x, 0.5), moved(&y, 0.5)].concat(), advance]
}

/// How far a step is from where the law has it, ticks; found by halving around it.
fn error_ticks(position: impl Fn(f64) -> f64, middle: f64, tick: f64, backwards: bool) -> f64 {
    let passed = |tick: f64| if backwards { position(tick) <= middle } else { position(tick) >= middle };
    let is_late = passed(tick);
    let mut distance = 1.0;
    // The nearest tick at which it is the other way.
    while passed(if is_late { tick - distance } else { tick + distance }) == is_late {
        distance *= 2.0;
        if distance > 1e9 {
            return f64::INFINITY;
        }
    }
    let (mut low, mut high) = (0.0, distance);
    for _ in 0..60 {
        let half = 0.5 * (low + high);
        if passed(if is_late { tick - half } else { tick + half }) == is_late { low = half } else { high = half }
    }
    high
}

/// The worst of a case's steps, ticks, and how many there are.
fn worst(case: &Case) -> (f64, usize) {
    let blocks = case.blocks();
    let Some((laws, end)) = laws(case, &blocks) else { return (0.0, 0) };
    let impulses = impulses(case);
    let events = case.events();
    let shaped: Vec<ShapedLaw<'_>> =
        laws.iter().zip(&impulses).map(|(law, impulses)| ShapedLaw { law, impulses }).collect();
    let position = |motor: usize, tick: f64| {
        let at = |axis: usize| shaped[axis].at(tick).position_mm;
        match (case.geometry.kinematics, motor) {
            (Kinematics::CoreXy, 0) => at(0) + at(1),
            (Kinematics::CoreXy, 1) => at(0) - at(1),
            (_, 3) => at(3) + at(4),
            _ => at(motor),
        }
    };
    let mut steps = [0i64; 4];
    let mut worst = 0.0f64;
    for &(tick, axes, directions) in &events.events {
        for motor in (0..4).filter(|motor| axes >> motor & 1 == 1) {
            let backwards = directions >> motor & 1 == 1;
            let middle = steps[motor] as f64 + if backwards { -0.5 } else { 0.5 };
            steps[motor] += if backwards { -1 } else { 1 };
            let error = error_ticks(|tick| position(motor, tick), middle, tick as f64, backwards);
            let off = position(motor, tick as f64) - middle;
            let speed = (position(motor, tick as f64 + 500.0) - position(motor, tick as f64 - 500.0)) / 1e3;
            assert!(
                error <= MOST_TICKS || off.abs() <= MOST_STEPS,
                "motor {motor} at {tick} of {end}, to {}: {error} ticks, {off:e} steps, {speed:e} steps/tick; {case:?}",
                steps[motor]
            );
            worst = worst.max(if off.abs() <= MOST_STEPS { 0.0 } else { error });
        }
    }
    // At rest, at the rounded ends of the blocks, and no later than the filters are long.
    let mut ends = [0i64; 4];
    for planned in &blocks {
        ends.iter_mut().zip(planned.block.steps).for_each(|(end, steps)| *end += i64::from(steps));
        ends[3] += i64::from(planned.block.extruder_256ths);
    }
    ends[3] = (ends[3] as f64 / 256.0).round() as i64;
    assert_eq!(steps, ends, "{case:?}");
    let length = impulses.iter().flatten().map(|one| one.delay_s).fold(0.0, f64::max);
    let (ended, motor_steps) = events.ended.unwrap();
    assert_eq!(motor_steps, ends);
    let late = ended as f64 - end as f64 - length;
    assert!(late.abs() <= 2.0 + 1e-6 * end as f64, "{ended} {end} {length}");
    (worst, events.events.len())
}

/// None for every other plan, and then of all kinds.
fn advance(random: &mut Random) -> PressureAdvance {
    if random.next().is_multiple_of(2) {
        return PressureAdvance::NONE;
    }
    let seconds = random.magnitude(0.005, 0.5);
    let above = SecondSlope { filament_mm_per_s: random.magnitude(0.2, 6.0), seconds: seconds * random.share() };
    PressureAdvance {
        seconds,
        above: random.next().is_multiple_of(2).then_some(above),
        smooth_time_s: random.next().is_multiple_of(2).then_some(random.magnitude(0.002, 0.06)),
    }
}

fn case(random: &mut Random) -> Case {
    let kinematics = if random.next().is_multiple_of(3) { Kinematics::CoreXy } else { Kinematics::Cartesian };
    let shaper = |random: &mut Random| AxisShaper {
        kind: ShaperKind::ALL[random.next() as usize % ShaperKind::ALL.len()],
        frequency_hz: random.magnitude(22.0, 120.0),
        damping: 0.19 * random.share(),
    };
    let x = shaper(random);
    let y = if random.next().is_multiple_of(2) { x } else { shaper(random) };
    let mut place = [0i64; 3];
    let mut moves = Vec::new();
    let mut direction = 6.3 * random.share();
    for line in 1..=4 + random.next() as u32 % 12 {
        let length = random.magnitude(0.05, 30.0);
        direction += match random.next() % 4 {
            0 => 0.01,
            1 => std::f64::consts::PI,
            2 => 6.3 * random.share(),
            _ => 0.5 * random.share(),
        };
        if !random.next().is_multiple_of(12) {
            place[0] += (length * direction.cos() * 1e5) as i64;
            place[1] += (length * direction.sin() * 1e5) as i64;
        }
        if random.next().is_multiple_of(9) {
            place[2] += (random.share() * 40_000.0) as i64;
        }
        let filament = if random.next().is_multiple_of(3) { 0.0 } else { (random.share() - 0.1) * 0.08 * length };
        moves.push(Move {
            target_10nm: place,
            filament_100pm: (filament * 1e7) as i64,
            feed_mm_per_s: random.magnitude(5.0, 300.0) as f32,
            line,
            ends_move: true,
        });
    }
    let shapers = if x.kind == ShaperKind::None && y.kind == ShaperKind::None {
        [AxisShaper { kind: ShaperKind::Mzv, ..x }, y]
    } else {
        [x, y]
    };
    Case {
        geometry: geometry(kinematics, 1),
        limits: limits(random.magnitude(300.0, 20_000.0)),
        shapers,
        pressure_advance: advance(random),
        jerk_mm_per_s3: None,
        moves,
    }
}

#[test]
fn every_step_is_where_the_filtered_law_has_it() {
    let plans = std::env::var(PLANS_VARIABLE).ok().map_or(PLANS, |plans| plans.parse().unwrap());
    let (mut most, mut steps) = (0.0f64, 0);
    for plan in 1..=plans {
        let mut random = Random(plan.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
        let (worst, count) = worst(&case(&mut random));
        most = most.max(worst);
        steps += count;
    }
    println!("{plans} plans, {steps} events, the worst step {most:.2} ticks off");
}

/// The largest speed, mm/s, and acceleration, mm/s^2, of a case's extruder, and by how much its speed jumps at most.
fn extruder_extremes(case: &Case) -> [f64; 3] {
    let Some((laws, _)) = laws(case, &case.blocks()) else { return [0.0; 3] };
    let impulses = impulses(case);
    let [e, advance] = [3, 4].map(|index| ShapedLaw { law: &laws[index], impulses: &impulses[index] });
    let mut times = [e.breakpoints_s(), advance.breakpoints_s()].concat();
    times.sort_by(f64::total_cmp);
    let at = |tick: f64| e.at(tick).plus(1.0, advance.at(tick));
    let (second, mut extremes) = (f64::from(TICKS_PER_SECOND), [0.0f64; 3]);
    for pair in times.windows(2) {
        // Between two breakpoints the acceleration is constant.
        let [start, end] = [pair[0], pair[1]];
        if end - start < 0.01 {
            continue;
        }
        let [first, last] = [start + 1e-3, end - 1e-3].map(at);
        let jump = at(start + 1e-3).speed_mm_per_s - at(start - 1e-3).speed_mm_per_s;
        let speed = first.speed_mm_per_s.abs().max(last.speed_mm_per_s.abs()) * second / 140.0;
        let acceleration = first.acceleration_mm_per_s2.abs() * second * second / 140.0;
        for (extreme, value) in extremes.iter_mut().zip([speed, acceleration, jump.abs() * second / 140.0]) {
            *extreme = extreme.max(value);
        }
    }
    extremes
}

/// Lines of one width, travels between them, and filament alone: the extruder keeps to its speed and acceleration, whatever K.
#[test]
fn the_advance_keeps_to_what_the_extruder_may() {
    let mut reached = [0.0f64; 3];
    for plan in 1..=1_000u64 {
        let mut random = Random(plan.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
        let mut case = case(&mut random);
        case.pressure_advance.seconds = random.magnitude(0.02, 1.0);
        case.pressure_advance.above = None;
        let per_path = random.magnitude(0.01, 0.08);
        let mut place = [0i64; 3];
        for one in &mut case.moves {
            let length =
                (0..3).map(|axis| ((one.target_10nm[axis] - place[axis]) as f64 * 1e-5).powi(2)).sum::<f64>().sqrt();
            let prints = one.filament_100pm != 0 && length > 0.02;
            one.filament_100pm = if prints { (per_path * length * 1e7) as i64 } else { 0 };
            place = one.target_10nm;
        }
        case.limits.max_feed_mm_per_s[3] = random.magnitude(15.0, 100.0);
        case.limits.max_acceleration_mm_per_s2[3] = random.magnitude(500.0, 10_000.0);
        case.limits.instantaneous_corner_velocity_mm_per_s[3] = random.magnitude(0.5, 10.0);
        let limits = case.limits;
        let most = [
            limits.max_feed_mm_per_s[3],
            limits.max_acceleration_mm_per_s2[3],
            limits.instantaneous_corner_velocity_mm_per_s[3],
        ];
        let extremes = extruder_extremes(&case);
        for ((extreme, most), reached) in extremes.iter().zip(most).zip(&mut reached) {
            // Blocks last whole ticks, and short ones are by so much faster or slower.
            assert!(*extreme <= most * 1.02 + 1e-3, "{extremes:?} of {most:?}: {case:?}");
            *reached = reached.max(extreme / most);
        }
    }
    println!("at most {reached:.2?} of what the extruder may");
    assert!(reached.iter().all(|part| *part > 0.5), "the limits never mattered: {reached:?}");
}

#[test]
fn steps_under_an_s_curve_are_where_the_filtered_law_has_them() {
    let mut most = 0.0f64;
    for line in 1..=60u64 {
        let mut random = Random(line.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
        let drawn = case(&mut random);
        let acceleration = random.magnitude(500.0, 10_000.0);
        let jerk_mm_per_s3 = (acceleration * random.magnitude(10.0, 300.0)).round();
        let feed = random.magnitude(10.0, 250.0);
        // As far as both ramps need, and a little more.
        let ramps = 2.0 * feed * ((feed / jerk_mm_per_s3).sqrt() + feed / acceleration + acceleration / jerk_mm_per_s3);
        let length = ramps + random.magnitude(0.1, 20.0);
        let angle = 6.3 * random.share();
        let target_10nm = [(length * angle.cos() * 1e5) as i64, (length * angle.sin() * 1e5) as i64, 0];
        let feed_mm_per_s = feed as f32;
        let moves = vec![Move { target_10nm, filament_100pm: 300_000, feed_mm_per_s, line: 1, ends_move: true }];
        let limits = limits(acceleration);
        let (worst, count) = worst(&Case { limits, jerk_mm_per_s3: Some(jerk_mm_per_s3), moves, ..drawn });
        assert!(count > 0);
        most = most.max(worst);
    }
    println!("the worst step {most:.2} ticks off");
}
