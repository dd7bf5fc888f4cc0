//! The measured mesh: heights of the bed at the points of a grid.

use super::bounds::{Ends, SurfaceBounds};
use crate::kinematics::UNITS_PER_MM;

/// Maximum number of points along X and along Y.
pub const MAX_MESH_POINTS: usize = 15;

/// Points of the largest mesh.
const MAX_POINTS: usize = MAX_MESH_POINTS * MAX_MESH_POINTS;

/// A point without a height.
const UNKNOWN: i16 = i16::MIN;

/// The greatest slope of a mesh, either way along X and along Y. A bed that is steeper is crooked,
/// or a point was measured wrong.
pub(super) const MAX_SLOPE: f32 = 0.05;

/// Minimum fade height as a multiple of the greatest height: the nozzle then rises with Z
/// everywhere.
const LEAST_FADE: f32 = 4.0;

/// Units of 10 nm in a micrometre.
pub(super) const UM_10NM: f32 = 100.0;

/// Reason why Z cannot follow a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MeshError {
    /// The mesh is missing, or some of its points have no heights.
    Incomplete,
    /// The bed rises or falls too steeply between two points.
    TooSteep {
        /// The slope, mm for each mm.
        slope: f32,
        /// The greatest that Z can follow.
        maximum: f32,
    },
    /// Z shares a motor with another axis.
    SharedMotor,
    /// The correction fades away too soon for its height.
    FadesTooSoon {
        /// The least height at which it may be gone, units of 10 nm.
        least_10nm: i32,
    },
}

/// Places of a mesh's points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MeshGrid {
    /// The first point: machine coordinates X and Y, units of 10 nm.
    pub from_10nm: [i32; 2],
    /// Distance between neighbouring points along X and along Y, units of 10 nm, above 0.
    pub spacing_10nm: [i32; 2],
    /// Number of points along X and along Y, 2 to [`MAX_MESH_POINTS`].
    pub points: [u8; 2],
}

impl MeshGrid {
    /// No points.
    pub const NONE: Self = Self { from_10nm: [0; 2], spacing_10nm: [1; 2], points: [0; 2] };

    /// Points between the ends of an area along X and along Y, units of 10 nm, the first and the
    /// last of them at the ends, less than 0.2 um beside the upper one; `None`: too many or too few
    /// points, or an area without size.
    pub fn over(area_10nm: [[i32; 2]; 2], points: [u8; 2]) -> Option<Self> {
        let mut grid = Self { from_10nm: area_10nm.map(|[from, _]| from), spacing_10nm: [0; 2], points };
        for ((spacing, points), [from, to]) in grid.spacing_10nm.iter_mut().zip(points).zip(area_10nm) {
            if !(2..=MAX_MESH_POINTS).contains(&usize::from(points)) {
                return None;
            }
            *spacing = to.checked_sub(from)?.checked_div(i32::from(points) - 1)?;
            if *spacing <= 0 {
                return None;
            }
        }
        Some(grid)
    }

    /// The machine coordinates of a point, units of 10 nm.
    pub fn place_10nm(&self, [column, row]: [u8; 2]) -> [i32; 2] {
        let ([from_x, from_y], [x, y]) = (self.from_10nm, self.spacing_10nm);
        // The sums are within the area.
        let along = |from: i32, spacing: i32, index: u8| from.wrapping_add(spacing.wrapping_mul(i32::from(index)));
        [along(from_x, x, column), along(from_y, y, row)]
    }
}

/// Surface between the measured points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MeshInterpolation {
    /// Bilinear.
    #[default]
    Bilinear,
    /// Bilinear between more points, whose heights are those of cubic curves through the measured
    /// ones: as many as a mesh may have.
    Bicubic,
}

impl MeshInterpolation {
    /// Into how many parts the distance of two of this many measured points is divided.
    const fn parts(self, points: u8) -> u8 {
        match (self, points) {
            // A curve through two points is straight.
            (Self::Bicubic, 3..) => max(1, (MAX_MESH_POINTS as u8 - 1) / (points - 1)),
            _ => 1,
        }
    }
}

const fn max(one: u8, other: u8) -> u8 {
    if other > one { other } else { one }
}

/// Heights at the points of a grid, and up to which height of the nozzle Z follows them.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// The measured points.
    grid: MeshGrid,
    /// Into how many parts their distance along X and along Y is divided.
    parts: [u8; 2],
    interpolation: MeshInterpolation,
    /// Row by row, um: of all points, the measured ones and those between them.
    heights_um: [i16; MAX_POINTS],
    fade_10nm: i32,
}

impl Mesh {
    /// No points; the correction does not fade.
    pub const NONE: Self = Self {
        grid: MeshGrid::NONE,
        parts: [1; 2],
        interpolation: MeshInterpolation::Bilinear,
        heights_um: [UNKNOWN; MAX_POINTS],
        fade_10nm: 0,
    };

    /// Surface between the measured points.
    pub fn interpolation(&self) -> MeshInterpolation {
        self.interpolation
    }

    /// The grid of the measured points.
    pub fn grid(&self) -> MeshGrid {
        self.grid
    }

    /// Takes a grid, whose points have no heights, and what the surface will be between them.
    pub fn begin(&mut self, grid: &MeshGrid, interpolation: MeshInterpolation) {
        self.grid = *grid;
        self.interpolation = interpolation;
        self.parts = grid.points.map(|points| interpolation.parts(points));
        self.heights_um = [UNKNOWN; MAX_POINTS];
    }

    /// Height of the nozzle at which the correction has faded away, units of 10 nm; 0:
    /// it does not fade.
    pub fn fade_10nm(&self) -> i32 {
        self.fade_10nm
    }

    /// Lets the correction fade away up to this height, units of 10 nm; 0: it does not fade.
    pub fn set_fade_10nm(&mut self, fade_10nm: i32) {
        self.fade_10nm = fade_10nm.max(0);
    }

    /// Number of points along X and along Y, with those between the measured ones.
    pub(super) fn points(&self) -> [u8; 2] {
        let ([columns, rows], [across, along]) = (self.grid.points, self.parts);
        [(columns, across), (rows, along)].map(|(points, parts)| match points.checked_sub(1) {
            // The product is at most 14.
            Some(gaps) => gaps.wrapping_mul(parts).wrapping_add(1),
            None => 0,
        })
    }

    /// Distance between neighbours among all points along X and along Y, units of 10 nm.
    pub(super) fn spacing_10nm(&self) -> [f32; 2] {
        let ([x, y], [across, along]) = (self.grid.spacing_10nm, self.parts);
        [(x, across), (y, along)].map(|(spacing, parts)| spacing as f32 / f32::from(parts))
    }

    /// Cells by which the surface continues beyond the outermost points along X and along Y: one
    /// distance of measured points.
    pub(super) fn beyond(&self) -> [u8; 2] {
        self.parts
    }

    /// Index of a measured point's height; `None` outside the grid.
    fn index(&self, [column, row]: [u8; 2]) -> Option<usize> {
        let ([columns, rows], [across, along]) = (self.grid.points, self.parts);
        let is_one = column < columns && row < rows;
        is_one.then(|| self.index_of_any([column.wrapping_mul(across), row.wrapping_mul(along)]))
    }

    /// Index of any point's height.
    fn index_of_any(&self, [column, row]: [u8; 2]) -> usize {
        let [columns, _] = self.points();
        usize::from(row) * usize::from(columns) + usize::from(column)
    }

    /// Height at a measured point, um; `None` for a point without a height, or outside the mesh.
    pub fn height_um(&self, point: [u8; 2]) -> Option<i16> {
        let height = self.heights_um.get(self.index(point)?).copied()?;
        (height != UNKNOWN).then_some(height)
    }

    /// Sets the height at a measured point, um; returns `false` if the point does not exist.
    pub fn set_height_um(&mut self, point: [u8; 2], height_um: i16) -> bool {
        let place = self.index(point).and_then(|index| self.heights_um.get_mut(index));
        place.map(|place| *place = height_um.max(UNKNOWN + 1)).is_some()
    }

    /// Gives the points between the measured ones their heights, first along X, then along Y.
    pub(super) fn refine(&mut self) {
        let ([columns, rows], [across, along]) = (self.points(), self.parts);
        if self.parts == [1; 2] || !self.is_complete() {
            return;
        }
        for row in (0..rows).step_by(along.into()) {
            let first = self.index_of_any([0, row]);
            self.refine_line(Line { first, stride: 1, points: columns, parts: across });
        }
        for column in 0..columns {
            self.refine_line(Line { first: column.into(), stride: columns.into(), points: rows, parts: along });
        }
    }

    fn refine_line(&mut self, line: Line) {
        let Line { first, stride, points, parts } = line;
        let at = |mesh: &Self, point: u8| {
            let height = mesh.heights_um.get(first + stride * usize::from(point)).copied();
            height.map_or(0.0, f32::from)
        };
        let last = points.saturating_sub(1);
        for from in (0..last).step_by(parts.into()) {
            let to = from.wrapping_add(parts);
            let (start, end) = (at(self, from), at(self, to));
            let before = from.checked_sub(parts).map(|point| at(self, point));
            let after = to.checked_add(parts).filter(|point| *point <= last).map(|point| at(self, point));
            // Beyond an end the curve continues as the parabola through the last three points.
            let (before, after) = match (before, after) {
                (Some(before), Some(after)) => (before, after),
                (Some(before), None) => (before, before - 3.0 * start + 3.0 * end),
                (None, Some(after)) => (after - 3.0 * end + 3.0 * start, after),
                (None, None) => (2.0 * start - end, 2.0 * end - start),
            };
            for part in 1..parts {
                let share = f32::from(part) / f32::from(parts);
                let height = catmull_rom([before, start, end, after], share);
                let index = first + stride * usize::from(from.wrapping_add(part));
                if let Some(place) = self.heights_um.get_mut(index) {
                    let least = i32::from(UNKNOWN) + 1;
                    *place = round(height).clamp(least, i16::MAX.into()) as i16;
                }
            }
        }
    }

    /// True if there is a mesh and every point of it has its height.
    pub fn is_complete(&self) -> bool {
        let [columns, rows] = self.grid.points;
        columns > 0 && (0..rows).all(|row| (0..columns).all(|column| self.height_um([column, row]).is_some()))
    }

    /// The greatest height of the surface, including its continuation beyond the grid, units of
    /// 10 nm; at least 0.
    pub fn highest_10nm(&self) -> i32 {
        let ([columns, rows], [beyond_x, beyond_y]) = (self.points(), self.beyond().map(i32::from));
        let mut most = 0;
        for row in 0..rows {
            for column in 0..columns {
                // Neighbour towards the middle, and how many cells the surface
                // continues away from it.
                let (right, by_x) = outwards(column, columns, beyond_x);
                let (back, by_y) = outwards(row, rows, beyond_y);
                let [here, beside, behind, across] =
                    [[column, row], [right, row], [column, back], [right, back]].map(|point| self.any_um(point));
                let (along_x, along_y) = (by_x * (here - beside), by_y * (here - behind));
                let twist = by_x * by_y * (here - beside - behind + across);
                let corner = here + along_x + along_y + twist;
                most = most.max(here).max(here + along_x).max(here + along_y).max(corner);
            }
        }
        most * UM_10NM as i32
    }

    /// The height at any point, um; 0 where it has none.
    fn any_um(&self, point: [u8; 2]) -> i32 {
        let height = self.heights_um.get(self.index_of_any(point)).copied();
        height.filter(|height| *height != UNKNOWN).map_or(0, i32::from)
    }

    /// The height that is farthest from 0, um.
    fn farthest_um(&self) -> f32 {
        let heights = self.heights_um.iter().filter(|height| **height != UNKNOWN);
        heights.fold(0, |farthest, height| height.unsigned_abs().max(farthest)).into()
    }

    /// The heights at the corners of a cell, um: along X, then along Y.
    pub(super) fn corners_um(&self, [column, row]: [u8; 2]) -> [f32; 4] {
        let [columns, rows] = self.points();
        [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[right, back]: [u8; 2]| {
            let point @ [column, row] = [column.wrapping_add(right), row.wrapping_add(back)];
            if column < columns && row < rows { self.any_um(point) as f32 } else { 0.0 }
        })
    }

    /// Height of the surface at a place, X and Y in units of 10 nm, where nothing has faded; mm.
    pub fn height_mm(&self, [x, y]: [f64; 2]) -> f64 {
        let ([from_x, from_y], [columns, rows]) = (self.grid.from_10nm, self.points());
        let ([per_x, per_y], [beyond_x, beyond_y]) = (self.spacing_10nm(), self.beyond());
        let (column, right) = cell((x - f64::from(from_x)) as f32 / per_x, columns, beyond_x);
        let (row, back) = cell((y - f64::from(from_y)) as f32 / per_y, rows, beyond_y);
        let [a, b, c, d] = self.corners_um([column, row]);
        let (front, behind) = (a + (b - a) * right, c + (d - c) * right);
        f64::from(front + (behind - front) * back) / 1000.0
    }

    /// Largest slopes and bends of the surface.
    ///
    /// # Errors
    /// [`MeshError`].
    pub(super) fn bounds(&self, max_slope: f32) -> Result<SurfaceBounds, MeshError> {
        if !self.is_complete() {
            return Err(MeshError::Incomplete);
        }
        let spacing_um = self.spacing_10nm().map(|spacing| spacing / UM_10NM);
        let mut bounds = SurfaceBounds::NONE;
        let ([columns, rows], [beyond_x, beyond_y]) = (self.points(), self.beyond());
        for row in 0..rows - 1 {
            for column in 0..columns - 1 {
                let ends = [Ends::of(column, columns, beyond_x), Ends::of(row, rows, beyond_y)];
                let after = |right: u8, back: u8| self.corners_um([column.wrapping_add(right), row.wrapping_add(back)]);
                bounds.add_cell(self.corners_um([column, row]), [after(1, 0), after(0, 1)], ends, spacing_um);
            }
        }
        let slope = bounds.steepest();
        if slope > max_slope {
            return Err(MeshError::TooSteep { slope, maximum: max_slope });
        }
        let fade_10nm = self.fade_10nm as f32;
        let least_10nm = LEAST_FADE * self.farthest_um() * UM_10NM;
        if self.fade_10nm > 0 {
            if fade_10nm < least_10nm {
                return Err(MeshError::FadesTooSoon { least_10nm: least_10nm as i32 });
            }
            // Beyond the grid the surface continues by at most a cell.
            bounds.fade = self.farthest_beyond_um(&bounds) * UM_10NM / fade_10nm;
            bounds.fade_per_mm = UNITS_PER_MM as f32 / fade_10nm;
        }
        bounds.per_mm();
        Ok(bounds)
    }

    /// The height that is farthest from 0 up to a cell beyond the grid, um, or more.
    fn farthest_beyond_um(&self, bounds: &SurfaceBounds) -> f32 {
        let [x, y] = self.grid.spacing_10nm.map(|spacing| spacing as f32 / UM_10NM);
        let [along_x, along_y] = bounds.slope;
        self.farthest_um() + along_x * x + along_y * y
    }
}

/// Points in a row or a column, the measured ones and those between them.
struct Line {
    /// Index of the first height, and distance to that of the next.
    first: usize,
    stride: usize,
    points: u8,
    parts: u8,
}

/// Neighbour of a point towards the middle of a row of `points`, and how many cells to extrapolate
/// outwards (0 except at the ends).
fn outwards(point: u8, points: u8, beyond: i32) -> (u8, i32) {
    match point {
        0 => (1, beyond),
        _ if point.saturating_add(1) == points => (point.wrapping_sub(1), beyond),
        _ => (point, 0),
    }
}

/// Cell of a place, in cells from the first point, and the position within it: up to `beyond` cells
/// outside the grid the outermost cell continues, and from there the surface is level.
pub(super) fn cell(place: f32, points: u8, beyond: u8) -> (u8, f32) {
    let last = points.saturating_sub(2);
    let beyond = f32::from(beyond);
    let (least, most) = (-beyond, f32::from(last) + 1.0 + beyond);
    let place = if place < least {
        least
    } else if place > most {
        most
    } else {
        place
    };
    // The cast makes negative numbers and NaN 0.
    let cell = (place as u8).min(last);
    (cell, place - f32::from(cell))
}

/// The cubic curve between the second and the third of four heights at even distances, whose
/// slope at each is that from its neighbour to its neighbour (Catmull and Rom 1974), at this
/// share of the distance.
fn catmull_rom([before, start, end, after]: [f32; 4], share: f32) -> f32 {
    let linear = end - before;
    let square = 2.0 * before - 5.0 * start + 4.0 * end - after;
    let cubic = 3.0 * (start - end) + after - before;
    start + 0.5 * share * (linear + share * (square + share * cubic))
}

fn round(x: f32) -> i32 {
    (if x < 0.0 { x - 0.5 } else { x + 0.5 }) as i32
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_fade_allows_for_the_height_a_cell_beyond_the_grid() {
        let mut mesh = Mesh::NONE;
        mesh.begin(&MeshGrid::over([[0, 10_000_000]; 2], [3, 3]).unwrap(), MeshInterpolation::Bilinear);
        // 2 um a millimetre along X, 1 um along Y.
        for (row, row_um) in (0..3).zip([0, 50, 100]) {
            for (column, column_um) in (0..3).zip([0, 100, 200]) {
                assert!(mesh.set_height_um([column, row], row_um + column_um));
            }
        }
        mesh.set_fade_10nm(1_000_000);
        let bounds = mesh.bounds(MAX_SLOPE).unwrap();
        // 450 um at the corner a cell beyond, of 10 mm.
        assert!((bounds.fade - 0.045).abs() < 1e-6, "{bounds:?}");
    }
}
