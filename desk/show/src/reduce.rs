//! Fewer nodes, with the same extremes: for jobs that are too large for a page.

use crate::node::Node;

/// Largest distance at first from the line that replaces a node, mm.
const FIRST_TOLERANCE_MM: f32 = 0.03;

/// The same for its speed, as a part of it; grows with the distance.
const SPEED_PART: f32 = 0.05;

/// Nodes of a path, at most `maximum`.
#[derive(Debug)]
pub(crate) struct Nodes {
    kept: Vec<Node>,
    maximum: usize,
    tolerance_mm: f32,
    /// Nodes that were left out.
    left_out: u64,
}

impl Nodes {
    pub fn new(maximum: usize) -> Self {
        Self { kept: Vec::new(), maximum, tolerance_mm: FIRST_TOLERANCE_MM, left_out: 0 }
    }

    pub fn push(&mut self, node: Node) {
        if self.kept.len() >= self.maximum {
            self.reduce();
        }
        self.kept.push(node);
    }

    /// The last part takes longer.
    pub fn replace_last(&mut self, node: Node) {
        if let Some(last) = self.kept.last_mut() {
            *last = node;
        }
    }

    /// Leaves out at least a third of them.
    fn reduce(&mut self) {
        let before = self.kept.len();
        let enough = before / 3 * 2;
        // Large steps come last: parts of another kind are joined only as a last resort.
        while self.kept.len() > enough && self.tolerance_mm < 1000.0 {
            self.pass(|a, b| a.kind == b.kind && a.layer == b.layer && a.feature == b.feature);
            self.tolerance_mm *= 2.0;
        }
        while self.kept.len() > enough {
            self.pass(|_, _| true);
        }
        self.left_out += (before - self.kept.len()) as u64;
    }

    /// Joins pairs of parts that may be joined and whose common node is near the line between their ends. A node with
    /// a larger speed, pressure or flow than both its neighbours stays, and so does one with a smaller speed, except
    /// as a last resort.
    fn pass(&mut self, may_join: impl Fn(&Node, &Node) -> bool) {
        let is_last_resort = self.tolerance_mm >= 1000.0;
        let tolerance_mm = self.tolerance_mm;
        let mut written = 1;
        let mut read = 1;
        while read < self.kept.len() {
            let node = self.kept[read];
            if let Some(&next) = self.kept.get(read + 1) {
                let before = self.kept[written - 1];
                let is_near = distance_to_line_mm(&node, &before, &next) <= tolerance_mm
                    && speed_off(&node, &before, &next) <= SPEED_PART * tolerance_mm / FIRST_TOLERANCE_MM;
                if may_join(&node, &next) && (is_last_resort || is_near && !is_extreme(&before, &node, &next)) {
                    self.kept[written] = joined(&node, &next, is_last_resort);
                    (written, read) = (written + 1, read + 2);
                    continue;
                }
            }
            self.kept[written] = node;
            (written, read) = (written + 1, read + 1);
        }
        self.kept.truncate(written);
    }

    /// Returns all nodes, and the number of those that were left out.
    pub fn finish(self) -> (Vec<Node>, u64) {
        (self.kept, self.left_out)
    }
}

/// Two parts as one, which ends where the second ends. As a last resort it has the values of the one that flows more, or is faster.
fn joined(first: &Node, second: &Node, is_last_resort: bool) -> Node {
    if !is_last_resort {
        return Node { is_slowed: first.is_slowed || second.is_slowed, ..*second };
    }
    let rank = |node: &Node| (node.flow_mm3_per_s(), node.speed_mm_per_s);
    let most = if rank(first) > rank(second) { first } else { second };
    Node {
        speed_mm_per_s: most.speed_mm_per_s,
        bead: most.bead,
        kind: most.kind,
        is_slowed: first.is_slowed || second.is_slowed,
        deviation_mm: first.deviation_mm.max(second.deviation_mm),
        feature: most.feature,
        pressure_mm3: first.pressure_mm3.max(second.pressure_mm3),
        ..*second
    }
}

/// Returns true if a node's speed, flow, pressure or deviation stands out from both its neighbours by more than a
/// tenth.
fn is_extreme(before: &Node, node: &Node, next: &Node) -> bool {
    let stands_out = |value: fn(&Node) -> f32| {
        let [a, b, c] = [value(before), value(node), value(next)];
        b > 1.1 * a.max(c) + 1.0 || b < 0.9 * a.min(c) - 1.0
    };
    stands_out(|node| node.speed_mm_per_s)
        || stands_out(|node| 10.0 * node.flow_mm3_per_s())
        || stands_out(|node| 50.0 * node.pressure_mm3)
        || stands_out(|node| 50.0 * node.deviation_mm)
}

/// Returns the distance of a node's speed from the even change between its neighbours', as a part of the speed.
fn speed_off(node: &Node, from: &Node, to: &Node) -> f32 {
    let whole_s = to.time_s - from.time_s;
    let share = if whole_s > 0.0 { ((node.time_s - from.time_s) / whole_s) as f32 } else { 0.0 };
    let even = from.speed_mm_per_s + (to.speed_mm_per_s - from.speed_mm_per_s) * share;
    (node.speed_mm_per_s - even).abs() / node.speed_mm_per_s.max(10.0)
}

fn distance_to_line_mm(node: &Node, from: &Node, to: &Node) -> f32 {
    let [line, point] = [to, node]
        .map(|end| -> [f32; 3] { std::array::from_fn(|axis| end.position_mm[axis] - from.position_mm[axis]) });
    let dot = |a: [f32; 3], b: [f32; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let length = dot(line, line);
    let along = if length > 0.0 { (dot(point, line) / length).clamp(0.0, 1.0) } else { 0.0 };
    let off: [f32; 3] = std::array::from_fn(|axis| point[axis] - along * line[axis]);
    dot(off, off).sqrt()
}
