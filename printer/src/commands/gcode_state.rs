//! State in which lines of G-code are read, and an assumed position: for a desk that stands in for
//! macros that a profile lacks. A board's image links none of this.

use ferrostep_gcode::Units;

use crate::error::CommandError;
use crate::motion::modal::KnownZ;
use crate::ports::{Motion, Ports};
use crate::printer::Printer;
use crate::settings::profile::Profile;

/// The state in which the next line is read. Lengths are in units of 10 nm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GcodeState {
    /// Units of the lengths (G20, G21).
    pub units: Units,
    /// X, Y and Z are relative (G91).
    pub is_relative: bool,
    /// E is relative (M83).
    pub is_extruder_relative: bool,
    /// Feed at 100 %, units of 10 nm a minute.
    pub feed_10nm_per_min: i64,
    /// Percentage of the feed (M220).
    pub feed_percent: u16,
    /// Percentage of the filament (M221).
    pub flow_percent: u16,
    /// Values of X, Y, Z and E in the G-code.
    pub logical_10nm: [i64; 4],
    /// Machine position of X, Y and Z that the G-code asks for.
    pub machine_10nm: [i64; 3],
    /// The axes that are homed.
    pub homed: [bool; 3],
    /// Offset of Z by SET_GCODE_OFFSET.
    pub z_offset_10nm: i64,
    /// Minimum temperature of a nozzle that extrudes, degrees Celsius (M302).
    pub min_extrusion_celsius: f32,
}

impl GcodeState {
    /// Returns true if lengths are in inches (G20).
    pub fn is_in_inches(&self) -> bool {
        self.units == Units::Inches
    }
}

impl<'a, P: Ports> Printer<'a, P> {
    /// Returns the state in which the next line is read.
    pub fn gcode_state(&self) -> GcodeState {
        let modal = &self.interpreter.modal;
        GcodeState {
            units: modal.units,
            is_relative: modal.relative,
            is_extruder_relative: modal.relative_extruder,
            feed_10nm_per_min: modal.feed_10nm_per_min,
            feed_percent: modal.feed_percent,
            flow_percent: modal.flow_percent,
            logical_10nm: modal.logical_10nm(),
            machine_10nm: modal.machine_10nm,
            homed: modal.homed,
            z_offset_10nm: modal.z.offset_10nm,
            min_extrusion_celsius: modal.min_extrusion_celsius,
        }
    }

    /// The machine.
    pub fn profile(&self) -> &'a Profile {
        self.profile
    }

    /// Marks the machine as homed, with the nozzle at a machine position or, outside the travel, at
    /// the nearest end. No axis moves. An offset of SET_GCODE_OFFSET stays, as in homing.
    ///
    /// # Errors
    /// Motion was stopped before.
    pub async fn take_place(&mut self, machine_10nm: [i64; 3]) -> Result<(), CommandError> {
        self.motion.finish().await?;
        let trigger_10nm = self.interpreter.trigger_10nm(2);
        let modal = &mut self.interpreter.modal;
        (modal.homed, modal.failed_home, modal.lost, modal.lift_10nm) = ([true; 3], [false; 3], [false; 3], 0);
        let offset_10nm = modal.z.offset_10nm;
        modal.z =
            KnownZ { trigger_10nm: Some(trigger_10nm), shift_10nm: offset_10nm, offset_10nm, ..KnownZ::default() };
        let mut inside_10nm = machine_10nm;
        self.interpreter.clamp_into(&mut inside_10nm, 0, &mut [false; 3]);
        self.interpreter.modal.machine_10nm = inside_10nm;
        self.motion.set_position(self.interpreter.raised(inside_10nm));
        Ok(())
    }
}
