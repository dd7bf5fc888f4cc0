//! The parts of a print, with their times: layers, features, objects and pauses.
//!
//! Their times are those of the motion, without waits for heat and homing. A pause has the time of
//! the print at which it begins.

use std::collections::VecDeque;
use std::rc::Rc;

use ferrostep_planner::extruder::FILAMENT_UNITS_PER_MM;
use ferrostep_planner::kinematics::UNITS_PER_MM;
use ferrostep_printer::{Ports, Printer};
use ferrostep_show::Mark;
use serde::Serialize;

use crate::command_code::code;
use crate::desk::{LineEnds, seconds};
use crate::job::Onlooker;
use crate::macros::value_of;
use crate::watch::is_pause;

/// Maximum number of parts of a kind that are listed; a broken file could have any number. Further
/// ones are left out.
const MAX_PARTS: usize = 100_000;

/// Commands that home or probe, whose motion is no part of the print's.
const HOMING: [&str; 5] = ["G28", "G29", "G30", "G34", "G38"];

/// A layer.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LayerPart {
    /// Line of the slicer's comment with which it begins.
    pub line: u32,
    /// Height of the nozzle at its first move with filament; missing in a layer without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub z_mm: Option<f64>,
    /// Height above the layer before.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height_mm: Option<f64>,
    /// Duration of its motion.
    pub time_s: f64,
    /// Net filament.
    pub filament_mm: f64,
}

/// A feature, as the slicer names it, in all layers; or an object.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NamedPart {
    /// Name of the feature or object.
    pub name: String,
    /// Duration of its motion.
    pub time_s: f64,
    /// Net filament.
    pub filament_mm: f64,
}

/// A line at which the printer waits for a person.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PausePart {
    /// Line of the command.
    pub line: u32,
    /// Name of the command.
    pub command: String,
    /// Time of the print at which it begins, with homing and heating.
    pub at_s: f64,
}

/// The parts of a print.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct PrintParts {
    /// Layers in their order, by the slicer's comments.
    pub layer_list: Vec<LayerPart>,
    /// Features in the order of their first lines.
    pub features: Vec<NamedPart>,
    /// Objects in the order of their first lines (EXCLUDE_OBJECT_START, M486).
    pub objects: Vec<NamedPart>,
    /// Pauses in their order.
    pub pauses: Vec<PausePart>,
}

/// The parts to which a line belongs, by their indices.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Place {
    layer: Option<usize>,
    feature: Option<usize>,
    object: Option<usize>,
}

/// Follows a job, and adds up what belongs to its parts. `F` is the present time: of the print, s,
/// and of the motion clock, ticks.
pub struct Parts<F> {
    now: F,
    ends: Rc<LineEnds>,
    found: PrintParts,
    /// Marks of comments whose lines have not been reached.
    marks: VecDeque<(u32, Mark)>,
    /// Place of the lines.
    place: Place,
    /// Changes of the place that motion has not reached.
    changes: VecDeque<(u32, Place)>,
    /// Place of the motion.
    moving: Place,
    /// Pauses that motion has not reached: line, command, and waits before, s.
    pauses: VecDeque<(u32, String, f64)>,
    /// The motion clock at the last end of a line.
    tick: u64,
    line: u32,
    homes: bool,
    filament_100pm: i64,
}

impl<F: Fn() -> (f64, u64)> Parts<F> {
    /// The parts of a job that begins; the ends of its lines come through `ends`.
    pub fn new(ends: Rc<LineEnds>, now: F) -> Self {
        Self {
            now,
            ends,
            found: PrintParts::default(),
            marks: VecDeque::new(),
            place: Place::default(),
            changes: VecDeque::new(),
            moving: Place::default(),
            pauses: VecDeque::new(),
            tick: 0,
            line: 0,
            homes: false,
            filament_100pm: 0,
        }
    }

    /// The parts of the job, when it has ended.
    pub fn finish(mut self) -> PrintParts {
        self.follow_motion();
        self.reach_pauses(u32::MAX);
        self.found
    }

    /// Follows motion to the last end of a line.
    fn follow_motion(&mut self) {
        while let Some((line, tick)) = self.ends.take() {
            while let Some((_, place)) = self.changes.pop_front_if(|(from, _)| *from <= line) {
                self.moving = place;
            }
            self.reach_pauses(line);
            let time_s = seconds(tick.saturating_sub(self.tick));
            self.tick = tick;
            if !(self.homes && line == self.line) {
                self.add(self.moving, time_s, 0.0);
            }
        }
    }

    /// Motion has reached a line: pauses up to it have begun where the motion before has ended.
    fn reach_pauses(&mut self, line: u32) {
        while let Some((line, command, waits_s)) = self.pauses.pop_front_if(|(from, ..)| *from <= line) {
            self.found.pauses.push(PausePart { line, command, at_s: waits_s + seconds(self.tick) });
        }
    }

    fn add(&mut self, place: Place, time_s: f64, filament_mm: f64) {
        if let Some(layer) = place.layer.and_then(|index| self.found.layer_list.get_mut(index)) {
            layer.time_s += time_s;
            layer.filament_mm += filament_mm;
        }
        let PrintParts { features, objects, .. } = &mut self.found;
        for (parts, index) in [(features, place.feature), (objects, place.object)] {
            if let Some(part) = index.and_then(|index| parts.get_mut(index)) {
                part.time_s += time_s;
                part.filament_mm += filament_mm;
            }
        }
    }

    fn reach_marks(&mut self, line: u32) {
        while let Some((line, mark)) = self.marks.pop_front_if(|(from, _)| *from <= line) {
            match mark {
                Mark::Layer => {
                    let layers = &mut self.found.layer_list;
                    self.place.layer = (layers.len() < MAX_PARTS).then_some(layers.len());
                    if self.place.layer.is_some() {
                        layers.push(LayerPart { line, z_mm: None, height_mm: None, time_s: 0.0, filament_mm: 0.0 });
                    }
                }
                Mark::Feature(name) => self.place.feature = index_of(&mut self.found.features, &name),
                Mark::Time(_) | Mark::Height(_) | Mark::Width(_) => {}
            }
        }
    }

    /// Notes the height of a layer that lays its first filament.
    fn note_height(&mut self, z_10nm: i64) {
        let layers = &mut self.found.layer_list;
        let Some(index) = self.place.layer else { return };
        if layers.get(index).is_none_or(|layer| layer.z_mm.is_some()) {
            return;
        }
        let z_mm = z_10nm as f64 / UNITS_PER_MM as f64;
        let below_mm = layers.iter().take(index).rev().find_map(|layer| layer.z_mm).unwrap_or(0.0);
        if let Some(layer) = layers.get_mut(index) {
            // Of two decimal numbers, so that it is one.
            let height_mm = ((z_mm - below_mm) * UNITS_PER_MM as f64).round() / UNITS_PER_MM as f64;
            (layer.z_mm, layer.height_mm) = (Some(z_mm), Some(height_mm));
        }
    }
}

/// The index of the part of a name, which is added if it is new and there is room.
fn index_of(parts: &mut Vec<NamedPart>, name: &str) -> Option<usize> {
    let known = parts.iter().position(|part| part.name == name);
    known.or_else(|| {
        (parts.len() < MAX_PARTS).then(|| {
            parts.push(NamedPart { name: name.to_owned(), time_s: 0.0, filament_mm: 0.0 });
            parts.len() - 1
        })
    })
}

/// The object that a line begins; `Some(None)`: one ends.
fn object(text: &str) -> Option<Option<&str>> {
    let code = code(text);
    if code.eq_ignore_ascii_case("EXCLUDE_OBJECT_START") {
        return Some(value_of(text, "NAME"));
    }
    if code.eq_ignore_ascii_case("EXCLUDE_OBJECT_END") {
        return Some(None);
    }
    let number = code.eq_ignore_ascii_case("M486").then(|| text.get(code.len()..))??;
    let number = number.trim().strip_prefix(['S', 's'])?.split(' ').next()?;
    Some((!number.starts_with('-')).then_some(number))
}

impl<P: Ports, F: Fn() -> (f64, u64)> Onlooker<P> for Parts<F> {
    fn begins(&mut self, _: &Printer<'_, P>, line: u32, text: &str) {
        self.line = line;
        self.follow_motion();
        let before = self.place;
        self.reach_marks(line);
        if let Some(name) = text.starts_with(['E', 'e', 'M', 'm']).then(|| object(text)).flatten() {
            self.place.object = name.and_then(|name| index_of(&mut self.found.objects, name));
        }
        if self.place != before {
            self.changes.push_back((line, self.place));
        }
        self.homes = text.starts_with(['G', 'g']) && HOMING.iter().any(|known| known.eq_ignore_ascii_case(code(text)));
        if is_pause(text) && self.found.pauses.len() < MAX_PARTS {
            let (now_s, tick) = (self.now)();
            self.pauses.push_back((line, code(text).to_ascii_uppercase(), now_s - seconds(tick)));
        }
    }

    fn ended(&mut self, printer: &Printer<'_, P>) {
        if self.homes {
            // All motion has ended. Searches for sensors are no moves that end.
            self.follow_motion();
            self.tick = (self.now)().1;
        }
        let filament_100pm = printer.tally().filament_100pm;
        let more_100pm = filament_100pm - self.filament_100pm;
        if more_100pm != 0 {
            self.filament_100pm = filament_100pm;
            if more_100pm > 0 {
                self.note_height(printer.logical_10nm()[2]);
            }
            self.add(self.place, 0.0, more_100pm as f64 / FILAMENT_UNITS_PER_MM as f64);
        }
    }

    fn marked(&mut self, line: u32, mark: &Mark) {
        // A file of nothing but comments must not fill the memory.
        if self.marks.len() < MAX_PARTS {
            self.marks.push_back((line, mark.clone()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_begin_and_end() {
        for (text, expected) in [
            ("EXCLUDE_OBJECT_START NAME=ring_0", Some(Some("ring_0"))),
            ("exclude_object_end NAME=ring_0", Some(None)),
            ("EXCLUDE_OBJECT_START", Some(None)),
            ("EXCLUDE_OBJECT_DEFINE NAME=a", None),
            ("M486 S3", Some(Some("3"))),
            ("M486 S-1", Some(None)),
            ("M486 T5", None),
            ("M486", None),
            ("M4867 S1", None),
        ] {
            assert_eq!(object(text), expected, "{text}");
        }
    }
}
