//! Shaped motion: every step of random plans is where the filtered law, worked out apart
//! in f64, puts it.
//!
//! [`PLANS_VARIABLE`] sets how many plans are tried.

#![allow(clippy::unwrap_used, missing_docs)]

use std::num::NonZeroUsize;

use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::{
    AccelerationProfile, AxisShaper, ChoiceError, Kinematics, MotionChoice, Move, Planner, ShaperError, ShaperKind,
    TICKS_PER_SECOND, smooth_ticks,
};
use ferrostep_random_cases::{Random, share_of};
use ferrostep_simulator::shapers::Impulse;

mod average;
mod case;
mod law;

use average::Averaged;
use case::{Case, case, limits};
use law::{impulses, laws};

/// Variable that sets the number of random plans.
const PLANS_VARIABLE: &str = "FERROSTEP_PLANS";

/// The default, of which a run tries its share.
const PLANS: u64 = 300;

/// Largest error of a step, ticks.
const MOST_TICKS: f64 = 20.0;

/// ... or part of a step. Where a motor turns, or hardly moves, the least part of a step takes many
/// ticks: its acceleration is a sum in single precision, and 6e-8 of a hundred steps are passed in
/// 20 ticks above 30 steps/s only.
const MOST_STEPS: f64 = 1e-5;

/// Largest error of an extruder with an advance, steps: tens of steps that are K times the plan's
/// speed, rounded as that is.
const MOST_ADVANCED_STEPS: f64 = 2e-5;

/// Distance of a step from its place by the law, ticks; found by halving around it.
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
    let average = f64::from(smooth_ticks(case.smooth_time_s).unwrap());
    // The advance has its own average.
    let shaped: Vec<Averaged<'_>> = (laws.iter().zip(&impulses).zip([average, average, average, average, 0.0]))
        .map(|((law, impulses), average)| Averaged::new(law, impulses, average))
        .collect();
    let position = |motor: usize, tick: f64| {
        let at = |axis: usize| shaped[axis].at(tick).position_mm;
        match (case.geometry.kinematics, motor) {
            (Kinematics::CoreXy, 0) => at(0) + at(1),
            (Kinematics::CoreXy, 1) => at(0) - at(1),
            (_, 3) => at(3) + at(4),
            _ => at(motor),
        }
    };
    let most_steps =
        |motor: usize| if motor == 3 && case.pressure_advance.is_some() { MOST_ADVANCED_STEPS } else { MOST_STEPS };
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
                error <= MOST_TICKS || off.abs() <= most_steps(motor),
                "motor {motor} at {tick} of {end}, to {}: {error} ticks, {off:e} steps, {speed:e} steps/tick; {case:?}",
                steps[motor]
            );
            worst = worst.max(if off.abs() <= most_steps(motor) { 0.0 } else { error });
        }
    }
    // The motors rest at the rounded ends of the blocks, no later than the length of the filters.
    let mut ends = [0i64; 4];
    for planned in &blocks {
        ends.iter_mut().zip(planned.block.steps).for_each(|(end, steps)| *end += i64::from(steps));
        ends[3] += i64::from(planned.block.extruder_256ths);
    }
    ends[3] = (ends[3] as f64 / 256.0).round() as i64;
    assert_eq!(steps, ends, "{case:?}");
    let last = |impulses: &[Impulse]| {
        impulses.iter().filter(|one| one.weight != 0.0).map(|one| one.delay_s).fold(0.0, f64::max)
    };
    let [axes @ .., advance] = &impulses;
    let length = axes.iter().map(|impulses| last(impulses) + average).fold(last(advance), f64::max);
    let (ended, motor_steps) = events.ended.unwrap();
    assert_eq!(motor_steps, ends);
    let late = ended as f64 - end as f64 - length;
    assert!(late.abs() <= 2.0 + 1e-6 * end as f64, "{ended} {end} {length}");
    (worst, events.events.len())
}

#[test]
fn every_step_is_where_the_filtered_law_has_it() {
    let plans: Vec<u64> = match std::env::var(PLANS_VARIABLE) {
        Ok(plans) => (0..plans.parse().unwrap()).collect(),
        Err(_) => share_of(PLANS).collect(),
    };
    let cores = std::thread::available_parallelism().map_or(1, NonZeroUsize::get);
    // Each core's share of the plans: how far its worst step is off, and the number of its steps.
    let share = |first: usize| {
        plans.iter().skip(first).step_by(cores).fold((0.0f64, 0), |(most, steps), &plan| {
            let (worst, count) = worst(&case(&mut Random::numbered(plan)));
            (most.max(worst), steps + count)
        })
    };
    let share = &share;
    let (most, steps) = std::thread::scope(|scope| {
        let shares: Vec<_> = (0..cores).map(|first| scope.spawn(move || share(first))).collect();
        shares
            .into_iter()
            .map(|share| share.join().unwrap())
            .fold((0.0f64, 0), |(most, steps), (worst, count)| (most.max(worst), steps + count))
    });
    println!("{} plans, {steps} events, the worst step {most:.2} ticks off", plans.len());
}

/// The largest speed, mm/s, and acceleration, mm/s^2, of a case's extruder, and the amount by which
/// its speed jumps at most.
fn extruder_extremes(case: &Case) -> [f64; 3] {
    let Some((laws, _)) = laws(case, &case.blocks()) else { return [0.0; 3] };
    let impulses = impulses(case);
    let average = f64::from(smooth_ticks(case.smooth_time_s).unwrap());
    let [e, advance] =
        [(3, average), (4, 0.0)].map(|(index, ticks)| Averaged::new(&laws[index], &impulses[index], ticks));
    let mut times = [e.breakpoints(), advance.breakpoints()].concat();
    times.sort_by(f64::total_cmp);
    let at = |tick: f64| e.at(tick).plus(1.0, advance.at(tick));
    let (second, mut extremes) = (f64::from(TICKS_PER_SECOND), [0.0f64; 3]);
    for pair in times.windows(2) {
        // Between two breakpoints the acceleration is constant, or changes evenly from one
        // value to another.
        let [start, end] = [pair[0], pair[1]];
        if end - start < 0.01 {
            continue;
        }
        let [first, last] = [start + 1e-3, end - 1e-3].map(at);
        let jump = at(start + 1e-3).speed_mm_per_s - at(start - 1e-3).speed_mm_per_s;
        let speed = first.speed_mm_per_s.abs().max(last.speed_mm_per_s.abs()) * second / 140.0;
        let acceleration =
            first.acceleration_mm_per_s2.abs().max(last.acceleration_mm_per_s2.abs()) * second * second / 140.0;
        for (extreme, value) in extremes.iter_mut().zip([speed, acceleration, jump.abs() * second / 140.0]) {
            *extreme = extreme.max(value);
        }
    }
    extremes
}

/// Lines of one width, travels between them, and filament alone: the extruder keeps to its speed
/// and acceleration, whatever K.
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
        // A jump of the speed is spread over the average.
        let smooth_s = f64::from(smooth_ticks(case.smooth_time_s).unwrap()) / f64::from(TICKS_PER_SECOND);
        let [feed, acceleration, jump] = most;
        let by_jump = if smooth_s > 0.0 { jump / smooth_s } else { 0.0 };
        let most = [feed, acceleration + by_jump, jump];
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
    for line in share_of(60) {
        let mut random = Random::numbered(line);
        let drawn = case(&mut random);
        let acceleration = random.magnitude(500.0, 10_000.0);
        let jerk_mm_per_s3 = (acceleration * random.magnitude(10.0, 300.0)).round();
        let feed = random.magnitude(10.0, 250.0);
        // Length for both ramps, and a little more.
        let ramps = 2.0 * feed * ((feed / jerk_mm_per_s3).sqrt() + feed / acceleration + acceleration / jerk_mm_per_s3);
        let length = ramps + random.magnitude(0.1, 20.0);
        let angle = 6.3 * random.share();
        let target_10nm = [(length * angle.cos() * 1e5) as i64, (length * angle.sin() * 1e5) as i64, 0];
        let feed_mm_per_s = feed as f32;
        let [x, y] = drawn.shapers;
        let shapers = if drawn.smooth_time_s.is_some() {
            [x, y].map(|shaper| AxisShaper { kind: ShaperKind::Ei, ..shaper })
        } else {
            [x, y]
        };
        let moves = vec![Move { target_10nm, filament_100pm: 300_000, feed_mm_per_s, line: 1, ends_move: true }];
        let limits = limits(acceleration);
        let (worst, count) =
            worst(&Case { limits, jerk_mm_per_s3: Some(jerk_mm_per_s3), moves, shapers, smooth_time_s: None, ..drawn });
        assert!(count > 0);
        most = most.max(worst);
    }
    println!("the worst step {most:.2} ticks off");
}

/// The average of an S-curve would be of fourth degree, which no step is solved for.
#[test]
fn a_moving_average_of_an_s_curve_is_refused() {
    let Case { geometry, limits, .. } = case(&mut Random(1));
    let mut planner: Planner<Vec<Slot>> = Planner::new(geometry, limits, vec![Slot::EMPTY; 4]);
    let average = MotionChoice { smooth_time_s: Some(0.008), ..MotionChoice::DEFAULT };
    planner.set_motion_choice(&average).unwrap();
    let s_curve = MotionChoice { acceleration: AccelerationProfile::SCurve, ..average };
    assert_eq!(planner.set_motion_choice(&s_curve), Err(ChoiceError::Shaper(ShaperError::SmoothSCurve)));
    for time_s in [0.0009, 0.0501, f64::NAN] {
        let other = MotionChoice { smooth_time_s: Some(time_s), ..average };
        assert_eq!(planner.set_motion_choice(&other), Err(ChoiceError::Shaper(ShaperError::SmoothTime)));
    }
    assert_eq!(planner.motion_choice(), &average);
}
