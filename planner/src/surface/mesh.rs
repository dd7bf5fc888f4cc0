//! The measured mesh: heights of the bed at the points of a grid.

use super::bounds::{Ends, SurfaceBounds};
use crate::kinematics::UNITS_PER_MM;

/// Most points along X and along Y.
pub const MAX_MESH_POINTS: usize = 15;

/// Points of the largest mesh.
const MAX_POINTS: usize = MAX_MESH_POINTS * MAX_MESH_POINTS;

/// A point without a height.
const UNKNOWN: i16 = i16::MIN;

/// The greatest slope of a mesh, either way along X and along Y. A bed that is steeper is crooked, or a point was measured wrong.
pub(super) const MAX_SLOPE: f32 = 0.05;

/// So many times the greatest height is the least height at which a correction may have faded away: the nozzle rises with Z
/// everywhere.
const LEAST_FADE: f32 = 4.0;

/// Units of 10 nm in a micrometre.
pub(super) const UM_10NM: f32 = 100.0;

/// Why Z cannot follow a mesh.
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
    /// Z has no motor of its own.
    SharedMotor,
    /// The correction fades away too soon for its height.
    FadesTooSoon {
        /// The least height at which it may be gone, units of 10 nm.
        least_10nm: i32,
    },
}

/// Where the points of a mesh are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MeshGrid {
    /// The first point: machine coordinates X and Y, units of 10 nm.
    pub from_10nm: [i32; 2],
    /// From one point to the next along X and along Y, units of 10 nm, above 0.
    pub spacing_10nm: [i32; 2],
    /// How many there are along X and along Y, 2 to [`MAX_MESH_POINTS`].
    pub points: [u8; 2],
}

impl MeshGrid {
    /// No points.
    pub const NONE: Self = Self { from_10nm: [0; 2], spacing_10nm: [1; 2], points: [0; 2] };

    /// Points between the ends of an area along X and along Y, units of 10 nm, the first and the last of them at the ends, less than
    /// 0.2 um beside the upper one; `None`: too many or too few points, or an area without size.
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
        // Within the area.
        let along = |from: i32, spacing: i32, index: u8| from.wrapping_add(spacing.wrapping_mul(i32::from(index)));
        [along(from_x, x, column), along(from_y, y, row)]
    }
}

/// Heights at the points of a grid, and up to which height of the nozzle Z follows them.
#[derive(Clone, Debug)]
pub struct Mesh {
    grid: MeshGrid,
    /// Row by row, um.
    heights_um: [i16; MAX_POINTS],
    fade_10nm: i32,
}

impl Mesh {
    /// No points; the correction does not fade.
    pub const NONE: Self = Self { grid: MeshGrid::NONE, heights_um: [UNKNOWN; MAX_POINTS], fade_10nm: 0 };

    /// The grid.
    pub fn grid(&self) -> MeshGrid {
        self.grid
    }

    /// Takes a grid, whose points have no heights.
    pub fn begin(&mut self, grid: &MeshGrid) {
        self.grid = *grid;
        self.heights_um = [UNKNOWN; MAX_POINTS];
    }

    /// At which height of the nozzle the correction has faded away, units of 10 nm; 0: it does not fade.
    pub fn fade_10nm(&self) -> i32 {
        self.fade_10nm
    }

    /// Lets the correction fade away up to this height, units of 10 nm; 0: it does not fade.
    pub fn set_fade_10nm(&mut self, fade_10nm: i32) {
        self.fade_10nm = fade_10nm.max(0);
    }

    fn index(&self, [column, row]: [u8; 2]) -> Option<usize> {
        let [columns, rows] = self.grid.points;
        (column < columns && row < rows).then(|| usize::from(row) * usize::from(columns) + usize::from(column))
    }

    /// The height at a point, um; `None`: it has none, or there is no such point.
    pub fn height_um(&self, point: [u8; 2]) -> Option<i16> {
        let height = self.heights_um.get(self.index(point)?).copied()?;
        (height != UNKNOWN).then_some(height)
    }

    /// Sets the height at a point, um; `false`: there is no such point.
    pub fn set_height_um(&mut self, point: [u8; 2], height_um: i16) -> bool {
        let place = self.index(point).and_then(|index| self.heights_um.get_mut(index));
        place.map(|place| *place = height_um.max(UNKNOWN + 1)).is_some()
    }

    /// Whether there is a mesh, and every point of it has its height.
    pub fn is_complete(&self) -> bool {
        let [columns, rows] = self.grid.points;
        columns > 0 && (0..rows).all(|row| (0..columns).all(|column| self.height_um([column, row]).is_some()))
    }

    /// A height that the surface stays below, also where it goes on beyond the grid, units of 10 nm.
    pub fn highest_10nm(&self) -> i32 {
        let heights = self.heights_um.iter().filter(|height| **height != UNKNOWN).map(|height| i32::from(*height));
        let [least, most] = heights.fold([0; 2], |[least, most], height| [height.min(least), height.max(most)]);
        // A cell beyond a corner, 4 a - 2 b - 2 c + d of the heights of the cell within.
        (most + 4 * (most - least)) * UM_10NM as i32
    }

    /// The height that is farthest from 0, um.
    fn farthest_um(&self) -> f32 {
        let heights = self.heights_um.iter().filter(|height| **height != UNKNOWN);
        heights.fold(0, |farthest, height| height.unsigned_abs().max(farthest)).into()
    }

    /// The heights at the corners of a cell, um: along X, then along Y.
    pub(super) fn corners_um(&self, [column, row]: [u8; 2]) -> [f32; 4] {
        [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[right, back]: [u8; 2]| {
            let height = self.height_um([column.wrapping_add(right), row.wrapping_add(back)]);
            height.map_or(0.0, f32::from)
        })
    }

    /// How steep and how bent the surface is.
    ///
    /// # Errors
    /// [`MeshError`].
    pub(super) fn bounds(&self, max_slope: f32) -> Result<SurfaceBounds, MeshError> {
        if !self.is_complete() {
            return Err(MeshError::Incomplete);
        }
        let spacing_um = self.grid.spacing_10nm.map(|spacing| spacing as f32 / UM_10NM);
        let mut bounds = SurfaceBounds::NONE;
        let [columns, rows] = self.grid.points;
        for row in 0..rows - 1 {
            for column in 0..columns - 1 {
                let ends = [Ends::of(column, columns), Ends::of(row, rows)];
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
            // Beyond the grid the surface goes on by at most a cell.
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
