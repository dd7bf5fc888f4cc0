//! Valid programs, in all modes.
//!
//! Lengths are chosen in millimetres and written in the unit in force, so that no program leaves
//! the reach of the planner (5 m, 1 m of filament a move); everything else is random.

use std::f64::consts::TAU;
use std::fmt::Write;

use proptest::prelude::*;

/// A program and the machine it is for.
#[derive(Clone, Debug)]
pub struct Program {
    /// The G-code.
    pub text: String,
    /// Name of the profile.
    pub machine: &'static str,
    /// True if G2 or G3 is among its lines.
    pub has_arcs: bool,
}

/// An axis' letter and a length, mm.
type Word = (char, f64);

#[derive(Clone, Debug)]
enum Line {
    Move {
        words: Vec<Word>,
        feed: Option<f64>,
    },
    Arc {
        clockwise: bool,
        radius: f64,
        from: f64,
        sweep: f64,
        rise: f64,
        filament: f64,
        by_radius: bool,
    },
    Circle {
        clockwise: bool,
        i: f64,
        j: f64,
        rise: f64,
    },
    SetPosition(Vec<Word>),
    Limits(u32, Vec<Word>),
    RetractSettings {
        length: f64,
        feed: f64,
        lift: f64,
        extra: f64,
    },
    /// Written unchanged.
    Plain(String),
    Relative(bool),
    RelativeExtruder(bool),
    Inches(bool),
}

fn words(axes: &'static str, range: std::ops::Range<f64>) -> impl Strategy<Value = Vec<Word>> {
    let letters: Vec<char> = axes.chars().collect();
    let count = letters.len();
    (prop::sample::subsequence(letters, 1..=count), prop::collection::vec(range, count))
        .prop_map(|(letters, values)| letters.into_iter().zip(values).collect())
}

/// Lengths as in sliced files: most are short.
fn moves() -> impl Strategy<Value = Line> {
    let feed = prop::option::weighted(0.3, 60.0f64..20_000.0);
    let place = prop_oneof![
        4 => words("XYE", -2.0..4.0),
        2 => words("XYZE", -0.5..1.5),
        1 => words("XY", -40.0..80.0),
        1 => words("XYZ", 0.0..5.0),
        1 => words("E", -3.0..3.0),
    ];
    (place, feed).prop_map(|(words, feed)| Line::Move { words, feed })
}

fn arcs() -> impl Strategy<Value = Line> {
    let arc = (any::<bool>(), 0.3f64..30.0, 0.0..TAU, 0.1f64..6.0, -0.5f64..0.5, -0.5f64..1.0, any::<bool>()).prop_map(
        |(clockwise, radius, from, sweep, rise, filament, by_radius)| Line::Arc {
            clockwise,
            radius,
            from,
            sweep,
            rise,
            filament,
            by_radius,
        },
    );
    let circle = (any::<bool>(), 0.5f64..10.0, -10.0f64..10.0, 0.0f64..0.5)
        .prop_map(|(clockwise, i, j, rise)| Line::Circle { clockwise, i, j, rise });
    prop_oneof![3 => arc, 1 => circle]
}

fn settings() -> impl Strategy<Value = Line> {
    prop_oneof![
        any::<bool>().prop_map(Line::Relative),
        any::<bool>().prop_map(Line::RelativeExtruder),
        any::<bool>().prop_map(Line::Inches),
        words("XYZE", -3.0..3.0).prop_map(Line::SetPosition),
        (10u32..300).prop_map(|percent| Line::Plain(format!("M220 S{percent}"))),
        (50u32..200).prop_map(|percent| Line::Plain(format!("M221 S{percent}"))),
        words("XYZE", 80.0..9_000.0).prop_map(|words| Line::Limits(201, words)),
        words("XYZE", 5.0..400.0).prop_map(|words| Line::Limits(203, words)),
        words("PRT", 80.0..9_000.0).prop_map(|words| Line::Limits(204, words)),
        words("S", 80.0..9_000.0).prop_map(|words| Line::Limits(204, words)),
        words("J", 0.011..0.29).prop_map(|words| Line::Limits(205, words)),
        (0.1f64..4.0, 300.0f64..4_000.0, 0.0f64..1.0, -0.05f64..0.2)
            .prop_map(|(length, feed, lift, extra)| Line::RetractSettings { length, feed, lift, extra }),
    ]
}

fn others() -> impl Strategy<Value = Line> {
    prop::sample::select(vec![
        "G10",
        "G11",
        "M400",
        "G4 P20",
        "M106 S128",
        "M107",
        "M73 P3",
        "M114",
        "; a comment",
        "",
        "M205 X8 Y8",
        "G28 X",
        "G28 Y",
        "T0",
        "M117 printing",
    ])
    .prop_map(|text| Line::Plain(text.to_owned()))
}

/// A program of up to 80 lines.
pub fn program() -> impl Strategy<Value = Program> {
    let straight = prop_oneof![12 => moves(), 2 => settings(), 1 => others()];
    let any_line = prop_oneof![12 => moves(), 3 => arcs(), 2 => settings(), 1 => others()];
    let machine = prop::sample::select(vec!["cartesian", "corexy", "prusa-mini"]);
    let lines = prop_oneof![
        2 => prop::collection::vec(straight, 1..80).prop_map(|lines| (lines, false)),
        1 => prop::collection::vec(any_line, 1..60).prop_map(|lines| (lines, true)),
    ];
    (machine, lines, prop::bool::weighted(0.7)).prop_map(|(machine, (lines, has_arcs), homed)| {
        let mut writer = Writer::default();
        writer.line("M302 P1");
        if homed {
            writer.line("G28");
            // Away from the corner: some moves should meet the soft limits, not all.
            writer.line("G1 X100 Y100 Z2 F9000");
        }
        lines.iter().for_each(|line| writer.write(line));
        Program { text: writer.text, machine, has_arcs }
    })
}

/// Writes lines in the modes that are in force.
#[derive(Default)]
struct Writer {
    text: String,
    relative: bool,
    relative_extruder: bool,
    inches: bool,
}

impl Writer {
    fn line(&mut self, text: &str) {
        self.text.push_str(text);
        self.text.push('\n');
    }

    /// A length in the unit in force, with the digits that slicers write.
    fn length(&self, millimetres: f64) -> String {
        if self.inches { format!("{:.5}", millimetres / 25.4) } else { format!("{millimetres:.4}") }
    }

    fn words(&self, words: &[Word]) -> String {
        let mut text = String::new();
        for (letter, value) in words {
            write!(text, " {letter}{}", self.length(*value)).unwrap();
        }
        text
    }

    fn write(&mut self, line: &Line) {
        match line {
            Line::Move { words, feed } => {
                let feed = feed.map_or(String::new(), |feed| format!(" F{}", self.length(feed)));
                let text = format!("G1{}{feed}", self.words(words));
                self.line(&text);
            }
            Line::Arc { clockwise, radius, from, sweep, rise, filament, by_radius } => {
                let to = if *clockwise { from - sweep } else { from + sweep };
                let centre = [-radius * from.cos(), -radius * from.sin()];
                let end = [centre[0] + radius * to.cos(), centre[1] + radius * to.sin()];
                let circle = if *by_radius {
                    // A little more, so that rounding never leaves the ends out of reach.
                    let radius = radius * 1.01;
                    self.words(&[('R', if *sweep > TAU / 2.0 { -radius } else { radius })])
                } else {
                    self.words(&[('I', centre[0]), ('J', centre[1])])
                };
                let target = self.words(&[('X', end[0]), ('Y', end[1]), ('Z', *rise), ('E', *filament)]);
                let command = if *clockwise { "G2" } else { "G3" };
                // Relative, since the end must lie on the circle.
                self.line("G91");
                self.line(&format!("{command}{target}{circle}"));
                self.restore_modes();
            }
            Line::Circle { clockwise, i, j, rise } => {
                let command = if *clockwise { "G2" } else { "G3" };
                let text = format!("{command}{}", self.words(&[('Z', *rise), ('I', *i), ('J', *j)]));
                self.line("G91");
                self.line(&text);
                self.restore_modes();
            }
            Line::SetPosition(words) => {
                let text = format!("G92{}", self.words(words));
                self.line(&text);
            }
            Line::Limits(code, words) => {
                let text = format!("M{code}{}", self.words(words));
                self.line(&text);
            }
            Line::RetractSettings { length, feed, lift, extra } => {
                let retract = self.words(&[('S', *length), ('F', *feed), ('Z', *lift)]);
                let recover = self.words(&[('S', *extra), ('F', *feed)]);
                // Firmwares differ in whether a change after G10 affects G11.
                self.line("G11");
                self.line(&format!("M207{retract}"));
                self.line(&format!("M208{recover}"));
            }
            Line::Plain(text) => self.line(text),
            Line::Relative(relative) => {
                self.relative = *relative;
                self.relative_extruder = *relative;
                self.line(if *relative { "G91" } else { "G90" });
            }
            Line::RelativeExtruder(relative) => {
                self.relative_extruder = *relative;
                self.line(if *relative { "M83" } else { "M82" });
            }
            Line::Inches(inches) => {
                self.inches = *inches;
                self.line(if *inches { "G20" } else { "G21" });
            }
        }
    }

    fn restore_modes(&mut self) {
        self.line(if self.relative { "G91" } else { "G90" });
        self.line(if self.relative_extruder { "M83" } else { "M82" });
    }
}
