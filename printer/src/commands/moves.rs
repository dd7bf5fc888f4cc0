//! G0 to G4, G10, G11 and G92: pass the interpreter's moves to the motors.

use ferrostep_gcode::{ArcForm, AxisWords, Decimal, Real};
use ferrostep_hal_shim::Heater;
use ferrostep_planner::{Move, filament_100pm};

use crate::error::CommandError;
use crate::motion::axis_names::AXIS_NAMES;
use crate::motion::interpreter::AskedMove;
use crate::ports::{Heating, Motion, Ports, Replies, Text};
use crate::printer::Printer;

/// A dwell of more than eleven days is taken for a mistake.
const LONGEST_DWELL_MS: u64 = 1_000_000_000;

impl<P: Ports> Printer<'_, P> {
    /// G0, G1.
    pub(crate) async fn linear(
        &mut self,
        rapid: bool,
        axes: &AxisWords,
        feed: Option<Decimal>,
    ) -> Result<(), CommandError> {
        let mut asked = self.interpreter.linear(rapid, axes, feed, self.lines.number)?;
        if asked.request.filament_100pm != 0 {
            match self.check_extrusion_temperature() {
                Err(CommandError::ColdExtrusion { minimum_celsius, .. })
                    if axes.is_e_alone() && self.is_meant_cold() =>
                {
                    let least = Real::short(minimum_celsius, 2);
                    self.replies.note(
                        self.lines.number,
                        format_args!("cold extrusion prevented, expected at least {least} C: the filament stays"),
                    );
                    asked = asked.without_filament();
                }
                checked => checked?,
            }
        }
        if asked.displaces {
            self.motion.add(asked.request).await?;
        }
        self.taken(&asked);
        // After the move, not before: a move that a host sends during the wait would be one more to
        // finish.
        Ok(self.motion.wait_for_room_in_time().await?)
    }

    /// G2, G3.
    pub(crate) async fn arc(
        &mut self,
        clockwise: bool,
        axes: &AxisWords,
        form: ArcForm,
        feed: Option<Decimal>,
    ) -> Result<(), CommandError> {
        let mut moves = self.interpreter.arc(clockwise, axes, form, feed, self.lines.number)?;
        if moves.extrudes {
            self.check_extrusion_temperature()?;
        }
        self.motion.begin_arc(moves.centre_mm, clockwise);
        while let Some(asked) = moves.next(&self.interpreter) {
            self.motion.add(asked.request).await?;
            self.taken(&asked);
            self.motion.wait_for_room_in_time().await?;
        }
        Ok(())
    }

    /// Updates the interpreter for a move that the planner has accepted.
    fn taken(&mut self, asked: &AskedMove) {
        self.interpreter.take(asked);
        if asked.request.ends_move && asked.clamped.contains(&true) {
            self.say_clamped(asked.clamped, asked.reach_10nm);
        }
    }

    pub(crate) fn check_extrusion_temperature(&self) -> Result<(), CommandError> {
        let modal = &self.interpreter.modal;
        if !modal.cold_extrusion_allowed {
            self.needs(self.fitted.equipment.heaters, "thermometers")?;
        }
        let celsius = self.heating.status(self.nozzle()).celsius;
        let minimum_celsius = modal.min_extrusion_celsius;
        if modal.cold_extrusion_allowed || celsius >= minimum_celsius {
            return Ok(());
        }
        Err(CommandError::ColdExtrusion { celsius, minimum_celsius })
    }

    /// Returns true if commands themselves have left the nozzle without a target at which filament
    /// is extruded. Filament-only moves are then skipped, as in Marlin: some makers' start code
    /// makes them after its purge. Nothing is displaced.
    pub(crate) fn is_meant_cold(&self) -> bool {
        !self.is_meant_hot(self.nozzle())
    }

    /// Returns true if commands have given a nozzle a target at which filament is extruded.
    pub(crate) fn is_meant_hot(&self, nozzle: Heater) -> bool {
        let target_celsius = self.modes.targets_celsius.get(nozzle.index()).copied().unwrap_or_default();
        target_celsius >= self.interpreter.modal.min_extrusion_celsius
    }

    /// Reports how a move would have left the travel of some axes; an arc may do so along its path,
    /// which `reach_10nm` covers.
    pub(crate) fn say_clamped(&self, clamped: [bool; 3], reach_10nm: Option<[[i64; 2]; 2]>) {
        let mut text = Text::new();
        let line = self.lines.number;
        let mut complete = core::fmt::write(&mut text, format_args!("echo:line {line}: outside the soft limits,"));
        for axis in (0..3).filter(|&axis| clamped[axis]) {
            let modal = &self.interpreter.modal;
            let [lower, upper] = self.interpreter.asked_travel_10nm(axis, modal.machine_10nm, modal.lift_10nm);
            let (mut at, mut verb) = (modal.machine_10nm[axis], "ends at");
            if let Some([least, most]) = reach_10nm.and_then(|reach| reach.get(axis).copied()) {
                (at, verb) = (if most - upper > lower - least { most } else { least }, "goes to");
            }
            // In the G-code's coordinates, which a reader finds in the file.
            let [at, lower, upper] = [at, lower, upper].map(|length_10nm| {
                let of_job_10nm = length_10nm.wrapping_add(modal.offset_10nm[axis]);
                Real::fixed(of_job_10nm as f64 / 100_000.0, 2)
            });
            let name = AXIS_NAMES[axis];
            let allowed = format_args!(" {name} {verb} {at} (allowed {lower} to {upper})");
            complete = complete.and(core::fmt::write(&mut text, allowed));
        }
        if complete.is_ok() {
            self.replies.say(format_args!("{text}"));
        }
    }

    /// Executes G10 and G11 with the settings of M207 and M208; a second one in a row has no
    /// effect, as in Marlin.
    pub(crate) async fn firmware_retract(&mut self, retract: bool) -> Result<(), CommandError> {
        let modal = &self.interpreter.modal;
        if retract == modal.retracted {
            return Ok(());
        }
        self.check_extrusion_temperature()?;
        let settings = modal.retraction;
        let (length_10nm, rate) = if retract {
            (-settings.length_10nm, settings.retract_10nm_per_s)
        } else {
            (settings.length_10nm + settings.extra_recover_10nm, settings.recover_10nm_per_s)
        };
        // As in Marlin, flow does not scale a retraction: the same length must be retracted and
        // pushed again.
        let filament = filament_100pm(length_10nm, 100);
        let here = self.motion.position_10nm();
        let there = self.interpreter.lifted(modal.machine_10nm, if retract { settings.lift_10nm } else { 0 });
        let feed_mm_per_s = self.motion.limits().max_feed_mm_per_s[2] as f32;
        let lift =
            Move { target_10nm: there, filament_100pm: 0, feed_mm_per_s, line: self.lines.number, ends_move: false };
        let filament_move = Move { filament_100pm: filament, feed_mm_per_s: rate as f32 / 100_000.0, ..lift };
        // Retract before lifting, lower before pushing forward, so that the nozzle never oozes in
        // the air.
        if retract {
            self.motion.add(Move { target_10nm: here, ..filament_move }).await?;
            self.interpreter.take_retraction(filament, here);
            self.interpreter.modal.retracted = true;
            self.motion.add(lift).await?;
            self.interpreter.modal.lift_10nm = settings.lift_10nm;
        } else {
            self.motion.add(lift).await?;
            self.interpreter.modal.lift_10nm = 0;
            self.motion.add(filament_move).await?;
            self.interpreter.take_retraction(filament, there);
            self.interpreter.modal.retracted = false;
        }
        Ok(())
    }

    /// G4.
    pub(crate) async fn dwell(&mut self, milliseconds: u64) -> Result<(), CommandError> {
        if milliseconds > LONGEST_DWELL_MS {
            let (value, maximum) = (milliseconds as f64, LONGEST_DWELL_MS as f64);
            return Err(CommandError::OutOfRange { word: 'P', value, minimum: 0.0, maximum });
        }
        self.motion.finish().await?;
        self.waits().for_ms(milliseconds).await
    }

    /// G92.
    pub(crate) fn set_position(&mut self, words: &AxisWords) -> Result<(), CommandError> {
        self.interpreter.set_position(words)?;
        Ok(())
    }
}
