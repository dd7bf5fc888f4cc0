//! The filtered path keeps its tolerance, worked out apart in f64: every place of it is within the
//! tolerance of the programmed path, and of every corner. With a moving average its true
//! acceleration, and the extruder's, are at most 5/4 of the machine's limits.
//!
//! [`CORNERS_VARIABLE`] sets how many random corners are tried.

#![allow(clippy::unwrap_used, missing_docs)]

mod paths;
mod reference;

use ferrostep_planner::PlannedBlock;
use ferrostep_random_cases::{Random, share_of};
use paths::{Case, case, on_the_way};
use reference::{Filters, Plan, from_line};

/// Variable that sets the number of corners.
const CORNERS_VARIABLE: &str = "FERROSTEP_CORNERS";

/// The default.
const CORNERS: usize = 20_000;

/// Places in the time that a filter reaches to one side.
const PLACES: f64 = 24.0;

/// Largest true acceleration, as a multiple of the machine's.
const MOST_ACCELERATION: f64 = 1.25;

/// The worst of a case, as a share of the limit.
#[derive(Clone, Copy, Debug, Default)]
struct Worst {
    tube: f64,
    corner: f64,
    acceleration: f64,
    filament: f64,
    /// Duration, s.
    time_s: f64,
}

fn worst(case: &Case, keeps: bool) -> Worst {
    worst_of(case, &case.blocks(keeps))
}

fn worst_of(case: &Case, blocks: &[PlannedBlock]) -> Worst {
    let plan = Plan::new(&case.moves, blocks);
    let filters = Filters::new(&case.shapers, case.smooth_time_s);
    let mut worst = Worst { time_s: plan.end_s(), ..Worst::default() };
    let reach = filters.reach_s;
    let place = |time_s: f64| filters.place(&plan, time_s);
    // Times: often while something happens, at least a few in each move.
    let mut times = Vec::new();
    for pair in plan.corners.windows(2) {
        let (begin, end) = (pair[0].1, pair[1].1);
        let count = ((end - begin) / reach * PLACES).ceil().clamp(2.0, 400.0);
        times.extend((0..count as u32).map(|number| begin + (end - begin) * f64::from(number) / count));
    }
    times.extend((0..=PLACES as u32).map(|number| plan.end_s() + reach * f64::from(number) / PLACES));
    // The filtered path bends where a filter's impulse, or an end of its average, passes a corner.
    let delays = filters.delays_s();
    times.extend(plan.corners.iter().flat_map(|(_, at)| delays.iter().map(move |delay| at + delay)));
    times.sort_by(f64::total_cmp);
    let corner_at = |index: usize| plan.corners[index.min(plan.corners.len() - 1)];
    let mut passed = vec![f64::INFINITY; plan.corners.len()];
    let mut before: Option<[f64; 3]> = None;
    let (mut low, mut high) = (0, 0);
    for &time_s in &times {
        let here = place(time_s);
        // The moves that the filters see.
        while low + 1 < plan.corners.len() && corner_at(low + 1).1 < time_s - 2.0 * reach {
            low += 1;
        }
        while high + 1 < plan.corners.len() && corner_at(high).1 <= time_s + 2.0 * reach {
            high += 1;
        }
        let tube = (low..high.max(low + 1))
            .filter(|index| index + 1 < plan.corners.len())
            .map(|index| from_line(here, plan.corners[index].0, plan.corners[index + 1].0))
            .fold(f64::INFINITY, f64::min);
        worst.tube = worst.tube.max(tube / case.path_tolerance_mm);
        let from = before.unwrap_or(here);
        for (index, passed) in passed.iter_mut().enumerate().take(high + 1).skip(low) {
            *passed = passed.min(from_line(plan.corners[index].0, from, here));
        }
        before = Some(here);
        if filters.average_s > 0.0 {
            let (path, filament) = filters.accelerations(&plan, time_s);
            // Unequal filters of X and Y see a corner at different times, so each counts by itself.
            let path = if case.shapers[0] == case.shapers[1] { path[0].hypot(path[1]) } else { path[0].max(path[1]) };
            worst.acceleration = worst.acceleration.max(path / case.acceleration);
            worst.filament = worst.filament.max(filament / case.filament_acceleration);
        }
    }
    let farthest = passed.iter().copied().fold(0.0, f64::max);
    worst.corner = farthest / case.path_tolerance_mm;
    worst
}

#[test]
fn the_filtered_path_keeps_its_tolerance_and_its_acceleration() {
    let corners = std::env::var(CORNERS_VARIABLE).ok().map_or(CORNERS, |corners| corners.parse().unwrap());
    let (mut tried, mut plan) = (0, 0_u64);
    let mut most = Worst::default();
    while tried < corners {
        plan += 1;
        let mut random = Random(plan.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
        let case = case(&mut random);
        tried += case.moves.len();
        let worst = worst(&case, true);
        let Worst { tube, corner, acceleration, filament, time_s } = worst;
        most = Worst {
            tube: most.tube.max(tube),
            corner: most.corner.max(corner),
            acceleration: most.acceleration.max(acceleration),
            filament: most.filament.max(filament),
            time_s: most.time_s + time_s,
        };
        let is_kept = tube <= 1.0
            && corner <= 1.0
            && acceleration <= MOST_ACCELERATION
            && filament <= MOST_ACCELERATION
            && time_s.is_finite();
        assert!(is_kept, "plan {plan}: {worst:?} of {:?}", Case { moves: Vec::new(), ..case });
    }
    println!("{tried} corners, at most these parts of what is allowed: {most:?}");
    // All of them are reached nearly: a rule that gave more would break them.
    assert!(most.tube > 0.9 && most.corner > 0.9 && most.acceleration > 1.2 && most.filament > 0.95, "{most:?}");
}

/// Filament that rides along travels divides them, and the parts keep the tolerance as other moves
/// do, the acceleration of X and Y, and that of the filament.
#[test]
fn with_filament_on_the_way_the_same_is_kept() {
    let mut most = Worst::default();
    for plan in share_of(150) {
        let mut random = Random::numbered(plan);
        let (case, blocks) = on_the_way(&mut random);
        let riding = case
            .moves
            .windows(2)
            .filter(|pair| pair[0].target_10nm != pair[1].target_10nm && pair[1].filament_100pm < 0);
        assert!(riding.count() > 0, "plan {plan}");
        let worst = worst_of(&case, &blocks);
        let Worst { tube, corner, acceleration, filament, .. } = worst;
        most = Worst {
            tube: most.tube.max(tube),
            corner: most.corner.max(corner),
            acceleration: most.acceleration.max(acceleration),
            filament: most.filament.max(filament),
            ..most
        };
        let is_kept =
            tube <= 1.0 && corner <= 1.0 && acceleration <= MOST_ACCELERATION && filament <= MOST_ACCELERATION;
        assert!(is_kept, "plan {plan}: {worst:?} of {:?}", Case { moves: Vec::new(), ..case });
    }
    println!("at most these parts of what is allowed: {most:?}");
}

/// The same machines break the tolerance by far if it is not asked for.
#[test]
fn without_a_tolerance_there_is_none() {
    let (mut beyond, plans) = (0, 60);
    for plan in 1..=plans {
        let mut random = Random((plan as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
        let case = case(&mut random);
        let worst = worst(&case, false);
        beyond += usize::from(worst.tube > 1.0 || worst.corner > 1.0);
    }
    assert!(beyond > plans / 2, "{beyond} of {plans}");
}

/// The same moves in a small ring and in a large one, with all the room that is needed made at any
/// time, have the same accelerations.
#[test]
fn the_plan_does_not_depend_on_when_there_is_room() {
    for plan in 1..=40_u64 {
        let mut random = Random(plan.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
        let case = case(&mut random);
        let held = |ring: usize| -> Vec<_> {
            case.blocks_with(true, ring).iter().map(|one| (one.block.line, one.block.acceleration)).collect()
        };
        assert_eq!(held(8), held(400));
    }
}
