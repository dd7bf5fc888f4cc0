//! Whatever a file contains, reading it ends with a board or an error of one line.

use ferrostep_boards::{builtin_names, builtin_text, constants, parse};
use proptest::prelude::*;

/// Parses, and uses the answer as a program would.
fn check(text: &str) {
    match parse(text, "test.toml") {
        Ok(board) => {
            // A board that is right can be built for.
            assert!(constants::rust(&board).contains(&board.name));
            assert!(constants::memories(&board, constants::STACK_KIB).contains("FLASH"));
        }
        Err(error) => {
            let shown = error.to_string();
            assert!(shown.starts_with("test.toml:"), "{shown}");
            assert!(!shown.contains('\n'), "{shown}");
            let lines = 1 + text.matches('\n').count();
            assert!(error.line().is_none_or(|line| (1..=lines).contains(&line)), "{shown}");
        }
    }
}

fn boards() -> impl Strategy<Value = &'static str> {
    proptest::sample::select(builtin_names().collect::<Vec<_>>()).prop_map(|name| builtin_text(name).unwrap())
}

proptest! {
    #[test]
    fn arbitrary_text_is_answered(text in any::<String>()) {
        check(&text);
    }

    #[test]
    fn damaged_text_is_answered(
        text in boards(),
        from in any::<proptest::sample::Index>(),
        length in 0_usize..40,
        replacement in "[ -~\n\u{e9}]{0,6}",
    ) {
        // The built-in texts are ASCII, so that every index is a character's.
        let from = from.index(text.len());
        let until = (from + length).min(text.len());
        check(&format!("{}{replacement}{}", &text[..from], &text[until..]));
    }

    #[test]
    fn any_value_in_the_place_of_any_other_is_answered(
        text in boards(),
        place in any::<proptest::sample::Index>(),
        value in prop_oneof![
            any::<f64>().prop_map(|number| format!("{number:?}")),
            any::<i64>().prop_map(|number| number.to_string()),
            "P[A-K]1?[0-9]".prop_map(|pin| format!("{pin:?}")),
            "[ -~]{0,12}".prop_map(|word| format!("{word:?}")),
        ],
    ) {
        let starts: Vec<_> = text.match_indices(" = ").map(|(index, found)| index + found.len()).collect();
        let start = starts[place.index(starts.len())];
        let rest = text[start..].find('\n').map_or("", |end| &text[start + end..]);
        check(&format!("{}{value}{rest}", &text[..start]));
    }
}
