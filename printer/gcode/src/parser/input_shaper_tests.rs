//! M593 and SET_INPUT_SHAPER.

use super::tests::{reads, reads_with, refused, some};
use crate::{Command, ShaperWords};

const NONE: ShaperWords<'_> = ShaperWords { kind: None, frequency: None, damping: None };

fn shaper<'a>(kind: &'a str, frequency: &str, damping: &str) -> ShaperWords<'a> {
    let given = |text: &str| if text.is_empty() { None } else { some(text) };
    ShaperWords {
        kind: Some(kind).filter(|kind| !kind.is_empty()),
        frequency: given(frequency),
        damping: given(damping),
    }
}

fn m593<'a>(x: ShaperWords<'a>, y: ShaperWords<'a>) -> Command<'a> {
    Command::InputShaper { axes: [x, y], usual: "zv" }
}

fn named<'a>(x: ShaperWords<'a>, y: ShaperWords<'a>) -> Command<'a> {
    Command::InputShaper { axes: [x, y], usual: "mzv" }
}

#[test]
fn m593_as_marlin_has_it() {
    let both = shaper("", "40.5", "0.15");
    reads("M593 F40.5 D0.15", m593(both, both));
    reads("m593d.15f40.5", m593(both, both));
    reads("M593 X Y F40.5 D0.15", m593(both, both));
    reads("M593 X F40.5 D0.15", m593(both, NONE));
    reads("M593 Y1 F0", m593(NONE, shaper("", "0", "")));
    reads_with("M593 X Z F40.5 D0.15", m593(both, NONE), "Z has no effect");
    for query in ["M593", "M593 X", "M593 Y (which?)"] {
        reads(query, m593(NONE, NONE));
    }
    reads_with("M593 F", m593(NONE, NONE), "F without a number is ignored");
}

#[test]
fn m593_as_reprapfirmware_has_it() {
    let both = shaper("mzv", "42", "0.1");
    for text in [
        "M593 P\"mzv\" F42 S0.1",
        "M593 F42 S0.1 P\"mzv\"",
        "M593 F42 P \"mzv\"S0.1",
        "M593F42P\"mzv\"S.1;x",
        "M593 (P\"ei2\") F42 p\"mzv\" s0.1 (P)*7",
    ] {
        reads(text, m593(both, both));
    }
    reads("M593 P\"None\"", m593(shaper("None", "", ""), shaper("None", "", "")));
    reads("M593 Y P\"ei3\"", m593(NONE, shaper("ei3", "", "")));
    reads_with("M593 P\"zvd\" L0.2", m593(shaper("zvd", "", ""), shaper("zvd", "", "")), "L has no effect");
    // Words after a second command do not belong to the first.
    let second = "one command a line: the second and everything after it is ignored";
    reads_with("M593 F42 M117 P\"mzv\"", m593(shaper("", "42", ""), shaper("", "42", "")), second);
}

#[test]
fn m593_is_refused_with_what_is_wrong() {
    let kind = "M593: expected P with a kind in quotes, such as P\"mzv\"";
    for (text, expected) in [
        ("M593 P2 F40", kind),
        ("M593 F40 P", kind),
        ("M593 Pmzv F40", kind),
        ("M593 P\"zv\" P1", kind),
        ("M593 P\"mzv F40", "unexpected character '\"', expected a letter and its number"),
        ("M593 Z F40", "M593 of Z and E: not supported, X and Y have filters; name X or Y, or neither for both"),
        ("M593 F40 D0.1 S0.2", "M593 with D and S: not supported, both are the damping; write one of them"),
        ("M593 Fnan", "F: \"nan\" is not a number, expected one like 12.5 or -.8"),
    ] {
        assert!(refused(text).starts_with(expected), "{text}: {}", refused(text));
    }
}

#[test]
fn set_input_shaper_as_klipper_has_it() {
    reads("SET_INPUT_SHAPER", named(NONE, NONE));
    reads("SET_INPUT_SHAPER SHAPER_FREQ_X=52.4", named(shaper("", "52.4", ""), NONE));
    reads("set_input_shaper shaper_type=EI", named(shaper("EI", "", ""), shaper("EI", "", "")));
    reads(
        "SET_INPUT_SHAPER SHAPER_TYPE_X=2hump_ei  SHAPER_FREQ_X=60 DAMPING_RATIO_X=0.05 SHAPER_TYPE_Y=mzv\tSHAPER_FREQ_Y=0 \
         DAMPING_RATIO_Y=.1",
        named(shaper("2hump_ei", "60", "0.05"), shaper("mzv", "0", "0.1")),
    );
}

#[test]
fn set_input_shaper_is_refused_with_what_is_wrong() {
    let expected = "SET_INPUT_SHAPER: expected SHAPER_TYPE, SHAPER_TYPE_X or SHAPER_TYPE_Y with a kind, SHAPER_FREQ_X, \
                    SHAPER_FREQ_Y, DAMPING_RATIO_X or DAMPING_RATIO_Y with a number";
    for text in [
        "SET_INPUT_SHAPER SHAPER_FREQ_X",
        "SET_INPUT_SHAPER SHAPER_FREQ_X=",
        "SET_INPUT_SHAPER SHAPER_FREQ_X=fast",
        "SET_INPUT_SHAPER SHAPER_FREQ_X=40 DAMPING_RATIO_Y=nan",
    ] {
        assert_eq!(refused(text), expected, "{text}");
    }
    for (text, word) in [("SET_INPUT_SHAPER SHAPER_FREQ=40", "SHAPER_FREQ"), ("SET_INPUT_SHAPER X40", "X40")] {
        assert!(refused(text).starts_with(&format!("SET_INPUT_SHAPER: unknown word \"{word}\", expected ")), "{text}");
    }
    for text in ["SET_INPUT_SHAPER SHAPER_FREQ_Z=40", "SET_INPUT_SHAPER SHAPER_FREQ_X=40 shaper_type_z=mzv"] {
        assert!(
            refused(text).starts_with("SET_INPUT_SHAPER of Z: not supported, only X and Y have input shapers"),
            "{text}"
        );
    }
    let two = refused("SET_INPUT_SHAPER SHAPER_TYPE=mzv SHAPER_TYPE_Y=ei");
    assert!(two.starts_with("SHAPER_TYPE with the type of an axis: not supported"), "{two}");
}
