//! The printer around a board, as the profile describes it. The profile's other keys are ignored.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use super::refusal::Refusal;
use super::z_motors::{RawZMotors, ZMotor};

/// The printer around a board. Arrays are in the order x, y, z, e.
#[derive(Debug, Clone, PartialEq)]
pub struct Printer {
    /// The profile's name.
    pub name: String,
    /// How X and Y are driven.
    pub kinematics: Kinematics,
    /// Upper ends of the travel, machine coordinates, mm.
    pub size_mm: [f64; 3],
    /// Lower ends of the travel, mm: 0 or below.
    pub lower_end_mm: [f64; 3],
    /// Motor steps per mm, microsteps included; on CoreXY x and y are the motors A and B.
    pub steps_per_mm: [f64; 4],
    /// How the printer homes.
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
    /// Whether its filament sensor sees filament move.
    pub sees_filament_move: bool,
}

/// A supply that a board switches. Without a level at its input it is off, as ATX supplies and relay modules are.
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

/// How X and Y are driven.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kinematics {
    /// One motor an axis.
    Cartesian,
    /// Motors A = X + Y and B = X - Y.
    CoreXy,
}

/// How the printer homes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Homing {
    /// Where the nozzle stands while Z homes: x and y, mm.
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

/// How an axis homes.
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
    /// How far the frame may be beyond the travel, mm.
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
    /// Pull-up resistor from the thermistor to the reference, ohm. A board's own value takes precedence.
    #[serde(default = "pull_up")]
    pub pull_up_ohm: f64,
    /// At or above this temperature the firmware must switch heaters off, degrees Celsius.
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

impl Printer {
    /// Reads a profile.
    ///
    /// # Errors
    /// The file cannot be read, or [`Printer::parse`] refuses it.
    pub fn read(path: &Path) -> Result<Self, Refusal> {
        let file = path.display().to_string();
        let text = std::fs::read_to_string(path).map_err(|error| Refusal::unreadable(&file, &error))?;
        Self::parse(&file, &text)
    }

    /// Reads a profile from its text; `file` is its name in errors.
    ///
    /// # Errors
    /// A key of the printer is missing or malformed, or has a value that no machine has.
    pub fn parse(file: &str, text: &str) -> Result<Self, Refusal> {
        let raw: RawPrinter = toml::from_str(text).map_err(|error| Refusal::toml(file, &error))?;
        let lower_end_mm = raw.lower_end_mm.unwrap_or(Xyz { x: 0.0, y: 0.0, z: 0.0 }).array();
        let size_mm = raw.size_mm.array();
        for (axis, name) in ["x", "y", "z"].iter().enumerate() {
            let (lower, upper) = (lower_end_mm[axis], size_mm[axis]);
            if !(lower.is_finite() && upper.is_finite() && lower <= 0.0 && upper > 0.0) {
                let problem = format!("a travel from {lower} to {upper} mm is impossible");
                return Err(Refusal::new(
                    file,
                    format!("size_mm.{name}"),
                    problem,
                    "write size_mm above 0 and lower_end_mm at most 0",
                ));
            }
        }
        let steps = raw.steps_per_mm;
        let steps_per_mm = [steps.x, steps.y, steps.z, steps.e];
        if !steps_per_mm.iter().all(|steps| steps.is_finite() && *steps > 0.0) {
            return Err(Refusal::new(
                file,
                "steps_per_mm",
                "every motor needs a number above 0",
                "write the steps per mm of x, y, z and e",
            ));
        }
        let driver = raw.driver;
        for (key, us) in [("pulse_width_us", driver.pulse_width_us), ("direction_setup_us", driver.direction_setup_us)]
        {
            if !(us.is_finite() && us >= 0.0) {
                return Err(Refusal::new(
                    file,
                    format!("driver.{key}"),
                    format!("{us} us is not a duration"),
                    "write 0 or more microseconds",
                ));
            }
        }
        let nozzle = heater(file, "nozzle", raw.nozzle)?;
        let bed = raw.bed.map(|bed| heater(file, "bed", bed)).transpose()?;
        if let Some(chamber) = &raw.chamber {
            heater(file, "chamber", chamber.settings)?;
        }
        let homing = raw.homing;
        let travel = [[lower_end_mm[0], size_mm[0]], [lower_end_mm[1], size_mm[1]]];
        let drivers = [raw.drivers.x, raw.drivers.y, raw.drivers.z, raw.drivers.e];
        for (settings, name) in drivers.iter().zip(["x", "y", "z", "e"]) {
            if let Some(settings) = settings.filter(|it| !it.microsteps.is_power_of_two() || it.microsteps > 256) {
                let problem = format!("no driver makes {} microsteps", settings.microsteps);
                let mend = "write 1, 2, 4, 8, 16, 32, 64, 128 or 256";
                return Err(Refusal::new(file, format!("drivers.{name}.microsteps"), problem, mend));
            }
        }
        let frame = [raw.frame.x, raw.frame.y];
        for (mode, axis) in frame.iter().zip(["x", "y"]) {
            if let Some(mode) = mode
                .filter(|mode| !((1.0..=1000.0).contains(&mode.frequency_hz) && (0.0..=0.95).contains(&mode.damping)))
            {
                let problem = format!("no frame rings at {} Hz with a damping of {}", mode.frequency_hz, mode.damping);
                let mend = "write 1 to 1000 Hz, and a damping of 0 to 0.95";
                return Err(Refusal::new(file, format!("frame.{axis}"), problem, mend));
            }
        }
        Ok(Self {
            name: raw.name,
            kinematics: raw.kinematics,
            size_mm,
            lower_end_mm,
            steps_per_mm,
            homing: Homing {
                home_at_mm: homing.home_at_mm.map(|place| [place.x, place.y]),
                probe_offset_mm: homing.probe_offset_mm.map(Xyz::array),
                bed_mm: homing.bed_mm.map_or(travel, |bed| [bed.x, bed.y]),
                axes: [homing.x, homing.y, homing.z],
            },
            nozzle,
            bed,
            chamber: raw.chamber,
            tool_thermistor: raw.tools.and_then(|tools| tools.t1.thermistor(nozzle.sensor)),
            signals: DriverSignals {
                pulse_width_us: driver.pulse_width_us,
                direction_setup_us: driver.direction_setup_us,
                both_edges: driver.both_edges,
                inverted: inverted(file, &driver.inverted)?,
            },
            drivers,
            z_motors: raw.z_motors.all(),
            frame,
            power_supply: raw.power_supply,
            has_bltouch: raw.bltouch.is_some(),
            sees_filament_move: raw.filament_sensor.is_some_and(|sensor| sensor.kind.as_deref() == Some("motion")),
        })
    }
}

fn inverted(file: &str, names: &[String]) -> Result<[bool; 4], Refusal> {
    let mut inverted = [false; 4];
    for name in names {
        match ["x", "y", "z", "e"].iter().position(|axis| axis == name) {
            Some(motor) => inverted[motor] = true,
            None => {
                let problem = format!("unknown motor \"{name}\"");
                return Err(Refusal::new(file, "driver.inverted", problem, "write \"x\", \"y\", \"z\" or \"e\""));
            }
        }
    }
    Ok(inverted)
}

fn heater(file: &str, key: &str, heater: HeaterSettings) -> Result<HeaterSettings, Refusal> {
    if let Some(problem) = thermistor_fault(heater.sensor) {
        return Err(Refusal::new(file, format!("{key}.sensor"), problem, THERMISTOR_CURE));
    }
    if !(heater.pull_up_ohm.is_finite() && heater.pull_up_ohm > 0.0) {
        return Err(Refusal::new(
            file,
            format!("{key}.pull_up_ohm"),
            format!("{} ohm is not a pull-up resistor", heater.pull_up_ohm),
            "write the resistor in ohm, such as 4700",
        ));
    }
    let fault = heater.model.is_some_and(|model| {
        let not_above_zero = [model.power_w, model.capacity_j_per_k].iter().any(|it| !(it.is_finite() && *it > 0.0));
        let below_zero = [model.loss_w_per_k, model.fan_loss_w_per_k, model.dead_time_s];
        not_above_zero || below_zero.iter().any(|it| !(it.is_finite() && *it >= 0.0))
    });
    if fault {
        let problem = "power and capacity must be above 0, losses and dead time at least 0";
        let mend = "copy the values of a similar printer from profiles/";
        return Err(Refusal::new(file, format!("{key}.model"), problem, mend));
    }
    Ok(heater)
}

/// How to mend a thermistor that [`thermistor_fault`] rejects.
pub(super) const THERMISTOR_CURE: &str = "copy R25 and B, or three points, from its data sheet";

/// The problem of a thermistor with impossible values, if any.
pub(super) fn thermistor_fault(kind: ThermistorKind) -> Option<&'static str> {
    match kind {
        ThermistorKind::Beta { r25_ohm, beta_k }
            if !(r25_ohm.is_finite() && r25_ohm > 0.0 && beta_k.is_finite() && beta_k > 0.0) =>
        {
            Some("r25_ohm and beta_k must be above 0")
        }
        ThermistorKind::Points { celsius, ohm }
            if !(celsius.is_sorted_by(|low, high| low < high)
                && ohm.is_sorted_by(|high, low| high > low)
                && ohm.iter().all(|ohm| *ohm > 0.0)) =>
        {
            Some("three temperatures must rise and their resistances fall")
        }
        _ => None,
    }
}

#[derive(Deserialize)]
struct RawPrinter {
    name: String,
    kinematics: Kinematics,
    size_mm: Xyz,
    lower_end_mm: Option<Xyz>,
    steps_per_mm: Xyze,
    homing: RawHoming,
    nozzle: HeaterSettings,
    bed: Option<HeaterSettings>,
    chamber: Option<Chamber>,
    tools: Option<RawTools>,
    driver: RawDriver,
    #[serde(default)]
    drivers: RawDrivers,
    #[serde(default)]
    z_motors: RawZMotors,
    #[serde(default)]
    frame: RawFrame,
    power_supply: Option<PowerSupply>,
    bltouch: Option<toml::Value>,
    filament_sensor: Option<RawFilamentSensor>,
}

#[derive(Deserialize)]
struct RawTools {
    t1: RawTool,
}

#[derive(Deserialize)]
struct RawTool {
    heater: Option<String>,
    thermistor: Option<String>,
    nozzle: Option<RawToolNozzle>,
}

#[derive(Deserialize)]
struct RawToolNozzle {
    sensor: Option<ThermistorKind>,
}

impl RawTool {
    /// At the input of the heater's name, and as the first nozzle's, where the profile does not say.
    fn thermistor(self, of_nozzle: ThermistorKind) -> Option<(String, ThermistorKind)> {
        let kind = self.nozzle.and_then(|nozzle| nozzle.sensor).unwrap_or(of_nozzle);
        Some((self.thermistor.or(self.heater)?, kind))
    }
}

#[derive(Deserialize, Default)]
struct RawFrame {
    x: Option<FrameMode>,
    y: Option<FrameMode>,
}

#[derive(Deserialize, Clone, Copy)]
struct Xyz {
    x: f64,
    y: f64,
    z: f64,
}

impl Xyz {
    fn array(self) -> [f64; 3] {
        [self.x, self.y, self.z]
    }
}

#[derive(Deserialize)]
struct Xyze {
    x: f64,
    y: f64,
    z: f64,
    e: f64,
}

#[derive(Deserialize)]
struct Xy {
    x: f64,
    y: f64,
}

#[derive(Deserialize)]
struct Area {
    x: [f64; 2],
    y: [f64; 2],
}

#[derive(Deserialize)]
struct RawHoming {
    home_at_mm: Option<Xy>,
    probe_offset_mm: Option<Xyz>,
    bed_mm: Option<Area>,
    x: Option<AxisHoming>,
    y: Option<AxisHoming>,
    z: Option<AxisHoming>,
}

#[derive(Deserialize)]
struct RawDriver {
    pulse_width_us: f64,
    direction_setup_us: f64,
    #[serde(default)]
    both_edges: bool,
    #[serde(default)]
    inverted: Vec<String>,
}

#[derive(Deserialize, Default)]
struct RawDrivers {
    x: Option<DriverSettings>,
    y: Option<DriverSettings>,
    z: Option<DriverSettings>,
    e: Option<DriverSettings>,
}

#[derive(Deserialize)]
struct RawFilamentSensor {
    kind: Option<String>,
}
