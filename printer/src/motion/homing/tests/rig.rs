//! A printer whose motors arrive at once, and whose sensors a test chooses.

use core::cell::{Cell, RefCell};
use core::pin::pin;
use core::task::{Context, Poll, Waker};

use ferrostep_gcode::{MotionFigures, PinCommand, Reply};
use ferrostep_hal_shim::{Clock, FanOutput, Heater, ServoPulses};
use ferrostep_planner::backlash::Backlash;
use ferrostep_planner::surface::NoBed;
use ferrostep_planner::{ChoiceError, Limits, MotionChoice, Move, Moved, PressureAdvance, Request, StepsPerMm};
use ferrostep_tmc2209::{DriverReport, DriverSettings, DriverState, DriverStatus, SettingsError};

use crate::heat::gains::PidGains;
use crate::heat::model::HeaterModel;
use crate::heat::report::{HeatFault, HeaterStatus};
use crate::motion::fault::{HomingOutcome, MotionError};
use crate::motion::machine::tests::profile;
use crate::ports::{Heating, Motion, MotorDrivers, Replies};
use crate::printer::Printer;
use crate::settings::profile::Profile;
use crate::settings::profile::homing::HomeEnd;
use crate::signals::Signals;

/// The size of each axis, mm.
pub const SIZE_MM: i64 = 200;

/// Units of 10 nm in a millimetre.
pub const MM: i64 = 100_000;

/// The sensor at an axis's end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sensor {
    /// The sensor triggers at the end of the true travel.
    Good,
    /// The sensor is never triggered.
    Dead,
    /// The sensor is always triggered.
    Stuck,
    /// The input has the sensor of this axis.
    WiredTo(usize),
}

/// A command to the motors. Distances in mm, speeds in mm/s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// A move by these distances along X, Y and Z.
    Moved([f64; 3], f32),
    /// A move towards the sensor of an axis.
    Sought(usize, f64, f32),
    /// The next moves are part of homing.
    Homing,
    /// The machine's assumed place.
    Placed([f64; 3]),
}

/// Motors and sensors. The machine's end stops are at 0, or at [`SIZE_MM`], of the true position.
#[derive(Debug)]
pub struct Rig {
    pub profile: Profile,
    pub sensors: [Cell<Sensor>; 3],
    /// Distances by which the next approaches end too early, units of 10 nm; missing ones end at
    /// the right place.
    pub early_10nm: RefCell<Vec<i64>>,
    /// The seek with this number is stopped from outside.
    pub stopped_seek: Cell<Option<usize>>,
    true_10nm: Cell<[i64; 3]>,
    believed_10nm: Cell<[i64; 3]>,
    enabled: Cell<u8>,
    choice: Cell<MotionChoice>,
    limits: Cell<Limits>,
    backlash: Cell<Backlash>,
    extruder_steps_per_mm: Cell<StepsPerMm>,
    /// True if moves wait since the last standstill.
    is_moving: Cell<bool>,
    /// Number of stops of motion from outside.
    stops: Cell<u32>,
    /// Widths of the pulses that the probe's pin was sent.
    told_us: RefCell<Vec<u16>>,
    /// Width of the pulses after which the pin's signal is wrong, and how many times it will be.
    pub wrong_signals: Cell<(u16, u32)>,
    events: RefCell<Vec<Event>>,
    texts: RefCell<Vec<String>>,
    signals: Signals,
}

/// Positions or ways in mm.
fn mm(units: [i64; 3]) -> [f64; 3] {
    units.map(|units| units as f64 / MM as f64)
}

impl Rig {
    /// Motors that are at 60, 50 and 40 mm and believe 0, of a machine that a test may change.
    pub fn new(change: impl FnOnce(&mut Profile)) -> Self {
        let mut profile = Profile { size_10nm: [SIZE_MM * MM; 3], ..profile() };
        change(&mut profile);
        Self {
            profile,
            choice: Cell::new(profile.motion),
            limits: Cell::new(profile.limits),
            backlash: Cell::new(profile.backlash.unwrap_or(Backlash::NONE)),
            extruder_steps_per_mm: Cell::new(profile.steps_per_mm[3]),
            is_moving: Cell::new(false),
            sensors: [const { Cell::new(Sensor::Good) }; 3],
            early_10nm: RefCell::default(),
            stopped_seek: Cell::new(None),
            true_10nm: Cell::new([60 * MM, 50 * MM, 40 * MM]),
            believed_10nm: Cell::new([0; 3]),
            enabled: Cell::new(0),
            stops: Cell::new(0),
            told_us: RefCell::default(),
            wrong_signals: Cell::new((0, 0)),
            events: RefCell::default(),
            texts: RefCell::default(),
            signals: Signals::new(),
        }
    }

    pub fn printer(&self) -> RigPrinter<'_> {
        Printer::new(&self.profile, RigMotion(self), Cold::of(&self.profile), NoTime, self, &self.signals)
    }

    /// Takes the commands to the motors since the last call.
    pub fn take_events(&self) -> Vec<Event> {
        self.events.take()
    }

    /// Widths of the pulses for the probe's pin since the last call, microseconds.
    pub fn take_told(&self) -> Vec<u16> {
        self.told_us.take()
    }

    /// The last line said.
    pub fn last_texts(&self) -> Vec<String> {
        self.texts.take()
    }

    /// True position of the motors, mm.
    pub fn true_mm(&self) -> [f64; 3] {
        mm(self.true_10nm.get())
    }

    /// Position that the motors believe, mm.
    pub fn believed_mm(&self) -> [f64; 3] {
        mm(self.believed_10nm.get())
    }

    /// Returns true if moves wait.
    pub fn is_moving(&self) -> bool {
        self.is_moving.get()
    }

    /// The methods and filters of the motion.
    pub fn choice(&self) -> MotionChoice {
        self.choice.get()
    }

    /// The limits of the moves to come.
    pub fn limits(&self) -> Limits {
        self.limits.get()
    }

    /// M410 from outside.
    pub fn stop_from_outside(&self) {
        self.stops.set(self.stops.get() + 1);
    }

    /// Mask of the motors with current.
    pub fn enabled(&self) -> u8 {
        self.enabled.get()
    }

    fn go(&self, by_10nm: [i64; 3]) {
        let add = |place: [i64; 3]| core::array::from_fn(|axis| place[axis] + by_10nm[axis]);
        self.true_10nm.set(add(self.true_10nm.get()));
        self.believed_10nm.set(add(self.believed_10nm.get()));
    }

    fn way_to(&self, target_10nm: [i64; 3]) -> [i64; 3] {
        core::array::from_fn(|axis| target_10nm[axis] - self.believed_10nm.get()[axis])
    }

    /// Distance to the place of a sound sensor of an axis, along a direction; not below 0.
    fn way_to_place(&self, axis: usize, direction: i64) -> Option<i64> {
        let at_max = self.profile.homing[axis].end == HomeEnd::Max;
        let end = if at_max { SIZE_MM * MM } else { 0 };
        let towards = if at_max { 1 } else { -1 };
        let left = (end - self.true_10nm.get()[axis]) * towards;
        (left <= 0 || towards == direction).then_some(left.max(0))
    }

    /// Distance to the place where the input of an axis triggers, along a direction; not below 0.
    fn way_to_sensor(&self, axis: usize, direction: i64) -> Option<i64> {
        match self.sensors[axis].get() {
            Sensor::Good => self.way_to_place(axis, direction),
            Sensor::Dead => None,
            Sensor::Stuck => Some(0),
            Sensor::WiredTo(other) => self.way_to_place(other, 0).filter(|way| *way == 0),
        }
    }
}

pub type RigPrinter<'a> = Printer<'a, (RigMotion<'a>, Cold, NoTime, Rig)>;

/// Runs a command to its end: every action on this machine ends at once.
pub fn execute(printer: &mut RigPrinter<'_>, text: &str) -> Result<(), crate::error::Failure> {
    let Poll::Ready(outcome) = pin!(printer.execute(1, text)).poll(&mut Context::from_waker(Waker::noop())) else {
        panic!("`{text}` waits");
    };
    outcome
}

/// The motion of a [`Rig`].
#[derive(Debug)]
pub struct RigMotion<'a>(&'a Rig);

impl<'a> RigMotion<'a> {
    pub fn new(rig: &'a Rig) -> Self {
        Self(rig)
    }
}

impl Motion for RigMotion<'_> {
    type Bed = NoBed;
    type Servo = crate::Present;
    type ZMotors = crate::Present;
    type Tools = crate::Present;
    type Backlash = crate::Present;

    fn backlash(&self) -> Backlash {
        self.0.backlash.get()
    }

    fn set_backlash(&mut self, backlash: &Backlash) {
        self.0.backlash.set(*backlash);
    }

    type SupplySignal = crate::Present;

    fn send_servo_pulses(&mut self, pulses: ServoPulses) {
        self.0.told_us.borrow_mut().push(pulses.width_us);
    }

    fn stops(&self) -> u32 {
        self.0.stops.get()
    }

    async fn add(&mut self, request: impl Request) -> Result<Moved, MotionError> {
        let Some(request) = request.as_move() else { unreachable!("no prepared jobs here") };
        let way = self.0.way_to(request.target_10nm);
        self.0.events.borrow_mut().push(Event::Moved(mm(way), request.feed_mm_per_s));
        self.0.go(way);
        self.0.is_moving.set(true);
        Ok(Moved::Queued)
    }

    async fn set_pressure_advance(&mut self, _: &PressureAdvance) -> Result<bool, MotionError> {
        Ok(false)
    }

    async fn set_fan_power(&mut self, _: FanOutput, _: u8) -> Result<(), MotionError> {
        Ok(())
    }

    async fn finish(&mut self) -> Result<(), MotionError> {
        self.0.is_moving.set(false);
        Ok(())
    }

    fn begin_homing(&mut self) {
        self.0.events.borrow_mut().push(Event::Homing);
    }

    async fn seek(&mut self, request: Move, axis: usize) -> Result<HomingOutcome, MotionError> {
        let way = self.0.way_to(request.target_10nm);
        let others = (0..3).filter(|other| *other != axis);
        assert!(others.map(|other| way[other]).all(|way| way == 0), "a seek of axis {axis} goes {way:?}");
        let way = way[axis];
        let event = Event::Sought(axis, way as f64 / MM as f64, request.feed_mm_per_s);
        let seeks = self.0.events.borrow().iter().filter(|event| matches!(event, Event::Sought(..))).count();
        self.0.events.borrow_mut().push(event);
        let along = |length: i64| core::array::from_fn(|one| if one == axis { length * way.signum() } else { 0 });
        if self.0.stopped_seek.get() == Some(seeks) {
            self.0.go(along(way.abs().min(MM)));
            return Err(MotionError::Stopped);
        }
        let early = self.0.early_10nm.borrow_mut().pop().unwrap_or(0);
        match self.0.way_to_sensor(axis, way.signum()).map(|left| (left - early).max(0)) {
            Some(left) if left <= way.abs() => {
                self.0.go(along(left));
                Ok(HomingOutcome::Triggered)
            }
            _ => {
                self.0.go(along(way.abs()));
                Ok(HomingOutcome::Missed)
            }
        }
    }

    fn position_10nm(&self) -> [i64; 3] {
        self.0.believed_10nm.get()
    }

    fn set_position(&mut self, position_10nm: [i64; 3]) {
        self.0.events.borrow_mut().push(Event::Placed(mm(position_10nm)));
        self.0.believed_10nm.set(position_10nm);
    }

    fn motor_steps(&self) -> [i64; 4] {
        [0; 4]
    }

    fn figures(&self) -> MotionFigures {
        MotionFigures::default()
    }

    fn limits(&self) -> Limits {
        self.0.limits.get()
    }

    fn set_limits(&mut self, limits: Limits) {
        self.0.limits.set(limits);
    }

    fn motion_choice(&self) -> MotionChoice {
        self.0.choice.get()
    }

    fn extruder_steps_per_mm(&self) -> StepsPerMm {
        self.0.extruder_steps_per_mm.get()
    }

    fn set_extruder_steps_per_mm(&mut self, steps_per_mm: StepsPerMm) -> Result<(), ChoiceError> {
        if self.0.is_moving.get() {
            return Err(ChoiceError::InMotion);
        }
        self.0.extruder_steps_per_mm.set(steps_per_mm);
        Ok(())
    }

    fn set_motion_choice(&mut self, choice: &MotionChoice) -> Result<(), ChoiceError> {
        if self.0.is_moving.get() {
            return Err(ChoiceError::InMotion);
        }
        self.0.choice.set(*choice);
        Ok(())
    }

    fn set_motors_enabled(&mut self, axes: u8, enabled: bool) {
        let before = self.0.enabled.get();
        self.0.enabled.set(if enabled { before | axes } else { before & !axes });
    }

    fn is_end_stop_triggered(&self, axis: usize) -> bool {
        if axis == 2 && self.0.profile.bltouch.is_some() {
            let told_us = self.0.told_us.borrow().last().copied().unwrap_or(0);
            let (wrong_us, left) = self.0.wrong_signals.get();
            let is_wrong = told_us == wrong_us && left > 0;
            if is_wrong {
                self.0.wrong_signals.set((wrong_us, left - 1));
            }
            return (told_us == PinCommand::TOUCH_MODE_US) != is_wrong;
        }
        self.0.way_to_sensor(axis, 0) == Some(0)
    }

    fn stop(&mut self) -> i64 {
        0
    }
}

impl Replies for Rig {
    fn send(&self, reply: Reply<'_>) {
        match reply {
            Reply::Text(text) => self.texts.borrow_mut().push(text.to_owned()),
            Reply::InputShaper(_) | Reply::PressureAdvance(_) | Reply::AdvanceLimits { .. } => {
                self.texts.borrow_mut().push(reply.to_string());
            }
            _ => {}
        }
    }
}

/// Heaters at room temperature.
#[derive(Debug)]
pub struct Cold {
    gains: [PidGains; 2],
    models: [Option<HeaterModel>; 2],
}

impl Cold {
    fn of(profile: &Profile) -> Self {
        Self { gains: [profile.nozzle.gains, profile.bed.gains], models: profile.control_models }
    }
}

impl Heating for Cold {
    type Supply = crate::Present;
    type Models = crate::Present;

    fn gains(&self, heater: Heater) -> PidGains {
        self.gains[heater.index()]
    }
    fn set_gains(&mut self, heater: Heater, gains: PidGains) {
        self.gains[heater.index()] = gains;
    }
    fn model(&self, heater: Heater) -> Option<HeaterModel> {
        self.models.get(heater.index()).copied()?
    }
    fn set_model(&mut self, heater: Heater, model: HeaterModel) {
        self.models[heater.index()] = Some(model);
    }
    fn set_target(&mut self, _: Heater, _: f32) {}
    fn status(&self, _: Heater) -> HeaterStatus {
        HeaterStatus { celsius: 22.0, ..HeaterStatus::default() }
    }
    fn all_off(&mut self) {}
    fn restart(&mut self) -> Result<(), HeatFault> {
        Ok(())
    }
}

/// A clock that does not run.
#[derive(Clone, Debug)]
pub struct NoTime;

impl Clock for NoTime {
    fn now_ms(&self) -> u64 {
        0
    }
}

impl embedded_hal_async::delay::DelayNs for NoTime {
    async fn delay_ns(&mut self, _: u32) {
        unreachable!("nothing waits here")
    }
}

/// Drivers that all have these settings, and have confirmed them.
#[derive(Debug)]
pub struct Drivers(pub DriverSettings);

impl MotorDrivers for Drivers {
    fn state(&self, _: usize) -> Option<DriverState> {
        Some(DriverState::Confirmed)
    }
    fn report(&self, _: usize) -> Option<DriverReport> {
        Some(DriverReport {
            state: DriverState::Confirmed,
            settings: self.0,
            run_ma: 0,
            hold_ma: 0,
            status: DriverStatus::default(),
            load: 0,
            repeated: 0,
        })
    }
    fn check(&self, _: usize, _: &DriverSettings) -> Result<(), SettingsError> {
        Ok(())
    }
    fn set(&self, _: usize, _: DriverSettings) -> Result<(), SettingsError> {
        Ok(())
    }
    fn take_moved(&self) -> u8 {
        0
    }
}

/// Runs all other waiting tasks, once.
pub async fn wait_once() {
    let mut has_waited = false;
    core::future::poll_fn(|_| if core::mem::replace(&mut has_waited, true) { Poll::Ready(()) } else { Poll::Pending })
        .await;
}
