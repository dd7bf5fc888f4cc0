//! Reads a board's file and checks it against the chip's data sheet.

use std::collections::BTreeMap;
use std::path::Path;

use super::board::{
    Accelerometer, Board, CardSlot, Driver, DriverLine, Eeprom, Fan, Heater, Input, Motor, Serial, Thermistor, Usb,
};
use super::board_file::{RawBoard, RawMotor};
use super::chip::Chip;
use super::functions::{Adc, CRYSTAL, SDIO_CK, SDIO_CMD, SDIO_DATA, TimerChannel, USART1_RX, USART1_TX, USB};
use super::printer_check::{THERMISTOR_CURE, thermistor_fault};
use super::refusal::Refusal;
use crate::pins::Pin;

/// The motors that the firmware moves, in the order of a step event's bits.
const AXES: [&str; 4] = ["x", "y", "z", "e"];
/// Alignment of the vector table, bytes (PM0214, 4.4.4, VTOR).
const VECTOR_ALIGNMENT: u32 = 0x200;

impl Board {
    /// Reads a board's file.
    ///
    /// # Errors
    /// The file cannot be read, or [`Board::parse`] refuses it.
    pub fn read(path: &Path) -> Result<Self, Refusal> {
        let file = path.display().to_string();
        let text = std::fs::read_to_string(path).map_err(|error| Refusal::unreadable(&file, &error))?;
        Self::parse(&file, &text)
    }

    /// Reads a board from its text; `file` is its name in errors.
    ///
    /// # Errors
    /// A key is unknown, missing or malformed, or the chip's data sheet excludes the wiring.
    pub fn parse(file: &str, text: &str) -> Result<Self, Refusal> {
        let raw: RawBoard = toml::from_str(text).map_err(|error| Refusal::toml(file, &error))?;
        board(file, raw)
    }
}

fn board(file: &str, raw: RawBoard) -> Result<Board, Refusal> {
    let chip = chip(file, &raw)?;
    memories(file, &raw, chip)?;
    if !(4.0..=26.0).contains(&raw.crystal_mhz) {
        return Err(Refusal::new(
            file,
            "crystal_mhz",
            format!("{} MHz is outside the range of this chip", raw.crystal_mhz),
            "write the frequency printed on the crystal, 4 to 26 MHz",
        ));
    }
    let mut pins = Pins { file, chip, taken: BTreeMap::new() };
    for pin in CRYSTAL {
        pins.taken.insert(pin, Use { key: "crystal_mhz".to_owned(), shared: false });
    }
    let motors = motors(&mut pins, &raw)?;
    let driver_uart = match &raw.driver_uart {
        Some(line) => Some(pins.take("driver_uart.pin", &line.pin)?),
        None => None,
    };
    let thermistors = thermistors(&mut pins, &raw)?;
    let heaters = heaters(&mut pins, &raw)?;
    let mut fans = Vec::new();
    for (name, fan) in &raw.fans {
        let key = format!("fans.{name}");
        let pin = pins.take(&format!("{key}.pin"), &fan.pin)?;
        let timer = pins.timer(&format!("{key}.timer"), fan.timer.as_deref(), pin)?;
        let tacho = pins.take_optional(&format!("{key}.tacho"), fan.tacho.as_deref())?;
        fans.push(Fan { name: name.clone(), pin, timer, tacho });
    }
    let mut inputs = Vec::new();
    for (name, pin) in &raw.inputs {
        inputs.push(Input { name: name.clone(), pin: pins.take(&format!("inputs.{name}"), pin)? });
    }
    let serial = serial(&mut pins, &raw)?;
    let usb = usb(&mut pins, &raw)?;
    let accelerometer = accelerometer(&mut pins, &raw)?;
    let eeprom = eeprom(&mut pins, &raw)?;
    let power_supply =
        pins.take_optional("power_supply.pin", raw.power_supply.as_ref().map(|table| table.pin.as_str()))?;
    let servo = pins.take_optional("servo.pin", raw.servo.as_ref().map(|table| table.pin.as_str()))?;
    let card = card(&mut pins, &raw)?;
    Ok(Board {
        name: raw.name,
        title: raw.title,
        chip,
        crystal_hz: (raw.crystal_mhz * 1e6).round() as u32,
        flash_bytes: raw.flash_kib * 1024,
        ram_bytes: raw.ram_kib * 1024,
        ccm_bytes: raw.ccm_kib * 1024,
        boot_offset: raw.boot_offset,
        boot_file: raw.boot_file,
        profile: raw.profile,
        motors,
        driver_uart,
        heaters,
        fans,
        thermistors,
        inputs,
        serial,
        usb,
        accelerometer,
        eeprom,
        power_supply,
        servo,
        card,
    })
}

fn chip(file: &str, raw: &RawBoard) -> Result<Chip, Refusal> {
    let Some(chip) = Chip::ALL.into_iter().find(|chip| chip.name() == raw.chip) else {
        let known = Chip::ALL.map(Chip::name).join(", ");
        return Err(Refusal::new(
            file,
            "chip",
            format!("unknown chip \"{}\"", raw.chip),
            format!("write one of the modelled chips: {known}"),
        ));
    };
    if raw.package != chip.package() {
        return Err(Refusal::new(
            file,
            "package",
            format!("the {} comes in {}, not in {}", chip.name(), chip.package(), raw.package),
            format!("write \"{}\"", chip.package()),
        ));
    }
    Ok(chip)
}

fn memories(file: &str, raw: &RawBoard, chip: Chip) -> Result<(), Refusal> {
    let sizes = [
        ("flash_kib", raw.flash_kib, chip.flash_kib()),
        ("ram_kib", raw.ram_kib, chip.ram_kib()),
        ("ccm_kib", raw.ccm_kib, chip.ccm_kib()),
    ];
    for (key, kib, max_kib) in sizes {
        if kib > max_kib {
            return Err(Refusal::new(
                file,
                key,
                format!("{kib} KiB is more than the {max_kib} KiB of the {}", chip.name()),
                if max_kib == 0 { "write 0".to_owned() } else { format!("write {max_kib} or less") },
            ));
        }
    }
    if raw.boot_offset >= raw.flash_kib * 1024 || !raw.boot_offset.is_multiple_of(VECTOR_ALIGNMENT) {
        return Err(Refusal::new(
            file,
            "boot_offset",
            format!("an image cannot start {:#x} bytes after the start of flash", raw.boot_offset),
            format!("write a multiple of {VECTOR_ALIGNMENT:#x} below {:#x}", raw.flash_kib * 1024),
        ));
    }
    Ok(())
}

fn motors(pins: &mut Pins<'_>, raw: &RawBoard) -> Result<Vec<Motor>, Refusal> {
    let mut motors = Vec::new();
    for name in AXES {
        let Some(motor) = raw.motors.get(name) else {
            return Err(Refusal::new(
                pins.file,
                format!("motors.{name}"),
                "is missing",
                "add the table: every board has the motors x, y, z and e",
            ));
        };
        motors.push(read_motor(pins, name, motor)?);
    }
    for (name, motor) in raw.motors.iter().filter(|(name, _)| !AXES.contains(&name.as_str())) {
        motors.push(read_motor(pins, name, motor)?);
    }
    let mut addresses: BTreeMap<u8, &str> = BTreeMap::new();
    for motor in &motors {
        let DriverLine::Shared(address) = motor.line else { continue };
        let key = format!("motors.{}.uart_address", motor.name);
        if address > 3 {
            let problem = format!("{address} is not a driver address");
            return Err(Refusal::new(pins.file, key, problem, "write 0 to 3, as set by the driver's pins MS1 and MS2"));
        }
        if raw.driver_uart.is_none() {
            let mend = "add [driver_uart] with its pin, or give the motor a `uart` pin of its own";
            return Err(Refusal::new(pins.file, key, "the board has no line shared by its drivers", mend));
        }
        if let Some(other) = addresses.insert(address, &motor.name) {
            let problem = format!("motors.{other} has the address {address} too");
            return Err(Refusal::new(
                pins.file,
                key,
                problem,
                "give each driver on the shared line its own address, 0 to 3",
            ));
        }
    }
    Ok(motors)
}

fn read_motor(pins: &mut Pins<'_>, name: &str, raw: &RawMotor) -> Result<Motor, Refusal> {
    let key = |field: &str| format!("motors.{name}.{field}");
    let line = match (&raw.uart, raw.uart_address) {
        (Some(_), Some(_)) => {
            let mend = "keep `uart` for a wire of its own, or `uart_address` for the shared line";
            return Err(Refusal::new(pins.file, key("uart"), "the driver has both `uart` and `uart_address`", mend));
        }
        (Some(pin), None) => DriverLine::Own(pins.take(&key("uart"), pin)?),
        (None, Some(address)) => DriverLine::Shared(address),
        (None, None) => DriverLine::None,
    };
    if let (Driver::None, true) = (raw.driver, line != DriverLine::None) {
        return Err(Refusal::new(
            pins.file,
            key("driver"),
            "is \"none\", but the motor has a serial line",
            "name the driver, or remove `uart` or `uart_address`",
        ));
    }
    if let Some(ohm) = raw.sense_resistor_ohm.filter(|ohm| !(*ohm > 0.0 && *ohm < 10.0)) {
        return Err(Refusal::new(
            pins.file,
            key("sense_resistor_ohm"),
            format!("{ohm} ohm is outside the range of 0 to 10 ohm"),
            "write the resistor in ohm, such as 0.11",
        ));
    }
    Ok(Motor {
        name: name.to_owned(),
        step: pins.take(&key("step"), &raw.step)?,
        direction: pins.take(&key("direction"), &raw.direction)?,
        enable: pins.take_shared(&key("enable"), &raw.enable)?,
        diag: pins.take_optional(&key("diag"), raw.diag.as_deref())?,
        driver: raw.driver,
        line,
        sense_resistor_ohm: raw.sense_resistor_ohm,
    })
}

fn thermistors(pins: &mut Pins<'_>, raw: &RawBoard) -> Result<Vec<Thermistor>, Refusal> {
    let mut thermistors = Vec::new();
    for (name, thermistor) in &raw.thermistors {
        let key = format!("thermistors.{name}");
        let pin = pins.take(&format!("{key}.pin"), &thermistor.pin)?;
        let Some(adc) = Adc::parse(&thermistor.adc).filter(|adc| adc.pin() == Some(pin)) else {
            let channels = Adc::all_at(pin);
            let mend = if channels.is_empty() {
                format!("choose another pin: {pin} has no converter")
            } else {
                format!("write one of {}", listed(&channels))
            };
            let problem = format!("{} is not on {pin}", thermistor.adc);
            return Err(Refusal::new(pins.file, format!("{key}.adc"), problem, mend));
        };
        if !(thermistor.pull_up_ohm > 0.0 && thermistor.pull_up_ohm < 1e7) {
            let problem = format!("{} ohm is outside the range of 0 to 10 megohm", thermistor.pull_up_ohm);
            let mend = "write the pull-up resistor in ohm, such as 4700";
            return Err(Refusal::new(pins.file, format!("{key}.pull_up_ohm"), problem, mend));
        }
        if let Some(problem) = thermistor.kind.and_then(thermistor_fault) {
            return Err(Refusal::new(pins.file, format!("{key}.kind"), problem, THERMISTOR_CURE));
        }
        let (kind, pull_up_ohm) = (thermistor.kind, thermistor.pull_up_ohm);
        thermistors.push(Thermistor { name: name.clone(), pin, adc, kind, pull_up_ohm });
    }
    Ok(thermistors)
}

fn heaters(pins: &mut Pins<'_>, raw: &RawBoard) -> Result<Vec<Heater>, Refusal> {
    let mut heaters = Vec::new();
    for (name, heater) in &raw.heaters {
        let key = format!("heaters.{name}");
        let pin = pins.take(&format!("{key}.pin"), &heater.pin)?;
        let timer = pins.timer(&format!("{key}.timer"), heater.timer.as_deref(), pin)?;
        if !raw.thermistors.contains_key(&heater.sensor) {
            return Err(Refusal::new(
                pins.file,
                format!("{key}.sensor"),
                format!("no thermistor is called \"{}\"", heater.sensor),
                format!("name a thermistor of this board, or add [thermistors.{}]", heater.sensor),
            ));
        }
        heaters.push(Heater { name: name.clone(), pin, timer, sensor: heater.sensor.clone() });
    }
    Ok(heaters)
}

fn serial(pins: &mut Pins<'_>, raw: &RawBoard) -> Result<Serial, Refusal> {
    if raw.serial.port != "USART1" {
        let problem = format!("{} is not supported: the host's line is USART1", raw.serial.port);
        return Err(Refusal::new(pins.file, "serial.port", problem, "write \"USART1\""));
    }
    let tx = pins.take_of("serial.tx", &raw.serial.tx, &USART1_TX, "USART1's transmitter")?;
    let rx = pins.take_of("serial.rx", &raw.serial.rx, &USART1_RX, "USART1's receiver")?;
    Ok(Serial { tx, rx })
}

fn usb(pins: &mut Pins<'_>, raw: &RawBoard) -> Result<Option<Usb>, Refusal> {
    let Some(usb) = &raw.usb else { return Ok(None) };
    let dm = pins.take_of("usb.dm", &usb.dm, &USB[..1], "USB's D-")?;
    let dp = pins.take_of("usb.dp", &usb.dp, &USB[1..], "USB's D+")?;
    Ok(Some(Usb { dm, dp }))
}

fn accelerometer(pins: &mut Pins<'_>, raw: &RawBoard) -> Result<Option<Accelerometer>, Refusal> {
    let Some(raw) = &raw.accelerometer else { return Ok(None) };
    if raw.chip != "adxl345" {
        let problem = format!("no model of a \"{}\"", raw.chip);
        return Err(Refusal::new(pins.file, "accelerometer.chip", problem, "write \"adxl345\""));
    }
    Ok(Some(Accelerometer {
        sck: pins.take("accelerometer.sck", &raw.sck)?,
        miso: pins.take("accelerometer.miso", &raw.miso)?,
        mosi: pins.take("accelerometer.mosi", &raw.mosi)?,
        cs: pins.take("accelerometer.cs", &raw.cs)?,
    }))
}

fn eeprom(pins: &mut Pins<'_>, raw: &RawBoard) -> Result<Option<Eeprom>, Refusal> {
    let Some(raw) = &raw.eeprom else { return Ok(None) };
    if raw.chip != "24c32" {
        let problem = format!("no model of a \"{}\"", raw.chip);
        return Err(Refusal::new(pins.file, "eeprom.chip", problem, "write \"24c32\""));
    }
    if raw.address >> 3 != 0b1010 {
        let problem = format!("{:#x} is no address of a 24C32", raw.address);
        return Err(Refusal::new(pins.file, "eeprom.address", problem, "write one from 0x50 to 0x57"));
    }
    Ok(Some(Eeprom {
        scl: pins.take("eeprom.scl", &raw.scl)?,
        sda: pins.take("eeprom.sda", &raw.sda)?,
        address: raw.address,
    }))
}

fn card(pins: &mut Pins<'_>, raw: &RawBoard) -> Result<Option<CardSlot>, Refusal> {
    let Some(raw) = &raw.card else { return Ok(None) };
    let clock = pins.take_of("card.clock", &raw.clock, &[SDIO_CK], "the SDIO's clock")?;
    let command = pins.take_of("card.command", &raw.command, &[SDIO_CMD], "the SDIO's command line")?;
    let mut data = SDIO_DATA;
    for (pin, (key, text)) in data.iter_mut().zip([("d0", &raw.d0), ("d1", &raw.d1), ("d2", &raw.d2), ("d3", &raw.d3)])
    {
        *pin = pins.take_of(&format!("card.{key}"), text, &[*pin], &format!("the SDIO's line {key}"))?;
    }
    let detect = pins.take_optional("card.detect", raw.detect.as_deref())?;
    Ok(Some(CardSlot { clock, command, data, detect }))
}

/// The key that uses a pin, and whether others may share it.
struct Use {
    key: String,
    shared: bool,
}

/// The pins in use.
struct Pins<'a> {
    file: &'a str,
    chip: Chip,
    taken: BTreeMap<Pin, Use>,
}

impl Pins<'_> {
    fn take(&mut self, key: &str, text: &str) -> Result<Pin, Refusal> {
        self.claim(key, text, false)
    }

    fn take_shared(&mut self, key: &str, text: &str) -> Result<Pin, Refusal> {
        self.claim(key, text, true)
    }

    fn take_optional(&mut self, key: &str, text: Option<&str>) -> Result<Option<Pin>, Refusal> {
        text.map(|text| self.take(key, text)).transpose()
    }

    fn take_of(&mut self, key: &str, text: &str, allowed: &[Pin], what: &str) -> Result<Pin, Refusal> {
        let pin = self.take(key, text)?;
        if allowed.contains(&pin) {
            return Ok(pin);
        }
        let problem = format!("{pin} is not a pin of {what}");
        Err(Refusal::new(self.file, key, problem, format!("write one of {}", listed(allowed))))
    }

    fn claim(&mut self, key: &str, text: &str, shared: bool) -> Result<Pin, Refusal> {
        let pin: Pin = text.parse().map_err(|fault: String| {
            let (problem, mend) = fault.split_once(": ").unwrap_or((&fault, "write a pin such as \"PD1\""));
            Refusal::new(self.file, key, problem, mend)
        })?;
        if !self.chip.has_pin(pin) {
            return Err(Refusal::new(
                self.file,
                key,
                format!("{pin} does not exist on the {} in {}", self.chip.name(), self.chip.package()),
                "look the pin up in the board's circuit diagram",
            ));
        }
        match self.taken.get(&pin) {
            Some(other) if !(shared && other.shared) => Err(Refusal::new(
                self.file,
                key,
                format!("{pin} is already used by {}", other.key),
                "give each signal its own pin; only the enable pins of motors may share one",
            )),
            _ => {
                self.taken.insert(pin, Use { key: key.to_owned(), shared });
                Ok(pin)
            }
        }
    }

    fn timer(&self, key: &str, text: Option<&str>, pin: Pin) -> Result<Option<TimerChannel>, Refusal> {
        let Some(text) = text else { return Ok(None) };
        match TimerChannel::parse(text).filter(|channel| channel.pins(self.chip).contains(&pin)) {
            Some(channel) => Ok(Some(channel)),
            None => {
                let channels = TimerChannel::all_at(self.chip, pin);
                let mend = if channels.is_empty() {
                    format!("remove the key: {pin} has no timer channel")
                } else {
                    format!("write one of {}, or remove the key to switch {pin} without a timer", listed(&channels))
                };
                Err(Refusal::new(self.file, key, format!("{text} is not on {pin}"), mend))
            }
        }
    }
}

fn listed<T: ToString>(items: &[T]) -> String {
    items.iter().map(T::to_string).collect::<Vec<_>>().join(", ")
}
