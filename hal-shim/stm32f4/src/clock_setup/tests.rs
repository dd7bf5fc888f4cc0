//! The start of the clock on a chip that exists in memory, after reset and after a boot loader.

use super::*;
use crate::clock_tree::{ClockSource, start_best};
use crate::registers::recorder::{Recorder, Sluggish};

/// All registers that this module states.
const STATED: [u32; 10] = [CR, CFGR, CIR, SSCGR, DCKCFGR, CKGATENR, DCKCFGR2, PWR_CR, FLASH_ACR, PLLCFGR];

/// The Buddy board's, and the Octopus's.
const SETTINGS: [ClockSettings; 2] = [
    ClockSettings {
        family: ChipFamily::F405,
        pll: [0x2740_2a06, 0x2700_5408],
        apb1_code: 0b101,
        apb2_code: 0b100,
        flash_wait_states: 5,
    },
    ClockSettings {
        family: ChipFamily::F446,
        pll: [0x2740_2a06, 0x2700_5408],
        apb1_code: 0b101,
        apb2_code: 0b100,
        flash_wait_states: 5,
    },
];

/// A chip whose flags follow its switches, unless they are broken.
#[derive(Clone, Debug, Default)]
struct Chip {
    recorder: Recorder,
    crystal_is_broken: bool,
    pll_is_broken: bool,
    regulator_is_broken: bool,
    flash_is_broken: bool,
    /// CFGR's last store, and the looks at it since.
    looks_since_dividers: u32,
}

impl Chip {
    /// A chip as reset leaves it, or with every register full of ones: on a PLL, prescalers
    /// at their largest.
    fn new(fill: Option<u32>) -> Self {
        let recorder = STATED.into_iter().fold(Recorder::default(), |recorder, register| {
            let at_reset = match register {
                CR => 0x81,
                PLLCFGR => 0x2400_3010,
                PWR_CR => 1 << 14,
                _ => 0,
            };
            recorder.with(register, fill.unwrap_or(at_reset))
        });
        Self { recorder, ..Self::default() }
    }

    /// Source of the core's clock, as CFGR codes it.
    fn switched_to(&self) -> u32 {
        self.recorder.value(CFGR) & SW
    }
}

impl Registers for Chip {
    fn read(&mut self, address: u32) -> u32 {
        let value = self.recorder.read(address);
        let cr = self.recorder.value(CR);
        match address {
            CR => {
                let on = value & (HSION | HSEON | PLLON | OTHERS_ON);
                let broken =
                    if self.crystal_is_broken { HSEON } else { 0 } | if self.pll_is_broken { PLLON } else { 0 };
                value & !(HSIRDY | HSERDY | PLLRDY | OTHERS_READY) | (on & !broken) << 1
            }
            CFGR => {
                self.looks_since_dividers += 1;
                value & !SWS | (value & SW) << 2
            }
            // The regulator follows while the PLL is on.
            PWR_CSR if cr & PLLON != 0 && !self.regulator_is_broken => VOSRDY,
            FLASH_ACR if self.flash_is_broken => 0,
            _ => value,
        }
    }

    fn write(&mut self, address: u32, value: u32) {
        let (cr, before) = (self.recorder.value(CR), self.recorder.value(address));
        let changes = |bits: u32| (value ^ before) & bits != 0;
        match address {
            PLLCFGR => assert_eq!(cr & PLLON, 0, "the PLL's numbers while it runs"),
            PWR_CR if changes(0b11 << 14) => assert_eq!(cr & PLLON, 0, "the voltage's scale while the PLL runs"),
            CR if changes(1 << 18) => assert_eq!(cr & HSEON, 0, "the bypass while the crystal is on"),
            CR if before & PLLON != 0 && value & PLLON == 0 => assert_ne!(self.switched_to(), SW_PLL, "the PLL in use"),
            CFGR => {
                assert!(!changes(SW) || value & !SW == before & !SW, "{value:#x}: dividers and switch in one store");
                if value & SW == SW_PLL && changes(SW) {
                    assert!(self.looks_since_dividers >= 16, "the dividers are not in effect yet");
                    assert_eq!(self.recorder.value(FLASH_ACR) & LATENCY, 5, "flash is too slow");
                    assert_ne!(self.recorder.value(PWR_CR) & 1 << 14, 0, "the voltage is too low");
                }
                self.looks_since_dividers = 0;
            }
            _ => {}
        }
        self.recorder.write(address, value);
    }
}

fn start(mut chip: Chip, settings: ClockSettings) -> (ClockSource, Chip) {
    let mut clock = ClockRegisters::start_internal(&mut chip, settings);
    let source = start_best(&mut clock);
    (source, chip)
}

/// The registers that both chips have, with those that an STM32F446 has besides.
fn stated(settings: ClockSettings) -> impl Iterator<Item = u32> {
    let is_its =
        move |register: &u32| settings.family == ChipFamily::F446 || ![DCKCFGR, CKGATENR, DCKCFGR2].contains(register);
    STATED.into_iter().filter(is_its)
}

#[test]
fn whatever_a_boot_loader_left_the_clock_is_the_same() {
    for settings in SETTINGS {
        for (break_it, expected) in [
            ((|_| ()) as fn(&mut Chip), ClockSource::Crystal),
            (|chip: &mut Chip| chip.crystal_is_broken = true, ClockSource::InternalWithPll),
            (|chip: &mut Chip| chip.pll_is_broken = true, ClockSource::Internal),
            (|chip: &mut Chip| chip.regulator_is_broken = true, ClockSource::Internal),
            (|chip: &mut Chip| chip.flash_is_broken = true, ClockSource::Internal),
        ] {
            let started = [None, Some(u32::MAX)].map(|fill| {
                let mut chip = Chip::new(fill);
                break_it(&mut chip);
                let (source, mut chip) = start(chip, settings);
                assert_eq!(source, expected, "{settings:?} {fill:x?}");
                stated(settings).map(|register| (register, chip.read(register))).collect::<Vec<_>>()
            });
            let [after_reset, after_loader] = started;
            assert_eq!(after_reset, after_loader, "{settings:x?} {expected:?}");
        }
    }
}

#[test]
fn registers_have_the_values_of_the_manual() {
    for settings in SETTINGS {
        let (_, chip) = start(Chip::new(Some(u32::MAX)), settings);
        let value = |register| chip.recorder.value(register);
        // HSI and its trim, crystal, clock security, PLL.
        assert_eq!(value(CR) & !(HSIRDY | HSERDY | PLLRDY | OTHERS_READY), 0x0109_0081);
        assert_eq!(value(CFGR) & !SWS, 0b10 | 0b101 << 10 | 0b100 << 13);
        assert_eq!((value(PLLCFGR), value(SSCGR), value(FLASH_ACR)), (0x2740_2a06, 0, 0x705));
        assert_eq!(value(CIR) & 0xffff, 0);
        let is_446 = settings.family == ChipFamily::F446;
        assert_eq!(value(PWR_CR), if is_446 { 0xc000 } else { 0x4000 });
        for register in [0x4002_388c, 0x4002_3890, 0x4002_3894] {
            // An STM32F405 has none of them: they are not written to there.
            assert_eq!(chip.recorder.stored(register), if is_446 { vec![0] } else { vec![] }, "{register:#x}");
        }
        let caches_emptied = chip.recorder.position(FLASH_ACR, CACHES_EMPTY).unwrap();
        assert!(caches_emptied < chip.recorder.position(FLASH_ACR, CACHES_ON).unwrap());
    }
}

/// CSSON follows the switch to the PLL and is set with the crystal only: the internal oscillator is
/// not watched, and a fault would be called at once.
#[test]
fn the_crystal_is_watched_once_the_core_runs_from_it() {
    let (source, chip) = start(Chip::new(None), SETTINGS[0]);
    assert_eq!(source, ClockSource::Crystal);
    let switched = chip.recorder.position(CFGR, SW_PLL).unwrap();
    assert!(chip.recorder.position(CR, CSSON).unwrap() > switched);
    for (crystal_is_broken, pll_is_broken) in [(true, false), (false, true), (true, true)] {
        let (source, chip) = start(Chip { crystal_is_broken, pll_is_broken, ..Chip::new(None) }, SETTINGS[0]);
        assert_ne!(source, ClockSource::Crystal);
        assert_eq!((chip.recorder.position(CR, CSSON), chip.recorder.value(CR) & HSEON), (None, 0), "{source:?}");
    }
}

#[test]
fn a_stopped_crystal_is_known_by_its_flag() {
    let mut registers = Recorder::default();
    assert!(!crystal_has_stopped(&mut registers));
    registers.fix(0x4002_380c, 1 << 7);
    assert!(crystal_has_stopped(&mut registers));
}

/// PWR_CR is read back after its clock is switched on; otherwise its store, and with it the
/// voltage's scale, would be lost.
#[test]
fn the_voltage_is_chosen_also_where_clocks_start_late() {
    for settings in SETTINGS {
        let mut late = Sluggish::new(Chip::new(Some(0)));
        start_best(&mut ClockRegisters::start_internal(&mut late, settings));
        assert_eq!(late.lost, 0);
        assert_eq!(late.registers.recorder.value(PWR_CR), settings.scale_1());
    }
}

/// 84 MHz become 8 MHz on the host's line, 16 MHz divided by 2: the last words are read at the
/// speed of before.
#[test]
fn the_serial_line_keeps_its_speed_without_the_crystal() {
    for baud in [9_600, 115_200, 250_000] {
        let before = (84_000_000 + baud / 2) / baud;
        let divider = divider_without_crystal(before as u16, 168_000_000, 16_000_000);
        let error = (8_000_000.0 / f64::from(divider) / f64::from(baud) - 1.0).abs();
        assert!(error < 0.02, "{baud}: {divider}");
    }
    assert_eq!(divider_without_crystal(1, 168_000_000, 16_000_000), 1);
    assert_eq!(divider_without_crystal(u16::MAX, 0, u32::MAX), u16::MAX);
}
