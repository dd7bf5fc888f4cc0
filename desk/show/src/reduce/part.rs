//! A part of the path that may replace several.

use super::{LAST_TOLERANCE_MM, Tolerance};
use crate::node::{Kind, Node};

/// Minimum speed to which a difference of speeds is compared, mm/s.
const SLOW_MM_PER_S: f32 = 10.0;
/// The path that a part replaces is longer than the part by this at most, as a part of it.
const SHORTER: f32 = 0.02;

/// The end of a part, with how far the nodes are from it that it replaces.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part {
    pub node: Node,
    /// Length of the path that it replaces, mm.
    path_mm: f32,
    off_mm: f32,
    off_share: f32,
    /// Nodes that it replaces, with its own.
    nodes: u32,
}

impl Part {
    pub const fn new(node: Node, path_mm: f32) -> Self {
        Self { node, path_mm, off_mm: 0.0, off_share: 0.0, nodes: 1 }
    }
}

/// The part that replaces these, from `start` on; `None` if it is too far from them.
pub(super) fn join(start: &Node, parts: &[Part], tolerance: &Tolerance) -> Option<Part> {
    let (last, before) = parts.split_last()?;
    let nodes = parts.iter().map(|part| part.nodes).fold(0, u32::saturating_add);
    let path_mm = parts.iter().map(|part| part.path_mm).sum();
    if before.iter().any(|part| part.node.is_rest != last.node.is_rest) {
        return None;
    }
    if nodes <= tolerance.nodes {
        let node = parts.iter().map(|part| part.node).reduce(|first, second| louder(&first, &second))?;
        return Some(Part { node, path_mm, off_mm: LAST_TOLERANCE_MM, off_share: 1.0, nodes });
    }
    let end = last.node;
    let is_same = |node: &Node| {
        (node.kind, node.layer, node.feature, node.is_slowed) == (end.kind, end.layer, end.feature, end.is_slowed)
    };
    let chord = Chord::new(start, &end);
    let is_filament_alone = matches!(end.kind, Kind::Retract | Kind::Prime);
    let is_short = chord.length_mm < (1.0 - SHORTER) * path_mm;
    if is_short || is_filament_alone || !before.iter().all(|part| is_same(&part.node)) {
        return None;
    }
    let (mut off_mm, mut off_share) = (0.0_f32, 0.0_f32);
    let mut distance_mm = 0.0_f32;
    for part in parts {
        let next_mm = if std::ptr::eq(part, last) { 0.0 } else { chord.distance_mm(&part.node) };
        // All that a part replaces is as near to it as it says, and it is no farther from the
        // chord than its ends.
        off_mm = off_mm.max(distance_mm.max(next_mm) + part.off_mm);
        let speed = (part.node.speed_mm_per_s - chord.speed_mm_per_s(part.node.time_s)).abs();
        let speed = speed / part.node.speed_mm_per_s.max(SLOW_MM_PER_S);
        let bead = (part.node.bead - end.bead).abs() / end.bead.abs().max(f32::MIN_POSITIVE);
        off_share = off_share.max(speed.max(bead.min(1.0)) + part.off_share);
        distance_mm = next_mm;
    }
    let is_near = off_mm <= tolerance.distance_mm && off_share <= tolerance.share;
    is_near.then(|| {
        let filament = parts.iter().map(|part| part.node.bead * part.path_mm).sum::<f32>();
        let bead = if path_mm > 0.0 && end.kind.moves() { filament / path_mm } else { end.bead };
        let deviation_mm = parts.iter().map(|part| part.node.deviation_mm).fold(0.0, f32::max);
        Part { node: Node { bead, deviation_mm, ..end }, path_mm, off_mm, off_share, nodes }
    })
}

/// Two parts as one that ends where the second ends, with the values of the one that flows
/// more, or is faster.
fn louder(first: &Node, second: &Node) -> Node {
    let rank = |node: &Node| (node.flow_mm3_per_s(), node.speed_mm_per_s);
    let most = if rank(first) > rank(second) { first } else { second };
    Node {
        speed_mm_per_s: most.speed_mm_per_s,
        bead: most.bead,
        kind: most.kind,
        feature: most.feature,
        is_slowed: first.is_slowed || second.is_slowed,
        deviation_mm: first.deviation_mm.max(second.deviation_mm),
        pressure_mm3: first.pressure_mm3.max(second.pressure_mm3),
        ..*second
    }
}

/// A straight part along which the speed changes evenly in time.
struct Chord<'a> {
    start: &'a Node,
    along: [f32; 3],
    length_mm: f32,
    /// Time, s, and change of speed.
    duration_s: f64,
    change_mm_per_s: f32,
}

impl<'a> Chord<'a> {
    fn new(start: &'a Node, end: &Node) -> Self {
        let along: [f32; 3] = std::array::from_fn(|axis| end.position_mm[axis] - start.position_mm[axis]);
        Self {
            start,
            along,
            length_mm: dot(along, along).sqrt(),
            duration_s: end.time_s - start.time_s,
            change_mm_per_s: end.speed_mm_per_s - start.speed_mm_per_s,
        }
    }

    fn distance_mm(&self, node: &Node) -> f32 {
        let point: [f32; 3] = std::array::from_fn(|axis| node.position_mm[axis] - self.start.position_mm[axis]);
        let square = self.length_mm * self.length_mm;
        let share = if square > 0.0 { (dot(point, self.along) / square).clamp(0.0, 1.0) } else { 0.0 };
        let off: [f32; 3] = std::array::from_fn(|axis| point[axis] - share * self.along[axis]);
        dot(off, off).sqrt()
    }

    fn speed_mm_per_s(&self, time_s: f64) -> f32 {
        let share = if self.duration_s > 0.0 { ((time_s - self.start.time_s) / self.duration_s) as f32 } else { 1.0 };
        self.start.speed_mm_per_s + self.change_mm_per_s * share
    }
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
