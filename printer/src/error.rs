//! Why a command was refused.

use core::fmt;

use ferrostep_gcode::{ParseError, Real, ShortText};
use ferrostep_hal_shim::AccelerometerFault;
use ferrostep_planner::look_ahead::PlanFault;
use ferrostep_planner::surface::MeshError;
use ferrostep_planner::{ChoiceError, MIN_FEED_MM_PER_S, MoveError, ShaperError};
use ferrostep_tmc2209::{DriverEvent, DriverEventKind, Failure as DriverFailure, SettingsError};

use crate::accelerometer::FaultText;
use crate::advance_refusal::AdvanceRefusal;
use crate::axis_names::AXIS_NAMES;
use crate::heat::HeatFault;
use crate::mesh_refusal::MeshRefusal;
use crate::motion_fault::{Miscount, MotionError, MotionFault};
use crate::plan_fault_text::PlanFaultText;
use crate::shaper_refusal::{self, ShaperRefusal};
use crate::tower::TowerRefusal;

/// Why a command was not executed. It has had no effect then; a command that was stopped on its way
/// ([`CommandError::Stopped`]) leaves the machine where it says it stands.
// R4.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CommandError {
    /// A coordinate is beyond 5 m.
    TooFar,
    /// More filament than one move may push.
    TooMuchFilament,
    /// The feed is below what the planner takes.
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
    /// An arc given by R whose end is its start, or farther than twice the radius.
    ArcRadius {
        /// The R word, mm.
        radius_mm: f64,
        /// Distance between start and end, mm.
        chord_mm: f64,
    },
    /// A target above what the heater may reach.
    TooHot {
        /// The target.
        celsius: f64,
        /// Highest allowed.
        maximum_celsius: f32,
    },
    /// A word is outside its range.
    OutOfRange {
        /// The word's letter.
        word: char,
        /// Its value.
        value: f64,
        /// Smallest allowed.
        minimum: f64,
        /// Largest allowed.
        maximum: f64,
    },
    /// The sensor did not trigger as far as it was searched for.
    HomingFailed {
        /// Index of the axis.
        axis: usize,
        /// How far the first approach went, units of 10 nm.
        searched_10nm: i64,
        /// The axis whose sensor triggered instead.
        swapped: Option<usize>,
    },
    /// Two approaches have found the sensor at different places, twice.
    HomingDisagrees {
        /// Index of the axis.
        axis: usize,
        /// How much farther up the axis the second was, units of 10 nm; `None`: it did not meet it.
        apart_10nm: Option<i64>,
        /// How far apart they may be.
        agree_10nm: i64,
    },
    /// Z homes at one place of the bed, and an axis of the plane is not homed.
    HomeFirst {
        /// Index of the axis that is not homed.
        axis: usize,
    },
    /// A paused print cannot go on: an axis has lost its home meanwhile.
    PausedUnhomed {
        /// Index of the axis.
        axis: usize,
    },
    /// M303 while the nozzle has a target, or a print is paused.
    TunesNoPrint,
    /// M303 has found no gains: the heater does not swing around its target.
    NotTuned,
    /// M24 or M602 without a print that is paused.
    NotPaused,
    /// M290 has shifted Z, and a prepared job brings its own heights.
    Shifted {
        /// By how much, units of 10 nm.
        shift_10nm: i64,
    },
    /// Z follows the bed, or shall, and a prepared job brings its own heights.
    MeshAndJob,
    /// M92 has set other steps of the extruder than the profile's, with which a prepared job is planned.
    StepsAndJob,
    /// Z cannot follow the bed.
    Mesh(MeshError),
    /// The profile names no screws of the bed.
    NoScrews,
    /// The bed is probed and followed with all axes homed.
    BedUnhomed {
        /// Index of an axis that is not homed.
        axis: usize,
    },
    /// M290 shifts no prepared job.
    ShiftsNoJob,
    /// M290 shifts a homed Z only.
    ShiftsHomedZ,
    /// M290 moves Z alone.
    ShiftsZOnly {
        /// The word's letter.
        word: char,
    },
    /// The axis' sensor is triggered away from the end of the axis.
    SensorStuck {
        /// Index of the axis.
        axis: usize,
    },
    /// The axis homes by its driver's stall signal, and that is off.
    NoStallSignal {
        /// Index of the axis.
        axis: usize,
    },
    /// A motor's driver has failed, so nothing may move.
    Driver {
        /// The motor, 0 to 3.
        motor: usize,
        /// Why.
        failure: DriverFailure,
    },
    /// A motor's driver does not have this setting.
    DriverSettings {
        /// The motor, 0 to 3.
        motor: usize,
        /// Why.
        error: SettingsError,
    },
    /// This board does not have what the command needs: `heaters`, `thermometers`, `end stops`, `fan`, `black box`.
    NotEquipped(&'static str),
    /// The accelerometer gives no samples.
    Accelerometer(AccelerometerFault),
    /// The memory card is in use: it prints, or a file is being written to it.
    CardInUse,
    /// A host's line would move the head of a print from the card.
    CardPrints,
    /// M796 asked for methods that this machine cannot use.
    MotionChoice(ChoiceError),
    /// M593 and SET_INPUT_SHAPER: there is no filter of this name.
    UnknownShaper(ShortText),
    /// The filter that was asked for cannot be made.
    Shaper(ShaperRefusal),
    /// Filters cannot be set.
    Shaping(ChoiceError),
    /// The advance that was asked for is out of range.
    Advance(AdvanceRefusal),
    /// There is no such tower (TUNING_TOWER).
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
    /// M112 or a heater fault has halted the machine, during this command or before; only M999 ends that.
    Halted,
    /// M999 does not end this heater fault.
    NeedsReset(HeatFault),
    /// A wait for heat ended because the heaters were switched off as unused (M86).
    HeatersTimedOut,
    /// Motion was stopped on the way.
    Stopped,
    /// The firmware has found a fault in its own motion and stopped it.
    MotionFault(MotionFault),
    /// A prepared job goes on at another place than the motors'.
    OtherPlace {
        /// Where the job goes on, units of 10 nm.
        job_10nm: [i32; 3],
        /// Where the machine stands, units of 10 nm.
        machine_10nm: [i32; 3],
    },
    /// A prepared move goes beyond the machine's travel.
    Outside {
        /// Index of the axis.
        axis: usize,
    },
    /// The plan of a prepared job cannot be followed.
    Plan(PlanFault),
    /// Jobs come over a board's own ports only.
    NoJobs,
    /// M791 within a print.
    BlackBoxInPrint,
}

impl CommandError {
    /// Whether it has stopped the machine, not only the line.
    pub(crate) const fn stops(&self) -> bool {
        matches!(self, Self::Stopped | Self::Halted | Self::NeedsReset(_) | Self::MotionFault(_))
    }

    /// A prepared job goes on at one position, the machine stands at another; units of 10 nm.
    pub(crate) fn other_place(job_10nm: [i64; 3], machine_10nm: [i64; 3]) -> Self {
        // What a hostile job says may be beyond any range.
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

impl fmt::Display for CommandError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooFar => write!(out, "the target is too far away, expected coordinates within 5 m"),
            Self::TooMuchFilament => write!(out, "E: too long extrusion prevented, expected at most 1 m in one move"),
            Self::FeedTooSlow { feed_mm_per_s } => {
                let [minimum, feed] =
                    [MIN_FEED_MM_PER_S, *feed_mm_per_s].map(|mm_per_s| Real::short(mm_per_s * 60.0, 6));
                write!(out, "F: {feed} mm/min is too slow, expected at least {minimum} mm/min")
            }
            Self::ColdExtrusion { celsius, minimum_celsius } => write!(
                out,
                "E: cold extrusion prevented, the nozzle is at {} C, expected at least {} C",
                Real::fixed(*celsius, 1),
                Real::short(*minimum_celsius, 2)
            ),
            Self::ArcGeometry { start_radius_mm, end_radius_mm } => write!(
                out,
                "I, J: the arc starts {} mm from its centre and ends {} mm from it: both must be the same",
                Real::fixed(*start_radius_mm, 3),
                Real::fixed(*end_radius_mm, 3)
            ),
            Self::ArcRadius { radius_mm, chord_mm } => write!(
                out,
                "R: a radius of {} mm does not reach over {} mm: it must be at least half of that, and the end must not be the \
                 start",
                Real::fixed(*radius_mm, 3),
                Real::fixed(*chord_mm, 3)
            ),
            Self::TooHot { celsius, maximum_celsius } => {
                let (celsius, maximum) = (Real::short(*celsius, 6), Real::short(*maximum_celsius, 2));
                write!(out, "S: {celsius} C is too hot, expected at most {maximum} C")
            }
            Self::OutOfRange { word, value, minimum, maximum } => {
                let [value, minimum, maximum] = [value, minimum, maximum].map(|number| Real::short(*number, 6));
                write!(out, "{word}: {value} is out of range, expected {minimum} to {maximum}")
            }
            Self::HomingFailed { axis, searched_10nm, swapped } => {
                let name = AXIS_NAMES.get(*axis).copied().unwrap_or('?');
                let searched = mm(*searched_10nm, 1);
                write!(out, "homing {name} failed: its sensor did not trigger within {searched} mm, ")?;
                match swapped.and_then(|swapped| AXIS_NAMES.get(swapped)) {
                    Some(other) => {
                        write!(out, "but the sensor of {other} did: are the two swapped?")
                    }
                    None if *axis == 2 => write!(
                        out,
                        "expected it at the bed: is the sheet on it, is the sensor connected (M119)? If the nozzle is still above \
                         the bed, switch the motors off (M84) and home again"
                    ),
                    None => write!(
                        out,
                        "expected it at the end of the axis: is it connected, or swapped with another's \
                         (M119)?"
                    ),
                }
            }
            Self::HomingDisagrees { axis, apart_10nm, agree_10nm } => {
                let name = AXIS_NAMES.get(*axis).copied().unwrap_or('?');
                let agree = mm(*agree_10nm, 2);
                write!(out, "homing {name} failed twice: ")?;
                match apart_10nm {
                    Some(apart) => {
                        write!(out, "the second approach met the sensor {} mm from the first, ", mm(*apart, 2))?
                    }
                    None => write!(out, "the second approach did not meet the sensor where the first did, ")?,
                }
                write!(out, "expected at most {agree} mm: is the sensor loose, or its threshold (M914) too sensitive?")
            }
            Self::HomeFirst { axis } => {
                let name = AXIS_NAMES.get(*axis).copied().unwrap_or('?');
                write!(out, "homing Z refused: {name} is not homed, and Z homes at one place of the bed only: send G28")
            }
            Self::PausedUnhomed { axis } => {
                let name = AXIS_NAMES.get(*axis).copied().unwrap_or('?');
                write!(
                    out,
                    "the print stays paused: {name} was homed when it paused and is not now: home it (G28 {name}), then go on (M602)"
                )
            }
            Self::TunesNoPrint => out.write_str(
                "M303 is for an idle printer: the nozzle has a target or a print is paused; end it (M524, M104 S0), then tune",
            ),
            Self::NotTuned => out.write_str(
                "PID Autotune failed! timeout: the temperature does not swing around S, is the heater strong enough for it?",
            ),
            Self::NotPaused => write!(out, "no print is paused: M601, M600 or M25 pauses one"),
            Self::Shifted { shift_10nm } => write!(
                out,
                "M290 has shifted Z by {} mm, and a prepared job brings its own heights: G28 Z ends the shift, M851 keeps it",
                mm(*shift_10nm, 3)
            ),
            Self::MeshAndJob => out.write_str(
                "a prepared job brings its own heights and follows no mesh: send M420 S0 before it, or print its G-code",
            ),
            Self::StepsAndJob => out.write_str(
                "a prepared job is planned with the profile's steps of the extruder, and M92 has set others: print its G-code, or write them \
                 into the profile and prepare it anew",
            ),
            Self::Mesh(error) => fmt::Display::fmt(&MeshRefusal(error), out),
            Self::NoScrews => out.write_str("the profile does not say where the bed's screws are: write its table bed_screws"),
            Self::BedUnhomed { axis } => {
                let name = AXIS_NAMES.get(*axis).copied().unwrap_or('?');
                write!(out, "{name} is not homed: send G28 before the bed is probed or followed")
            }
            Self::ShiftsNoJob => write!(out, "a prepared job brings its own heights: send M290 before or after it"),
            Self::ShiftsHomedZ => write!(out, "Z is not homed: send G28 before M290"),
            Self::ShiftsZOnly { word } => write!(out, "{word}: M290 shifts Z alone: send M290 Z"),
            Self::SensorStuck { axis } => {
                let name = AXIS_NAMES.get(*axis).copied().unwrap_or('?');
                write!(
                    out,
                    "homing {name} failed: its sensor is triggered away from the end of the axis: is it connected, or swapped with \
                     another's (M119)?"
                )
            }
            Self::NoStallSignal { axis } => {
                let name = AXIS_NAMES.get(*axis).copied().unwrap_or('?');
                write!(
                    out,
                    "{name} homes by its driver's stall signal, which is off: send M914 {name}1 to 255, M569 S1 {name}"
                )
            }
            Self::Driver { motor, failure } => {
                write!(out, "{}", DriverEvent { motor: *motor, kind: DriverEventKind::Failed(*failure) })
            }
            Self::DriverSettings { motor, error } => {
                let name = AXIS_NAMES.get(*motor).copied().unwrap_or('?');
                write!(out, "{name}: {error}")
            }
            Self::CardInUse => {
                out.write_str("the memory card is in use: M524 ends a print from it, M29 ends what is written to it")
            }
            Self::CardPrints => out
                .write_str("the memory card is printing, and this line would move its print: pause it first with M25"),
            Self::NotEquipped(what) => write!(out, "this board has no {what}"),
            Self::Accelerometer(fault) => write!(out, "{}", FaultText(*fault)),
            Self::MotionChoice(ChoiceError::NotContained) => {
                write!(out, "M796: this image contains only step-bresenham (I0) with trapezoid (A0) or s-curve (A1)")
            }
            Self::MotionChoice(ChoiceError::Parameter | ChoiceError::PressureAdvance(_)) => {
                write!(out, "M796: a parameter of the method is out of range, see the machine's profile")
            }
            Self::MotionChoice(ChoiceError::InMotion) => write!(out, "M796: methods change at standstill only"),
            Self::MotionChoice(ChoiceError::Shaper(ShaperError::SmoothSCurve)) => {
                write!(out, "M796: {}", shaper_refusal::SMOOTH_S_CURVE)
            }
            Self::MotionChoice(ChoiceError::Shaper(_)) => {
                write!(
                    out,
                    "M796: input shapers and pressure advance need step-bresenham (I0), expected M593 F0 and M900 K0 before"
                )
            }
            Self::UnknownShaper(name) => {
                write!(out, "\"{name}\" is no input shaper of this machine, expected {}", shaper_refusal::KnownShapers)
            }
            Self::Shaper(refusal) => fmt::Display::fmt(refusal, out),
            Self::Advance(refusal) => fmt::Display::fmt(refusal, out),
            Self::Tower(refusal) => fmt::Display::fmt(refusal, out),
            Self::Shaping(error) => out.write_str(shaper_refusal::choice_text(*error)),
            Self::OtherNozzle { job_mm, machine_mm } => {
                let [job, machine] = [job_mm, machine_mm].map(|diameter_mm| Real::short(*diameter_mm, 2));
                write!(
                    out,
                    "P: the job is for a nozzle of {job} mm, this machine has one of {machine} mm: slice the job for it, or \
                     change nozzle_diameter_mm of the profile"
                )
            }
            Self::OtherModel(names) => write!(
                out,
                "P: the job is for another printer, this machine is {names}: slice the job for it, or change model_names of \
                 the profile"
            ),
            Self::InvalidTool(tool) => write!(
                out,
                "T{tool} - Invalid extruder number !, this machine has one extruder, T0: slice the job for one"
            ),
            Self::Halted => write!(out, "the printer is halted (M112 or a heater fault): M999 restarts it"),
            Self::NeedsReset(HeatFault { heater, trip }) => write!(
                out,
                "M999 does not end \"{trip}\" of the {}: mend its cause, then reset the board (its button, or power off and on)",
                heater.name()
            ),
            Self::HeatersTimedOut => {
                write!(
                    out,
                    "the heaters were switched off during the wait, as unused: allow more time with M86 S before it"
                )
            }
            Self::Stopped => write!(out, "motion was stopped"),
            Self::MotionFault(fault) => {
                match fault {
                    MotionFault::Miscount(Miscount { motor, counted, expected }) => {
                        let name = AXIS_NAMES.get(*motor).copied().unwrap_or('?');
                        write!(out, "motor {name} stands at step {counted}, expected {expected}: ")?;
                    }
                    MotionFault::StepsTooNear => write!(out, "two steps were planned too near each other: ")?,
                    MotionFault::MissedUpdates(updates) => {
                        write!(out, "the step interrupt missed {updates} updates of its timer: ")?;
                    }
                }
                out.write_str(
                    "a fault of the firmware, please report it; motion was stopped, home the machine (G28) before it moves \
                     again",
                )
            }
            Self::OtherPlace { job_10nm, machine_10nm } => write!(
                out,
                "the job goes on at {}, the machine stands at {}: home it (G28), then start the job again",
                Place(*job_10nm),
                Place(*machine_10nm)
            ),
            Self::Outside { axis } => {
                let name = AXIS_NAMES.get(*axis).copied().unwrap_or('?');
                write!(out, "{name}: outside the soft limits: a prepared job must stay within the travel")
            }
            Self::Plan(fault) => fmt::Display::fmt(&PlanFaultText(fault), out),
            Self::BlackBoxInPrint => out.write_str("M791: the black box is read at rest: end the print first"),
            Self::NoJobs => write!(out, "M790 works on a board's serial or USB port only"),
        }
    }
}

/// A machine position as messages show it, mm; in units of 10 nm.
struct Place([i32; 3]);

impl fmt::Display for Place {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.0.map(|length_10nm| mm(length_10nm.into(), 3));
        write!(out, "X{x} Y{y} Z{z}")
    }
}

/// A length as messages show it, mm.
fn mm(length_10nm: i64, decimals: u8) -> Real {
    Real::fixed(length_10nm as f64 / 100_000.0, decimals)
}

/// Why a line was not executed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Failure {
    /// It cannot be read.
    Parse(ParseError),
    /// It cannot be done.
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
