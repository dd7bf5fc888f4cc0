//! A board: its chip, and what is connected to each pin.

use serde::Deserialize;

use super::chip::Chip;
use super::functions::{Adc, TimerChannel};
use super::printer::ThermistorKind;
use crate::pins::Pin;

/// A board as its file describes it.
#[derive(Debug, Clone, PartialEq)]
pub struct Board {
    /// The name in commands.
    pub name: String,
    /// The name for people.
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
    /// Offset of the image from the start of flash, bytes.
    pub boot_offset: u32,
    /// The file name that the boot loader accepts; `None` without a boot loader that reads files.
    pub boot_file: Option<String>,
    /// The profile with which the board's image is built.
    pub profile: String,
    /// The motors: x, y, z and e first, in this order; then sockets that the firmware does
    /// not use, by name.
    pub motors: Vec<Motor>,
    /// The serial line shared by the drivers, if the board has one.
    pub driver_uart: Option<Pin>,
    /// Heaters by name.
    pub heaters: Vec<Heater>,
    /// Fans by name.
    pub fans: Vec<Fan>,
    /// Thermistors by name.
    pub thermistors: Vec<Thermistor>,
    /// Inputs by name: end stops "x", "y", "z", "probe", "filament", "power_loss", "button".
    pub inputs: Vec<Input>,
    /// The host's serial line.
    pub serial: Serial,
    /// USB, if the board has a plug.
    pub usb: Option<Usb>,
    /// The plug for an ADXL345, if the board has one.
    pub accelerometer: Option<Accelerometer>,
    /// The EEPROM, an AT24C32, if the board has one.
    pub eeprom: Option<Eeprom>,
    /// The output that switches the supply of motors, heaters and fans.
    pub power_supply: Option<Pin>,
    /// The output for a servo.
    pub servo: Option<Pin>,
    /// The slot for a memory card, if the board has one.
    pub card: Option<CardSlot>,
}

/// The wires to a slot for a memory card, at the SDIO.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, Deserialize)]
pub struct CardSlot {
    /// The clock.
    pub clock: Pin,
    /// Commands and answers.
    pub command: Pin,
    /// Data, D0 to D3.
    pub data: [Pin; 4],
    /// Closed to ground while a card is in the slot.
    pub detect: Option<Pin>,
}

/// The wires to an EEPROM (I2C).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Eeprom {
    /// The clock.
    pub scl: Pin,
    /// Data.
    pub sda: Pin,
    /// The EEPROM's address, 7 bits.
    pub address: u8,
}

/// The wires to an accelerometer (SPI).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Accelerometer {
    /// The clock.
    pub sck: Pin,
    /// The chip's output.
    pub miso: Pin,
    /// The chip's input.
    pub mosi: Pin,
    /// Low while the chip is asked.
    pub cs: Pin,
}

/// The kind of motor driver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Driver {
    /// No driver.
    None,
    /// A socket for a driver module.
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

/// The serial line that configures a driver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, Deserialize)]
pub enum DriverLine {
    /// No line.
    None,
    /// A separate wire.
    Own(Pin),
    /// An address, 0 to 3, on the shared line.
    Shared(u8),
}

/// A motor and its driver.
#[derive(Debug, Clone, PartialEq)]
pub struct Motor {
    /// "x", "y", "z", "e", or the name of a socket that the firmware does not use, such as "e1".
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
    /// The line that configures the driver.
    pub line: DriverLine,
    /// The resistor at which the driver measures the current, ohm.
    pub sense_resistor_ohm: Option<f64>,
}

/// A heater: high is on.
#[derive(Debug, Clone, PartialEq)]
pub struct Heater {
    /// "nozzle", "bed", "nozzle1" to "nozzle3".
    pub name: String,
    /// The output pin.
    pub pin: Pin,
    /// The timer channel that can drive the pin.
    pub timer: Option<TimerChannel>,
    /// The thermistor that watches it.
    pub sensor: String,
}

/// A fan: high is on.
#[derive(Debug, Clone, PartialEq)]
pub struct Fan {
    /// "part", "hotend", "fan2" to "fan5".
    pub name: String,
    /// The output pin.
    pub pin: Pin,
    /// The timer channel that can drive the pin.
    pub timer: Option<TimerChannel>,
    /// Tachometer input: two pulses a turn.
    pub tacho: Option<Pin>,
}

/// A thermistor to ground.
#[derive(Debug, Clone, PartialEq)]
pub struct Thermistor {
    /// The name of the heater whose temperature it measures, or "probe", "board".
    pub name: String,
    /// The input pin.
    pub pin: Pin,
    /// Converter and channel.
    pub adc: Adc,
    /// The kind, if the board has a fixed one; otherwise the profile decides.
    pub kind: Option<ThermistorKind>,
    /// Pull-up resistor to the converter's reference, ohm.
    pub pull_up_ohm: f64,
}

/// A digital input.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Input {
    /// "x", "y", "z", "probe", "filament", "power_loss", "button".
    pub name: String,
    /// The pin.
    pub pin: Pin,
}

/// The host's serial line: USART1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Serial {
    /// The pin at which the board sends.
    pub tx: Pin,
    /// The pin at which the board receives.
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
