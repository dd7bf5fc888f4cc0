//! Random commands, printed as programs print them, read back as the same commands.

mod commands;
mod printing;

use proptest::prelude::*;

use self::commands::{machine, motion, settings};
use self::printing::{print, style};
use crate::{Command, LineReader, parse};

proptest! {
    #[test]
    fn a_printed_program_reads_back(
        program in proptest::collection::vec((prop_oneof![motion(), settings(), machine()], style()), 1..30),
        numbered: bool,
    ) {
        let mut text = String::new();
        for (index, (command, style)) in program.iter().enumerate() {
            let line = print(*command, *style);
            if numbered {
                let line = format!("N{index} {line}");
                let checksum = line.bytes().fold(0, |sum, byte| sum ^ byte);
                text += &format!("{line}*{checksum}\n");
            } else {
                text += &format!("{line}\n");
            }
        }
        let mut reader = LineReader::new();
        let mut rest = text.as_bytes();
        for (index, (command, _)) in program.iter().enumerate() {
            let (consumed, line) = reader.feed(rest);
            rest = &rest[consumed..];
            let Some(Ok(line)) = line else { panic!("{line:?} in {text}") };
            prop_assert_eq!(line.line_number, index as u32 + 1);
            prop_assert_eq!(line.number, numbered.then_some(index as i64));
            if numbered {
                prop_assert_eq!(line.checksum, crate::Checksum::Right);
            }
            prop_assert_eq!(parse(line.text), Ok(*command), "{}", line.text);
        }
        prop_assert!(rest.is_empty());
    }

    #[test]
    fn any_text_is_answered(text in "\\PC{0,60}", words in "[ GMTXYZEFIJPRSN0-9.*(;-]{0,60}") {
        let in_quotes = format!("M593 P{text}");
        let named = format!("SET_INPUT_SHAPER SHAPER_TYPE_X={text}");
        for text in [&text, &words, &format!("G1 {words}"), &format!("M204{text}"), &in_quotes, &named] {
            match parse(text) {
                Ok(Command::Unknown(unknown)) => prop_assert!(text.contains(unknown)),
                Ok(_) => {}
                Err(error) => prop_assert!(!error.to_string().is_empty()),
            }
        }
    }
}
