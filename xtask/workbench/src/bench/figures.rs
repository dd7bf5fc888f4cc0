//! Counts as the book shows them.

use serde_json::Value;

/// A number by its key with dots.
pub fn number(figures: &Value, key: &str) -> Option<f64> {
    key.split('.').try_fold(figures, |value, key| value.get(key))?.as_f64()
}

/// Text of a number in groups of three digits, with one decimal below 1000 unless it is whole; a
/// dash for `None`.
pub fn shown(count: Option<f64>) -> String {
    let Some(count) = count else { return "-".to_owned() };
    if count < 1000.0 && count.fract() != 0.0 {
        return format!("{count:.1}");
    }
    let digits = format!("{count:.0}");
    let mut grouped = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index) % 3 == 0 {
            grouped.push(' ');
        }
        grouped.push(digit);
    }
    grouped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_grouped_and_what_is_missing_is_a_dash() {
        assert_eq!(shown(Some(1_234_567.0)), "1 234 567");
        assert_eq!(shown(Some(120.62)), "120.6");
        assert_eq!(shown(Some(33.0)), "33");
        assert_eq!(shown(Some(48_530.4)), "48 530");
        assert_eq!(shown(None), "-");
    }
}
