//! Jobs that were planned elsewhere (GPRE): their moves bring their speeds; commands are executed as from G-code.

use ferrostep_gcode::parse;
use ferrostep_gpre::{LimitValues, ModalState};
use ferrostep_hal_shim::Heater;
use ferrostep_planner::extruder::FILAMENT_UNITS_PER_MM;
use ferrostep_planner::{Limits, Moved, Prepared, PreparedBlock, PreparedMove, Retuned};

use crate::error::{CommandError, Failure};
use crate::moves::MAX_EXTRUDER_10NM;
use crate::ports::{Heating, Motion, MotionError, Ports};
use crate::printer::Printer;

/// E of the G-code as the blocks of a prepared job push it. The packets say it as well, from time to time; where they
/// are refused it is the motors that count.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BlockExtruder {
    pub extruder_10nm: i64,
    /// What is not in it yet, units of 0.1 nm times percent.
    rest_100pm: i64,
}

impl BlockExtruder {
    fn push(&mut self, filament_100pm: i64, flow_percent: u16) {
        let pushed_100pm = self.rest_100pm.saturating_add(filament_100pm);
        let flow = i64::from(flow_percent.max(1));
        self.extruder_10nm = self.extruder_10nm.saturating_add(pushed_100pm / flow);
        self.rest_100pm = pushed_100pm % flow;
    }
}

/// Limits in the order and precision in which a job has them.
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
        let modal = &self.modal;
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

    /// Where the motors' moves end that were taken so far, machine coordinates in units of 10 nm.
    pub fn machine_10nm(&self) -> [i64; 3] {
        self.motion.position_10nm()
    }

    /// Executes a move of a prepared job; `planned_with` is what its frame says of feed and flow, which may have been
    /// changed since.
    ///
    /// # Errors
    /// As for a move of G-code; a target beyond the soft limits is refused, not clamped.
    pub async fn prepared_move(&mut self, item: &PreparedMove, planned_with: &ModalState) -> Result<(), CommandError> {
        if let Some(result) = self.try_prepared_move(item, planned_with) {
            return result;
        }
        let now = self.retuned(item, planned_with);
        let moved = self.motion.add(Prepared { planned: item, now: now.as_ref() }).await;
        self.note_prepared(item, now.as_ref(), moved)
    }

    /// As [`Self::prepared_move`], if it needs no waiting; `None`, and nothing has changed, where it does.
    #[inline]
    pub fn try_prepared_move(
        &mut self,
        item: &PreparedMove,
        planned_with: &ModalState,
    ) -> Option<Result<(), CommandError>> {
        self.line = item.line;
        if let Err(error) = self.allow(item) {
            return Some(Err(error));
        }
        let now = if self.has_percents_of(planned_with) { None } else { self.retuned(item, planned_with) };
        let moved = self.motion.try_add(&Prepared { planned: item, now: now.as_ref() })?;
        Some(self.note_prepared(item, now.as_ref(), moved))
    }

    /// What became of a prepared move: state and tallies follow one that was taken.
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
            self.modal.machine_10nm = [x, y, self.modal.machine_z_10nm(z)];
            self.modal.push_prepared(filament_100pm);
        } else {
            self.note_retraction(z, filament_100pm);
        }
        self.tally.moves = self.tally.moves.wrapping_add(u64::from(item.ends_move));
        self.tally.filament_100pm = self.tally.filament_100pm.wrapping_add(filament_100pm);
        Ok(())
    }

    /// A move of a firmware retraction was taken: the G-code's Z does not see its lift, nor E its filament.
    #[inline(never)]
    fn note_retraction(&mut self, z_10nm: i64, filament_100pm: i64) {
        let [.., z_before_10nm] = self.modal.machine_10nm;
        self.modal.lift_10nm = z_10nm.wrapping_sub(z_before_10nm);
        if filament_100pm != 0 {
            self.modal.retracted = filament_100pm < 0;
        }
    }

    /// Whether the machine may do what a move of a prepared job asks.
    #[inline(always)]
    fn allow(&mut self, item: &PreparedMove) -> Result<(), CommandError> {
        if self.signals.is_halted() {
            return Err(self.refused(CommandError::Halted));
        }
        if self.modal.z.shift_10nm != 0 {
            return Err(CommandError::Shifted { shift_10nm: self.modal.z.shift_10nm });
        }
        if self.modal.soft_limits {
            for axis in 0..3 {
                // Below the lower end it is more than any length: all are at most 5 m.
                let (lower, upper) = (self.profile.lower_end_10nm[axis] as i32, self.profile.size_10nm[axis] as i32);
                let above_lower = item.target[axis].units().wrapping_sub(lower).cast_unsigned();
                let is_outside = above_lower > upper.wrapping_sub(lower).cast_unsigned();
                if is_outside && self.modal.homed[axis] {
                    return Err(CommandError::Outside { axis });
                }
            }
        }
        if item.filament_100pm != 0 {
            self.check_extrusion_temperature()?;
        }
        Ok(())
    }

    /// Whether feed and flow have the percentages that moves were planned with.
    #[inline(always)]
    fn has_percents_of(&self, planned_with: &ModalState) -> bool {
        self.modal.feed_percent == planned_with.feed_percent && self.modal.flow_percent == planned_with.flow_percent
    }

    /// What feed and flow of now make of a move; `None` where they are those of its plan.
    #[cold]
    #[inline(never)]
    fn retuned(&self, item: &PreparedMove, planned_with: &ModalState) -> Option<Retuned> {
        if self.has_percents_of(planned_with) {
            return None;
        }
        let (feed, flow) = (self.modal.feed_percent, self.modal.flow_percent);
        let mut filament_100pm = item.filament_100pm;
        if flow != planned_with.flow_percent && item.counts {
            let (now, then) = (i64::from(flow), i64::from(planned_with.flow_percent.max(1)));
            filament_100pm = filament_100pm.saturating_mul(now) / then;
        }
        let feed_mm_per_s = item.feed_mm_per_s * f32::from(feed) / f32::from(planned_with.feed_percent.max(1));
        Some(Retuned { filament_100pm, feed_mm_per_s: (feed != planned_with.feed_percent).then_some(feed_mm_per_s) })
    }

    /// A move was not taken.
    #[cold]
    #[inline(never)]
    fn refused(&mut self, error: CommandError) -> CommandError {
        self.follow_after(error);
        error
    }

    /// Executes a block of a prepared job that has no moves; `moves` end in it.
    ///
    /// # Errors
    /// As for a move of G-code.
    pub async fn prepared_block(&mut self, block: &PreparedBlock, moves: u32) -> Result<(), CommandError> {
        self.line = block.block.line;
        if self.signals.is_halted() {
            return Err(CommandError::Halted);
        }
        if self.modal.z.shift_10nm != 0 {
            return Err(CommandError::Shifted { shift_10nm: self.modal.z.shift_10nm });
        }
        if block.block.extruder_256ths != 0 {
            self.check_extrusion_temperature()?;
        }
        let result = self.take_block(block).await;
        if let Err(error) = result {
            self.follow_after(error);
        }
        result?;
        let [x, y, z] = self.motion.position_10nm();
        self.modal.machine_10nm = [x, y, z - self.modal.lift_10nm];
        self.tally.moves += u64::from(moves);
        // 1/256 steps at 1e-5 steps/mm: 3,906,250,000, times 2^31 less than 2^63 by a tenth of it.
        const PER_256TH: i64 = FILAMENT_UNITS_PER_MM * 100_000 / 256;
        let steps_per_mm = self.profile.steps_per_mm[3].hundred_thousandths().max(1);
        let filament = i64::from(block.block.extruder_256ths) * PER_256TH;
        let half = if filament < 0 { -steps_per_mm / 2 } else { steps_per_mm / 2 };
        let filament_100pm = (filament + half) / steps_per_mm;
        self.tally.filament_100pm += filament_100pm;
        let (extruder_10nm, flow_percent) = (self.modal.extruder_10nm, self.modal.flow_percent);
        let extruder = self.block_extruder.get_or_insert(BlockExtruder { extruder_10nm, rest_100pm: 0 });
        extruder.push(filament_100pm, flow_percent);
        Ok(())
    }

    async fn take_block(&mut self, block: &PreparedBlock) -> Result<(), CommandError> {
        let end = {
            let geometry = self.profile.geometry();
            let mut steps = geometry.motor_steps(self.motion.position_10nm()).map(i64::from);
            steps.iter_mut().zip(block.block.steps).for_each(|(position, steps)| *position += i64::from(steps));
            geometry.position_10nm(steps)
        };
        // Where the motors stand is up to a step beside where they should.
        for (axis, end) in end.into_iter().enumerate() {
            let step = self.profile.steps_per_mm[axis].step_10nm();
            let inside = self.profile.lower_end_10nm[axis] - step..=self.profile.size_10nm[axis] + step;
            if self.modal.soft_limits && self.modal.homed[axis] && !inside.contains(&end) {
                return Err(CommandError::Outside { axis });
            }
        }
        self.motion.add(*block).await?;
        Ok(())
    }

    /// Takes over where the machine is after the blocks so far, to less than a step, how much of that is a firmware
    /// retraction's lift, and E as the G-code sees it.
    ///
    /// # Errors
    /// The motors do not stand there, or E is beyond any that the G-code can have; nothing has changed.
    pub fn prepared_place(
        &mut self,
        position_10nm: [i64; 3],
        lift_10nm: i64,
        extruder_10nm: i64,
    ) -> Result<(), CommandError> {
        if extruder_10nm.unsigned_abs() > MAX_EXTRUDER_10NM as u64 {
            return Err(CommandError::TooMuchFilament);
        }
        if !self.motion.refine_position(position_10nm) {
            return Err(CommandError::other_place(position_10nm, self.motion.position_10nm()));
        }
        let [x, y, z] = position_10nm;
        self.modal.machine_10nm = [x, y, z - lift_10nm];
        self.modal.lift_10nm = lift_10nm;
        self.modal.extruder_10nm = extruder_10nm;
        Ok(())
    }

    /// Changes the fan as a prepared job has it.
    ///
    /// # Errors
    /// Motion was stopped.
    pub async fn prepared_fan(&mut self, line: u32, power: u8) -> Result<(), CommandError> {
        self.line = line;
        Ok(self.motion.set_fan_power(power).await?)
    }

    /// Executes a command of a prepared job as a line is executed, without its `ok`: no host has sent it.
    ///
    /// # Errors
    /// It cannot be read, or not be done.
    pub async fn prepared_command(&mut self, line: u32, text: &str) -> Result<(), Failure> {
        self.line = line;
        self.signals.note_host();
        let command = parse(text).map_err(Failure::Parse)?;
        self.command_with_signs_of_life(&command).await.map(|_| ()).map_err(Failure::Command)
    }

    /// Ends a prepared job of which nothing more can be trusted: what was taken of it is executed, to a standstill on the
    /// path; the G-code's position is then where the motors stand. Heaters stay as they are.
    ///
    /// # Errors
    /// Motion was stopped.
    pub async fn abandon_prepared(&mut self) -> Result<(), CommandError> {
        let finished = self.motion.finish().await;
        if let Some(by_motors) = self.block_extruder.take() {
            self.modal.extruder_10nm = by_motors.extruder_10nm;
        }
        self.stop_motion();
        Ok(finished?)
    }
}
