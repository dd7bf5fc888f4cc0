//! M851, M290 and SET_GCODE_OFFSET: the probe's offset, and the height of the nozzle.

use ferrostep_gcode::{AxisWords, Decimal};
use ferrostep_planner::Move;

use crate::error::CommandError;
use crate::motion::axis_names::AXIS_NAMES;
use crate::motion::length::mm;
use crate::ports::{Motion, Ports, Replies};
use crate::printer::Printer;
use crate::settings::bounds::within;
use crate::settings::profile::homing::{HomeSensor, SafeHoming};

/// Units of 10 nm in a millimetre.
const MM: i64 = 100_000;

/// Maximum shift by one M290, and by all since Z was homed, units of 10 nm, either way.
const MAX_SHIFT_AT_ONCE_10NM: i64 = MM;
const MAX_SHIFT_10NM: i64 = 2 * MM;

impl<P: Ports> Printer<'_, P> {
    /// Returns true if the axes go elsewhere than a prepared job expects: M290 has shifted Z, Z
    /// follows the bed, or the axes are skew.
    pub fn is_shifted(&self) -> bool {
        let modal = &self.interpreter.modal;
        modal.z.shift_10nm != 0 || modal.follows_bed || self.is_skew()
    }

    pub(crate) fn has_probe(&self) -> bool {
        self.profile.homing[2].sensor == HomeSensor::Probe
    }

    /// Range of the probe's offset along an axis: the probe must be above the bed where Z homes.
    pub(crate) fn probe_range_10nm(&self, axis: usize) -> [i64; 2] {
        let SafeHoming { home_at_10nm, bed_10nm, .. } = self.profile.safe_homing;
        match (bed_10nm.get(axis), home_at_10nm.unwrap_or_default().get(axis)) {
            (Some([from, to]), Some(place)) => [from - place, to - place],
            _ => SafeHoming::PROBE_Z_10NM,
        }
    }

    /// Executes M851. The new offset applies from the next homing of Z on.
    pub(crate) fn probe_offset(&mut self, words: &AxisWords) -> Result<(), CommandError> {
        self.needs(self.has_probe(), "probe (homing.z.sensor of its profile)")?;
        let words = [words.x, words.y, words.z];
        if words == [None; 3] {
            let [x, y, z] = self.interpreter.modal.probe_offset_10nm.map(mm);
            self.replies.say(format_args!("echo:; Z-Probe Offset:\necho:  M851 X{x} Y{y} Z{z} ; (mm)"));
            return Ok(());
        }
        let mut offset_10nm = self.interpreter.modal.probe_offset_10nm;
        for (axis, word) in words.into_iter().enumerate() {
            let Some(value) = word else { continue };
            let length_10nm = self.interpreter.modal.length_10nm(value).ok_or(CommandError::TooFar)?;
            let [minimum, maximum] = self.probe_range_10nm(axis);
            offset_10nm[axis] = within(AXIS_NAMES[axis], length_10nm, minimum, maximum)?;
        }
        self.probe_finds_home(offset_10nm)?;
        self.interpreter.modal.probe_offset_10nm = offset_10nm;
        Ok(())
    }

    /// Refuses a probe offset that would put the probe beside a round bed where Z homes.
    pub(crate) fn probe_finds_home(&self, [x, y, _]: [i64; 3]) -> Result<(), CommandError> {
        let Some([home_x, home_y]) = self.profile.safe_homing.home_at_10nm else { return Ok(()) };
        self.is_above_bed([home_x + x, home_y + y])
    }

    /// Executes M290: shifts Z under the G-code, whose coordinates stay; the probe's offset is
    /// changed with it unless `keeps_offset` (P0). The shift is a separate move, after those
    /// accepted before.
    pub(crate) async fn shift_z(&mut self, words: &AxisWords, keeps_offset: bool) -> Result<(), CommandError> {
        if words.x.is_some() || words.y.is_some() || words.e.is_some() {
            // Start code for Bambu's X1 contains one, with a Z that would not be a shift either.
            self.replies.note(self.lines.number, format_args!("M290 shifts only Z: with X, Y or E it has no effect"));
            return Ok(());
        }
        if let Some(value) = words.z {
            let by_10nm = self.interpreter.modal.length_10nm(value).ok_or(CommandError::TooFar)?;
            self.shift_z_by(by_10nm, keeps_offset).await?;
        }
        if self.has_probe() {
            let [.., z] = self.interpreter.modal.probe_offset_10nm.map(mm);
            self.replies.say(format_args!("echo:Probe Offset Z{z}"));
        }
        if words.z.is_none() {
            let z = mm(self.interpreter.modal.z.shift_10nm);
            self.replies.say(format_args!("echo:Babystep Z{z}"));
        }
        Ok(())
    }

    /// Executes SET_GCODE_OFFSET: the offset along Z lasts through homing, and the probe's stays.
    /// Without an immediate move, the nozzle follows with its next move along Z: until then the
    /// G-code sees it at another height.
    pub(crate) async fn offset_z(&mut self, offset: Decimal, adds: bool, moves: bool) -> Result<(), CommandError> {
        let before_10nm = self.interpreter.modal.z.offset_10nm;
        let base_10nm = if adds { before_10nm } else { 0 };
        // Klipper's lengths are in mm whatever the G-code's unit.
        let offset_10nm = within('Z', offset.to_10nm_from_mm(), -MAX_SHIFT_10NM, MAX_SHIFT_10NM)?;
        let offset_10nm = within('Z', base_10nm + offset_10nm, -MAX_SHIFT_10NM, MAX_SHIFT_10NM)?;
        let by_10nm = offset_10nm - before_10nm;
        if by_10nm == 0 {
            return Ok(());
        }
        if self.interpreter.modal.in_prepared_job {
            return Err(CommandError::ShiftsNoJob);
        }
        let shift_10nm = self.interpreter.modal.z.shift_10nm;
        within('Z', by_10nm, -MAX_SHIFT_10NM - shift_10nm, MAX_SHIFT_10NM - shift_10nm)?;
        if moves && self.interpreter.modal.homed[2] {
            self.move_by_shift(by_10nm).await?;
        } else {
            self.interpreter.modal.z.shift_10nm = shift_10nm + by_10nm;
            self.interpreter.modal.machine_10nm[2] -= by_10nm;
        }
        self.interpreter.modal.z.offset_10nm = offset_10nm;
        Ok(())
    }

    async fn shift_z_by(&mut self, by_10nm: i64, keeps_offset: bool) -> Result<(), CommandError> {
        if self.interpreter.modal.in_prepared_job {
            return Err(CommandError::ShiftsNoJob);
        }
        if !self.interpreter.modal.homed[2] {
            return Err(CommandError::ShiftsHomedZ);
        }
        within('Z', by_10nm, -MAX_SHIFT_AT_ONCE_10NM, MAX_SHIFT_AT_ONCE_10NM)?;
        // The remainder of the maximum shift, so that the message names an acceptable value.
        let before_10nm = self.interpreter.modal.z.shift_10nm;
        within('Z', by_10nm, -MAX_SHIFT_10NM - before_10nm, MAX_SHIFT_10NM - before_10nm)?;
        let offset_10nm = self.interpreter.modal.probe_offset_10nm[2];
        if self.has_probe() && !keeps_offset {
            let [minimum, maximum] = SafeHoming::PROBE_Z_10NM;
            within('Z', by_10nm, minimum - offset_10nm, maximum - offset_10nm)?;
        }
        self.move_by_shift(by_10nm).await?;
        if self.has_probe() && !keeps_offset {
            self.interpreter.modal.probe_offset_10nm[2] = offset_10nm + by_10nm;
        }
        Ok(())
    }

    /// Shifts Z under the G-code, by a separate move.
    async fn move_by_shift(&mut self, by_10nm: i64) -> Result<(), CommandError> {
        let before_10nm = self.interpreter.modal.z.shift_10nm;
        self.interpreter.modal.z.shift_10nm = before_10nm + by_10nm;
        let target_10nm = self.interpreter.raised(self.interpreter.modal.machine_10nm);
        let feed_mm_per_s = self.motion.limits().max_feed_mm_per_s[2] as f32;
        let request = Move { target_10nm, filament_100pm: 0, feed_mm_per_s, line: self.lines.number, ends_move: false };
        if let Err(error) = self.motion.add(request).await {
            self.interpreter.modal.z.shift_10nm = before_10nm;
            return Err(error.into());
        }
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
