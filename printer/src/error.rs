//! Reasons why a command was refused.

pub(crate) mod advance_refusal;
mod mesh_refusal;
mod plan_fault_text;
pub(crate) mod shaper_refusal;
pub(crate) mod skew_refusal;
mod text;

use core::fmt;

use ferrostep_gcode::{ParseError, ShortText};
use ferrostep_hal_shim::AccelerometerFault;
use ferrostep_planner::look_ahead::PlanFault;
use ferrostep_planner::surface::MeshError;
use ferrostep_planner::{ChoiceError, MoveError};
use ferrostep_tmc2209::{Failure as DriverFailure, SettingsError};

use crate::error::advance_refusal::AdvanceRefusal;
use crate::error::shaper_refusal::ShaperRefusal;
use crate::error::skew_refusal::SkewRefusal;
use crate::heat::report::HeatFault;
use crate::job::tower::TowerRefusal;
use crate::motion::fault::{MotionError, MotionFault};

/// Reason why a command was not executed. It has then had no effect; a command stopped midway
/// ([`CommandError::Stopped`]) leaves the machine at the position that it reports.
// R4.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CommandError {
    /// A coordinate is beyond 5 m.
    TooFar,
    /// A move pushes more filament than a single move may.
    TooMuchFilament,
    /// The feed is below the planner's minimum.
    FeedTooSlow {
        /// The feed, mm/s.
        feed_mm_per_s: f64,
    },
    /// The nozzle is too cold to extrude.
    ColdExtrusion {
        /// Nozzle temperature, degrees Celsius.
        celsius: f32,
        /// Smallest allowed.
        minimum_celsius: f32,
    },
    /// The radius does not fit the end point.
    ArcGeometry {
        /// Distance of the start from the centre, mm.
        start_radius_mm: f64,
        /// Distance of the end from the centre, mm.
        end_radius_mm: f64,
    },
    /// The end of an arc given by R is its start, or farther away than twice the radius.
    ArcRadius {
        /// The R word, mm.
        radius_mm: f64,
        /// Distance between start and end, mm.
        chord_mm: f64,
    },
    /// A target above the heater's maximum.
    TooHot {
        /// The target.
        celsius: f64,
        /// Highest allowed.
        maximum_celsius: f32,
        /// True if the maximum is excluded: the target must be below it.
        below: bool,
    },
    /// A word is outside its range.
    OutOfRange {
        /// The word's letter.
        word: char,
        /// Value of the word.
        value: f64,
        /// Smallest allowed.
        minimum: f64,
        /// Largest allowed.
        maximum: f64,
    },
    /// The sensor did not trigger within the search distance.
    HomingFailed {
        /// Index of the axis.
        axis: usize,
        /// Length of the first approach, units of 10 nm.
        searched_10nm: i64,
        /// The axis whose sensor triggered instead.
        swapped: Option<usize>,
    },
    /// Two approaches found the sensor at different places, twice.
    HomingDisagrees {
        /// Index of the axis.
        axis: usize,
        /// Distance of the second place from the first, up the axis, units of 10 nm; `None` if the
        /// second approach did not reach the sensor.
        apart_10nm: Option<i64>,
        /// Maximum distance, units of 10 nm.
        agree_10nm: i64,
    },
    /// Z homes at one place of the bed, but an axis of the plane is not homed.
    HomeFirst {
        /// Index of the axis that is not homed.
        axis: usize,
    },
    /// A paused print cannot be resumed, because an axis has lost its home meanwhile.
    PausedUnhomed {
        /// Index of the axis.
        axis: usize,
    },
    /// M303 was sent while the nozzle has a target or a print is paused.
    TunesNoPrint,
    /// An autotune has failed, or the command is for the other kind of control: the reason and the
    /// cure.
    HeaterControl(&'static str),
    /// M290 has shifted Z, but a prepared job brings its own heights.
    Shifted {
        /// The shift, units of 10 nm.
        shift_10nm: i64,
    },
    /// Z follows the bed, or is to follow it, but a prepared job brings its own heights.
    MeshAndJob,
    /// The machine's axes are skew (M852), but a prepared job is planned for right angles.
    SkewAndJob,
    /// Axes must not be that far from a right angle.
    TooSkew(SkewRefusal),
    /// M425 sets the play of an axis whose motors also move another axis.
    SharedPlay {
        /// Index of the axis.
        axis: usize,
    },
    /// M92 has changed the extruder's steps from the profile's, with which a prepared job is
    /// planned.
    StepsAndJob,
    /// Z cannot follow the bed.
    Mesh(MeshError),
    /// A place to be probed is beside the round bed.
    BesideBed,
    /// The profile names no screws of the bed.
    NoScrews,
    /// The Z motors are not at one height; the text gives the cure.
    NotAligned(&'static str),
    /// A print would extrude a line, but an axis has failed to home.
    FailedHome {
        /// Index of the axis.
        axis: usize,
    },
    /// The bed is probed and followed only with all axes homed.
    BedUnhomed {
        /// Index of an axis that is not homed.
        axis: usize,
    },
    /// M290 cannot shift a prepared job.
    ShiftsNoJob,
    /// M290 only shifts a homed Z.
    ShiftsHomedZ,
    /// The axis' sensor is triggered although the axis is not at its end.
    SensorStuck {
        /// Index of the axis.
        axis: usize,
    },
    /// The axis homes by its driver's stall signal, which is off.
    NoStallSignal {
        /// Index of the axis.
        axis: usize,
    },
    /// The probe's pin does not follow its command, or its signal does not confirm it.
    ProbePin(&'static str),
    /// A motor's driver has failed, so no motor may move.
    Driver {
        /// The motor, 0 to 3.
        motor: usize,
        /// The failure.
        failure: DriverFailure,
    },
    /// A motor's driver does not have this setting.
    DriverSettings {
        /// The motor, 0 to 3.
        motor: usize,
        /// Fault of the setting.
        error: SettingsError,
    },
    /// This board lacks a part that the command needs: `heaters`, `thermometers`, `end stops`,
    /// `fan`, `black box`.
    NotEquipped(&'static str),
    /// The accelerometer gives no samples.
    Accelerometer(AccelerometerFault),
    /// M42: no output of the profile has this number.
    OtherOutput,
    /// The command needs the power supply, and that is off.
    SupplyOff,
    /// M81 was sent while a print is paused or comes from the card.
    SupplyInUse,
    /// The memory card is in use: it prints, or a file is being written to it.
    CardInUse,
    /// M28 occurs in the file of a print.
    WritesWithinPrint,
    /// A host's line would move the head during a print from the card.
    CardPrints,
    /// M796 asked for methods that this machine cannot use.
    MotionChoice(ChoiceError),
    /// M593 and SET_INPUT_SHAPER: no filter has this name.
    UnknownShaper(ShortText),
    /// The requested filter cannot be made.
    Shaper(ShaperRefusal),
    /// Filters cannot be set.
    Shaping(ChoiceError),
    /// The requested advance is out of range.
    Advance(AdvanceRefusal),
    /// TUNING_TOWER: this tower is not possible.
    Tower(TowerRefusal),
    /// The job is for another nozzle (M862.1).
    OtherNozzle {
        /// The job's diameter, mm.
        job_mm: f64,
        /// The machine's, mm.
        machine_mm: f64,
    },
    /// The job is for another printer (M862.3); the names of this one, separated by commas.
    OtherModel(&'static str),
    /// A tool that does not exist.
    InvalidTool(u32),
    /// A machine with several tools cannot select one of them, or the command is for another one:
    /// the reason.
    Tool(&'static str),
    /// M112 or a heater fault has halted the machine, during this command or earlier; only M999
    /// ends the halt.
    Halted,
    /// M999 cannot clear this heater fault.
    NeedsReset(HeatFault),
    /// A wait for heat ended because the heaters were switched off as unused (M86).
    HeatersTimedOut,
    /// Motion was stopped midway.
    Stopped,
    /// The firmware has found a fault in its own motion and stopped it.
    MotionFault(MotionFault),
    /// A prepared job continues at a place other than the motors'.
    OtherPlace {
        /// Place where the job continues, units of 10 nm.
        job_10nm: [i32; 3],
        /// Place of the machine, units of 10 nm.
        machine_10nm: [i32; 3],
    },
    /// A prepared move goes beyond the machine's travel.
    Outside {
        /// Index of the axis.
        axis: usize,
    },
    /// The plan of a prepared job cannot be followed.
    Plan(PlanFault),
    /// Jobs are received on a board's own ports only.
    NoJobs,
    /// M791 was sent during a print.
    BlackBoxInPrint,
}

impl CommandError {
    /// Returns true if the error has stopped the machine, not only refused the line.
    pub(crate) const fn stops(&self) -> bool {
        matches!(self, Self::Stopped | Self::Halted | Self::NeedsReset(_) | Self::MotionFault(_))
    }

    /// Returns true if a person can remedy the reason, so that the line is worth a second try: by
    /// heat, homing, power or the limits.
    pub(crate) const fn is_mendable(&self) -> bool {
        self.fails_homing()
            || matches!(
                self,
                Self::ColdExtrusion { .. }
                    | Self::FeedTooSlow { .. }
                    | Self::PausedUnhomed { .. }
                    | Self::BedUnhomed { .. }
                    | Self::ShiftsHomedZ
                    | Self::NotAligned(_)
                    | Self::Mesh(_)
                    | Self::Driver { .. }
                    | Self::Accelerometer(_)
                    | Self::SupplyOff
                    | Self::HeatersTimedOut
                    | Self::TunesNoPrint
            )
    }

    /// Returns true if an axis is not where the print needs it because its homing has failed.
    pub(crate) const fn fails_homing(&self) -> bool {
        matches!(
            self,
            Self::HomingFailed { .. }
                | Self::HomingDisagrees { .. }
                | Self::SensorStuck { .. }
                | Self::NoStallSignal { .. }
                | Self::HomeFirst { .. }
                | Self::ProbePin(_)
                | Self::FailedHome { .. }
        )
    }

    /// The error for a prepared job that continues at one position while the machine is at
    /// another; units of 10 nm.
    pub(crate) fn other_place(job_10nm: [i64; 3], machine_10nm: [i64; 3]) -> Self {
        // Positions of a malicious job may be beyond any range.
        let shown = |length_10nm: i64| length_10nm.clamp(i32::MIN.into(), i32::MAX.into()) as i32;
        Self::OtherPlace { job_10nm: job_10nm.map(shown), machine_10nm: machine_10nm.map(shown) }
    }
}

impl From<MotionError> for CommandError {
    fn from(error: MotionError) -> Self {
        match error {
            MotionError::Stopped | MotionError::Move(MoveError::NoRoom) => Self::Stopped,
            MotionError::Fault(fault) => Self::MotionFault(fault),
            MotionError::Move(MoveError::TooFar) => Self::TooFar,
            MotionError::Move(MoveError::TooMuchFilament) => Self::TooMuchFilament,
            MotionError::Move(MoveError::Plan(fault)) => Self::Plan(fault),
            MotionError::Move(MoveError::Feed) => Self::FeedTooSlow { feed_mm_per_s: 0.0 },
        }
    }
}

/// Reason why a line was not executed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Failure {
    /// The line cannot be read.
    Parse(ParseError),
    /// The command cannot be executed.
    Command(CommandError),
}

impl fmt::Display for Failure {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Parse(error) => fmt::Display::fmt(error, out),
            Self::Command(error) => fmt::Display::fmt(error, out),
        }
    }
}
