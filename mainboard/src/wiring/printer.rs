//! A printer's profile, as far as the machine around the board is concerned. Its other keys are not read.

use std::path::Path;

use serde::Deserialize;

use super::refusal::Refusal;

/// The machine around a board. Arrays are in the order x, y, z, e.
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
    /// Motor steps a mm, micro-steps included; on CoreXY x and y are the motors A and B.
    pub steps_per_mm: [f64; 4],
    /// How it homes.
    pub homing: Homing,
    /// The hot end.
    pub nozzle: HeaterSettings,
    /// The heated bed, if it has one.
    pub bed: Option<HeaterSettings>,
    /// Step and direction signals.
    pub signals: DriverSignals,
    /// Drivers that are set over a line.
    pub drivers: [Option<DriverSettings>; 4],
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

/// How the machine homes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Homing {
    /// Where the nozzle stands while Z homes, x and y, mm.
    pub home_at_mm: Option<[f64; 2]>,
    /// From the nozzle's tip to where the probe triggers: x, y, z, mm.
    pub probe_offset_mm: Option<[f64; 3]>,
    /// Where the probe finds the bed: lower and upper end along x and along y, mm.
    pub bed_mm: [[f64; 2]; 2],
    /// Each axis: x, y, z.
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

/// What an axis meets at its end.
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
    /// Towards which end.
    pub end: End,
    /// What it meets there.
    pub sensor: HomingSensor,
    /// Machine coordinate at which the sensor triggers, mm.
    pub position_mm: f64,
    /// True if the sensor's signal is low when it triggers.
    #[serde(default)]
    pub triggers_low: bool,
    /// How much longer than the travel the frame may be, mm.
    #[serde(default = "five")]
    pub overrun_mm: f64,
}

/// A thermistor's kind.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, Deserialize)]
#[serde(untagged)]
pub enum ThermistorKind {
    /// One with a table in its data sheet.
    Named(NamedThermistor),
    /// Any other.
    Beta {
        /// Resistance at 25 degrees Celsius, ohm.
        r25_ohm: f64,
        /// The B constant, kelvin.
        beta_k: f64,
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
}

/// A heater and its thermistor.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub struct HeaterSettings {
    /// Its thermistor.
    pub sensor: ThermistorKind,
    /// Resistor from the thermistor to the reference, ohm. Where a board states its own, that one is in the board.
    #[serde(default = "pull_up")]
    pub pull_up_ohm: f64,
    /// At or above this the heaters are to go off, degrees Celsius.
    pub max_celsius: f64,
    /// Below this the heaters are to go off, degrees Celsius.
    pub min_celsius: f64,
    /// What it heats; the profile may leave that open.
    pub model: Option<HeaterModel>,
}

/// What a heater heats.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, Deserialize)]
pub struct HeaterModel {
    /// Power, W.
    pub power_w: f64,
    /// Heat capacity, J/K.
    pub capacity_j_per_k: f64,
    /// Loss to the air, W/K.
    pub loss_w_per_k: f64,
    /// More loss with the part fan at full power, W/K.
    #[serde(default)]
    pub fan_loss_w_per_k: f64,
    /// Time until the thermistor answers, s.
    #[serde(default)]
    pub dead_time_s: f64,
}

/// Step and direction signals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriverSignals {
    /// Shortest high time and shortest low time of a step pulse that the driver wants, us.
    pub pulse_width_us: f64,
    /// Shortest time from a direction change to the step after it that the driver wants, us.
    pub direction_setup_us: f64,
    /// True if each edge of the step signal is a step.
    pub both_edges: bool,
    /// Motors that run the other way round.
    pub inverted: [bool; 4],
}

/// What a driver is set to.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub struct DriverSettings {
    /// Effective current in motion, mA.
    pub current_ma: f64,
    /// Current at standstill, percent of that.
    pub hold_current_percent: f64,
    /// Microsteps of a full step.
    pub microsteps: u16,
    /// Full steps in a turn of the motor.
    #[serde(default = "two_hundred")]
    pub full_steps_per_turn: u32,
    /// True: the driver makes 256 microsteps of them.
    pub interpolate: bool,
    /// The load at which the stall signal comes, 0 to 255; 0 = never.
    pub stall_threshold: u8,
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
    /// It cannot be read, or [`Printer::parse`] refuses it.
    pub fn read(path: &Path) -> Result<Self, Refusal> {
        let file = path.display().to_string();
        let text = std::fs::read_to_string(path).map_err(|error| Refusal::unreadable(&file, &error))?;
        Self::parse(&file, &text)
    }

    /// Reads a profile from its text; `file` is what errors call it.
    ///
    /// # Errors
    /// A key that concerns the machine is missing or malformed, or no machine is like that.
    pub fn parse(file: &str, text: &str) -> Result<Self, Refusal> {
        let raw: RawPrinter = toml::from_str(text).map_err(|error| Refusal::toml(file, &error))?;
        let lower_end_mm = raw.lower_end_mm.unwrap_or(Xyz { x: 0.0, y: 0.0, z: 0.0 }).array();
        let size_mm = raw.size_mm.array();
        for (axis, name) in ["x", "y", "z"].iter().enumerate() {
            let (lower, upper) = (lower_end_mm[axis], size_mm[axis]);
            if !(lower.is_finite() && upper.is_finite() && lower <= 0.0 && upper > 0.0) {
                let problem = format!("no travel goes from {lower} to {upper} mm");
                return Err(Refusal::new(
                    file,
                    format!("size_mm.{name}"),
                    problem,
                    "size_mm is above 0, lower_end_mm at most 0",
                ));
            }
        }
        let steps = raw.steps_per_mm;
        let steps_per_mm = [steps.x, steps.y, steps.z, steps.e];
        if !steps_per_mm.iter().all(|steps| steps.is_finite() && *steps > 0.0) {
            return Err(Refusal::new(
                file,
                "steps_per_mm",
                "a motor has no steps",
                "write a number above 0 for each motor",
            ));
        }
        let driver = raw.driver;
        for (key, us) in [("pulse_width_us", driver.pulse_width_us), ("direction_setup_us", driver.direction_setup_us)]
        {
            if !(us.is_finite() && us >= 0.0) {
                return Err(Refusal::new(
                    file,
                    format!("driver.{key}"),
                    format!("{us} us is no time"),
                    "write 0 or more",
                ));
            }
        }
        let nozzle = heater(file, "nozzle", raw.nozzle)?;
        let bed = raw.bed.map(|bed| heater(file, "bed", bed)).transpose()?;
        let homing = raw.homing;
        let travel = [[lower_end_mm[0], size_mm[0]], [lower_end_mm[1], size_mm[1]]];
        let drivers = [raw.drivers.x, raw.drivers.y, raw.drivers.z, raw.drivers.e];
        for (settings, name) in drivers.iter().zip(["x", "y", "z", "e"]) {
            if settings.is_some_and(|it| !it.microsteps.is_power_of_two() || it.microsteps > 256) {
                let mend = "write 1, 2, 4, 8, 16, 32, 64, 128 or 256";
                return Err(Refusal::new(file, format!("drivers.{name}.microsteps"), "no driver has that many", mend));
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
            signals: DriverSignals {
                pulse_width_us: driver.pulse_width_us,
                direction_setup_us: driver.direction_setup_us,
                both_edges: driver.both_edges,
                inverted: inverted(file, &driver.inverted)?,
            },
            drivers,
        })
    }
}

fn inverted(file: &str, names: &[String]) -> Result<[bool; 4], Refusal> {
    let mut inverted = [false; 4];
    for name in names {
        match ["x", "y", "z", "e"].iter().position(|axis| axis == name) {
            Some(motor) => inverted[motor] = true,
            None => {
                let problem = format!("there is no motor \"{name}\"");
                return Err(Refusal::new(file, "driver.inverted", problem, "write \"x\", \"y\", \"z\" or \"e\""));
            }
        }
    }
    Ok(inverted)
}

fn heater(file: &str, key: &str, heater: HeaterSettings) -> Result<HeaterSettings, Refusal> {
    if let Some(fault) = thermistor_fault(heater.sensor) {
        return Err(Refusal::new(file, format!("{key}.sensor"), fault, "copy the data sheet's R25 and B"));
    }
    if !(heater.pull_up_ohm.is_finite() && heater.pull_up_ohm > 0.0) {
        return Err(Refusal::new(
            file,
            format!("{key}.pull_up_ohm"),
            "is no pull-up resistor",
            "write it in ohm, such as 4700",
        ));
    }
    let fault = heater.model.is_some_and(|model| {
        let not_above_zero = [model.power_w, model.capacity_j_per_k].iter().any(|it| !(it.is_finite() && *it > 0.0));
        let below_zero = [model.loss_w_per_k, model.fan_loss_w_per_k, model.dead_time_s];
        not_above_zero || below_zero.iter().any(|it| !(it.is_finite() && *it >= 0.0))
    });
    if fault {
        let mend = "power and capacity are above 0, losses and dead time at least 0";
        return Err(Refusal::new(file, format!("{key}.model"), "heats nothing that exists", mend));
    }
    Ok(heater)
}

/// Why a thermistor cannot be, if so.
pub(super) fn thermistor_fault(kind: ThermistorKind) -> Option<&'static str> {
    match kind {
        ThermistorKind::Beta { r25_ohm, beta_k }
            if !(r25_ohm.is_finite() && r25_ohm > 0.0 && beta_k.is_finite() && beta_k > 0.0) =>
        {
            Some("is no thermistor: its resistance and B are above 0")
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
    driver: RawDriver,
    #[serde(default)]
    drivers: RawDrivers,
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
