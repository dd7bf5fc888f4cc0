//! The keys of a board, each read by one line, and the checks that need more than one of them.

use ferrostep_checked_toml::{Range, Section, range};
use ferrostep_hal_shim::FanOutput;

use crate::board::{
    Accelerometer, AccelerometerChip, BBF_HEADER_BYTES, BBF_SUFFIX, Board, CardSlot, Driver, DriverUart, Eeprom,
    EepromChip, Fan, Heater, Motor, SECTORS, Thermistor, blows_when_safe,
};
use crate::chip::Chip;
use crate::clock::{CRYSTALS_MHZ, Clock, INTERNAL_HZ};
use crate::pin::Pin;
use crate::pins::{Pins, Use};
use crate::signals::{
    SDIO_PINS, TIMERS_IN_USE, USART1_RX, USART1_TX, USART2_TX, USB_PINS, analogue_channels, timer_channels,
};

const CRYSTAL: Range = range(4.0, 26.0, "MHz");
// Smallest memories that the firmware can be linked for, and the largest of a chip.
const FLASH: Range = range(256.0, 1024.0, "KiB");
const RAM: Range = range(96.0, 128.0, "KiB");
const CCM: Range = range(0.0, 64.0, "KiB");
const BOOT_OFFSET: Range = range(0.0, 524_288.0, "bytes");
const UART_ADDRESS: Range = range(0.0, 3.0, "");
/// 1010 and the levels of its pins A2, A1 and A0 (data sheet of the AT24C32E, device addressing).
const EEPROM_ADDRESS: Range = range(80.0, 87.0, "(0x50 to 0x57)");
const SENSE_RESISTOR: Range = range(0.01, 1.0, "ohm");
const PULL_UP: Range = range(100.0, 100_000.0, "ohm");

/// Longest name, bytes.
const MAX_NAME: usize = 32;
/// Longest title, bytes.
const MAX_TITLE: usize = 60;

/// Maximum number of ports that step and direction signals may be on: an event costs the step
/// interrupt a store for each.
const MAX_MOTOR_PORTS: usize = 3;

/// The board.
pub(crate) fn board(keys: &Section<'_>) -> Board {
    let board_name = name(keys, "name").required("what commands and errors call the board");
    let title = title(keys);
    let chip = chip(keys);
    let memory = |key, range: Range, kib: u32| {
        keys.whole(key, range.at_most(kib.into(), "at most what the chip has")).required("") as u32
    };
    let flash_kib = memory("flash_kib", FLASH, chip.flash_kib);
    let ram_kib = memory("ram_kib", RAM, chip.ram_kib);
    let ccm_kib = memory("ccm_kib", CCM, chip.ccm_kib);
    let (crystal_hz, clock) = clock(keys, chip);
    let internal_clock = Clock::of(INTERNAL_HZ, chip);
    if internal_clock.is_none() {
        keys.refuse("chip", "a chip whose internal oscillator has a clock");
    }
    let boot_file = boot_file(keys);
    let boot_offset = boot_offset(keys, boot_file.as_deref(), chip, flash_kib);
    let profile = name(keys, "profile").required("profile of an image that is built without `--profile`");
    let mut pins = Pins::new(keys.reader(), chip);
    let uart = keys.optional_section("driver_uart", "no shared line", "the line that the drivers share");
    let motors = keys.section(
        "motors",
        "x (A), y (B), z and e move, on at most three ports; of the others those that lift a profile's Z \
         ([how](z-motors.md#sockets-and-ports)) or push T1's filament, the rest is kept switched off",
    );
    let has_uart = uart.is_some();
    let moving = ["x", "y", "z", "e"].map(|name| motor(&motors.section(name, ""), name, has_uart, &mut pins));
    let spare_motors = some(&motors, ["z2", "e1", "e2", "e3"], |name, table| motor(table, name, has_uart, &mut pins));
    let driver_uart = uart.map(|table| one_of(&table, "pin", USART2_TX, &mut pins));
    let thermistor_tables = keys.section_of_defaults("thermistors", "to ground; all at one converter, ADC1 or ADC3");
    let names = ["nozzle", "bed", "nozzle1", "nozzle2", "nozzle3", "probe", "board"];
    let thermistors = some(&thermistor_tables, names, |name, table| thermistor(table, name, &mut pins));
    let heater_tables = keys.section_of_defaults("heaters", "high = on");
    let names = ["nozzle", "bed", "nozzle1", "nozzle2", "nozzle3"];
    let heaters = some(&heater_tables, names, |name, table| heater(table, name, &thermistors, &mut pins));
    let fan_tables = keys.section_of_defaults("fans", "high = on; not on a timer that switches a heater");
    let fans = some(&fan_tables, FanOutput::ALL.map(FanOutput::name), |name, table| fan(table, name, &mut pins));
    let input_keys = keys.section_of_defaults("inputs", "end stops of x, y and z, and other sensors");
    let inputs = ["x", "y", "z", "probe", "filament", "filament2", "power_loss", "button"]
        .into_iter()
        .filter_map(|name| Some((name, pins.take_some(&input_keys, name, Use::Input, "no such sensor", "")?)))
        .collect();
    let serial = serial(keys, &mut pins);
    let usb = keys.optional_section("usb", "no plug", "full speed").map(|table| {
        let [minus, plus] = USB_PINS;
        [one_of(&table, "dm", [minus], &mut pins), one_of(&table, "dp", [plus], &mut pins)]
    });
    let card = keys
        .optional_section("card", "no slot", "a slot for a memory card, at the SDIO")
        .map(|table| card(&table, &mut pins));
    let accelerometer = keys
        .optional_section(
            "accelerometer",
            "M955 and M956 are refused",
            "a plug for one, on four wires (SPI), which the firmware moves itself: [any pins](calibration.md#on-a-board). Its x, y and z \
             are the machine's",
        )
        .map(|table| accelerometer(&table, &mut pins));
    let eeprom = keys
        .optional_section(
            "eeprom",
            "settings are kept in the flash of a chip of 1 MiB, or not at all",
            "the board's memory for [settings](settings.md#the-memory), on two wires (I2C), which the firmware moves itself: any pins",
        )
        .map(|table| eeprom(&table, &mut pins));
    let power_supply = keys
        .optional_section("power_supply", "not switched", "[M80 and M81](gcode.md#a-supply-that-is-switched) switch it")
        .map(|table| pins.take(&table, "pin", Use::Any, "output; the profile says which level is on"));
    let servo = keys
        .optional_section(
            "servo",
            "no such output",
            "for a [probe with a pin](homing.md#a-probe-with-a-pin) (BLTouch), whose signal is the input `probe`",
        )
        .map(|table| pins.take(&table, "pin", Use::Any, "output; the pulses of TIM6's interrupt"));
    let board = Board {
        name: board_name,
        title,
        chip,
        crystal_hz,
        clock: clock.unwrap_or_default(),
        internal_clock: internal_clock.unwrap_or_default(),
        flash_kib,
        ram_kib,
        ccm_kib,
        boot_offset,
        boot_file,
        profile,
        motors: moving,
        spare_motors,
        driver_uart,
        heaters,
        safe_outputs: fans.iter().filter_map(blows_when_safe).collect(),
        fans,
        thermistors,
        inputs,
        serial,
        usb,
        card,
        accelerometer,
        eeprom,
        power_supply,
        used_supply: None,
        used_chamber: None,
        servo,
        used_servo: None,
        further_z: Vec::new(),
        further_e: Vec::new(),
        used_nozzle: None,
        notes: pins.into_notes(),
    };
    as_a_whole(&board, keys);
    board
}

/// The slot for a memory card.
fn card(table: &Section<'_>, pins: &mut Pins<'_>) -> CardSlot {
    let [clock, command, d0, d1, d2, d3] = SDIO_PINS;
    let lines = [
        one_of(table, "clock", [clock], pins),
        one_of(table, "command", [command], pins),
        one_of(table, "d0", [d0], pins),
        one_of(table, "d1", [d1], pins),
        one_of(table, "d2", [d2], pins),
        one_of(table, "d3", [d3], pins),
    ];
    let about = "low while a card is in the slot";
    let detect = pins.take_some(table, "detect", Use::Any, "a card is looked for by asking it", about);
    CardSlot { lines, detect }
}

/// The plug for an accelerometer.
fn accelerometer(table: &Section<'_>, pins: &mut Pins<'_>) -> Accelerometer {
    Accelerometer {
        chip: table.word("chip", AccelerometerChip::ALL).required("its type"),
        sck: pins.take(table, "sck", Use::Any, "output; the clock (SCL)"),
        miso: pins.take(table, "miso", Use::Any, "input; the chip's data (SDO)"),
        mosi: pins.take(table, "mosi", Use::Any, "output; data for the chip (SDA)"),
        cs: pins.take(table, "cs", Use::Any, "output; low while the chip is asked"),
    }
}

/// The EEPROM.
fn eeprom(table: &Section<'_>, pins: &mut Pins<'_>) -> Eeprom {
    Eeprom {
        chip: table.word("chip", EepromChip::ALL).required("its type: 4 KiB in pages of 32 bytes"),
        scl: pins.take(table, "scl", Use::Any, "output, open drain; the clock"),
        sda: pins.take(table, "sda", Use::Any, "output and input, open drain; data"),
        address: table.whole("address", EEPROM_ADDRESS).required("on the bus; its pins A0 to A2 are the lowest bits")
            as u8,
    }
}

/// The checks that need more than one part of the board.
fn as_a_whole(board: &Board, keys: &Section<'_>) {
    let ports = board.motor_ports().len();
    if ports > MAX_MOTOR_PORTS {
        let expected =
            format!("step and direction of X, Y, Z and E on at most {MAX_MOTOR_PORTS} ports, not on {ports}");
        keys.refuse("motors.e.direction", expected);
    }
    // One converter goes round all thermistors.
    let first = board.thermistors.first().map(|thermistor| thermistor.channel.converter);
    for thermistor in &board.thermistors {
        let converter = thermistor.channel.converter;
        if Some(converter) != first || converter == 2 {
            let expected =
                "a channel of ADC1, or of ADC3, and of the same for all thermistors: one converter goes round them";
            keys.refuse(&format!("thermistors.{}.adc", thermistor.name), expected);
        }
    }
    // A timer has one frequency.
    let timer_of = |channel: &Option<String>| channel.as_deref()?.split('_').next().map(str::to_owned);
    let of_heaters: Vec<String> = board.heaters.iter().filter_map(|heater| timer_of(&heater.timer)).collect();
    for fan in &board.fans {
        if let Some(timer) = timer_of(&fan.timer).filter(|timer| of_heaters.contains(timer)) {
            let expected =
                format!("another timer than {timer}, which switches a heater at another frequency; or no timer");
            keys.refuse(&format!("fans.{}.timer", fan.name), expected);
        }
    }
}

/// The tables that the file has.
fn some<'r, T, const N: usize>(
    tables: &Section<'r>,
    names: [&'static str; N],
    mut read: impl FnMut(&'static str, &Section<'r>) -> T,
) -> Vec<T> {
    let read = |name| Some(read(name, &tables.optional_section(name, "not there", "")?));
    names.into_iter().filter_map(read).collect()
}

/// A name that can be a folder's.
fn name<'r>(keys: &Section<'r>, key: &'static str) -> ferrostep_checked_toml::Field<'r, String> {
    let is_good = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-' || byte == b'.';
    let expected = format!("1 to {MAX_NAME} lower-case letters, digits, \"-\" and \".\", a letter first");
    keys.text(key, &expected, |name| {
        let is_short = name.starts_with(|first: char| first.is_ascii_lowercase()) && name.len() <= MAX_NAME;
        is_short && name.bytes().all(is_good)
    })
}

/// A title that fits a line of a report.
fn title(keys: &Section<'_>) -> String {
    let expected = format!("1 to {MAX_TITLE} printable ASCII characters, not all blank");
    let is_right = |title: &str| {
        let is_printable = title.bytes().all(|byte| byte == b' ' || byte.is_ascii_graphic());
        is_printable && !title.trim().is_empty() && title.len() <= MAX_TITLE
    };
    keys.text("title", &expected, is_right).required("what a person calls the board")
}

/// The name of a file on a card.
fn boot_file(keys: &Section<'_>) -> Option<String> {
    let is_good = |byte: u8| byte.is_ascii_alphanumeric() || b"-_.".contains(&byte);
    let is_right = |name: &str| {
        let has_suffix = name.ends_with(".bin") || name.ends_with(BBF_SUFFIX);
        name.len() <= MAX_NAME && name.bytes().all(is_good) && has_suffix && !name.starts_with('.')
    };
    keys.text("boot_file", "a file's name that ends with \".bin\" or \".bbf\"", is_right).optional(
        "no file",
        "the file that the boot loader takes: plain bytes (`.bin`) or Prusa's container (`.bbf`), unsigned",
    )
}

fn chip(keys: &Section<'_>) -> Chip {
    let chip = keys.word("chip", Chip::ALL.map(|chip| (chip.name, chip))).required("");
    let package = keys.text("package", "a package's name, such as \"LQFP64\"", |_| true).required("the chip's");
    if package != chip.package {
        keys.refuse("package", format!("\"{}\", the package of the {}", chip.package, chip.name));
    }
    chip
}

/// The crystal's frequency, Hz, and the clock from it.
fn clock(keys: &Section<'_>, chip: Chip) -> (u32, Option<Clock>) {
    let about = "8, 12, 16 or 25: from these the PLL makes exactly 84 MHz for the motion clock and 48 MHz for USB, with the same \
                 numbers in the firmware and in its library";
    let crystal_hz = (keys.number("crystal_mhz", CRYSTAL).required(about) * 1e6).round() as u32;
    let may_be_used = CRYSTALS_MHZ.map(|mhz| mhz * 1_000_000).contains(&crystal_hz);
    let clock = may_be_used.then(|| Clock::of(crystal_hz, chip)).flatten();
    if clock.is_none() {
        let expected = "8, 12, 16 or 25 MHz, for which the firmware's clock and stm32f4xx-hal agree; to use another crystal, \
                        add its frequency to CRYSTALS_MHZ in config/boards/src/clock.rs and run `cargo test -p ferrostep-boards`";
        keys.refuse("crystal_mhz", expected);
    }
    (crystal_hz, clock)
}

/// Reads the start of the image: a flash sector's, so that erasing it leaves the boot loader alone;
/// where the boot loader takes a container, the image begins after the header in that sector.
fn boot_offset(keys: &Section<'_>, boot_file: Option<&str>, chip: Chip, flash_kib: u32) -> u32 {
    // Half of the flash is left at least: an image is at most a quarter of the largest.
    let half = f64::from(flash_kib) * 512.0;
    let offset = keys.whole("boot_offset", BOOT_OFFSET.at_most(half, "at most half of the flash")).required(
        "where the image begins, from the start of flash: after the boot loader, at a flash sector, or 512 bytes after one for a \
         `.bbf`",
    ) as u32;
    if boot_file.is_some_and(|name| name.ends_with(BBF_SUFFIX)) {
        let sector = offset.checked_sub(BBF_HEADER_BYTES).filter(|sector| *sector > 0);
        if !sector.is_some_and(|sector| chip.is_sector_boundary(sector)) {
            let expected = format!(
                "{BBF_HEADER_BYTES} bytes after {SECTORS} of the {}, but not in the first: the boot loader lies there, and \
                 the header of a {BBF_SUFFIX} before the image",
                chip.name
            );
            keys.refuse("boot_offset", expected);
        }
    } else if !chip.is_sector_boundary(offset) {
        keys.refuse("boot_offset", format!("{SECTORS} of the {}", chip.name));
    }
    offset
}

fn motor(table: &Section<'_>, name: &'static str, has_uart: bool, pins: &mut Pins<'_>) -> Motor {
    let driver = table.word("driver", Driver::ALL).required("`socket`: whatever is plugged in");
    let uart = pins.take_some(table, "uart", Use::Any, "no such line", "the driver's own single-wire line");
    let address = table
        .whole("uart_address", UART_ADDRESS)
        .optional("no address", "the driver's address on the shared line `[driver_uart]`: instead of `uart`");
    let uart = match (uart, address) {
        (None, None) => None,
        (Some(pin), None) => Some(DriverUart::Pin(pin)),
        (Some(pin), Some(_)) => {
            table.refuse("uart", "either uart, a separate line, or uart_address on the shared one");
            Some(DriverUart::Pin(pin))
        }
        (None, Some(address)) => {
            if driver != Driver::Tmc2209 || !has_uart {
                table.refuse("uart_address", "a tmc2209, which has addresses, and the table [driver_uart]");
            }
            Some(DriverUart::Address(address as u8))
        }
    };
    Motor {
        name,
        step: pins.take(table, "step", Use::Any, "output; a step is its rising edge"),
        direction: pins.take(table, "direction", Use::Any, "output; high = backwards"),
        enable: pins.take(table, "enable", Use::Enable, "output; low = on; motors may share it"),
        diag: pins.take_some(table, "diag", Use::Input, "no stall signal", "input; the driver's stall signal"),
        driver,
        uart,
        sense_resistor_ohm: table
            .number("sense_resistor_ohm", SENSE_RESISTOR)
            .optional("0.11, the usual modules'", "at which the driver measures its current"),
    }
}

/// A timer channel at a pin, if one is named.
fn timer(table: &Section<'_>, pin: Pin) -> Option<String> {
    let name = table
        .text("timer", "a timer's channel, such as \"TIM3_CH4\"", |_| true)
        .optional("no timer", "the channel at the pin that can switch it; TIM2, TIM5 and TIM9 make the steps")?;
    if let Some((timer, use_)) = TIMERS_IN_USE.into_iter().find(|(timer, _)| name.starts_with(&format!("{timer}_"))) {
        table.refuse("timer", format!("another timer than {timer}, which {use_}"));
        return Some(name);
    }
    let channels = timer_channels(pin);
    if !channels.contains(&name.as_str()) {
        let expected = match channels.join(" or ") {
            empty if empty.is_empty() => format!("no timer: {pin} has no channel that is free"),
            channels => format!("{channels}, what {pin} has"),
        };
        table.refuse("timer", expected);
    }
    Some(name)
}

fn heater(table: &Section<'_>, name: &'static str, thermistors: &[Thermistor], pins: &mut Pins<'_>) -> Heater {
    let sensor = table
        .text("sensor", "the name of a thermistor of this board", |_| true)
        .required("name of the thermistor that watches it");
    if !thermistors.iter().any(|thermistor| thermistor.name == sensor) {
        let expected =
            format!("the name of a thermistor of this board: a heater without one is not safe ([thermistors.{name}])");
        table.refuse("sensor", expected);
    }
    let pin = pins.take(table, "pin", Use::Any, "");
    Heater { name, pin, timer: timer(table, pin), sensor }
}

fn fan(table: &Section<'_>, name: &'static str, pins: &mut Pins<'_>) -> Fan {
    let pin = pins.take(table, "pin", Use::Any, "");
    let timer = timer(table, pin);
    Fan { name, pin, timer, tacho: pins.take_some(table, "tacho", Use::Input, "no tacho", "input; two pulses a turn") }
}

fn thermistor(table: &Section<'_>, thermistor: &'static str, pins: &mut Pins<'_>) -> Thermistor {
    let pin = pins.take(table, "pin", Use::Any, "");
    let channels = analogue_channels(pin);
    let adc = table
        .text("adc", "a converter's channel, such as \"ADC1_IN10\"", |_| true)
        .required("converter and channel at the pin");
    let channel = channels.iter().find(|channel| channel.to_string() == adc).copied();
    if channel.is_none() {
        let expected = match channels.iter().map(ToString::to_string).collect::<Vec<_>>().join(" or ") {
            empty if empty.is_empty() => format!("a thermistor at an analogue pin, which {pin} is not"),
            channels => format!("{channels}, what {pin} has"),
        };
        table.refuse("adc", expected);
    }
    Thermistor {
        name: thermistor,
        pin,
        channel: channel.unwrap_or_default(),
        kind: name(table, "kind").optional("whatever the profile says", "the thermistor, if the board decides that"),
        pull_up_ohm: table.number("pull_up_ohm", PULL_UP).required("resistor to the converter's reference"),
    }
}

fn serial(keys: &Section<'_>, pins: &mut Pins<'_>) -> [Pin; 2] {
    let table = keys.section("serial", "the host's line");
    let port = table.text("port", "`\"USART1\"`", |_| true).required("");
    if port != "USART1" {
        table.refuse("port", "\"USART1\", the only port that the firmware has code for");
    }
    [one_of(&table, "tx", USART1_TX, pins), one_of(&table, "rx", USART1_RX, pins)]
}

/// A pin that is one of these.
fn one_of<const N: usize>(
    table: &Section<'_>,
    key: &'static str,
    names: [&'static str; N],
    pins: &mut Pins<'_>,
) -> Pin {
    let name = table.word(key, names.map(|name| (name, name))).required("");
    pins.take_named(&table.path(key), name, Use::Any)
}
