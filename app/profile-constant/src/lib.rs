//! Profile of the machine that an image is built for.
#![no_std]
#![forbid(unsafe_code)]

use ferrostep_printer::Profile;

/// Machine profile as read by the build script from its TOML file. An image makes its own static of
/// it, so that the compiler sees the values where they are used.
pub const PROFILE: Profile = {
    use names::*;
    include!(concat!(env!("OUT_DIR"), "/profile.rs"))
};

include!(concat!(env!("OUT_DIR"), "/step_signals.rs"));

/// Names that `Debug` prints in a profile. Not every machine has drivers, and a given machine uses
/// only one variant of each type.
#[allow(unused_imports, non_upper_case_globals)]
mod names {
    pub const inf: f64 = f64::INFINITY;

    pub use ferrostep_hal_shim::SpareConnector::*;
    pub use ferrostep_planner::backlash::Backlash;
    pub use ferrostep_planner::surface::MeshInterpolation::*;
    pub use ferrostep_planner::{
        AccelerationProfile::*, AxisShaper, DualRatePeriods, EvenSpacing, Interpolation::*, Kinematics::*, Limits,
        MotionChoice, PressureAdvance, SCurveTableSettings, SecondSlope, ShaperKind, StepsPerMm,
    };
    pub use ferrostep_printer::{
        AxisHoming, BedScrew, BedScrews, BlTouch, ChamberSettings, DriverTiming, ExtrusionSettings, FanRule::*,
        FanSettings, FilamentSensor, FilamentSensorKind::*, FirmwareRetraction, FurtherTool, HeaterModel,
        HeaterSettings, HeaterWatch, HomeEnd::*, HomeSensor::*, Kept, LightColor::*, MeshSettings, PauseSettings,
        PidGains, PowerSupply, Profile, SafeHoming, Skew, SupplySignal, ToolChange, ToolHeater, Tools, ZAlignment,
        ZMotor, ZMotors,
    };
    pub use ferrostep_thermistor::{Thermistor, ThermistorType::*};
    pub use ferrostep_tmc2209::DriverSettings;
    pub use ferrostep_virtual_board::{HeatedMass, SheetShape};
}
