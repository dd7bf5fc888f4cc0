//! Limits that the surface sets for a motion in the plane because of Z.

/// Largest slope and bend of a surface, from which follows what Z needs for a speed and an
/// acceleration in the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceBounds {
    /// Slope along X and along Y.
    pub slope: [f32; 2],
    /// Largest change of the slope along X and along Y at the border of two cells.
    pub border: [f32; 2],
    /// Largest change of the slope along X for each mm along Y, 1/mm, and the other way round.
    pub twist_per_mm: f32,
    /// Largest change of the correction for each mm of Z, as it fades.
    pub fade: f32,
    /// The share of the correction that fades away for each mm of Z.
    pub fade_per_mm: f32,
}

/// Ends of the grid that a cell is at, along X or along Y. Beyond them its surface continues.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ends {
    pub is_first: bool,
    pub is_last: bool,
    /// Cells by which its surface continues.
    pub beyond: u8,
}

impl Ends {
    /// Ends of cell number `cell` in a row of `points` points.
    pub fn of(cell: u8, points: u8, beyond: u8) -> Self {
        Self { is_first: cell == 0, is_last: cell + 2 >= points, beyond }
    }

    /// Range in which the cell's surface is followed, in cells.
    fn reach(self) -> [f32; 2] {
        let beyond = f32::from(self.beyond);
        [if self.is_first { -beyond } else { 0.0 }, if self.is_last { 1.0 + beyond } else { 1.0 }]
    }
}

fn larger(one: &mut f32, other: f32) {
    if other > *one {
        *one = other;
    }
}

impl SurfaceBounds {
    /// A level surface, or none.
    pub const NONE: Self = Self { slope: [0.0; 2], border: [0.0; 2], twist_per_mm: 0.0, fade: 0.0, fade_per_mm: 0.0 };

    /// The steeper of both slopes.
    pub(super) fn steepest(&self) -> f32 {
        let [x, y] = self.slope;
        if y > x { y } else { x }
    }

    /// Adds a cell: the heights at its corners and at those of its next ones along X and along Y,
    /// and its size, um.
    pub(super) fn add_cell(&mut self, corners: [f32; 4], next: [[f32; 4]; 2], ends: [Ends; 2], [x, y]: [f32; 2]) {
        let (along_x, along_y) = (Slopes::along_x(corners, x), Slopes::along_y(corners, y));
        let ([next_x, next_y], [ends_x, ends_y]) = (next, ends);
        let ([slope_x, slope_y], [border_x, border_y]) = (&mut self.slope, &mut self.border);
        for end in ends_y.reach() {
            larger(slope_x, along_x.at(end).abs());
            // The slope ends at the end of the continued surface.
            let after = if ends_x.is_last { 0.0 } else { Slopes::along_x(next_x, x).at(end) };
            larger(border_x, (after - along_x.at(end)).abs());
            if ends_x.is_first {
                larger(border_x, along_x.at(end).abs());
            }
        }
        for end in ends_x.reach() {
            larger(slope_y, along_y.at(end).abs());
            let after = if ends_y.is_last { 0.0 } else { Slopes::along_y(next_y, y).at(end) };
            larger(border_y, (after - along_y.at(end)).abs());
            if ends_y.is_first {
                larger(border_y, along_y.at(end).abs());
            }
        }
        larger(&mut self.twist_per_mm, ((along_x.upper - along_x.lower) / y).abs());
    }

    /// Converts the twist, which was summed up for each um, to mm.
    pub(super) fn per_mm(&mut self) {
        self.twist_per_mm *= 1000.0;
    }
}

/// Slopes at both sides of a cell.
struct Slopes {
    lower: f32,
    upper: f32,
}

impl Slopes {
    fn along_x([a, b, c, d]: [f32; 4], x: f32) -> Self {
        Self { lower: (b - a) / x, upper: (d - c) / x }
    }

    fn along_y([a, b, c, d]: [f32; 4], y: f32) -> Self {
        Self { lower: (c - a) / y, upper: (d - b) / y }
    }

    /// The height at this share of the path from the lower to the upper side.
    fn at(&self, way: f32) -> f32 {
        self.lower + (self.upper - self.lower) * way
    }
}
