//! Turns samples into nodes: a node at each end of a move, and between them where direction or speed change.

use std::collections::VecDeque;

use crate::commanded::{Commanded, PlannedMove, SlowedLines};
use crate::lines::{LineState, LineStates};
use crate::node::{Kind, Node, UNMARKED};

/// Largest distance of a sample from the straight line between two nodes, mm.
const STRAIGHT_MM: f64 = 0.012;
/// Largest difference of a sample's speed from the even change between two nodes, mm/s, or this part of it.
const EVEN_MM_PER_S: f64 = 1.5;
const EVEN_PART: f64 = 0.02;
/// The same for the volume that is compressed in the nozzle, mm^3: it changes by itself.
const PRESSURE_MM3: f64 = 0.02;
const PRESSURE_PART: f64 = 0.06;
/// Minimum filament for each mm of path in a move that prints, mm^2: a tenth of a thin line.
const THINNEST_MM2: f64 = 0.004;
/// A shorter path is a motor that settles.
const REST_MM: f64 = 0.03;

/// A sample in machine coordinates.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Place {
    pub time_s: f64,
    pub position_mm: [f64; 3],
    /// mm.
    pub filament_mm: f64,
    pub pressure_mm3: f64,
}

/// A place with the path and the speed up to it.
#[derive(Clone, Copy, Debug, Default)]
struct Passed {
    place: Place,
    /// Path since the beginning of the move.
    along_mm: f64,
    /// Speed at the place: between those before and after it.
    speed_mm_per_s: f64,
    /// Distance from the path that the lines ask for.
    deviation_mm: f64,
}

/// The bounds of a line's slope within which all samples since its start are near it (a swinging door).
#[derive(Clone, Copy, Debug)]
struct Door {
    lower: f64,
    upper: f64,
}

impl Door {
    const OPEN: Self = Self { lower: f64::NEG_INFINITY, upper: f64::INFINITY };

    /// Narrows the bounds by a sample this far along, and says whether the slope to it lies within those before.
    fn admits(&mut self, along: f64, rise: f64, tolerance: f64) -> bool {
        let slope = rise / along;
        let fits = self.lower <= slope && slope <= self.upper;
        self.lower = self.lower.max((rise - tolerance) / along);
        self.upper = self.upper.min((rise + tolerance) / along);
        fits
    }
}

/// Builds nodes of one move after the other.
#[derive(Debug)]
pub(crate) struct Path {
    filament_mm2: f64,
    /// The end of the last move.
    start: Passed,
    /// The last node that is kept of this move, and the last sample.
    anchor: Passed,
    last: Passed,
    /// Speed over the interval before the last sample, and that interval.
    last_interval: (f64, f64),
    doors: [Door; 5],
    /// The last sample that lay on the line from the last node.
    admitted: Option<Passed>,
    open: Vec<Passed>,
    /// The end of the last move, whose speed is known with the next sample.
    ended: Option<Node>,
    /// Filament of moves that are planned and have not ended, mm.
    planned_mm: VecDeque<f64>,
    planned_part_mm: f64,
    commanded: Commanded,
    slowed: SlowedLines,
}

impl Path {
    pub fn new(filament_mm2: f64, start: Place) -> Self {
        let start = Passed { place: start, ..Passed::default() };
        Self {
            filament_mm2,
            start,
            anchor: start,
            last: start,
            last_interval: (0.0, 1.0),
            doors: [Door::OPEN; 5],
            admitted: None,
            open: Vec::new(),
            ended: None,
            planned_mm: VecDeque::new(),
            planned_part_mm: 0.0,
            commanded: Commanded::default(),
            slowed: SlowedLines::default(),
        }
    }

    /// A move has been planned after the others.
    pub fn planned(&mut self, taken: &PlannedMove) {
        let length_mm = self.commanded.take(self.last.place.position_mm, taken.target_mm);
        self.slowed.take(taken, length_mm);
        self.planned_part_mm += taken.filament_mm;
        if taken.ends_move {
            self.planned_mm.push_back(std::mem::take(&mut self.planned_part_mm));
        }
    }

    /// The motion so far has been broken off.
    pub fn broken_off(&mut self) {
        self.commanded.clear();
        self.planned_mm.clear();
        self.planned_part_mm = 0.0;
    }

    /// Starts again at another place.
    pub fn begin(&mut self, place: Place) {
        let start = Passed { place, ..Passed::default() };
        (self.start, self.anchor, self.last) = (start, start, start);
        self.last_interval = (0.0, 1.0);
        self.doors = [Door::OPEN; 5];
        self.admitted = None;
        self.open.clear();
    }

    /// The last place.
    pub const fn last(&self) -> Place {
        self.last.place
    }

    /// Takes the next sample.
    pub fn pass(&mut self, place: Place, keep: &mut impl FnMut(Node)) {
        let before = self.last.place;
        let step_s = place.time_s - before.time_s;
        let deltas: [f64; 3] = std::array::from_fn(|axis| place.position_mm[axis] - before.position_mm[axis]);
        let step_mm = deltas.iter().map(|delta| delta * delta).sum::<f64>().sqrt();
        if step_s <= 0.0 && step_mm == 0.0 {
            self.last.place = place;
            return;
        }
        let speed = if step_s > 0.0 { step_mm / step_s } else { self.last_interval.0 };
        // The speed at the sample before is known only now.
        let (speed_before, before_s) = self.last_interval;
        let between = before_s + step_s;
        self.last.speed_mm_per_s =
            if between > 0.0 { (speed_before * step_s + speed * before_s) / between } else { speed };
        if let Some(ended) = self.ended.take() {
            let speed = if ended.kind.moves() { self.last.speed_mm_per_s as f32 } else { 0.0 };
            keep(Node { speed_mm_per_s: speed, ..ended });
        }
        self.keep_if_bent();
        self.last_interval = (speed, step_s);
        let deviation_mm = self.commanded.deviation_mm(place.position_mm, step_mm);
        self.last = Passed { place, along_mm: self.last.along_mm + step_mm, speed_mm_per_s: speed, deviation_mm };
    }

    /// Keeps a node at the sample before the last one if the last one does not lie on the line from the last node through it.
    fn keep_if_bent(&mut self) {
        let candidate = self.last;
        if candidate.along_mm <= self.anchor.along_mm {
            self.anchor = candidate;
            return;
        }
        if !self.admits(&candidate)
            && let Some(before) = self.admitted
        {
            self.open.push(before);
            self.anchor = before;
            self.doors = [Door::OPEN; 5];
            if candidate.along_mm > before.along_mm {
                self.admits(&candidate);
            }
        }
        self.admitted = Some(candidate);
    }

    fn admits(&mut self, candidate: &Passed) -> bool {
        let anchor = self.anchor;
        let along = candidate.along_mm - anchor.along_mm;
        let [x, y, z] = std::array::from_fn(|axis| candidate.place.position_mm[axis] - anchor.place.position_mm[axis]);
        let (speed, pressure) = (candidate.speed_mm_per_s, candidate.place.pressure_mm3);
        let rises = [
            (x, STRAIGHT_MM),
            (y, STRAIGHT_MM),
            (z, STRAIGHT_MM),
            (speed - anchor.speed_mm_per_s, EVEN_MM_PER_S.max(EVEN_PART * speed)),
            (pressure - anchor.place.pressure_mm3, PRESSURE_MM3.max(PRESSURE_PART * pressure.abs())),
        ];
        let mut fits = true;
        for (door, (rise, tolerance)) in self.doors.iter_mut().zip(rises) {
            fits &= door.admits(along, rise, tolerance);
        }
        fits
    }

    /// The move of a line ends at the last sample. Its nodes go to `keep`.
    pub fn end(&mut self, line: u32, states: &mut LineStates, keep: &mut impl FnMut(Node)) {
        let filament_mm = self.planned_mm.pop_front();
        self.close(line, states.at(line), filament_mm, keep);
    }

    /// The motion so far has come to its end without the end of a line's move (homing, waits in between).
    pub fn settle(&mut self, line: u32, homes: bool, states: &mut LineStates, keep: &mut impl FnMut(Node)) {
        let state = states.at(line);
        self.close(line, LineState { homes: homes || state.homes, ..state }, None, keep);
        if let Some(ended) = self.ended.take() {
            keep(Node { speed_mm_per_s: 0.0, ..ended });
        }
    }

    fn close(&mut self, line: u32, state: LineState, filament_mm: Option<f64>, keep: &mut impl FnMut(Node)) {
        let pushed_mm = self.last.place.filament_mm - self.start.place.filament_mm;
        let path_mm = self.last.along_mm;
        // The extruder's steps say what is pushed where moves are unknown (prepared jobs), and one of them may belong
        // to a neighbour.
        let is_bead = pushed_mm.abs() * self.filament_mm2 > THINNEST_MM2 * path_mm;
        let filament_mm = filament_mm.unwrap_or(if is_bead { pushed_mm } else { 0.0 });
        let took_s = self.last.place.time_s - self.start.place.time_s;
        if took_s > 0.0 {
            let volume_mm3 = filament_mm * self.filament_mm2;
            // A bead is never thicker than the nozzle is wide by much: a short path with much filament is a motor that settles.
            let alone = path_mm < REST_MM && volume_mm3.abs() > 1.5 * path_mm;
            let (kind, bead) = match () {
                () if state.homes => (Kind::Homing, 0.0),
                () if alone && filament_mm < 0.0 => (Kind::Retract, filament_mm),
                () if alone => (Kind::Prime, filament_mm),
                () if path_mm <= 0.0 => (Kind::Wait, 0.0),
                () if filament_mm > 0.0 => (Kind::Print, volume_mm3 / path_mm),
                () => (Kind::Travel, volume_mm3 / path_mm),
            };
            let is_slowed = self.slowed.contains(line);
            let node = |passed: &Passed, speed| Node {
                deviation_mm: if kind == Kind::Homing { 0.0 } else { passed.deviation_mm as f32 },
                is_slowed,
                ..node(passed.place, speed, kind, bead, line, state)
            };
            for passed in self.open.drain(..) {
                keep(node(&passed, if kind.moves() { passed.speed_mm_per_s } else { 0.0 }));
            }
            if let Some(ended) = self.ended.replace(node(&self.last, 0.0)) {
                keep(ended);
            }
        }
        self.open.clear();
        self.last.along_mm = 0.0;
        (self.start, self.anchor) = (self.last, self.last);
        self.doors = [Door::OPEN; 5];
        self.admitted = None;
    }
}

fn node(place: Place, speed: f64, kind: Kind, bead: f64, line: u32, state: LineState) -> Node {
    Node {
        time_s: place.time_s,
        position_mm: place.position_mm.map(|mm| mm as f32),
        speed_mm_per_s: speed as f32,
        bead: bead as f32,
        pressure_mm3: place.pressure_mm3 as f32,
        feed_mm_per_s: state.feed_mm_per_s,
        line,
        layer: state.layer.unwrap_or(UNMARKED),
        kind,
        feature: state.feature,
        ..Node::default()
    }
}
