//! M206: the G-code's coordinates of home, as an offset from the profile's.

use ferrostep_gcode::AxisWords;

use crate::error::CommandError;
use crate::motion::axis_names::AXIS_NAMES;
use crate::motion::length::mm;
use crate::ports::{Ports, Replies};
use crate::printer::Printer;
use crate::settings::bounds::{LARGEST_MM, within};

impl<P: Ports> Printer<'_, P> {
    /// Executes M206. It shifts coordinates at once, and so does every later homing.
    pub(crate) fn home_offset(&mut self, words: &AxisWords) -> Result<(), CommandError> {
        let words = [words.x, words.y, words.z];
        let mut offset_10nm = self.interpreter.modal.home_offset_10nm;
        if words == [None; 3] {
            let [x, y, z] = offset_10nm.map(mm);
            self.replies.say(format_args!("echo:; Home offset:\necho:  M206 X{x} Y{y} Z{z} ; (mm)"));
            return Ok(());
        }
        const LARGEST_10NM: i64 = LARGEST_MM as i64 * 100_000;
        for (axis, word) in words.into_iter().enumerate() {
            let Some(value) = word else { continue };
            let length_10nm = self.interpreter.modal.length_10nm(value).ok_or(CommandError::TooFar)?;
            offset_10nm[axis] = within(AXIS_NAMES[axis], length_10nm, -LARGEST_10NM, LARGEST_10NM)?;
        }
        self.interpreter.modal.set_home_offset(offset_10nm);
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use crate::{motion::homing::tests::rig::MM, motion::homing::tests::rig::Rig, motion::homing::tests::rig::execute};

    fn logical_mm(printer: &crate::motion::homing::tests::rig::RigPrinter<'_>) -> [i64; 3] {
        let [x, y, z, _] = printer.logical_10nm();
        [x, y, z].map(|length| length / MM)
    }

    #[test]
    fn it_shifts_coordinates_at_once_and_at_every_homing() {
        let rig = Rig::new(|_| {});
        let mut printer = rig.printer();
        for line in ["G28", "M206 X5 Y-3"] {
            execute(&mut printer, line).unwrap();
        }
        assert_eq!(logical_mm(&printer), [5, -3, 0]);
        // The machine position gets another coordinate; soft limits are in machine coordinates.
        execute(&mut printer, "G1 X15 Y-50").unwrap();
        assert_eq!(rig.believed_mm(), [10.0, 0.0, 0.0]);
        for line in ["G92 X100 Y100", "G28"] {
            execute(&mut printer, line).unwrap();
        }
        assert_eq!(logical_mm(&printer), [5, -3, 0]);
        // The new offset replaces the previous one; G92 stays.
        for line in ["G92 X100", "M206 X7"] {
            execute(&mut printer, line).unwrap();
        }
        assert_eq!(logical_mm(&printer), [102, -3, 0]);
    }

    #[test]
    fn it_is_reported_and_refused_beyond_its_range() {
        let rig = Rig::new(|_| {});
        let mut printer = rig.printer();
        execute(&mut printer, "M206 X1.5 Z-0.25").unwrap();
        rig.last_texts();
        execute(&mut printer, "M206").unwrap();
        assert_eq!(rig.last_texts(), ["echo:; Home offset:\necho:  M206 X1.50 Y0.00 Z-0.25 ; (mm)"]);
        // A refused line changes nothing.
        assert!(execute(&mut printer, "M206 X3 Y1000.1").is_err());
        execute(&mut printer, "M206").unwrap();
        assert!(rig.last_texts().concat().contains("X1.50 Y0.00"));
    }
}
