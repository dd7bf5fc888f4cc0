//! Jobs that were planned elsewhere (GPRE): their moves are executed without look-ahead, everything else as ever.

use embedded_hal_async::delay::DelayNs;
use ferrostep_gcode::parse;
use ferrostep_gpre::{LimitValues, ModalState, MoveItem, Speed};
use ferrostep_hal_shim::{Clock, Heater};
use ferrostep_planner::extruder::FILAMENT_UNITS_PER_MM;
use ferrostep_planner::look_ahead::Entry;
use ferrostep_planner::{Limits, Move, PreparedBlock, PreparedMove, SquaredSpeed};

use crate::error::{CommandError, Failure};
use crate::ports::{Heating, Motion, Replies};
use crate::printer::Printer;

/// Limits in the order and precision in which a job has them.
fn limit_values(limits: &Limits) -> LimitValues {
    let [vx, vy, vz, ve] = limits.max_feed_mm_per_s;
    let [ax, ay, az, ae] = limits.max_acceleration_mm_per_s2;
    let (print, travel) = (limits.print_acceleration_mm_per_s2, limits.travel_acceleration_mm_per_s2);
    let (retract, deviation) = (limits.retract_acceleration_mm_per_s2, limits.junction_deviation_mm);
    [vx, vy, vz, ve, ax, ay, az, ae, print, travel, retract, deviation].map(|value| value as f32)
}

impl<M: Motion, H: Heating, T: Clock + DelayNs + Clone, R: Replies> Printer<'_, M, H, T, R> {
    /// What lasts from move to move, for somebody who prepares a job.
    pub fn prepared_state(&self) -> ModalState {
        let celsius = |heater| self.heating.status(heater).target_celsius as u16;
        let limits = self.motion.limits();
        ModalState {
            nozzle_celsius: celsius(Heater::Nozzle),
            bed_celsius: celsius(Heater::Bed),
            feed_percent: self.modal.feed_percent,
            flow_percent: self.modal.flow_percent,
            extruder_10nm: self.modal.extruder_10nm,
            offset_10nm: self.modal.offset_10nm,
            lift_10nm: self.modal.lift_10nm,
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
    /// As for a move of G-code; a target beyond the soft limits is none that a prepared job has.
    pub async fn prepared_move(&mut self, item: &MoveItem, planned_with: &ModalState) -> Result<(), CommandError> {
        self.line = item.line;
        let result = self.take_prepared(item, planned_with).await;
        if matches!(result, Err(CommandError::Stopped | CommandError::Halted)) {
            self.follow_the_motors();
        }
        result
    }

    async fn take_prepared(&mut self, item: &MoveItem, planned_with: &ModalState) -> Result<(), CommandError> {
        if self.signals.is_halted() {
            return Err(CommandError::Halted);
        }
        if self.modal.soft_limits {
            for axis in 0..3 {
                let inside = 0..=self.profile.size_10nm[axis];
                if self.modal.homed[axis] && !inside.contains(&item.target_10nm[axis]) {
                    return Err(CommandError::Outside { axis });
                }
            }
        }
        if item.filament_100pm != 0 {
            self.check_extrusion_temperature()?;
        }
        let (feed, flow) = (self.modal.feed_percent, self.modal.flow_percent);
        let mut filament_100pm = item.filament_100pm;
        if flow != planned_with.flow_percent && item.counts {
            let (now, then) = (i64::from(flow), i64::from(planned_with.flow_percent.max(1)));
            filament_100pm = filament_100pm.saturating_mul(now) / then;
        }
        let mut feed_now_mm_per_s = item.feed_mm_per_s;
        if feed != planned_with.feed_percent {
            feed_now_mm_per_s = item.feed_mm_per_s * f32::from(feed) / f32::from(planned_with.feed_percent.max(1));
        }
        let request = Move {
            target_10nm: item.target_10nm,
            filament_100pm,
            feed_mm_per_s: item.feed_mm_per_s,
            line: item.line,
            ends_move: item.ends_move,
        };
        let entry = match item.speed {
            Speed::Continues => None,
            Speed::Bound => Some(Entry::Bound),
            Speed::Falling => Some(Entry::Falling),
            Speed::Given(units) => Some(Entry::Given(SquaredSpeed::from_units(units))),
        };
        self.motion.add_prepared(PreparedMove { request, feed_now_mm_per_s, entry }).await?;
        let [x, y, z] = item.target_10nm;
        if item.counts {
            // Heights and lifts within 5 m, sums of filament within 63 bits.
            self.modal.machine_10nm = [x, y, z.wrapping_sub(self.modal.lift_10nm)];
        } else {
            // A firmware retraction: where Z is lifted to is no place of the G-code's.
            self.modal.lift_10nm = z - self.modal.machine_10nm[2];
            if filament_100pm != 0 {
                self.modal.retracted = filament_100pm < 0;
            }
        }
        if item.counts {
            // An arc's share of a whole number need not be whole.
            let pushed_100pm = self.modal.extruder_rest_100pm.wrapping_add(filament_100pm);
            // Nearly always a percent of 100, and little enough to be divided by the processor.
            let (whole, rest) = match i32::try_from(pushed_100pm) {
                Ok(pushed) => (i64::from(pushed / i32::from(flow.max(1))), i64::from(pushed % i32::from(flow.max(1)))),
                Err(_) => (pushed_100pm / i64::from(flow.max(1)), pushed_100pm % i64::from(flow.max(1))),
            };
            self.modal.extruder_10nm = self.modal.extruder_10nm.wrapping_add(whole);
            self.modal.extruder_rest_100pm = rest;
        }
        self.tally.moves = self.tally.moves.wrapping_add(u64::from(item.ends_move));
        self.tally.filament_100pm = self.tally.filament_100pm.wrapping_add(filament_100pm);
        Ok(())
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
        if block.block.extruder_256ths != 0 {
            self.check_extrusion_temperature()?;
        }
        let result = self.take_block(block).await;
        if matches!(result, Err(CommandError::Stopped | CommandError::Halted)) {
            self.follow_the_motors();
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
        self.tally.filament_100pm += (filament + half) / steps_per_mm;
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
            let inside = -step..=self.profile.size_10nm[axis] + step;
            if self.modal.soft_limits && self.modal.homed[axis] && !inside.contains(&end) {
                return Err(CommandError::Outside { axis });
            }
        }
        Ok(self.motion.add_prepared_block(*block).await?)
    }

    /// Takes over where the machine is after the blocks so far, to less than a step, how much of that is a firmware
    /// retraction's lift, and E as the G-code sees it.
    ///
    /// # Errors
    /// The motors do not stand there.
    pub fn prepared_place(
        &mut self,
        position_10nm: [i64; 3],
        lift_10nm: i64,
        extruder_10nm: i64,
    ) -> Result<(), CommandError> {
        if !self.motion.refine_position(position_10nm) {
            return Err(CommandError::OtherPlace);
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

    /// Executes a command of a prepared job as a line is executed, without its `ok`: nobody has sent a line.
    ///
    /// # Errors
    /// It cannot be read, or not be done.
    pub async fn prepared_command(&mut self, line: u32, text: &str) -> Result<(), Failure> {
        self.line = line;
        let command = parse(text).map_err(Failure::Parse)?;
        self.command_with_signs_of_life(&command).await.map(|_| ()).map_err(Failure::Command)
    }

    /// Ends a prepared job of which nothing more can be trusted: what was taken of it is executed, to a standstill on the
    /// path; the G-code's position is then where the motors stand. Heaters are left to whoever watches over them.
    ///
    /// # Errors
    /// Motion was stopped.
    pub async fn abandon_prepared(&mut self) -> Result<(), CommandError> {
        let finished = self.motion.finish().await;
        self.stop_motion();
        Ok(finished?)
    }
}
