//! The committed counts, and the changes since.

use std::fmt;
use std::path::PathBuf;

use serde_json::Value;

use crate::steps::Failure;
use crate::system;

/// Maximum growth of a count, percent; more fails the check.
const TOLERANCE_PERCENT: f64 = 3.0;

/// The same for images of another compiler than the baseline's, which alone has changed
/// counts by up to 10 %.
const OTHER_COMPILER_TOLERANCE_PERCENT: f64 = 20.0;

/// The parts of the figures that are the same on every run and every machine, and are costs.
const COMPARED: [&str; 3] = ["target", "image", DESK];

/// The part that is counted only where valgrind is installed.
pub const DESK: &str = "desk";

/// A count that differs from the baseline.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    /// Key with dots.
    pub key: String,
    /// The committed count; `None` if it is missing.
    pub before: Option<f64>,
    /// The current count; `None` if it is not counted any more.
    pub now: Option<f64>,
}

impl Change {
    /// Growth of the count, percent; `None` for a new or lost count.
    pub fn percent(&self) -> Option<f64> {
        let (before, now) = (self.before?, self.now?);
        Some(if before > 0.0 { (now / before - 1.0) * 100.0 } else { f64::INFINITY })
    }

    /// Returns true if it fails the check: it grew too much, or is not counted any more.
    fn is_failure(&self, tolerance_percent: f64) -> bool {
        match (self.before, self.now) {
            (Some(before), Some(now)) => now * 100.0 > before * (100.0 + tolerance_percent),
            (_, now) => now.is_none(),
        }
    }
}

impl fmt::Display for Change {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { key, before, now } = self;
        match (before, now, self.percent()) {
            (Some(before), Some(now), Some(percent)) => write!(out, "{key}: {before} -> {now} ({percent:+.1} %)"),
            (Some(before), ..) => write!(out, "{key}: {before} -> no longer counted"),
            (None, Some(now), _) => write!(out, "{key}: {now}, not in the baseline"),
            (None, None, _) => write!(out, "{key}: never counted"),
        }
    }
}

/// Path of the committed counts.
fn path() -> PathBuf {
    system::root().join("xtask/bench-baseline.json")
}

/// The committed counts.
pub fn read() -> Result<Value, Failure> {
    let path = path();
    let text = std::fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))?;
    serde_json::from_str(&text).map_err(|error| format!("{}: {error}", path.display()))
}

/// Saves these as the committed counts, without those that differ from run to run; the desk's stay
/// unchanged if they were not counted. Returns them.
pub fn write(figures: &Value) -> Result<Value, Failure> {
    let kept = kept(figures, &read().unwrap_or_default());
    let path = path();
    let text = format!("{kept:#}\n");
    std::fs::write(&path, text).map_err(|error| format!("{}: {error}", path.display()))?;
    Ok(kept)
}

/// The part of these figures that is committed.
fn kept(figures: &Value, before: &Value) -> Value {
    let mut kept = figures.clone();
    if let Some(object) = kept.as_object_mut() {
        object.remove("host");
        if let Some(desk) = before.get(DESK) {
            object.entry(DESK).or_insert_with(|| desk.clone());
        }
    }
    kept
}

/// All numbers in nested objects and lists, by their keys with dots, in the order of the file.
pub fn numbers(value: &Value) -> Vec<(String, f64)> {
    fn collect(prefix: &str, value: &Value, found: &mut Vec<(String, f64)>) {
        let key_of = |key: &str| if prefix.is_empty() { key.to_owned() } else { format!("{prefix}.{key}") };
        match value {
            Value::Object(object) => object.iter().for_each(|(key, value)| collect(&key_of(key), value, found)),
            Value::Array(list) => {
                list.iter().enumerate().for_each(|(index, value)| collect(&key_of(&index.to_string()), value, found));
            }
            _ => found.extend(value.as_f64().map(|number| (prefix.to_owned(), number))),
        }
    }
    let mut found = Vec::new();
    collect("", value, &mut found);
    found
}

/// Every compared count that differs from the baseline.
pub fn changes(baseline: &Value, figures: &Value) -> Vec<Change> {
    // A part may be counted without the others.
    let is_counted = |part: &str| figures.get(part).is_some();
    let compared = |value: &Value| -> Vec<(String, f64)> {
        let parts = COMPARED.iter().filter(|part| is_counted(part));
        let parts = parts.filter_map(|part| Some((part, value.get(part)?)));
        parts
            .flat_map(|(part, value)| {
                numbers(value).into_iter().map(move |(key, number)| (format!("{part}.{key}"), number))
            })
            .collect()
    };
    let (before, now) = (compared(baseline), compared(figures));
    let find = |list: &[(String, f64)], key: &str| list.iter().find(|entry| entry.0 == key).map(|entry| entry.1);
    let kept =
        before.iter().map(|(key, count)| Change { key: key.clone(), before: Some(*count), now: find(&now, key) });
    let added = now.iter().filter(|(key, _)| find(&before, key).is_none()).map(|(key, count)| Change {
        key: key.clone(),
        before: None,
        now: Some(*count),
    });
    kept.chain(added).filter(|change| change.before != change.now).collect()
}

/// Prints the changes; fails if something grew too much or is not counted any more.
pub fn check(baseline: &Value, figures: &Value) -> Result<(), Failure> {
    let changes = changes(baseline, figures);
    for change in &changes {
        eprintln!("    {change}");
    }
    let (theirs, own) = (compiler(baseline), compiler(figures));
    let tolerance = if theirs == own {
        TOLERANCE_PERCENT
    } else {
        eprintln!("    the baseline is of code by {theirs}, these counts by {own}: they may differ more");
        OTHER_COMPILER_TOLERANCE_PERCENT
    };
    let failures: Vec<String> =
        changes.iter().filter(|change| change.is_failure(tolerance)).map(Change::to_string).collect();
    if failures.is_empty() {
        eprintln!(
            "    {} counts differ from the baseline, none is lost or more than {tolerance} % above",
            changes.len()
        );
        return Ok(());
    }
    Err(format!(
        "more than {tolerance} % above the baseline, or lost: {}. If it must be so, `cargo xtask bench \
         --save-baseline` makes these the baseline",
        failures.join("; ")
    ))
}

/// The compiler that built the images.
fn compiler(figures: &Value) -> &str {
    figures.get("compiler").and_then(Value::as_str).unwrap_or("an unknown compiler")
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use serde_json::json;

    fn figures(parse: f64, text: u32) -> Value {
        json!({"target": {"parse_line": parse, "step_event": {"worst": 40, "new_key": null}},
            "image": {"text": text}, "host": {"realtime_factor": parse}, "workload": {"events": parse}})
    }

    #[test]
    fn numbers_are_found_by_their_keys() {
        let found = numbers(&json!({"a": {"b": 1, "c": {"d": 2.5}}, "e": null, "f": [3, {"g": 4}]}));
        let expected = [("a.b", 1.0), ("a.c.d", 2.5), ("f.0", 3.0), ("f.1.g", 4.0)];
        let expected = expected.map(|(key, number)| (key.to_owned(), number));
        assert_eq!(found, expected);
    }

    #[test]
    fn growth_within_the_tolerance_passes_and_beyond_it_fails() {
        let baseline = figures(1000.0, 5000);
        for (parse, passes) in [(1.0, true), (1000.0, true), (1030.0, true), (1030.1, false), (9000.0, false)] {
            assert_eq!(check(&baseline, &figures(parse, 5000)).is_ok(), passes, "{parse}");
        }
        assert!(check(&baseline, &figures(1000.0, 5151)).unwrap_err().contains("image.text: 5000 -> 5151 (+3.0 %)"));
    }

    #[test]
    fn another_compiler_may_differ_more_but_not_without_bound() {
        let by = |compiler: &str, parse| {
            let mut figures = figures(parse, 1);
            figures["compiler"] = json!(compiler);
            figures
        };
        for (compiler, parse, passes) in [("a", 1040.0, false), ("b", 1040.0, true), ("b", 1201.0, false)] {
            assert_eq!(check(&by("a", 1000.0), &by(compiler, parse)).is_ok(), passes, "{compiler} {parse}");
        }
    }

    #[test]
    fn a_failure_names_key_both_counts_and_percent() {
        let error = check(&figures(1000.0, 1), &figures(1100.0, 1)).unwrap_err();
        assert!(error.contains("target.parse_line: 1000 -> 1100 (+10.0 %)"), "{error}");
        assert!(!error.contains("host") && !error.contains("workload"), "{error}");
    }

    #[test]
    fn a_lost_count_fails_and_a_new_one_does_not() {
        let baseline = figures(1000.0, 1);
        let mut lost = baseline.clone();
        lost["target"]["step_event"]["worst"] = Value::Null;
        assert!(check(&baseline, &lost).unwrap_err().contains("target.step_event.worst: 40 -> no longer counted"));
        let mut more = baseline.clone();
        more["target"]["step_event"]["new_key"] = json!(8);
        assert_eq!(check(&baseline, &more), Ok(()));
        assert_eq!(changes(&baseline, &more).len(), 1);
    }

    #[test]
    fn the_desk_is_compared_where_it_is_counted() {
        let with_desk = |a_line: f64| {
            let mut figures = figures(1000.0, 1);
            figures["desk"] = json!({"estimate": {"cube": {"a_line": a_line}}});
            figures
        };
        let baseline = with_desk(6000.0);
        let error = check(&baseline, &with_desk(36_000.0)).unwrap_err();
        assert!(error.contains("desk.estimate.cube.a_line: 6000 -> 36000 (+500.0 %)"), "{error}");
        assert_eq!(check(&baseline, &figures(1000.0, 1)), Ok(()));
        // The desk's baseline is kept where the desk is not counted.
        assert_eq!(kept(&figures(1000.0, 1), &baseline)["desk"], baseline["desk"]);
        assert_eq!(kept(&with_desk(5000.0), &baseline)["desk"], with_desk(5000.0)["desk"]);
        assert_eq!(kept(&baseline, &json!({})).get("host"), None);
    }

    #[test]
    fn improvements_are_reported() {
        let changes = changes(&figures(1000.0, 1), &figures(900.0, 1));
        assert_eq!(changes.len(), 1);
        assert_eq!(changes[0].to_string(), "target.parse_line: 1000 -> 900 (-10.0 %)");
        assert!(!changes[0].is_failure(0.0));
    }

    #[test]
    fn a_count_that_was_zero_may_not_grow() {
        let change = Change { key: "a".to_owned(), before: Some(0.0), now: Some(1.0) };
        assert!(change.is_failure(100.0));
    }
}
