//! The machine that executes commands: modal state, moves, homing, heat, reports.
//!
//! Generic over its surroundings (see [`ports`]); it knows neither registers nor tasks. Commands
//! are asynchronous: a wait is an await, and every wait ends when it is cancelled ([`Signals`]).
#![cfg_attr(not(test), no_std)]

mod commands;
mod error;
pub mod heat;
mod job;
mod motion;
mod part;
pub mod ports;
mod printer;
mod settings;
mod signals;

pub use commands::card::print::{HostLines, HostText};
pub use commands::drivers::tell_driver_event;
pub use commands::fans::tell_stalled_fan;
pub use commands::gcode_state::GcodeState;
pub use commands::host::Host;
pub use commands::transfer::JobLine;
pub use error::skew_refusal::SkewRefusal;
pub use error::{CommandError, Failure};
pub use heat::fans::{FanDemand, FanRule, FanSettings, FanTable, LightColor};
pub use heat::gains::PidGains;
pub use heat::model::HeaterModel;
pub use heat::report::{FanStatus, HeaterStatus};
pub use heat::timeout::{HeaterRest, HeaterTimeout};
pub use job::button::ButtonWatch;
pub use job::filament::FilamentWatch;
pub use job::filament::encoder::EncoderWatch;
pub use job::lines::Source;
pub use job::macros::MACRO_LINE;
pub use job::paused::PauseReason;
pub use job::power_loss::signal::{SUPPLY_FAILS, SupplyWatch};
pub use job::prepared::{OtherMotion, PreparedPlace};
pub use job::print::JobRequest;
pub use job::tower::TowerRefusal;
pub use motion::axis_names::AXIS_NAMES;
pub use motion::fault::{HomingOutcome, Miscount, MotionError, MotionFault};
pub use motion::interpreter::AskedPlaces;
pub use motion::machine;
pub use motion::modal::Tally;
pub use motion::shared_machine::{SharedMachine, SharedMotion};
pub use motion::skew::Skew;
pub use part::{Absent, Part, Present};
pub use ports::accelerometer::recorder::Recorder;
pub use ports::accelerometer::{Accelerometer, AccelerometerSettings, RecordEvent, RecordFault};
pub use ports::black_box::BlackBox;
pub use ports::{Equipment, Heating, Motion, MotorDrivers, Ports, Replies, SettingsMemory, Timing, temperatures};
pub use printer::Printer;
pub use settings::profile::filament::{
    ExtrusionSettings, FilamentSensor, FilamentSensorKind, FirmwareRetraction, PauseSettings,
};
pub use settings::profile::heaters::{ChamberSettings, DEFAULT_HEATER_TIMEOUT_S, HeaterSettings, HeaterWatch};
pub use settings::profile::homing::{
    AxisHoming, BedScrew, BedScrews, BlTouch, HomeEnd, HomeSensor, MeshSettings, SafeHoming,
};
pub use settings::profile::supply::SupplySignal;
pub use settings::profile::tools::{FurtherTool, MAX_TOOLS, ToolChange, ToolHeater, Tools};
pub use settings::profile::z_motors::{Kept, ZAlignment, ZMotor, ZMotors};
pub use settings::profile::{
    DEFAULT_EVENTS_PER_S, DEFAULT_MOVES_PER_S, DriverTiming, PowerSupply, Profile, SQUARE_CORNER_SHARE,
};
pub use settings::stored::stored_keys;
pub use signals::{IDLE_TIMEOUT_S, Signals};
