//! Every built-in board is right, and agrees with its maker's documents.

use ferrostep_boards::registers::{all_off, pins};
use ferrostep_boards::{
    AccelerometerChip, Board, Driver, DriverUart, EepromChip, Pin, Store, builtin_names, constants, fit, load,
};
use ferrostep_hal_shim::SpareConnector;

fn board(name: &str) -> Board {
    load(name).unwrap_or_else(|error| panic!("{error}"))
}

/// The text of a board without its heaters, fans and thermistors.
fn without_heat(text: &str) -> String {
    let is_of_heat = |table: &&str| ["heaters.", "fans.", "thermistors."].iter().any(|of| table.starts_with(of));
    let (first, tables) = text.split_once("\n[").unwrap();
    let kept: Vec<&str> = tables.split("\n[").filter(|table| !is_of_heat(table)).collect();
    [&[first], kept.as_slice()].concat().join("\n[")
}

fn pin(name: &str) -> Pin {
    Pin::named(name).unwrap()
}

#[test]
fn every_board_is_right_and_runs_at_168_mhz() {
    for name in builtin_names() {
        let board = board(name);
        assert_eq!(board.name, name);
        assert_eq!((board.clock.core_hz, board.internal_clock.core_hz), (168_000_000, 168_000_000));
        assert!((1..=3).contains(&board.motor_ports().len()));
        assert!(ferrostep_profiles::builtin_text(&board.profile).is_some(), "{name}");
        let memories = constants::memories(&board, constants::STACK_KIB);
        assert!(memories.contains(&format!("{:#x}", board.image_address())), "{memories}");
    }
}

#[test]
fn every_board_is_a_file_that_someone_else_can_write() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .filter_map(|entry| entry.unwrap().file_name().into_string().ok())
        .filter_map(|name| name.strip_suffix(".toml").map(str::to_owned))
        .filter(|name| name != "Cargo")
        .collect();
    files.sort();
    assert_eq!(files, builtin_names().collect::<Vec<_>>());
    for name in files {
        assert_eq!(load(folder.join(format!("{name}.toml")).to_str().unwrap()).unwrap(), board(&name));
    }
    let error = load("no-such-board").unwrap_err().to_string();
    assert!(error.contains("no built-in board of this name (bench, btt-octopus-1.1, prusa-buddy)"), "{error}");
}

#[test]
fn the_bench_has_one_port_for_motors_and_all_that_its_profile_needs() {
    let bench = board("bench");
    let heaters: Vec<_> = bench.heaters.iter().map(|heater| (heater.name, heater.pin.to_string())).collect();
    assert_eq!(heaters, [("nozzle", "PA6".to_owned()), ("bed", "PA7".to_owned())]);
    let cartesian = ferrostep_profiles::load(&bench.profile).unwrap();
    let end_stops = ["PB12", "PB13", "PB14"].map(|name| Some((pin(name), cartesian.homing[0].triggers_low)));
    assert_eq!(fit::sensor_pins(&bench, &cartesian), end_stops);
    assert!(fit::check(&bench, &cartesian, "cartesian").is_ok() && bench.notes.is_empty());
    assert_eq!((bench.motor_ports(), bench.image_address()), (vec![2], 0x0800_0000));
    assert!(bench.motors.iter().all(|motor| motor.enable == pin("PC8")));
}

#[test]
fn the_buddy_steps_with_one_store_and_speaks_to_its_drivers_by_address() {
    let buddy = board("prusa-buddy");
    assert_eq!(buddy.motor_ports(), [3]);
    assert_eq!(buddy.motors.clone().map(|motor| motor.uart.unwrap()), [1, 3, 0, 2].map(DriverUart::Address));
    assert!(buddy.motors.iter().all(|motor| motor.driver == Driver::Tmc2209 && motor.sense_resistor_ohm == Some(0.22)));
    let heaters: Vec<_> = buddy.heaters.iter().map(|heater| (heater.name, heater.pin.to_string())).collect();
    assert_eq!(heaters, [("nozzle", "PB1".to_owned()), ("bed", "PB0".to_owned())]);
    assert!(buddy.notes.is_empty());
}

/// Prusa's boot loader has the first 128 KiB; its container's header the next 512 bytes (Klipper's
/// Kconfig, "128KiB + 512 byte offset"). VTOR wants 512.
#[test]
fn the_buddys_image_lies_after_its_boot_loader_or_in_its_place() {
    let buddy = board("prusa-buddy");
    assert_eq!((buddy.image_address(), buddy.boot_file.as_deref()), (0x0802_0200, Some("ferrostep.bbf")));
    assert!(buddy.image_address().is_multiple_of(512) && buddy.takes_bbf());
    assert_eq!(buddy.clone().at_boot_offset(0x20200).unwrap(), buddy);
    let instead = buddy.clone().at_boot_offset(0).unwrap();
    assert_eq!((instead.image_address(), instead.boot_file.clone(), instead.takes_bbf()), (0x0800_0000, None, false));
    let memories = constants::memories(&instead, constants::STACK_KIB);
    assert!(memories.contains("ORIGIN = 0x8000000, LENGTH = 0xc0000"), "{memories}");
    for offset in [1, 0x20400, 0xa0000, u32::MAX] {
        let error = buddy.clone().at_boot_offset(offset).unwrap_err();
        assert!(error.contains("expected 0x20200, the board's own, or the beginning of a flash sector"), "{error}");
    }
}

#[test]
fn the_octopus_steps_with_two_stores_after_its_boot_loader() {
    let octopus = board("btt-octopus-1.1");
    assert_eq!(octopus.motor_ports(), [5, 6]);
    assert_eq!((octopus.image_address(), octopus.boot_file.as_deref()), (0x0800_8000, Some("firmware.bin")));
    assert_eq!((octopus.spare_motors.len(), octopus.heaters.len(), octopus.fans.len()), (4, 5, 6));
    assert_eq!(
        octopus.notes,
        ["motors.e3.direction = PA14 is the debug probe's SWCLK: while it is used, no probe is heard"]
    );
}

#[test]
fn the_constants_name_every_motor_and_register() {
    let text = constants::rust(&board("prusa-buddy"));
    for part in [
        "pub const NAME: &str = \"prusa-buddy\";",
        "pub const CORE_HZ: u32 = 168000000;",
        "pub const APB1_HZ: u32 = 42000000;",
        "pub const MOTOR_PORTS: usize = 1;",
        "pub const MOTOR_PORT_INDICES: [u8; MOTOR_PORTS] = [3];",
        "MotorPins { step: Pin { port: 0, number: 13 }, direction: Pin { port: 0, number: 12 } }",
        "pub const ENABLE: [(u8, u8); 4] = [(3, 3), (3, 14), (3, 2), (3, 10)];",
        "pub const RAM: core::ops::Range<u32> = 0x20000000..0x20020000;",
        // PB0 and PB1 low.
        "Store { address: 0x40020418, clear: 0xffffffff, set: 0x30000 }",
    ] {
        assert!(text.contains(part), "{part} in {text}");
    }
}

#[test]
fn the_constants_say_what_heats_and_what_watches_it() {
    let text = constants::rust(&board("prusa-buddy"));
    for part in [
        "pub const THERMISTORS: usize = 4;",
        "converter: ConverterNumber::One, channels: &[10, 4, 3, 6], sensors: [Some(0), Some(1), None, None]",
        // PB1 on TIM3, channel 4, alternate function 2; then PB0.
        "heaters: [Some(OutputPin { port: 1, number: 1, channel: Some(TimerChannel { timer: 1073742848, channel: 4, function: 2, \
         clock_bit: 1, is_fast: false, has_main_switch: false }) }), Some(OutputPin { port: 1, number: 0, ",
        "fans: [Some(FanPins { power: OutputPin { port: 4, number: 11, channel: Some(TimerChannel { timer: 1073807360, \
         channel: 2, ",
        "}, tachometer: Some((4, 10)) }), Some(FanPins { power: OutputPin { port: 4, number: 9, ",
        "}, tachometer: Some((4, 14)) }), None, None, None, None]",
    ] {
        assert!(text.contains(part), "{part} in {text}");
    }
    let text = constants::rust(&board("btt-octopus-1.1"));
    for part in [
        // In the order of the names: the nozzle's is the first, the bed's the second.
        "converter: ConverterNumber::Three, channels: &[14, 9, 15, 4, 5], sensors: [Some(0), Some(1), None, None]",
        "heaters: [Some(OutputPin { port: 0, number: 2, channel: None }), Some(OutputPin { port: 0, number: 1, channel: None }), None, None]",
        "Some(FanPins { power: OutputPin { port: 4, number: 5, channel: None }, tachometer: None }), Some(FanPins {",
    ] {
        assert!(text.contains(part), "{part} in {text}");
    }
    let text = constants::rust(&board("bench"));
    for part in [
        "converter: ConverterNumber::One, channels: &[1, 2], sensors: [Some(0), Some(1), None, None]",
        // PA6 on TIM3, channel 1.
        "heaters: [Some(OutputPin { port: 0, number: 6, channel: Some(TimerChannel { timer: 1073742848, channel: 1, function: 2, ",
        // PB6 on TIM4, channel 1.
        "fans: [Some(FanPins { power: OutputPin { port: 1, number: 6, channel: Some(TimerChannel { timer: 1073743872, channel: 1, ",
    ] {
        assert!(text.contains(part), "{part} in {text}");
    }
    let bare = ferrostep_boards::parse(&without_heat(ferrostep_boards::builtin_text("bench").unwrap()), "bare.toml");
    assert!(constants::rust(&bare.unwrap()).contains("pub const THERMAL: Option<ThermalPins> = None;"));
    // A chamber at two connectors of others.
    let mut warm = board("btt-octopus-1.1");
    for (heater, expected) in [
        (
            None,
            "heaters: [Some(OutputPin { port: 0, number: 2, channel: None }), Some(OutputPin { port: 0, number: 1, channel: None }), None, None]",
        ),
        (Some(SpareConnector::Nozzle2), "Some(OutputPin { port: 1, number: 10, channel: None }), None]"),
    ] {
        warm.used_chamber = Some((SpareConnector::Nozzle1, heater));
        let text = constants::rust(&warm);
        assert!(text.contains("sensors: [Some(0), Some(1), Some(2), None]") && text.contains(expected), "{text}");
    }
}

/// Marlin's `pins_BTT_OCTOPUS_V1_common.h`: I2C_SCL_PIN and I2C_SDA_PIN, a 24C32, which answers at
/// 0x50 with its address pins low.
#[test]
fn the_octopus_alone_has_an_eeprom() {
    let eeprom = board("btt-octopus-1.1").eeprom.unwrap();
    assert_eq!((eeprom.chip, eeprom.address), (EepromChip::C24c32, 0x50));
    assert_eq!([eeprom.scl, eeprom.sda], ["PB8", "PB9"].map(pin));
    let text = constants::rust(&board("btt-octopus-1.1"));
    let value = "Some((I2cPins { scl: (1, 8), sda: (1, 9) }, 80))";
    assert!(text.contains(&format!("pub const EEPROM: Option<(I2cPins, u8)> = {value};")), "{text}");
    for name in ["bench", "prusa-buddy"] {
        assert_eq!(board(name).eeprom, None);
        assert!(constants::rust(&board(name)).contains("pub const EEPROM: Option<(I2cPins, u8)> = None;"));
    }
    // A board with one leaves no flash to settings.
    let table = "[eeprom]\nchip = \"24c32\"\nscl = \"PB8\"\nsda = \"PB9\"\naddress = 0x51\n";
    let text = format!("{}\n{table}", ferrostep_boards::builtin_text("bench").unwrap());
    let with_eeprom = ferrostep_boards::parse(&text, "bench.toml").unwrap();
    assert_eq!((board("bench").settings_bytes(), with_eeprom.settings_bytes()), (0x4_0000, 0));
    assert_eq!(with_eeprom.image_room(), 0x10_0000);
}

/// Klipper's `spi3` (src/stm32/spi.c), and PA15 as in an owner's settings.
#[test]
fn the_octopus_alone_has_a_plug_for_an_accelerometer() {
    let plug = board("btt-octopus-1.1").accelerometer.unwrap();
    assert_eq!(plug.chip, AccelerometerChip::Adxl345);
    assert_eq!([plug.miso, plug.mosi, plug.sck, plug.cs], ["PB4", "PB5", "PB3", "PA15"].map(pin));
    let text = constants::rust(&board("btt-octopus-1.1"));
    let pins = "Some(SpiPins { sck: (1, 3), miso: (1, 4), mosi: (1, 5), cs: (0, 15) })";
    assert!(text.contains(&format!("pub const ACCELEROMETER: Option<SpiPins> = {pins};")), "{text}");
    for name in ["bench", "prusa-buddy"] {
        assert_eq!(board(name).accelerometer, None);
        assert!(constants::rust(&board(name)).contains("pub const ACCELEROMETER: Option<SpiPins> = None;"));
    }
}

/// Marlin's PS_ON_PIN, and Klipper's sample of the board.
#[test]
fn the_octopus_alone_can_switch_a_supply_and_only_for_a_profile_that_has_one() {
    let octopus = board("btt-octopus-1.1");
    assert_eq!(octopus.power_supply, Some(pin("PE11")));
    for name in ["bench", "prusa-buddy"] {
        assert_eq!(board(name).power_supply, None);
    }
    let profile = |table: &str| {
        let text = format!("{}{table}", ferrostep_profiles::builtin_text("corexy").unwrap());
        ferrostep_profiles::parse(&text, "supply.toml").unwrap()
    };
    // BSRR and MODER of port E.
    let (levels, modes) = (0x4002_1018, 0x4002_1000);
    let touches = |stores: &[Store], address: u32, bits: u32| {
        stores
            .iter()
            .filter(|store| store.address == address)
            .map(|store| store.set & bits)
            .filter(|set| *set != 0)
            .collect::<Vec<_>>()
    };
    let without = octopus.clone().for_machine(&profile(""));
    for stores in [pins(&without), all_off(&without)] {
        assert_eq!(touches(&stores, levels, 1 << 11 | 1 << 27), [0; 0], "the pin stays an input");
        assert_eq!(touches(&stores, modes, 0b11 << 22), [0; 0]);
    }
    assert!(constants::rust(&without).contains("supply: None"));
    let (low, high) = (1 << 27, 1 << 11);
    for (keys, at_start, off) in [
        ("on_is_low = true", low, high),
        ("on_is_low = false", high, low),
        ("on_is_low = true\non_at_start = false", high, high),
        ("on_is_low = false\non_at_start = false", low, low),
    ] {
        let with = octopus.clone().for_machine(&profile(&format!("[power_supply]\n{keys}\n")));
        for (stores, level) in [(pins(&with), at_start), (all_off(&with), off)] {
            assert_eq!(touches(&stores, levels, low | high), [level], "{keys}");
            assert_eq!(touches(&stores, modes, 0b11 << 22), [0b01 << 22], "{keys}");
        }
        let heaters_first = all_off(&with).first().is_some_and(|store| store.address == 0x4002_0018);
        assert!(heaters_first, "a heater's own switch comes before the supply's");
        let pin = format!(
            "supply: Some(ferrostep_stm32f4::SupplyPin {{ port: 4, number: 11, on_is_low: {} }})",
            keys.contains("low = true")
        );
        assert!(constants::rust(&with).contains(&pin), "{keys}");
    }
}

/// Marlin's SERVO0_PIN and Klipper's sample of the board (control_pin). Low before it is an output,
/// and an input where no probe needs it.
#[test]
fn the_octopus_alone_has_an_output_for_a_servo_and_uses_it_for_a_pin() {
    let octopus = board("btt-octopus-1.1");
    assert_eq!(octopus.servo, Some(pin("PB6")));
    for name in ["bench", "prusa-buddy"] {
        assert_eq!(board(name).servo, None);
    }
    let mut profile = ferrostep_profiles::load("prusa-mini").unwrap();
    for (bltouch, constant) in [(None, "None"), (Some(BLTOUCH), "Some((1, 6))")] {
        profile.bltouch = bltouch;
        let octopus = octopus.clone().for_machine(&profile);
        assert!(constants::rust(&octopus).contains(&format!("SERVO: Option<(u8, u8)> = {constant};")));
        let stores = pins(&octopus);
        // BSRR and MODER of port B.
        let low = stores.iter().position(|store| store.address == 0x4002_0418 && store.set & 1 << 22 != 0);
        let output =
            stores.iter().position(|store| store.address == 0x4002_0400 && store.set & 0b11 << 12 == 0b01 << 12);
        assert_eq!((low.is_some(), output.is_some()), (bltouch.is_some(), bltouch.is_some()));
        assert!(low <= output);
        assert!(!stores.iter().any(|store| store.address == 0x4002_0418 && store.set & 1 << 6 != 0), "never high");
    }
}

const BLTOUCH: ferrostep_printer::BlTouch =
    ferrostep_printer::BlTouch { move_ms: 680, stows_each_touch: true, tests_signal: true };

/// A light goes to its own level in the safe state, and a fan's output that the profile uses for
/// something else does not blow.
#[test]
fn the_safe_state_knows_what_is_no_fan() {
    let profile = |tables: &str| {
        let text = format!("{}{tables}", ferrostep_profiles::builtin_text("corexy").unwrap());
        ferrostep_profiles::parse(&text, "outputs.toml").unwrap()
    };
    let levels = |tables: &str| {
        let stores = all_off(&board("btt-octopus-1.1").for_machine(&profile(tables)));
        // BSRR of the ports A (part, PA8), E (hot end, PE5) and D (fan2, PD12; fan3, PD13).
        [(0x4002_0018, 8), (0x4002_1018, 5), (0x4002_0c18, 12), (0x4002_0c18, 13)].map(|(address, pin)| {
            let word = stores.iter().filter(|store| store.address == address).fold(0, |word, store| word | store.set);
            match (word >> pin & 1, word >> (pin + 16) & 1) {
                (0, 0) => None,
                (high, _) => Some(high == 1),
            }
        })
    };
    assert_eq!(levels(""), [Some(true), Some(true), None, None]);
    let outputs = "[outputs.light]\noutput = \"fan2\"\nat_halt = 1\n[outputs.relay]\noutput = \"fan3\"\n";
    assert_eq!(levels(outputs), [Some(true), Some(true), Some(true), Some(false)]);
    let moved = "[fans.part]\noutput = \"fan2\"\n[outputs.relay]\noutput = \"part\"\n";
    assert_eq!(levels(moved), [Some(false), Some(true), None, None]);
    assert!(all_off(&board("btt-octopus-1.1")) == all_off(&board("btt-octopus-1.1").for_machine(&profile(""))));
}
