//! Finds the times at which a motor steps, by bisection, so that they depend only on the law
//! itself.

use crate::law::shaped::ShapedLaw;
use crate::motion::Motion;

/// Number of times an interval is halved; more than an f64 has binary digits.
const HALVINGS: usize = 64;

/// Step of a motor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepTime {
    /// Time of the step, s.
    pub time_s: f64,
    /// True towards smaller positions.
    pub negative: bool,
}

/// Returns the steps of a motor with this scale that follows a shaped law from its start. The motor
/// starts at the nearest whole step, halves rounded away from zero, and steps where the position
/// passes the middle between two steps. Times are in order.
pub fn step_times(shaped: &ShapedLaw<'_>, steps_per_mm: f64) -> Vec<StepTime> {
    let breakpoints = shaped.breakpoints_s();
    let mut steps = Vec::new();
    let Some(first_s) = breakpoints.first() else { return steps };
    let mut place = (shaped.at(first_s - 1.0).position_mm * steps_per_mm).round();
    for pair in breakpoints.windows(2) {
        let &[start_s, end_s] = pair else { continue };
        let duration_s = end_s - start_s;
        if duration_s <= 0.0 {
            continue;
        }
        // The middle lies within one piece for every impulse; the ends, because of rounding, may
        // not.
        let start = shaped.at(start_s + 0.5 * duration_s).after(-0.5 * duration_s);
        follow(&mut steps, &mut place, start, [start_s, end_s], steps_per_mm);
    }
    steps
}

/// Appends the steps of a motor at `place`, in steps, that follows a motion, mm, between two times.
pub(crate) fn follow(
    steps: &mut Vec<StepTime>,
    place: &mut f64,
    start: Motion,
    [start_s, end_s]: [f64; 2],
    steps_per_mm: f64,
) {
    let duration_s = end_s - start_s;
    let turn_s = -start.speed_mm_per_s / start.acceleration_mm_per_s2;
    let turn_s = if turn_s > 0.0 && turn_s < duration_s { turn_s } else { duration_s };
    // Positions that a jump passes are due immediately.
    for part in [[0.0, 0.0], [0.0, turn_s], [turn_s, duration_s]] {
        due(steps, place, start, part, start_s, steps_per_mm);
    }
}

/// Appends the steps between two times after `start`, between which the motion does not reverse.
fn due(
    steps: &mut Vec<StepTime>,
    place: &mut f64,
    start: Motion,
    [from_s, to_s]: [f64; 2],
    start_s: f64,
    steps_per_mm: f64,
) {
    let at = |time_s: f64| start.after(time_s).position_mm * steps_per_mm;
    let target = at(to_s).round();
    let negative = target < *place;
    let sign = if negative { -1.0 } else { 1.0 };
    let mut after_s = from_s;
    while *place != target {
        let middle = *place + 0.5 * sign;
        let (mut early_s, mut late_s) = (after_s, to_s);
        for _ in 0..HALVINGS {
            let half_s = 0.5 * (early_s + late_s);
            if (at(half_s) - middle) * sign < 0.0 { early_s = half_s } else { late_s = half_s }
        }
        after_s = late_s;
        steps.push(StepTime { time_s: start_s + late_s, negative });
        *place += sign;
    }
}
