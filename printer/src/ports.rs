//! What the printer needs of its surroundings.

use core::future::Future;
use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU16, AtomicU32, Ordering};

use embedded_hal_async::delay::DelayNs;
use ferrostep_gcode::{MotionFigures, Reply, TimingFigures};
use ferrostep_hal_shim::{Clock, Heater};
use ferrostep_planner::{ChoiceError, Limits, MotionChoice, Move, MoveError, Moved, Request};
use ferrostep_tmc2209::{DriverReport, DriverSettings, DriverState, SettingsError};

use crate::error::Failure;
use crate::heat::HeatFault;
use crate::profile::DEFAULT_HEATER_TIMEOUT_S;

/// Why motion was not possible.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotionError {
    /// The planner refused the move.
    Move(MoveError),
    /// Motion was stopped (M112, M410) before it ended.
    Stopped,
    /// The firmware has found its own motion wrong and stopped it.
    Fault(MotionFault),
}

/// Motion that is not as planned: an error of the firmware or of the chip. Motion has stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotionFault {
    /// A motor does not stand where its block ends.
    Miscount(Miscount),
    /// A step was planned nearer to the one before than the drivers or the step interrupt allow.
    StepsTooNear,
    /// The step interrupt has missed this many updates of its timer within a few milliseconds.
    MissedUpdates(u32),
}

/// A motor that does not stand where its block ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Miscount {
    /// The motor: X, Y, Z (CoreXY: A, B, Z), extruder.
    pub motor: usize,
    /// Where it stands, steps.
    pub counted: i64,
    /// Where the block ends, steps.
    pub expected: i64,
}

impl Miscount {
    /// The first motor that does not stand where it must; `None` if all do.
    pub fn between(counted: [i64; 4], expected: [i64; 4]) -> Option<Self> {
        let motors = counted.into_iter().zip(expected).enumerate();
        let mut wrong = motors.filter(|(_, (counted, expected))| counted != expected);
        wrong.next().map(|(motor, (counted, expected))| Self { motor, counted, expected })
    }
}

/// How a move towards a sensor ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HomingOutcome {
    /// The sensor triggered; the motors stand there.
    Triggered,
    /// The move ended without it.
    Missed,
}

/// The planner and the motors, seen from the command side.
pub trait Motion {
    /// A command begins: what it waits for ends with any stop from now on. Whether motion was stopped since the last one
    /// began, by others than [`Self::stop`].
    fn begin_command(&mut self) -> bool {
        false
    }
    /// How often motion was stopped so far; it may wrap.
    fn stops(&self) -> u32 {
        0
    }
    /// Queues motion; waits for room.
    fn add(&mut self, request: impl Request) -> impl Future<Output = Result<Moved, MotionError>>;
    /// Queues motion if that needs no waiting; `None` where it does, or might.
    fn try_add(&mut self, _request: &impl Request) -> Option<Result<Moved, MotionError>> {
        None
    }
    /// Says where the machine is to less than a step; whether the motors stand there.
    fn refine_position(&mut self, position_10nm: [i64; 3]) -> bool;
    /// Changes the fan with the motion queued so far; waits for room.
    fn set_fan_power(&mut self, power: u8) -> impl Future<Output = Result<(), MotionError>>;
    /// Waits until all queued motion has ended. An error, too, where the plan of a prepared job's last block could not be
    /// followed.
    fn finish(&mut self) -> impl Future<Output = Result<(), MotionError>>;
    /// The moves to come, until the position is set, are part of homing: a print's motion time leaves them out.
    fn begin_homing(&mut self) {}
    /// Runs a move at standstill until the end stop of `axis` triggers or the move ends.
    fn seek(&mut self, request: Move, axis: usize) -> impl Future<Output = Result<HomingOutcome, MotionError>>;
    /// Machine position at the end of all queued motion, units of 10 nm.
    fn position_10nm(&self) -> [i64; 3];
    /// Says where the machine is, at standstill.
    fn set_position(&mut self, position_10nm: [i64; 3]);
    /// Live step counters of X, Y, Z (A, B, Z) and the extruder.
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
    /// [`ChoiceError`]; nothing has changed then.
    fn set_motion_choice(&mut self, choice: &MotionChoice) -> Result<(), ChoiceError>;
    /// Switches the motors of the axes in the mask on or off.
    fn set_motors_enabled(&mut self, axes: u8, enabled: bool);
    /// Whether motors were switched off by [`crate::machine::Machine::rest`] since this was last asked: none is where its
    /// steps say.
    fn take_switched_off(&mut self) -> bool {
        false
    }
    /// Takes the fault for which motion was stopped, if no wait has reported it.
    fn take_fault(&mut self) -> Option<MotionFault> {
        None
    }
    /// Whether the end stop of an axis is triggered.
    fn is_end_stop_triggered(&self, axis: usize) -> bool;
    /// Stops at once and forgets all queued motion; the position is then where the motors stand. Returns the filament
    /// that was queued and not pushed, units of 0.1 nm.
    fn stop(&mut self) -> i64;
    /// Takes the filament that stops of others have left unpushed, units of 0.1 nm.
    fn take_dropped_100pm(&mut self) -> i64 {
        0
    }
}

/// What a printer's commands act on.
pub trait Ports {
    /// The planner and the motors.
    type Motion: Motion;
    /// The heaters.
    type Heating: Heating;
    /// The time, and waits for it.
    type Clock: Clock + DelayNs + Clone;
    /// Where replies go.
    type Replies: Replies;
}

impl<M: Motion, H: Heating, T: Clock + DelayNs + Clone, R: Replies> Ports for (M, H, T, R) {
    type Motion = M;
    type Heating = H;
    type Clock = T;
    type Replies = R;
}

/// The parts of a board that can be used. Commands for the others are refused by name, so that nobody takes for hot or
/// homed what is not.
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

/// A heater as a report shows it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HeaterStatus {
    /// Temperature, degrees Celsius.
    pub celsius: f32,
    /// Target, degrees Celsius; 0 = off.
    pub target_celsius: f32,
    /// Power, 0 to 1.
    pub power: f32,
}

/// Heater control, seen from the command side.
pub trait Heating {
    /// Sets a target, degrees Celsius; 0 switches the heater off.
    fn set_target(&mut self, heater: Heater, celsius: f32);
    /// How a heater is.
    fn status(&self, heater: Heater) -> HeaterStatus;
    /// Switches all heaters off.
    fn all_off(&mut self);
    /// M999: heaters may be switched on again after a fault.
    ///
    /// # Errors
    /// The fault is still there, and all heaters stay off.
    fn restart(&mut self) -> Result<(), HeatFault>;
}

/// Times that a board measures of itself while it prints (M798). A board need not have it.
pub trait Timing: core::fmt::Debug {
    /// Switches the measuring on or off; what was measured stays.
    fn switch(&self, on: bool);
    /// Forgets what was measured.
    fn clear(&self);
    /// What was measured so far.
    fn figures(&self) -> [TimingFigures; 3];
}

/// Motor drivers that can be set. A machine need not have any. Motors are X (A), Y (B), Z and E, 0 to 3.
pub trait MotorDrivers: core::fmt::Debug {
    /// Whether a driver can be relied on; `None` for a motor without one that can be set.
    fn state(&self, motor: usize) -> Option<DriverState>;
    /// How a driver is.
    fn report(&self, motor: usize) -> Option<DriverReport>;
    /// Whether a driver could be set to this.
    ///
    /// # Errors
    /// It could not.
    fn check(&self, motor: usize, settings: &DriverSettings) -> Result<(), SettingsError>;
    /// Sets a driver, which is then unconfirmed for a while.
    ///
    /// # Errors
    /// It cannot be set to this; nothing has changed.
    fn set(&self, motor: usize, settings: DriverSettings) -> Result<(), SettingsError>;
    /// Mask of the motors that may not be where their steps say, since this was last asked.
    fn take_moved(&self) -> u8;
}

/// Where replies go. Several commands may answer, so this takes a shared reference.
pub trait Replies {
    /// Sends a reply, line by line.
    fn send(&self, reply: Reply<'_>);

    /// Explains why a line was refused.
    fn refuse(&self, line: u32, failure: &Failure) {
        let mut text = heapless::String::<384>::new();
        // A text that does not fit is cut; the failure itself is whole.
        let _ = core::fmt::write(&mut text, format_args!("echo:line {line}: {failure}"));
        self.send(Reply::Text(&text));
    }
}

/// Flags between the command side and those who act on bytes as they arrive, or on time.
#[derive(Debug, Default)]
pub struct Signals {
    end_wait: AtomicBool,
    halted: AtomicBool,
    waiting_for_heat: AtomicBool,
    report_interval_s: AtomicU8,
    keep_alive_s: AtomicU8,
    is_at_work: AtomicBool,
    idle_timeout_s: AtomicU32,
    heater_timeout_s: AtomicU16,
    host_spoke: AtomicBool,
}

/// Seconds at rest after which motors are switched off, unless M84 S says otherwise: Marlin's.
pub const IDLE_TIMEOUT_S: u32 = 120;

impl Signals {
    /// Nothing signalled; `busy` messages every two seconds.
    pub const fn new() -> Self {
        Self {
            end_wait: AtomicBool::new(false),
            halted: AtomicBool::new(false),
            waiting_for_heat: AtomicBool::new(false),
            report_interval_s: AtomicU8::new(0),
            keep_alive_s: AtomicU8::new(2),
            is_at_work: AtomicBool::new(false),
            idle_timeout_s: AtomicU32::new(IDLE_TIMEOUT_S),
            heater_timeout_s: AtomicU16::new(DEFAULT_HEATER_TIMEOUT_S),
            host_spoke: AtomicBool::new(false),
        }
    }

    /// M108: the present wait ends.
    pub fn end_wait(&self) {
        self.end_wait.store(true, Ordering::Release);
    }

    /// Takes the request to end a wait.
    pub(crate) fn take_end_wait(&self) -> bool {
        self.end_wait.swap(false, Ordering::AcqRel)
    }

    /// Whether a command is being executed: a wait, too, is work.
    pub fn is_at_work(&self) -> bool {
        self.is_at_work.load(Ordering::Acquire)
    }

    pub(crate) fn set_at_work(&self, is_at_work: bool) {
        self.is_at_work.store(is_at_work, Ordering::Release);
    }

    /// Seconds at rest after which motors are switched off (M84 S); 0 = never.
    pub fn idle_timeout_s(&self) -> u32 {
        self.idle_timeout_s.load(Ordering::Relaxed)
    }

    pub(crate) fn set_idle_timeout_s(&self, seconds: u64) {
        self.idle_timeout_s.store(u32::try_from(seconds).unwrap_or(u32::MAX), Ordering::Relaxed);
    }

    /// Seconds without use after which heaters go off (M86); 0 = never.
    pub fn heater_timeout_s(&self) -> u16 {
        self.heater_timeout_s.load(Ordering::Relaxed)
    }

    pub(crate) fn set_heater_timeout_s(&self, seconds: u16) {
        self.heater_timeout_s.store(seconds, Ordering::Relaxed);
    }

    /// A host has sent a line, or a frame of a prepared job. From any priority: the receiving interrupt calls it, for a line may
    /// have to wait its turn.
    pub fn note_host(&self) {
        self.host_spoke.store(true, Ordering::Release);
    }

    /// Whether a host has sent anything since this was last taken.
    pub fn has_host_spoken(&self) -> bool {
        self.host_spoke.load(Ordering::Acquire)
    }

    /// Takes that.
    pub fn take_host_spoken(&self) -> bool {
        self.host_spoke.swap(false, Ordering::AcqRel)
    }

    /// M112, or a heater fault: every wait ends and every command is refused until M999. Who sets it has switched
    /// heaters off and stopped the motors.
    pub fn halt(&self) {
        self.halted.store(true, Ordering::Release);
    }

    /// Whether the machine is halted.
    pub fn is_halted(&self) -> bool {
        self.halted.load(Ordering::Acquire)
    }

    /// M999.
    pub(crate) fn restart(&self) {
        self.halted.store(false, Ordering::Release);
    }

    /// Seconds between temperature reports (M155); 0 = off, and while a wait for heat prints its own.
    pub fn report_interval_s(&self) -> u8 {
        if self.is_waiting_for_heat() { 0 } else { self.report_interval_s.load(Ordering::Relaxed) }
    }

    pub(crate) fn is_waiting_for_heat(&self) -> bool {
        self.waiting_for_heat.load(Ordering::Relaxed)
    }

    pub(crate) fn set_waiting_for_heat(&self, waiting: bool) {
        self.waiting_for_heat.store(waiting, Ordering::Relaxed);
    }

    pub(crate) fn set_report_interval_s(&self, seconds: u8) {
        self.report_interval_s.store(seconds, Ordering::Relaxed);
    }

    /// Seconds between `busy` messages (M113); 0 = off.
    pub fn keep_alive_s(&self) -> u8 {
        self.keep_alive_s.load(Ordering::Relaxed)
    }

    pub(crate) fn set_keep_alive_s(&self, seconds: u8) {
        self.keep_alive_s.store(seconds, Ordering::Relaxed);
    }
}
