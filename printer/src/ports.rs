//! The printer's surroundings, as traits.

pub(crate) mod accelerometer;
pub(crate) mod black_box;
pub(crate) mod identity;

use core::fmt;
use core::future::Future;

use embedded_hal_async::delay::DelayNs;
use ferrostep_gcode::{
    ChamberTemperature, Command, MotionFigures, NozzleTemperature, Remarks, Reply, ShortText, Temperatures,
    TimingFigures,
};
use ferrostep_hal_shim::{Clock, FanOutput, Heater, ServoPulses};
use ferrostep_planner::backlash::Backlash;
use ferrostep_planner::surface::{Bed, Mesh, MeshError};
use ferrostep_planner::{ChoiceError, Limits, MotionChoice, Move, Moved, PressureAdvance, Request, StepsPerMm};
use ferrostep_settings::{Slot, StoreError};
use ferrostep_tmc2209::{DriverReport, DriverSettings, DriverState, SettingsError};

use crate::error::Failure;
use crate::heat::gains::PidGains;
use crate::heat::model::HeaterModel;
use crate::heat::relay::RelayProgress;
use crate::heat::report::{FanStatus, HeatFault, HeaterStatus};
use crate::heat::step_response::StepProgress;
use crate::motion::fault::{HomingOutcome, MotionError, MotionFault};
use crate::part::Part;

/// A line of text that is formatted here.
pub(crate) type Text = heapless::String<384>;

/// The planner and the motors, seen from the command side.
pub trait Motion {
    /// True if the filament that the extruder pushes can be watched
    /// ([`crate::machine::Machine::pushed_filament`]).
    const FOLLOWS_FILAMENT: bool = true;

    /// Constant of [`ferrostep_hal_shim::MotionWatch::HAS_FILAMENT_SWITCH`].
    const HAS_FILAMENT_SWITCH: bool = true;
    /// Begins a command: any stop from now on ends its waits. Returns true if motion was stopped
    /// since the last command began, by anything but [`Self::stop`].
    fn begin_command(&mut self) -> bool {
        false
    }
    /// Number of stops of motion so far; it may wrap.
    fn stops(&self) -> u32 {
        0
    }
    /// Sets whether [`Self::wait_for_room_in_time`] waits at all
    /// ([`crate::machine::Machine::set_bounded_in_time`]).
    fn set_bounded_in_time(&mut self, _is_bounded: bool) {}
    /// Queues motion; waits for room.
    fn add(&mut self, request: impl Request) -> impl Future<Output = Result<Moved, MotionError>>;
    /// Waits while enough motion is queued that a host should not send more
    /// ([`crate::machine::Machine::holds_enough`]).
    fn wait_for_room_in_time(&mut self) -> impl Future<Output = Result<(), MotionError>> {
        async { Ok(()) }
    }
    /// Queues motion if that needs no waiting; `None` if it does, or might.
    fn try_add(&mut self, _request: &impl Request) -> Option<Result<Moved, MotionError>> {
        None
    }
    /// Sees a command before it is executed, with the unit of its lengths in mm. For planners by
    /// the rules of another firmware, which reads the words of its limits in its own way.
    fn see(&mut self, _command: &Command<'_>, _unit_mm: f64) {}
    /// The moves up to the next one that ends its line's move are chords of an arc. The centre is
    /// seen from its start, mm.
    fn begin_arc(&mut self, _centre_mm: [f64; 2], _is_clockwise: bool) {}
    /// Changes a fan with the motion queued so far; waits for room.
    fn set_fan_power(&mut self, fan: FanOutput, power: u8) -> impl Future<Output = Result<(), MotionError>>;
    /// Sets the pressure advance from the motion queued so far on; waits for room. `false`, and the
    /// advance is unchanged: it needs a standstill and [`Self::set_motion_choice`].
    fn set_pressure_advance(&mut self, advance: &PressureAdvance) -> impl Future<Output = Result<bool, MotionError>>;
    /// Watches until the motors have passed the beginning of a line: all moves of the lines before
    /// it have ended then.
    fn watch_line(&mut self, _line: u32) {}
    /// Returns true if the motors have passed it; at most one later move late.
    fn has_passed_line(&self) -> bool {
        true
    }
    /// Waits until all queued motion has ended. It is also an error if the plan of a prepared job's
    /// last block cannot be followed.
    fn finish(&mut self) -> impl Future<Output = Result<(), MotionError>>;
    /// The moves to come, until the position is set, are part of homing: a print's motion time
    /// leaves them out.
    fn begin_homing(&mut self) {}
    /// Runs a move at standstill until the end stop of `axis` triggers or the move ends.
    fn seek(&mut self, request: Move, axis: usize) -> impl Future<Output = Result<HomingOutcome, MotionError>>;
    /// Machine position at the end of all queued motion, units of 10 nm.
    fn position_10nm(&self) -> [i64; 3];
    /// Sets the machine's position, at standstill.
    fn set_position(&mut self, position_10nm: [i64; 3]);
    /// Steps that X, Y, Z (A, B, Z) and the extruder have made so far, also in motion.
    fn motor_steps(&self) -> [i64; 4];
    /// Digests and counters of all motion handed to the motors so far.
    fn figures(&self) -> MotionFigures;
    /// Limits of the moves to come.
    fn limits(&self) -> Limits;
    /// Sets the limits of the moves to come.
    fn set_limits(&mut self, limits: Limits);
    /// The methods that make the steps.
    fn motion_choice(&self) -> MotionChoice;
    /// Sets the methods that make the steps.
    ///
    /// # Errors
    /// [`ChoiceError`]; the choice is unchanged then.
    fn set_motion_choice(&mut self, choice: &MotionChoice) -> Result<(), ChoiceError>;
    /// Steps of the extruder in a millimetre of filament.
    fn extruder_steps_per_mm(&self) -> StepsPerMm;
    /// Sets the steps of the extruder in a millimetre of filament.
    ///
    /// # Errors
    /// [`ChoiceError::InMotion`]: the machine is not at standstill; the steps are unchanged then.
    fn set_extruder_steps_per_mm(&mut self, steps_per_mm: StepsPerMm) -> Result<(), ChoiceError>;
    /// Bed following, or a type without it: its code is compiled only for a bed that is followed.
    type Bed: Bed;
    /// True if Z can follow the bed.
    const HAS_BED: bool = Self::Bed::PRESENT;
    /// Looks at the measured mesh of the bed, or changes it while Z does not follow it; `None`
    /// without memory for one.
    fn mesh<T>(&mut self, _act: impl FnOnce(&mut Mesh) -> T) -> Option<T> {
        None
    }
    /// Makes Z follow the bed, or stops it, at standstill
    /// ([`crate::machine::Machine::follow_bed`]).
    ///
    /// # Errors
    /// [`MeshError`]; Z does not follow the bed then.
    fn follow_bed(&mut self, _on: bool) -> Result<(), MeshError> {
        Ok(())
    }
    /// Servo of the probe's pin, or no such part: its code is compiled only if it is present.
    type Servo: Part;
    /// Sends pulses to the probe's servo; they replace those that have not been sent.
    fn send_servo_pulses(&mut self, _pulses: ServoPulses) {}
    /// Waits until all of them have been sent; a stop ends the wait, and not the pulses.
    fn servo_pulses_sent(&mut self) -> impl Future<Output = Result<(), MotionError>> {
        async { Ok(()) }
    }
    /// Several motors that lift Z and are aligned, or not: the code for that is compiled only then.
    type ZMotors: Part;
    /// Selects the motors of Z that make the next steps
    /// ([`crate::machine::Machine::step_z_motors`]).
    fn step_z_motors(&mut self, _motors: u8) {}
    /// Several tools, one of them selected, or not: the code for that is compiled only then.
    type Tools: Part;
    /// Selects the extruder that makes the next steps, by its tool, whose nozzle has this offset
    /// from the first's ([`crate::machine::Machine::step_extruder`]).
    fn step_extruder(&mut self, _tool: u8, _offset_10nm: [i32; 2]) {}
    /// Play of the drives that is taken up, or none: the code for that is compiled only then.
    type Backlash: Part;
    /// The play of the drives.
    fn backlash(&self) -> Backlash {
        Backlash::NONE
    }
    /// Sets the play of the drives, at standstill.
    fn set_backlash(&mut self, _backlash: &Backlash) {}
    /// A signal that says that the supply fails, or none: the code that keeps a print then is
    /// compiled only where there is one.
    type SupplySignal: Part;
    /// Switches the motors of the axes in the mask on or off.
    fn set_motors_enabled(&mut self, axes: u8, enabled: bool);
    /// Returns true if [`crate::machine::Machine::rest`] has switched the motors off since the last
    /// call: they may have been turned since.
    fn take_switched_off(&mut self) -> bool {
        false
    }
    /// Takes the fault for which motion was stopped, if no wait has reported it.
    fn take_fault(&mut self) -> Option<MotionFault> {
        None
    }
    /// Returns true if the end stop of an axis is triggered.
    fn is_end_stop_triggered(&self, axis: usize) -> bool;
    /// Stops at once and forgets all queued motion; the position is then that of the motors.
    /// Returns the filament that was queued and not pushed, units of 0.1 nm.
    fn stop(&mut self) -> i64;
    /// Takes the filament that stops of others have left unpushed, units of 0.1 nm.
    fn take_dropped_100pm(&mut self) -> i64 {
        0
    }
}

/// The parts of a machine on which commands act.
pub trait Ports {
    /// The planner and the motors.
    type Motion: Motion;
    /// The heaters.
    type Heating: Heating;
    /// The time, and waits.
    type Clock: Clock + DelayNs + Clone;
    /// Receiver of replies.
    type Replies: Replies + ?Sized;
}

impl<M: Motion, H: Heating, T: Clock + DelayNs + Clone, R: Replies> Ports for (M, H, T, R) {
    type Motion = M;
    type Heating = H;
    type Clock = T;
    type Replies = R;
}

/// The usable parts of a board. Commands for the others are refused by name: a heater must not seem
/// hot, nor an axis homed, when it is not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Equipment {
    /// Heaters with their thermometers.
    pub heaters: bool,
    /// The sensors that homing looks for.
    pub end_stops: bool,
    /// The part-cooling fan.
    pub fan: bool,
}

impl Equipment {
    /// All parts.
    pub const ALL: Self = Self { heaters: true, end_stops: true, fan: true };
    /// Motors alone.
    pub const NONE: Self = Self { heaters: false, end_stops: false, fan: false };
}

/// Heater control, seen from the command side.
pub trait Heating {
    /// Sets a target, degrees Celsius; 0 switches the heater off.
    fn set_target(&mut self, heater: Heater, celsius: f32);
    /// Returns true if the chamber has a heater beside its thermometer; `None` without either.
    fn chamber_is_heated(&self) -> Option<bool> {
        None
    }
    /// The heater of the selected tool's nozzle.
    fn nozzle(&self) -> Heater {
        Heater::Nozzle
    }
    /// The selected tool's nozzle has this heater from now on.
    fn select_nozzle(&mut self, _heater: Heater) {}
    /// Returns true if a further tool has its own nozzle.
    fn has_nozzles(&self) -> bool {
        false
    }
    /// Temperature, target and power of a heater.
    fn status(&self, heater: Heater) -> HeaterStatus;
    /// Switches all heaters off.
    fn all_off(&mut self);
    /// The gains of a heater.
    fn gains(&self, _heater: Heater) -> PidGains {
        PidGains::default()
    }
    /// Sets the gains of a heater.
    fn set_gains(&mut self, _heater: Heater, _gains: PidGains) {}
    /// Tunes a heater by a relay, see [`crate::heat::HeatControl::begin_relay`].
    fn begin_relay(&mut self, _heater: Heater, _celsius: f32, _cycles: u8, _has_fan: bool) {}
    /// Progress of a heater's autotune; `None` without one.
    fn relay(&self, _heater: Heater) -> Option<RelayProgress> {
        None
    }
    /// [`crate::Present`] if heaters may be controlled by a model.
    type Models: Part;
    /// The model that controls a heater; `None` if a PID loop does.
    fn model(&self, _heater: Heater) -> Option<HeaterModel> {
        None
    }
    /// Changes the model of a heater.
    fn set_model(&mut self, _heater: Heater, _model: HeaterModel) {}
    /// Finds the model of a heater, see [`crate::heat::HeatControl::begin_step`].
    fn begin_step(&mut self, _heater: Heater, _celsius: f32, _has_fan: bool) {}
    /// Progress of a heater's step response; `None` without one.
    fn step(&self, _heater: Heater) -> Option<StepProgress> {
        None
    }
    /// Power and speed of a fan.
    fn fan(&self, _output: FanOutput) -> FanStatus {
        FanStatus::default()
    }
    /// The first fan that has full power and turns too slowly.
    fn stalled_fan(&self) -> Option<FanOutput> {
        None
    }
    /// [`crate::Present`] if the power supply may be switched.
    type Supply: Part;
    /// True if the machine may have outputs other than fans
    /// ([`crate::heat::fans::FanRule::Output`]).
    const HAS_OUTPUTS: bool = true;
    /// Switches the power supply; off switches all heaters off as well.
    fn set_supply(&mut self, _on: bool) {}
    /// Returns true if the power supply is on; one that cannot be switched always is.
    fn is_supply_on(&self) -> bool {
        true
    }
    /// M112: switches all heaters off, and the power supply if that can be switched.
    fn halt(&mut self) {
        self.all_off();
    }
    /// M999: heaters may be switched on again after a fault.
    ///
    /// # Errors
    /// The fault is still there, and all heaters stay off.
    fn restart(&mut self) -> Result<(), HeatFault>;
}

/// Times that a board measures while it prints (M798). Boards may do without.
pub trait Timing: core::fmt::Debug {
    /// Switches the measuring on or off; measured values stay.
    fn switch(&self, on: bool);
    /// Clears the measured values.
    fn clear(&self);
    /// The values measured so far.
    fn figures(&self) -> [TimingFigures; 3];
}

/// Motor drivers that can be set; machines may have none. Motors are X (A), Y (B), Z and E, 0 to 3,
/// then the further ones of Z, whose settings are those of Z.
pub trait MotorDrivers: core::fmt::Debug {
    /// State of a driver: it has confirmed its settings, or has failed; `None` for a motor whose
    /// driver cannot be set.
    fn state(&self, motor: usize) -> Option<DriverState>;
    /// A driver's report.
    fn report(&self, motor: usize) -> Option<DriverReport>;
    /// Checks whether a driver could be set to this.
    ///
    /// # Errors
    /// It does not have such a setting.
    fn check(&self, motor: usize, settings: &DriverSettings) -> Result<(), SettingsError>;
    /// Sets a driver, which is then unconfirmed for a while.
    ///
    /// # Errors
    /// The driver does not have this setting, and keeps the old ones.
    fn set(&self, motor: usize, settings: DriverSettings) -> Result<(), SettingsError>;
    /// Takes the mask of the motors (0 to 3, Z's as one) that may not be where their steps say
    /// since the last call.
    fn take_moved(&self) -> u8;
}

/// A memory that keeps settings without power ([`ferrostep_settings::Store`]).
/// Machines may do without.
pub trait SettingsMemory: core::fmt::Debug {
    /// The newest record; `None` if the memory is empty.
    ///
    /// # Errors
    /// The memory does not work.
    fn load<'s>(&self, slot: &'s mut Slot) -> Result<Option<&'s [u8]>, StoreError>;
    /// Stores a record, at standstill.
    ///
    /// # Errors
    /// The memory does not work.
    fn save(&self, record: &[u8]) -> Result<(), StoreError>;
    /// Returns true if the processor is stopped meanwhile, so that no heater may be on.
    fn stalls(&self) -> bool;
}

/// Receiver of replies. Several commands may answer, so this takes a shared reference.
pub trait Replies {
    /// Sends a reply, line by line.
    fn send(&self, reply: Reply<'_>);

    /// Formats a line and sends it. Where it is kept as a text before, one that is too long is cut.
    fn say(&self, line: fmt::Arguments<'_>) {
        let mut text = Text::new();
        let _ = fmt::write(&mut text, line);
        self.send(Reply::Text(&text));
    }

    /// Takes a remark on a line, whose words are ignored, changed or without effect; `new` is the
    /// part that was not reported in this job before.
    fn remark(&self, line: u32, text: &str, _remarks: &Remarks, new: &Remarks) {
        if !new.is_empty() {
            let text = ShortText::new(text);
            self.say(format_args!("echo:line {line}: \"{text}\": {new} (said once a job)"));
        }
    }

    /// Takes a remark with numbers on a line.
    fn note(&self, line: u32, text: fmt::Arguments<'_>) {
        self.say(format_args!("echo:line {line}: {text}"));
    }

    /// Takes an unknown command.
    fn unknown(&self, _line: u32, text: &str) {
        self.send(Reply::UnknownCommand(text));
    }

    /// Explains why a line was refused.
    fn refuse(&self, line: u32, failure: &Failure) {
        self.say(format_args!("echo:line {line}: {failure}"));
    }
}

/// All temperatures as reports show them.
pub fn temperatures(heating: &impl Heating) -> Temperatures {
    let nozzle = heating.status(heating.nozzle());
    let bed = heating.status(Heater::Bed);
    let power = |share: f32| (share * 127.0) as u8;
    let chamber = heating.chamber_is_heated().map(|is_heated| {
        let HeaterStatus { celsius, target_celsius, power: share } = heating.status(Heater::Chamber);
        ChamberTemperature { celsius, target: target_celsius, power: is_heated.then(|| power(share)) }
    });
    let nozzles = heating.has_nozzles().then(|| {
        [Heater::Nozzle, Heater::Nozzle1].map(|heater| {
            let HeaterStatus { celsius, target_celsius, power: share } = heating.status(heater);
            NozzleTemperature { celsius, target: target_celsius, power: power(share) }
        })
    });
    Temperatures {
        nozzles,
        chamber,
        nozzle: nozzle.celsius,
        nozzle_target: nozzle.target_celsius,
        bed: bed.celsius,
        bed_target: bed.target_celsius,
        nozzle_power: power(nozzle.power),
        bed_power: power(bed.power),
    }
}

/// [`crate::Present`] if the machine may have several tools.
pub(crate) type ToolsPart<P> = <<P as Ports>::Motion as Motion>::Tools;
