//! The shape of a board's text: names of keys and their types. What they mean is said in the boards' files.

use serde::Deserialize;
use toml::Spanned;

/// A word with its place in the text.
pub type Word = Spanned<String>;
/// A number with its place in the text; TOML integers are taken too.
pub type Number = Spanned<f64>;

/// A whole board.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a board")]
pub struct BoardFile {
    pub name: Word,
    pub title: Word,
    pub chip: Word,
    pub package: Word,
    pub crystal_mhz: Number,
    pub flash_kib: Number,
    pub ram_kib: Number,
    pub ccm_kib: Number,
    pub boot_offset: Number,
    pub boot_file: Option<Word>,
    pub profile: Word,
    #[serde(default)]
    pub virtual_sensors: bool,
    pub motors: MotorTables,
    pub driver_uart: Option<DriverUartTable>,
    #[serde(default)]
    pub heaters: HeaterTables,
    #[serde(default)]
    pub fans: FanTables,
    #[serde(default)]
    pub thermistors: ThermistorTables,
    #[serde(default)]
    pub inputs: InputTable,
    pub serial: SerialTable,
    pub usb: Option<UsbTable>,
}

/// The four motors that move, and sockets besides.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "the tables motors.x, motors.y, motors.z, motors.e")]
pub struct MotorTables {
    pub x: MotorTable,
    pub y: MotorTable,
    pub z: MotorTable,
    pub e: MotorTable,
    pub z2: Option<MotorTable>,
    pub e1: Option<MotorTable>,
    pub e2: Option<MotorTable>,
    pub e3: Option<MotorTable>,
}

/// A motor.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table of a motor's values")]
pub struct MotorTable {
    pub step: Word,
    pub direction: Word,
    pub enable: Word,
    pub driver: Spanned<DriverName>,
    pub diag: Option<Word>,
    pub uart: Option<Word>,
    pub uart_address: Option<Number>,
    pub sense_resistor_ohm: Option<Number>,
}

/// A motor driver.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "lowercase")]
pub enum DriverName {
    /// None at all.
    None,
    /// Whatever is plugged in.
    Socket,
    /// Allegro A4988.
    A4988,
    /// Texas Instruments DRV8825.
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

/// The line that drivers share.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table with the key pin")]
pub struct DriverUartTable {
    pub pin: Word,
}

/// Heaters, by what they heat.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, expecting = "the heaters' tables")]
pub struct HeaterTables {
    pub nozzle: Option<HeaterTable>,
    pub bed: Option<HeaterTable>,
    pub nozzle1: Option<HeaterTable>,
    pub nozzle2: Option<HeaterTable>,
    pub nozzle3: Option<HeaterTable>,
}

/// A heater.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table of a heater's values")]
pub struct HeaterTable {
    pub pin: Word,
    pub timer: Option<Word>,
    pub sensor: Word,
}

/// Fans.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, expecting = "the fans' tables")]
pub struct FanTables {
    pub part: Option<FanTable>,
    pub hotend: Option<FanTable>,
    pub fan2: Option<FanTable>,
    pub fan3: Option<FanTable>,
    pub fan4: Option<FanTable>,
    pub fan5: Option<FanTable>,
}

/// A fan.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table of a fan's values")]
pub struct FanTable {
    pub pin: Word,
    pub timer: Option<Word>,
    pub tacho: Option<Word>,
}

/// Thermistors, by what they measure.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, expecting = "the thermistors' tables")]
pub struct ThermistorTables {
    pub nozzle: Option<ThermistorTable>,
    pub bed: Option<ThermistorTable>,
    pub nozzle1: Option<ThermistorTable>,
    pub nozzle2: Option<ThermistorTable>,
    pub nozzle3: Option<ThermistorTable>,
    pub probe: Option<ThermistorTable>,
    pub board: Option<ThermistorTable>,
}

/// A thermistor.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table of a thermistor's values")]
pub struct ThermistorTable {
    pub pin: Word,
    pub adc: Word,
    pub kind: Option<Word>,
    pub pull_up_ohm: Number,
}

/// Inputs besides those of motors and fans.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table of inputs")]
pub struct InputTable {
    pub x: Option<Word>,
    pub y: Option<Word>,
    pub z: Option<Word>,
    pub probe: Option<Word>,
    pub filament: Option<Word>,
}

/// The host's line.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table with the keys port, tx, rx")]
pub struct SerialTable {
    pub port: Word,
    pub tx: Word,
    pub rx: Word,
}

/// USB.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table with the keys dm, dp")]
pub struct UsbTable {
    pub dm: Word,
    pub dp: Word,
}
