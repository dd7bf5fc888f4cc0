//! G34, Z_TILT_ADJUST and QUAD_GANTRY_LEVEL: bring the motors that lift Z to one height above the
//! bed.
//!
//! The probe measures the bed at the profile's points. Of the surfaces that the motors can produce,
//! the one nearest to the heights gives the bed's height at each motor ([`ZAlignment::weights`]):
//! each motor moves away from the bed by that height, minus the move of the lowest. The idea is
//! that of Klipper's `z_tilt` and `quad_gantry_level`, and of Marlin's G34.

use ferrostep_gcode::{Decimal, Real};
use ferrostep_tmc2209::motor_name;

use super::{Heights, MM, Z};
use crate::error::CommandError;
use crate::motion::homing::Homing;
use crate::part::Part;
use crate::ports::{Motion, Ports, Replies};
use crate::printer::Printer;
use crate::settings::bounds::within;
use crate::settings::profile::homing::MeshSettings;
use crate::settings::profile::z_motors::{ZAlignment, ZMotors};

/// Maximum number of motors.
const MOTORS: usize = ZMotors::FURTHER + 1;

/// Mask of all motors.
const ALL: u8 = (1 << MOTORS) - 1;

/// Marlin's ranges and defaults of I, T and A (Z_STEPPER_ALIGN_ITERATIONS, _ACC, _AMP), T
/// in units of 10 nm.
const ROUNDS: [u8; 3] = [1, 30, 5];
const ACCURACY_10NM: [i64; 3] = [1_000, 100_000, 2_000];
const AMPLIFICATION: [f64; 3] = [0.5, 2.0, 1.0];

/// Errors of G34. Earlier lines have reported the differences.
const GROWS: &str = "the points differ by no less than before the motors of Z were moved: is each plugged in where the profile says \
                     (z_motors.motors), and does none run the other way round?";
const ENDS: &str = "the points still differ by more than T: send G34 again, with a larger I or T";
const TOO_FAR: &str = "the motors of Z are farther apart than z_motors.max_correction_mm: bring them nearer by hand";

/// Goal of a G34.
#[derive(Clone, Copy, Debug)]
struct Goal {
    rounds: u8,
    accuracy_10nm: i64,
    amplification: f32,
}

/// Moves of the Z motors, units of 10 nm.
#[derive(Clone, Copy, Debug)]
struct Raises {
    /// Height of the bed at the motor where it is lowest.
    least_10nm: i32,
    /// Move of each motor away from the bed; at least one is 0, and so are those of absent motors.
    by_10nm: [i32; MOTORS],
}

impl<P: Ports> Printer<'_, P> {
    /// Returns true if the machine can align the motors that lift Z.
    pub fn aligns_z(&self) -> bool {
        <P::Motion as Motion>::ZMotors::PRESENT && self.profile.aligns_z()
    }

    /// Executes G34. Afterwards Z is where the probe found the bed at the homing place, and follows
    /// no mesh if a motor has moved; the mesh keeps its points.
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
        match outcome {
            // Nothing was moved.
            Ok(false) if follows => {
                let _as_before = self.switch_bed(true);
            }
            Ok(true) => self.interpreter.modal.homed[Z] = true,
            Ok(false) => {}
            // The bed's height that homing found may be that of motors at other heights.
            Err(_) if !self.interpreter.modal.homed[Z] => self.interpreter.forget_home(1 << Z),
            Err(_) => {}
        }
        outcome.map(|_| ())
    }

    /// Probes and moves the motors until the points agree, then probes where Z homes. Returns
    /// `false` if no motor had to move.
    async fn align_to(
        &mut self,
        goal: &Goal,
        alignment: &ZAlignment,
        settings: &MeshSettings,
    ) -> Result<bool, CommandError> {
        let mut places_10nm = alignment.points_10nm;
        // The height difference between the ends of the bed is not known yet.
        let mut clearance_10nm = alignment.max_correction_10nm;
        let mut round = 0;
        let mut agree = false;
        loop {
            let around = MeshSettings {
                lift_10nm: settings.lift_10nm + clearance_10nm,
                depth_10nm: settings.depth_10nm + clearance_10nm,
                ..*settings
            };
            let mut heights_10nm = [0; ZAlignment::MAX_POINTS];
            for (place_10nm, height_10nm) in places_10nm.iter().flatten().zip(&mut heights_10nm) {
                let mut heights = Heights::NONE;
                self.probe(*place_10nm, settings.samples, &around, &mut heights).await?;
                // Within 1 m.
                *height_10nm = heights.mean_10nm() as i32;
            }
            if agree {
                let [height_10nm, ..] = heights_10nm;
                self.lower_z(height_10nm.into());
                return Ok(true);
            }
            let range_10nm = self.report_points(alignment, &heights_10nm);
            if range_10nm <= goal.accuracy_10nm {
                if round == 0 {
                    return Ok(false);
                }
                agree = true;
                places_10nm = [None; ZAlignment::MAX_POINTS];
                places_10nm[0] = self.home_place().or(alignment.points_10nm[0]);
                continue;
            }
            if round > 0 && range_10nm >= clearance_10nm {
                return Err(CommandError::NotAligned(GROWS));
            }
            if round == goal.rounds {
                return Err(CommandError::NotAligned(ENDS));
            }
            clearance_10nm = range_10nm;
            round += 1;
            let raises = self.raises(alignment, &heights_10nm, goal.amplification)?;
            self.raise_motors(&raises).await?;
        }
    }

    /// Place of the probe while Z homes; `None` if that may be anywhere.
    fn home_place(&self) -> Option<[i64; 2]> {
        let [x_10nm, y_10nm] = self.profile.safe_homing.home_at_10nm?;
        let [offset_x_10nm, offset_y_10nm, _] = self.interpreter.modal.probe_offset_10nm;
        Some([x_10nm + offset_x_10nm, y_10nm + offset_y_10nm])
    }

    /// Lowers the motors' position by `by_10nm`, because the bed is that much higher; the probe's
    /// trigger position stays.
    fn lower_z(&mut self, by_10nm: i64) {
        let home_10nm = self.home_height_10nm();
        let [x_10nm, y_10nm, z_10nm] = self.motion.position_10nm();
        self.motion.set_position([x_10nm, y_10nm, z_10nm - by_10nm]);
        self.interpreter.modal.z.trigger_10nm = Some(home_10nm);
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

    /// Computes the move of each motor, and reports it.
    #[inline(never)]
    fn raises(
        &self,
        alignment: &ZAlignment,
        heights_10nm: &[i32; ZAlignment::MAX_POINTS],
        amplification: f32,
    ) -> Result<Raises, CommandError> {
        let count = self.profile.z_motors.map_or(1, |motors| motors.0.count());
        let mut raises_10nm = [0.0; MOTORS];
        for (raise, weights) in raises_10nm.iter_mut().zip(&alignment.weights) {
            *raise = weights.iter().zip(heights_10nm).map(|(weight, height)| weight * *height as f32).sum::<f32>();
        }
        let there = raises_10nm.get(..count).unwrap_or_default();
        let least_10nm = there.iter().copied().fold(f32::INFINITY, f32::min);
        let mut raises = Raises { least_10nm: least_10nm as i32, by_10nm: [0; MOTORS] };
        let mut apart_10nm = 0.0;
        for (number, (raise_10nm, by_10nm)) in there.iter().zip(&mut raises.by_10nm).enumerate() {
            let away_10nm = raise_10nm - least_10nm;
            apart_10nm = f32::max(apart_10nm, away_10nm);
            *by_10nm = (away_10nm * amplification) as i32;
            let name = motor_name(if number == 0 { Z } else { ferrostep_tmc2209::MOTORS + number - 1 });
            let by = Real::fixed(f64::from(*by_10nm) / MM, 4);
            self.replies.say(format_args!("echo:motor {name} moves by {by}"));
        }
        if apart_10nm as i64 > alignment.max_correction_10nm {
            return Err(CommandError::NotAligned(TOO_FAR));
        }
        Ok(raises)
    }

    /// Moves each motor away from the bed, together with all others that still have to move, so
    /// that the bed or the gantry never tilts more than before. Afterwards Z is where the points
    /// say that it is.
    async fn raise_motors(&mut self, raises: &Raises) -> Result<(), CommandError> {
        self.interpreter.modal.homed[Z] = false;
        let mut outcome = Ok(());
        let mut done_10nm = 0;
        while let Some(next_10nm) = raises.by_10nm.iter().copied().filter(|by| *by > done_10nm).min() {
            let further = raises.by_10nm.iter().enumerate().filter(|(_, by)| **by >= next_10nm);
            let motors = further.fold(0, |motors, (motor, _)| motors | 1 << motor);
            self.motion.step_z_motors(motors);
            let [.., z_10nm] = self.motion.position_10nm();
            let (motion, interpreter) = (&mut self.motion, &mut self.interpreter);
            let mut homing = Homing { motion, interpreter, drivers: self.fitted.drivers, line: self.lines.number };
            outcome = homing.rise_over_bed(z_10nm + i64::from(next_10nm - done_10nm)).await;
            if outcome.is_err() {
                break;
            }
            done_10nm = next_10nm;
        }
        self.motion.step_z_motors(ALL);
        outcome?;
        // Seen from the motors' earlier position, the whole bed is now where its lowest place was.
        self.lower_z((raises.least_10nm + done_10nm).into());
        Ok(())
    }

    /// Reports the points; returns their difference, units of 10 nm.
    #[inline(never)]
    fn report_points(&self, alignment: &ZAlignment, heights_10nm: &[i32; ZAlignment::MAX_POINTS]) -> i64 {
        let (mut least_10nm, mut most_10nm) = (i32::MAX, i32::MIN);
        for ([x, y], height_10nm) in alignment.points_10nm.iter().flatten().zip(heights_10nm) {
            self.report_place([*x, *y], (*height_10nm).into());
            (least_10nm, most_10nm) = (least_10nm.min(*height_10nm), most_10nm.max(*height_10nm));
        }
        let range_10nm = i64::from(most_10nm) - i64::from(least_10nm);
        self.replies.say(format_args!("echo:the points differ by {} mm", Real::fixed(range_10nm as f64 / MM, 4)));
        range_10nm
    }
}
