//! The machine that executes commands: modal state, moves, homing, heat, reports.
//!
//! Generic over its surroundings (see [`ports`]); it knows neither registers nor tasks. Commands are
//! asynchronous: a wait is an await, and every wait ends when it is cancelled ([`Signals`]).
#![cfg_attr(not(test), no_std)]

mod accelerometer;
mod advance_refusal;
mod arc;
mod axis_names;
mod black_box;
mod bltouch;
mod button;
mod card;
mod change_macros;
mod command_kind;
mod commands;
mod debounce;
mod error;
mod extrusion;
mod fans;
mod filament;
pub mod heat;
mod heater_timeout;
mod homing;
mod interpreter;
pub mod machine;
mod macros;
mod mesh_refusal;
mod modal;
mod motion_fault;
mod part;
mod paused;
mod plan_fault_text;
pub mod ports;
mod power_loss;
mod prepared;
mod print_clock;
mod printer;
mod profile;
mod shaper_refusal;
mod shared_machine;
mod signals;
mod skew;
mod skew_refusal;
mod stored;
mod tool_box;
mod tools;
mod tower;
mod z_motors;

pub use accelerometer::{Accelerometer, AccelerometerSettings, RecordEvent, RecordFault, Recorder};
pub use axis_names::AXIS_NAMES;
pub use black_box::BlackBox;
pub use button::ButtonWatch;
pub use card::{HostLines, HostText};
pub use commands::drivers::tell_driver_event;
pub use commands::fans::tell_stalled_fan;
pub use commands::host::Host;
pub use commands::transfer::JobLine;
pub use error::{CommandError, Failure};
pub use fans::{FanDemand, FanRule, FanSettings, FanTable, LightColor};
pub use filament::{EncoderWatch, FilamentWatch};
pub use heat::{FanStatus, HeaterModel, HeaterStatus, PidGains};
pub use heater_timeout::{HeaterRest, HeaterTimeout};
pub use macros::MACRO_LINE;
pub use modal::Tally;
pub use motion_fault::{HomingOutcome, Miscount, MotionError, MotionFault};
pub use part::{Absent, Part, Present};
pub use paused::PauseReason;
pub use ports::{Equipment, Heating, Motion, MotorDrivers, Ports, Replies, SettingsMemory, Timing, temperatures};
pub use power_loss::{SUPPLY_FAILS, SupplySignal, SupplyWatch};
pub use prepared::{OtherMotion, PreparedPlace};
pub use printer::{JobRequest, Printer, Source};
pub use profile::{
    AxisHoming, BedScrew, BedScrews, BlTouch, ChamberSettings, DEFAULT_EVENTS_PER_S, DEFAULT_HEATER_TIMEOUT_S,
    DEFAULT_MOVES_PER_S, DriverTiming, ExtrusionSettings, FilamentSensor, FilamentSensorKind, FirmwareRetraction,
    HeaterSettings, HeaterWatch, HomeEnd, HomeSensor, MeshSettings, PauseSettings, PowerSupply, Profile,
    SQUARE_CORNER_SHARE, SafeHoming,
};
pub use shared_machine::{SharedMachine, SharedMotion};
pub use signals::{IDLE_TIMEOUT_S, Signals};
pub use skew::Skew;
pub use skew_refusal::SkewRefusal;
pub use stored::stored_keys;
pub use tools::{FurtherTool, MAX_TOOLS, ToolChange, ToolHeater, Tools};
pub use tower::TowerRefusal;
pub use z_motors::{Kept, ZAlignment, ZMotor, ZMotors};
