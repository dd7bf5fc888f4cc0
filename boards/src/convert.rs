//! From the text to the board: ranges, pins that exist and are used once, channels that the pins have.

use std::collections::BTreeMap;

use ferrostep_checked_toml::{Checker, FileError, Range, range};
use toml::Spanned;

use crate::board::{BBF_HEADER_BYTES, BBF_SUFFIX, Board, Driver, DriverUart, Fan, Heater, Motor, SECTORS, Thermistor};
use crate::chip::Chip;
use crate::clock::{CRYSTAL_HZ, Clock, INTERNAL_HZ};
use crate::file::{BoardFile, FanTable, HeaterTable, MotorTable, Number, ThermistorTable, Word};
use crate::pin::Pin;
use crate::signals::{
    DEBUG_PINS, TIMERS_IN_USE, USART1_RX, USART1_TX, USART2_TX, USB_PINS, analogue_channels, timer_channels,
};

const CRYSTAL: Range = range(4.0, 26.0, "MHz");
const UART_ADDRESS: Range = range(0.0, 3.0, "");
const SENSE_RESISTOR: Range = range(0.01, 1.0, "ohm");
const PULL_UP: Range = range(100.0, 100_000.0, "ohm");

/// Smallest memories that the firmware can be linked for, KiB.
const LEAST_FLASH_KIB: f64 = 256.0;
const LEAST_RAM_KIB: f64 = 96.0;

/// Longest name, bytes.
const MAX_NAME: usize = 32;
/// Longest title, bytes.
const MAX_TITLE: usize = 60;

/// Most ports that step and direction signals may be on: an event costs the step interrupt a store for each.
const MOST_MOTOR_PORTS: usize = 3;

/// What a pin is used as.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Use {
    /// As anything but what follows.
    Any,
    /// A motor's enable signal: motors may share it.
    Enable,
    /// An input that interrupts: of each number only one port's pin can.
    Input,
}

/// The pins used so far.
struct Pins<'a> {
    chip: Chip,
    check: &'a Checker<'a>,
    used: BTreeMap<Pin, (Use, String, usize)>,
    notes: Vec<String>,
}

impl Pins<'_> {
    /// The pin of this name, for a use of its own.
    fn take(&mut self, key: &str, word: &Word, usage: Use) -> Result<Pin, FileError> {
        let shown = quoted(word);
        let Some(pin) = Pin::named(word.get_ref()) else {
            return Err(self.check.refuse(key, &shown, "a pin's name, such as \"PA0\""));
        };
        if !self.chip.has(pin) {
            let Chip { name, package, .. } = self.chip;
            let expected = format!("a pin of the {name} in {package} that is not the crystal's");
            return Err(self.check.refuse(key, &shown, expected));
        }
        if let Some((before, other, line)) = self.used.get(&pin)
            && (usage, *before) != (Use::Enable, Use::Enable)
        {
            let expected = format!("a pin that nothing else uses: it is {other} already (line {line})");
            return Err(self.check.refuse(key, &shown, expected));
        }
        if usage == Use::Input {
            let same_line = self.used.iter().find(|(used, (of, ..))| *of == Use::Input && used.number == pin.number);
            if let Some((_, (_, other, line))) = same_line {
                let expected = format!(
                    "an input of another number: {other} (line {line}) has the interrupt line {} already",
                    pin.number
                );
                return Err(self.check.refuse(key, &shown, expected));
            }
        }
        if let Some((_, debug)) = DEBUG_PINS.into_iter().find(|(name, _)| *name == word.get_ref()) {
            self.notes.push(format!("{key} = {pin} is the debug probe's {debug}: while it is used, no probe is heard"));
        }
        self.used.entry(pin).or_insert_with(|| (usage, key.to_owned(), self.check.line_of(word)));
        Ok(pin)
    }

    /// An optional pin.
    fn take_some(&mut self, key: &str, word: &Option<Word>, usage: Use) -> Result<Option<Pin>, FileError> {
        word.as_ref().map(|word| self.take(key, word, usage)).transpose()
    }
}

/// Keys of a table with their values, which may be left out.
macro_rules! tables {
    ($table:expr; $($key:ident)+) => {
        [$((stringify!($key), &$table.$key)),+]
    };
}

/// Checks every value of a board.
pub fn board(file: &BoardFile, check: &Checker<'_>) -> Result<Board, FileError> {
    let name = name("name", &file.name, check)?;
    let title = title(&file.title, check)?;
    let chip = chip(file, check)?;
    let flash_kib = whole("flash_kib", &file.flash_kib, range(LEAST_FLASH_KIB, chip.flash_kib.into(), "KiB"), check)?;
    let ram_kib = whole("ram_kib", &file.ram_kib, range(LEAST_RAM_KIB, chip.ram_kib.into(), "KiB"), check)?;
    let ccm_kib = whole("ccm_kib", &file.ccm_kib, range(0.0, chip.ccm_kib.into(), "KiB"), check)?;
    let (crystal_hz, clock) = clock(file, chip, check)?;
    let Some(internal_clock) = Clock::of(INTERNAL_HZ, chip) else {
        return Err(check.refuse("chip", &quoted(&file.chip), "a chip whose internal oscillator has a clock"));
    };
    let boot_file = file.boot_file.as_ref().map(|word| boot_file(word, check)).transpose()?;
    let boot_offset = boot_offset(file, boot_file.as_deref(), chip, flash_kib, check)?;
    let profile = self::name("profile", &file.profile, check)?;

    let mut pins = Pins { chip, check, used: BTreeMap::new(), notes: Vec::new() };
    let tables = &file.motors;
    let mut moving = |name, table| motor(name, table, file, &mut pins);
    let motors = [moving("x", &tables.x)?, moving("y", &tables.y)?, moving("z", &tables.z)?, moving("e", &tables.e)?];
    let spare_motors = some(tables!(file.motors; z2 e1 e2 e3), moving)?;
    let driver_uart = match &file.driver_uart {
        Some(table) => Some(one_of("driver_uart.pin", &table.pin, &USART2_TX, &mut pins)?),
        None => None,
    };
    let tables = tables!(file.thermistors; nozzle bed nozzle1 nozzle2 nozzle3 probe board);
    let thermistors = some(tables, |name, table| thermistor(name, table, &mut pins))?;
    let tables = tables!(file.heaters; nozzle bed nozzle1 nozzle2 nozzle3);
    let heaters = some(tables, |name, table| heater(name, table, &thermistors, &mut pins))?;
    let tables = tables!(file.fans; part hotend fan2 fan3 fan4 fan5);
    let fans = some(tables, |name, table| fan(name, table, &mut pins))?;
    let words = tables!(file.inputs; x y z probe filament);
    let inputs = some(words, |name, word| Ok((name, pins.take(&format!("inputs.{name}"), word, Use::Input)?)))?;
    let serial = serial(file, &mut pins)?;
    let usb = match &file.usb {
        Some(table) => Some([
            one_of("usb.dm", &table.dm, &USB_PINS[..1], &mut pins)?,
            one_of("usb.dp", &table.dp, &USB_PINS[1..], &mut pins)?,
        ]),
        None => None,
    };
    let notes = pins.notes;
    let board = Board {
        name,
        title,
        chip,
        crystal_hz,
        clock,
        internal_clock,
        flash_kib,
        ram_kib,
        ccm_kib,
        boot_offset,
        boot_file,
        profile,
        virtual_sensors: file.virtual_sensors,
        motors,
        spare_motors,
        driver_uart,
        heaters,
        fans,
        thermistors,
        inputs,
        serial,
        usb,
        notes,
    };
    as_a_whole(&board, file, check)?;
    Ok(board)
}

/// What concerns more than one part of the board.
fn as_a_whole(board: &Board, file: &BoardFile, check: &Checker<'_>) -> Result<(), FileError> {
    let ports = board.motor_ports().len();
    if ports > MOST_MOTOR_PORTS {
        let expected =
            format!("step and direction of X, Y, Z and E on at most {MOST_MOTOR_PORTS} ports, not on {ports}");
        return Err(check.refuse("motors.e.direction", &quoted(&file.motors.e.direction), expected));
    }
    thermal_parts(board, file, check)?;
    let is_real = board.heaters.len() + board.thermistors.len() + board.inputs.len() > 0;
    if board.virtual_sensors && is_real {
        let shown = quoted(&file.name);
        let expected = "no heaters, thermistors and inputs on a board with virtual_sensors = true";
        return Err(check.refuse("name", &shown, expected));
    }
    Ok(())
}

/// One converter goes round all thermistors, and a timer has one frequency.
fn thermal_parts(board: &Board, file: &BoardFile, check: &Checker<'_>) -> Result<(), FileError> {
    let tables = &file.thermistors;
    let words =
        [&tables.nozzle, &tables.bed, &tables.nozzle1, &tables.nozzle2, &tables.nozzle3, &tables.probe, &tables.board];
    let words = words.into_iter().flatten().map(|table| &table.adc);
    let first = board.thermistors.first().map(|thermistor| thermistor.channel.converter);
    for (thermistor, word) in board.thermistors.iter().zip(words) {
        let converter = thermistor.channel.converter;
        if Some(converter) != first || converter == 2 {
            let expected =
                "a channel of ADC1, or of ADC3, and of the same for all thermistors: one converter goes round them";
            return Err(check.refuse(&format!("thermistors.{}.adc", thermistor.name), &quoted(word), expected));
        }
    }
    let timer_of =
        |channel: &Option<String>| channel.as_deref().and_then(|name| name.split('_').next()).map(str::to_owned);
    let of_heaters: Vec<String> = board.heaters.iter().filter_map(|heater| timer_of(&heater.timer)).collect();
    let tables = &file.fans;
    let words = [&tables.part, &tables.hotend, &tables.fan2, &tables.fan3, &tables.fan4, &tables.fan5];
    let words = words.into_iter().flatten().map(|table| &table.timer);
    for (fan, word) in board.fans.iter().zip(words) {
        if let (Some(timer), Some(word)) = (timer_of(&fan.timer), word)
            && of_heaters.contains(&timer)
        {
            let expected = format!("another timer than {timer}, which switches a heater at another frequency; or none");
            return Err(check.refuse(&format!("fans.{}.timer", fan.name), &quoted(word), expected));
        }
    }
    Ok(())
}

/// Those tables that are there.
fn some<'a, T, R, const N: usize>(
    tables: [(&'static str, &'a Option<T>); N],
    mut convert: impl FnMut(&'static str, &'a T) -> Result<R, FileError>,
) -> Result<Vec<R>, FileError> {
    tables.into_iter().filter_map(|(name, table)| Some(convert(name, table.as_ref()?))).collect()
}

/// The word as errors show it, where it stands.
fn quoted(word: &Word) -> Spanned<String> {
    Spanned::new(word.span(), format!("{:?}", word.get_ref()))
}

/// A number without a fraction.
fn whole(key: &str, value: &Number, range: Range, check: &Checker<'_>) -> Result<u32, FileError> {
    let number = check.number(key, value, range)?;
    if number.fract() != 0.0 {
        return Err(check.refuse(key, value, format!("{range}, without a fraction")));
    }
    Ok(number as u32)
}

/// A name that can be a folder's.
fn name(key: &str, word: &Word, check: &Checker<'_>) -> Result<String, FileError> {
    let name = word.get_ref();
    let is_good = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-' || byte == b'.';
    if name.starts_with(|first: char| first.is_ascii_lowercase()) && name.len() <= MAX_NAME && name.bytes().all(is_good)
    {
        return Ok(name.clone());
    }
    let expected = format!("1 to {MAX_NAME} lower-case letters, digits, \"-\" and \".\", a letter first");
    Err(check.refuse(key, &quoted(word), expected))
}

/// A title that fits a line of a report.
fn title(word: &Word, check: &Checker<'_>) -> Result<String, FileError> {
    let title = word.get_ref();
    let is_printable = title.bytes().all(|byte| byte == b' ' || byte.is_ascii_graphic());
    if is_printable && !title.trim().is_empty() && title.len() <= MAX_TITLE {
        return Ok(title.clone());
    }
    let expected = format!("1 to {MAX_TITLE} printable ASCII characters, not all blank");
    Err(check.refuse("title", &quoted(word), expected))
}

/// The name of a file on a card.
fn boot_file(word: &Word, check: &Checker<'_>) -> Result<String, FileError> {
    let name = word.get_ref();
    let is_good = |byte: u8| byte.is_ascii_alphanumeric() || b"-_.".contains(&byte);
    let has_suffix = name.ends_with(".bin") || name.ends_with(BBF_SUFFIX);
    if name.len() <= MAX_NAME && name.bytes().all(is_good) && has_suffix && !name.starts_with('.') {
        return Ok(name.clone());
    }
    Err(check.refuse("boot_file", &quoted(word), "a file's name that ends with \".bin\" or \".bbf\""))
}

fn chip(file: &BoardFile, check: &Checker<'_>) -> Result<Chip, FileError> {
    let Some(chip) = Chip::named(file.chip.get_ref()) else {
        let expected = Chip::names().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(" or ");
        return Err(check.refuse("chip", &quoted(&file.chip), expected));
    };
    if file.package.get_ref() != chip.package {
        let expected = format!("\"{}\", the package of the {}", chip.package, chip.name);
        return Err(check.refuse("package", &quoted(&file.package), expected));
    }
    Ok(chip)
}

/// The crystal and the clock from it.
fn clock(file: &BoardFile, chip: Chip, check: &Checker<'_>) -> Result<(u32, Clock), FileError> {
    let key = "crystal_mhz";
    let crystal_hz = (check.number(key, &file.crystal_mhz, CRYSTAL)? * 1e6).round() as u32;
    let clock = CRYSTAL_HZ.contains(&crystal_hz).then(|| Clock::of(crystal_hz, chip)).flatten();
    clock.map(|clock| (crystal_hz, clock)).ok_or_else(|| {
        let expected = "a crystal from which a PLL makes exactly 48 MHz for USB and 84 MHz for the motion clock, such as \
                        8, 12, 16 or 25 MHz";
        check.refuse(key, &file.crystal_mhz, expected)
    })
}

/// Where the image begins: at a flash sector, so that what erases it erases nothing of a boot loader's; after the header in
/// one where the boot loader takes a container.
fn boot_offset(
    file: &BoardFile,
    boot_file: Option<&str>,
    chip: Chip,
    flash_kib: u32,
    check: &Checker<'_>,
) -> Result<u32, FileError> {
    let value = &file.boot_offset;
    // Half of the flash is left at least: an image is at most a quarter of the largest.
    let offset =
        whole("boot_offset", value, range(0.0, f64::from(flash_kib) * 512.0, "bytes, half of the flash"), check)?;
    if boot_file.is_some_and(|name| name.ends_with(BBF_SUFFIX)) {
        let sector = offset.checked_sub(BBF_HEADER_BYTES).filter(|sector| *sector > 0);
        if sector.is_some_and(|sector| chip.is_sector_boundary(sector)) {
            return Ok(offset);
        }
        let expected = format!(
            "{BBF_HEADER_BYTES} bytes after {SECTORS} of the {}, but not in the first: the boot loader lies there, and the \
             header of a {BBF_SUFFIX} before the image",
            chip.name
        );
        return Err(check.refuse("boot_offset", value, expected));
    }
    if chip.is_sector_boundary(offset) {
        return Ok(offset);
    }
    Err(check.refuse("boot_offset", value, format!("{SECTORS} of the {}", chip.name)))
}

fn motor(name: &'static str, table: &MotorTable, file: &BoardFile, pins: &mut Pins<'_>) -> Result<Motor, FileError> {
    let key = |last: &str| format!("motors.{name}.{last}");
    let driver = *table.driver.get_ref();
    let uart = match (&table.uart, &table.uart_address) {
        (None, None) => None,
        (Some(word), None) => Some(DriverUart::Pin(pins.take(&key("uart"), word, Use::Any)?)),
        (Some(word), Some(_)) => {
            let expected = "either uart, a line of its own, or uart_address on the shared one";
            return Err(pins.check.refuse(&key("uart"), &quoted(word), expected));
        }
        (None, Some(address)) => {
            let number = whole(&key("uart_address"), address, UART_ADDRESS, pins.check)?;
            if driver != Driver::Tmc2209 || file.driver_uart.is_none() {
                let expected = "a tmc2209, which has addresses, and the table [driver_uart]";
                return Err(pins.check.refuse(&key("uart_address"), address, expected));
            }
            Some(DriverUart::Address(number as u8))
        }
    };
    let sense_resistor_ohm = match &table.sense_resistor_ohm {
        Some(ohm) => Some(pins.check.number(&key("sense_resistor_ohm"), ohm, SENSE_RESISTOR)?),
        None => None,
    };
    Ok(Motor {
        name,
        step: pins.take(&key("step"), &table.step, Use::Any)?,
        direction: pins.take(&key("direction"), &table.direction, Use::Any)?,
        enable: pins.take(&key("enable"), &table.enable, Use::Enable)?,
        diag: pins.take_some(&key("diag"), &table.diag, Use::Input)?,
        driver,
        uart,
        sense_resistor_ohm,
    })
}

/// A timer channel at a pin, if one is named.
fn timer(key: &str, word: &Option<Word>, pin: Pin, check: &Checker<'_>) -> Result<Option<String>, FileError> {
    let Some(word) = word else { return Ok(None) };
    let name = word.get_ref();
    if let Some((timer, use_)) = TIMERS_IN_USE.into_iter().find(|(timer, _)| name.starts_with(&format!("{timer}_"))) {
        return Err(check.refuse(key, &quoted(word), format!("another timer than {timer}, which {use_}")));
    }
    let channels = timer_channels(pin);
    if channels.contains(&name.as_str()) {
        return Ok(Some(name.clone()));
    }
    let expected = match channels.join(" or ") {
        none if none.is_empty() => format!("no timer: {pin} has no channel that is free"),
        some => format!("{some}, what {pin} has"),
    };
    Err(check.refuse(key, &quoted(word), expected))
}

fn heater(
    name: &'static str,
    table: &HeaterTable,
    thermistors: &[Thermistor],
    pins: &mut Pins<'_>,
) -> Result<Heater, FileError> {
    let sensor = table.sensor.get_ref();
    if !thermistors.iter().any(|thermistor| thermistor.name == sensor) {
        let expected =
            format!("the name of a thermistor of this board: a heater without one is not safe ([thermistors.{name}])");
        return Err(pins.check.refuse(&format!("heaters.{name}.sensor"), &quoted(&table.sensor), expected));
    }
    let pin = pins.take(&format!("heaters.{name}.pin"), &table.pin, Use::Any)?;
    let timer = timer(&format!("heaters.{name}.timer"), &table.timer, pin, pins.check)?;
    Ok(Heater { name, pin, timer, sensor: sensor.clone() })
}

fn fan(name: &'static str, table: &FanTable, pins: &mut Pins<'_>) -> Result<Fan, FileError> {
    let pin = pins.take(&format!("fans.{name}.pin"), &table.pin, Use::Any)?;
    let timer = timer(&format!("fans.{name}.timer"), &table.timer, pin, pins.check)?;
    let tacho = pins.take_some(&format!("fans.{name}.tacho"), &table.tacho, Use::Input)?;
    Ok(Fan { name, pin, timer, tacho })
}

fn thermistor(thermistor: &'static str, table: &ThermistorTable, pins: &mut Pins<'_>) -> Result<Thermistor, FileError> {
    let key = |last: &str| format!("thermistors.{thermistor}.{last}");
    let pin = pins.take(&key("pin"), &table.pin, Use::Any)?;
    let channels = analogue_channels(pin);
    let Some(channel) = channels.iter().find(|channel| channel.to_string() == *table.adc.get_ref()) else {
        let expected = match channels.iter().map(ToString::to_string).collect::<Vec<_>>().join(" or ") {
            none if none.is_empty() => format!("a thermistor at an analogue pin, which {pin} is not"),
            some => format!("{some}, what {pin} has"),
        };
        return Err(pins.check.refuse(&key("adc"), &quoted(&table.adc), expected));
    };
    let kind = table.kind.as_ref().map(|word| name(&key("kind"), word, pins.check)).transpose()?;
    let pull_up_ohm = pins.check.number(&key("pull_up_ohm"), &table.pull_up_ohm, PULL_UP)?;
    Ok(Thermistor { name: thermistor, pin, channel: *channel, kind, pull_up_ohm })
}

fn serial(file: &BoardFile, pins: &mut Pins<'_>) -> Result<[Pin; 2], FileError> {
    let table = &file.serial;
    if table.port.get_ref() != "USART1" {
        let expected = "\"USART1\", the only port that the firmware has code for";
        return Err(pins.check.refuse("serial.port", &quoted(&table.port), expected));
    }
    Ok([one_of("serial.tx", &table.tx, &USART1_TX, pins)?, one_of("serial.rx", &table.rx, &USART1_RX, pins)?])
}

/// A pin that is one of these.
fn one_of(key: &str, word: &Word, names: &[&str], pins: &mut Pins<'_>) -> Result<Pin, FileError> {
    if names.contains(&word.get_ref().as_str()) {
        return pins.take(key, word, Use::Any);
    }
    let expected = names.iter().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(" or ");
    Err(pins.check.refuse(key, &quoted(word), expected))
}
