//! The surface, worked out apart.

use ferrostep_planner::surface::{Mesh, MeshInterpolation};

use crate::surface::machine::{MM, Machine};

/// The surface in double precision, with nothing of the code that is tested but the mesh's heights.
pub struct Surface<'a> {
    mesh: &'a Mesh,
    /// Into how many parts the distances of its points are divided.
    parts: [u8; 2],
    /// Row by row, um.
    heights_um: Vec<Vec<f64>>,
    pub steps_per_mm: f64,
}

/// Heights at even distances, and between each two `parts` - 1 more on the cubic curves that have
/// there the mean of the slopes to both neighbours (at the ends the slope of the parabola through
/// three): Hermite's form. As the mesh has them, to a um.
fn curve(heights: &[f64], parts: u8) -> Vec<f64> {
    let last = heights.len() - 1;
    let slope = |at: usize| match at {
        _ if last == 1 => heights[1] - heights[0],
        0 => -1.5 * heights[0] + 2.0 * heights[1] - 0.5 * heights[2],
        _ if at == last => 1.5 * heights[last] - 2.0 * heights[last - 1] + 0.5 * heights[last - 2],
        _ => (heights[at + 1] - heights[at - 1]) / 2.0,
    };
    let mut all = Vec::new();
    for at in 0..last {
        for part in 0..parts {
            let t = f64::from(part) / f64::from(parts);
            let (from, to) = (heights[at], heights[at + 1]);
            let bend = (2.0 * t * t * t - 3.0 * t * t + 1.0) * from + (3.0 * t * t - 2.0 * t * t * t) * to;
            let leave = (t * t * t - 2.0 * t * t + t) * slope(at) + (t * t * t - t * t) * slope(at + 1);
            all.push((bend + leave).round());
        }
    }
    all.push(heights[last]);
    all
}

impl<'a> Surface<'a> {
    pub fn new(mesh: &'a Mesh, machine: &Machine) -> Self {
        let [columns, rows] = mesh.grid().points;
        let parts = if mesh.interpolation() == MeshInterpolation::Bicubic {
            [columns, rows].map(|points| if points < 3 { 1 } else { (14 / (points - 1)).max(1) })
        } else {
            [1; 2]
        };
        let measured = (0..rows).map(|row| {
            let heights: Vec<_> = (0..columns).map(|column| mesh.height_um([column, row]).unwrap().into()).collect();
            curve(&heights, parts[0])
        });
        let measured: Vec<_> = measured.collect();
        let columns = (0..measured[0].len()).map(|column| {
            let heights: Vec<_> = measured.iter().map(|row| row[column]).collect();
            curve(&heights, parts[1])
        });
        let columns: Vec<_> = columns.collect();
        let heights_um = (0..columns[0].len()).map(|row| columns.iter().map(|column| column[row]).collect()).collect();
        Self { mesh, parts, heights_um, steps_per_mm: machine.steps_per_mm[2] }
    }

    /// Height at a place, mm; the outermost cells continue for one cell beyond the grid.
    pub fn height_mm(&self, place_mm: [f64; 2]) -> f64 {
        let grid = self.mesh.grid();
        let cells = [0, 1].map(|axis| {
            let parts = f64::from(self.parts[axis]);
            let cells = f64::from(grid.points[axis] - 1) * parts;
            let at =
                (place_mm[axis] * MM as f64 - f64::from(grid.from_10nm[axis])) / f64::from(grid.spacing_10nm[axis]);
            let at = (at * parts).clamp(-parts, cells + parts);
            let cell = at.floor().clamp(0.0, cells - 1.0);
            (cell as usize, at - cell)
        });
        let [(column, t), (row, v)] = cells;
        let at = |right: usize, back: usize| self.heights_um[row + back][column + right] / 1000.0;
        at(0, 0) * (1.0 - t) * (1.0 - v) + at(1, 0) * t * (1.0 - v) + at(0, 1) * (1.0 - t) * v + at(1, 1) * t * v
    }

    /// Height of the surface that is left at a height of the plan, in steps of Z.
    pub fn height_steps(&self, place_mm: [f64; 2], z_mm: f64) -> f64 {
        let fade_mm = f64::from(self.mesh.fade_10nm()) / MM as f64;
        let left = if fade_mm > 0.0 { (1.0 - z_mm / fade_mm).clamp(0.0, 1.0) } else { 1.0 };
        self.height_mm(place_mm) * left * self.steps_per_mm
    }
}
