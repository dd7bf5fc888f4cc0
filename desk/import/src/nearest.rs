//! The value of a range that is nearest to a refused one, by what the check of profiles expects.

use toml::{Table, Value};

use crate::paths::{get, number};

/// The speed that spreadCycle begins at for a driver that homes by stalls, as a share of the homing
/// speed: the signal must last until then.
pub(crate) const QUIET_UNTIL: f64 = 1.25;

/// The keys to change, with the values that the check would take; none where it expects no range.
pub(crate) fn nearest(table: &Table, key: &str, reason: &str) -> Vec<(String, Value)> {
    if reason.starts_with("missing key") || reason.starts_with("unknown key") {
        return Vec::new();
    }
    let Some((_, expected)) = reason.split_once("expected ") else { return Vec::new() };
    if let Some(changes) = slower(table, key, expected) {
        return changes;
    }
    if let Some(changes) = faster_homing(table, key, expected) {
        return changes;
    }
    let Some(value) = get(table, key) else { return Vec::new() };
    if value.as_bool() == Some(false) && expected.starts_with("true, or ") {
        return vec![(key.to_owned(), Value::Boolean(true))];
    }
    if let (Some(ends), Some([from, to])) = (value.as_array(), ends_of(expected.trim_start_matches("within "))) {
        let moved: Vec<Value> =
            ends.iter().filter_map(number).map(|end| Value::Float(end.clamp(from, to.max(from)))).collect();
        let ends: Vec<f64> = moved.iter().filter_map(number).collect();
        let is_wide = matches!(ends.as_slice(), [low, high] if high - low >= 1.0);
        return if is_wide { vec![(key.to_owned(), Value::Array(moved))] } else { Vec::new() };
    }
    let Some(now) = number(value) else { return Vec::new() };
    let place = |word: &str| expected.strip_prefix(word).and_then(first_number);
    let moved = if let Some([from, to]) = ends_of(expected) {
        now.clamp(from, to.max(from))
    } else if let Some(least) = place("at least ") {
        now.max(least)
    } else if let Some(most) = place("at most ").or_else(|| value_after(expected, "at most ")) {
        now.min(most)
    } else if let Some(speed) = value_after(expected, "0 or above ") {
        (speed * QUIET_UNTIL).ceil()
    } else if let Some(most) = value_after(expected, "less than ") {
        now.min(most - 1.0)
    } else if let Some(least) = leading_number(expected).filter(|_| expected.contains(" at least")) {
        now.max(least)
    } else {
        return Vec::new();
    };
    if moved == now {
        return Vec::new();
    }
    let moved = match value {
        // A count of the profile stays whole.
        Value::Integer(_) if moved.fract() == 0.0 => Value::Integer(moved as i64),
        _ => Value::Float(moved),
    };
    vec![(key.to_owned(), moved)]
}

/// Speeds that a motor can follow, where its steps would come too fast. Motors that move two axes
/// take the sum of both.
fn slower(table: &Table, key: &str, expected: &str) -> Option<Vec<(String, Value)>> {
    let (_, rest) = expected.split_once("a motor rate of at most ")?;
    let most = first_number(rest)?;
    let (_, rest) = rest.split_once("not ")?;
    let share = most / first_number(rest)?;
    let kinematics = get(table, "kinematics").and_then(Value::as_str).unwrap_or_default();
    let both = match (kinematics, key) {
        ("corexy", "max_feed_mm_per_s.x" | "max_feed_mm_per_s.y") => vec!["max_feed_mm_per_s.x", "max_feed_mm_per_s.y"],
        ("corexz", "max_feed_mm_per_s.x" | "max_feed_mm_per_s.z") => vec!["max_feed_mm_per_s.x", "max_feed_mm_per_s.z"],
        _ => vec![key],
    };
    let slow = |path: &str| {
        let feed = get(table, path).and_then(number)?;
        Some((path.to_owned(), Value::Float((feed * share * 100.0).floor() / 100.0)))
    };
    Some(both.into_iter().filter_map(slow).collect())
}

/// Homing speeds that a driver can measure the load at. The first approach is as fast as the
/// second one at least.
fn faster_homing(table: &Table, key: &str, expected: &str) -> Option<Vec<(String, Value)>> {
    let axis = key.strip_suffix(".slow_mm_per_s")?;
    let least = expected.strip_prefix("at least ").filter(|rest| rest.contains("\"stall\"")).and_then(first_number)?;
    let slower = |path: String| {
        let speed = get(table, &path).and_then(number)?;
        (speed < least).then_some((path, Value::Float(least)))
    };
    Some(["fast_mm_per_s", "slow_mm_per_s"].into_iter().filter_map(|name| slower(format!("{axis}.{name}"))).collect())
}

/// The ends of a range: `0.01 to 50 mm/s, at most fast_mm_per_s`.
fn ends_of(text: &str) -> Option<[f64; 2]> {
    let (low, rest) = text.split_once(" to ")?;
    Some([low.trim().parse().ok()?, first_number(rest)?])
}

/// The number at the very beginning of a text.
fn first_number(text: &str) -> Option<f64> {
    let end = text.find(|char: char| !(char.is_ascii_digit() || ['.', '-'].contains(&char))).unwrap_or(text.len());
    text.get(..end)?.trim_end_matches('.').parse().ok()
}

/// Returns the number as [`first_number`] does, after spaces; for `3 points at least`.
fn leading_number(text: &str) -> Option<f64> {
    first_number(text.trim_start())
}

/// The number of `at most nozzle.max_celsius = 260`.
fn value_after(text: &str, word: &str) -> Option<f64> {
    let (_, value) = text.strip_prefix(word)?.split_once(" = ")?;
    first_number(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn moves(table: &str, key: &str, reason: &str, expected: &str) {
        let table: Table = table.parse().unwrap_or_default();
        let found: Vec<String> =
            nearest(&table, key, reason).into_iter().map(|(path, value)| format!("{path}={value}")).collect();
        assert_eq!(found.join(" "), expected, "{reason}");
    }

    #[test]
    fn a_value_moves_to_the_end_of_its_range() {
        moves("a = 5000", "a", "a = 5000: expected 0.01 to 2000 mm/s", "a=2000");
        moves("a = -3.5", "a", "a = -3.5: expected 0.01 to 2 mm/s, at most the axis's", "a=0.01");
        moves("a = 3", "a", "a = 3: expected at least 4.5 mm with the table", "a=4.5");
        moves("a = 3.0", "a", "a = 3: expected at least 4.5 mm with the table", "a=4.5");
        moves("a = 300.0", "a", "a = 300: expected less than nozzle.max_celsius = 260", "a=259.0");
        moves("a = [20.0, 185.0]", "a", "a: expected within -40 to 180 mm, and 1 mm wide", "a=[20.0, 180.0]");
        moves("a = [190.0, 195.0]", "a", "a: expected within -40 to 180 mm, and 1 mm wide", "");
        moves("a = false", "a", "a = false: expected true, or b at most 3 mm", "a=true");
        let stall = "homing.x.slow_mm_per_s = 16: expected at least 40.0 mm/s for \"stall\", 200 full steps a second";
        let homing = "homing.x.fast_mm_per_s=40.0 homing.x.slow_mm_per_s=40.0";
        moves("homing.x = { fast_mm_per_s = 30, slow_mm_per_s = 16 }", "homing.x.slow_mm_per_s", stall, homing);
        let quiet = "a = 38: expected 0 or above homing.x.fast_mm_per_s = 40: in spreadCycle no stall signal comes";
        moves("a = 38", "a", quiet, "a=50");
        moves("a = 1", "b", "missing key \"b\", expected 2 to 15 points", "");
        moves("a = \"x\"", "a", "a = x: expected one of y, z", "");
        let text = "kinematics = \"corexy\"\nmax_feed_mm_per_s = { x = 400.0, y = 300.0 }";
        let reason = "expected a motor rate of at most 500000 steps/s (interval = 2), not 1000000: lower it";
        moves(text, "max_feed_mm_per_s.x", reason, "max_feed_mm_per_s.x=200.0 max_feed_mm_per_s.y=150.0");
    }
}
