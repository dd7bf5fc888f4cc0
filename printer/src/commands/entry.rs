//! Entering a prepared job in its middle: the machine stands at the start of a frame, and takes
//! over the settings in force there.

use core::fmt::Write;

use ferrostep_gpre::LimitValues;
use ferrostep_gpre::compact::FrameState;
use ferrostep_hal_shim::FanOutput;
use ferrostep_planner::Limits;

use crate::error::CommandError;
use crate::motion::modal::KnownZ;
use crate::ports::{Motion, Ports};
use crate::printer::Printer;
use crate::settings::bounds::{LARGEST_LIMIT, PERCENTS, SMALLEST_LIMIT};

/// Largest E, offset and lift of a frame, either sign, units of 10 nm: 10 km.
const MAX_10NM: u64 = 1_000_000_000_000;

/// The limit as it was written: the shortest decimal number that rounds to the frame's
/// single-precision value. So a plan is executed with exactly the limits with which it was made.
fn as_written(value: f32) -> f64 {
    let mut text = heapless::String::<64>::new();
    let written = write!(text, "{value}").ok().and_then(|()| text.parse().ok());
    written.unwrap_or(f64::from(value)).clamp(SMALLEST_LIMIT, LARGEST_LIMIT)
}

/// The limits of a frame.
fn limits(values: LimitValues) -> Limits {
    let [vx, vy, vz, ve, ax, ay, az, ae, print, travel, retract, deviation, corners @ ..] = values;
    let [vx, vy, vz, ve] = [vx, vy, vz, ve].map(as_written);
    let [ax, ay, az, ae] = [ax, ay, az, ae].map(as_written);
    let [print, travel, retract, deviation] = [print, travel, retract, deviation].map(as_written);
    Limits {
        max_feed_mm_per_s: [vx, vy, vz, ve],
        max_acceleration_mm_per_s2: [ax, ay, az, ae],
        print_acceleration_mm_per_s2: print,
        travel_acceleration_mm_per_s2: travel,
        retract_acceleration_mm_per_s2: retract,
        junction_deviation_mm: deviation,
        instantaneous_corner_velocity_mm_per_s: corners
            .map(|value| if value.is_finite() { as_written(value) } else { f64::INFINITY }),
    }
}

impl<P: Ports> Printer<'_, P> {
    /// Sets the height of the nozzle, a machine coordinate in units of 10 nm, for a machine that
    /// must not home Z because a print is in the way. Z then counts as homed.
    ///
    /// # Errors
    /// Motion was stopped, or the height is outside this machine's travel.
    pub async fn take_height(&mut self, z_10nm: i64) -> Result<(), CommandError> {
        if !(self.profile.lower_end_10nm[2]..=self.profile.size_10nm[2]).contains(&z_10nm) {
            return Err(CommandError::Outside { axis: 2 });
        }
        self.motion.finish().await?;
        let [x, y, _] = self.motion.position_10nm();
        self.motion.set_position([x, y, z_10nm]);
        self.interpreter.modal.lift_10nm = 0;
        self.interpreter.modal.homed[2] = true;
        self.interpreter.modal.failed_home[2] = false;
        // A probe triggers at its offset; any other sensor where the profile says.
        self.interpreter.modal.z = KnownZ { trigger_10nm: Some(self.interpreter.trigger_10nm(2)), ..KnownZ::default() };
        self.interpreter.follow([x, y, z_10nm]);
        Ok(())
    }

    /// Takes over the settings in force at the start of a frame: limits, percentages, the fan, E,
    /// G92, the lift of a retraction and the feed. The machine must stand there. The caller sets
    /// the heaters.
    ///
    /// # Errors
    /// The machine is elsewhere, the frame's values are out of range, or motion was stopped.
    pub async fn enter_prepared(&mut self, state: &FrameState) -> Result<(), CommandError> {
        self.needs_right_angles()?;
        let modal = &state.modal;
        let [x, y, z] = modal.offset_10nm;
        if [x, y, z, modal.lift_10nm, modal.extruder_10nm].iter().any(|length| length.unsigned_abs() > MAX_10NM) {
            return Err(CommandError::TooFar);
        }
        self.motion.finish().await?;
        let stands_10nm = self.motion.position_10nm();
        if stands_10nm != state.position_10nm {
            return Err(CommandError::other_place(state.position_10nm, stands_10nm));
        }
        self.motion.set_limits(modal.limits.map_or(self.profile.limits, limits));
        self.motion.set_fan_power(FanOutput::Part, state.fan_power).await?;
        let [x, y, z] = state.position_10nm;
        self.interpreter.modal.machine_10nm = [x, y, z - modal.lift_10nm];
        self.interpreter.modal.lift_10nm = modal.lift_10nm;
        self.interpreter.modal.offset_10nm = modal.offset_10nm;
        (self.interpreter.modal.extruder_10nm, self.interpreter.modal.extruder_rest_100pm) = (modal.extruder_10nm, 0);
        let [least, most] = PERCENTS.map(|percent| percent as u16);
        self.interpreter.modal.feed_percent = modal.feed_percent.clamp(least, most);
        self.interpreter.modal.flow_percent = modal.flow_percent.clamp(least, most);
        // The frame's feed includes the percentage.
        let feed_10nm_per_min = f64::from(state.feed_mm_per_s) * 6_000_000.0;
        self.interpreter.modal.feed_10nm_per_min =
            (feed_10nm_per_min * 100.0 / f64::from(self.interpreter.modal.feed_percent)) as i64;
        Ok(())
    }
}
