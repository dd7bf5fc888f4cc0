//! Registers as a boot loader may have left them: every one full of ones, and then the image's own
//! start. It must end with the very values that it has from reset.

use std::collections::BTreeMap;

use ferrostep_boards::Store;
use ferrostep_boards::registers::{first, pins};
use ferrostep_boards::{Board, builtin_names, load};
use ferrostep_stm32f4::clock_tree::{ClockSource, start_best};
use ferrostep_stm32f4::registers::Registers;
use ferrostep_stm32f4::{ChipFamily, ClockRegisters, ClockSettings};

const RCC: u32 = 0x4002_3800;
const PWR_CR: u32 = 0x4000_7000;
const PWR_CSR: u32 = 0x4000_7004;
const GPIOA: u32 = 0x4002_0000;

/// First addresses of the peripherals of the buses APB1 and APB2: 1 KiB each, in the order of the
/// bits that reset them.
const BUSES: [(u32, u32); 2] = [(RCC + 0x20, 0x4000_0000), (RCC + 0x24, 0x4001_0000)];

/// The bits of RCC_AHB1RSTR that reset the DMA controllers, and where they are.
const DMA: [(u32, u32); 2] = [(21, 0x4002_6000), (22, 0x4002_6400)];

/// Values after reset other than 0 (RM0090 5.4, 7.3, 3.9, RM0390 the same but for the
/// clocks in sleep).
fn after_reset(address: u32, family: ChipFamily) -> u32 {
    let is_446 = family == ChipFamily::F446;
    let sleep: [u32; 5] = match family {
        ChipFamily::F405 => [0x7e67_91ff, 0xf1, 0x1, 0x36fe_c9ff, 0x0007_5f33],
        ChipFamily::F446 => [0x6067_90ff, 0x81, 0x3, 0x3fff_c9ff, 0x00c7_7f33],
    };
    match address - RCC.min(address) {
        0x00 => 0x81,
        0x04 => 0x2400_3010,
        0x30 => 1 << 20,
        0x50 => sleep[0],
        0x54 => sleep[1],
        0x58 => sleep[2],
        0x60 => sleep[3],
        0x64 => sleep[4],
        _ if address == PWR_CR => {
            if is_446 {
                0xc000
            } else {
                0x4000
            }
        }
        _ => 0,
    }
}

/// A chip in memory.
struct Chip {
    family: ChipFamily,
    values: BTreeMap<u32, u32>,
    /// Value of all registers that have not been stored to; `None`: their reset values.
    fill: Option<u32>,
}

impl Chip {
    fn value(&self, address: u32) -> u32 {
        let untouched = || self.fill.unwrap_or_else(|| after_reset(address, self.family));
        self.values.get(&address).copied().unwrap_or_else(untouched)
    }

    fn apply(&mut self, stores: &[Store]) {
        for Store { address, clear, set } in stores {
            self.modify(*address, *clear, *set);
        }
    }

    /// Resets a part of 1 KiB: its stored values are lost.
    fn reset(&mut self, start: u32) {
        self.values.extend((start..start + 0x400).step_by(4).map(|address| (address, 0)));
    }
}

impl Registers for Chip {
    fn read(&mut self, address: u32) -> u32 {
        let value = self.value(address);
        match address {
            // Each switch of CR has its flag one bit higher, and SWS follows SW.
            RCC => {
                let on = value & (1 << 0 | 1 << 16 | 1 << 24 | 1 << 26 | 1 << 28);
                value & !(on_flags()) | on << 1
            }
            _ if address == RCC + 0x08 => value & !0b1100 | (value & 0b11) << 2,
            PWR_CSR => 1 << 14,
            _ => value,
        }
    }

    fn write(&mut self, address: u32, value: u32) {
        let is_set = |bit: &u32| value >> bit & 1 == 1;
        if let Some((_, bus)) = BUSES.into_iter().find(|(register, _)| *register == address) {
            (0..32).filter(is_set).for_each(|part| self.reset(bus + 0x400 * part));
        } else if address == RCC + 0x10 {
            DMA.into_iter().filter(|(bit, _)| is_set(bit)).for_each(|(_, start)| self.reset(start));
        }
        self.values.insert(address, value);
    }
}

fn on_flags() -> u32 {
    1 << 1 | 1 << 17 | 1 << 25 | 1 << 27 | 1 << 29
}

/// A chip after the image's start: the first instructions, the clock, the pins.
fn started(board: &Board, fill: Option<u32>) -> Chip {
    let mut chip = Chip { family: board.chip.family, values: BTreeMap::new(), fill };
    chip.apply(&first(board));
    let settings = ClockSettings {
        family: board.chip.family,
        pll: [board.clock.pll.register(true), board.internal_clock.pll.register(false)],
        apb1_code: 0b101,
        apb2_code: 0b100,
        flash_wait_states: 5,
    };
    assert_eq!(start_best(&mut ClockRegisters::start_internal(&mut chip, settings)), ClockSource::Crystal);
    chip.apply(&pins(board));
    chip
}

/// Registers that the firmware relies on: the clock and its prescalers, power, flash, timers,
/// serial lines, converters, DMA, sensors' interrupt lines.
fn relied_on(family: ChipFamily) -> Vec<u32> {
    // CR, PLLCFGR, CFGR, CIR; resets; clocks, also in sleep; SSCGR.
    let mut registers: Vec<u32> = [0x00, 0x04, 0x08, 0x0c, 0x80].map(|offset| RCC + offset).to_vec();
    for base in [0x10, 0x30, 0x50] {
        registers.extend([0x00, 0x04, 0x08, 0x10, 0x14].map(|offset| RCC + base + offset));
    }
    if family == ChipFamily::F446 {
        registers.extend([0x8c, 0x90, 0x94].map(|offset| RCC + offset));
    }
    registers.extend([PWR_CR, 0x4002_3c00]);
    // The core's timer, its memory protection, and how it sleeps.
    registers.extend([0xe000_e010, 0xe000_ed94, 0xe000_ed10]);
    // TIM2, TIM3, TIM4, TIM5, TIM7, TIM12; TIM1, TIM8, TIM9; USART2 and USART1; ADC1 to ADC3; SDIO;
    // SYSCFG; DMA1 and DMA2.
    let parts = [
        0x4000_0000,
        0x4000_0400,
        0x4000_0800,
        0x4000_0c00,
        0x4000_1400,
        0x4000_1800,
        0x4001_0000,
        0x4001_0400,
        0x4001_4000,
        0x4000_4400,
        0x4001_1000,
        0x4001_2000,
        0x4001_2c00,
        0x4001_3800,
        0x4002_6000,
        0x4002_6400,
    ];
    registers.extend(parts.into_iter().flat_map(|part| (part..part + 0x50).step_by(4)));
    registers.extend([0x00, 0x04, 0x08, 0x0c].map(|offset| 0x4001_3c00 + offset));
    registers
}

#[test]
fn a_start_after_a_boot_loader_ends_as_one_from_reset() {
    for board in builtin_names().map(|name| load(name).unwrap()) {
        let [mut clean, mut used] = [None, Some(u32::MAX)].map(|fill| started(&board, fill));
        for register in relied_on(board.chip.family) {
            assert_eq!(used.read(register), clean.read(register), "{}: {register:#x}", board.name);
        }
    }
}

/// Ports are not reset, for their pins hold heaters and motors off. So each pin that the board uses
/// is stated in full: mode, push-pull or not, speed of the signals, pull.
#[test]
fn pins_that_are_used_do_not_depend_on_who_had_them_before() {
    for board in builtin_names().map(|name| load(name).unwrap()) {
        let [mut clean, mut used] = [None, Some(u32::MAX)].map(|fill| started(&board, fill));
        let motors = board.motors.iter().flat_map(|motor| [motor.step, motor.direction]);
        let enable = board.all_motors().map(|motor| motor.enable);
        let heaters = board.heaters.iter().map(|heater| heater.pin);
        let fans = board.fans.iter().map(|fan| fan.pin);
        let thermistors = board.thermistors.iter().map(|thermistor| thermistor.pin);
        let outputs: Vec<_> = motors.clone().chain(enable).chain(heaters).chain(fans).chain(board.serial).collect();
        let mut field = |pin: ferrostep_boards::Pin, offset: u32, width: u32| {
            let address = GPIOA + 0x400 * u32::from(pin.port) + offset;
            [&mut clean, &mut used]
                .map(|chip| chip.read(address) >> (width * u32::from(pin.number)) & ((1 << width) - 1))
        };
        for pin in outputs.iter().copied().chain(thermistors) {
            for (what, offset, width) in [("mode", 0x00, 2), ("pull", 0x0c, 2)] {
                let [clean, used] = field(pin, offset, width);
                assert_eq!(used, clean, "{}: {what} of {pin}", board.name);
            }
        }
        for pin in outputs {
            assert_eq!(field(pin, 0x04, 1), [0, 0], "{}: {pin} drives both levels", board.name);
        }
        for pin in motors {
            assert_eq!(field(pin, 0x08, 2), [0, 0], "{}: {pin} has slow edges", board.name);
        }
    }
}

/// The heaters' ports are held throughout: no reset reaches a port, and none comes before heaters
/// and motors are off.
#[test]
fn nothing_is_reset_that_holds_a_heater_off() {
    for board in builtin_names().map(|name| load(name).unwrap()) {
        let first = first(&board);
        let resets: Vec<usize> =
            (0..first.len()).filter(|&index| (RCC + 0x10..=RCC + 0x24).contains(&first[index].address)).collect();
        // Set and cleared, five registers.
        assert_eq!(resets.len(), 10, "{}", board.name);
        let is_port = |store: &Store| (GPIOA..GPIOA + 0x2000).contains(&store.address);
        let last_port = first.iter().rposition(is_port).unwrap();
        assert!(last_port < resets[0], "{}: a port is set up after a reset", board.name);
        for &index in &resets {
            let Store { address, set, .. } = first[index];
            if address == RCC + 0x10 {
                assert_eq!(set & 0x7ff, 0, "{}: a port is reset", board.name);
            }
            // The power control keeps the voltage's scale while a loader's PLL runs.
            assert!(address != RCC + 0x20 || set & 1 << 28 == 0, "{}", board.name);
        }
        // The backup domain and the flags of the reset's cause.
        assert!(first.iter().all(|store| ![RCC + 0x70, RCC + 0x74].contains(&store.address)), "{}", board.name);
    }
}
