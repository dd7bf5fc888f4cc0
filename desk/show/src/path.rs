//! Turns samples into nodes: a node at each end of a move, and between them where direction
//! or speed change.

use crate::commanded::{Commanded, PlannedMove, SlowedLines};
use crate::lines::{LineState, LineStates};
use crate::node::{Kind, Node, UNMARKED};
use crate::pieces::{Piece, Pieces};

/// Largest distance of a sample from the straight line between two nodes, mm.
const STRAIGHT_MM: f64 = 0.012;
/// Largest difference of a sample's speed from the even change between two nodes, mm/s, or
/// this part of it.
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

impl Place {
    /// Distance to another place, mm.
    pub fn distance_mm(&self, other: &Self) -> f64 {
        let squares = self.position_mm.iter().zip(other.position_mm).map(|(a, b)| (a - b) * (a - b));
        squares.sum::<f64>().sqrt()
    }
}

/// A place with the path and the speed up to it.
#[derive(Clone, Copy, Debug, Default)]
struct Passed {
    place: Place,
    /// Path since the beginning of the move.
    along_mm: f64,
    /// Speed at the place.
    speed_mm_per_s: f64,
    /// Distance from the path that the lines ask for.
    deviation_mm: f64,
}

/// The bounds of a line's slope within which all samples since its start are near it
/// (a swinging door).
#[derive(Clone, Copy, Debug)]
struct Door {
    lower: f64,
    upper: f64,
}

impl Door {
    const OPEN: Self = Self { lower: f64::NEG_INFINITY, upper: f64::INFINITY };

    /// Narrows the bounds by a sample this far along, and says whether the slope to it lies
    /// within those before.
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
    /// Filament of a step of the extruder.
    filament_step_mm: f64,
    /// The end of the last move.
    start: Passed,
    /// The last node that is kept of this move, and the last sample.
    anchor: Passed,
    last: Passed,
    doors: [Door; 5],
    /// The last sample that lay on the line from the last node.
    admitted: Option<Passed>,
    open: Vec<Passed>,
    pieces: Pieces<Passed>,
    commanded: Commanded,
    slowed: SlowedLines,
}

impl Path {
    /// `filament_step_mm`: filament of a step of the extruder.
    pub fn new(filament_mm2: f64, filament_step_mm: f64, start: Place) -> Self {
        let start = Passed { place: start, ..Passed::default() };
        Self {
            filament_mm2,
            filament_step_mm,
            start,
            anchor: start,
            last: start,
            doors: [Door::OPEN; 5],
            admitted: None,
            open: Vec::new(),
            pieces: Pieces::default(),
            commanded: Commanded::default(),
            slowed: SlowedLines::default(),
        }
    }

    /// A move has been planned after the others.
    pub fn planned(&mut self, taken: &PlannedMove) {
        let length_mm = self.commanded.take(self.last.place.position_mm, taken.target_mm);
        self.slowed.take(taken, length_mm);
        self.pieces.plan(taken, length_mm);
    }

    /// The motion so far has been broken off.
    pub fn broken_off(&mut self) {
        self.commanded.clear();
        self.pieces.clear();
    }

    /// Starts again at another place.
    pub fn begin(&mut self, place: Place) {
        let start = Passed { place, ..Passed::default() };
        (self.start, self.anchor, self.last) = (start, start, start);
        self.doors = [Door::OPEN; 5];
        self.admitted = None;
        self.open.clear();
    }

    /// Takes the next sample, with the speed there.
    pub fn pass(&mut self, place: Place, speed_mm_per_s: f64) {
        let step_mm = self.last.place.distance_mm(&place);
        if place.time_s <= self.last.place.time_s && step_mm == 0.0 {
            self.last.place = place;
            self.end_pieces();
            return;
        }
        self.keep_if_bent();
        let deviation_mm = self.commanded.deviation_mm(place.position_mm, step_mm);
        self.last = Passed { place, along_mm: self.last.along_mm + step_mm, speed_mm_per_s, deviation_mm };
        self.end_pieces();
    }

    /// Notes which planned moves have ended at the last sample.
    fn end_pieces(&mut self) {
        let filament_mm = self.last.place.filament_mm - self.start.place.filament_mm;
        self.pieces.pass(self.commanded.along_mm(), filament_mm, self.filament_step_mm, self.last);
    }

    /// Keeps a node at the sample before the last one if the last one does not lie on the line from
    /// the last node through it.
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
        let pieces = self.pieces.end_line();
        let own = pieces.iter().flatten().filter(|piece| piece.line != line);
        self.close_own(own.copied(), states, keep);
        let of_line = pieces.as_ref().map(|pieces| pieces.iter().filter(|piece| piece.line == line));
        let filament_mm = of_line.map(|pieces| pieces.map(|piece| piece.filament_mm).sum());
        let motion = self.motion(self.last, filament_mm);
        self.close(self.last, line, states.at(line), motion, keep);
    }

    /// The motion so far has ended without the end of a line's move (homing,
    /// waits in between).
    pub fn settle(&mut self, line: u32, homes: bool, states: &mut LineStates, keep: &mut impl FnMut(Node)) {
        let mut own = self.pieces.end_own();
        if let Some(last) = own.last_mut() {
            // Motors settle after their last step.
            last.ended = last.ended.filter(|end| self.last.along_mm - end.along_mm > REST_MM).or(Some(self.last));
        }
        self.last.speed_mm_per_s = 0.0;
        let is_known = !own.is_empty();
        self.close_own(own.into_iter(), states, keep);
        let state = states.at(line);
        let motion = self.motion(self.last, None);
        // Moves that the printer adds print nothing.
        let motion = if is_known && motion.0 == Kind::Print { (Kind::Travel, 0.0) } else { motion };
        self.close(self.last, line, LineState { homes: homes || state.homes, ..state }, motion, keep);
    }

    /// Ends moves that the printer has made itself, each where it has ended.
    fn close_own(
        &mut self,
        pieces: impl Iterator<Item = Piece<Passed>>,
        states: &mut LineStates,
        keep: &mut impl FnMut(Node),
    ) {
        for piece in pieces {
            let Some(end) = piece.ended else { continue };
            let motion = match () {
                () if piece.moves => (Kind::Travel, 0.0),
                () if piece.filament_mm < 0.0 => (Kind::Retract, piece.filament_mm),
                () => (Kind::Prime, piece.filament_mm),
            };
            self.close(end, piece.line, states.at(piece.line), motion, keep);
        }
    }

    /// The kind of the motion from the end of the last move up to a place, and its [`Node::bead`],
    /// by the planned filament.
    fn motion(&self, end: Passed, filament_mm: Option<f64>) -> (Kind, f64) {
        let pushed_mm = end.place.filament_mm - self.start.place.filament_mm;
        let path_mm = end.along_mm - self.start.along_mm;
        // The extruder's steps say what is pushed where moves are unknown, and one of them may
        // belong to a neighbour.
        let is_bead = pushed_mm.abs() * self.filament_mm2 > THINNEST_MM2 * path_mm;
        let filament_mm = filament_mm.unwrap_or(if is_bead { pushed_mm } else { 0.0 });
        motion(path_mm, filament_mm, self.filament_mm2)
    }

    /// Ends the motion up to a place.
    fn close(
        &mut self,
        end: Passed,
        line: u32,
        state: LineState,
        (kind, bead): (Kind, f64),
        keep: &mut impl FnMut(Node),
    ) {
        if end.place.time_s > self.start.place.time_s {
            let (kind, bead) = if state.homes { (Kind::Homing, 0.0) } else { (kind, bead) };
            let is_slowed = self.slowed.contains(line);
            let after = self.open.iter().position(|passed| passed.place.time_s >= end.place.time_s);
            let before = self.open.drain(..after.unwrap_or(self.open.len()));
            for passed in before.chain([end]) {
                let speed = if kind.moves() { passed.speed_mm_per_s } else { 0.0 };
                keep(Node {
                    deviation_mm: if kind == Kind::Homing { 0.0 } else { passed.deviation_mm as f32 },
                    is_slowed,
                    ..node(passed.place, speed, kind, bead, line, state)
                });
            }
        }
        self.start = end;
        if end.place.time_s < self.last.place.time_s {
            return;
        }
        self.open.clear();
        self.last.along_mm = 0.0;
        (self.start, self.anchor) = (self.last, self.last);
        self.doors = [Door::OPEN; 5];
        self.admitted = None;
    }
}

/// The kind of a motion along a path with so much filament, and its [`Node::bead`].
pub(crate) fn motion(path_mm: f64, filament_mm: f64, filament_mm2: f64) -> (Kind, f64) {
    let volume_mm3 = filament_mm * filament_mm2;
    // A bead is never thicker than the nozzle is wide by much: a short path with much filament
    // is a motor that settles.
    let alone = path_mm < REST_MM && volume_mm3.abs() > 1.5 * path_mm;
    match () {
        () if alone && filament_mm < 0.0 => (Kind::Retract, filament_mm),
        () if alone => (Kind::Prime, filament_mm),
        () if path_mm <= 0.0 => (Kind::Wait, 0.0),
        () if filament_mm > 0.0 => (Kind::Print, volume_mm3 / path_mm),
        () => (Kind::Travel, volume_mm3 / path_mm),
    }
}

/// The node at a place where a part of the path ends.
pub(crate) fn node(place: Place, speed: f64, kind: Kind, bead: f64, line: u32, state: LineState) -> Node {
    let nozzle_mm: [f64; 3] = std::array::from_fn(|axis| place.position_mm[axis] + state.nozzle_mm[axis]);
    Node {
        time_s: place.time_s,
        position_mm: nozzle_mm.map(|mm| mm as f32),
        speed_mm_per_s: speed as f32,
        bead: bead as f32,
        height_mm: state.height_mm,
        width_mm: state.width_mm,
        pressure_mm3: place.pressure_mm3 as f32,
        feed_mm_per_s: state.feed_mm_per_s,
        line,
        layer: state.layer.unwrap_or(UNMARKED),
        kind,
        feature: state.feature,
        tool: state.tool,
        ..Node::default()
    }
}
