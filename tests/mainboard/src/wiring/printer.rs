//! The printer around a board, as the profile describes it. The profile's other keys are ignored.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::z_motors::ZMotor;

/// The printer around a board. Arrays are in the order x, y, z, e.
#[derive(Debug, Clone, PartialEq)]
pub struct Printer {
    /// The profile's name.
    pub name: String,
    /// Drive of X and Y.
    pub kinematics: Kinematics,
    /// Upper ends of the travel, machine coordinates, mm.
    pub size_mm: [f64; 3],
    /// Lower ends of the travel, mm: 0 or below.
    pub lower_end_mm: [f64; 3],
    /// Motor steps per mm, microsteps included; on CoreXY x and y are the motors A and B.
    pub steps_per_mm: [f64; 4],
    /// Homing of the printer.
    pub homing: Homing,
    /// The hot end.
    pub nozzle: HeaterSettings,
    /// The heated bed, if the printer has one.
    pub bed: Option<HeaterSettings>,
    /// The chamber's thermometer, and its heater if it has one.
    pub chamber: Option<Chamber>,
    /// The thermistor of a second tool's nozzle: the board's name for its input, and what it is.
    pub tool_thermistor: Option<(String, ThermistorKind)>,
    /// Step and direction signals.
    pub signals: DriverSignals,
    /// Settings of drivers with a serial line.
    pub drivers: [Option<DriverSettings>; 4],
    /// The motors that lift Z, by the board's names for them; empty for one motor.
    pub z_motors: BTreeMap<String, ZMotor>,
    /// The frame along X and Y; `None` where the profile does not describe it.
    pub frame: [Option<FrameMode>; 2],
    /// The supply of motors, heaters and fans, if the board switches it.
    pub power_supply: Option<PowerSupply>,
    /// The probe has a pin that a servo's signal moves.
    pub has_bltouch: bool,
    /// The filament sensor sees filament move.
    pub sees_filament_move: bool,
}

/// A supply that a board switches. Without a level at its input it is off, as ATX supplies and
/// relay modules are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, Deserialize)]
pub struct PowerSupply {
    /// A low level switches it on.
    pub on_is_low: bool,
}

/// A frame along an axis, as the profile describes it.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub struct FrameMode {
    /// Undamped frequency, Hz.
    pub frequency_hz: f64,
    /// Damping ratio.
    #[serde(default = "usual_damping")]
    pub damping: f64,
}

/// Drive of X and Y.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kinematics {
    /// One motor an axis.
    Cartesian,
    /// Motors A = X + Y and B = X - Y.
    CoreXy,
}

/// Homing of the printer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Homing {
    /// Position of the nozzle while Z homes: x and y, mm.
    pub home_at_mm: Option<[f64; 2]>,
    /// The offset from the nozzle's tip to the point where the probe triggers: x, y, z, mm.
    pub probe_offset_mm: Option<[f64; 3]>,
    /// The area in which the probe finds the bed: lower and upper end along x and along y, mm.
    pub bed_mm: [[f64; 2]; 2],
    /// The axes x, y, z; `None` for an axis without homing.
    pub axes: [Option<AxisHoming>; 3],
}

/// An end of the travel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum End {
    /// The lower one.
    Min,
    /// The upper one.
    Max,
}

/// The kind of sensor at an axis's end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum HomingSensor {
    /// A switch.
    EndStop,
    /// The probe finds the bed.
    Probe,
    /// The frame; the driver reports the stall.
    Stall,
}

/// Homing of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub struct AxisHoming {
    /// The end at which it homes.
    pub end: End,
    /// The sensor at that end.
    pub sensor: HomingSensor,
    /// Machine coordinate at which the sensor triggers, mm.
    pub position_mm: f64,
    /// True if the sensor's signal is low when it triggers.
    #[serde(default)]
    pub triggers_low: bool,
    /// Distance that the frame may be beyond the travel, mm.
    #[serde(default = "five")]
    pub overrun_mm: f64,
}

/// A thermistor's kind.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, Deserialize)]
#[serde(untagged)]
pub enum ThermistorKind {
    /// A kind with a table in its data sheet.
    Named(NamedThermistor),
    /// Any other.
    Beta {
        /// Resistance at 25 degrees Celsius, ohm.
        r25_ohm: f64,
        /// The B constant, kelvin.
        beta_k: f64,
    },
    /// Any other, through three points of its data sheet.
    Points {
        /// Degrees Celsius.
        celsius: [f64; 3],
        /// Ohm.
        ohm: [f64; 3],
    },
}

/// A thermistor by its part number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, Deserialize)]
pub enum NamedThermistor {
    /// Semitec 104GT-2.
    #[serde(rename = "semitec-104gt-2")]
    Semitec104Gt2,
    /// EPCOS (TDK) B57560G104F.
    #[serde(rename = "epcos-100k")]
    Epcos100k,
    /// A platinum resistor of 1000 ohm at 0 degrees Celsius.
    #[serde(rename = "pt1000")]
    Pt1000,
}

/// A heater and its thermistor.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub struct HeaterSettings {
    /// The thermistor.
    pub sensor: ThermistorKind,
    /// Pull-up resistor from the thermistor to the reference, ohm. A board's own value
    /// takes precedence.
    #[serde(default = "pull_up")]
    pub pull_up_ohm: f64,
    /// Temperature from which on the firmware must switch heaters off, degrees Celsius.
    pub max_celsius: f64,
    /// Below this temperature the firmware must switch heaters off, degrees Celsius.
    pub min_celsius: f64,
    /// The heated mass; optional in a profile.
    pub model: Option<HeaterModel>,
}

/// A chamber, at connectors of the board.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Chamber {
    /// The thermistor's input.
    pub thermistor: String,
    /// The heater's output.
    pub heater: Option<String>,
    /// The heater and the thermistor.
    #[serde(flatten)]
    pub settings: HeaterSettings,
}

/// The heated mass of a heater.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, Deserialize)]
pub struct HeaterModel {
    /// Power, W.
    pub power_w: f64,
    /// Heat capacity, J/K.
    pub capacity_j_per_k: f64,
    /// Loss to the air, W/K.
    pub loss_w_per_k: f64,
    /// Additional loss with the part fan at full power, W/K.
    #[serde(default)]
    pub fan_loss_w_per_k: f64,
    /// Delay until the thermistor responds, s.
    #[serde(default)]
    pub dead_time_s: f64,
}

/// Step and direction signals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriverSignals {
    /// Minimum high time and minimum low time of a step pulse that the driver requires, us.
    pub pulse_width_us: f64,
    /// Minimum time from a direction change to the next step that the driver requires, us.
    pub direction_setup_us: f64,
    /// True if each edge of the step signal is a step.
    pub both_edges: bool,
    /// Motors with an inverted direction.
    pub inverted: [bool; 4],
}

/// The settings of a driver.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub struct DriverSettings {
    /// Effective current in motion, mA.
    pub current_ma: f64,
    /// Current at standstill, percent of the current in motion.
    pub hold_current_percent: f64,
    /// Microsteps per full step.
    pub microsteps: u16,
    /// Full steps in a turn of the motor.
    #[serde(default = "two_hundred")]
    pub full_steps_per_turn: u32,
    /// True if the driver interpolates to 256 microsteps.
    pub interpolate: bool,
    /// StallGuard threshold: the load at which the driver reports a stall, 0 to 255; 0 = never.
    pub stall_threshold: u8,
}

fn usual_damping() -> f64 {
    0.1
}

fn five() -> f64 {
    5.0
}

fn pull_up() -> f64 {
    4700.0
}

fn two_hundred() -> u32 {
    200
}
