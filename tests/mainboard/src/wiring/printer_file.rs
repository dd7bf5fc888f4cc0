//! The keys of a profile that describe the printer.

use serde::Deserialize;

use super::printer::{
    AxisHoming, Chamber, DriverSettings, FrameMode, HeaterSettings, Kinematics, PowerSupply, ThermistorKind,
};
use super::z_motors::RawZMotors;

/// A profile; its other keys are ignored.
#[derive(Deserialize)]
pub(super) struct RawPrinter {
    pub name: String,
    pub kinematics: Kinematics,
    pub size_mm: Xyz,
    pub lower_end_mm: Option<Xyz>,
    pub steps_per_mm: Xyze,
    pub homing: RawHoming,
    pub nozzle: HeaterSettings,
    pub bed: Option<HeaterSettings>,
    pub chamber: Option<Chamber>,
    pub tools: Option<RawTools>,
    pub driver: RawDriver,
    #[serde(default)]
    pub drivers: RawDrivers,
    #[serde(default)]
    pub z_motors: RawZMotors,
    #[serde(default)]
    pub frame: RawFrame,
    pub power_supply: Option<PowerSupply>,
    pub bltouch: Option<toml::Value>,
    pub filament_sensor: Option<RawFilamentSensor>,
}

#[derive(Deserialize)]
pub(super) struct RawTools {
    pub t1: RawTool,
}

#[derive(Deserialize)]
pub(super) struct RawTool {
    pub heater: Option<String>,
    pub thermistor: Option<String>,
    pub nozzle: Option<RawToolNozzle>,
}

#[derive(Deserialize)]
pub(super) struct RawToolNozzle {
    pub sensor: Option<ThermistorKind>,
}

impl RawTool {
    /// Input and kind of its thermistor: those of the heater's name and of the first nozzle, where
    /// the profile does not say.
    pub fn thermistor(self, of_nozzle: ThermistorKind) -> Option<(String, ThermistorKind)> {
        let kind = self.nozzle.and_then(|nozzle| nozzle.sensor).unwrap_or(of_nozzle);
        Some((self.thermistor.or(self.heater)?, kind))
    }
}

#[derive(Deserialize, Default)]
pub(super) struct RawFrame {
    pub x: Option<FrameMode>,
    pub y: Option<FrameMode>,
}

#[derive(Deserialize, Clone, Copy)]
pub(super) struct Xyz {
    pub x: f64,
    pub y: f64,
    pub z: f64,
}

impl Xyz {
    pub fn array(self) -> [f64; 3] {
        [self.x, self.y, self.z]
    }
}

#[derive(Deserialize)]
pub(super) struct Xyze {
    pub x: f64,
    pub y: f64,
    pub z: f64,
    pub e: f64,
}

#[derive(Deserialize)]
pub(super) struct Xy {
    pub x: f64,
    pub y: f64,
}

#[derive(Deserialize)]
pub(super) struct Area {
    pub x: [f64; 2],
    pub y: [f64; 2],
}

#[derive(Deserialize)]
pub(super) struct RawHoming {
    pub home_at_mm: Option<Xy>,
    pub probe_offset_mm: Option<Xyz>,
    pub bed_mm: Option<Area>,
    pub x: Option<AxisHoming>,
    pub y: Option<AxisHoming>,
    pub z: Option<AxisHoming>,
}

#[derive(Deserialize)]
pub(super) struct RawDriver {
    pub pulse_width_us: f64,
    pub direction_setup_us: f64,
    #[serde(default)]
    pub both_edges: bool,
    #[serde(default)]
    pub inverted: Vec<String>,
}

#[derive(Deserialize, Default)]
pub(super) struct RawDrivers {
    pub x: Option<DriverSettings>,
    pub y: Option<DriverSettings>,
    pub z: Option<DriverSettings>,
    pub e: Option<DriverSettings>,
}

#[derive(Deserialize)]
pub(super) struct RawFilamentSensor {
    pub kind: Option<String>,
}
