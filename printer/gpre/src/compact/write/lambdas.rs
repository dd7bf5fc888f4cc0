//! Choice of the lambda that predicts a move's filament.

use std::vec::Vec;

use super::steps::Steps;
use crate::bits::{golomb_bits, zigzag};
use crate::compact::shape::{PATH_NONE, PLACES, prediction};

/// A prediction this far off, in the filament's unit, is a good one.
const GOOD: i64 = 3;

/// Chooses a lambda for each move that pushes filament along a path: as few and as exact as pays.
pub fn lambdas(steps: &[Steps]) -> Vec<f32> {
    let mut chosen = Vec::with_capacity(steps.len());
    let mut known: Vec<f32> = Vec::new();
    let mut lambda = 0.0f32;
    let off = |steps: &Steps, lambda: f32| (steps.filament - i64::from(prediction(steps.path, lambda))).abs();
    let is_predicted = |steps: &Steps| steps.kind != PATH_NONE && steps.filament != 0;
    for (index, next) in steps.iter().enumerate() {
        if !is_predicted(next) {
            chosen.push(lambda);
            continue;
        }
        if off(next, lambda) > GOOD {
            let best = known.iter().copied().min_by_key(|&other| off(next, other));
            match best {
                Some(best) if off(next, best) <= GOOD && best != lambda => lambda = best,
                _ => {
                    let (run, new) = longest_run(&steps[index..], is_predicted);
                    // A new lambda has 29 bits; a bad prediction costs two for every doubling.
                    let bad: u32 = steps[index..]
                        .iter()
                        .filter(|steps| is_predicted(steps))
                        .take(run)
                        .map(|steps| golomb_bits(zigzag(off(steps, lambda)), 1).saturating_sub(4))
                        .sum();
                    if bad > 29 || lambda == 0.0 {
                        lambda = new;
                        known.push(new);
                        if known.len() > PLACES {
                            known.remove(0);
                        }
                    }
                }
            }
        }
        chosen.push(lambda);
    }
    chosen
}

/// Number of moves from here on that one lambda predicts well, and that lambda.
fn longest_run(steps: &[Steps], is_predicted: impl Fn(&Steps) -> bool) -> (usize, f32) {
    /// Longer runs give no more information.
    const ENOUGH: usize = 40;
    let mut run = 0;
    let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
    for steps in steps.iter().filter(|steps| is_predicted(steps)).take(ENOUGH) {
        let length = steps.path.iter().map(|&component| f64::from(component).powi(2)).sum::<f64>().sqrt();
        let (least, most) = ((steps.filament as f64 - 1.5) / length, (steps.filament as f64 + 1.5) / length);
        if least > high || most < low {
            break;
        }
        (low, high) = (low.max(least), high.min(most));
        run += 1;
    }
    // Cut to the written bits; the prediction is cut as well, so the middle is above by half a
    // unit at the longest.
    (run, f32::from_bits(((low / 2.0 + high / 2.0) as f32).to_bits() & !0xff))
}
