//! The machine this firmware is for.

use ferrostep_hal_shim::thermistor::{Thermistor, ThermistorType};
use ferrostep_planner::{
    AccelerationProfile, DualRatePeriods, Interpolation, Kinematics, Limits, MotionChoice, SCurveTableSettings,
    StepsPerMm,
};
use ferrostep_printer::{
    AxisHoming, DriverTiming, ExtrusionSettings, FirmwareRetraction, HeaterSettings, HeaterWatch, HomeEnd, HomeSensor,
    Profile, SafeHoming,
};

/// The profile, as `build.rs` found it in its TOML file.
pub static PROFILE: Profile = include!(concat!(env!("OUT_DIR"), "/profile.rs"));

const _: () = assert!(PROFILE.motion.is_offered(), "a method of the profile is not among the features");

include!(concat!(env!("OUT_DIR"), "/step_signals.rs"));

/// Steps/mm as the profile's constant names them; a value out of range ends the build.
const fn steps_per_mm(hundred_thousandths: i64) -> StepsPerMm {
    match StepsPerMm::from_hundred_thousandths(hundred_thousandths) {
        Some(steps) => steps,
        None => panic!("steps/mm out of range"),
    }
}
