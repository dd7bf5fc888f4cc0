//! G34, Z_TILT_ADJUST and QUAD_GANTRY_LEVEL: the motors that lift Z are brought to one height above the bed.
//!
//! The probe measures the bed at the profile's points. The surface that the motors can make, and that is nearest to the heights, says how
//! high the bed is at each motor ([`ZAlignment::weights`]): each one moves away from the bed by that, less what the lowest would move. The
//! idea is that of Klipper's `z_tilt` and `quad_gantry_level`, and of Marlin's G34.

use ferrostep_gcode::{AxisFlags, Decimal, Real};

use super::{Heights, MM, Z};
use crate::error::CommandError;
use crate::homing::Homing;
use crate::ports::{Motion, Ports, Replies};
use crate::printer::Printer;
use crate::profile::{MeshSettings, ZAlignment, ZMotors};
use crate::z_offset::within;

/// Motors, at most.
const MOTORS: usize = ZMotors::FURTHER + 1;

/// Mask of all of them.
const ALL: u8 = (1 << MOTORS) - 1;

/// Marlin's ranges and defaults of I, T and A (Z_STEPPER_ALIGN_ITERATIONS, _ACC, _AMP), T in units of 10 nm.
const ROUNDS: [u8; 3] = [1, 30, 5];
const ACCURACY_10NM: [i64; 3] = [1_000, 100_000, 2_000];
const AMPLIFICATION: [f64; 3] = [0.5, 2.0, 1.0];

/// How a G34 fails. The lines before have said by how much.
const GROWS: &str = "the points differ by no less than before the motors of Z were moved: is each plugged in where the profile says \
                     (z_motors.motors), and does none run the other way round?";
const ENDS: &str = "the points still differ by more than T: send G34 once more, with a larger I or T";
const TOO_FAR: &str = "the motors of Z are farther apart than z_motors.max_correction_mm: bring them nearer by hand";

/// What a G34 is to reach.
#[derive(Clone, Copy, Debug)]
struct Goal {
    rounds: u8,
    accuracy_10nm: i64,
    amplification: f32,
}

impl<P: Ports> Printer<'_, P> {
    /// G34. Afterwards Z is homed anew, and follows no mesh: the points of the mesh stay.
    pub(super) async fn align_z(
        &mut self,
        rounds: Option<u8>,
        accuracy: Option<Decimal>,
        amplification: Option<Decimal>,
        settings: &MeshSettings,
    ) -> Result<(), CommandError> {
        let profile = self.profile;
        let Some(alignment) = profile.z_alignment() else { return Ok(()) };
        self.needs_home()?;
        let goal = self.goal(rounds, accuracy, amplification)?;
        let follows = self.interpreter.modal.follows_bed;
        let _off = self.switch_bed(false);
        let outcome = self.align_to(&goal, alignment, settings).await;
        self.follow_probing();
        let is_homed = self.interpreter.modal.homed[Z];
        if outcome.is_err() && !is_homed {
            // The place of the bed, too, is that of motors at other heights.
            self.interpreter.forget_home(1 << Z);
        }
        if is_homed && follows {
            let _as_before = self.switch_bed(true);
        }
        outcome?;
        if is_homed {
            return Ok(());
        }
        let (motion, interpreter) = (&mut self.motion, &mut self.interpreter);
        let mut homing = Homing { motion, interpreter, drivers: self.drivers, line: self.line };
        homing.home(AxisFlags { z: true, ..AxisFlags::default() }).await
    }

    /// Probes, and moves the motors, until the points agree.
    async fn align_to(
        &mut self,
        goal: &Goal,
        alignment: &ZAlignment,
        settings: &MeshSettings,
    ) -> Result<(), CommandError> {
        // How far apart the ends of the bed are is not known yet.
        let mut clearance_10nm = alignment.max_correction_10nm;
        let mut round = 0;
        loop {
            let around = MeshSettings {
                lift_10nm: settings.lift_10nm + clearance_10nm,
                depth_10nm: settings.depth_10nm + clearance_10nm,
                ..*settings
            };
            let mut heights_10nm = [0; ZAlignment::MAX_POINTS];
            for (point, height_10nm) in alignment.points_10nm.iter().flatten().zip(&mut heights_10nm) {
                let mut heights = Heights::NONE;
                self.probe(*point, settings.samples, &around, &mut heights).await?;
                *height_10nm = heights.mean_10nm();
            }
            let range_10nm = self.report_points(alignment, &heights_10nm);
            if range_10nm <= goal.accuracy_10nm {
                return Ok(());
            }
            if round > 0 && range_10nm >= clearance_10nm {
                return Err(CommandError::NotAligned(GROWS));
            }
            if round == goal.rounds {
                return Err(CommandError::NotAligned(ENDS));
            }
            clearance_10nm = range_10nm;
            round += 1;
            let raises_10nm = self.raises_10nm(alignment, &heights_10nm, goal.amplification)?;
            self.raise_motors(&raises_10nm).await?;
        }
    }

    #[inline(never)]
    fn goal(
        &self,
        rounds: Option<u8>,
        accuracy: Option<Decimal>,
        amplification: Option<Decimal>,
    ) -> Result<Goal, CommandError> {
        let [least, most, usual] = ROUNDS;
        let rounds = rounds.unwrap_or(usual);
        if !(least..=most).contains(&rounds) {
            let (value, minimum, maximum) = (rounds.into(), least.into(), most.into());
            return Err(CommandError::OutOfRange { word: 'I', value, minimum, maximum });
        }
        let [least, most, usual] = ACCURACY_10NM;
        let accuracy_10nm = match accuracy {
            Some(accuracy) => self.interpreter.modal.length_10nm(accuracy).ok_or(CommandError::TooFar)?,
            None => usual,
        };
        let accuracy_10nm = within('T', accuracy_10nm, least, most)?;
        let [minimum, maximum, usual] = AMPLIFICATION;
        let value = amplification.map_or(usual, Decimal::to_f64);
        if !(minimum..=maximum).contains(&value) {
            return Err(CommandError::OutOfRange { word: 'A', value, minimum, maximum });
        }
        Ok(Goal { rounds, accuracy_10nm, amplification: value as f32 })
    }

    /// By how much each motor moves away from the bed, units of 10 nm; the lowest number stands for none. Reports what the motors differ by.
    #[inline(never)]
    fn raises_10nm(
        &self,
        alignment: &ZAlignment,
        heights_10nm: &[i64; ZAlignment::MAX_POINTS],
        amplification: f32,
    ) -> Result<[i64; MOTORS], CommandError> {
        let count = self.profile.z_motors.map_or(1, |motors| motors.0.count());
        let mut raises_10nm = [0; MOTORS];
        for (raise, weights) in raises_10nm.iter_mut().zip(&alignment.weights).take(count) {
            // Heights are within 1 m, and no weight is above 10.
            *raise =
                weights.iter().zip(heights_10nm).map(|(weight, height)| weight * *height as f32).sum::<f32>() as i64;
        }
        let moved = raises_10nm.get(..count).unwrap_or_default();
        let least_10nm = moved.iter().copied().min().unwrap_or(0);
        let apart_10nm = moved.iter().copied().max().unwrap_or(0) - least_10nm;
        for (number, raise_10nm) in moved.iter().enumerate() {
            let name =
                ferrostep_tmc2209::motor_name(if number == 0 { Z } else { ferrostep_tmc2209::MOTORS + number - 1 });
            let by = Real::fixed((raise_10nm - least_10nm) as f64 / MM, 4);
            self.replies.say(format_args!("echo:motor {name} moves by {by}"));
        }
        if apart_10nm > alignment.max_correction_10nm {
            return Err(CommandError::NotAligned(TOO_FAR));
        }
        for raise in raises_10nm.iter_mut().take(count) {
            *raise = ((*raise - least_10nm) as f32 * amplification) as i64 + least_10nm;
        }
        // Motors that are not there move no more than the lowest.
        raises_10nm.iter_mut().skip(count).for_each(|raise| *raise = least_10nm);
        Ok(raises_10nm)
    }

    /// Moves each motor away from the bed by its number, less the lowest of them: all together that have still to move, so that the bed
    /// or the gantry never tilts more than before. Then Z is where the points say that it is.
    async fn raise_motors(&mut self, raises_10nm: &[i64; MOTORS]) -> Result<(), CommandError> {
        self.interpreter.modal.homed[Z] = false;
        let home_10nm = self.home_height_10nm();
        let least_10nm = raises_10nm.iter().copied().min().unwrap_or(0);
        let mut outcome = Ok(());
        let mut done_10nm = least_10nm;
        while let Some(next_10nm) = raises_10nm.iter().copied().filter(|raise| *raise > done_10nm).min() {
            let further = raises_10nm.iter().enumerate().filter(|(_, raise)| **raise >= next_10nm);
            let motors = further.fold(0, |motors, (motor, _)| motors | 1 << motor);
            self.motion.step_z_motors(motors);
            let [.., z_10nm] = self.motion.position_10nm();
            let (motion, interpreter) = (&mut self.motion, &mut self.interpreter);
            let mut homing = Homing { motion, interpreter, drivers: self.drivers, line: self.line };
            outcome = homing.rise_over_bed(z_10nm + next_10nm - done_10nm).await;
            if outcome.is_err() {
                break;
            }
            done_10nm = next_10nm;
        }
        self.motion.step_z_motors(ALL);
        outcome?;
        // All of the bed is where its lowest place was, as seen from where the motors stood before.
        let [x_10nm, y_10nm, z_10nm] = self.motion.position_10nm();
        self.motion.set_position([x_10nm, y_10nm, z_10nm - done_10nm]);
        self.interpreter.modal.z.trigger_10nm = Some(home_10nm);
        Ok(())
    }

    /// Reports the points; returns by how much they differ, units of 10 nm.
    #[inline(never)]
    fn report_points(&self, alignment: &ZAlignment, heights_10nm: &[i64; ZAlignment::MAX_POINTS]) -> i64 {
        let (mut least_10nm, mut most_10nm) = (i64::MAX, i64::MIN);
        for ([x, y], height_10nm) in alignment.points_10nm.iter().flatten().zip(heights_10nm) {
            self.report_place([*x, *y], *height_10nm);
            (least_10nm, most_10nm) = (least_10nm.min(*height_10nm), most_10nm.max(*height_10nm));
        }
        let range_10nm = most_10nm - least_10nm;
        self.replies.say(format_args!("echo:the points differ by {} mm", Real::fixed(range_10nm as f64 / MM, 4)));
        range_10nm
    }
}
