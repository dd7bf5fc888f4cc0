//! Conditions around Marlin's definitions: `#if ENABLED(A) && (B > 1 || AXIS_IS_TMC(X))`.
//!
//! Marlin computes many of its names in its own headers, which are not read. A condition that
//! cannot be known holds, so that nothing is lost.

use crate::c_macros::is_enabled;
use crate::definitions::Definitions;
use crate::expression::number;

/// Deepest brackets and negations.
const MAX_DEPTH: usize = 20;

/// Comparisons, the longer ones first.
const COMPARISONS: [&str; 6] = ["==", "!=", "<=", ">=", "<", ">"];

/// Returns true if a condition holds.
pub fn holds(text: &str, definitions: &Definitions) -> bool {
    any(text, definitions, 0)
}

fn any(text: &str, definitions: &Definitions, depth: usize) -> bool {
    depth > MAX_DEPTH || parts(text, "||").into_iter().any(|part| all(part, definitions, depth))
}

fn all(text: &str, definitions: &Definitions, depth: usize) -> bool {
    parts(text, "&&").into_iter().all(|part| one(part.trim(), definitions, depth))
}

fn one(text: &str, definitions: &Definitions, depth: usize) -> bool {
    if let Some(inner) = text.strip_prefix('!').filter(|inner| !inner.starts_with('=')) {
        return depth > MAX_DEPTH || !one(inner.trim(), definitions, depth + 1);
    }
    if let Some(comparison) = compared(text, definitions) {
        return comparison;
    }
    if let Some(inner) = text.strip_prefix('(').and_then(|rest| rest.strip_suffix(')')) {
        return any(inner, definitions, depth + 1);
    }
    if let Some((function, names)) =
        text.split_once('(').and_then(|(f, rest)| Some((f.trim(), rest.strip_suffix(')')?)))
    {
        let names: Vec<&str> = names.split(',').map(str::trim).collect();
        return called(function, &names, definitions).unwrap_or(true);
    }
    if let Some(name) = text.strip_prefix("defined ") {
        return definitions.values.contains_key(name.trim());
    }
    match text {
        "HAS_TRINAMIC_CONFIG" => any_driver(definitions, is_trinamic),
        "HAS_L64XX" => any_driver(definitions, is_l64xx),
        _ => number(text, definitions).is_none_or(|number| number != 0.0),
    }
}

/// Evaluates a function-like name; `None` if it is not known.
fn called(function: &str, names: &[&str], definitions: &Definitions) -> Option<bool> {
    let is_on = |name: &&str| is_enabled(name, definitions).unwrap_or(false);
    let first = names.first().copied().unwrap_or_default();
    Some(match function {
        "defined" => definitions.values.contains_key(first),
        "ENABLED" | "ALL" | "BOTH" => names.iter().all(is_on),
        "ANY" | "EITHER" => names.iter().any(is_on),
        "DISABLED" | "NONE" | "NEITHER" => !names.iter().any(is_on),
        "MB" | "MOTHERBOARD" => {
            let board = definitions.values.get("MOTHERBOARD")?;
            names.iter().any(|name| board.strip_prefix("BOARD_") == Some(name) || board == name)
        }
        "HAS_DRIVER" => any_driver(definitions, |kind| kind == first),
        "AXIS_IS_TMC" | "AXIS_IS_TMC_CONFIG" => is_trinamic(driver(definitions, first)),
        "AXIS_IS_L64XX" => is_l64xx(driver(definitions, first)),
        "AXIS_DRIVER_TYPE" => names.get(1).is_some_and(|kind| driver(definitions, first) == *kind),
        _ => driver(definitions, function.strip_prefix("AXIS_DRIVER_TYPE_")?) == first,
    })
}

/// The kind of a motor's driver; Marlin's own is the A4988, and a motor that is not there has none.
fn driver<'a>(definitions: &'a Definitions, axis: &str) -> &'a str {
    let kind = definitions.values.get(&format!("{axis}_DRIVER_TYPE")).map(String::as_str);
    kind.unwrap_or(if ["X", "Y", "Z", "E0"].contains(&axis) { "A4988" } else { "" })
}

fn any_driver(definitions: &Definitions, is: impl Fn(&str) -> bool) -> bool {
    definitions.values.iter().any(|(name, kind)| name.ends_with("_DRIVER_TYPE") && is(kind))
}

/// Returns true if a driver is one of Trinamic's that takes settings.
fn is_trinamic(kind: &str) -> bool {
    let rest = kind.strip_prefix("TMC").filter(|rest| !rest.ends_with("_STANDALONE"));
    rest.is_some_and(|rest| !["2100", "26X"].contains(&rest))
}

fn is_l64xx(kind: &str) -> bool {
    kind.starts_with("L64") || kind == "POWERSTEP01"
}

/// A comparison of two numbers or of two words; `None` for anything else, or if one of its
/// sides is not known.
fn compared(text: &str, definitions: &Definitions) -> Option<bool> {
    let (sign, [left, right]) = COMPARISONS.into_iter().find_map(|sign| match parts(text, sign)[..] {
        [left, right] => Some((sign, [left.trim(), right.trim()])),
        _ => None,
    })?;
    if let (Some(left), Some(right)) = (number(left, definitions), number(right, definitions)) {
        return Some(match sign {
            "==" => left == right,
            "!=" => left != right,
            "<=" => left <= right,
            ">=" => left >= right,
            "<" => left < right,
            _ => left > right,
        });
    }
    let value = |name: &str| definitions.values.get(name).cloned();
    match (sign, value(left)) {
        ("==", Some(left)) => Some(left == value(right).unwrap_or_else(|| right.to_owned())),
        ("!=", Some(left)) => Some(left != value(right).unwrap_or_else(|| right.to_owned())),
        _ => Some(true),
    }
}

/// The parts of a text between signs outside all brackets.
fn parts<'a>(text: &'a str, sign: &str) -> Vec<&'a str> {
    let (mut parts, mut depth, mut start, mut at) = (Vec::new(), 0_usize, 0, 0);
    while let Some(rest) = text.get(at..) {
        match rest.chars().next() {
            None => break,
            Some('(') => depth += 1,
            Some(')') => depth = depth.saturating_sub(1),
            Some(_) if depth == 0 && rest.starts_with(sign) => {
                parts.push(text.get(start..at).unwrap_or_default());
                start = at + sign.len();
                at = start;
                continue;
            }
            Some(_) => {}
        }
        at += rest.chars().next().map_or(1, char::len_utf8);
    }
    parts.push(text.get(start..).unwrap_or_default());
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    fn definitions() -> Definitions {
        let text = "#define A\n#define OFF 0\n#define TWO 2\n#define BOARD BOARD_X\n#define MOTHERBOARD BOARD_X\n\
                    #define X_DRIVER_TYPE TMC2209\n#define Y_DRIVER_TYPE TMC2208_STANDALONE\n";
        crate::marlin::parse("Configuration.h", text, &mut |_| Err("none".to_owned())).unwrap_or_default()
    }

    #[test]
    fn conditions_hold_as_the_preprocessor_has_them() {
        for (text, expected) in [
            ("ENABLED(A)", true),
            ("ENABLED(OFF)", false),
            ("ENABLED(B)", false),
            ("DISABLED(B)", true),
            ("ANY(B, A)", true),
            ("BOTH(B, A)", false),
            ("defined(OFF) && !defined(B)", true),
            ("defined A", true),
            ("OFF", false),
            ("TWO", true),
            ("TWO == 2", true),
            ("TWO > 2", false),
            ("TWO >= 2 && TWO <= 2", true),
            ("TWO * 2 == 4", true),
            ("(TWO > 1 || ENABLED(B)) && !(ENABLED(B) || TWO < 2)", true),
            ("MOTHERBOARD == BOARD_Y", false),
            ("MB(X)", true),
            ("AXIS_IS_TMC(X)", true),
            ("AXIS_IS_TMC(Y)", false),
            ("AXIS_IS_TMC(X2)", false),
            ("AXIS_DRIVER_TYPE_X(TMC26X)", false),
            ("AXIS_DRIVER_TYPE_Z(A4988)", true),
            ("AXIS_IS_L64XX(X)", false),
            ("HAS_L64XX", false),
            ("HAS_TRINAMIC_CONFIG", true),
            ("HAS_DRIVER(TMC2209)", true),
            ("HAS_OF_MARLINS_OWN", true),
            ("HAS_OF_MARLINS_OWN(X)", true),
        ] {
            assert_eq!(holds(text, &definitions()), expected, "{text}");
        }
    }

    #[test]
    fn deep_brackets_end() {
        for text in ["(".repeat(100_000), "!".repeat(100_000), format!("{}A{}", "(".repeat(5_000), ")".repeat(5_000))] {
            let _ = holds(&text, &definitions());
        }
    }
}
