//! Motors, kinematics and axes: from steps to the nozzle's position, and its effect on
//! switches, probe and bed.
//!
//! Positions are exact: a motor's field is counted in 1/256 of a full step (`i64`), an axis in half
//! of that, so that the mean of two CoreXY motors is exact as well.
//!
//! | what | test |
//! |---|---|
//! | Cartesian and CoreXY (A = X + Y, B = X - Y) | `cartesian_*`, `core_xy_*` |
//! | hard ends: the carriage stays, the field runs ahead, the rotor slips by four full steps, the load is 1 |
//! `a_motor_at_the_frame_*`, `core_xy_a_stall_*` |
//! | outputs off: steps move nothing; outputs on again: the rotor snaps to the nearest position of the field |
//! `without_current_*`, `the_rotor_snaps_*`, `a_rotor_rests_*` |
//! | end stops: hysteresis, bounce, stuck, polarity ([`end_stop`]) | `end_stop::tests` |
//! | several motors lift Z, and tilt what they lift ([`lift`]) | `lift::tests`, `a_further_motor_of_z_*` |
//! | probe over the sheet only, hysteresis, noise, dead, always on; nozzle pressed into the sheet ([`sheet`]) | `sheet::tests`, `the_probe_*` |
//!
//! Left out, and why:
//! - Mass, belts' stretch and torque: a motor follows its field at any speed unless something
//!   blocks it. Steps lost by speed depend on the machine, not on the firmware's logic.
//! - A blocked rotor swings between the frame and two full steps before it (slipping); it does not
//!   bounce further. Pushing into the sheet does not stop Z: the depth is recorded instead.
//! - A motor without current keeps its position: Z does not sink, and no hand pushes the carriage.

pub mod end_stop;
pub mod lift;
pub mod sheet;
#[cfg(test)]
mod tests;

use end_stop::{EndStop, EndStopConfig};
use lift::Lift;
use sheet::{Probe, ProbeConfig, Sheet, SheetConfig};

/// Microsteps of 1/256 in an electrical period: four full steps.
const PERIOD: i64 = 1024;
/// Half a period, in halves of 1/256: a field further ahead pulls the rotor in the
/// opposite direction.
const SLIP_HALVES: i64 = PERIOD;
/// Halves of 1/256 in a full step.
const FULL_STEP_HALVES: i64 = 512;

/// Coupling of the motors to the axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Kinematics {
    /// Motors 0, 1, 2 move X, Y, Z.
    Cartesian,
    /// Motor 0 is A = X + Y, motor 1 is B = X - Y, motor 2 moves Z. A and B have the same steps
    /// per mm: motor 0's.
    CoreXy,
}

/// A motor and its ratio to the axis.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MotorConfig {
    /// Full steps per millimetre of its axis (or of filament).
    pub full_steps_per_mm: f64,
    /// A field that counts up moves the axis down.
    pub inverted: bool,
}

/// An axis between its ends.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct AxisConfig {
    /// Lower end of its travel in mm.
    pub minimum_mm: f64,
    /// Upper end of its travel in mm.
    pub maximum_mm: f64,
    /// Distance of the frame beyond the lower end, in mm.
    pub frame_below_mm: f64,
    /// Distance of the frame beyond the upper end, in mm.
    pub frame_above_mm: f64,
    /// The position at the start, in mm.
    pub start_mm: f64,
}

/// Everything that moves. Motors from 3 on are extruders, or lift Z beside its own;
/// they meet no ends.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Config {
    /// Coupling of motors 0 and 1 to X and Y.
    pub kinematics: Kinematics,
    /// X, Y, Z.
    pub axes: [AxisConfig; 3],
    /// X or A, Y or B, Z, then extruders.
    pub motors: Vec<MotorConfig>,
    /// The motors that lift Z, where there are several.
    pub lift: Option<Lift>,
    /// Switches along axes.
    pub end_stops: Vec<EndStopConfig>,
    /// The bed's sheet.
    pub sheet: SheetConfig,
    /// The probe beside the nozzle.
    pub probe: Option<ProbeConfig>,
}

/// The changes of a call, which the run must pass on.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Effect {
    /// Motors' loads, for their drivers.
    pub loads: bool,
    /// Levels of end stops or of the probe.
    pub lines: bool,
}

impl std::ops::BitOrAssign for Effect {
    fn bitor_assign(&mut self, other: Self) {
        self.loads |= other.loads;
        self.lines |= other.lines;
    }
}

/// The fate of a motor's steps.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct MotorRecord {
    /// Steps while its driver gave no current.
    pub unpowered_steps: u64,
    /// Electrical periods (four full steps) by which the rotor slipped, in either direction.
    pub slipped_periods: u64,
    /// The sum of the slips in 1/256 of a full step, positive with the field ahead upwards: the
    /// error of the firmware's position.
    pub lost_256: i64,
    /// The sum of jumps when current returned, in 1/256.
    pub snapped_256: i64,
}

#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
struct Motor {
    sign: i64,
    field_256: i64,
    /// Field minus the driver's microstep counter, modulo a period.
    phase_256: i64,
    energized: bool,
    record: MotorRecord,
}

#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
struct Axis {
    halves_per_mm: f64,
    low_frame: i64,
    high_frame: i64,
    position: i64,
    /// Lead of the field over the carriage.
    lead: i64,
    /// 1 while it pushes against the upper frame, -1 against the lower one, 0 when free.
    leaning: i64,
    /// The furthest field towards the frame since it pushes.
    furthest: i64,
}

impl Axis {
    /// Moves to the field's position as far as the frame allows; true if the pushing changed.
    fn follow(&mut self, field: i64) -> bool {
        self.position = field.clamp(self.low_frame, self.high_frame);
        self.lead = field - self.position;
        let before = self.leaning;
        if self.lead != 0 {
            self.leaning = self.lead.signum();
            self.furthest =
                if before == self.leaning { self.furthest.max(field * before) } else { field * self.leaning };
        } else if before != 0 {
            // Free again after a full step back.
            let outward = field * before;
            self.furthest = self.furthest.max(outward);
            if outward < self.furthest - FULL_STEP_HALVES {
                self.leaning = 0;
            }
        }
        self.leaning != before
    }
}

/// Motors, axes, and the sensors along them.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Motion {
    kinematics: Kinematics,
    motors: Vec<Motor>,
    axes: [Axis; 3],
    end_stops: Vec<EndStop>,
    lift: Option<Lift>,
    sheet: Sheet,
    probe: Option<Probe>,
    full_steps_per_mm: Vec<f64>,
}

impl Motion {
    /// The machine at its start, motors without current.
    ///
    /// # Errors
    /// X, Y or Z has no motor, steps per mm are not positive, an axis's ends are swapped or its
    /// start is beyond the frame, or an end stop belongs to an unknown axis.
    pub fn new(config: Config) -> Result<Self, String> {
        if config.motors.len() < 3 {
            return Err(format!("{} motors, expected at least 3: X or A, Y or B, Z", config.motors.len()));
        }
        for (index, motor) in config.motors.iter().enumerate() {
            if !(motor.full_steps_per_mm > 0.0 && motor.full_steps_per_mm.is_finite()) {
                return Err(format!(
                    "motors[{index}].full_steps_per_mm is {}, expected a number above 0",
                    motor.full_steps_per_mm
                ));
            }
        }
        for (index, axis) in config.axes.iter().enumerate() {
            let frame = axis.minimum_mm - axis.frame_below_mm..=axis.maximum_mm + axis.frame_above_mm;
            if !(axis.minimum_mm < axis.maximum_mm && frame.contains(&axis.start_mm)) {
                return Err(format!(
                    "axes[{index}]: the minimum must be below the maximum, and the start within the frame"
                ));
            }
        }
        if let Some(index) = config.end_stops.iter().position(|stop| stop.axis > 2) {
            return Err(format!("end_stops[{index}].axis is {}, expected 0 to 2", config.end_stops[index].axis));
        }
        let per_mm = |axis: usize| match (config.kinematics, axis) {
            (Kinematics::CoreXy, 1) => config.motors[0].full_steps_per_mm,
            _ => config.motors[axis].full_steps_per_mm,
        };
        let axes = [0, 1, 2].map(|index| {
            let halves_per_mm = per_mm(index) * FULL_STEP_HALVES as f64;
            let axis = &config.axes[index];
            Axis {
                halves_per_mm,
                low_frame: ((axis.minimum_mm - axis.frame_below_mm) * halves_per_mm).round() as i64,
                high_frame: ((axis.maximum_mm + axis.frame_above_mm) * halves_per_mm).round() as i64,
                // A whole number of 1/256 for each motor, also for sum and difference of two.
                position: (axis.start_mm * halves_per_mm / 2.0).round() as i64 * 2,
                lead: 0,
                leaning: 0,
                furthest: 0,
            }
        });
        let (x, y) = (axes[0].position / 2, axes[1].position / 2);
        let fields = match config.kinematics {
            Kinematics::Cartesian => [x, y, axes[2].position / 2],
            Kinematics::CoreXy => [x + y, x - y, axes[2].position / 2],
        };
        let motors = config.motors.iter().enumerate().map(|(index, motor)| {
            let lifts = config.lift.as_ref().is_some_and(|lift| lift.is_further(index));
            // They begin level with the axis's own.
            let field_256 = fields.get(if lifts { 2 } else { index }).copied().unwrap_or(0);
            let sign = if motor.inverted { -1 } else { 1 };
            Motor { sign, field_256, phase_256: field_256, energized: false, record: MotorRecord::default() }
        });
        let scale = [0, 1, 2].map(|axis: usize| axes[axis].halves_per_mm);
        let end_stops = config.end_stops.iter().map(|stop| EndStop::new(stop, scale[stop.axis]));
        let mut motion = Self {
            kinematics: config.kinematics,
            motors: motors.collect(),
            end_stops: end_stops.collect(),
            lift: config.lift,
            sheet: Sheet::new(config.sheet),
            probe: config.probe.map(Probe::new),
            full_steps_per_mm: config.motors.iter().map(|motor| motor.full_steps_per_mm).collect(),
            axes,
        };
        for axis in 0..3 {
            motion.update_sensors(0, axis);
        }
        // No switch bounces at the start.
        for stop in &mut motion.end_stops {
            stop.come_to_rest();
        }
        Ok(motion)
    }

    /// Follows a step at a driver's outputs, `delta_256` by the driver's count. An unknown
    /// motor has no effect.
    pub fn step(&mut self, now_ns: u64, motor: usize, delta_256: i32) -> Effect {
        let Some(moved) = self.motors.get_mut(motor) else { return Effect::default() };
        if !moved.energized {
            moved.record.unpowered_steps += 1;
            return Effect::default();
        }
        moved.field_256 += moved.sign * i64::from(delta_256);
        self.follow(now_ns, motor)
    }

    /// Follows a driver's outputs, on or off, at the field's position `mscnt`. Repeated
    /// calls have no effect.
    ///
    /// Off, the rotor stays where it is. On, it snaps to the nearest position of the field,
    /// within two full steps.
    pub fn set_energized(&mut self, now_ns: u64, motor: usize, on: bool, mscnt: u16) -> Effect {
        let lead_256 = self.lead_256(motor);
        let Some(changed) = self.motors.get_mut(motor) else { return Effect::default() };
        if changed.energized == on {
            return Effect::default();
        }
        changed.energized = on;
        if on {
            let ahead = (changed.sign * i64::from(mscnt) + changed.phase_256 - changed.field_256).rem_euclid(PERIOD);
            let jump = if ahead > PERIOD / 2 { ahead - PERIOD } else { ahead };
            changed.field_256 += jump;
            changed.record.snapped_256 += jump;
        } else {
            changed.field_256 -= lead_256;
            let effect = self.follow(now_ns, motor);
            return self.rest(now_ns, motor, effect);
        }
        self.follow(now_ns, motor)
    }

    /// Clears the remaining leads when both motors of CoreXY are off and nothing pushes any more.
    fn rest(&mut self, now_ns: u64, motor: usize, mut effect: Effect) -> Effect {
        let both = self.kinematics == Kinematics::CoreXy && motor < 2;
        if both && !self.motors[0].energized && !self.motors[1].energized {
            let leads = [self.lead_256(0), self.lead_256(1)];
            self.motors[0].field_256 -= leads[0];
            self.motors[1].field_256 -= leads[1];
            effect |= self.follow(now_ns, motor);
        }
        effect
    }

    /// The lead of a motor's field over its rotor, in 1/256.
    fn lead_256(&self, motor: usize) -> i64 {
        let (x, y) = (self.axes[0].lead, self.axes[1].lead);
        match (self.kinematics, motor) {
            (Kinematics::CoreXy, 0) => (x + y) / 2,
            (Kinematics::CoreXy, 1) => (x - y) / 2,
            (_, 0..=2) => self.axes[motor].lead / 2,
            _ => 0,
        }
    }

    /// Makes the carriage follow the fields after one of them moved.
    fn follow(&mut self, now_ns: u64, motor: usize) -> Effect {
        let mut effect = Effect::default();
        match (self.kinematics, motor) {
            (Kinematics::CoreXy, 0 | 1) => {
                let (a, b) = (self.motors[0].field_256, self.motors[1].field_256);
                effect.loads |= self.axes[0].follow(a + b) | self.axes[1].follow(a - b);
                let (x, y) = (self.axes[0].lead, self.axes[1].lead);
                if x | y != 0 {
                    // Both leads are compared before either slips: a push along X slips
                    // A and B together.
                    let slipped = [self.slip(0, x + y), self.slip(1, x - y)];
                    if slipped != [false; 2] {
                        let (a, b) = (self.motors[0].field_256, self.motors[1].field_256);
                        self.axes[0].furthest = i64::MIN / 2;
                        self.axes[1].furthest = i64::MIN / 2;
                        effect.loads |= self.axes[0].follow(a + b) | self.axes[1].follow(a - b);
                    }
                }
                effect.lines = self.update_sensors(now_ns, 0) | self.update_sensors(now_ns, 1);
            }
            (_, 0..=2) => {
                effect.loads = self.axes[motor].follow(2 * self.motors[motor].field_256);
                let lead = self.axes[motor].lead;
                if lead != 0 && self.slip(motor, lead) {
                    self.axes[motor].furthest = i64::MIN / 2;
                    effect.loads |= self.axes[motor].follow(2 * self.motors[motor].field_256);
                }
                effect.lines = self.update_sensors(now_ns, motor);
            }
            (_, motor) if self.lift.as_ref().is_some_and(|lift| lift.is_further(motor)) => {
                effect.lines = self.update_sensors(now_ns, 2);
            }
            _ => {}
        }
        effect
    }

    /// Turns the screw of a motor that lifts Z by hand, with its rotor, while it
    /// has no current, mm.
    pub fn turn_by_hand(&mut self, motor: usize, by_mm: f64) {
        let Some(per_mm) = self.full_steps_per_mm.get(motor) else { return };
        let by_256 = (by_mm * per_mm * 256.0).round() as i64;
        if let Some(turned) = self.motors.get_mut(motor).filter(|motor| !motor.energized) {
            turned.field_256 += by_256;
            turned.phase_256 += by_256;
        }
    }

    /// Height of the nozzle at a place above that at Z's own motor, because others
    /// lift Z as well, mm.
    fn raised_mm(&self, place_mm: [f64; 2]) -> f64 {
        self.lift.as_ref().map_or(0.0, |lift| lift.raised_mm(place_mm, |motor| self.motor_mm(motor)))
    }

    /// Slips a rotor whose field is more than half a period ahead; true if it slipped.
    fn slip(&mut self, motor: usize, lead_halves: i64) -> bool {
        if lead_halves.abs() <= SLIP_HALVES {
            return false;
        }
        let lost = PERIOD * lead_halves.signum();
        let motor = &mut self.motors[motor];
        motor.field_256 -= lost;
        motor.record.slipped_periods += 1;
        motor.record.lost_256 += lost;
        true
    }

    /// Reports an axis's new position to the sensors along it; true if a level changed.
    fn update_sensors(&mut self, now_ns: u64, axis: usize) -> bool {
        let position = self.axes[axis].position;
        let mut changed = false;
        for stop in &mut self.end_stops {
            if stop.axis() == axis {
                changed |= stop.update(now_ns, position);
            }
        }
        let z_mm = self.position_mm(2);
        // Nothing rules out a touch where Z tilts.
        let is_near = self.lift.is_some()
            || self.sheet.may_touch(z_mm)
            || self.probe.as_ref().is_some_and(|probe| probe.may_change(&self.sheet, z_mm));
        if is_near {
            let (x_mm, y_mm) = (self.position_mm(0), self.position_mm(1));
            self.sheet.press(now_ns, x_mm, y_mm, z_mm + self.raised_mm([x_mm, y_mm]));
            let (dx_mm, dy_mm) = self.probe.as_ref().map_or((0.0, 0.0), Probe::offset_mm);
            let z_mm = z_mm + self.raised_mm([x_mm + dx_mm, y_mm + dy_mm]);
            if let Some(probe) = &mut self.probe {
                changed |= probe.update(&self.sheet, x_mm, y_mm, z_mm);
            }
        }
        changed
    }

    /// Bounces the switches up to `now_ns`; true if a level changed.
    pub fn advance(&mut self, now_ns: u64) -> bool {
        self.end_stops.iter_mut().fold(false, |changed, stop| stop.advance(now_ns) | changed)
    }

    /// The next bounce of a switch, ns.
    pub fn next_event_ns(&self) -> Option<u64> {
        self.end_stops.iter().filter_map(EndStop::next_event_ns).min()
    }

    /// The position of an axis, in mm (0 for X, 1 for Y, 2 for Z).
    pub fn position_mm(&self, axis: usize) -> f64 {
        self.axes.get(axis).map_or(0.0, |axis| axis.position as f64 / axis.halves_per_mm)
    }

    /// The position of a motor's field, in 1/256 of a full step: exact, with the axis's sign.
    pub fn field_256(&self, motor: usize) -> i64 {
        self.motors.get(motor).map_or(0, |motor| motor.field_256)
    }

    /// The filament that an extruder has fed, or the position of a motor's field, in mm.
    pub fn motor_mm(&self, motor: usize) -> f64 {
        self.full_steps_per_mm.get(motor).map_or(0.0, |per_mm| self.field_256(motor) as f64 / (per_mm * 256.0))
    }

    /// The fate of a motor's steps.
    pub fn record(&self, motor: usize) -> MotorRecord {
        self.motors.get(motor).map_or_else(MotorRecord::default, |motor| motor.record)
    }

    /// A motor's load for its driver: 1 while it pushes against the frame, otherwise 0. With CoreXY
    /// both motors push.
    pub fn load(&self, motor: usize) -> f32 {
        let leaning = match (self.kinematics, motor) {
            (Kinematics::CoreXy, 0 | 1) => self.axes[0].leaning | self.axes[1].leaning,
            (_, 0..=2) => self.axes[motor].leaning,
            _ => 0,
        };
        if leaning == 0 { 0.0 } else { 1.0 }
    }

    /// An end stop, by its index in the configuration.
    pub fn end_stop(&self, index: usize) -> Option<&EndStop> {
        self.end_stops.get(index)
    }

    /// An end stop to break or mend.
    pub fn end_stop_mut(&mut self, index: usize) -> Option<&mut EndStop> {
        self.end_stops.get_mut(index)
    }

    /// The probe.
    pub fn probe(&self) -> Option<&Probe> {
        self.probe.as_ref()
    }

    /// The nozzle's height above the sheet below the probe, mm; `None` beside the sheet.
    pub fn probe_gap_mm(&self) -> Option<f64> {
        let (dx_mm, dy_mm) = self.probe.as_ref()?.offset_mm();
        let (x_mm, y_mm) = (self.position_mm(0) + dx_mm, self.position_mm(1) + dy_mm);
        let nozzle_mm = self.position_mm(2) + self.raised_mm([x_mm, y_mm]);
        self.sheet.height_mm(x_mm, y_mm).map(|height_mm| nozzle_mm - height_mm)
    }

    /// The probe, to break or mend.
    pub fn probe_mut(&mut self) -> Option<&mut Probe> {
        self.probe.as_mut()
    }

    /// The sheet, which records how deep the nozzle was pressed into it.
    pub fn sheet(&self) -> &Sheet {
        &self.sheet
    }

    /// Puts an obstacle into an axis's path: the axis now ends at these positions in mm, or at its
    /// own if that is beyond them.
    pub fn set_frame(&mut self, axis: usize, low_mm: f64, high_mm: f64) {
        if let Some(axis) = self.axes.get_mut(axis) {
            axis.low_frame = ((low_mm * axis.halves_per_mm).round() as i64).min(axis.position);
            axis.high_frame = ((high_mm * axis.halves_per_mm).round() as i64).max(axis.position);
        }
    }
}
