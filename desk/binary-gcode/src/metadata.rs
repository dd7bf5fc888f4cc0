//! Reads the entries of blocks of metadata.

/// The entries of a block of metadata, in its order: a key and its value. Lines without
/// `=` are left out.
///
/// ```
/// let text = "printer_model=MINI\nestimated printing time (normal mode)=21m 27s\n";
/// let mut entries = ferrostep_binary_gcode::entries(text);
/// assert_eq!(entries.next(), Some(("printer_model", "MINI")));
/// assert_eq!(entries.next(), Some(("estimated printing time (normal mode)", "21m 27s")));
/// ```
pub fn entries(text: &str) -> impl Iterator<Item = (&str, &str)> {
    text.lines().filter_map(|line| line.split_once('='))
}

/// The seconds of a duration as PrusaSlicer writes it, `1d 2h 21m 27s`; `None` if it is not one.
pub fn seconds(duration: &str) -> Option<u32> {
    let mut sum = None;
    for word in duration.split_whitespace() {
        let unit = word.char_indices().next_back()?;
        let unit_s: u32 = match unit.1 {
            'd' => 86_400,
            'h' => 3600,
            'm' => 60,
            's' => 1,
            _ => return None,
        };
        let count: u32 = word.get(..unit.0)?.parse().ok()?;
        sum = Some(count.checked_mul(unit_s)?.checked_add(sum.unwrap_or(0))?);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations() {
        for (text, expected) in [
            ("21m 27s", Some(1287)),
            ("1d 2h 3m 4s", Some(93_784)),
            ("59s", Some(59)),
            ("2h", Some(7200)),
            ("", None),
            ("27", None),
            ("m", None),
            ("2h soon", None),
            ("99999d 1s", None),
        ] {
            assert_eq!(seconds(text), expected, "{text:?}");
        }
    }
}
