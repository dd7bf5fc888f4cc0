//! Entering and leaving prepared jobs (GPRE); their commands are executed as from G-code.

use ferrostep_gcode::parse;
use ferrostep_gpre::{LimitValues, ModalState};
use ferrostep_hal_shim::{FanOutput, Heater};
use ferrostep_planner::{Limits, Moved, Prepared, PreparedMove, Request, Retuned};

use crate::error::{CommandError, Failure};
use crate::job::lines::Source;
use crate::job::prepared::{OtherMotion, PreparedPlace};
use crate::motion::fault::MotionError;
use crate::motion::interpreter::MAX_EXTRUDER_10NM;
use crate::ports::{Heating, Motion, Ports};
use crate::printer::Printer;

/// The limits in a job's order and precision.
fn limit_values(limits: &Limits) -> LimitValues {
    let [vx, vy, vz, ve] = limits.max_feed_mm_per_s;
    let [ax, ay, az, ae] = limits.max_acceleration_mm_per_s2;
    let (print, travel) = (limits.print_acceleration_mm_per_s2, limits.travel_acceleration_mm_per_s2);
    let (retract, deviation) = (limits.retract_acceleration_mm_per_s2, limits.junction_deviation_mm);
    let [jx, jy, jz, je] = limits.instantaneous_corner_velocity_mm_per_s;
    [vx, vy, vz, ve, ax, ay, az, ae, print, travel, retract, deviation, jx, jy, jz, je].map(|value| value as f32)
}

impl<P: Ports> Printer<'_, P> {
    /// The settings in force from move to move, for the writer of a prepared job.
    pub fn prepared_state(&self) -> ModalState {
        let celsius = |heater| self.heating.status(heater).target_celsius as u16;
        let limits = self.motion.limits();
        let modal = &self.interpreter.modal;
        ModalState {
            nozzle_celsius: celsius(Heater::Nozzle),
            bed_celsius: celsius(Heater::Bed),
            feed_percent: modal.feed_percent,
            flow_percent: modal.flow_percent,
            extruder_10nm: modal.extruder_10nm,
            offset_10nm: modal.offset_10nm,
            lift_10nm: modal.lift_10nm,
            limits: (limits != self.profile.limits).then(|| limit_values(&limits)),
        }
    }

    /// End of the moves accepted so far, motor position in machine coordinates, units of 10 nm.
    pub fn machine_10nm(&self) -> [i64; 3] {
        self.motion.position_10nm()
    }

    /// Executes a move of a prepared job; `planned_with` has the feed and flow of its frame, which
    /// may have been changed since.
    ///
    /// # Errors
    /// The errors of a G-code move; a target beyond the soft limits is refused, not clamped.
    pub async fn prepared_move(&mut self, item: &PreparedMove, planned_with: &ModalState) -> Result<(), CommandError> {
        if let Some(result) = self.try_prepared_move(item, planned_with) {
            return result;
        }
        let now = self.retuned(item, planned_with);
        let moved = self.motion.add(Prepared { planned: item, now: now.as_ref() }).await;
        self.note_prepared(item, now.as_ref(), moved)
    }

    /// Accepts a move as [`Self::prepared_move`] does if that needs no waiting; otherwise returns
    /// `None` and changes nothing.
    #[inline]
    pub fn try_prepared_move(
        &mut self,
        item: &PreparedMove,
        planned_with: &ModalState,
    ) -> Option<Result<(), CommandError>> {
        self.lines.number = item.line;
        if let Err(error) = self.allow(item) {
            return Some(Err(error));
        }
        let now = if self.has_percents_of(planned_with) { None } else { self.retuned(item, planned_with) };
        let moved = self.motion.try_add(&Prepared { planned: item, now: now.as_ref() })?;
        Some(self.note_prepared(item, now.as_ref(), moved))
    }

    /// Updates state and tallies after a prepared move was accepted.
    #[inline(always)]
    fn note_prepared(
        &mut self,
        item: &PreparedMove,
        now: Option<&Retuned>,
        moved: Result<Moved, MotionError>,
    ) -> Result<(), CommandError> {
        if let Err(error) = moved {
            return Err(self.refused(error.into()));
        }
        let filament_100pm = now.map_or(item.filament_100pm, |now| now.filament_100pm);
        let [x, y, z] = item.target_10nm().map(i64::from);
        if item.counts {
            self.interpreter.modal.machine_10nm = [x, y, self.interpreter.modal.machine_z_10nm(z)];
            self.interpreter.modal.push_prepared(filament_100pm);
        } else {
            self.note_retraction(z, filament_100pm);
        }
        self.interpreter.tally.moves = self.interpreter.tally.moves.wrapping_add(u64::from(item.ends_move));
        self.interpreter.tally.filament_100pm = self.interpreter.tally.filament_100pm.wrapping_add(filament_100pm);
        Ok(())
    }

    /// Accounts for a move of a firmware retraction: the G-code's Z excludes its lift, and E its
    /// filament.
    #[inline(never)]
    fn note_retraction(&mut self, z_10nm: i64, filament_100pm: i64) {
        let [.., z_before_10nm] = self.interpreter.modal.machine_10nm;
        self.interpreter.modal.lift_10nm = z_10nm.wrapping_sub(z_before_10nm);
        if filament_100pm != 0 {
            self.interpreter.modal.retracted = filament_100pm < 0;
        }
    }

    /// Checks a move of a prepared job against travel, temperature and filament.
    #[inline(always)]
    fn allow(&mut self, item: &PreparedMove) -> Result<(), CommandError> {
        if self.signals.is_halted() {
            return Err(self.refused(CommandError::Halted));
        }
        if self.interpreter.modal.z.shift_10nm != 0 {
            return Err(CommandError::Shifted { shift_10nm: self.interpreter.modal.z.shift_10nm });
        }
        if P::Motion::HAS_BED && self.interpreter.modal.follows_bed {
            return Err(CommandError::MeshAndJob);
        }
        self.needs_right_angles()?;
        self.supplied()?;
        if self.interpreter.modal.soft_limits {
            for axis in 0..3 {
                // A negative difference becomes larger than any length, since all are at most 5 m.
                let (lower, upper) = (self.profile.lower_end_10nm[axis] as i32, self.profile.size_10nm[axis] as i32);
                let above_lower = item.target[axis].units().wrapping_sub(lower).cast_unsigned();
                let is_outside = above_lower > upper.wrapping_sub(lower).cast_unsigned();
                if is_outside && self.interpreter.modal.homed[axis] {
                    return Err(CommandError::Outside { axis });
                }
            }
        }
        if item.filament_100pm != 0 {
            self.check_extrusion_temperature()?;
        }
        Ok(())
    }

    /// Returns true if feed and flow have the percentages with which the moves were planned.
    #[inline(always)]
    fn has_percents_of(&self, planned_with: &ModalState) -> bool {
        self.interpreter.modal.feed_percent == planned_with.feed_percent
            && self.interpreter.modal.flow_percent == planned_with.flow_percent
    }

    /// The move at the present feed and flow; `None` if they are those of the plan.
    #[cold]
    #[inline(never)]
    fn retuned(&self, item: &PreparedMove, planned_with: &ModalState) -> Option<Retuned> {
        if self.has_percents_of(planned_with) {
            return None;
        }
        let (feed, flow) = (self.interpreter.modal.feed_percent, self.interpreter.modal.flow_percent);
        let mut filament_100pm = item.filament_100pm;
        if flow != planned_with.flow_percent && item.counts {
            let (now, then) = (i64::from(flow), i64::from(planned_with.flow_percent.max(1)));
            filament_100pm = filament_100pm.saturating_mul(now) / then;
        }
        let feed_mm_per_s = item.feed_mm_per_s * f32::from(feed) / f32::from(planned_with.feed_percent.max(1));
        Some(Retuned { filament_100pm, feed_mm_per_s: (feed != planned_with.feed_percent).then_some(feed_mm_per_s) })
    }

    /// Updates the state after a move was refused.
    #[cold]
    #[inline(never)]
    fn refused(&mut self, error: CommandError) -> CommandError {
        self.follow_after(error);
        error
    }

    /// Executes motion of a prepared job in an encoding other than the compact one. E stays as it
    /// is, see [`Self::prepared_place`].
    ///
    /// # Errors
    /// As for [`Self::prepared_move`].
    pub async fn prepared_motion(&mut self, motion: OtherMotion<impl Request>) -> Result<(), CommandError> {
        self.lines.number = motion.line;
        if self.signals.is_halted() {
            return Err(self.refused(CommandError::Halted));
        }
        if self.interpreter.modal.z.shift_10nm != 0 {
            return Err(CommandError::Shifted { shift_10nm: self.interpreter.modal.z.shift_10nm });
        }
        if P::Motion::HAS_BED && self.interpreter.modal.follows_bed {
            return Err(CommandError::MeshAndJob);
        }
        self.needs_right_angles()?;
        self.supplied()?;
        if motion.filament_100pm != 0 {
            self.check_extrusion_temperature()?;
        }
        for (axis, end) in motion.end_10nm.into_iter().enumerate() {
            let (lower, upper) = (self.profile.lower_end_10nm[axis], self.profile.size_10nm[axis]);
            let outside_10nm = (lower - end).max(end - upper);
            if self.interpreter.modal.soft_limits
                && self.interpreter.modal.homed[axis]
                && outside_10nm > motion.tolerance_10nm[axis]
            {
                return Err(CommandError::Outside { axis });
            }
        }
        if let Err(error) = self.motion.add(motion.request).await {
            return Err(self.refused(error.into()));
        }
        let [x, y, z] = self.motion.position_10nm();
        self.interpreter.modal.machine_10nm = [x, y, z - self.interpreter.modal.lift_10nm];
        self.interpreter.tally.moves += u64::from(motion.moves);
        self.interpreter.tally.filament_100pm += motion.filament_100pm;
        Ok(())
    }

    /// Takes over the position after the motion so far; `request` makes the planner's position
    /// exact, which is otherwise known to less than a motor step.
    ///
    /// # Errors
    /// The motors are elsewhere, E is out of range (units of 10 nm, as for G92), or motion was
    /// stopped; the G-code's position is unchanged.
    pub async fn prepared_place(&mut self, place: &PreparedPlace, request: impl Request) -> Result<(), CommandError> {
        let PreparedPlace { position_10nm, lift_10nm, extruder_10nm } = *place;
        if extruder_10nm.unsigned_abs() > MAX_EXTRUDER_10NM as u64 {
            return Err(CommandError::TooMuchFilament);
        }
        self.motion.add(request).await?;
        let stands_10nm = self.motion.position_10nm();
        if stands_10nm != position_10nm {
            return Err(CommandError::other_place(position_10nm, stands_10nm));
        }
        let [x, y, z] = position_10nm;
        self.interpreter.modal.machine_10nm = [x, y, z - lift_10nm];
        self.interpreter.modal.lift_10nm = lift_10nm;
        self.interpreter.modal.extruder_10nm = extruder_10nm;
        Ok(())
    }

    /// Sets the G-code's E, units of 10 nm: after a refused job it differs from the filament that
    /// its motion has pushed.
    pub fn set_prepared_extruder(&mut self, extruder_10nm: i64) {
        self.interpreter.modal.extruder_10nm = extruder_10nm;
    }

    /// The flow in force (M221), percent.
    pub fn current_flow_percent(&self) -> u16 {
        self.interpreter.modal.flow_percent
    }

    /// Changes the part-cooling fan by an item of a prepared job.
    ///
    /// # Errors
    /// Motion was stopped.
    pub async fn prepared_fan(&mut self, line: u32, power: u8) -> Result<(), CommandError> {
        self.lines.number = line;
        Ok(self.motion.set_fan_power(FanOutput::Part, power).await?)
    }

    /// Executes a command of a prepared job as a line, but without an `ok`, because no
    /// host has sent it.
    ///
    /// # Errors
    /// The command cannot be read or executed.
    pub async fn prepared_command(&mut self, line: u32, text: &str) -> Result<(), Failure> {
        self.lines.number = line;
        self.signals.note_host();
        if self.prints_from_card() {
            self.lines.source = Source::Card;
        }
        let command = parse(text).map_err(Failure::Parse)?;
        self.command_with_signs_of_life(&command).await.map(|_| ()).map_err(Failure::Command)
    }

    /// Ends a prepared job whose rest cannot be trusted: the accepted moves are executed, to a
    /// standstill on the path; the G-code's position then becomes that of the motors. Heaters keep
    /// their targets.
    ///
    /// # Errors
    /// Motion was stopped.
    pub async fn abandon_prepared(&mut self) -> Result<(), CommandError> {
        let finished = self.motion.finish().await;
        self.stop_motion();
        Ok(finished?)
    }
}
