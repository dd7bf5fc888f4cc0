//! Fewer nodes of a path, for jobs that are too large for a page: every layer within
//! the same tolerance.
//!
//! One tolerance holds for the whole print and grows until all of it fits. A part that replaces
//! others keeps how far it is from the nodes that it replaces, so that errors never add up beyond
//! the tolerance, however often parts are joined.

mod part;
#[cfg(test)]
mod tests;

use crate::node::{Kind, Node};
use part::Part;

/// Largest distance at first of a node that is left out from the part that replaces it, mm.
const FIRST_TOLERANCE_MM: f32 = 0.015;
/// The same for its speed and its bead, as a part of them.
const FIRST_SHARE: f32 = 0.05;
/// The largest: a line of which one place is left shows how fast it is.
const LAST_SHARE: f32 = 0.8;
/// Growth of the distance from one tolerance to the next: the shares double.
const GROWTH: f32 = 1.26;
/// Tolerances above this keep nothing of a path's form: parts are joined by their number.
const LAST_TOLERANCE_MM: f32 = 2.0;
/// Maximum number of parts that are joined at once: it bounds the time.
const MAX_JOINED: usize = 64;

/// Largest difference of a part from the nodes that it replaces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Tolerance {
    /// Distance, mm.
    pub distance_mm: f32,
    /// Difference of speed and bead, as a part of them.
    pub share: f32,
    /// Nodes that may become one whatever they are.
    pub nodes: u32,
}

impl Tolerance {
    /// All nodes stay.
    const NONE: Self = Self { distance_mm: 0.0, share: 0.0, nodes: 1 };

    /// The next larger one. Speeds give way faster than the path: a path that is off
    /// is a wrong part.
    fn larger(self) -> Self {
        match () {
            () if self == Self::NONE => Self { distance_mm: FIRST_TOLERANCE_MM, share: FIRST_SHARE, ..self },
            () if self.distance_mm < LAST_TOLERANCE_MM => {
                Self { distance_mm: self.distance_mm * GROWTH, share: (2.0 * self.share).min(LAST_SHARE), ..self }
            }
            () => Self { nodes: self.nodes.saturating_mul(2), ..self },
        }
    }
}

/// Nodes of a path, at most `maximum`.
#[derive(Debug)]
pub(crate) struct Nodes {
    parts: Vec<Part>,
    maximum: usize,
    tolerance: Tolerance,
    /// Parts at the beginning that are as few as the tolerance allows.
    settled: usize,
    extremes: Extremes,
    /// Nodes that were left out.
    left_out: u64,
}

/// Nodes, and the ones left out.
#[derive(Debug)]
pub(crate) struct Reduced {
    pub nodes: Vec<Node>,
    pub left_out: u64,
    /// Largest distance of the path from the nodes that were left out, mm; 0 if none were.
    pub tolerance_mm: f32,
}

impl Nodes {
    pub fn new(maximum: usize) -> Self {
        Self {
            parts: Vec::new(),
            maximum,
            tolerance: Tolerance::NONE,
            settled: 0,
            extremes: Extremes::default(),
            left_out: 0,
        }
    }

    pub fn push(&mut self, node: Node) {
        if self.parts.len() >= self.maximum {
            self.reduce();
        }
        self.extremes.note(&node);
        let path_mm = self.parts.last().map_or(0.0, |before| before.node.distance_mm(&node) as f32);
        self.parts.push(Part::new(node, path_mm));
    }

    /// The last part takes longer.
    pub fn replace_last(&mut self, node: Node) {
        if let Some(last) = self.parts.last_mut() {
            last.node = node;
        }
    }

    /// Joins parts until a sixteenth of the room is free, with a larger tolerance if it must be.
    fn reduce(&mut self) {
        self.settle();
        while self.parts.len() > self.maximum / 16 * 15 {
            self.tolerance = self.tolerance.larger();
            self.settled = 0;
            self.settle();
        }
    }

    /// Joins the parts that are not settled, as far as the tolerance allows.
    fn settle(&mut self) {
        // The last settled part may be joined with the new ones.
        let start = self.settled.saturating_sub(1);
        let mut written = start;
        let mut read = start;
        while read < self.parts.len() {
            let (part, count) = self.joined(written, read);
            self.parts[written] = part;
            (written, read) = (written + 1, read + count);
        }
        self.left_out += (self.parts.len() - written) as u64;
        self.parts.truncate(written);
        self.settled = written;
    }

    /// The part that replaces as many parts from `read` on as the tolerance allows, and their
    /// number. `written`: the parts that are in place, after the last of which it begins.
    fn joined(&self, written: usize, read: usize) -> (Part, usize) {
        let alone = self.parts[read];
        let Some(start) = written.checked_sub(1).map(|before| self.parts[before].node) else { return (alone, 1) };
        let end = self.parts.len().min(read + MAX_JOINED);
        let mut best = (alone, 1);
        for count in 2..=end - read {
            let parts = &self.parts[read..read + count];
            // The node that would be left out last.
            if self.extremes.contains(&parts[count - 2].node) {
                break;
            }
            let Some(part) = part::join(&start, parts, &self.tolerance) else { break };
            best = (part, count);
        }
        best
    }

    pub fn finish(mut self) -> Reduced {
        if self.tolerance != Tolerance::NONE {
            self.settle();
        }
        let tolerance_mm = if self.left_out > 0 { self.tolerance.distance_mm } else { 0.0 };
        let nodes = self.parts.into_iter().map(|part| part.node).collect();
        Reduced { nodes, left_out: self.left_out, tolerance_mm }
    }
}

/// The nodes that have the most of something: the scales of colours end there.
#[derive(Debug, Default)]
struct Extremes {
    /// The values, and the times at which they are reached, s.
    most: [(f32, f64); 5],
}

impl Extremes {
    fn values(node: &Node) -> [f32; 5] {
        let of = |kind, value| if node.kind == kind { value } else { 0.0 };
        [
            of(Kind::Print, node.speed_mm_per_s),
            of(Kind::Travel, node.speed_mm_per_s),
            node.flow_mm3_per_s(),
            of(Kind::Print, node.deviation_mm),
            node.pressure_mm3,
        ]
    }

    fn note(&mut self, node: &Node) {
        for (most, value) in self.most.iter_mut().zip(Self::values(node)) {
            if value > most.0 {
                *most = (value, node.time_s);
            }
        }
    }

    fn contains(&self, node: &Node) -> bool {
        // The rest of a job that stopped has no speeds, and its time is that of the end.
        !node.is_rest && self.most.iter().any(|(value, time_s)| *value > 0.0 && *time_s == node.time_s)
    }
}
