//! Costs of the steps of `ci`, compared with those of an earlier run, so that a check that grows by
//! a third is noticed.
//!
//! A cost is the core-seconds of a step's programs divided by those of a fixed loop on the same
//! computer ([`crate::cost`]).

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde_json::json;

use crate::steps::Failure;
use crate::system;

/// The costs that were kept, from the root.
const KEPT: &str = "xtask/step-costs.json";

/// Maximum cost of a step, in parts of its kept cost.
const LARGEST_GROWTH: f64 = 4.0 / 3.0;

/// Minimum growth of a step that counts, in units: short steps vary with the state of the disk.
const SMALLEST_GROWTH: f64 = 10.0;

type Costs = BTreeMap<String, f64>;

/// Keeps the costs of these steps, which are in core-seconds.
///
/// # Errors
/// The file cannot be written.
pub fn write(steps: &[(&str, f64)], unit_s: f64) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(&json!(in_units(steps, unit_s))).map_err(|error| error.to_string())?;
    std::fs::write(path(), text + "\n").map_err(|error| format!("{KEPT}: {error}"))
}

/// Compares the costs of these steps, which are in core-seconds, with the kept ones.
///
/// # Errors
/// A step costs over a third more than it did, or the file cannot be read.
pub fn check(steps: &[(&str, f64)], unit_s: f64) -> Result<(), Failure> {
    let text = std::fs::read_to_string(path())
        .map_err(|error| format!("{KEPT}: {error}: `cargo xtask ci --save-costs` writes it"))?;
    let kept: Costs = serde_json::from_str(&text).map_err(|error| format!("{KEPT}: {error}"))?;
    let grown = grown(&kept, &in_units(steps, unit_s));
    if grown.is_empty() { Ok(()) } else { Err(grown.join("\n")) }
}

fn path() -> PathBuf {
    system::root().join(KEPT)
}

/// Steps of one name are added.
fn in_units(steps: &[(&str, f64)], unit_s: f64) -> Costs {
    let mut costs = Costs::new();
    for (name, core_s) in steps {
        *costs.entry((*name).to_owned()).or_default() += core_s / unit_s.max(f64::MIN_POSITIVE);
    }
    costs.values_mut().for_each(|cost| *cost = (*cost * 10.0).round() / 10.0);
    costs
}

/// A line for each step that has grown too much. A new step has no kept cost and is left out.
fn grown(kept: &Costs, now: &Costs) -> Vec<Failure> {
    let too_much = |before: f64, now: f64| now > before * LARGEST_GROWTH && now > before + SMALLEST_GROWTH;
    let pairs = now.iter().filter_map(|(name, now)| Some((name, *kept.get(name)?, *now)));
    let grown = pairs.filter(|(_, before, now)| too_much(*before, *now));
    grown
        .map(|(name, before, now)| {
            format!("the step \"{name}\" costs {now} units, {before} before: make it cheaper, or keep the new cost by `cargo xtask ci --save-costs`")
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn costs(pairs: &[(&str, f64)]) -> Costs {
        pairs.iter().map(|(name, cost)| ((*name).to_owned(), *cost)).collect()
    }

    #[test]
    fn a_third_more_is_noticed() {
        let kept = costs(&[("tests", 90.0), ("images", 60.0), ("format", 1.0)]);
        assert!(
            grown(&kept, &costs(&[("tests", 119.0), ("images", 30.0), ("format", 9.0), ("new", 500.0)])).is_empty()
        );
        let said = grown(&kept, &costs(&[("tests", 121.0), ("images", 60.0)]));
        assert_eq!(said.len(), 1);
        assert!(said.iter().all(|said| said.contains("\"tests\" costs 121 units, 90 before")), "{said:?}");
    }

    #[test]
    fn costs_are_in_units_of_the_loop() {
        assert_eq!(
            in_units(&[("tests", 10.0), ("tests", 5.0), ("images", 1.0)], 2.0),
            costs(&[("images", 0.5), ("tests", 7.5)])
        );
    }
}
