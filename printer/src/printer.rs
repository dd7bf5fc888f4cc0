//! The printer: its parts, and what it consists of.

use embedded_hal_async::delay::DelayNs;
use ferrostep_gcode::{BedArea, Remarks, SettingsCommand};
use ferrostep_hal_shim::{Clock, Heater};
use ferrostep_planner::MotionChoice;

use crate::job::card::Card;
use crate::job::paused::Paused;
use crate::job::power_loss::PowerLoss;
use crate::job::print_clock::PrintClock;
use crate::job::tool_box::ToolBox;
use crate::job::tower::Tower;
use crate::motion::interpreter::MoveInterpreter;
use crate::motion::modal::Tally;
use crate::part::Part;
use crate::ports::accelerometer::Accelerometer;
use crate::ports::black_box::BlackBox;
use crate::ports::{Equipment, Heating, Motion, MotorDrivers, Ports, Replies, Timing};
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

/// A host that wants to send a prepared job (M790).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JobRequest {
    /// Length of the job, bytes.
    pub size: u32,
    /// Longest silence of the host, s.
    pub silence_s: u16,
}

/// The source of a line: it decides whether a person can be asked, and where a pause waits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// A host, which waits for the answer. The lines of a print have numbers; those that a person types have none.
    Host {
        /// The line has a number.
        is_numbered: bool,
    },
    /// A file that is read to its end: there is no person to ask.
    File,
    /// A card, while hosts are heard as well: its reader waits while [`Printer::is_paused`].
    Card,
}

/// What a memory makes of the commands that need one. An image whose board has none does not contain their code.
pub(crate) trait KeepsSettings<P: Ports> {
    /// M500, M501 and M504; `None`: the start. Returns what is still to be set of the motion.
    fn keep(&self, printer: &mut Printer<'_, P>, command: Option<SettingsCommand>) -> Option<MotionChoice>;

    /// Stores what the machine has done in its life, and leaves the stored settings.
    fn keep_statistics(&self, printer: &mut Printer<'_, P>);
}

/// Executes commands on the machine's parts, and answers each line.
///
/// The commands are in modules by their subject (`moves`, `temperatures`, `settings`, ...); only `dispatch` knows which command
/// is where.
pub struct Printer<'a, P: Ports> {
    pub(crate) profile: &'a Profile,
    pub(crate) motion: P::Motion,
    pub(crate) heating: P::Heating,
    pub(crate) clock: P::Clock,
    pub(crate) replies: &'a P::Replies,
    pub(crate) signals: &'a Signals,
    pub(crate) interpreter: MoveInterpreter<'a>,
    /// Number of the line being executed.
    pub(crate) line: u32,
    pub(crate) last_line: i64,
    /// Remarks made on this job's lines.
    pub(crate) said: Remarks,
    pub(crate) version: &'a str,
    pub(crate) identifier: Option<[u32; 3]>,
    pub(crate) emergency_parser: bool,
    pub(crate) meatpack: bool,
    pub(crate) timing: Option<&'a dyn Timing>,
    pub(crate) drivers: Option<&'a dyn MotorDrivers>,
    pub(crate) equipment: Equipment,
    pub(crate) settings_memory: Option<&'a dyn KeepsSettings<P>>,
    pub(crate) receives_jobs: bool,
    pub(crate) job_request: Option<JobRequest>,
    pub(crate) card: Card<'a>,
    /// Of the present line.
    pub(crate) source: Source,
    pub(crate) paused: Option<Paused>,
    /// Progress by M73: percent, and minutes left.
    pub(crate) progress: (Option<u8>, Option<u16>),
    /// Targets that commands have set, degrees Celsius. A heater that is off against them was switched off by its timeout.
    pub(crate) targets_celsius: [f32; Heater::COUNT],
    /// Whether the hosts know that their prints end because the machine is halted.
    pub(crate) told_halted: bool,
    /// A print pauses when its filament has run out (M412).
    pub(crate) pauses_at_runout: bool,
    /// A print is laying lines whose filament an encoder watches.
    pub(crate) lays_lines: bool,
    /// What a filament change draws out and pushes in, units of 10 nm (M603).
    pub(crate) filament_10nm: [i64; 2],
    /// What changes with the height (TUNING_TOWER).
    pub(crate) tower: Option<Tower>,
    pub(crate) print_clock: PrintClock,
    /// The command at hand is a line of a macro.
    pub(crate) is_in_macro: bool,
    pub(crate) accelerometer: Option<&'a dyn Accelerometer>,
    pub(crate) power_loss: PowerLoss,
    pub(crate) black_box: Option<&'a dyn BlackBox>,
    /// M555: which part of the bed is measured next.
    pub(crate) bed_area: Option<BedArea>,
    /// The selected tool, of several.
    pub(crate) tools: <<P::Motion as Motion>::Tools as Part>::Of<ToolBox>,
}

impl<'a, M: Motion, H: Heating, T: Clock + DelayNs + Clone, R: Replies> Printer<'a, (M, H, T, R)> {
    /// A printer that has just been switched on: nothing homed, everything cold.
    pub fn new(profile: &'a Profile, motion: M, heating: H, clock: T, replies: &'a R, signals: &'a Signals) -> Self {
        signals.set_heater_timeout_s(profile.heater_timeout_s);
        if M::FOLLOWS_FILAMENT
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
            line: 0,
            last_line: 0,
            said: Remarks::NONE,
            version: env!("CARGO_PKG_VERSION"),
            identifier: None,
            emergency_parser: false,
            meatpack: false,
            timing: None,
            drivers: None,
            equipment: Equipment::ALL,
            settings_memory: None,
            receives_jobs: false,
            job_request: None,
            card: Card::none(),
            source: Source::File,
            paused: None,
            progress: (None, None),
            targets_celsius: [0.0; Heater::COUNT],
            told_halted: false,
            pauses_at_runout: profile.filament_sensor.is_some(),
            lays_lines: false,
            filament_10nm: profile.pause.filament_10nm(),
            tower: None,
            print_clock: PrintClock::new(),
            is_in_macro: false,
            accelerometer: None,
            power_loss: PowerLoss::new(),
            black_box: None,
            bed_area: None,
            tools: M::Tools::of(ToolBox::new(profile)),
        }
    }
}

impl<'a, P: Ports> Printer<'a, P> {
    /// Version of the firmware as M115 reports it, `0.1.0 (commit abcdef0)`; without this it has no commit.
    pub fn set_version(&mut self, version: &'a str) {
        self.version = version;
    }

    /// The board's own number, such as its chip's unique identifier: M115 reports it as a UUID.
    pub fn set_identifier(&mut self, identifier: [u32; 3]) {
        self.identifier = Some(identifier);
    }

    /// Says that M112, M108 and M410 are acted on as their bytes arrive (M115 reports it).
    pub fn set_emergency_parser(&mut self, present: bool) {
        self.emergency_parser = present;
    }

    /// Says that the ports' bytes may be packed (M115 reports it).
    pub fn set_meatpack(&mut self, present: bool) {
        self.meatpack = present;
    }

    /// The board measures its times (M798).
    pub fn set_timing(&mut self, timing: &'a dyn Timing) {
        self.timing = Some(timing);
    }

    /// The motors' drivers can be set (M122, M569, M906, M913, M914); nothing moves before all have confirmed their settings.
    pub fn set_drivers(&mut self, drivers: &'a dyn MotorDrivers) {
        self.drivers = Some(drivers);
    }

    /// The parts of the board that can be used; all without this.
    pub fn set_equipment(&mut self, equipment: Equipment) {
        self.equipment = equipment;
    }

    /// Counts of what has been done so far.
    pub fn tally(&self) -> Tally {
        self.interpreter.tally
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
        self.last_line = number;
    }
}
