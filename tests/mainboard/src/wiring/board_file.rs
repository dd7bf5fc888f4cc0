//! The tables and keys of a board's file.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::board::Driver;
use super::printer::ThermistorKind;

/// A board's file.
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
    pub accelerometer: Option<RawAccelerometer>,
    pub eeprom: Option<RawEeprom>,
    pub power_supply: Option<RawPin>,
    pub servo: Option<RawPin>,
    pub card: Option<RawCard>,
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

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawAccelerometer {
    pub chip: String,
    pub sck: String,
    pub miso: String,
    pub mosi: String,
    pub cs: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawEeprom {
    pub chip: String,
    pub scl: String,
    pub sda: String,
    pub address: u8,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawCard {
    pub clock: String,
    pub command: String,
    pub d0: String,
    pub d1: String,
    pub d2: String,
    pub d3: String,
    pub detect: Option<String>,
}
