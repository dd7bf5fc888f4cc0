//! Planned motor positions, worked out in f64: the plan's pieces, and the impulses through which
//! each motor follows them.

use ferrostep_planner::{
    AxisShaper, Kinematics, PlannedBlock, PressureAdvance, ShaperKind, TICKS_PER_SECOND, smooth_ticks,
};
use ferrostep_simulator::law::{Law, Piece};
use ferrostep_simulator::motion::Motion;
use ferrostep_simulator::shapers::{Impulse, Shaper};

use super::case::Case;
use crate::textbook::trapezoid;

/// The parts of a block at a constant acceleration: ticks, speed at the start (10 nm/tick)
/// and acceleration.
fn textbook(planned: &PlannedBlock) -> Vec<[f64; 3]> {
    let second = f64::from(TICKS_PER_SECOND);
    let unit = 100_000.0 / second;
    let in_ticks = |[time, speed, a]: [f64; 3]| [time * second, speed * unit, a * unit / second];
    trapezoid(planned).into_iter().map(in_ticks).collect()
}

/// The parts of a line from rest to rest under an S-curve that reaches its speed, each so short
/// that its acceleration is as good as constant.
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

/// The advance while the filament moves at a constant acceleration from this speed on, summed over
/// time from `sum` on: steps times ticks. Two pieces where the filament passes the speed at which
/// the slope changes.
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

/// The laws of X, Y, Z (of CoreXY half the sum and difference of A and B), the extruder, and its
/// advance summed over time, in steps and ticks.
pub fn laws(case: &Case, blocks: &[PlannedBlock]) -> Option<([Law; 5], u64)> {
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
    // The joints of blocks are at whole ticks: the times are in ticks here, and a law's
    // joints must be exact.
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

/// Impulses in ticks, as late as the later of two shapers, and those of the advance's sum. The
/// moving average of the others begins at them.
pub fn impulses(case: &Case) -> [Vec<Impulse>; 5] {
    let shaper = |axis: usize| {
        let AxisShaper { kind, frequency_hz, damping } = case.shapers[axis];
        match kind {
            ShaperKind::None => Shaper::identity(),
            kind => Shaper::new(kind.to_string().parse().unwrap(), frequency_hz, damping).unwrap(),
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
    // Moments of the answer of the frame's mode to an impulse: its effect on 1, t and t^2 / 2.
    let of_path = |axis: usize, impulses: &[Impulse]| {
        let AxisShaper { kind, frequency_hz, damping } = case.shapers[axis];
        let omega = std::f64::consts::TAU * frequency_hz / second;
        let lag = 2.0 * damping / omega;
        let second_moment = 2.0 * (4.0 * damping * damping - 1.0) / (omega * omega);
        if kind == ShaperKind::None { 0.0 } else { variance(impulses) + second_moment - lag * lag }
    };
    let path = (0.5 * (of_path(0, &x) + of_path(1, &y))).max(0.0);
    let PressureAdvance { smooth_time_s, .. } = case.pressure_advance;
    let smooth = smooth_ticks(case.smooth_time_s).unwrap() as f64;
    let spread = 0.9 * f64::from(((12.0 * path + smooth * smooth) as f32).sqrt());
    let average = smooth_time_s.map_or(spread.max(0.008 * second), |time_s| time_s * second);
    let half = if case.pressure_advance.is_some() { (0.5 * average).round() } else { 0.0 };
    // Filament of the path's variance is as early as the advance; the advance alone may be early by
    // half of the average.
    let least = if path > 0.0 { half } else { (half - 0.5 * smooth).max(0.0) };
    let late = centroid(&x).max(centroid(&y)).max(least);
    let moved = |impulses: &[Impulse]| -> Vec<Impulse> {
        let by = (late - centroid(impulses)).round();
        impulses.iter().map(|one| Impulse { delay_s: one.delay_s + by, ..*one }).collect()
    };
    let z = vec![Impulse { weight: 1.0, delay_s: late.round() }];
    let weight = 0.5 / half;
    let advance = if half == 0.0 {
        Vec::new()
    } else {
        let middle = late.round() + 0.5 * smooth;
        let [sooner, later] = [middle - half, middle + half];
        vec![Impulse { weight, delay_s: sooner }, Impulse { weight: -weight, delay_s: later }]
    };
    // Filament has the path's variance: by the part of it that is half an average early,
    // and as much late.
    let outer = if half == 0.0 { 0.0 } else { (0.5 * path / (half * half)).min(0.5) };
    let filament = [(-half, outer), (0.0, 1.0 - 2.0 * outer), (half, outer)]
        .map(|(from_late, weight)| Impulse { weight, delay_s: late.round() + from_late });
    [moved(&x), moved(&y), z, filament.to_vec(), advance]
}
