//! The machine this firmware is for.

use ferrostep_printer::Profile;

/// The profile, as `build.rs` read it from its TOML file.
pub static PROFILE: Profile = {
    use names::*;
    include!(concat!(env!("OUT_DIR"), "/profile.rs"))
};

const _: () = assert!(
    cfg!(feature = "papers") || PROFILE.motion.is_standard(),
    "the profile asks for a method of motion that only the desk and the bench contain: a printer's image has \
     interpolation = \"step-bresenham\" with acceleration = \"trapezoid\" or \"s-curve\""
);

include!(concat!(env!("OUT_DIR"), "/step_signals.rs"));

/// What `Debug` names in a profile. Not every machine has drivers, and not every type's variants are told apart by one.
#[allow(unused_imports, non_upper_case_globals)]
mod names {
    pub const inf: f64 = f64::INFINITY;

    pub use ferrostep_planner::{
        AccelerationProfile::*, DualRatePeriods, Interpolation::*, Kinematics::*, Limits, MotionChoice,
        SCurveTableSettings, StepsPerMm,
    };
    pub use ferrostep_printer::{
        AxisHoming, DriverTiming, ExtrusionSettings, FirmwareRetraction, HeaterSettings, HeaterWatch, HomeEnd::*,
        HomeSensor::*, Profile, SafeHoming,
    };
    pub use ferrostep_thermistor::{Thermistor, ThermistorType::*};
    pub use ferrostep_tmc2209::DriverSettings;
    pub use ferrostep_virtual_board::HeatedMass;
}
