//! G28.

use ferrostep_gcode::{AxisFlags, PinCommand};
use ferrostep_planner::Move;

use crate::error::CommandError;
use crate::motion::fault::HomingOutcome;
use crate::motion::interpreter::MoveInterpreter;
use crate::part::Part;
use crate::ports::{Motion, MotorDrivers};
use crate::settings::profile::homing::{AxisHoming, HomeEnd, HomeSensor};

/// The axis that may drive the nozzle into the bed.
const Z: usize = 2;

/// Attempts of two approaches each before approaches that do not agree are an error.
const ATTEMPTS: u32 = 2;

/// One G28: seeks the sensors of the axes, then sets the position of motors and interpreter.
#[derive(Debug)]
pub(crate) struct Homing<'h, 'a, M> {
    pub motion: &'h mut M,
    pub interpreter: &'h mut MoveInterpreter<'a>,
    pub drivers: Option<&'a dyn MotorDrivers>,
    /// The line of the command.
    pub line: u32,
}

impl<M: Motion> Homing<'_, '_, M> {
    /// Homes X, then Y, then Z: those that the command names, or all.
    ///
    /// Before X and Y move, and before Z homes elsewhere than at the nozzle's present
    /// place, Z is raised.
    pub async fn home(&mut self, axes: AxisFlags) -> Result<(), CommandError> {
        let all = !(axes.x || axes.y || axes.z);
        let named = [axes.x, axes.y, axes.z].map(|named| named || all);
        // Until it is done: whatever ends it leaves the axes at places that no print may count on.
        self.interpreter.modal.note_failed_home(named, true);
        self.home_named(named).await?;
        self.interpreter.modal.note_failed_home(named, false);
        Ok(())
    }

    async fn home_named(&mut self, named: [bool; 3]) -> Result<(), CommandError> {
        let home_at_10nm = self.interpreter.profile.safe_homing.home_at_10nm.filter(|_| named[Z]);
        if home_at_10nm.is_some() {
            let unknown = (0..Z).find(|&axis| !named[axis] && !self.interpreter.modal.homed[axis]);
            unknown.map_or(Ok(()), |axis| Err(CommandError::HomeFirst { axis }))?;
        }
        for axis in (0..Z).filter(|&axis| named[axis]) {
            self.needs_stall_signal(axis)?;
        }
        self.motion.finish().await?;
        self.leave_bed();
        if let Some(pin) = self.pin_out() {
            let homing = &mut *self;
            M::Servo::only(move || homing.tell_pin(pin, PinCommand::In)).await?;
        }
        if named[0] || named[1] || home_at_10nm.is_some() {
            self.raise().await?;
        }
        for axis in (0..Z).filter(|&axis| named[axis]) {
            self.home_axis(axis).await?;
        }
        if named[Z] {
            if let Some(place_10nm) = home_at_10nm {
                self.travel(place_10nm).await?;
            }
            self.home_axis(Z).await?;
            if home_at_10nm.is_some() {
                // Off the bed, to a height that does not depend on the probe's offset.
                self.raise().await?;
                // This ends homing.
                let position_10nm = self.motion.position_10nm();
                self.motion.set_position(position_10nm);
            }
        }
        Ok(())
    }

    /// Stops bed following: the position of the machine becomes known anew. The mesh stays.
    fn leave_bed(&mut self) {
        if M::HAS_BED && self.interpreter.modal.follows_bed {
            // Only on can fail.
            let _off = self.motion.follow_bed(false);
            self.interpreter.modal.follows_bed = false;
            self.interpreter.modal.mesh_rise_10nm = 0;
            self.interpreter.follow(self.motion.position_10nm());
        }
    }

    /// Goes to this height of the motors, if Z is lower, then to a place in the plane.
    pub async fn go_over_bed(&mut self, place_10nm: [i64; 2], height_10nm: i64) -> Result<(), CommandError> {
        self.rise_over_bed(height_10nm).await?;
        self.travel(place_10nm).await
    }

    /// Raises Z to this height of the motors, if it is lower.
    pub async fn rise_over_bed(&mut self, height_10nm: i64) -> Result<(), CommandError> {
        let [x_10nm, y_10nm, z_10nm] = self.motion.position_10nm();
        if z_10nm >= height_10nm {
            return Ok(());
        }
        self.go([x_10nm, y_10nm, height_10nm], self.interpreter.profile.homing[Z].fast_mm_per_s).await
    }

    /// Probes the bed at the machine's present place, fast and then slowly, and at most
    /// `below_10nm` below the place where home is. Returns the height of the motors at which
    /// the probe triggers.
    pub async fn probe_bed(&mut self, below_10nm: i64) -> Result<i64, CommandError> {
        let homing = self.interpreter.profile.homing[Z];
        let mut outcome = self.find_home(Z, &homing, below_10nm).await;
        if let Some(pin) = self.pin_out() {
            let homing = &mut *self;
            outcome = outcome.and(M::Servo::only(move || homing.tell_pin(pin, PinCommand::In)).await);
        }
        outcome?;
        let [.., z_10nm] = self.motion.position_10nm();
        Ok(z_10nm)
    }

    /// Raises Z to the profile's height, or by it where Z is unknown and has not been raised since.
    /// Never lowers it.
    async fn raise(&mut self) -> Result<(), CommandError> {
        let raise_10nm = self.interpreter.profile.safe_homing.raise_10nm;
        let mut target_10nm = self.motion.position_10nm();
        let z_10nm = target_10nm[Z];
        target_10nm[Z] = if self.interpreter.modal.homed[Z] {
            raise_10nm.min(self.interpreter.profile.size_10nm[Z])
        } else {
            self.interpreter.modal.z.raised_to_10nm.unwrap_or(z_10nm.saturating_add(raise_10nm))
        };
        if raise_10nm == 0 || target_10nm[Z] <= z_10nm {
            return Ok(());
        }
        let outcome = self.go(target_10nm, self.interpreter.profile.homing[Z].fast_mm_per_s).await;
        let raised_10nm = self.motion.position_10nm();
        self.interpreter.modal.machine_10nm[Z] += raised_10nm[Z] - z_10nm;
        self.interpreter.follow_plane(raised_10nm);
        if !self.interpreter.modal.homed[Z] {
            self.interpreter.modal.z.raised_to_10nm = Some(target_10nm[Z]);
        }
        outcome
    }

    /// Goes to a place in the plane, at the nozzle's present height.
    async fn travel(&mut self, [x_10nm, y_10nm]: [i64; 2]) -> Result<(), CommandError> {
        let [x, y, _] = &self.interpreter.profile.homing;
        let feed_mm_per_s = x.fast_mm_per_s.min(y.fast_mm_per_s);
        let [.., z_10nm] = self.motion.position_10nm();
        self.go([x_10nm, y_10nm, z_10nm], feed_mm_per_s).await?;
        self.interpreter.follow_plane([x_10nm, y_10nm, z_10nm]);
        Ok(())
    }

    /// Makes a move that is part of homing, to its end.
    async fn go(&mut self, target_10nm: [i64; 3], feed_mm_per_s: f64) -> Result<(), CommandError> {
        self.motion.begin_homing();
        self.move_to(target_10nm, feed_mm_per_s).await?;
        Ok(self.motion.finish().await?)
    }

    /// Homes an axis and sets its position.
    async fn home_axis(&mut self, axis: usize) -> Result<(), CommandError> {
        let homing = self.interpreter.profile.homing[axis];
        let towards = towards(&homing);
        self.interpreter.modal.homed[axis] = false;
        self.motion.set_motors_enabled(1 << axis, true);

        let mut outcome = self.find_home(axis, &homing, AxisHoming::MAX_PRESS_10NM).await;
        if let Some(pin) = self.pin_out().filter(|_| axis == Z) {
            let homing = &mut *self;
            // Where something else has failed, that counts.
            outcome = outcome.and(M::Servo::only(move || homing.tell_pin(pin, PinCommand::In)).await);
        }
        // Also after a failure the G-code's position is that of the motors.
        let found_10nm = self.motion.position_10nm()[axis];
        // The other axes stay, a lifted Z has its part in where they are.
        let mut position = self.interpreter.raised(self.interpreter.modal.machine_10nm);
        if axis == Z {
            // The sensor's height counts: it includes the lift and the shift.
            // Klipper's offset stays.
            self.interpreter.modal.lift_10nm = 0;
            self.interpreter.modal.z.shift_10nm = self.interpreter.modal.z.offset_10nm;
            self.interpreter.modal.z.raised_to_10nm = None;
        }
        position[axis] = match outcome {
            Ok(()) => self.interpreter.trigger_10nm(axis),
            Err(_) => found_10nm,
        };
        if axis == Z && outcome.is_ok() && homing.end == HomeEnd::Min {
            self.interpreter.modal.z.trigger_10nm = Some(position[Z]);
        }
        self.set_axis(axis, position);
        outcome?;
        self.interpreter.modal.offset_10nm[axis] = self.interpreter.modal.home_offset_10nm[axis];
        self.interpreter.modal.homed[axis] = true;
        if homing.sensor == HomeSensor::Stall && self.interpreter.profile.kinematics.shares_motors(axis) {
            // Motors that still push against the frame would seem to stall as soon as they
            // move another axis.
            self.motion.begin_homing();
            self.move_back(axis, &homing).await?;
            position[axis] -= towards * homing.back_off_10nm;
            self.set_axis(axis, position);
        }
        Ok(())
    }

    /// An axis has another position, of all axes the others are as they were.
    fn set_axis(&mut self, axis: usize, position_10nm: [i64; 3]) {
        self.motion.set_position(position_10nm);
        if axis == Z {
            self.interpreter.modal.machine_10nm[Z] = self.interpreter.modal.machine_z_10nm(position_10nm[Z]);
        }
        self.interpreter.follow_plane(position_10nm);
    }

    /// A fast approach until the sensor triggers, a move back, and a second approach, which counts
    /// if it agrees with the first. An axis that homes by a stall begins with the move back: it may
    /// be at its end already, and a motor that is held back from its first step on never reaches
    /// the speed that a stall signal needs.
    ///
    /// Towards the bed the first approach goes `below_10nm` below the lowest place where the
    /// sensor should trigger.
    async fn find_home(&mut self, axis: usize, homing: &AxisHoming, below_10nm: i64) -> Result<(), CommandError> {
        if homing.sensor == HomeSensor::Stall {
            self.motion.begin_homing();
            self.move_back(axis, homing).await?;
            self.is_released(axis)?;
        }
        let mut apart_10nm = None;
        for attempt in 0..ATTEMPTS {
            let by_stall = homing.sensor == HomeSensor::Stall;
            // A pin that went in does not tell that it is at the bed.
            let may_touch = self.pin(axis).is_some() || self.motion.is_end_stop_triggered(axis);
            if attempt > 0 && (by_stall || may_touch) {
                self.move_back(axis, homing).await?;
                self.is_released(axis)?;
            }
            let others = self.other_sensors(axis);
            let target_10nm = self.end_of_search_10nm(axis, homing, below_10nm);
            let from_10nm = self.motion.position_10nm()[axis];
            if self.seek(axis, target_10nm, homing.fast_mm_per_s, true).await? == HomingOutcome::Missed {
                let searched_10nm = way_10nm(homing, from_10nm, target_10nm).max(0);
                // A sensor of another axis that triggers here is this one's.
                let swapped = others.into_iter().flatten().find(|&other| self.motion.is_end_stop_triggered(other));
                return Err(CommandError::HomingFailed { axis, searched_10nm, swapped });
            }
            let first_10nm = self.motion.position_10nm()[axis];
            self.move_back(axis, homing).await?;
            self.is_released(axis)?;
            let beyond_10nm = if is_bed(axis, homing) {
                AxisHoming::MAX_PRESS_10NM.min(homing.back_off_10nm)
            } else {
                homing.back_off_10nm
            };
            let target_10nm = first_10nm + towards(homing) * beyond_10nm;
            apart_10nm = match self.seek(axis, target_10nm, homing.slow_mm_per_s, false).await? {
                HomingOutcome::Triggered => Some(self.motion.position_10nm()[axis] - first_10nm),
                HomingOutcome::Missed => None,
            };
            if apart_10nm.is_some_and(|apart_10nm| apart_10nm.abs() <= homing.agree_10nm) {
                return Ok(());
            }
        }
        Err(CommandError::HomingDisagrees { axis, apart_10nm, agree_10nm: homing.agree_10nm })
    }

    /// Last position that a first approach may reach, machine coordinate of the motors. Away from
    /// the bed that is the whole travel and the frame's possible excess. Towards the bed it is a
    /// little below the lowest place where the sensor can trigger, as the last homing has found it,
    /// or an approach from an unknown height that has gone down all the way.
    fn end_of_search_10nm(&mut self, axis: usize, homing: &AxisHoming, below_10nm: i64) -> i64 {
        let position_10nm = self.motion.position_10nm()[axis];
        let length_10nm = self.interpreter.profile.size_10nm[axis] - self.interpreter.profile.lower_end_10nm[axis];
        if !is_bed(axis, homing) {
            return position_10nm + towards(homing) * (length_10nm + homing.overrun_10nm);
        }
        let highest_10nm = self.interpreter.profile.size_10nm[Z] + homing.overrun_10nm;
        let all_10nm = highest_10nm - self.interpreter.trigger_10nm(Z);
        let trigger_10nm = *self.interpreter.modal.z.trigger_10nm.get_or_insert(position_10nm - all_10nm);
        trigger_10nm - below_10nm
    }

    /// The other axes whose sensors are released.
    fn other_sensors(&self, axis: usize) -> [Option<usize>; 3] {
        let released = |other: usize| {
            let by_stall = self.interpreter.profile.homing[other].sensor == HomeSensor::Stall;
            other != axis && !by_stall && !self.motion.is_end_stop_triggered(other)
        };
        [0, 1, 2].map(|other| released(other).then_some(other))
    }

    async fn move_back(&mut self, axis: usize, homing: &AxisHoming) -> Result<(), CommandError> {
        let mut back = self.motion.position_10nm();
        back[axis] -= towards(homing) * homing.back_off_10nm;
        self.move_to(back, homing.fast_mm_per_s).await?;
        Ok(self.motion.finish().await?)
    }

    /// Refuses a sensor that is triggered away from the end: it is broken, or not connected.
    fn is_released(&self, axis: usize) -> Result<(), CommandError> {
        if self.motion.is_end_stop_triggered(axis) { Err(CommandError::SensorStuck { axis }) } else { Ok(()) }
    }

    /// Refuses an axis whose driver would let the motor push on without end.
    fn needs_stall_signal(&self, axis: usize) -> Result<(), CommandError> {
        let homing = self.interpreter.profile.homing[axis];
        if homing.sensor != HomeSensor::Stall {
            return Ok(());
        }
        let Some(report) = self.drivers.and_then(|drivers| drivers.report(axis)) else { return Ok(()) };
        let settings = report.settings;
        let is_quiet = settings.stealth_chop && !settings.leaves_stealth_chop_at(homing.fast_mm_per_s);
        if settings.stall_threshold > 0 && is_quiet { Ok(()) } else { Err(CommandError::NoStallSignal { axis }) }
    }

    /// Adds a move that the G-code does not contain.
    async fn move_to(&mut self, target_10nm: [i64; 3], feed_mm_per_s: f64) -> Result<(), CommandError> {
        self.motion.add(self.request(target_10nm, feed_mm_per_s)).await?;
        Ok(())
    }

    fn request(&self, target_10nm: [i64; 3], feed_mm_per_s: f64) -> Move {
        let feed_mm_per_s = feed_mm_per_s as f32;
        Move { target_10nm, filament_100pm: 0, feed_mm_per_s, line: self.line, ends_move: false }
    }

    /// Approaches a sensor; `is_first` of the two approaches to it, for which a probe's pin goes
    /// out in any case.
    async fn seek(
        &mut self,
        axis: usize,
        to_10nm: i64,
        feed_mm_per_s: f64,
        is_first: bool,
    ) -> Result<HomingOutcome, CommandError> {
        let mut target_10nm = self.motion.position_10nm();
        // Never away from the sensor: a sensor beyond the axis's end counts as missed.
        if way_10nm(&self.interpreter.profile.homing[axis], target_10nm[axis], to_10nm) <= 0 {
            return Ok(HomingOutcome::Missed);
        }
        target_10nm[axis] = to_10nm;
        if let Some(pin) = self.pin(axis).filter(|pin| is_first || pin.stows_each_touch) {
            let homing = &mut *self;
            M::Servo::only(move || homing.tell_pin(pin, PinCommand::Out)).await?;
        }
        let outcome = self.motion.seek(self.request(target_10nm, feed_mm_per_s), axis).await?;
        if let Some(pin) = self.pin(axis).filter(|pin| pin.stows_each_touch) {
            let homing = &mut *self;
            M::Servo::only(move || homing.tell_pin(pin, PinCommand::In)).await?;
        }
        Ok(outcome)
    }
}

/// The direction in which an axis homes.
fn towards(homing: &AxisHoming) -> i64 {
    if homing.end == HomeEnd::Max { 1 } else { -1 }
}

/// Distance from one place of an axis to another, in the direction in which it homes.
fn way_10nm(homing: &AxisHoming, from_10nm: i64, to_10nm: i64) -> i64 {
    if homing.end == HomeEnd::Max { to_10nm - from_10nm } else { from_10nm - to_10nm }
}

/// Returns true if an axis homes towards the bed, into which the nozzle must not be pressed.
fn is_bed(axis: usize, homing: &AxisHoming) -> bool {
    axis == Z && homing.end == HomeEnd::Min
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
pub(crate) mod tests;
