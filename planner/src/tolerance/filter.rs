//! Moments of a filter's weights around their mean: impulses, each spread by a moving average.

use crate::limits::larger;
use crate::shaping::{Impulse, Kernel};

/// Points at which two filters are compared; their differences are polygons and parabolas that bend
/// at a few delays.
const POINTS: u32 = 128;

/// Measures of a filter, in ticks and squared ticks; of its two sides the larger.
#[derive(Clone, Copy, Debug)]
pub(super) struct Filter {
    /// E(tau)+, on both sides the same.
    pub jump: f32,
    /// Half of E(tau^2) on one side.
    pub bend: f32,
    /// The farthest from the mean.
    pub reach: f32,
    /// The weight.
    pub weight: f32,
}

impl Filter {
    /// Filter of a kernel and a moving average over twice `half_average` ticks.
    #[cold]
    pub fn of(kernel: &Kernel, half_average: f32) -> Self {
        let mut sides = [Self { jump: 0.0, bend: 0.0, reach: 0.0, weight: 0.0 }; 2];
        let centroid = kernel.centroid_ticks();
        for one in kernel.impulses() {
            let weight = one.weight as f32;
            let late = (f64::from(one.delay_ticks) - centroid) as f32;
            for (side, from_mean) in sides.iter_mut().zip([late, -late]) {
                let (part, mean, square) = beyond(from_mean, half_average);
                side.weight += weight * part;
                side.jump += weight * mean;
                side.bend += 0.5 * weight * square;
                side.reach = larger(side.reach, from_mean + half_average);
            }
        }
        let [one, other] = sides;
        Self {
            jump: larger(one.jump, other.jump),
            bend: larger(one.bend, other.bend),
            reach: larger(one.reach, other.reach),
            weight: larger(one.weight, other.weight),
        }
    }
}

/// The integral over |G_x - G_y|, squared ticks: by how much the filters part while the speed
/// changes, for each unit of acceleration.
#[cold]
pub(super) fn apart(x: &Kernel, y: &Kernel, half_average: f32, reach: f32) -> f32 {
    let step = 2.0 * reach / POINTS as f32;
    let mut sum = 0.0;
    for point in 0..POINTS {
        let ticks = (point as f32 + 0.5) * step - reach;
        let difference = ramp(x, half_average, ticks) - ramp(y, half_average, ticks);
        sum += if difference < 0.0 { -difference } else { difference };
    }
    sum * step
}

/// Filtered ramp from 0 at time 0 on, this many ticks later.
fn ramp(kernel: &Kernel, half_average: f32, ticks: f32) -> f32 {
    let centroid = kernel.centroid_ticks();
    let after = |one: &Impulse| ticks - (f64::from(one.delay_ticks) - centroid) as f32;
    kernel.impulses().iter().map(|one| one.weight as f32 * beyond(after(one), half_average).1).sum()
}

/// Part above 0 of a variable that is uniformly distributed within `half` of its mean: its
/// probability, mean and square.
#[inline(never)]
fn beyond(mean: f32, half: f32) -> (f32, f32, f32) {
    if mean >= half {
        return (1.0, mean, mean * mean + half * half / 3.0);
    }
    let above = mean + half;
    if above <= 0.0 {
        return (0.0, 0.0, 0.0);
    }
    let part = above / (2.0 * half);
    (part, 0.5 * part * above, part * above * above / 3.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shaping::{AxisShaper, ShaperKind};

    #[test]
    fn an_average_has_the_moments_of_the_textbook() {
        let Filter { jump, bend, reach, weight } = Filter::of(&Kernel::IDENTITY, 500.0);
        // T / 8, T^2 / 48
        assert!((jump - 125.0).abs() < 1e-3 && (bend - 1e6 / 48.0).abs() < 1e-1, "{jump} {bend}");
        assert_eq!((reach, weight), (500.0, 0.5));
    }

    #[test]
    fn both_sides_together_have_the_variance() {
        for kind in ShaperKind::EXAMPLES {
            let kernel = AxisShaper { kind, frequency_hz: 50.0, damping: 0.0 }.kernel().unwrap_or(Kernel::IDENTITY);
            let filter = Filter::of(&kernel, 0.0);
            // Filters without damping are symmetric, or nearly: of two unequal sides
            // the larger counts.
            let variance = kernel.variance() as f32;
            let per_variance = 4.0 * filter.bend / variance;
            assert!((0.999..1.05).contains(&per_variance) || variance == 0.0, "{kind:?} {filter:?}");
            // A filter against none: the integral of G.
            let apart = apart(&kernel, &Kernel::IDENTITY, 1000.0, filter.reach + 1000.0);
            assert!((apart - 0.5 * variance).abs() <= 1e-2 * variance, "{kind:?} {apart}");
        }
    }
}
