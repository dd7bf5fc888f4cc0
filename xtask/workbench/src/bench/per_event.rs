//! Instructions per step event: the bench counts the instructions, its other build the events.

use serde_json::{Value, json};

use super::cycle_model::{percent, solved_steps_percent};
use crate::steps::Failure;

/// Steps a second of all motors of a fast machine: CoreXY with 160 steps/mm at 300 mm/s.
pub const FAST_STEPS_PER_S: f64 = 140e3;

/// Breakpoints a second of the bench's filters, MZV at 50 and 40 Hz, in the shortest moves
/// that the plan lets through: 36 pieces of it within the 18.8 ms of the longer filter, seen
/// at each of 7 delays.
pub const MOST_BREAKPOINTS_PER_S: f64 = 36.0 * 7.0 / 18.8e-3;

/// Counts for each event: the place in the counts and the workload, and the key in the
/// target's figures.
const PER_EVENT: [(&str, &[&str]); 3] = [
    ("trapezoid", &["interpolate_per_step_trapezoid"]),
    ("trapezoid_one_axis", &["interpolate_per_step_trapezoid_one_axis"]),
    ("print", &["line_to_queue", "interpolate_per_event"]),
];

/// The target's figures.
pub fn target(counts: &Value, workload: &Value) -> Result<Value, Failure> {
    let mut target = counts.get("target").cloned().ok_or("the bench counted nothing of the target")?;
    for (what, keys) in PER_EVENT {
        let instructions = number(counts, &["interpolation", what])?;
        let events = number(workload, &[what, "events"])?;
        if events <= 0.0 {
            return Err(format!("the bench made no events: {what}"));
        }
        // One decimal, as in the means that the bench works out itself.
        let each = (instructions / events * 10.0).round() / 10.0;
        let mut place = &mut target;
        for key in keys {
            place = place
                .as_object_mut()
                .ok_or_else(|| format!("the bench counted no {key}"))?
                .entry(*key)
                .or_insert(Value::Null);
        }
        *place = json!(each);
    }
    add_shares(&mut target)?;
    Ok(target)
}

/// Adds the shares of the processor that shaped motion takes.
fn add_shares(target: &mut Value) -> Result<(), Failure> {
    let interrupt = number(target, &["step_event", "new_stair_1_axis"])?;
    let step = number(target, &["shaped", "per_step"])?;
    let breakpoint = number(target, &["shaped", "per_breakpoint"])?;
    let shares = [
        ("percent_at_140k_steps", solved_steps_percent(FAST_STEPS_PER_S, step, interrupt)),
        ("percent_of_most_breakpoints", percent(MOST_BREAKPOINTS_PER_S, breakpoint)),
    ];
    let shaped = target.get_mut("shaped").and_then(Value::as_object_mut).ok_or("the bench shaped nothing")?;
    for (key, share) in shares {
        shaped.insert(key.to_owned(), json!((share * 10.0).round() / 10.0));
    }
    Ok(())
}

/// The number of events.
pub fn workload(counts: &Value, mut workload: Value) -> Result<Value, Failure> {
    let moves = counts.get("moves").cloned().ok_or("the bench counted no moves")?;
    workload
        .get_mut("print")
        .and_then(Value::as_object_mut)
        .ok_or("the bench made no print")?
        .insert("moves".to_owned(), moves);
    Ok(workload)
}

fn number(value: &Value, keys: &[&str]) -> Result<f64, Failure> {
    keys.iter()
        .try_fold(value, |value, key| value.get(key))
        .and_then(Value::as_f64)
        .ok_or_else(|| format!("the bench counted no {}", keys.join(".")))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn counts() -> Value {
        json!({"target": {"parse_line": 7, "line_to_queue": {"plan": 8}, "step_event": {"new_stair_1_axis": 33},
                "shaped": {"per_step": 120, "per_breakpoint": 600.0}}, "moves": 5,
            "interpolation": {"trapezoid": 1000, "trapezoid_one_axis": 500, "print": 100}})
    }

    fn tallies(print_events: u32) -> Value {
        json!({"trapezoid": {"events": 3}, "trapezoid_one_axis": {"events": 5}, "print": {"events": print_events}})
    }

    #[test]
    fn instructions_are_divided_by_events() {
        let expected = json!({"parse_line": 7, "interpolate_per_step_trapezoid": 333.3,
            "interpolate_per_step_trapezoid_one_axis": 100.0,
            "step_event": {"new_stair_1_axis": 33},
            "shaped": {"per_step": 120, "per_breakpoint": 600.0, "percent_at_140k_steps": 21.8,
                "percent_of_most_breakpoints": 6.7},
            "line_to_queue": {"plan": 8, "interpolate_per_event": 50.0}});
        assert_eq!(target(&counts(), &tallies(2)).unwrap(), expected);
    }

    #[test]
    fn uncounted_values_are_named() {
        assert!(target(&json!({}), &tallies(2)).is_err());
        assert!(target(&counts(), &tallies(0)).unwrap_err().contains("print"));
        let error = target(&counts(), &json!({})).unwrap_err();
        assert!(error.contains("trapezoid.events"), "{error}");
        let mut unshaped = counts();
        unshaped["target"]["shaped"] = json!({});
        let error = target(&unshaped, &tallies(2)).unwrap_err();
        assert!(error.contains("shaped.per_step"), "{error}");
    }

    #[test]
    fn the_print_has_its_moves() {
        assert_eq!(workload(&counts(), tallies(2)).unwrap()["print"], json!({"events": 2, "moves": 5}));
        assert!(workload(&json!({}), tallies(2)).is_err());
    }
}
