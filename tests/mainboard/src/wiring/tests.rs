#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::Path;

use super::*;
use crate::pins::Pin;

const BENCH: &str = include_str!("../../../../config/boards/bench.toml");
const BUDDY: &str = include_str!("../../../../config/boards/prusa-buddy.toml");
const OCTOPUS: &str = include_str!("../../../../config/boards/btt-octopus-1.1.toml");
const MINI: &str = include_str!("../../../../config/profiles/prusa-mini.toml");
const COREXY: &str = include_str!("../../../../config/profiles/corexy.toml");
const CARTESIAN: &str = include_str!("../../../../config/profiles/cartesian.toml");

fn pin(name: &str) -> Pin {
    name.parse().unwrap()
}

/// The refusal of a board after one replacement in its file.
fn refused(text: &str, from: &str, to: &str) -> Refusal {
    assert!(text.contains(from), "{from} is not in the file");
    Board::parse("board.toml", &text.replacen(from, to, 1)).expect_err(to)
}

fn refused_profile(from: &str, to: &str) -> Refusal {
    assert!(MINI.contains(from), "{from} is not in the file");
    Printer::parse("mini.toml", &MINI.replacen(from, to, 1)).expect_err(to)
}

#[test]
fn the_buddy_is_wired_according_to_its_file() {
    let board = Board::parse("prusa-buddy.toml", BUDDY).unwrap();
    assert_eq!((board.chip, board.crystal_hz, board.boot_offset), (Chip::F407, 12_000_000, 0x20200));
    assert_eq!((board.flash_bytes, board.ram_bytes, board.ccm_bytes), (0x10_0000, 0x2_0000, 0x1_0000));
    assert_eq!(board.motors.iter().map(|motor| motor.name.as_str()).collect::<Vec<_>>(), ["x", "y", "z", "e"]);
    let y = board.motor("y").unwrap();
    assert_eq!((y.step, y.direction, y.enable, y.diag), (pin("PD13"), pin("PD12"), pin("PD14"), Some(pin("PE1"))));
    assert_eq!((y.driver, y.line, y.sense_resistor_ohm), (Driver::Tmc2209, DriverLine::Shared(3), Some(0.22)));
    assert_eq!(board.driver_uart, Some(pin("PD5")));
    let nozzle = board.heaters.iter().find(|heater| heater.name == "nozzle").unwrap();
    assert_eq!((nozzle.pin, nozzle.timer), (pin("PB1"), Some(TimerChannel { timer: 3, channel: 4 })));
    let thermistor = board.thermistor("nozzle").unwrap();
    assert_eq!(thermistor.adc, Adc { converter: 1, channel: 10 });
    assert_eq!(thermistor.kind, Some(ThermistorKind::Named(NamedThermistor::Semitec104Gt2)));
    assert_eq!(board.input("probe").unwrap().pin, pin("PA8"));
    assert_eq!((board.serial.tx, board.serial.rx), (pin("PB6"), pin("PB7")));
    assert_eq!(board.usb, Some(Usb { dm: pin("PA11"), dp: pin("PA12") }));
}

#[test]
fn the_other_boards_and_all_profiles_can_be_read() {
    let bench = Board::parse("bench.toml", BENCH).unwrap();
    let end_stops = ["x", "y", "z"].map(|name| bench.input(name).unwrap().pin);
    assert_eq!(end_stops, [pin("PB12"), pin("PB13"), pin("PB14")]);
    assert_eq!(bench.heaters.iter().map(|heater| heater.pin).collect::<Vec<_>>(), [pin("PA7"), pin("PA6")]);
    let octopus = Board::parse("octopus.toml", OCTOPUS).unwrap();
    assert_eq!((octopus.chip, octopus.ccm_bytes, octopus.motors.len()), (Chip::F446, 0, 8));
    assert_eq!(octopus.motors[4].name, "e1");
    assert_eq!(octopus.motors[0].line, DriverLine::Own(pin("PC4")));
    for profile in [MINI, COREXY, CARTESIAN] {
        Printer::parse("profile.toml", profile).unwrap();
    }
}

#[test]
fn missing_profile_keys_get_their_defaults() {
    let mini = Printer::parse("mini.toml", MINI).unwrap();
    assert_eq!((mini.size_mm, mini.lower_end_mm), ([180.4, 180.0, 185.0], [-2.0, -3.0, 0.0]));
    assert_eq!(mini.homing.bed_mm, [[0.0, 180.0], [0.0, 180.0]]);
    assert_eq!(mini.homing.probe_offset_mm, Some([-29.0, -3.0, 0.0]));
    let x = mini.homing.axes[0].unwrap();
    assert_eq!((x.end, x.sensor, x.overrun_mm, x.triggers_low), (End::Max, HomingSensor::Stall, 10.0, false));
    assert_eq!(mini.signals.inverted, [true, true, false, false]);
    assert!(mini.signals.both_edges);
    assert_eq!(mini.nozzle.pull_up_ohm, 4700.0);
    assert_eq!(mini.drivers[2].unwrap().microsteps, 8);
    let corexy = Printer::parse("corexy.toml", COREXY).unwrap();
    assert_eq!((corexy.kinematics, corexy.homing.bed_mm), (Kinematics::CoreXy, [[0.0, 300.0], [0.0, 300.0]]));
    assert_eq!(corexy.homing.axes[2].unwrap().overrun_mm, 5.0);
    let cartesian = Printer::parse("cartesian.toml", CARTESIAN).unwrap();
    assert_eq!((cartesian.signals.inverted, cartesian.drivers), ([false; 4], [None; 4]));
}

#[test]
fn a_thermistor_may_be_given_by_r25_and_b() {
    let text = MINI.replacen("sensor = \"semitec-104gt-2\"", "sensor = { r25_ohm = 100000, beta_k = 3950 }", 1);
    let sensor = Printer::parse("mini.toml", &text).unwrap().nozzle.sensor;
    assert_eq!(sensor, ThermistorKind::Beta { r25_ohm: 100_000.0, beta_k: 3950.0 });
}

#[test]
fn wiring_that_the_chip_excludes_is_refused_with_its_key() {
    let cases = [
        (BUDDY, "\"STM32F407VG\"\npackage", "\"STM32F103C8\"\npackage", "chip", "STM32F103C8"),
        (BUDDY, "package = \"LQFP100\"", "package = \"LQFP64\"", "package", "LQFP100"),
        (BUDDY, "flash_kib = 1024", "flash_kib = 2048", "flash_kib", "1024"),
        (BUDDY, "ram_kib = 128", "ram_kib = 192", "ram_kib", "128"),
        (OCTOPUS, "ccm_kib = 0", "ccm_kib = 64", "ccm_kib", "write 0"),
        (OCTOPUS, "flash_kib = 512", "flash_kib = 1024", "flash_kib", "512"),
        (BUDDY, "crystal_mhz = 12", "crystal_mhz = 27", "crystal_mhz", "4 to 26"),
        (BUDDY, "crystal_mhz = 12", "crystal_mhz = 3", "crystal_mhz", "4 to 26"),
        (BUDDY, "boot_offset = 0x20200", "boot_offset = 0x20100", "boot_offset", "0x200"),
        (BUDDY, "boot_offset = 0x20200", "boot_offset = 0x100000", "boot_offset", "0x100000"),
        (BUDDY, "step = \"PD1\"", "step = \"PF1\"", "motors.x.step", "LQFP100"),
        (BENCH, "step = \"PC0\"", "step = \"PD3\"", "motors.x.step", "LQFP64"),
        (OCTOPUS, "step = \"PF13\"", "step = \"PI1\"", "motors.x.step", "LQFP144"),
        (BUDDY, "step = \"PD1\"", "step = \"D1\"", "motors.x.step", "PD1"),
        (BUDDY, "step = \"PD1\"", "step = \"PH0\"", "motors.x.step", "crystal_mhz"),
        (BUDDY, "step = \"PD1\"", "step = \"PD0\"", "motors.x.direction", "motors.x.step"),
        (BUDDY, "enable = \"PD3\"", "enable = \"PD1\"", "motors.x.enable", "motors.x.step"),
        (
            BUDDY,
            "adc = \"ADC1_IN10\"",
            "adc = \"ADC1_IN11\"",
            "thermistors.nozzle.adc",
            "ADC1_IN10, ADC2_IN10, ADC3_IN10",
        ),
        (BUDDY, "adc = \"ADC1_IN4\"", "adc = \"ADC3_IN4\"", "thermistors.bed.adc", "ADC1_IN4, ADC2_IN4"),
        (BUDDY, "timer = \"TIM3_CH4\"", "timer = \"TIM3_CH3\"", "heaters.nozzle.timer", "TIM3_CH4"),
        (OCTOPUS, "timer = \"TIM4_CH1\"", "timer = \"TIM4_CH2\"", "fans.fan2.timer", "TIM4_CH1"),
        (BUDDY, "sensor = \"bed\"", "sensor = \"bett\"", "heaters.bed.sensor", "bett"),
        (BUDDY, "port = \"USART1\"", "port = \"USART2\"", "serial.port", "USART1"),
        (BUDDY, "tx = \"PB6\"", "tx = \"PC6\"", "serial.tx", "PA9, PB6"),
        (BUDDY, "rx = \"PB7\"", "rx = \"PC7\"", "serial.rx", "PA10, PB7"),
        (BUDDY, "dm = \"PA11\"\ndp = \"PA12\"", "dm = \"PA12\"\ndp = \"PA11\"", "usb.dm", "PA11"),
        (BUDDY, "uart_address = 3", "uart_address = 4", "motors.y.uart_address", "0 to 3"),
        (BUDDY, "uart_address = 3", "uart_address = 1", "motors.y.uart_address", "motors.x"),
        (BUDDY, "uart_address = 3", "uart_address = 3\nuart = \"PE15\"", "motors.y.uart", "both"),
        (BUDDY, "[driver_uart]\npin = \"PD5\"", "", "motors.x.uart_address", "[driver_uart]"),
        (BUDDY, "[motors.e]", "[motors.f]", "motors.e", "missing"),
        (BUDDY, "pull_up_ohm = 4700", "pull_up_ohm = 0", "thermistors", "ohm"),
        (BUDDY, "[fans.part]", "[virtual]\n[fans.part]", "", "virtual"),
        (BUDDY, "sensor = \"bed\"", "sensor = \"bed\"\ncolour = \"red\"", "", "colour"),
    ];
    for (board, from, to, key, says) in cases {
        let refusal = refused(board, from, to);
        let text = refusal.to_string();
        assert!(refusal.key.starts_with(key) && (refusal.key.is_empty() == key.is_empty()), "{to}: {text}");
        assert!(text.starts_with("board.toml: ") && text.contains(says), "{to}: {text}");
        assert!(!refusal.mend.is_empty(), "{to}: {text}");
    }
}

#[test]
fn motors_may_share_enable_pins_only() {
    assert!(Board::parse("bench.toml", BENCH).is_ok());
    let refusal = refused(BENCH, "step = \"PC1\"", "step = \"PC0\"");
    assert_eq!(refusal.key, "motors.y.step");
}

#[test]
fn impossible_profile_values_are_refused_with_their_key() {
    let cases = [
        ("lower_end_mm = { x = -2", "lower_end_mm = { x = 2", "size_mm.x"),
        ("e = 325", "e = 0", "steps_per_mm"),
        ("pulse_width_us = 0.2", "pulse_width_us = -1", "driver.pulse_width_us"),
        ("inverted = [\"x\", \"y\"]", "inverted = [\"a\"]", "driver.inverted"),
        ("microsteps = 16", "microsteps = 17", "drivers.x.microsteps"),
        ("capacity_j_per_k = 11.2", "capacity_j_per_k = 0", "nozzle.model"),
        ("[nozzle]\nsensor", "[nozzle]\npull_up_ohm = 0\nsensor", "nozzle.pull_up_ohm"),
        ("sensor = \"semitec-104gt-2\"", "sensor = { r25_ohm = 0, beta_k = 3950 }", "nozzle.sensor"),
        ("kinematics = \"cartesian\"", "kinematics = \"delta\"", ""),
    ];
    for (from, to, key) in cases {
        let refusal = refused_profile(from, to);
        assert_eq!(refusal.key, key, "{refusal}");
    }
}

#[test]
fn a_missing_file_is_named() {
    let refusal = Board::read(Path::new("/nowhere/board.toml")).unwrap_err();
    assert!(refusal.to_string().starts_with("/nowhere/board.toml: cannot be read"), "{refusal}");
    assert!(Printer::read(Path::new("/nowhere/p.toml")).is_err());
}

#[test]
fn every_pin_has_the_channels_of_the_data_sheet() {
    let names = |text: &str| Adc::all_at(pin(text)).iter().map(Adc::to_string).collect::<Vec<_>>();
    assert_eq!(names("PA3"), ["ADC1_IN3", "ADC2_IN3", "ADC3_IN3"]);
    assert_eq!(names("PB1"), ["ADC1_IN9", "ADC2_IN9"]);
    assert_eq!(names("PC5"), ["ADC1_IN15", "ADC2_IN15"]);
    assert_eq!(names("PF3"), ["ADC3_IN9"]);
    assert_eq!(names("PF10"), ["ADC3_IN8"]);
    assert_eq!(names("PF5"), ["ADC3_IN15"]);
    assert!(names("PD0").is_empty());
    let timers = |chip, text| TimerChannel::all_at(chip, pin(text)).iter().map(ToString::to_string).collect::<Vec<_>>();
    assert_eq!(timers(Chip::F407, "PA2"), ["TIM2_CH3", "TIM5_CH3", "TIM9_CH1"]);
    assert_eq!(timers(Chip::F407, "PB8"), ["TIM4_CH3", "TIM10_CH1"]);
    assert_eq!(timers(Chip::F446, "PB8"), ["TIM2_CH1", "TIM4_CH3", "TIM10_CH1"]);
    assert_eq!(timers(Chip::F446, "PF9"), ["TIM14_CH1"]);
    assert!(timers(Chip::F405, "PE9").is_empty(), "the small package has no port E");
    assert_eq!(TimerChannel { timer: 12, channel: 1 }.alternate_function(), Some(9));
}

/// An image with a vector table and 8 bytes of code at `start`, and `ram` bytes of RAM in use.
fn elf(start: u32, stack: u32, reset: u32, flash: u32, ram: u32) -> Vec<u8> {
    let mut file = b"\x7fELF\x01\x01\x01".to_vec();
    file.resize(52, 0);
    file[18] = 40;
    file[28] = 52;
    file[42] = 32;
    file[44] = 2;
    let offset = 52 + 64;
    for header in [[1, offset, start, start, flash, flash, 5, 4], [1, offset, 0x2000_0000, 0x2000_0000, 0, ram, 6, 4]] {
        file.extend(header.into_iter().flat_map(u32::to_le_bytes));
    }
    file.extend(stack.to_le_bytes());
    file.extend(reset.to_le_bytes());
    file.resize((offset + flash) as usize, 0xbf);
    file
}

#[test]
fn an_image_fits_its_own_board_only() {
    let buddy = Board::parse("prusa-buddy.toml", BUDDY).unwrap();
    let start = 0x0802_0200;
    let image = check_image(&buddy, "f.elf", &elf(start, 0x2000_6000, start + 9, 64, 0x2_0000)).unwrap();
    assert_eq!(image, Image { start, end: start + 64, stack_pointer: 0x2000_6000, entry: start + 8 });
    // Flash filled to its end, and a stack at the end of either memory.
    let whole = 0x10_0000 - 0x2_0200;
    check_image(&buddy, "f.elf", &elf(start, 0x2002_0000, start + 9, whole, 0)).unwrap();
    check_image(&buddy, "f.elf", &elf(start, 0x1001_0000, start + 9, 64, 0)).unwrap();

    let refusals = [
        (elf(0x0800_8000, 0x2000_6000, 0x0800_8009, 64, 0), "boot_offset", "0x8020200"),
        (elf(start + 0x200, 0x2000_6000, start + 0x209, 64, 0), "boot_offset", "0x8020400"),
        (elf(start, 0x2000_6000, start + 9, whole + 4, 0), "flash_kib", "0x8100000"),
        (elf(start, 0x2002_0004, start + 9, 64, 0), "ram_kib", "stack pointer"),
        (elf(start, 0x2000_0000, start + 9, 64, 0), "ram_kib", "stack pointer"),
        (elf(start, 0x2000_6000, start + 9, 64, 0x2_0004), "ram_kib", "no memory"),
        (elf(start, 0x2000_6000, start + 8, 64, 0), "", "first instruction"),
        (elf(start, 0x2000_6000, start + 65, 64, 0), "", "first instruction"),
        (elf(start, 0, 0, 4, 0), "", "truncated"),
        (b"#!/bin/sh".to_vec(), "", "not an ELF"),
    ];
    for (file, key, says) in refusals {
        let refusal = check_image(&buddy, "f.elf", &file).unwrap_err();
        assert!(refusal.key == key && refusal.to_string().contains(says), "{refusal}");
    }
    let octopus = Board::parse("octopus.toml", OCTOPUS).unwrap();
    let refusal = check_image(&octopus, "f.elf", &elf(0x0800_8000, 0x1000_4000, 0x0800_8009, 64, 0)).unwrap_err();
    assert_eq!(refusal.key, "ram_kib", "the F446 has no core coupled memory: {refusal}");
}

#[test]
fn an_image_truncated_anywhere_is_refused() {
    let board = Board::parse("bench.toml", BENCH).unwrap();
    let file = elf(0x0800_0000, 0x2000_6000, 0x0800_0009, 64, 0);
    assert!(check_image(&board, "f.elf", &file).is_ok());
    for length in 0..file.len() {
        assert!(check_image(&board, "f.elf", &file[..length]).is_err(), "{length}");
    }
}

#[test]
fn an_eeprom() {
    let eeprom = Board::parse("octopus.toml", OCTOPUS).unwrap().eeprom.unwrap();
    assert_eq!((eeprom.scl, eeprom.sda, eeprom.address), (pin("PB8"), pin("PB9"), 0x50));
    assert_eq!(Board::parse("bench.toml", BENCH).unwrap().eeprom, None);
    let refusal = refused(OCTOPUS, "chip = \"24c32\"", "chip = \"24c256\"");
    assert_eq!((refusal.key.as_str(), refusal.mend.as_str()), ("eeprom.chip", "write \"24c32\""));
    assert_eq!(refused(OCTOPUS, "sda = \"PB9\"", "sda = \"PB8\"").key, "eeprom.sda");
    assert_eq!(refused(OCTOPUS, "address = 0x50", "address = 0x48").key, "eeprom.address");
}

#[test]
fn an_accelerometer_and_the_frame_that_it_feels() {
    let plug = Board::parse("octopus.toml", OCTOPUS).unwrap().accelerometer.unwrap();
    assert_eq!([plug.sck, plug.miso, plug.mosi, plug.cs], ["PB3", "PB4", "PB5", "PA15"].map(pin));
    assert_eq!(Board::parse("bench.toml", BENCH).unwrap().accelerometer, None);
    let refusal = refused(OCTOPUS, "chip = \"adxl345\"", "chip = \"lis2dw12\"");
    assert_eq!((refusal.key.as_str(), refusal.mend.as_str()), ("accelerometer.chip", "write \"adxl345\""));
    assert_eq!(refused(OCTOPUS, "miso = \"PB4\"", "miso = \"PB7\"").key, "accelerometer.miso");
    let framed = format!("{COREXY}\n[frame.x]\nfrequency_hz = 48.5\nfrequency_uncertainty_hz = 1\n");
    let frame = Printer::parse("corexy.toml", &framed).unwrap().frame;
    assert_eq!(frame, [Some(FrameMode { frequency_hz: 48.5, damping: 0.1 }), None]);
    let stiff = framed.replace("48.5", "0.2");
    assert_eq!(Printer::parse("corexy.toml", &stiff).unwrap_err().key, "frame.x");
}
