//! The machine this firmware is for.

use ferrostep_printer::Profile;

/// The profile, as `build.rs` read it from its TOML file.
pub static PROFILE: Profile = {
    use names::*;
    include!(concat!(env!("OUT_DIR"), "/profile.rs"))
};

const _: () = assert!(PROFILE.motion.is_offered(), "a method of the profile is not among the features");

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
