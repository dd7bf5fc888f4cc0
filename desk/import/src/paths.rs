//! Keys of a profile by their paths, and which of them say what machine it is.

use ferrostep_checked_toml::keys::paths;
use toml::{Table, Value};

/// Keys that say what machine it is: another machine's value there breaks something. A path that
/// begins with one is meant as well.
const IDENTITY: [&str; 9] = [
    "kinematics",
    "size_mm",
    "lower_end_mm",
    "steps_per_mm",
    "driver.inverted",
    "homing.probe_offset_mm",
    "tools.t1.steps_per_mm",
    "tools.t1.inverted",
    "tools.t1.nozzle.sensor",
];
/// The same of each axis's homing, and of each heater.
const OF_AXIS: [&str; 4] = ["end", "sensor", "triggers_low", "position_mm"];
const OF_HEATER: [&str; 2] = ["sensor", "pull_up_ohm"];

/// Returns true if a key is part of the machine's identity.
pub(crate) fn is_identity(path: &str) -> bool {
    let begins = |start: &str| path.strip_prefix(start).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'));
    let parts: Vec<&str> = path.split('.').collect();
    IDENTITY.iter().any(|start| begins(start))
        || matches!(parts.as_slice(), ["homing", "x" | "y" | "z", key, ..] if OF_AXIS.contains(key))
        || matches!(parts.as_slice(), ["nozzle" | "bed", key, ..] if OF_HEATER.contains(key))
}

/// Numbers as people write them: six decimals are more than a profile keeps, and
/// nothing has a sign.
pub(crate) fn rounded(value: Value) -> Value {
    match value {
        Value::Float(number) if number.is_finite() => Value::Float((number * 1e6).round() / 1e6 + 0.0),
        other => other,
    }
}

/// The number that a value is.
pub(crate) fn number(value: &Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|number| number as f64))
}

/// The paths of all values.
pub(crate) fn values(table: &Table) -> Vec<String> {
    paths(table).into_iter().filter(|path| get(table, path).is_some_and(|value| !value.is_table())).collect()
}

/// The value of a path.
pub(crate) fn get<'a>(table: &'a Table, path: &str) -> Option<&'a Value> {
    match path.split_once('.') {
        None => table.get(path),
        Some((first, rest)) => get(table.get(first)?.as_table()?, rest),
    }
}

/// Sets a path's value, or removes it.
pub(crate) fn set(table: &mut Table, path: &str, value: Option<Value>) {
    match (path.split_once('.'), value) {
        (None, Some(value)) => {
            table.insert(path.to_owned(), value);
        }
        (None, None) => {
            table.remove(path);
        }
        (Some((first, rest)), value) => {
            let inner = table.entry(first).or_insert_with(|| Value::Table(Table::new()));
            if let Some(inner) = inner.as_table_mut() {
                set(inner, rest, value);
            }
        }
    }
}
