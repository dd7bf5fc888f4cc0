//! A board's file.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use super::check;
use super::chip::Chip;
use super::functions::{Adc, TimerChannel};
use super::printer::ThermistorKind;
use super::refusal::Refusal;
use crate::pins::Pin;

/// A board as its file wires it.
#[derive(Debug, Clone, PartialEq)]
pub struct Board {
    /// What commands call it.
    pub name: String,
    /// What a person calls it.
    pub title: String,
    /// The chip.
    pub chip: Chip,
    /// The crystal, Hz: 4 to 26 MHz.
    pub crystal_hz: u32,
    /// Flash, bytes.
    pub flash_bytes: u32,
    /// SRAM from 0x2000_0000 on, bytes.
    pub ram_bytes: u32,
    /// Core coupled memory from 0x1000_0000 on, bytes.
    pub ccm_bytes: u32,
    /// Where the image begins, bytes from the start of flash.
    pub boot_offset: u32,
    /// The file that the boot loader takes, if there is one.
    pub boot_file: Option<String>,
    /// The profile that the board's image is built with.
    pub profile: String,
    /// True where nothing real hangs on the board.
    pub virtual_sensors: bool,
    /// The motors: x, y, z and e first, in this order; then those that nothing moves, by name.
    pub motors: Vec<Motor>,
    /// The line that the drivers share, if they do.
    pub driver_uart: Option<Pin>,
    /// Heaters by name.
    pub heaters: Vec<Heater>,
    /// Fans by name.
    pub fans: Vec<Fan>,
    /// Thermistors by name.
    pub thermistors: Vec<Thermistor>,
    /// Inputs by name: end stops "x", "y", "z", "probe", "filament".
    pub inputs: Vec<Input>,
    /// The host's serial line.
    pub serial: Serial,
    /// USB, where there is a plug.
    pub usb: Option<Usb>,
}

/// What drives a motor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Driver {
    /// Nothing is there.
    None,
    /// A socket for any driver.
    Socket,
    /// Allegro A4988.
    A4988,
    /// TI DRV8825.
    Drv8825,
    /// Trinamic TMC2130.
    Tmc2130,
    /// Trinamic TMC2208.
    Tmc2208,
    /// Trinamic TMC2209.
    Tmc2209,
    /// Trinamic TMC5160.
    Tmc5160,
}

/// The line by which a driver is set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, Deserialize)]
pub enum DriverLine {
    /// It has none.
    None,
    /// A single wire of its own.
    Own(Pin),
    /// An address, 0 to 3, on the shared line.
    Shared(u8),
}

/// A motor and its driver.
#[derive(Debug, Clone, PartialEq)]
pub struct Motor {
    /// "x", "y", "z", "e", or one that nothing moves, such as "e1".
    pub name: String,
    /// Step output.
    pub step: Pin,
    /// Direction output: high is backwards.
    pub direction: Pin,
    /// Enable output: low is on. Motors may share it.
    pub enable: Pin,
    /// Stall signal of the driver.
    pub diag: Option<Pin>,
    /// The driver.
    pub driver: Driver,
    /// How the driver is set.
    pub line: DriverLine,
    /// What the driver measures the current at, ohm.
    pub sense_resistor_ohm: Option<f64>,
}

/// A heater: high is on.
#[derive(Debug, Clone, PartialEq)]
pub struct Heater {
    /// "nozzle", "bed", "nozzle1" to "nozzle3".
    pub name: String,
    /// Its output.
    pub pin: Pin,
    /// The timer channel that can switch it.
    pub timer: Option<TimerChannel>,
    /// The thermistor that watches it.
    pub sensor: String,
}

/// A fan: high is on.
#[derive(Debug, Clone, PartialEq)]
pub struct Fan {
    /// "part", "hotend", "fan2" to "fan5".
    pub name: String,
    /// Its output.
    pub pin: Pin,
    /// The timer channel that can switch it.
    pub timer: Option<TimerChannel>,
    /// Input with two pulses a turn.
    pub tacho: Option<Pin>,
}

/// A thermistor to ground.
#[derive(Debug, Clone, PartialEq)]
pub struct Thermistor {
    /// As the heater that it watches, or "probe", "board".
    pub name: String,
    /// Its input.
    pub pin: Pin,
    /// Converter and channel.
    pub adc: Adc,
    /// What hangs on it, where the board decides that.
    pub kind: Option<ThermistorKind>,
    /// Resistor to the converter's reference, ohm.
    pub pull_up_ohm: f64,
}

/// An input.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Input {
    /// "x", "y", "z", "probe", "filament".
    pub name: String,
    /// Its pin.
    pub pin: Pin,
}

/// The host's serial line: USART1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Serial {
    /// The board sends here.
    pub tx: Pin,
    /// The board receives here.
    pub rx: Pin,
}

/// USB, full speed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Usb {
    /// D-.
    pub dm: Pin,
    /// D+.
    pub dp: Pin,
}

impl Board {
    /// Reads a board's file.
    ///
    /// # Errors
    /// It cannot be read, or [`Board::parse`] refuses it.
    pub fn read(path: &Path) -> Result<Self, Refusal> {
        let file = path.display().to_string();
        let text = std::fs::read_to_string(path).map_err(|error| Refusal::unreadable(&file, &error))?;
        Self::parse(&file, &text)
    }

    /// Reads a board from its text; `file` is what errors call it.
    ///
    /// # Errors
    /// A key is unknown, missing or malformed, or the chip cannot be wired so.
    pub fn parse(file: &str, text: &str) -> Result<Self, Refusal> {
        let raw: RawBoard = toml::from_str(text).map_err(|error| Refusal::toml(file, &error))?;
        check::board(file, raw)
    }

    /// The motor of this name.
    #[must_use]
    pub fn motor(&self, name: &str) -> Option<&Motor> {
        self.motors.iter().find(|motor| motor.name == name)
    }

    /// The thermistor of this name.
    #[must_use]
    pub fn thermistor(&self, name: &str) -> Option<&Thermistor> {
        self.thermistors.iter().find(|thermistor| thermistor.name == name)
    }

    /// The input of this name.
    #[must_use]
    pub fn input(&self, name: &str) -> Option<&Input> {
        self.inputs.iter().find(|input| input.name == name)
    }
}

/// The file as it is written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawBoard {
    pub name: String,
    pub title: String,
    pub chip: String,
    pub package: String,
    pub crystal_mhz: f64,
    pub flash_kib: u32,
    pub ram_kib: u32,
    pub ccm_kib: u32,
    pub boot_offset: u32,
    pub boot_file: Option<String>,
    pub profile: String,
    #[serde(default)]
    pub virtual_sensors: bool,
    pub motors: BTreeMap<String, RawMotor>,
    pub driver_uart: Option<RawPin>,
    #[serde(default)]
    pub heaters: BTreeMap<String, RawHeater>,
    #[serde(default)]
    pub fans: BTreeMap<String, RawFan>,
    #[serde(default)]
    pub thermistors: BTreeMap<String, RawThermistor>,
    #[serde(default)]
    pub inputs: BTreeMap<String, String>,
    pub serial: RawSerial,
    pub usb: Option<RawUsb>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawMotor {
    pub step: String,
    pub direction: String,
    pub enable: String,
    pub driver: Driver,
    pub diag: Option<String>,
    pub uart: Option<String>,
    pub uart_address: Option<u8>,
    pub sense_resistor_ohm: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawPin {
    pub pin: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawHeater {
    pub pin: String,
    pub timer: Option<String>,
    pub sensor: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawFan {
    pub pin: String,
    pub timer: Option<String>,
    pub tacho: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawThermistor {
    pub pin: String,
    pub adc: String,
    pub kind: Option<ThermistorKind>,
    pub pull_up_ohm: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawSerial {
    pub port: String,
    pub tx: String,
    pub rx: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawUsb {
    pub dm: String,
    pub dp: String,
}
