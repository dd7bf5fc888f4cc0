//! Our models of the chip from the firmware's side: registers according to the manual.

#![allow(clippy::unwrap_used)]

use std::collections::BTreeMap;

use rigless::device::Level;
use rigless::emulator::{Error, Memory};
use rigless::mcu::Operate;
use rigless::soc::Width;
use rigless::time::VirtualNanos;

use super::Stm32f4;
use crate::pins::Pin;
use crate::wiring::Chip;

/// A memory that these tests never access.
struct NoMemory;

impl Memory for NoMemory {
    fn read(&mut self, address: u64, width: Width) -> Result<u64, Error> {
        Err(Error::Memory { address, width })
    }
    fn write(&mut self, address: u64, width: Width, _: u64) -> Result<(), Error> {
        Err(Error::Memory { address, width })
    }
}

/// A chip on its internal oscillator, 16 MHz: a tick of every timer is 62.5 ns.
struct Bench {
    chip: Stm32f4,
    now_ns: u64,
    lines: BTreeMap<u16, bool>,
}

const RCC: u64 = 0x4002_3800;
const SYSCFG: u64 = 0x4001_3800;
const EXTI: u64 = 0x4001_3C00;
const TIM2: u64 = 0x4000_0000;
const TIM7: u64 = 0x4000_1400;
const TIM9: u64 = 0x4001_4000;
const TIM13: u64 = 0x4000_1C00;
// Registers of all timers (RM0090 tables 99 to 103).
const CR1: u64 = 0x00;
const CR2: u64 = 0x04;
const SMCR: u64 = 0x08;
const DIER: u64 = 0x0C;
const SR: u64 = 0x10;
const CCMR1: u64 = 0x18;
const CCER: u64 = 0x20;
const CNT: u64 = 0x24;
const PSC: u64 = 0x28;
const ARR: u64 = 0x2C;
const CCR1: u64 = 0x34;

impl Bench {
    fn new(model: Chip) -> Self {
        let mut bench = Self { chip: Stm32f4::new(model).unwrap(), now_ns: 0, lines: BTreeMap::new() };
        bench.chip.set_interrupt_entry(0);
        // All clocks on: ports, timers, SYSCFG (6.3.10, 6.3.13, 6.3.14).
        bench.write(RCC + 0x30, 0x0000_01FF);
        bench.write(RCC + 0x40, 0x0000_01FF);
        bench.write(RCC + 0x44, 0x0007_4003);
        bench
    }

    fn settle(&mut self) {
        self.chip.settle(&mut NoMemory).unwrap();
        for change in self.chip.drain_lines() {
            self.lines.insert(change.line.index(), change.level == Level::High);
        }
    }

    fn write(&mut self, address: u64, value: u64) {
        self.chip.write(VirtualNanos(self.now_ns), address, Width::W32, value).unwrap();
        self.settle();
    }

    fn read(&mut self, address: u64) -> u64 {
        let value = self.chip.read(VirtualNanos(self.now_ns), address, Width::W32).unwrap();
        self.settle();
        value
    }

    /// Advances time, event by event.
    fn pass(&mut self, ns: u64) {
        let end_ns = self.now_ns + ns;
        while let Some(next) = self.chip.next_event().filter(|next| next.0 <= end_ns) {
            self.now_ns = next.0;
            self.chip.advance_to(next);
            self.settle();
        }
        self.now_ns = end_ns;
    }

    fn drive(&mut self, pin: &str, level: bool) {
        let pin: Pin = pin.parse().unwrap();
        self.chip.drive_pin(VirtualNanos(self.now_ns), pin, Some(level));
        self.settle();
    }

    /// Drives pins low, like a board does from the start on.
    fn drive_low(&mut self, pins: &[&str]) {
        pins.iter().for_each(|pin| self.drive(pin, false));
    }

    fn line(&self, line: u16) -> bool {
        self.lines.get(&line).copied().unwrap_or(false)
    }
}

#[test]
fn a_line_follows_the_selected_port() {
    let mut bench = Bench::new(Chip::F407);
    bench.write(EXTI, 1 << 3); // IMR
    bench.write(EXTI + 0x08, 1 << 3); // RTSR
    bench.write(SYSCFG + 0x08, 4 << 12); // EXTICR1: line 3 is port E
    bench.drive_low(&["PD3", "PE3"]);
    bench.drive("PD3", true);
    assert!(!bench.line(9));
    bench.drive("PE3", true);
    assert!(bench.line(9));
    assert_eq!(bench.read(EXTI + 0x14), 1 << 3);
}

#[test]
fn an_edge_sets_pending_by_its_direction() {
    let mut bench = Bench::new(Chip::F407);
    bench.write(EXTI + 0x0C, 1 << 1); // FTSR
    bench.drive("PA1", true);
    assert_eq!(bench.read(EXTI + 0x14), 0);
    bench.drive("PA1", false);
    assert_eq!(bench.read(EXTI + 0x14), 1 << 1);
    bench.write(EXTI + 0x0C, 0);
    bench.write(EXTI + 0x14, 1 << 1);
    bench.drive("PA1", true);
    bench.drive("PA1", false);
    assert_eq!(bench.read(EXTI + 0x14), 0, "neither edge is asked for");
}

#[test]
fn a_masked_line_is_pending_and_silent() {
    let mut bench = Bench::new(Chip::F446);
    bench.write(EXTI + 0x08, 1);
    bench.drive_low(&["PA0"]);
    bench.drive("PA0", true);
    assert_eq!(bench.read(EXTI + 0x14), 1);
    assert!(!bench.line(6));
    bench.write(EXTI, 1);
    assert!(bench.line(6));
}

#[test]
fn a_written_one_clears_pending() {
    let mut bench = Bench::new(Chip::F407);
    bench.write(EXTI, 0xFFFF);
    bench.write(EXTI + 0x08, 0xFFFF);
    bench.drive_low(&["PA2", "PA4"]);
    bench.drive("PA2", true);
    bench.drive("PA4", true);
    bench.write(EXTI + 0x14, 1 << 2);
    assert_eq!(bench.read(EXTI + 0x14), 1 << 4);
    assert!(!bench.line(8) && bench.line(10));
}

#[test]
fn software_makes_a_line_pending() {
    let mut bench = Bench::new(Chip::F407);
    bench.write(EXTI, 1 << 7);
    bench.write(EXTI + 0x10, 1 << 7); // SWIER
    assert!(bench.line(23));
    bench.write(EXTI + 0x14, 1 << 7);
    assert!(!bench.line(23));
    assert_eq!(bench.read(EXTI + 0x10), 0);
}

#[test]
fn lines_share_interrupts() {
    let mut bench = Bench::new(Chip::F407);
    bench.write(EXTI, 0xFFFF);
    for (line, interrupt) in [(0, 6), (1, 7), (2, 8), (3, 9), (4, 10), (5, 23), (9, 23), (10, 40), (15, 40)] {
        bench.write(EXTI + 0x10, 1 << line);
        assert!(bench.line(interrupt), "line {line}");
        bench.write(EXTI + 0x14, 1 << line);
        assert!(!bench.line(interrupt), "line {line}");
    }
}

#[test]
fn a_basic_timer_counts_and_interrupts() {
    let mut bench = Bench::new(Chip::F407);
    bench.write(TIM7 + PSC, 15);
    bench.write(TIM7 + ARR, 99);
    bench.write(TIM7 + 0x14, 1); // EGR: the prescaler takes effect
    bench.write(TIM7 + SR, 0);
    bench.write(TIM7 + DIER, 1);
    bench.write(TIM7 + CR1, 1);
    bench.pass(99_000);
    assert!(!bench.line(55) && bench.read(TIM7 + CNT) == 99);
    bench.pass(1_000);
    assert!(bench.line(55));
    bench.write(TIM7 + SR, 0);
    assert!(!bench.line(55));
    bench.pass(100_000);
    assert!(bench.line(55));
}

#[test]
fn timers_with_one_and_two_channels_output_their_waves() {
    let mut bench = Bench::new(Chip::F407);
    for timer in [TIM9, TIM13] {
        bench.write(timer + ARR, 199);
        bench.write(timer + CCR1, 50);
        bench.write(timer + CCMR1, 0b110 << 4); // PWM mode 1
        bench.write(timer + CCER, 1);
        bench.write(timer + 0x14, 1);
        bench.write(timer + SR, 0);
        bench.write(timer + CR1, 1);
        bench.pass(3_200); // 51 ticks and a little
        assert_eq!(bench.read(timer + SR) & 0b10, 0b10, "its compare has matched");
        bench.pass(62_500);
        assert_eq!(bench.read(timer + SR) & 1, 1, "and it has come round");
    }
    // TIM9 has a second channel; TIM13 lacks it and its register.
    bench.write(TIM9 + 0x38, 7);
    assert_eq!(bench.read(TIM9 + 0x38), 7);
    assert!(bench.chip.write(VirtualNanos(0), TIM13 + 0x38, Width::W32, 7).is_err());
}

fn step_timer(bench: &mut Bench, period: u64) {
    bench.write(TIM9 + ARR, 0x7FFF);
    bench.write(TIM9 + SMCR, 0b111); // external clock mode 1, ITR0
    bench.write(TIM9 + CR1, 1);
    bench.write(TIM2 + CR2, 0b010 << 4); // update as trigger output
    bench.write(TIM2 + ARR, period - 1);
    bench.write(TIM2 + CR1, 1 | 1 << 7);
}

#[test]
fn tim9_counts_the_updates_of_tim2() {
    let mut bench = Bench::new(Chip::F446);
    step_timer(&mut bench, 160); // 10 us
    bench.write(TIM2 + DIER, 1);
    bench.pass(1_000_100);
    assert_eq!(bench.read(TIM9 + CNT), 100);
    assert!(bench.line(28));
}

#[test]
fn a_rested_timer_has_the_count_of_a_running_one() {
    let mut bench = Bench::new(Chip::F407);
    step_timer(&mut bench, 1_000); // 62.5 us
    bench.pass(500_000);
    assert_eq!(bench.read(TIM9 + CNT), 8);
    bench.write(TIM2 + SR, 0);
    bench.pass(100_000_000);
    // It has rested and has no event for a long time; a read returns the count of a running timer.
    assert!(bench.chip.next_event().is_none_or(|next| next.0 > bench.now_ns + 62_500));
    let count = bench.read(TIM2 + CNT);
    let ticks = (bench.now_ns as u128 * 16 / 1_000 % 1_000) as u64;
    assert!(count.abs_diff(ticks) <= 1, "{count} of {ticks}");
    assert_eq!(bench.read(TIM2 + SR) & 1, 1);
    let before = bench.read(TIM9 + CNT);
    bench.pass(625_000);
    assert_eq!(bench.read(TIM9 + CNT), before + 10, "awake, it tells its slave again");
}

#[test]
fn a_reload_is_taken_at_the_next_update() {
    let mut bench = Bench::new(Chip::F407);
    step_timer(&mut bench, 160);
    bench.write(TIM2 + DIER, 1);
    bench.pass(5_000);
    bench.write(TIM2 + ARR, 319); // preloaded: 18.3.1
    bench.pass(5_100);
    bench.write(TIM2 + SR, 0);
    bench.pass(19_000);
    assert!(!bench.line(28), "20 us from the update on");
    bench.pass(1_000);
    assert!(bench.line(28));
}

#[test]
fn the_core_enters_the_step_interrupt_after_its_delay() {
    let mut bench = Bench::new(Chip::F407);
    bench.chip.set_interrupt_entry(71);
    step_timer(&mut bench, 160);
    bench.write(TIM2 + DIER, 1);
    bench.pass(10_010);
    assert!(!bench.line(28) && bench.chip.is_entering());
    bench.pass(71);
    assert!(bench.line(28) && !bench.chip.is_entering());
    // A request that its timer withdraws meanwhile does not arrive.
    bench.write(TIM2 + SR, 0);
    assert!(!bench.line(28));
    bench.pass(9_950);
    bench.write(TIM2 + SR, 0);
    bench.pass(1_000);
    assert!(!bench.line(28));
}

#[test]
fn chips_have_the_memories_and_registers_of_their_manuals() {
    for (model, flash, has_ccm, id) in
        [(Chip::F405, 1024, true, 0x413), (Chip::F407, 1024, true, 0x413), (Chip::F446, 512, false, 0x421)]
    {
        let mut bench = Bench::new(model);
        let memory = rigless::mcu::Mcu::bus(&bench.chip).memory();
        let of = |name: &str| memory.iter().find(|region| region.name == name).map(|region| region.size >> 10);
        assert_eq!((of("flash"), of("ccm").is_some(), of("sram")), (Some(flash), has_ccm, Some(128)));
        assert_eq!(bench.read(0xE004_2000) & 0xFFF, id);
        // Only the F427 has UART7; only the F446 has DCKCFGR2.
        assert!(bench.chip.read(VirtualNanos(0), 0x4000_7800, Width::W32).is_err());
        assert_eq!(bench.chip.read(VirtualNanos(0), RCC + 0x94, Width::W32).is_ok(), model == Chip::F446);
    }
}
