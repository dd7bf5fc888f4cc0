//! A board as the firmware's source: constants, and the linker's memories.

use std::fmt::Write;

use ferrostep_hal_shim::FanOutput;
use ferrostep_printer::Profile;
use ferrostep_stm32f4::registers::Registers;
use ferrostep_stm32f4::sensor_lines::{SensorLines, SensorPin};
use ferrostep_stm32f4::{I2cPins, OutputPin, SpiPins, SupplyPin, TimerChannel};

use crate::board::{Board, CCM_ADDRESS, DriverUart, Eeprom, FLASH_ADDRESS, Motor, RAM_ADDRESS, SupplyOutput};
use crate::clock::{Clock, INTERNAL_HZ};
use crate::fit;
use crate::pin::Pin;
use crate::registers;
use crate::store::Store;

/// KiB at the start of RAM for the stack. A test computes the deepest path through each image and
/// compares it with this.
pub const STACK_KIB: u32 = 23;

/// The same in the images that measure: each counted part puts its own planner on the stack.
pub const MEASURING_STACK_KIB: u32 = 32;

/// The constants that `ferrostep-stm32f4` includes as its module `board`.
pub fn rust(board: &Board) -> String {
    let Board { name, title, crystal_hz, clock, internal_clock, .. } = board;
    let ports = board.motor_ports();
    let has_usb = board.usb.is_some();
    let has_card = board.card.is_some();
    let card_detect = board.card.and_then(|card| card.detect).map(|pin| (pin.port, pin.number));
    let accelerometer = board.accelerometer.map(|plug| {
        let [sck, miso, mosi, cs] = [plug.sck, plug.miso, plug.mosi, plug.cs].map(|pin| (pin.port, pin.number));
        SpiPins { sck, miso, mosi, cs }
    });
    let eeprom = board.eeprom.map(|Eeprom { scl, sda, address, .. }| {
        let [scl, sda] = [scl, sda].map(|pin| (pin.port, pin.number));
        (I2cPins { scl, sda }, address)
    });
    let servo = board.used_servo.map(|pin| (pin.port, pin.number));
    let family = board.chip.family;
    // The core is as fast with either oscillator: each constant below holds for both.
    let Clock { core_hz, apb1_divider, apb2_divider, flash_wait_states, .. } = *clock;
    let [apb1_code, apb2_code] = [apb1_divider, apb2_divider].map(Clock::divider_code);
    let plls = [clock.pll.register(true), internal_clock.pll.register(false)];
    let motor_pin = |pin: Pin| {
        let port = ports.iter().position(|port| *port == pin.port).unwrap_or_default();
        format!("Pin {{ port: {port}, number: {} }}", pin.number)
    };
    let motor_pins = |motor: &Motor| {
        format!("MotorPins {{ step: {}, direction: {} }}", motor_pin(motor.step), motor_pin(motor.direction))
    };
    let motors: Vec<String> = board.motors.iter().map(motor_pins).collect();
    let motors = motors.join(", ");
    let further: Vec<String> =
        board.further_z.iter().map(|(motor, is_inverted)| format!("({}, {is_inverted})", motor_pins(motor))).collect();
    let further = further.join(", ");
    let extruders: Vec<String> =
        board.further_e.iter().map(|(motor, is_inverted)| format!("({}, {is_inverted})", motor_pins(motor))).collect();
    let extruders = extruders.join(", ");
    let enable: Vec<(u8, u8)> = board.moving_motors().map(|motor| (motor.enable.port, motor.enable.number)).collect();
    let settings_bytes = board.settings_bytes();
    let settings_offset = board.flash_kib * 1024 - settings_bytes;
    let ram_end = RAM_ADDRESS + board.ram_kib * 1024;
    let first = registers::first(board);
    format!(
        "/// Its name.\npub const NAME: &str = {name:?};\n\
         /// Its name for people.\npub const TITLE: &str = {title:?};\n\
         /// There is a slot for a memory card.\npub const CARD: bool = {has_card};\n\
         /// Port and number of the pin that is low while a card is in it.\n\
         pub const CARD_DETECT: Option<(u8, u8)> = {card_detect:?};\n\
         /// Pins of the bus to an accelerometer.\n\
         pub const ACCELEROMETER: Option<SpiPins> = {accelerometer:?};\n\
         /// Pins of the bus to an EEPROM, a 24C32, and its address.\n\
         pub const EEPROM: Option<(I2cPins, u8)> = {eeprom:?};\n\
         /// Port and number of the output for a servo, if the machine uses it.\n\
         pub const SERVO: Option<(u8, u8)> = {servo:?};\n\
         /// PA11 and PA12 lead to a USB plug.\npub const USB: bool = {has_usb};\n\
         /// Its chip's registers.\npub const FAMILY: ChipFamily = ChipFamily::{family:?};\n\
         /// Frequency of the core with the PLL, Hz.\npub const CORE_HZ: u32 = {core_hz};\n\
         /// Frequency of the crystal, Hz.\npub const CRYSTAL_HZ: u32 = {crystal_hz};\n\
         /// Frequency of the internal oscillator, Hz.\n\
         pub const INTERNAL_HZ: u32 = {INTERNAL_HZ};\n\
         /// Frequency of the slow bus, Hz.\npub const APB1_HZ: u32 = {};\n\
         /// Frequency of the fast bus, Hz.\npub const APB2_HZ: u32 = {};\n\
         /// RCC_PLLCFGR with the crystal, and with the internal oscillator.\n\
         #[used]\n#[unsafe(no_mangle)]\npub static FERROSTEP_PLL: [u32; 2] = {plls:#x?};\n\
         /// RCC_CFGR's code of the slow bus's divider.\npub const APB1_CODE: u8 = {apb1_code};\n\
         /// RCC_CFGR's code of the fast bus's divider.\npub const APB2_CODE: u8 = {apb2_code};\n\
         /// Wait states of the flash at that frequency.\n\
         pub const FLASH_WAIT_STATES: u8 = {flash_wait_states};\n\
         /// Number of ports that carry step and direction signals.\n\
         pub const MOTOR_PORTS: usize = {};\n\
         /// Those ports: 0 is A.\npub const MOTOR_PORT_INDICES: [u8; MOTOR_PORTS] = {ports:?};\n\
         /// Step and direction pins of X, Y, Z and E.\n\
         pub const MOTORS: [MotorPins; 4] = [{motors}];\n\
         /// Those of further motors of Z; true: runs the other way round than Z's own.\n\
         pub const FURTHER_Z: [(MotorPins, bool); {}] = [{further}];\n\
         /// Those of the extruders of further tools, and whether each runs the other way round.\n\
         pub const FURTHER_E: [(MotorPins, bool); {}] = [{extruders}];\n\
         /// Port and number of the enable pins of all of them; low = on.\n\
         pub const ENABLE: [(u8, u8); {}] = {enable:?};\n\
         /// Flash that settings are kept in (M500): bytes from its start, and bytes; 0: none.\n\
         pub const SETTINGS: [u32; 2] = [{settings_offset:#x}, {settings_bytes:#x}];\n\
         /// RAM.\npub const RAM: core::ops::Range<u32> = {RAM_ADDRESS:#x}..{ram_end:#x};\n{}\
         /// What the image writes before anything else.\n{}\
         /// Heaters off, motors off, fans full, off the USB bus.\n{}\
         /// Motors and serial line ready, fans off.\n{}",
        clock.apb1_hz(),
        clock.apb2_hz(),
        ports.len(),
        board.further_z.len(),
        board.further_e.len(),
        enable.len(),
        thermal(board),
        stores("FIRST", &first),
        stores("ALL_OFF", &registers::all_off(board)),
        stores("PINS", &registers::pins(board)),
    )
}

/// Heaters, fans and thermistors. All thermistors are at one converter, which goes round them in
/// the file's order.
fn thermal(board: &Board) -> String {
    let output = |pin: Pin, timer: &Option<String>| {
        let channel = timer.as_deref().and_then(TimerChannel::named);
        format!("{:?}", OutputPin { port: pin.port, number: pin.number, channel })
    };
    let channels: Vec<u8> = board.thermistors.iter().map(|thermistor| thermistor.channel.channel).collect();
    let sensor = |name: &str| board.thermistors.iter().position(|thermistor| thermistor.name == name);
    let heater = |name: &str| {
        let heater = board.heaters.iter().find(|heater| heater.name == name)?;
        Some((output(heater.pin, &heater.timer), sensor(&heater.sensor)?))
    };
    let chamber_sensor = board.used_chamber.and_then(|(thermistor, _)| sensor(thermistor.name()));
    let chamber = board.used_chamber.and_then(|(_, used)| heater(used?.name()));
    let chamber = chamber.map_or("None".to_owned(), |(output, _)| format!("Some({output})"));
    let nozzle1_sensor = board.used_nozzle.and_then(|(thermistor, _)| sensor(thermistor.name()));
    let nozzle1 = board.used_nozzle.and_then(|(_, used)| heater(used.name()));
    let nozzle1 = nozzle1.map_or("None".to_owned(), |(output, _)| format!("Some({output})"));
    let fans = FanOutput::ALL.map(|of| {
        let fan = board.fans.iter().find(|fan| fan.name == of.name());
        fan.map_or("None".to_owned(), |fan| {
            let tachometer = fan.tacho.map(|pin| (pin.port, pin.number));
            format!("Some(FanPins {{ power: {}, tachometer: {tachometer:?} }})", output(fan.pin, &fan.timer))
        })
    });
    let fans = fans.join(", ");
    let supply = board.used_supply.map(|SupplyOutput { pin, settings }| SupplyPin {
        port: pin.port,
        number: pin.number,
        on_is_low: settings.on_is_low,
    });
    // Most machines have none, and the name of its type would be an unused import.
    let supply = supply.map_or("None".to_owned(), |pin| format!("Some(ferrostep_stm32f4::{pin:?})"));
    let pins = match (heater("nozzle"), heater("bed")) {
        (Some((nozzle, nozzle_sensor)), Some((bed, bed_sensor))) => {
            let number = match board.thermistors.first().map(|thermistor| thermistor.channel.converter) {
                Some(3) => "Three",
                _ => "One",
            };
            format!(
                "{{ use ferrostep_stm32f4::{{ConverterNumber, FanPins, OutputPin, TimerChannel}}; \
                 Some(ThermalPins {{ converter: ConverterNumber::{number}, channels: &{channels:?}, \
                 sensors: [Some({nozzle_sensor}), Some({bed_sensor}), {chamber_sensor:?}, {nozzle1_sensor:?}], \
                 heaters: [Some({nozzle}), Some({bed}), {chamber}, {nozzle1}], fans: [{fans}], supply: {supply} }}) }}"
            )
        }
        _ => "None".to_owned(),
    };
    format!(
        "/// Number of thermistors.\npub const THERMISTORS: usize = {};\n\
         /// Pins of heaters, fans and thermistors; `None` on a board without them.\n\
         pub const THERMAL: Option<ThermalPins> = {pins};\n",
        channels.len()
    )
}

/// Registers that record every store instead of a chip's.
#[derive(Default)]
struct Script(Vec<Store>);

impl Registers for Script {
    fn read(&mut self, _address: u32) -> u32 {
        0
    }

    fn write(&mut self, address: u32, value: u32) {
        self.modify(address, u32::MAX, value);
    }

    fn modify(&mut self, address: u32, clear: u32, set: u32) {
        self.0.push(Store { address, clear, set });
    }

    /// A store without changes represents a read-back.
    fn switch_clocks_on(&mut self, address: u32, clocks: u32) {
        self.modify(address, 0, clocks);
        self.modify(address, 0, clocks);
    }
}

/// The sensors that the axes home with, and the stores that set their pins and interrupt
/// lines up, as items.
pub fn sensors(board: &Board, profile: &Profile) -> String {
    let pins = fit::sensor_pins(board, profile)
        .map(|sensor| sensor.map(|(Pin { port, number }, triggers_low)| SensorPin { port, number, triggers_low }));
    let mut script = Script::default();
    SensorLines::start(pins, &mut script);
    let inputs = [
        fit::filament_pin(board, profile),
        fit::filament_switch_pin(board, profile),
        fit::power_loss_pin(board, profile),
        fit::button_pin(board),
    ];
    let [filament, filament_switch, power_loss, button] =
        inputs.map(|input| input.map(|(Pin { port, number }, triggers_low)| SensorPin { port, number, triggers_low }));
    for pin in [filament, filament_switch, power_loss, button].into_iter().flatten() {
        pin.set_up(&mut script);
    }
    format!(
        "/// The pins of the sensors that X, Y and Z home with.\n\
         pub const SENSORS: [Option<SensorPin>; 3] = {pins:?};\n\
         /// The pin of the filament sensor. A switch triggers when filament is missing.\n\
         pub const FILAMENT: Option<SensorPin> = {filament:?};\n\
         /// The pin of the switch beside a filament sensor that sees filament move.\n\
         pub const FILAMENT_SWITCH: Option<SensorPin> = {filament_switch:?};\n\
         /// The pin that says that the supply fails; it triggers then.\n\
         pub const POWER_LOSS: Option<SensorPin> = {power_loss:?};\n\
         /// The pin of the board's button.\n\
         pub const BUTTON: Option<SensorPin> = {button:?};\n\
         /// Their set-up.\n{}",
        stores("SENSOR_STORES", &script.0)
    )
}

/// The drivers that the profile sets, and the lines to them, as items.
pub fn drivers(board: &Board, profile: &Profile) -> String {
    let wiring = fit::wiring(board, profile);
    let driven = fit::driven(board, profile);
    // In a place without a motor the pin of another one: lines are pulled up.
    let first = driven.first().copied().flatten();
    let pins: Vec<(u8, u8)> = driven
        .into_iter()
        .map(|driven| match (driven.or(first).and_then(|(motor, _)| motor.uart), board.driver_uart) {
            (Some(DriverUart::Pin(pin)), _) | (_, Some(pin)) => (pin.port, pin.number),
            _ => (0, 0),
        })
        .collect();
    let line = match (wiring.iter().any(Option::is_some), board.driver_uart) {
        (false, _) => "NoLine",
        (true, Some(_)) => "SharedLine",
        (true, None) => "OwnLines<DRIVERS>",
    };
    format!(
        "/// Line to the drivers.\n\
         pub type BoardDriverLine = ferrostep_stm32f4_board::driver_line::{line};\n\
         /// Number of motors, the further ones of Z included.\npub const DRIVERS: usize = {};\n\
         /// Port and number of the lines' pins.\n\
         pub const DRIVER_PINS: [(u8, u8); DRIVERS] = {pins:?};\n\
         /// Connections of the drivers that are set.\n\
         pub const DRIVER_WIRING: [Option<ferrostep_tmc2209::DriverWiring>; DRIVERS] = {{\n    \
         #[allow(unused_imports)]\n    use ferrostep_tmc2209::DriverWiring;\n    {wiring:?}\n}};\n",
        wiring.len()
    )
}

fn stores(name: &str, stores: &[Store]) -> String {
    let words = stores.iter().fold(String::new(), |mut text, Store { address, clear, set }| {
        let _ = writeln!(text, "    Store {{ address: {address:#x}, clear: {clear:#x}, set: {set:#x} }},");
        text
    });
    format!("pub static {name}: [Store; {}] = [\n{words}];\n", stores.len())
}

/// The linker's memories, as `memory.x` includes them, with this much of RAM for the stack.
pub fn memories(board: &Board, stack_kib: u32) -> String {
    let flash_length = board.image_room();
    let (stack_length, ram_length) = (stack_kib * 1024, (board.ram_kib - stack_kib) * 1024);
    let ram = RAM_ADDRESS + stack_length;
    format!(
        "/* {}: {} */\nMEMORY\n{{\n    FLASH (rx)  : ORIGIN = {:#x}, LENGTH = {flash_length:#x}\n    \
         STACK (rw)  : ORIGIN = {RAM_ADDRESS:#x}, LENGTH = {stack_length:#x}\n    \
         RAM   (rwx) : ORIGIN = {ram:#x}, LENGTH = {ram_length:#x}\n}}\n",
        board.name,
        board.chip.name,
        board.image_address(),
    )
}

/// Memory that an address lies in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Memory {
    /// Flash.
    Flash,
    /// RAM that everything can reach.
    Ram,
    /// Core-coupled memory, which DMA cannot reach.
    Ccm,
}

impl Memory {
    /// The memory of a board that holds all `bytes` from an address on; `None` if no memory does.
    pub fn of(board: &Board, address: u64, bytes: u64) -> Option<Self> {
        let within = |start: u32, kib: u32| {
            let start = u64::from(start);
            address >= start && address.saturating_add(bytes) <= start + u64::from(kib) * 1024
        };
        let image_end = u64::from(board.image_address()) + u64::from(board.image_room());
        let is_after_boot_loader = address >= u64::from(board.image_address());
        if within(FLASH_ADDRESS, board.flash_kib) && is_after_boot_loader && address.saturating_add(bytes) <= image_end
        {
            Some(Self::Flash)
        } else if within(RAM_ADDRESS, board.ram_kib) {
            Some(Self::Ram)
        } else if within(CCM_ADDRESS, board.ccm_kib) {
            Some(Self::Ccm)
        } else {
            None
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn memories_end_where_the_chip_does() {
        let octopus = crate::load("btt-octopus-1.1").unwrap();
        let text = memories(&octopus, STACK_KIB);
        assert!(text.contains("FLASH (rx)  : ORIGIN = 0x8008000, LENGTH = 0x78000"), "{text}");
        assert!(text.contains("STACK (rw)  : ORIGIN = 0x20000000, LENGTH = 0x5c00"), "{text}");
        assert!(text.contains("RAM   (rwx) : ORIGIN = 0x20005c00, LENGTH = 0x1a400"), "{text}");
        let of = |address, bytes| Memory::of(&octopus, address, bytes);
        assert_eq!(of(0x0800_8000, 0x78000), Some(Memory::Flash));
        // The boot loader's part, beyond the end, and across a border.
        assert_eq!(of(0x0800_0000, 4), None);
        assert_eq!(of(0x0800_8000, 0x78001), None);
        assert_eq!(of(0x2001_fffc, 4), Some(Memory::Ram));
        assert_eq!(of(0x2001_fffd, 4), None);
        assert_eq!(of(0x1000_0000, 4), None);
        let bench = crate::load("bench").unwrap();
        assert_eq!(Memory::of(&bench, 0x1000_0000, 4), Some(Memory::Ccm));
    }

    /// No image reaches into the sectors that settings are kept in, and a debugger's tool
    /// learns the same limit.
    #[test]
    fn images_end_before_the_settings() {
        for (name, length) in [("bench", 0xc_0000), ("prusa-buddy", 0x9_fe00)] {
            let board = crate::load(name).unwrap();
            let text = memories(&board, STACK_KIB);
            assert!(text.contains(&format!("LENGTH = {length:#x}\n")), "{text}");
            assert!(rust(&board).contains("SETTINGS: [u32; 2] = [0xc0000, 0x40000];"));
            assert_eq!(Memory::of(&board, 0x080b_fffc, 4), Some(Memory::Flash));
            assert_eq!(Memory::of(&board, 0x080b_fffd, 4), None);
            assert_eq!(Memory::of(&board, 0x080c_0000, 4), None);
        }
        assert!(rust(&crate::load("btt-octopus-1.1").unwrap()).contains("SETTINGS: [u32; 2] = [0x80000, 0x0];"));
    }
}
