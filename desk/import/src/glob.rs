//! Names of files with `*`, `?` and `[a-z]` in any part, as Python's glob has them.

use std::path::{Path, PathBuf};

/// Maximum number of names that a pattern is compared with.
const MAX_NAMES: usize = 20_000;

/// Returns true if a name contains a wildcard.
pub(crate) fn is_pattern(name: &str) -> bool {
    name.contains(['*', '?', '['])
}

/// The names that match a pattern, relative to a folder as the pattern is, in their order.
pub(crate) fn matching(folder: &Path, pattern: &str) -> Vec<String> {
    let mut found = vec![String::new()];
    for (index, part) in pattern.split('/').enumerate() {
        let mut next = Vec::new();
        for before in &found {
            let with = |name: &str| {
                if index == 0 { name.to_owned() } else { format!("{before}/{name}") }
            };
            if part.is_empty() || !is_pattern(part) {
                next.push(with(part));
                continue;
            }
            let within: PathBuf = if index == 0 {
                folder.to_owned()
            } else if before.is_empty() {
                PathBuf::from("/")
            } else {
                folder.join(before)
            };
            let Ok(entries) = std::fs::read_dir(within) else { continue };
            let names = entries.flatten().take(MAX_NAMES).filter_map(|entry| entry.file_name().into_string().ok());
            let is_meant = |name: &String| (!name.starts_with('.') || part.starts_with('.')) && fits(name, part);
            let mut names: Vec<String> = names.filter(is_meant).collect();
            names.sort();
            next.extend(names.iter().map(|name| with(name)));
        }
        found = next;
    }
    found.retain(|name| folder.join(name).exists());
    found
}

/// Returns true if a name fits a pattern.
fn fits(name: &str, pattern: &str) -> bool {
    let (name, pattern): (Vec<char>, Vec<char>) = (name.chars().collect(), pattern.chars().collect());
    // Place of the last `*`, and the end of the text that it matches.
    let (mut at, mut place, mut star) = (0, 0, None);
    while at < name.len() {
        match pattern.get(place) {
            Some('*') => {
                star = Some((place, at));
                place += 1;
                continue;
            }
            Some(sign) => {
                if let Some(length) =
                    name.get(at).and_then(|char| one(*char, *sign, pattern.get(place..).unwrap_or_default()))
                {
                    at += 1;
                    place += length;
                    continue;
                }
            }
            None => {}
        }
        let Some((of_star, reached)) = star else { return false };
        star = Some((of_star, reached + 1));
        at = reached + 1;
        place = of_star + 1;
    }
    pattern.get(place..).unwrap_or_default().iter().all(|sign| *sign == '*')
}

/// Compares a letter with the sign that a pattern begins with: how long the sign is, if it fits.
fn one(letter: char, sign: char, pattern: &[char]) -> Option<usize> {
    if sign == '?' {
        return Some(1);
    }
    let close = pattern.iter().skip(2).position(|char| *char == ']').map(|at| at + 2);
    let (Some(close), '[') = (close, sign) else { return (letter == sign).then_some(1) };
    let inner = pattern.get(1..close).unwrap_or_default();
    let (is_not, mut inner) = match inner {
        ['!', rest @ ..] => (true, rest),
        _ => (false, inner),
    };
    let mut is_in = false;
    while let [first, rest @ ..] = inner {
        inner = match rest {
            ['-', last, after @ ..] => {
                is_in |= (*first..=*last).contains(&letter);
                after
            }
            _ => {
                is_in |= *first == letter;
                rest
            }
        };
    }
    (is_in != is_not).then_some(close + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_fit_as_in_python() {
        for (name, pattern, expected) in [
            ("a.cfg", "*.cfg", true),
            ("a.cfg.bak", "*.cfg", false),
            ("m1.cfg", "m?.cfg", true),
            ("m12.cfg", "m?.cfg", false),
            ("m1.cfg", "m[0-9].cfg", true),
            ("mx.cfg", "m[!0-9].cfg", true),
            ("ma.cfg", "m[abc].cfg", true),
            ("aXbYc", "a*b*c", true),
            ("a", "*", true),
            ("", "*", true),
            ("a[b", "a[b", true),
        ] {
            assert_eq!(fits(name, pattern), expected, "{name} {pattern}");
        }
    }
}
