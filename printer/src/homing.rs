//! G28.

use embedded_hal_async::delay::DelayNs;
use ferrostep_gcode::{AxisFlags, Reply};
use ferrostep_hal_shim::Clock;
use ferrostep_planner::{Kinematics, Move};

use crate::error::CommandError;
use crate::ports::{Heating, Motion, Replies, Seek};
use crate::printer::Printer;
use crate::profile::{HomeEnd, HomeSensor};

impl<M: Motion, H: Heating, T: Clock + DelayNs + Clone, R: Replies> Printer<'_, M, H, T, R> {
    /// Homes X, then Y, then Z, those that are named or all.
    pub(crate) async fn home(&mut self, axes: AxisFlags) -> Result<(), CommandError> {
        self.needs(self.equipment.end_stops, "end stops")?;
        self.motion.finish().await?;
        let all = !(axes.x || axes.y || axes.z);
        for (axis, named) in [axes.x, axes.y, axes.z].into_iter().enumerate() {
            if named || all {
                self.home_axis(axis).await?;
            }
        }
        self.replies.send(Reply::Position(self.position()));
        Ok(())
    }

    /// A fast approach until the sensor triggers, a way back, and a slow one that counts. An axis that homes by a stall
    /// begins with the way back: it may stand at its end already, and a motor that is held back from its first step on
    /// never reaches the speed at which a stall is told.
    async fn home_axis(&mut self, axis: usize) -> Result<(), CommandError> {
        let homing = self.profile.homing[axis];
        let towards = if homing.end == HomeEnd::Max { 1 } else { -1 };
        let reach = self.profile.size_10nm[axis] * 3 / 2;
        let by_stall = homing.sensor == HomeSensor::Stall;
        if by_stall {
            self.needs_stall_signal(axis)?;
        }
        self.modal.homed[axis] = false;
        self.motion.set_motors_enabled(1 << axis, true);

        let outcome = async {
            if by_stall {
                self.motion.begin_homing();
                self.move_back(axis, towards * homing.back_off_10nm, homing.fast_mm_per_s).await?;
                self.is_released(axis)?;
            }
            self.seek(axis, towards * reach, homing.fast_mm_per_s).await?;
            self.move_back(axis, towards * homing.back_off_10nm, homing.fast_mm_per_s).await?;
            self.is_released(axis)?;
            self.seek(axis, towards * homing.back_off_10nm * 2, homing.slow_mm_per_s).await
        }
        .await;
        // Even after a failure the G-code's position is where the motors stand.
        if axis == 2 {
            // Z is where its sensor says; nothing is left to lower.
            self.modal.lift_10nm = 0;
        }
        let mut position = self.raised(self.modal.machine_10nm);
        position[axis] = match outcome {
            Ok(()) => homing.position_10nm,
            Err(_) => self.motion.position_10nm()[axis],
        };
        self.motion.set_position(position);
        self.modal.machine_10nm[axis] = position[axis];
        outcome?;
        self.modal.offset_10nm[axis] = 0;
        self.modal.homed[axis] = true;
        if by_stall && self.profile.kinematics == Kinematics::CoreXy {
            // Motors that still push against the frame would seem to stall as soon as they move the other axis.
            self.motion.begin_homing();
            self.move_back(axis, towards * homing.back_off_10nm, homing.fast_mm_per_s).await?;
            position[axis] -= towards * homing.back_off_10nm;
            self.motion.set_position(position);
            self.modal.machine_10nm[axis] = position[axis];
        }
        Ok(())
    }

    async fn move_back(&mut self, axis: usize, distance_10nm: i64, feed_mm_per_s: f64) -> Result<(), CommandError> {
        let mut back = self.motion.position_10nm();
        back[axis] -= distance_10nm;
        self.move_to(back, feed_mm_per_s).await?;
        Ok(self.motion.finish().await?)
    }

    /// A sensor that is triggered away from the end is broken, or not connected.
    fn is_released(&self, axis: usize) -> Result<(), CommandError> {
        if self.motion.is_end_stop_triggered(axis) { Err(CommandError::SensorStuck { axis }) } else { Ok(()) }
    }

    /// Refuses an axis whose driver would let the motor push on for ever.
    fn needs_stall_signal(&self, axis: usize) -> Result<(), CommandError> {
        let settings = self.drivers.and_then(|drivers| drivers.report(axis)).map(|report| report.settings);
        match settings {
            Some(settings) if settings.stall_threshold == 0 || !settings.stealth_chop => {
                Err(CommandError::NoStallSignal { axis })
            }
            _ => Ok(()),
        }
    }

    async fn seek(&mut self, axis: usize, distance_10nm: i64, feed_mm_per_s: f64) -> Result<(), CommandError> {
        let mut target_10nm = self.motion.position_10nm();
        target_10nm[axis] += distance_10nm;
        let feed_mm_per_s = feed_mm_per_s as f32;
        let request = Move { target_10nm, filament_100pm: 0, feed_mm_per_s, line: self.line, ends_move: false };
        match self.motion.seek(request, axis).await? {
            Seek::Triggered => Ok(()),
            Seek::Missed => Err(CommandError::HomingFailed { axis }),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
