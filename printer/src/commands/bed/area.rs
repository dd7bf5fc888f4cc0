//! The measured part of the bed, and the number of its points.

use ferrostep_gcode::{BedArea, Decimal};
use ferrostep_planner::surface::MeshGrid;

use crate::error::CommandError;
use crate::ports::Ports;
use crate::printer::Printer;
use crate::settings::bounds::within;
use crate::settings::profile::homing::MeshSettings;

/// Narrowest part that can be measured, units of 10 nm: 1 mm.
const MIN_SIZE_10NM: i64 = 100_000;

/// Minimum number of points along a part of the bed: three show its bend.
const MIN_POINTS: u8 = 3;

impl<P: Ports> Printer<'_, P> {
    /// The G-code's coordinates minus those of the bed, which are the axes' of T0.
    pub(super) fn bed_offset_10nm(&self) -> [i64; 2] {
        let ([x, y, _], [of_x, of_y, _]) = (self.interpreter.modal.offset_10nm, self.tool_offset_10nm());
        [x - of_x, y - of_y]
    }

    /// Range in which the probe finds the bed along X or Y, units of 10 nm.
    pub(super) fn reach_10nm(&self, axis: usize) -> [i64; 2] {
        let offset_10nm = self.interpreter.modal.probe_offset_10nm[axis];
        let [bed_from, bed_to] = self.profile.safe_homing.bed_10nm[axis];
        let [lower, upper] = self.interpreter.travel_10nm(axis);
        [bed_from.max(lower + offset_10nm), bed_to.min(upper + offset_10nm)]
    }

    /// The points for a part of the bed: for the given one, otherwise that of M555, otherwise the
    /// profile's.
    #[inline(never)]
    pub(super) fn grid(&self, area: Option<BedArea>, settings: &MeshSettings) -> Result<MeshGrid, CommandError> {
        let mut ends_10nm = settings.area_10nm;
        let mut points = settings.points;
        if let Some(area) = area.or(self.modes.bed_area) {
            let asked_10nm = self.ends_10nm(&area, settings)?;
            for ((points, asked), whole) in points.iter_mut().zip(asked_10nm).zip(&mut ends_10nm) {
                let ([whole_from, whole_to], [from, to]) = (*whole, asked);
                // As closely spaced as on the whole bed.
                let gaps = i64::from(*points) - 1;
                let part = ((to - from) * gaps + (whole_to - whole_from) - 1) / (whole_to - whole_from).max(1) + 1;
                *points = u8::try_from(part).unwrap_or(*points).clamp(MIN_POINTS.min(*points), *points);
                *whole = asked;
            }
        } else {
            // M851 may have moved the probe since the profile was written.
            for (axis, [from, to]) in ends_10nm.iter_mut().enumerate() {
                let [least, most] = self.reach_10nm(axis);
                (*from, *to) = ((*from).clamp(least, most), (*to).clamp(least, most));
            }
        }
        // Within 5 m.
        let ends_10nm = ends_10nm.map(|ends| ends.map(|end| end as i32));
        MeshGrid::over(ends_10nm, points).ok_or(CommandError::TooFar)
    }

    /// The ends of a part along X and Y, machine coordinates, within the probe's reach.
    fn ends_10nm(&self, area: &BedArea, settings: &MeshSettings) -> Result<[[i64; 2]; 2], CommandError> {
        let BedArea { left, right, front, back, is_size } = *area;
        let words = if is_size { [('X', 'W'), ('Y', 'H')] } else { [('L', 'R'), ('F', 'B')] };
        let mut ends_10nm = [[0; 2]; 2];
        for (axis, ((ends, (low, high)), (from, to))) in
            ends_10nm.iter_mut().zip(words).zip([(left, right), (front, back)]).enumerate()
        {
            let length = |word: Decimal| self.interpreter.modal.length_10nm(word).ok_or(CommandError::TooFar);
            // In the G-code's coordinates, like everything that is printed.
            let offset_10nm = self.bed_offset_10nm()[axis];
            let reach_10nm = self.reach_10nm(axis);
            let [least, most] = reach_10nm.map(|end| end + offset_10nm);
            // Ends that are not named.
            let [first, last] =
                settings.area_10nm[axis].map(|end_10nm| end_10nm.clamp(reach_10nm[0], reach_10nm[1]) + offset_10nm);
            let from = match from {
                Some(word) => within(low, length(word)?, least, to.map_or(last, |_| most) - MIN_SIZE_10NM)?,
                None => first,
            };
            let base = if is_size { from } else { 0 };
            let to = match to {
                Some(word) => base + within(high, length(word)?, from + MIN_SIZE_10NM - base, most - base)?,
                None => last,
            };
            *ends = [from - offset_10nm, to - offset_10nm];
        }
        Ok(ends_10nm)
    }
}
