//! The limit that explains the time that a printer took for a file.

use std::path::Path;

use ferrostep_session::rules::{RuledMachine, Scale, Scaled};
use ferrostep_session::took::{Explanation, Took};

use crate::sweep::{SweepError, estimate};
use crate::without_commands::Dropped;

/// Largest factor of a limit that is tried, and the inverse of the smallest.
const LARGEST_FACTOR: f64 = 16.0;
/// Largest difference from the measured time, as a part of it.
const TOLERANCE: f64 = 2e-4;
/// Maximum number of estimates for a limit.
const MAX_TRIALS: usize = 24;

/// The limits by name.
const LIMITS: [(Scaled, &str); 5] = [
    (Scaled::AskedSpeed, "asked speed"),
    (Scaled::LargestSpeed, "largest speed"),
    (Scaled::Acceleration, "acceleration"),
    (Scaled::Corner, "corner"),
    (Scaled::ShortMove, "acceleration of short moves"),
];

/// Finds the limits with which a file, estimated at so much, would take the measured time.
///
/// # Errors
/// The machine makes no plan, or the job stops.
pub fn explain(file: &Path, machine: &RuledMachine, measured_s: f64, estimated_s: f64) -> Result<Took, SweepError> {
    let mut took = Took { measured_s, difference_s: measured_s - estimated_s, explained_by: Vec::new() };
    if Took::agrees(measured_s, estimated_s) {
        return Ok(took);
    }
    let limits = LIMITS.into_iter().filter(|(limit, _)| machine.has(*limit));
    let found = std::thread::scope(|scope| {
        let threads: Vec<_> = limits
            .map(|(limit, name)| (name, scope.spawn(move || factor(file, machine, limit, measured_s, estimated_s))))
            .collect();
        threads.into_iter().map(|(name, thread)| (name, thread.join().unwrap_or(Ok(None)))).collect::<Vec<_>>()
    });
    for (limit, factor) in found {
        took.explained_by.extend(factor?.map(|factor| Explanation { limit, factor }));
    }
    took.explained_by.sort_by(|one, other| one.factor.ln().abs().total_cmp(&other.factor.ln().abs()));
    Ok(took)
}

/// The factor of a limit with which the file takes a time; `None` if none does.
fn factor(
    file: &Path,
    machine: &RuledMachine,
    limit: Scaled,
    measured_s: f64,
    estimated_s: f64,
) -> Result<Option<f64>, SweepError> {
    let dropped = Dropped::new(Vec::new());
    let time_s = |logarithm: f64| -> Result<f64, SweepError> {
        let machine = machine
            .scaled(Scale::of(limit, logarithm.exp()))
            .map_err(|error| SweepError::Profile(error.to_string()))?;
        Ok(estimate(file, machine, &dropped)?.0)
    };
    // A smaller limit takes longer.
    let far = if measured_s > estimated_s { -LARGEST_FACTOR.ln() } else { LARGEST_FACTOR.ln() };
    let (mut near, mut far) = ((0.0, estimated_s - measured_s), (far, time_s(far)? - measured_s));
    if near.1 * far.1 > 0.0 {
        return Ok(None);
    }
    for trial in 0..MAX_TRIALS {
        // The line between the two, and now and then their middle.
        let share = if trial % 3 == 2 { 0.5 } else { near.1 / (near.1 - far.1) };
        let between = near.0 + (far.0 - near.0) * share.clamp(0.02, 0.98);
        let off_s = time_s(between)? - measured_s;
        if off_s.abs() <= TOLERANCE * measured_s {
            return Ok(Some(between.exp()));
        }
        if off_s * near.1 > 0.0 {
            near = (between, off_s);
        } else {
            far = (between, off_s);
        }
    }
    Ok(None)
}
