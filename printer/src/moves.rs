//! G0 to G4, G10, G11 and G92.

use ferrostep_gcode::{ArcForm, AxisWords, Decimal, Real, Reply};
use ferrostep_hal_shim::Heater;
use ferrostep_planner::extruder::Extruder;
use ferrostep_planner::kinematics::MAX_COORDINATE_10NM;
use ferrostep_planner::{Move, Moved, filament_100pm};

use crate::AXIS_NAMES;
use crate::arc::Arc;
use crate::error::CommandError;
use crate::extrusion::AdaptiveExtrusion;
use crate::ports::{Heating, Motion, Ports, Replies};
use crate::printer::Printer;

/// Logical extruder positions stay within 10,000 km.
pub(crate) const MAX_EXTRUDER_10NM: i64 = 1_000_000_000_000_000;

/// No chord is longer: 2 sqrt(2 r c) with the largest radius, 10 m, and c of 0.01 mm is 28.3 mm.
const LONGEST_CHORD_10NM: i64 = 3_000_000;

/// A dwell of more than eleven days is a mistake.
const LONGEST_DWELL_MS: u64 = 1_000_000_000;

/// A move whose words have been checked.
struct Target {
    machine_10nm: [i64; 3],
    extruder_10nm: i64,
    feed_10nm_per_min: i64,
}

/// A firmware retraction or recovery after which no move with filament was taken. The machine stands meanwhile, which tells
/// after a stop how far it was.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NewestRetraction {
    /// Where the motors of X, Y and Z stand.
    motor_steps: [i32; 3],
    /// Its filament, units of 0.1 nm.
    filament_100pm: i64,
}

impl<P: Ports> Printer<'_, P> {
    /// G0, G1.
    pub(crate) async fn linear(
        &mut self,
        rapid: bool,
        axes: &AxisWords,
        feed: Option<Decimal>,
    ) -> Result<(), CommandError> {
        let mut target = self.target(axes, feed)?;
        let clamped = self.clamp(&mut target.machine_10nm);
        let (mut filament, mut extrusion) = (self.filament(&target), self.modal.extrusion);
        if !rapid && self.extrudes_by_length(axes, &target) {
            (filament, extrusion) = self.along(extrusion, self.modal.machine_10nm, target.machine_10nm);
            self.check_extrusion(filament)?;
        }
        let request = Move {
            target_10nm: self.raised(target.machine_10nm),
            filament_100pm: filament,
            feed_mm_per_s: self.modal.feed_mm_per_s(target.feed_10nm_per_min),
            line: self.line,
            ends_move: true,
        };
        let displaces = target.machine_10nm != self.modal.machine_10nm || filament != 0;
        if displaces {
            self.motion.add(request).await?;
        }
        self.modal.extrusion = extrusion;
        self.moved(&target, filament, displaces, clamped);
        Ok(())
    }

    /// Whether a move gets filament by its length (M795): one in the plane, without an E of its own, and with the
    /// filament not drawn back.
    fn extrudes_by_length(&self, axes: &AxisWords, target: &Target) -> bool {
        let [from, to] = [self.modal.machine_10nm[2], target.machine_10nm[2]];
        self.modal.extrusion.settings().adaptive && axes.e.is_none() && from == to && !self.modal.retracted
    }

    /// Filament along a path in the plane, and the rest that is owed after it.
    fn along(&self, extrusion: AdaptiveExtrusion, from: [i64; 3], to: [i64; 3]) -> (i64, AdaptiveExtrusion) {
        let [from, to] = [from, to].map(|[x, y, _]| [x, y]);
        extrusion.along(from, to, self.modal.flow_percent)
    }

    /// Whether a move may push so much.
    fn check_extrusion(&self, filament_100pm: i64) -> Result<(), CommandError> {
        if filament_100pm != 0 {
            self.check_extrusion_temperature()?;
        }
        if Extruder::can_push(self.profile.steps_per_mm[3], filament_100pm) {
            Ok(())
        } else {
            Err(CommandError::TooMuchFilament)
        }
    }

    /// G2, G3: chords at most 0.01 mm off; Z and E follow evenly.
    pub(crate) async fn arc(
        &mut self,
        clockwise: bool,
        axes: &AxisWords,
        form: ArcForm,
        feed: Option<Decimal>,
    ) -> Result<(), CommandError> {
        let mut target = self.target(axes, feed)?;
        let from = self.modal.machine_10nm;
        let [start, end] = [from, target.machine_10nm].map(|[x, y, _]| [x, y]);
        let arc = match form {
            ArcForm::Centre { i, j } => {
                let i = self.modal.length_10nm(i).ok_or(CommandError::TooFar)?;
                let j = self.modal.length_10nm(j).ok_or(CommandError::TooFar)?;
                if i.abs().max(j.abs()) > MAX_COORDINATE_10NM {
                    return Err(CommandError::TooFar);
                }
                Arc::around(start, end, [start[0] + i, start[1] + j], clockwise)?
            }
            ArcForm::Radius(radius) => {
                let radius = self.modal.length_10nm(radius).ok_or(CommandError::TooFar)?;
                if radius.abs() > MAX_COORDINATE_10NM {
                    return Err(CommandError::TooFar);
                }
                Arc::with_radius(start, end, radius, clockwise)?
            }
        };
        let filament = self.filament(&target);
        let by_length = self.extrudes_by_length(axes, &target);
        if by_length {
            let longest = [from[0] + LONGEST_CHORD_10NM, from[1], from[2]];
            self.check_extrusion(self.along(self.modal.extrusion, from, longest).0)?;
        }
        let feed_mm_per_s = self.modal.feed_mm_per_s(target.feed_10nm_per_min);
        let chords = i128::from(arc.chords());
        // Shares of a whole that add up to it exactly.
        let share = |whole: i64, index: u32| (i128::from(whole) * i128::from(index) / chords) as i64;
        let rise = target.machine_10nm[2] - from[2];

        let extruder_before = self.modal.extruder_10nm;
        let extrusion_10nm = target.extruder_10nm - extruder_before;

        let mut clamped = [false; 3];
        let mut pushed = 0;
        for (index, [x, y]) in (1..).zip(arc.inner_points()) {
            let mut point = [x, y, from[2] + share(rise, index)];
            self.clamp_into(&mut point, &mut clamped);
            let mut extrusion = self.modal.extrusion;
            let mut push = share(filament, index) - pushed;
            if by_length {
                (push, extrusion) = self.along(extrusion, self.modal.machine_10nm, point);
            }
            let chord = Move {
                target_10nm: self.raised(point),
                filament_100pm: push,
                feed_mm_per_s,
                line: self.line,
                ends_move: false,
            };
            pushed += push;
            self.motion.add(chord).await?;
            // The planner has taken it: a stop takes back the part that was not made, here as there.
            self.modal.machine_10nm = point;
            self.modal.extruder_10nm = extruder_before + share(extrusion_10nm, index);
            self.tally.filament_100pm += push;
            self.modal.extrusion = extrusion;
        }
        self.clamp_into(&mut target.machine_10nm, &mut clamped);
        let mut extrusion = self.modal.extrusion;
        let mut push = filament - pushed;
        if by_length {
            (push, extrusion) = self.along(extrusion, self.modal.machine_10nm, target.machine_10nm);
        }
        let last = Move {
            target_10nm: self.raised(target.machine_10nm),
            filament_100pm: push,
            feed_mm_per_s,
            line: self.line,
            ends_move: true,
        };
        self.motion.add(last).await?;
        self.modal.extrusion = extrusion;
        self.moved(&target, push, true, clamped);
        Ok(())
    }

    /// Where a move goes, or why it is refused.
    fn target(&self, axes: &AxisWords, feed: Option<Decimal>) -> Result<Target, CommandError> {
        let (machine_10nm, extruder_10nm) = self.modal.target(axes).ok_or(CommandError::TooFar)?;
        if machine_10nm.iter().any(|coordinate| coordinate.unsigned_abs() > MAX_COORDINATE_10NM as u64) {
            return Err(CommandError::TooFar);
        }
        if extruder_10nm.unsigned_abs() > MAX_EXTRUDER_10NM as u64 {
            return Err(CommandError::TooMuchFilament);
        }
        let feed_10nm_per_min = self.modal.feed(feed).ok_or(CommandError::TooFar)?;
        if !self.modal.is_feed_fast_enough(feed_10nm_per_min) {
            let percent = f64::from(self.modal.feed_percent);
            let feed_mm_per_s = feed_10nm_per_min as f64 * percent / (60.0 * 100.0 * 100_000.0);
            return Err(CommandError::FeedTooSlow { feed_mm_per_s });
        }
        if extruder_10nm != self.modal.extruder_10nm {
            self.check_extrusion_temperature()?;
        }
        let target = Target { machine_10nm, extruder_10nm, feed_10nm_per_min };
        // Looked at here, not only by the planner: an arc goes there in many moves.
        if !Extruder::can_push(self.profile.steps_per_mm[3], self.filament(&target)) {
            return Err(CommandError::TooMuchFilament);
        }
        Ok(target)
    }

    pub(crate) fn check_extrusion_temperature(&self) -> Result<(), CommandError> {
        if !self.modal.cold_extrusion_allowed {
            self.needs(self.equipment.heaters, "thermometers")?;
        }
        let celsius = self.heating.status(Heater::Nozzle).celsius;
        let minimum_celsius = self.modal.min_extrusion_celsius;
        if self.modal.cold_extrusion_allowed || celsius >= minimum_celsius {
            return Ok(());
        }
        Err(CommandError::ColdExtrusion { celsius, minimum_celsius })
    }

    fn filament(&self, target: &Target) -> i64 {
        filament_100pm(target.extruder_10nm - self.modal.extruder_10nm, i64::from(self.modal.flow_percent))
    }

    /// Soft limits: draws a target into the travel of the homed axes. Returns which axes that changed.
    fn clamp(&self, target_10nm: &mut [i64; 3]) -> [bool; 3] {
        let mut clamped = [false; 3];
        self.clamp_into(target_10nm, &mut clamped);
        clamped
    }

    /// Lower and upper end of an axis's travel.
    fn travel_10nm(&self, axis: usize) -> [i64; 2] {
        let upper = self.profile.size_10nm[axis];
        [self.profile.lower_end_10nm[axis].min(upper), upper]
    }

    fn clamp_into(&self, target_10nm: &mut [i64; 3], clamped: &mut [bool; 3]) {
        if !self.modal.soft_limits {
            return;
        }
        for axis in 0..3 {
            let [lower, upper] = self.travel_10nm(axis);
            let inside = target_10nm[axis].clamp(lower, upper);
            if self.modal.homed[axis] && inside != target_10nm[axis] {
                target_10nm[axis] = inside;
                clamped[axis] = true;
            }
        }
    }

    /// The move has been taken: state and tallies follow.
    fn moved(&mut self, target: &Target, filament_100pm: i64, displaces: bool, clamped: [bool; 3]) {
        self.modal.machine_10nm = target.machine_10nm;
        self.modal.extruder_10nm = target.extruder_10nm;
        self.modal.feed_10nm_per_min = target.feed_10nm_per_min;
        if filament_100pm != 0 {
            self.newest_retraction = None;
        }
        self.tally.moves += u64::from(displaces);
        self.tally.filament_100pm += filament_100pm;
        if clamped.contains(&true) {
            self.tally.clamped_moves += 1;
            self.say_clamped(clamped);
        }
    }

    fn say_clamped(&self, clamped: [bool; 3]) {
        let mut text = crate::printer::Text::new();
        let line = self.line;
        let mut complete = core::fmt::write(&mut text, format_args!("echo:line {line}: outside the soft limits,"));
        for axis in (0..3).filter(|&axis| clamped[axis]) {
            let [lower, upper] = self.travel_10nm(axis);
            let [at, lower, upper] = [self.modal.machine_10nm[axis], lower, upper]
                .map(|length_10nm| Real::fixed(length_10nm as f64 / 100_000.0, 2));
            let name = AXIS_NAMES[axis];
            let allowed = format_args!(" {name} ends at {at} (allowed {lower} to {upper})");
            complete = complete.and(core::fmt::write(&mut text, allowed));
        }
        if complete.is_ok() {
            self.replies.send(Reply::Text(&text));
        }
    }

    /// G10, G11 with the settings of M207 and M208; a second one in a row has no effect, as in Marlin.
    pub(crate) async fn firmware_retract(&mut self, retract: bool) -> Result<(), CommandError> {
        if retract == self.modal.retracted {
            return Ok(());
        }
        self.check_extrusion_temperature()?;
        let settings = self.modal.retraction;
        let (length_10nm, rate) = if retract {
            (-settings.length_10nm, settings.retract_10nm_per_s)
        } else {
            (settings.length_10nm + settings.extra_recover_10nm, settings.recover_10nm_per_s)
        };
        // As in Marlin, the flow does not scale a retraction: what is drawn back must be what is pushed again.
        let filament = filament_100pm(length_10nm, 100);
        let here = self.motion.position_10nm();
        let there = self.lifted(self.modal.machine_10nm, if retract { settings.lift_10nm } else { 0 });
        let feed_mm_per_s = self.motion.limits().max_feed_mm_per_s[2] as f32;
        let lift = Move { target_10nm: there, filament_100pm: 0, feed_mm_per_s, line: self.line, ends_move: false };
        let filament_move = Move { filament_100pm: filament, feed_mm_per_s: rate as f32 / 100_000.0, ..lift };
        // Draw back before lifting, lower before pushing forward: the nozzle never oozes in the air.
        if retract {
            self.motion.add(Move { target_10nm: here, ..filament_move }).await?;
            self.retracted(filament, here);
            self.modal.retracted = true;
            self.motion.add(lift).await?;
            self.modal.lift_10nm = settings.lift_10nm;
        } else {
            self.motion.add(lift).await?;
            self.modal.lift_10nm = 0;
            self.motion.add(filament_move).await?;
            self.retracted(filament, there);
            self.modal.retracted = false;
        }
        Ok(())
    }

    /// The filament of a firmware retraction was taken, to be moved where the machine stands then.
    fn retracted(&mut self, filament_100pm: i64, stands_10nm: [i64; 3]) {
        self.tally.filament_100pm += filament_100pm;
        let motor_steps = self.profile.geometry().motor_steps(stands_10nm);
        self.newest_retraction = Some(NewestRetraction { motor_steps, filament_100pm });
    }

    /// How much of the filament that a stop has left unpushed belongs to the newest firmware retraction, units of 0.1 nm.
    pub(crate) fn retraction_dropped_100pm(&self, dropped_100pm: i64) -> i64 {
        let Some(NewestRetraction { motor_steps, filament_100pm }) = self.newest_retraction else { return 0 };
        let [x, y, z, _] = self.motion.motor_steps();
        if [x, y, z] == motor_steps.map(i64::from) {
            // It is being made, has ended or is about to begin: all filament still to come was its own.
            dropped_100pm.clamp(filament_100pm.min(0), filament_100pm.max(0))
        } else if dropped_100pm == 0 {
            // Over.
            0
        } else {
            // Not begun.
            filament_100pm
        }
    }

    /// A machine position with Z lifted, as far as the soft limits let it, and shifted as M290 has it.
    fn lifted(&self, machine_10nm: [i64; 3], lift_10nm: i64) -> [i64; 3] {
        let [x, y, z] = machine_10nm;
        let mut lifted = [x, y, z + lift_10nm];
        if lift_10nm != 0 {
            self.clamp(&mut lifted);
        }
        let shift_10nm = self.modal.z.shift_10nm;
        lifted[2] += shift_10nm;
        if shift_10nm > 0 && self.modal.soft_limits && self.modal.homed[2] {
            lifted[2] = lifted[2].min(self.profile.size_10nm[2]);
        }
        lifted
    }

    /// Where the motors go for a machine position of the G-code.
    pub(crate) fn raised(&self, machine_10nm: [i64; 3]) -> [i64; 3] {
        self.lifted(machine_10nm, self.modal.lift_10nm)
    }

    /// G4.
    pub(crate) async fn dwell(&mut self, milliseconds: u64) -> Result<(), CommandError> {
        if milliseconds > LONGEST_DWELL_MS {
            let (value, maximum) = (milliseconds as f64, LONGEST_DWELL_MS as f64);
            return Err(CommandError::OutOfRange { word: 'P', value, minimum: 0.0, maximum });
        }
        self.motion.finish().await?;
        self.wait_ms(milliseconds).await
    }

    /// G92: the coordinates change, the machine stands.
    pub(crate) fn set_position(&mut self, words: &AxisWords) -> Result<(), CommandError> {
        let mut offset = self.modal.offset_10nm;
        for (axis, word) in [words.x, words.y, words.z].into_iter().enumerate() {
            if let Some(value) = word {
                let logical = self.modal.length_10nm(value).filter(|length| length.abs() <= MAX_COORDINATE_10NM);
                offset[axis] = logical.ok_or(CommandError::TooFar)? - self.modal.machine_10nm[axis];
            }
        }
        let extruder = match words.e {
            Some(value) => self.modal.length_10nm(value).filter(|length| length.abs() <= MAX_EXTRUDER_10NM),
            None => Some(self.modal.extruder_10nm),
        };
        self.modal.extruder_10nm = extruder.ok_or(CommandError::TooMuchFilament)?;
        if words.e.is_some() {
            self.block_extruder = None;
        }
        self.modal.offset_10nm = offset;
        Ok(())
    }

    /// Adds a move outside the G-code's own (homing).
    pub(crate) async fn move_to(&mut self, target_10nm: [i64; 3], feed_mm_per_s: f64) -> Result<Moved, CommandError> {
        let feed_mm_per_s = feed_mm_per_s as f32;
        let request = Move { target_10nm, filament_100pm: 0, feed_mm_per_s, line: self.line, ends_move: false };
        Ok(self.motion.add(request).await?)
    }
}
