//! Texts of refused commands for a person: the expected value, or the cure.

use core::fmt;

use ferrostep_gcode::Real;
use ferrostep_planner::{ChoiceError, MIN_FEED_MM_PER_S, ShaperError};
use ferrostep_tmc2209::{DriverEvent, DriverEventKind, motor_name};

use super::CommandError;
use crate::error::mesh_refusal::MeshRefusal;
use crate::error::plan_fault_text::PlanFaultText;
use crate::error::shaper_refusal;
use crate::heat::report::HeatFault;
use crate::motion::axis_names::AXIS_NAMES;
use crate::motion::fault::{Miscount, MotionFault};
use crate::ports::accelerometer::FaultText;

impl fmt::Display for CommandError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooFar => write!(out, "the target is too far: coordinates are limited to +-5 m"),
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
            Self::ArcRadius { chord_mm, .. } if *chord_mm == 0.0 => {
                write!(out, "R: the arc ends where it starts: give I and J for a full circle")
            }
            Self::ArcRadius { radius_mm, chord_mm } => write!(
                out,
                "R: an arc of radius {} mm cannot span {} mm: make R at least {} mm",
                Real::fixed(*radius_mm, 3),
                Real::fixed(*chord_mm, 3),
                Real::fixed(chord_mm / 2.0 + 0.000_49, 3)
            ),
            Self::TooHot { celsius, maximum_celsius, below } => {
                let (celsius, maximum) = (Real::short(*celsius, 6), Real::short(*maximum_celsius, 2));
                let most = if *below { "less than" } else { "at most" };
                write!(out, "S: {celsius} C is too hot, expected {most} {maximum} C")
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
                    "the print stays paused: {name} has lost its home position: home it (G28 {name}), then resume (M602)"
                )
            }
            Self::TunesNoPrint => out.write_str(
                "M303 needs an idle printer: the nozzle has a target or a print is paused; end it (M524, M104 S0), then tune",
            ),
            Self::HeaterControl(text) => out.write_str(text),
            Self::Shifted { shift_10nm } => write!(
                out,
                "M290 or SET_GCODE_OFFSET has shifted Z by {} mm, and a prepared job has fixed heights: \
                 send SET_GCODE_OFFSET Z=0 and G28 Z, or keep it by M851",
                mm(*shift_10nm, 3)
            ),
            Self::MeshAndJob => out.write_str(
                "a prepared job has fixed heights and cannot follow the mesh: send M420 S0 first, or print its G-code",
            ),
            Self::SkewAndJob => out.write_str(
                "a prepared job cannot correct skewed axes: send M852 I0 J0 K0 first, or print its G-code",
            ),
            Self::TooSkew(refusal) => refusal.fmt(out),
            Self::SharedPlay { axis } => {
                let name = AXIS_NAMES.get(*axis).copied().unwrap_or('?');
                write!(
                    out,
                    "{name}: its motors also move another axis: expected 0, tighten the belts"
                )
            }
            Self::StepsAndJob => out.write_str(
                "a prepared job is planned with the profile's steps_per_mm.e, and M92 has set another: \
                 print its G-code, or write it into the profile and prepare it again",
            ),
            Self::Mesh(error) => fmt::Display::fmt(&MeshRefusal(error), out),
            Self::BesideBed => out.write_str(
                "X, Y: the probe is off the round bed there: choose a place nearer to the middle of homing.bed_mm",
            ),
            Self::NoScrews => out.write_str("the profile does not say where the bed's screws are: add a table bed_screws"),
            Self::BedUnhomed { axis } => {
                let name = AXIS_NAMES.get(*axis).copied().unwrap_or('?');
                write!(out, "{name} is not homed: send G28 before probing or mesh levelling")
            }
            Self::FailedHome { axis } => {
                let name = AXIS_NAMES.get(*axis).copied().unwrap_or('?');
                write!(out, "homing {name} has failed, and its position is unknown: home it (G28) before the print")
            }
            Self::ShiftsNoJob => write!(out, "a prepared job has fixed heights: send M290 before or after it"),
            Self::ShiftsHomedZ => write!(out, "Z is not homed: send G28 before M290"),
            Self::SensorStuck { axis } => {
                let name = AXIS_NAMES.get(*axis).copied().unwrap_or('?');
                write!(
                    out,
                    "homing {name} failed: its sensor is triggered away from the end of the axis: is it connected, or swapped with \
                     another's (M119)?"
                )
            }
            Self::ProbePin(why) | Self::NotAligned(why) => out.write_str(why),
            Self::NoStallSignal { axis } => {
                let name = AXIS_NAMES.get(*axis).copied().unwrap_or('?');
                write!(
                    out,
                    "{name} homes by its driver's stall signal, which is off: send M914 {name}1 to 255, M569 S1 {name}, M913 {name}0"
                )
            }
            Self::Driver { motor, failure } => {
                write!(out, "{}", DriverEvent { motor: *motor, kind: DriverEventKind::Failed(*failure) })
            }
            Self::DriverSettings { motor, error } => {
                write!(out, "{}: {error}", motor_name(*motor))
            }
            Self::OtherOutput => out.write_str(
                "P: no output of the profile has this number",
            ),
            Self::SupplyOff => out.write_str("the power supply is off: M80 switches it on"),
            Self::SupplyInUse => out.write_str("a print is under way or paused: M524 ends it"),
            Self::CardInUse => {
                out.write_str("the memory card is in use: M524 ends a print from it, M29 ends an upload")
            }
            Self::WritesWithinPrint => out.write_str(
                "M28: the lines up to M29 would be executed and not written: leave M28 and M29 out of the file",
            ),
            Self::CardPrints => out
                .write_str("the memory card is printing, and this line would disturb it: pause it first (M25)"),
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
                    "M796: input shapers and pressure advance need step-bresenham (I0): send M593 F0 and M900 K0 first"
                )
            }
            Self::UnknownShaper(name) => {
                write!(out, "\"{name}\" is not an input shaper, expected {}", shaper_refusal::KnownShapers)
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
            Self::Tool(why) => out.write_str(why),
            Self::Halted => write!(out, "the printer is halted (M112 or a heater fault): M999 restarts it"),
            Self::NeedsReset(HeatFault { heater, trip }) => write!(
                out,
                "M999 does not end \"{trip}\" of the {}: mend its cause, then reset the board (its button, or power off and on)",
                heater.name()
            ),
            Self::HeatersTimedOut => {
                write!(
                    out,
                    "the heaters were switched off during the wait (idle timeout): raise it first (M86 S)"
                )
            }
            Self::Stopped => write!(out, "motion was stopped"),
            Self::MotionFault(fault) => {
                match fault {
                    MotionFault::Miscount(Miscount { motor, counted, expected }) => {
                        let name = AXIS_NAMES.get(*motor).copied().unwrap_or('?');
                        write!(out, "motor {name} is at step {counted}, expected {expected}: ")?;
                    }
                    MotionFault::StepsTooNear => write!(out, "two steps were planned too close together: ")?,
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
                "the job starts at {}, the machine is at {}: home it (G28), then start the job again",
                Place(*job_10nm),
                Place(*machine_10nm)
            ),
            Self::Outside { axis } => {
                let name = AXIS_NAMES.get(*axis).copied().unwrap_or('?');
                write!(out, "{name}: outside the soft limits: a prepared job must stay within them")
            }
            Self::Plan(fault) => fmt::Display::fmt(&PlanFaultText(fault), out),
            Self::BlackBoxInPrint => out.write_str("M791 needs an idle printer: end the print first"),
            Self::NoJobs => write!(out, "M790 works on a board's serial or USB port only"),
        }
    }
}

/// A machine position, shown in mm in messages; units of 10 nm.
struct Place([i32; 3]);

impl fmt::Display for Place {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [x, y, z] = self.0.map(|length_10nm| mm(length_10nm.into(), 3));
        write!(out, "X{x} Y{y} Z{z}")
    }
}

/// A length as shown in messages, mm.
fn mm(length_10nm: i64, decimals: u8) -> Real {
    Real::fixed(length_10nm as f64 / 100_000.0, decimals)
}
