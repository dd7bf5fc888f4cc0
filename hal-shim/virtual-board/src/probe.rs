//! The virtual board's Z probe and the sheet that it looks for.

/// A probe beside the nozzle. It sees the sheet only where it is above it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VirtualProbe {
    /// From the nozzle to the probe along X and Y, units of 10 nm.
    pub offset_10nm: [i64; 2],
    /// The sheet's outline: lower and upper end along X and Y, machine coordinates, units of 10 nm.
    pub sheet_10nm: [[i64; 2]; 2],
}

impl VirtualProbe {
    /// Whether it is above the sheet when the nozzle is here.
    pub fn is_above_sheet(&self, nozzle_10nm: [i64; 3]) -> bool {
        let [x, y, _] = nozzle_10nm;
        let places = [x, y].into_iter().zip(self.offset_10nm).zip(self.sheet_10nm);
        places.into_iter().all(|((nozzle, offset), [from, to])| (from..=to).contains(&(nozzle + offset)))
    }
}
