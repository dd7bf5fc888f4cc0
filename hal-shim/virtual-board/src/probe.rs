//! The virtual board's Z probe and the sheet that it looks for.

/// The sheet's shape, and how well a probe finds it. Lengths in units of 10 nm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SheetShape {
    /// Rise from the lower to the upper end along X and along Y.
    pub tilt_10nm: [i64; 2],
    /// Height that is added everywhere.
    pub height_10nm: i64,
    /// Rise of the corners at the lower ends of X and Y and at both upper ends, and fall
    /// of the two others.
    pub twist_10nm: i64,
    /// Rise of the middle above the corners of the outline.
    pub bend_10nm: i64,
    /// Each approach ends within this distance of the sheet, evenly distributed.
    pub scatter_10nm: i64,
}

impl SheetShape {
    /// Level and flat, and found exactly.
    pub const FLAT: Self = Self { tilt_10nm: [0; 2], height_10nm: 0, twist_10nm: 0, bend_10nm: 0, scatter_10nm: 0 };

    /// The height at a place of a sheet with this outline, over its middle's if it were not bent.
    pub fn height_10nm(&self, place_10nm: [i64; 2], outline_10nm: [[i64; 2]; 2]) -> i64 {
        let mut height = (self.height_10nm + self.bend_10nm) as f64;
        let mut twist = self.twist_10nm as f64;
        for ((place, [from, to]), tilt) in place_10nm.into_iter().zip(outline_10nm).zip(self.tilt_10nm) {
            // From -1 to 1 over the sheet.
            let across = (2 * place - from - to) as f64 / (to - from).max(1) as f64;
            height += across * tilt as f64 / 2.0 - across * across * self.bend_10nm as f64 / 2.0;
            twist *= across;
        }
        (height + twist) as i64
    }
}

/// Width of the sheet beyond each end of the bed, units of 10 nm: sheets are cut some tenths larger
/// than the part that is printed on, and homing by stall finds its place to some hundredths.
const SHEET_EDGE_10NM: i64 = 50_000;

/// A probe beside the nozzle. It sees the sheet only where it is above it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VirtualProbe {
    /// Offset from the nozzle to the probe along X and Y, units of 10 nm.
    pub offset_10nm: [i64; 2],
    /// The part of the sheet that is printed on: lower and upper end along X and Y, machine
    /// coordinates, units of 10 nm. The sheet is half a millimetre larger on each side.
    pub sheet_10nm: [[i64; 2]; 2],
    /// Shape of the sheet.
    pub shape: SheetShape,
}

impl VirtualProbe {
    /// Place of the probe when the nozzle is here.
    fn place_10nm(&self, [x, y, _]: [i64; 3]) -> [i64; 2] {
        let [offset_x, offset_y] = self.offset_10nm;
        [x + offset_x, y + offset_y]
    }

    /// True if the probe is above the sheet when the nozzle is here.
    pub fn is_above_sheet(&self, nozzle_10nm: [i64; 3]) -> bool {
        let places = self.place_10nm(nozzle_10nm).into_iter().zip(self.sheet_10nm);
        places.into_iter().all(|(place, [from, to])| (from - SHEET_EDGE_10NM..=to + SHEET_EDGE_10NM).contains(&place))
    }

    /// Height of the sheet below the probe when the nozzle is here.
    pub fn sheet_height_10nm(&self, nozzle_10nm: [i64; 3]) -> i64 {
        self.shape.height_10nm(self.place_10nm(nozzle_10nm), self.sheet_10nm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sheet_is_half_a_millimetre_larger_than_the_bed() {
        let probe = VirtualProbe { offset_10nm: [0; 2], sheet_10nm: [[0, 18_000_000]; 2], shape: SheetShape::FLAT };
        for (place, is_above) in [(-6_000, true), (-50_000, true), (-50_001, false), (18_050_000, true)] {
            assert_eq!(probe.is_above_sheet([place, 9_000_000, 0]), is_above, "{place}");
            assert_eq!(probe.is_above_sheet([9_000_000, place, 0]), is_above, "{place}");
        }
    }

    #[test]
    fn a_sheet_is_tilted_and_bent() {
        let shape = SheetShape { tilt_10nm: [1_000, -400], bend_10nm: 600, ..SheetShape::FLAT };
        let outline = [[0, 10_000], [-2_000, 2_000]];
        for (place, height) in [
            ([5_000, 0], 600),
            ([0, 0], -500 + 300),
            ([10_000, 0], 500 + 300),
            ([10_000, 2_000], 500 - 200),
            ([5_000, -2_000], 300 + 200),
        ] {
            assert_eq!(shape.height_10nm(place, outline), height, "{place:?}");
        }
        let twisted = SheetShape { height_10nm: 50, twist_10nm: 200, ..SheetShape::FLAT };
        for (place, height) in
            [([0, -2_000], 250), ([10_000, 2_000], 250), ([10_000, -2_000], -150), ([5_000, 2_000], 50)]
        {
            assert_eq!(twisted.height_10nm(place, outline), height, "{place:?}");
        }
        assert_eq!(SheetShape::FLAT.height_10nm([77, 5], outline), 0);
    }
}
