//! Klipper's commands for which the printer has a G-code with another name.

use super::words::Words;

/// Writes the lines of a command from its words.
type Translate = fn(Words<'_>) -> Result<Vec<String>, String>;

/// The commands, each with what writes its lines.
const TRANSLATED: [(&str, Translate); 2] = [("SET_DISPLAY_TEXT", display_text), ("SET_RETRACTION", retraction)];

/// The lines that a command stands for; `None` for one that has no such lines.
///
/// # Errors
/// A word of it cannot be read.
pub(super) fn lines(name: &str, text: &str) -> Result<Option<Vec<String>>, String> {
    let known = TRANSLATED.iter().find(|(known, _)| *known == name);
    known.map(|(_, translate)| translate(Words::of(text))).transpose()
}

/// SET_DISPLAY_TEXT MSG, which clears the display without its word.
fn display_text(words: Words<'_>) -> Result<Vec<String>, String> {
    Ok(vec![format!("M117 {}", words.value("MSG").unwrap_or_default())])
}

/// SET_RETRACTION: lengths in mm, speeds in mm/s.
fn retraction(words: Words<'_>) -> Result<Vec<String>, String> {
    let mut lines = Vec::new();
    let codes = [("M207", "RETRACT_LENGTH", "RETRACT_SPEED"), ("M208", "UNRETRACT_EXTRA_LENGTH", "UNRETRACT_SPEED")];
    for (code, length, speed) in codes {
        let (length_mm, mm_per_s) = (words.number(length)?, words.number(speed)?);
        let length = length_mm.map(|mm| format!(" S{}", mm.to_f64())).unwrap_or_default();
        let feed = mm_per_s.map(|speed| format!(" F{}", speed.to_f64() * 60.0)).unwrap_or_default();
        if length_mm.is_some() || mm_per_s.is_some() {
            lines.push(format!("{code}{length}{feed}"));
        }
    }
    if lines.is_empty() {
        return Err("SET_RETRACTION: expected RETRACT_LENGTH, RETRACT_SPEED, UNRETRACT_EXTRA_LENGTH or \
                    UNRETRACT_SPEED with a number"
            .to_owned());
    }
    Ok(lines)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn commands_become_g_code() {
        for (text, expected) in [
            ("SET_DISPLAY_TEXT MSG=\"Layer 3\"", &["M117 Layer 3"][..]),
            ("SET_DISPLAY_TEXT", &["M117 "]),
            ("SET_RETRACTION RETRACT_LENGTH=0.8 RETRACT_SPEED=35", &["M207 S0.8 F2100"]),
            (
                "SET_RETRACTION RETRACT_LENGTH=1 UNRETRACT_EXTRA_LENGTH=-0.05 UNRETRACT_SPEED=20",
                &["M207 S1", "M208 S-0.05 F1200"],
            ),
        ] {
            let name = text.split(' ').next().unwrap();
            assert_eq!(lines(name, text).unwrap().unwrap(), expected, "{text}");
        }
        assert_eq!(lines("START_PRINT", "START_PRINT").unwrap(), None);
        let refused = lines("SET_RETRACTION", "SET_RETRACTION RETRACT_LENGTH=far").unwrap_err();
        assert_eq!(refused, "RETRACT_LENGTH=far: expected a number");
        assert!(lines("SET_RETRACTION", "SET_RETRACTION X=1").unwrap_err().contains("RETRACT_SPEED"));
    }
}
