//! The printer: its parts and its set-up.

use ferrostep_gcode::SettingsCommand;
use ferrostep_planner::MotionChoice;

use crate::job::lines::Lines;
use crate::job::modes::Modes;
use crate::job::print::Print;
use crate::motion::interpreter::{AskedPlaces, MoveInterpreter};
use crate::motion::modal::Tally;
use crate::ports::accelerometer::Accelerometer;
use crate::ports::black_box::BlackBox;
use crate::ports::identity::Identity;
use crate::ports::{Equipment, Motion, MotorDrivers, Ports, Timing};
use crate::settings::profile::Profile;
use crate::signals::Signals;

/// Masks of all motors.
pub(crate) const ALL_MOTORS: u8 = 0b1111;

/// The answer to an executed command.
// R4.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Answer {
    /// `ok` has still to be sent.
    Ok,
    /// `ok` has been sent, with more text.
    Given,
}

/// Handling of the commands that need a settings memory. An image whose board has no memory does
/// not contain their code.
pub(crate) trait KeepsSettings<P: Ports> {
    /// Executes M500, M501 and M504; `None`: the start. Returns the choice of motion that is
    /// still to be set.
    fn keep(&self, printer: &mut Printer<'_, P>, command: Option<SettingsCommand>) -> Option<MotionChoice>;

    /// Stores the machine's statistics, and leaves the stored settings.
    fn keep_statistics(&self, printer: &mut Printer<'_, P>);
}

/// Optional equipment of a board beside motors and heaters.
pub(crate) struct Fitted<'a, P: Ports> {
    /// The parts of the board that can be used.
    pub equipment: Equipment,
    /// Measures the board's times (M798).
    pub timing: Option<&'a dyn Timing>,
    /// The motors' drivers can be set.
    pub drivers: Option<&'a dyn MotorDrivers>,
    /// Settings survive the power there.
    pub settings_memory: Option<&'a dyn KeepsSettings<P>>,
    pub accelerometer: Option<&'a dyn Accelerometer>,
    pub black_box: Option<&'a dyn BlackBox>,
}

impl<P: Ports> Fitted<'_, P> {
    /// All equipment, and no optional parts.
    const fn new() -> Self {
        Self {
            equipment: Equipment::ALL,
            timing: None,
            drivers: None,
            settings_memory: None,
            accelerometer: None,
            black_box: None,
        }
    }
}

/// Executes commands on the machine's parts, and answers each line.
///
/// The commands are in modules by their subject (`moves`, `temperatures`, `settings`, ...); only
/// `dispatch` knows which command is where.
pub struct Printer<'a, P: Ports> {
    pub(crate) profile: &'a Profile,
    pub(crate) motion: P::Motion,
    pub(crate) heating: P::Heating,
    pub(crate) clock: P::Clock,
    pub(crate) replies: &'a P::Replies,
    pub(crate) signals: &'a Signals,
    pub(crate) interpreter: MoveInterpreter<'a>,
    pub(crate) identity: Identity<'a>,
    pub(crate) fitted: Fitted<'a, P>,
    pub(crate) lines: Lines,
    pub(crate) print: Print<'a>,
    pub(crate) modes: Modes<<P::Motion as Motion>::Tools>,
}

impl<'a, P: Ports> Printer<'a, P> {
    /// A printer that has just been switched on: no axis homed, all heaters cold.
    pub fn new(
        profile: &'a Profile,
        motion: P::Motion,
        heating: P::Heating,
        clock: P::Clock,
        replies: &'a P::Replies,
        signals: &'a Signals,
    ) -> Self {
        signals.set_heater_timeout_s(profile.heater_timeout_s);
        if <P::Motion as Motion>::FOLLOWS_FILAMENT
            && let Some(length_10nm) = profile.filament_sensor.and_then(|sensor| sensor.detection_10nm())
        {
            signals.set_filament_detection_10nm(length_10nm as u32);
            signals.count_filament_anew();
        }
        Self {
            profile,
            motion,
            heating,
            clock,
            replies,
            signals,
            interpreter: MoveInterpreter::new(profile),
            identity: Identity::new(),
            fitted: Fitted::new(),
            lines: Lines::new(),
            print: Print::none(),
            modes: Modes::new(profile),
        }
    }

    /// Version of the firmware as M115 reports it, `0.1.0 (commit abcdef0)`; without this
    /// it has no commit.
    pub fn set_version(&mut self, version: &'a str) {
        self.identity.version = version;
    }

    /// The board's own number, such as its chip's unique identifier: M115 reports it as a UUID.
    pub fn set_identifier(&mut self, identifier: [u32; 3]) {
        self.identity.identifier = Some(identifier);
    }

    /// Says that M112, M108 and M410 are acted on as their bytes arrive (M115 reports it).
    pub fn set_emergency_parser(&mut self, present: bool) {
        self.identity.emergency_parser = present;
    }

    /// Notes that the ports' bytes may be packed (M115 reports it).
    pub fn set_meatpack(&mut self, present: bool) {
        self.identity.meatpack = present;
    }

    /// The board measures its times (M798).
    pub fn set_timing(&mut self, timing: &'a dyn Timing) {
        self.fitted.timing = Some(timing);
    }

    /// Sets the motors' drivers, for M122, M569, M906, M913, M914; no motor moves before all have
    /// confirmed their settings.
    pub fn set_drivers(&mut self, drivers: &'a dyn MotorDrivers) {
        self.fitted.drivers = Some(drivers);
    }

    /// The parts of the board that can be used; all without this.
    pub fn set_equipment(&mut self, equipment: Equipment) {
        self.fitted.equipment = equipment;
    }

    /// Counts of the actions so far.
    pub fn tally(&self) -> Tally {
        self.interpreter.tally
    }

    /// The places of a line's move as the line asks for them; `None` without one.
    pub fn asked_places(&self, text: &str) -> Option<AskedPlaces> {
        self.interpreter.asked_places(&ferrostep_gcode::parse(text).ok()?)
    }

    /// X, Y, Z and E as the G-code sees them, units of 10 nm.
    pub fn logical_10nm(&self) -> [i64; 4] {
        self.interpreter.modal.logical_10nm()
    }

    /// The feed of the moves to come, at the present percentage, mm/s.
    pub fn feed_mm_per_s(&self) -> f64 {
        let modal = &self.interpreter.modal;
        modal.feed_mm_per_s(modal.feed_10nm_per_min).into()
    }

    pub(crate) fn replies(&self) -> &'a P::Replies {
        self.replies
    }

    pub(crate) fn set_last_line(&mut self, number: i64) {
        self.lines.last = number;
    }
}
