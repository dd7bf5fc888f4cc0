//! The rest of a job that has stopped: where its lines ask the nozzle to go.
//!
//! Lines are read by their words alone. No machine executes them, so nothing is clamped, slowed or
//! refused.

use crate::node::{Kind, Node, UNMARKED};
use crate::path::motion;
use crate::source::Marked;

/// Largest distance of an arc from its chords, mm.
const CHORD_MM: f64 = 0.01;
/// Maximum number of chords of an arc: of a radius of 100 m, whose chords are farther from it.
const MAX_CHORDS: f64 = 2048.0;
/// Coordinates beyond this are damage, mm.
const MAX_MM: f64 = 100_000.0;
const INCH_MM: f64 = 25.4;

/// State in which the rest of a job begins.
#[derive(Clone, Copy, Debug)]
pub struct RestState {
    /// Place of the nozzle on the page, mm.
    pub position_mm: [f64; 3],
    /// X, Y, Z and E as the G-code sees them, mm.
    pub logical_mm: [f64; 4],
    /// X, Y and Z are relative (G91).
    pub is_relative: bool,
    /// E is relative (M83).
    pub is_extruder_relative: bool,
    /// Lengths are in inches (G20).
    pub is_inches: bool,
    /// The selected tool.
    pub tool: u8,
}

/// Follows lines that are not executed.
#[derive(Debug)]
pub struct Rest {
    state: RestState,
    filament_mm2: f64,
    /// Code of the last motion, for lines of coordinates alone.
    motion: Option<u32>,
}

/// The words of a line: the last value of each letter.
struct Words([Option<f64>; 26]);

impl Words {
    fn of(text: &str) -> Self {
        let mut words = [None; 26];
        let bytes = text.as_bytes();
        let mut at = 0;
        while let Some(&letter) = bytes.get(at) {
            at += 1;
            match letter {
                b';' => break,
                b'(' => {
                    at += bytes.iter().skip(at).take_while(|&&byte| byte != b')').count() + 1;
                    continue;
                }
                _ => {}
            }
            let after = bytes.get(at..).unwrap_or_default();
            let blanks = after.iter().take_while(|byte| matches!(byte, b' ' | b'\t')).count();
            let digits = after.iter().skip(blanks).take_while(|byte| matches!(byte, b'0'..=b'9' | b'.' | b'+' | b'-'));
            let number = text.get(at + blanks..at + blanks + digits.count()).unwrap_or_default();
            if let Some(word) = words.get_mut(usize::from(letter.to_ascii_uppercase().wrapping_sub(b'A'))) {
                // A letter without a number names an axis (`G28 X`), and moves none.
                *word = Some(number.parse().unwrap_or(f64::NAN));
                at += if number.is_empty() { 0 } else { blanks + number.len() };
            }
        }
        Self(words)
    }

    fn get(&self, letter: u8) -> Option<f64> {
        self.0.get(usize::from(letter.wrapping_sub(b'A'))).copied().flatten()
    }

    /// The values of X, Y, Z and E.
    fn axes(&self) -> [Option<f64>; 4] {
        (*b"XYZE").map(|letter| self.get(letter))
    }
}

impl Rest {
    /// Begins where a job has stopped.
    pub const fn new(state: RestState, filament_mm2: f64) -> Self {
        Self { state, filament_mm2, motion: None }
    }

    /// Follows a line, and passes on the nodes at the ends of the parts that it asks for.
    pub fn follow(&mut self, line: u32, text: &str, marked: Marked, mut keep: impl FnMut(Node)) {
        // Named commands (`EXCLUDE_OBJECT`) have no words.
        let is_named = text.bytes().take(2).all(|byte| byte.is_ascii_alphabetic() || byte == b'_');
        if is_named && text.len() > 1 {
            return;
        }
        let words = Words::of(text);
        let whole = |letter| words.get(letter).filter(|code| (0.0..1000.0).contains(code)).map(|code| code as u32);
        let state = &mut self.state;
        match (text.as_bytes().first().map(u8::to_ascii_uppercase), whole(b'G'), whole(b'M')) {
            (Some(b'G'), Some(code @ 0..=3), _) => self.motion = Some(code),
            (Some(b'G'), Some(20 | 21), _) => state.is_inches = whole(b'G') == Some(20),
            (Some(b'G'), Some(28), _) => return self.home(line, &words, marked, &mut keep),
            (Some(b'G'), Some(90 | 91), _) => {
                state.is_relative = whole(b'G') == Some(91);
                state.is_extruder_relative = state.is_relative;
            }
            (Some(b'G'), Some(92), _) => return self.redefine(&words),
            (Some(b'M'), _, Some(82 | 83)) => state.is_extruder_relative = whole(b'M') == Some(83),
            (Some(b'T'), ..) => state.tool = whole(b'T').map_or(state.tool, |tool| tool.min(255) as u8),
            // Coordinates alone repeat the last motion.
            (Some(b'X' | b'Y' | b'Z'), ..) => {}
            _ => return,
        }
        let is_motion = matches!(text.as_bytes().first(), Some(b'G' | b'g' | b'X' | b'x' | b'Y' | b'y' | b'Z' | b'z'))
            && whole(b'G').is_none_or(|code| code <= 3);
        if let Some(code) = self.motion.filter(|_| is_motion) {
            self.go(code, line, &words, marked, &mut keep);
        }
    }

    fn unit_mm(&self) -> f64 {
        if self.state.is_inches { INCH_MM } else { 1.0 }
    }

    /// G92: other coordinates for the same place.
    fn redefine(&mut self, words: &Words) {
        let unit_mm = self.unit_mm();
        let axes = words.axes();
        let is_all = axes.iter().all(Option::is_none);
        for (logical_mm, value) in self.state.logical_mm.iter_mut().zip(axes) {
            *logical_mm = value
                .filter(|value| value.is_finite())
                .map_or(if is_all { 0.0 } else { *logical_mm }, |value| value * unit_mm);
        }
    }

    /// G28: the axes are at zero, and their coordinates are the machine's.
    fn home(&mut self, line: u32, words: &Words, marked: Marked, keep: &mut impl FnMut(Node)) {
        let axes = words.axes();
        let is_all = axes.iter().take(3).all(Option::is_none);
        for (axis, value) in axes.iter().take(3).enumerate() {
            if is_all || value.is_some() {
                (self.state.position_mm[axis], self.state.logical_mm[axis]) = (0.0, 0.0);
            }
        }
        keep(self.node(line, marked, (Kind::Homing, 0.0)));
    }

    /// G0 to G3.
    fn go(&mut self, code: u32, line: u32, words: &Words, marked: Marked, keep: &mut impl FnMut(Node)) {
        let (unit_mm, state) = (self.unit_mm(), self.state);
        let is_relative = [state.is_relative, state.is_relative, state.is_relative, state.is_extruder_relative];
        let mut by_mm = [0.0; 4];
        for (axis, value) in words.axes().into_iter().enumerate() {
            let Some(value) = value else { continue };
            by_mm[axis] = value * unit_mm - if is_relative[axis] { 0.0 } else { state.logical_mm[axis] };
        }
        let from_mm = state.position_mm;
        let target_mm: [f64; 3] = std::array::from_fn(|axis| from_mm[axis] + by_mm[axis]);
        if !target_mm.iter().chain(&by_mm).all(|mm| mm.abs() <= MAX_MM) {
            return;
        }
        for (logical_mm, mm) in self.state.logical_mm.iter_mut().zip(by_mm) {
            *logical_mm += mm;
        }
        let arc = if code >= 2 { Arc::new(from_mm, target_mm, code == 2, words, unit_mm) } else { None };
        let rise_mm = by_mm[2];
        let path_mm = arc.as_ref().map_or_else(|| by_mm[0].hypot(by_mm[1]), Arc::length_mm).hypot(rise_mm);
        if path_mm <= 0.0 {
            return;
        }
        let (kind, bead) = motion(path_mm, by_mm[3], self.filament_mm2);
        let chords = arc.as_ref().map_or(1, Arc::chords);
        for chord in 1..chords {
            let share = f64::from(chord) / f64::from(chords);
            if let Some([x, y]) = arc.as_ref().map(|arc| arc.at(share)) {
                self.state.position_mm = [x, y, from_mm[2] + rise_mm * share];
                keep(self.node(line, marked, (kind, bead)));
            }
        }
        self.state.position_mm = target_mm;
        if kind.moves() {
            keep(self.node(line, marked, (kind, bead)));
        }
    }

    fn node(&self, line: u32, marked: Marked, (kind, bead): (Kind, f64)) -> Node {
        Node {
            position_mm: self.state.position_mm.map(|mm| mm as f32),
            bead: bead as f32,
            height_mm: marked.height_mm,
            width_mm: marked.width_mm,
            line,
            layer: marked.layer.unwrap_or(UNMARKED),
            kind,
            feature: marked.feature,
            tool: self.state.tool,
            is_rest: true,
            ..Node::default()
        }
    }
}

/// An arc in the plane of X and Y.
struct Arc {
    centre_mm: [f64; 2],
    radius_mm: f64,
    begin: f64,
    /// Angle that it turns; negative: clockwise.
    turn: f64,
}

impl Arc {
    /// The arc by I and J, or by R; `None` if the words make none.
    fn new(from_mm: [f64; 3], to_mm: [f64; 3], is_clockwise: bool, words: &Words, unit_mm: f64) -> Option<Self> {
        let [x, y, _] = from_mm;
        let chord = [to_mm[0] - x, to_mm[1] - y];
        let to_centre = match (words.get(b'I'), words.get(b'J'), words.get(b'R')) {
            (None, None, None) => return None,
            (None, None, Some(radius)) => {
                let (radius_mm, length_mm) = (radius * unit_mm, chord[0].hypot(chord[1]));
                if length_mm <= 0.0 {
                    return None;
                }
                // The shorter of both arcs; with a negative radius the longer one.
                let off_mm = (radius_mm * radius_mm - 0.25 * length_mm * length_mm).max(0.0).sqrt();
                let side = if is_clockwise == (radius_mm < 0.0) { 1.0 } else { -1.0 } * off_mm / length_mm;
                [0.5 * chord[0] - side * chord[1], 0.5 * chord[1] + side * chord[0]]
            }
            (i, j, _) => [i, j].map(|value| value.unwrap_or(0.0) * unit_mm),
        };
        let radius_mm = to_centre[0].hypot(to_centre[1]);
        if !(radius_mm > 0.0 && radius_mm <= MAX_MM) {
            return None;
        }
        let begin = (-to_centre[1]).atan2(-to_centre[0]);
        let end = (chord[1] - to_centre[1]).atan2(chord[0] - to_centre[0]);
        let left = (end - begin).rem_euclid(std::f64::consts::TAU);
        // An arc to its own beginning is a circle.
        let left = if chord[0].hypot(chord[1]) < 1e-6 { 0.0 } else { left };
        let turn = match (is_clockwise, left > 0.0) {
            (true, _) => left - std::f64::consts::TAU,
            (false, true) => left,
            (false, false) => std::f64::consts::TAU,
        };
        Some(Self { centre_mm: [x + to_centre[0], y + to_centre[1]], radius_mm, begin, turn })
    }

    fn length_mm(&self) -> f64 {
        self.radius_mm * self.turn.abs()
    }

    fn chords(&self) -> u32 {
        // The middle of a chord is off the arc by r (1 - cos(angle / 2)), about r angle^2 / 8.
        let angle = (8.0 * CHORD_MM / self.radius_mm).sqrt().min(0.5);
        (self.turn.abs() / angle).ceil().clamp(1.0, MAX_CHORDS) as u32
    }

    fn at(&self, share: f64) -> [f64; 2] {
        let (sin, cos) = (self.begin + self.turn * share).sin_cos();
        [self.centre_mm[0] + self.radius_mm * cos, self.centre_mm[1] + self.radius_mm * sin]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STATE: RestState = RestState {
        position_mm: [10.0, 20.0, 0.2],
        logical_mm: [0.0, 20.0, 0.2, 5.0],
        is_relative: false,
        is_extruder_relative: false,
        is_inches: false,
        tool: 0,
    };

    fn nodes(state: RestState, text: &str) -> Vec<Node> {
        let mut rest = Rest::new(state, 2.0);
        let mut nodes = Vec::new();
        for (line, text) in (1..).zip(text.lines()) {
            rest.follow(line, text, Marked::default(), |node| nodes.push(node));
        }
        nodes
    }

    fn places(text: &str) -> Vec<(u32, Kind, [f32; 3])> {
        nodes(STATE, text).iter().map(|node| (node.line, node.kind, node.position_mm)).collect()
    }

    #[test]
    fn words_set_modes_and_ask_for_places() {
        let text =
            "G1 X5 E6\nG92 X0 E0\nG91\nG0Y-1.5 (to Z9) ; Z8\nM82\ng1 z.2 e1\nG90\nM83\nG1 X1 E0.5\nX2\nG20\nG0 X1\n";
        let expected = [
            (1, Kind::Print, [15.0, 20.0, 0.2]),
            (4, Kind::Travel, [15.0, 18.5, 0.2]),
            (6, Kind::Print, [15.0, 18.5, 0.4]),
            (9, Kind::Print, [16.0, 18.5, 0.4]),
            (10, Kind::Travel, [17.0, 18.5, 0.4]),
            (12, Kind::Travel, [40.4, 18.5, 0.4]),
        ];
        assert_eq!(places(text), expected);
    }

    #[test]
    fn a_part_that_prints_has_its_bead() {
        let found = nodes(STATE, "M83\nG1 X10 E0.5\nG1 E-1\nG1 X20 E-1\nT1\nG0 X30");
        let told: Vec<_> = found.iter().map(|node| (node.kind, node.bead, node.tool)).collect();
        assert_eq!(told, [(Kind::Print, 0.1, 0), (Kind::Travel, -0.2, 0), (Kind::Travel, 0.0, 1)]);
        assert!(found.iter().all(|node| node.is_rest && node.speed_mm_per_s == 0.0));
    }

    #[test]
    fn homing_gives_the_machines_coordinates() {
        let text = "G28 X\nG1 X7\nG28\nG1 X1 Y1 Z1\n";
        let expected = [
            (1, Kind::Homing, [0.0, 20.0, 0.2]),
            (2, Kind::Travel, [7.0, 20.0, 0.2]),
            (3, Kind::Homing, [0.0; 3]),
            (4, Kind::Travel, [1.0; 3]),
        ];
        assert_eq!(places(text), expected);
    }

    #[test]
    fn arcs_turn_by_their_centre_and_by_their_radius() {
        for (text, middle) in [
            ("G3 X10 Y20 I5 J0", [5.0, 15.0]),
            ("G2 X10 Y20 I5 J0", [5.0, 25.0]),
            ("G3 X10 Y20 R5", [5.0, 15.0]),
            ("G2 X0 Y20 I5", [10.0, 20.0]),
            ("G3 X0 Y20 I5", [10.0, 20.0]),
            ("G2 X5 Y25 R5", [1.464, 23.536]),
            ("G2 X5 Y25 R-5", [-3.536, 28.536]),
        ] {
            let state = RestState { position_mm: [0.0, 20.0, 0.0], logical_mm: [0.0, 20.0, 0.0, 0.0], ..STATE };
            let found = nodes(state, text);
            let [x, y, _] = found[found.len() / 2 - 1].position_mm;
            let off = (x - middle[0]).hypot(y - middle[1]);
            assert!(off < 0.4, "{text}: [{x}, {y}], expected {middle:?}");
        }
        assert!(nodes(STATE, "G2 X1e300 I99999999\nG2 X1\nG3 X5 Y5").len() < 10);
    }

    #[test]
    fn other_lines_and_damage_ask_for_nothing() {
        for text in [
            "",
            ";",
            "G1",
            "G1 E5",
            "G1 X Y",
            "G1 X1-2",
            "G92 X",
            "M117 X5",
            "EXCLUDE_OBJECT_START NAME=X5",
            "G1 X99999999999",
            "G4 P5",
            "(",
            "X5",
            "G29 X5 Y5",
        ] {
            assert_eq!(places(text), [], "{text}");
        }
        // A coordinate of five metres is one.
        assert_eq!(places("G0 X5000"), [(1, Kind::Travel, [5010.0, 20.0, 0.2])]);
    }
}
