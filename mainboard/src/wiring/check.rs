//! What a board's file may say: the chip's data sheet decides.

use std::collections::BTreeMap;

use super::board::{Board, Driver, DriverLine, Fan, Heater, Input, Motor, RawBoard, RawMotor, Serial, Thermistor, Usb};
use super::chip::Chip;
use super::functions::{Adc, CRYSTAL, TimerChannel, USART1_RX, USART1_TX, USB};
use super::refusal::Refusal;
use crate::pins::Pin;

/// The motors that the firmware moves, in the order of a step event's bits.
const AXES: [&str; 4] = ["x", "y", "z", "e"];
/// The vector table begins on such a boundary, bytes (PM0214, 4.4.4, VTOR).
const VECTOR_ALIGNMENT: u32 = 0x200;

/// Checks a whole file.
pub(super) fn board(file: &str, raw: RawBoard) -> Result<Board, Refusal> {
    let chip = chip(file, &raw)?;
    memories(file, &raw, chip)?;
    if !(4.0..=26.0).contains(&raw.crystal_mhz) {
        return Err(Refusal::new(
            file,
            "crystal_mhz",
            format!("{} MHz is no crystal for this chip", raw.crystal_mhz),
            "it takes 4 to 26 MHz: write what is printed on the crystal",
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
    if raw.virtual_sensors && !(heaters.is_empty() && thermistors.is_empty() && inputs.is_empty()) {
        return Err(Refusal::new(
            file,
            "virtual_sensors",
            "the board has heaters, thermistors or inputs, but the file says that it has none",
            "set it to false, or remove those tables",
        ));
    }
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
        virtual_sensors: raw.virtual_sensors,
        motors,
        driver_uart,
        heaters,
        fans,
        thermistors,
        inputs,
        serial,
        usb,
    })
}

fn chip(file: &str, raw: &RawBoard) -> Result<Chip, Refusal> {
    let Some(chip) = Chip::ALL.into_iter().find(|chip| chip.name() == raw.chip) else {
        let known = Chip::ALL.map(Chip::name).join(", ");
        return Err(Refusal::new(
            file,
            "chip",
            format!("there is no model of an {}", raw.chip),
            format!("write one of {known}"),
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
    for (key, said, most) in sizes {
        if said > most {
            return Err(Refusal::new(
                file,
                key,
                format!("{said} KiB are more than the {} has", chip.name()),
                format!("write {most} or less"),
            ));
        }
    }
    if raw.boot_offset >= raw.flash_kib * 1024 || !raw.boot_offset.is_multiple_of(VECTOR_ALIGNMENT) {
        return Err(Refusal::new(
            file,
            "boot_offset",
            format!("no image can begin {:#x} bytes from the start of flash", raw.boot_offset),
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
                "every board has x, y, z and e",
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
            let problem = format!("{address} is no address of a driver");
            return Err(Refusal::new(pins.file, key, problem, "write 0 to 3, as the driver's pins MS1 and MS2 say"));
        }
        if raw.driver_uart.is_none() {
            let mend = "add [driver_uart] with its pin, or give the motor a `uart` of its own";
            return Err(Refusal::new(pins.file, key, "there is no line that the drivers share", mend));
        }
        if let Some(other) = addresses.insert(address, &motor.name) {
            let problem = format!("{address} is the address of motors.{other} too");
            return Err(Refusal::new(pins.file, key, problem, "give each driver on the line its own, 0 to 3"));
        }
    }
    Ok(motors)
}

fn read_motor(pins: &mut Pins<'_>, name: &str, raw: &RawMotor) -> Result<Motor, Refusal> {
    let key = |field: &str| format!("motors.{name}.{field}");
    let line = match (&raw.uart, raw.uart_address) {
        (Some(_), Some(_)) => {
            let mend = "keep `uart` for a wire of its own or `uart_address` for the shared line";
            return Err(Refusal::new(pins.file, key("uart"), "the driver has two lines", mend));
        }
        (Some(pin), None) => DriverLine::Own(pins.take(&key("uart"), pin)?),
        (None, Some(address)) => DriverLine::Shared(address),
        (None, None) => DriverLine::None,
    };
    if let (Driver::None, true) = (raw.driver, line != DriverLine::None) {
        return Err(Refusal::new(
            pins.file,
            key("driver"),
            "a line leads to no driver",
            "name the driver, or remove the line",
        ));
    }
    if raw.sense_resistor_ohm.is_some_and(|ohm| !(ohm > 0.0 && ohm < 10.0)) {
        let mend = "write it in ohm, such as 0.11";
        return Err(Refusal::new(
            pins.file,
            key("sense_resistor_ohm"),
            "is no resistor that a driver measures at",
            mend,
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
            let there = listed(&Adc::all_at(pin));
            return Err(Refusal::new(
                pins.file,
                format!("{key}.adc"),
                format!("{} is not at {pin}", thermistor.adc),
                format!("{pin} has {there}"),
            ));
        };
        if !(thermistor.pull_up_ohm > 0.0 && thermistor.pull_up_ohm < 1e7) {
            let mend = "write it in ohm, such as 4700";
            return Err(Refusal::new(pins.file, format!("{key}.pull_up_ohm"), "is no pull-up resistor", mend));
        }
        if let Some(fault) = thermistor.kind.and_then(super::printer::thermistor_fault) {
            return Err(Refusal::new(pins.file, format!("{key}.kind"), fault, "copy the data sheet's R25 and B"));
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
                format!("there is no thermistor \"{}\"", heater.sensor),
                format!("name a table of [thermistors], or add [thermistors.{}]", heater.sensor),
            ));
        }
        heaters.push(Heater { name: name.clone(), pin, timer, sensor: heater.sensor.clone() });
    }
    Ok(heaters)
}

fn serial(pins: &mut Pins<'_>, raw: &RawBoard) -> Result<Serial, Refusal> {
    if raw.serial.port != "USART1" {
        let problem = format!("{} is not the host's line", raw.serial.port);
        return Err(Refusal::new(pins.file, "serial.port", problem, "write \"USART1\""));
    }
    let tx = pins.take_of("serial.tx", &raw.serial.tx, &USART1_TX, "USART1 sends")?;
    let rx = pins.take_of("serial.rx", &raw.serial.rx, &USART1_RX, "USART1 receives")?;
    Ok(Serial { tx, rx })
}

fn usb(pins: &mut Pins<'_>, raw: &RawBoard) -> Result<Option<Usb>, Refusal> {
    let Some(usb) = &raw.usb else { return Ok(None) };
    let dm = pins.take_of("usb.dm", &usb.dm, &USB[..1], "USB's D- is")?;
    let dp = pins.take_of("usb.dp", &usb.dp, &USB[1..], "USB's D+ is")?;
    Ok(Some(Usb { dm, dp }))
}

/// What takes a pin.
struct Use {
    key: String,
    shared: bool,
}

/// The pins that are taken already.
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
        let list = listed(allowed);
        Err(Refusal::new(self.file, key, format!("{what} at {list}, not at {pin}"), format!("write one of {list}")))
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
                format!("the {} in {} has no {pin}", self.chip.name(), self.chip.package()),
                "look the pin up in the board's circuit diagram",
            ));
        }
        match self.taken.get(&pin) {
            Some(other) if !(shared && other.shared) => Err(Refusal::new(
                self.file,
                key,
                format!("{pin} is taken by {}", other.key),
                "give each its own pin; only enable pins may be shared among motors",
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
                let there = listed(&TimerChannel::all_at(self.chip, pin));
                let mend = format!("{pin} has {there}; leave the key out to switch it without a timer");
                Err(Refusal::new(self.file, key, format!("{text} is not at {pin}"), mend))
            }
        }
    }
}

fn listed<T: ToString>(items: &[T]) -> String {
    if items.is_empty() {
        return "none".to_owned();
    }
    items.iter().map(T::to_string).collect::<Vec<_>>().join(", ")
}
