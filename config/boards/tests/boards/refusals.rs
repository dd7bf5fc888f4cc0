//! A fault of a board is refused with its line, its key and the expected value.

use ferrostep_boards::{builtin_names, builtin_text, parse};
use ferrostep_checked_toml::keys::{holder, paths};
use toml::{Table, Value};

/// The one-line error after a replacement in a board, which must occur once.
fn error_after(board: &str, from: &str, to: &str) -> String {
    let text = builtin_text(board).unwrap();
    assert_eq!(text.matches(from).count(), 1, "{from:?} must occur once in {board}");
    parse(&text.replace(from, to), "test.toml").expect_err(to).to_string()
}

const BUDDY: &str = "prusa-buddy";
const OCTOPUS: &str = "btt-octopus-1.1";

/// (board, text, its replacement, key and value to blame, what was expected; `{TEXT}`:
/// the line of a text)
const REFUSALS: [(&str, &str, &str, &str, &str); 62] = [
    ("bench", "name = \"bench\"", "name = \"Bench\"", "name = \"Bench\"", "lower-case letters"),
    ("bench", "name = \"bench\"", "name = \"../bench\"", "name = \"../bench\"", "lower-case letters"),
    ("bench", "title = \"Olimex STM32-H405, bare\"", "title = \"\"", "title = \"\"", "printable ASCII"),
    (
        "bench",
        "chip = \"STM32F405RG\"",
        "chip = \"STM32F999ZZ\"",
        "chip = \"STM32F999ZZ\"",
        "\"STM32F405RG\", \"STM32F407VG\" or \"STM32F446ZE\"",
    ),
    (
        "bench",
        "package = \"LQFP64\"",
        "package = \"LQFP100\"",
        "package = \"LQFP100\"",
        "\"LQFP64\", the package of the STM32F405RG",
    ),
    ("bench", "crystal_mhz = 8", "crystal_mhz = 3.9", "crystal_mhz = 3.9", "4 to 26 MHz"),
    ("bench", "crystal_mhz = 8", "crystal_mhz = 24.576", "crystal_mhz = 24.576", "8, 12, 16 or 25 MHz"),
    // Its PLL would do, but the HAL sets it with other numbers.
    ("bench", "crystal_mhz = 8", "crystal_mhz = 24", "crystal_mhz = 24", "add its frequency to CRYSTALS_MHZ"),
    ("bench", "flash_kib = 1024", "flash_kib = 2048", "flash_kib = 2048", "256 to 1024 KiB"),
    ("bench", "ram_kib = 128", "ram_kib = 192", "ram_kib = 192", "96 to 128 KiB"),
    ("bench", "ram_kib = 128", "ram_kib = 100.5", "ram_kib = 100.5", "a whole number from 96 to 128 KiB"),
    (OCTOPUS, "ccm_kib = 0", "ccm_kib = 64", "ccm_kib = 64", "0 to 0 KiB"),
    // A flash sector's middle; a multiple of a sector's size that begins none; half of the flash.
    (OCTOPUS, "boot_offset = 0x8000", "boot_offset = 0x8200", "boot_offset = 0x8200", "beginning of a flash sector"),
    (OCTOPUS, "boot_offset = 0x8000", "boot_offset = 0x14000", "boot_offset = 0x14000", "beginning of a flash sector"),
    (OCTOPUS, "boot_offset = 0x8000", "boot_offset = 0x60000", "boot_offset = 0x60000", "half of the flash"),
    (OCTOPUS, "boot_offset = 0x8000", "boot_offset = -1", "boot_offset = -1", "0 to 262144 bytes"),
    (BUDDY, "boot_offset = 0x20200", "boot_offset = 0x20000", "boot_offset = 0x20000", "512 bytes after the beginning"),
    (BUDDY, "boot_offset = 0x20200", "boot_offset = 0x20400", "boot_offset = 0x20400", "512 bytes after the beginning"),
    (BUDDY, "boot_offset = 0x20200", "boot_offset = 0x200", "boot_offset = 0x200", "but not in the first"),
    (BUDDY, "\"ferrostep.bbf\"", "\"ferrostep.bin\"", "boot_offset = 0x20200", "the beginning of a flash sector"),
    (OCTOPUS, "\"firmware.bin\"", "\"../firmware.bin\"", "boot_file = \"../firmware.bin\"", "a file's name"),
    (OCTOPUS, "\"firmware.bin\"", "\"firmware.hex\"", "boot_file = \"firmware.hex\"", "ends with \".bin\""),
    ("bench", "profile = \"cartesian\"", "profile = \"\"", "profile = \"\"", "a letter first"),
    // Names of pins.
    (BUDDY, "step = \"PD13\"", "step = \"D13\"", "motors.y.step = \"D13\"", "a pin's name"),
    (BUDDY, "step = \"PD13\"", "step = \"PD16\"", "motors.y.step = \"PD16\"", "a pin's name"),
    (BUDDY, "step = \"PD13\"", "step = \"PF13\"", "motors.y.step = \"PF13\"", "a pin of the STM32F407VG in LQFP100"),
    ("bench", "step = \"PC3\"", "step = \"PD3\"", "motors.e.step = \"PD3\"", "a pin of the STM32F405RG in LQFP64"),
    ("bench", "step = \"PC3\"", "step = \"PH1\"", "motors.e.step = \"PH1\"", "that is not the crystal's"),
    // Used twice.
    (
        BUDDY,
        "step = \"PD13\"",
        "step = \"PD1\"",
        "motors.y.step = \"PD1\"",
        "motors.x.step already (line {step = \"PD1\"})",
    ),
    (BUDDY, "enable = \"PD14\"", "enable = \"PD1\"", "motors.y.enable = \"PD1\"", "motors.x.step already"),
    (BUDDY, "direction = \"PD12\"", "direction = \"PD3\"", "motors.y.direction = \"PD3\"", "motors.x.enable already"),
    (OCTOPUS, "pin = \"PE5\"", "pin = \"PB11\"", "fans.hotend.pin = \"PB11\"", "heaters.nozzle3.pin already"),
    ("bench", "rx = \"PA10\"", "rx = \"PA9\"", "serial.rx = \"PA9\"", "\"PA10\" or \"PB7\""),
    // One interrupt line for two inputs.
    (
        BUDDY,
        "diag = \"PE1\"",
        "diag = \"PC2\"",
        "motors.y.diag = \"PC2\"",
        "motors.x.diag (line {diag = \"PE2\"}) has the interrupt line 2",
    ),
    (BUDDY, "filament = \"PB4\"", "filament = \"PB10\"", "inputs.filament = \"PB10\"", "fans.part.tacho"),
    // Channels that are not the pin's.
    (
        BUDDY,
        "adc = \"ADC1_IN10\"",
        "adc = \"ADC1_IN11\"",
        "thermistors.nozzle.adc = \"ADC1_IN11\"",
        "ADC1_IN10 or ADC2_IN10 or ADC3_IN10, what PC0 has",
    ),
    (BUDDY, "adc = \"ADC1_IN4\"", "adc = \"ADC3_IN4\"", "thermistors.bed.adc = \"ADC3_IN4\"", "ADC1_IN4 or ADC2_IN4"),
    (
        BUDDY,
        "pin = \"PC0\"",
        "pin = \"PE0\"",
        "thermistors.nozzle.adc = \"ADC1_IN10\"",
        "at an analogue pin, which PE0 is not",
    ),
    (
        BUDDY,
        "timer = \"TIM3_CH4\"",
        "timer = \"TIM3_CH3\"",
        "heaters.nozzle.timer = \"TIM3_CH3\"",
        "TIM3_CH4, what PB1 has",
    ),
    (
        BUDDY,
        "timer = \"TIM3_CH4\"",
        "timer = \"TIM2_CH4\"",
        "heaters.nozzle.timer = \"TIM2_CH4\"",
        "which makes the steps",
    ),
    (
        OCTOPUS,
        "pin = \"PE5\"",
        "pin = \"PE5\"\ntimer = \"TIM9_CH1\"",
        "fans.hotend.timer = \"TIM9_CH1\"",
        "counts the step timer's updates",
    ),
    (
        OCTOPUS,
        "pin = \"PE5\"",
        "pin = \"PE5\"\ntimer = \"TIM1_CH1\"",
        "fans.hotend.timer = \"TIM1_CH1\"",
        "PE5 has no channel that is free",
    ),
    // One converter for all thermistors, and not ADC2, which no stream serves here.
    (
        BUDDY,
        "adc = \"ADC1_IN4\"",
        "adc = \"ADC2_IN4\"",
        "thermistors.bed.adc = \"ADC2_IN4\"",
        "one converter goes round them",
    ),
    (
        BUDDY,
        "adc = \"ADC1_IN10\"",
        "adc = \"ADC3_IN10\"",
        "thermistors.bed.adc = \"ADC1_IN4\"",
        "of the same for all thermistors",
    ),
    // Heaters and fans are switched at different frequencies.
    (
        BUDDY,
        "pin = \"PE9\"\ntimer = \"TIM1_CH1\"",
        "pin = \"PC6\"\ntimer = \"TIM3_CH1\"",
        "fans.hotend.timer = \"TIM3_CH1\"",
        "another timer than TIM3, which switches a heater",
    ),
    // A heater without supervision.
    (
        BUDDY,
        "sensor = \"bed\"",
        "sensor = \"chamber\"",
        "heaters.bed.sensor = \"chamber\"",
        "a heater without one is not safe",
    ),
    (
        BUDDY,
        "kind = \"epcos-100k\"",
        "kind = \"EPCOS 100K\"",
        "thermistors.bed.kind = \"EPCOS 100K\"",
        "lower-case letters",
    ),
    // Drivers.
    (BUDDY, "uart_address = 3", "uart_address = 4", "motors.y.uart_address = 4", "0 to 3"),
    (BUDDY, "[driver_uart]\npin = \"PD5\"", "", "motors.x.uart_address = 1", "the table [driver_uart]"),
    (BUDDY, "uart_address = 3", "uart_address = 3\nuart = \"PC4\"", "motors.y.uart = \"PC4\"", "either uart"),
    ("bench", "port = \"USART1\"", "port = \"USART9\"", "serial.port = \"USART9\"", "\"USART1\", the only port"),
    // The accelerometer.
    (OCTOPUS, "chip = \"adxl345\"", "chip = \"adxl999\"", "accelerometer.chip = \"adxl999\"", "\"adxl345\""),
    (OCTOPUS, "miso = \"PB4\"", "miso = \"PB7\"", "accelerometer.miso = \"PB7\"", "inputs.probe already"),
    (OCTOPUS, "cs = \"PA15\"", "cs = \"PB3\"", "accelerometer.cs = \"PB3\"", "accelerometer.sck already"),
    (OCTOPUS, "sck = \"PB3\"", "sck = \"SCK\"", "accelerometer.sck = \"SCK\"", "a pin's name"),
    // The EEPROM.
    (OCTOPUS, "chip = \"24c32\"", "chip = \"24c02\"", "eeprom.chip = \"24c02\"", "\"24c32\""),
    (OCTOPUS, "scl = \"PB8\"", "scl = \"PB7\"", "eeprom.scl = \"PB7\"", "inputs.probe already"),
    (OCTOPUS, "sda = \"PB9\"", "sda = \"PB8\"", "eeprom.sda = \"PB8\"", "eeprom.scl already"),
    (OCTOPUS, "sda = \"PB9\"", "sda = 9", "eeprom.sda = 9", "a pin's name"),
    (OCTOPUS, "address = 0x50", "address = 0x58", "eeprom.address = 0x58", "80 to 87 (0x50 to 0x57)"),
    (OCTOPUS, "address = 0x50", "address = 80.5", "eeprom.address = 80.5", "whole"),
    (BUDDY, "dm = \"PA11\"", "dm = \"PB14\"", "usb.dm = \"PB14\"", "\"PA11\""),
];

#[test]
fn each_refusal_names_line_key_and_what_was_expected() {
    for (board, from, to, blamed, expected) in REFUSALS {
        let shown = error_after(board, from, to);
        let text = builtin_text(board).unwrap().replace(from, to);
        // The line that is named holds the value that is blamed.
        let (line, rest) = shown.strip_prefix("test.toml:").and_then(|rest| rest.split_once(": ")).expect(&shown);
        let line: usize = line.parse().expect(&shown);
        let key = blamed.split(" = ").next().unwrap().rsplit('.').next().unwrap();
        assert!(text.lines().nth(line - 1).unwrap().contains(key), "{shown}");
        assert!(rest.starts_with(&format!("{blamed}: expected ")), "{blamed}: {shown}");
        let mut expected = expected.to_owned();
        if let Some((_, wanted)) = expected.split_once('{') {
            let wanted = wanted.split('}').next().unwrap().to_owned();
            let number = 1 + text.lines().position(|line| line == wanted).expect(&wanted);
            expected = expected.replace(&format!("{{{wanted}}}"), &number.to_string());
        }
        assert!(rest.contains(&expected), "{expected}: {shown}");
        assert!(!shown.contains('\n'), "{shown}");
    }
}

#[test]
fn what_stands_for_the_whole_board_is_refused() {
    // One step pin on each of four ports.
    let text = builtin_text(BUDDY).unwrap();
    let scattered = text
        .replace("step = \"PD1\"", "step = \"PA7\"")
        .replace("step = \"PD13\"", "step = \"PB12\"")
        .replace("step = \"PD4\"", "step = \"PC13\"");
    let error = parse(&scattered, "test.toml").unwrap_err().to_string();
    assert!(error.contains("motors.e.direction") && error.contains("at most 3 ports, not on 4"), "{error}");
}

#[test]
fn a_debug_pin_in_use_is_noted_and_not_refused() {
    let text = builtin_text(BUDDY).unwrap().replace("filament = \"PB4\"", "filament = \"PA13\"");
    let board = parse(&text, "test.toml").unwrap();
    assert_eq!(board.notes, ["inputs.filament = PA13 is the debug probe's SWDIO: while it is used, no probe is heard"]);
}

#[test]
fn motors_may_share_an_enable_pin_but_nothing_else() {
    let text = builtin_text(BUDDY).unwrap().replace("enable = \"PD14\"", "enable = \"PD3\"");
    let board = parse(&text, "test.toml").unwrap();
    assert_eq!(board.motors[0].enable, board.motors[1].enable);
}

#[test]
fn each_misspelt_or_mistyped_key_is_named() {
    for board in builtin_names() {
        let table: Table = builtin_text(board).unwrap().parse().unwrap();
        for path in paths(&table) {
            let mut misspelt = table.clone();
            let (inner, last) = holder(&mut misspelt, &path).unwrap();
            let value = inner.remove(last).unwrap();
            inner.insert(format!("{last}_"), value);
            let error = parse(&toml::to_string(&misspelt).unwrap(), "test.toml").unwrap_err();
            assert_eq!(error.key(), Some(format!("{path}_").as_str()), "{error}");

            let mut mistyped = table.clone();
            let (inner, last) = holder(&mut mistyped, &path).unwrap();
            inner.insert(last.to_owned(), Value::Array(vec![]));
            let error = parse(&toml::to_string(&mistyped).unwrap(), "test.toml").unwrap_err();
            assert_eq!(error.key(), Some(path.as_str()), "{error}");
        }
    }
}

#[test]
fn what_every_board_must_have_is_missed() {
    let table: Table = builtin_text("bench").unwrap().parse().unwrap();
    let mut required = 0;
    // Tables that may be left out; a table that is present needs all its keys.
    let tables = ["usb", "heaters", "fans", "thermistors", "inputs"];
    let may_be_missing = |path: &str| {
        let (table, rest) = path.split_once('.').unwrap_or((path, ""));
        let is_key = rest.contains('.') && !rest.ends_with(".timer") || table == "usb" && !rest.is_empty();
        tables.contains(&table) && !is_key
    };
    for path in paths(&table).into_iter().filter(|path| !may_be_missing(path)) {
        let mut table = table.clone();
        let (inner, last) = holder(&mut table, &path).unwrap();
        inner.remove(last);
        let error = parse(&toml::to_string(&table).unwrap(), "test.toml").unwrap_err().to_string();
        assert!(error.contains(&format!(": missing key \"{path}\", expected ")), "{error}");
        required += 1;
    }
    assert_eq!(required, 49);
}
