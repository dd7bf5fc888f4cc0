//! Layers of a file that marks none.
//!
//! Where layers are flat, one begins where printing continues at another height. Where the height
//! changes while something is printed (a spiral, a print that is not planar), one begins where the
//! nozzle prints over lines of the present one.

use std::collections::HashMap;

use crate::node::{Kind, Node};

/// Height difference above which printing is at another height, mm.
const LAYER_MM: f32 = 0.04;
/// Side of the squares of the bed in which printing is remembered, mm.
const SQUARE_MM: f32 = 1.0;
/// Path over squares of the present layer after which another one has begun, mm: the ends
/// of a turn overlap.
const OVERLAP_MM: f32 = 3.0;
/// Squares that are remembered at most: 1 m^2, printed all over.
const MAX_SQUARES: usize = 1 << 20;
/// Longest distance between two looks along a part, mm.
const LOOK_MM: f32 = 0.5;
/// Maximum number of samples along one part.
const MAX_LOOKS: f32 = 2000.0;

/// Printing in a square of the bed: the layer, and its lowest height there, mm.
type Printed = (u32, f32);

/// Counts layers.
#[derive(Debug, Default)]
pub(crate) struct Layers {
    layer: u32,
    /// Height at which the present layer began; none before anything is printed.
    began_mm: Option<f32>,
    /// True from the first printing on whose height changes.
    is_sloped: bool,
    /// True if the last part printed lower than all before it: those were no part.
    begins_part: bool,
    squares: HashMap<[i32; 2], Printed>,
    overlap_mm: f32,
    /// Squares of the present overlap, and the height there.
    over: Vec<([i32; 2], f32)>,
}

impl Layers {
    /// The layer of the part between two nodes, from 0.
    pub fn note(&mut self, before: &Node, node: &Node) -> u32 {
        if node.kind != Kind::Print {
            return self.layer;
        }
        let [_, _, z_mm] = node.position_mm;
        let [_, _, before_mm] = before.position_mm;
        let began_mm = *self.began_mm.get_or_insert(z_mm);
        let changes = (z_mm - began_mm).abs() > LAYER_MM;
        if changes && before.kind == Kind::Print && (before_mm - began_mm).abs() <= LAYER_MM + (z_mm - before_mm).abs()
        {
            self.is_sloped |= before_mm != z_mm;
        }
        if self.is_sloped {
            self.look_down(before, node);
        } else if changes {
            // The lowest printing is a part's first layer; a line that primes the
            // nozzle may be higher.
            self.begins_part = self.layer == 0 && z_mm < began_mm;
            self.layer += u32::from(!self.begins_part);
            self.began_mm = Some(z_mm);
        }
        self.remember(before, node);
        self.layer
    }

    /// Returns true once, when the part begins after something else was printed.
    pub fn take_beginning(&mut self) -> bool {
        std::mem::take(&mut self.begins_part)
    }

    /// Looks along a part for what the present layer has below it.
    fn look_down(&mut self, before: &Node, node: &Node) {
        for (square, z_mm, length_mm) in looks(before, node) {
            let below = self.squares.get(&square);
            if below.is_some_and(|(layer, below_mm)| *layer == self.layer && z_mm - below_mm > LAYER_MM) {
                self.overlap_mm += length_mm;
                self.over.push((square, z_mm));
            } else {
                self.overlap_mm = 0.0;
                self.over.clear();
            }
            if self.overlap_mm > OVERLAP_MM {
                self.layer += 1;
                (self.overlap_mm, self.began_mm) = (0.0, Some(z_mm));
                // The layer has begun where the overlap did.
                for (square, z_mm) in self.over.drain(..) {
                    self.squares.insert(square, (self.layer, z_mm));
                }
                return;
            }
        }
    }

    fn remember(&mut self, before: &Node, node: &Node) {
        for (square, z_mm, _) in looks(before, node) {
            if self.squares.len() >= MAX_SQUARES && !self.squares.contains_key(&square) {
                self.squares.clear();
            }
            let printed = self.squares.entry(square).or_insert((self.layer, z_mm));
            if printed.0 != self.layer {
                *printed = (self.layer, z_mm);
            }
        }
    }
}

/// Squares along a part, the height there, and the length of the part that each look stands for.
fn looks(before: &Node, node: &Node) -> impl Iterator<Item = ([i32; 2], f32, f32)> {
    let (from, to) = (before.position_mm, node.position_mm);
    let length_mm = (to[0] - from[0]).hypot(to[1] - from[1]);
    let count = (length_mm / LOOK_MM).ceil().clamp(1.0, MAX_LOOKS);
    (1..=count as u16).map(move |look| {
        let share = f32::from(look) / count;
        let [x, y, z] = std::array::from_fn(|axis| from[axis] + (to[axis] - from[axis]) * share);
        ([x, y].map(|mm| (mm / SQUARE_MM).floor() as i32), z, length_mm / count)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The layers of parts that end at these places; `true`: printed.
    fn layers(places: impl IntoIterator<Item = (bool, [f32; 3])>) -> Vec<u32> {
        let mut layers = Layers::default();
        let mut before = Node::default();
        let mut found = Vec::new();
        for (prints, position_mm) in places {
            let kind = if prints { Kind::Print } else { Kind::Travel };
            let node = Node { kind, position_mm, ..Node::default() };
            found.push(layers.note(&before, &node));
            before = node;
        }
        found
    }

    fn spiral(turns: u16) -> impl Iterator<Item = (bool, [f32; 3])> {
        (0..=turns * 100).map(|part| {
            let turn = f32::from(part) / 100.0;
            let angle = std::f32::consts::TAU * turn;
            (part > 0, [100.0 + 20.0 * angle.cos(), 100.0 + 20.0 * angle.sin(), 0.2 + 0.2 * turn])
        })
    }

    #[test]
    fn flat_layers_begin_at_their_height() {
        let square = |z: f32| [(false, [0.0, 0.0, z]), (true, [20.0, 0.0, z]), (true, [20.0, 20.0, z])];
        let places = [0.2, 0.4, 0.6].into_iter().flat_map(square);
        assert_eq!(layers(places), [0, 0, 0, 0, 1, 1, 1, 2, 2]);
        // A hop between two lines of a layer.
        let hop =
            [(false, [0.0, 0.0, 0.2]), (true, [9.0, 0.0, 0.2]), (false, [9.0, 9.0, 0.6]), (true, [0.0, 9.0, 0.2])];
        assert_eq!(layers(hop), [0; 4]);
    }

    #[test]
    fn a_priming_line_above_the_first_layer_is_no_layer() {
        let mut layers = Layers::default();
        let part = |z: f32| Node { kind: Kind::Print, position_mm: [50.0, 0.0, z], ..Node::default() };
        let travel = |z: f32| Node { position_mm: [0.0, 0.0, z], ..Node::default() };
        let mut found = Vec::new();
        for z in [0.3, 0.2, 0.4] {
            found.push((layers.note(&travel(z), &part(z)), layers.take_beginning()));
        }
        assert_eq!(found, [(0, false), (0, true), (1, false)]);
    }

    #[test]
    fn a_spiral_has_a_layer_for_each_turn() {
        let found = layers(spiral(10));
        assert_eq!(found.last(), Some(&9));
        for (part, layer) in found.iter().enumerate() {
            let turn = part as f64 / 100.0;
            assert!((turn - f64::from(*layer) - 0.5).abs() < 0.56, "part {part} is in layer {layer}");
        }
    }

    /// Three waves on top of each other, each with a way back to its beginning.
    #[test]
    fn waves_on_top_of_each_other_are_layers() {
        let wave = |layer: u16| {
            (0..=200_u16).map(move |part| {
                let x = f32::from(part % 101) * 0.5;
                let y = f32::from(part / 101) * 3.0;
                let z = 0.5 + (x * 0.3).sin() + 0.3 * f32::from(layer);
                (part % 101 != 0, [x, y, z])
            })
        };
        let found = layers((0..3).flat_map(wave));
        assert_eq!([100, 300, 550].map(|part| found[part]), [0, 1, 2]);
        assert_eq!(found.last(), Some(&2));
    }
}
