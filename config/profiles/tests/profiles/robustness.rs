//! Whatever a file contains, reading it ends with a profile or an error of one line.

use ferrostep_profiles::{builtin_names, builtin_text, parse};
use proptest::prelude::*;

/// Parses, and looks at the error as a program would that shows it.
fn check(text: &str) {
    if let Err(error) = parse(text, "test.toml") {
        let shown = error.to_string();
        assert!(shown.starts_with("test.toml:"), "{shown}");
        assert!(!shown.contains('\n'), "{shown}");
        let lines = 1 + text.matches('\n').count();
        assert!(error.line().is_none_or(|line| (1..=lines).contains(&line)), "{shown}");
    }
}

proptest! {
    #[test]
    fn arbitrary_text_is_answered(text in any::<String>()) {
        check(&text);
    }

    #[test]
    fn arbitrary_toml_like_text_is_answered(text in "([a-z_]{1,6}[.= ]|[\\[\\]{}\"',\n]|[0-9.e+-]{1,9}|nan|inf|true){0,60}") {
        check(&text);
    }

    #[test]
    fn a_damaged_profile_is_answered(
        name in proptest::sample::select(builtin_names().collect::<Vec<_>>()),
        from in any::<proptest::sample::Index>(),
        length in 0_usize..40,
        replacement in "[ -~\n\u{e9}]{0,6}",
    ) {
        let text = builtin_text(name).unwrap();
        // The built-in texts are ASCII, so that every index is a character's.
        let from = from.index(text.len());
        let until = (from + length).min(text.len());
        check(&format!("{}{replacement}{}", &text[..from], &text[until..]));
    }

    #[test]
    fn any_number_in_the_place_of_any_other_is_answered(
        name in proptest::sample::select(builtin_names().collect::<Vec<_>>()),
        place in any::<proptest::sample::Index>(),
        number in any::<f64>(),
    ) {
        let text = builtin_text(name).unwrap();
        let starts: Vec<_> = text.match_indices("= ").map(|(index, _)| index + 2).collect();
        let start = starts[place.index(starts.len())];
        let rest = text[start..].trim_start_matches(|c: char| c.is_ascii_digit() || c == '.');
        check(&format!("{}{number:?}{rest}", &text[..start]));
    }
}

#[test]
fn deep_nesting_is_answered() {
    for depth in [10, 100, 10_000] {
        check(&format!("name = {}{}", "[".repeat(depth), "]".repeat(depth)));
        check(&format!("name = {}1{}", "{a=".repeat(depth), "}".repeat(depth)));
        check(&format!("{}a = 1", "a.".repeat(depth)));
        check(&format!("[{}a]", "a.".repeat(depth)));
    }
}
