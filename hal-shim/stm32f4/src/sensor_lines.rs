//! The pins of the sensors that axes home with, and their interrupt lines (EXTI).
//!
//! One line at a time is open, and only while its axis seeks its home. Addresses and bits: RM0090
//! 2.3 (memory map), 7.3.10 and 7.3.14 (RCC), 8.4 (GPIO), 9.2 (SYSCFG), 12.3 (EXTI); RM0390 is the
//! same in all of it.

use ferrostep_register_address::register;

use crate::gpio::{IDR, MODER, PULL_UP, PUPDR, port};
use crate::rcc::{RCC_AHB1ENR, RCC_APB2ENR};
use crate::registers::Registers;

const SYSCFG_CLOCK: u32 = 1 << 14;
const SYSCFG_EXTICR1: u32 = register!(SYSCFG.exticr1);
const EXTI_IMR: u32 = register!(EXTI.imr);
const EXTI_RTSR: u32 = register!(EXTI.rtsr);
const EXTI_FTSR: u32 = register!(EXTI.ftsr);
const EXTI_PR: u32 = register!(EXTI.pr);

/// Samples of a pin that must all agree, some tens of nanoseconds apart: a spike must not
/// count as an end stop.
const LOOKS: u32 = 8;

/// A sensor's pin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SensorPin {
    /// Port of the pin: 0 is A.
    pub port: u8,
    /// Number of the pin there, 0 to 15, which is also its interrupt line.
    pub number: u8,
    /// True if its level is low when the sensor triggers.
    pub triggers_low: bool,
}

impl SensorPin {
    /// A register of its port.
    const fn of_port(self, offset: u32) -> u32 {
        port(self.port) + offset
    }

    const fn bit(self) -> u32 {
        1 << (self.number & 15)
    }

    /// Makes the pin an input with a pull-up, so that a broken wire reads as high.
    pub fn set_up(self, registers: &mut impl Registers) {
        let line = u32::from(self.number & 15);
        registers.switch_clocks_on(RCC_AHB1ENR, 1 << self.port);
        registers.modify(self.of_port(PUPDR), 0b11 << (2 * line), PULL_UP << (2 * line));
        registers.modify(self.of_port(MODER), 0b11 << (2 * line), 0);
    }

    /// Returns true if the sensor is triggered now, by several samples that all agree: a
    /// spike does not count.
    pub fn is_triggered(self, registers: &mut impl Registers) -> bool {
        (0..LOOKS).all(|_| {
            let is_high = registers.read(self.of_port(IDR)) & self.bit() != 0;
            is_high != self.triggers_low
        })
    }
}

/// The sensors of X, Y and Z.
#[derive(Clone, Copy, Debug)]
pub struct SensorLines {
    pins: [Option<SensorPin>; 3],
}

impl SensorLines {
    /// Makes the pins inputs with pull-ups, so that a broken wire reads as high, and connects their
    /// interrupt lines to the edge at which they trigger. All lines stay closed.
    pub fn start(pins: [Option<SensorPin>; 3], registers: &mut impl Registers) -> Self {
        registers.switch_clocks_on(RCC_APB2ENR, SYSCFG_CLOCK);
        registers.write(EXTI_IMR, 0);
        for pin in pins.into_iter().flatten() {
            pin.set_up(registers);
            let line = u32::from(pin.number & 15);
            let place = line % 4 * 4;
            registers.modify(SYSCFG_EXTICR1 + line / 4 * 4, 0xf << place, u32::from(pin.port) << place);
            let (at, not_at) = if pin.triggers_low { (EXTI_FTSR, EXTI_RTSR) } else { (EXTI_RTSR, EXTI_FTSR) };
            registers.modify(at, 0, pin.bit());
            registers.modify(not_at, pin.bit(), 0);
        }
        Self::started(pins)
    }

    /// Lines whose pins are set up: by the stores of [`Self::start`], which a build
    /// script recorded.
    pub const fn started(pins: [Option<SensorPin>; 3]) -> Self {
        Self { pins }
    }

    /// Returns true if the sensor of an axis is triggered now, by as many samples as in the
    /// interrupt, so that a spike does not end an approach before it begins. `false`
    /// without a sensor.
    pub fn is_triggered(&self, axis: usize, registers: &mut impl Registers) -> bool {
        self.pins.get(axis).copied().flatten().is_some_and(|pin| pin.is_triggered(registers))
    }

    /// Opens the line of an axis alone: from now on its edge interrupts.
    pub fn open(&self, axis: usize, registers: &mut impl Registers) {
        if let Some(pin) = self.pins.get(axis).copied().flatten() {
            // An earlier edge does not count.
            registers.write(EXTI_PR, pin.bit());
            registers.write(EXTI_IMR, pin.bit());
        }
    }

    /// Closes all lines.
    pub fn close(&self, registers: &mut impl Registers) {
        registers.write(EXTI_IMR, 0);
    }

    /// The interrupt of the open line: whether its sensor has triggered, after which the line is
    /// closed. After a spike it stays open.
    pub fn interrupt(&self, registers: &mut impl Registers) -> bool {
        let open = registers.read(EXTI_IMR);
        registers.write(EXTI_PR, open);
        for pin in self.pins.into_iter().flatten() {
            if pin.bit() == open && pin.is_triggered(registers) {
                registers.write(EXTI_IMR, 0);
                return true;
            }
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registers::recorder::Recorder;

    /// X at PE2, Y at PE1, both high; Z at PA8, low.
    const PINS: [Option<SensorPin>; 3] = [
        Some(SensorPin { port: 4, number: 2, triggers_low: false }),
        Some(SensorPin { port: 4, number: 1, triggers_low: false }),
        Some(SensorPin { port: 0, number: 8, triggers_low: true }),
    ];
    const GPIOA_IDR: u32 = 0x4002_0010;
    const GPIOE_IDR: u32 = 0x4002_1010;

    fn started() -> (SensorLines, Recorder) {
        // The lines of before, and port E's pins as something else.
        let mut registers = Recorder::default()
            .with(EXTI_IMR, 0xff)
            .with(EXTI_RTSR, 1 << 8 | 1 << 12)
            .with(EXTI_FTSR, 1 << 2)
            .with(SYSCFG_EXTICR1, 0xffff)
            .with(0x4002_1000, u32::MAX)
            .with(0x4002_100c, 0b10 << 4);
        let lines = SensorLines::start(PINS, &mut registers);
        (lines, registers)
    }

    #[test]
    fn ports_edges_and_pull_ups() {
        let (_, registers) = started();
        assert_eq!(registers.value(RCC_APB2ENR), 1 << 14);
        assert_eq!(registers.value(RCC_AHB1ENR), 1 << 4 | 1);
        // EXTICR1 has lines 0 to 3: E is 4; line 8 is the first of EXTICR3: A is 0.
        assert_eq!(registers.value(SYSCFG_EXTICR1), 0xf44f);
        assert_eq!(registers.value(SYSCFG_EXTICR1 + 8), 0);
        // High triggers at the rising edge alone, low at the falling one alone; other
        // lines stay unchanged.
        assert_eq!(registers.value(EXTI_RTSR), 1 << 1 | 1 << 2 | 1 << 12);
        assert_eq!(registers.value(EXTI_FTSR), 1 << 8);
        assert_eq!(registers.value(0x4002_1000), !(0b1111 << 2));
        assert_eq!(registers.value(0x4002_100c), 0b0101 << 2);
        assert_eq!(registers.value(0x4002_000c), 0b01 << 16);
        assert_eq!(registers.value(EXTI_IMR), 0);
        // The clock of the registers comes first, and no line is open meanwhile.
        assert_eq!(registers.stores.first().map(|(to, _)| *to), Some(RCC_APB2ENR));
        assert!(registers.stored(EXTI_IMR).iter().all(|lines| *lines == 0));
    }

    #[test]
    fn levels_are_those_of_the_sensor() {
        let (lines, mut registers) = started();
        // PA8 is low: a sensor that triggers low has triggered.
        let all = |registers: &mut Recorder| [0, 1, 2, 3].map(|axis| lines.is_triggered(axis, registers));
        assert_eq!(all(&mut registers), [false, false, true, false]);
        registers.fix(GPIOE_IDR, 1 << 2);
        registers.fix(GPIOA_IDR, 1 << 8);
        assert_eq!(all(&mut registers), [true, false, false, false]);
    }

    #[test]
    fn an_edge_of_the_open_line_counts_and_closes_it() {
        let (lines, mut registers) = started();
        registers.stores.clear();
        lines.open(0, &mut registers);
        assert_eq!(registers.stores, [(EXTI_PR, 1 << 2), (EXTI_IMR, 1 << 2)]);
        registers.fix(GPIOE_IDR, 1 << 2);
        registers.stores.clear();
        assert!(lines.interrupt(&mut registers));
        assert_eq!(registers.stores, [(EXTI_PR, 1 << 2), (EXTI_IMR, 0)]);
        // With all lines closed there is no report.
        assert!(!lines.interrupt(&mut registers));
        lines.open(1, &mut registers);
        lines.close(&mut registers);
        assert_eq!(registers.value(EXTI_IMR), 0);
    }

    #[test]
    fn a_spike_is_not_an_end_stop() {
        let (lines, mut registers) = started();
        lines.open(1, &mut registers);
        // Over when the processor looks.
        registers.fix(GPIOE_IDR, 1 << 2);
        assert!(!lines.interrupt(&mut registers));
        assert_eq!((registers.value(EXTI_PR), registers.value(EXTI_IMR)), (1 << 1, 1 << 1));
        registers.fix(GPIOE_IDR, 1 << 1);
        assert!(lines.interrupt(&mut registers));
    }

    /// A port whose pins read high for some looks at them.
    struct Spike {
        looks_left: u32,
    }

    impl Registers for Spike {
        fn read(&mut self, _: u32) -> u32 {
            let is_high = self.looks_left > 0;
            self.looks_left = self.looks_left.saturating_sub(1);
            if is_high { u32::MAX } else { 0 }
        }

        fn write(&mut self, _: u32, _: u32) {}
    }

    /// The level at the beginning of an approach counts as its edge does.
    #[test]
    fn a_spike_is_no_level_either() {
        let lines = SensorLines::started(PINS);
        for looks_left in 0..LOOKS {
            assert!(!lines.is_triggered(0, &mut Spike { looks_left }), "{looks_left}");
        }
        assert!(lines.is_triggered(0, &mut Spike { looks_left: LOOKS }));
    }

    #[test]
    fn an_axis_without_a_sensor_opens_nothing() {
        let mut registers = Recorder::default();
        let lines = SensorLines::start([None; 3], &mut registers);
        lines.open(0, &mut registers);
        assert_eq!(registers.value(EXTI_IMR), 0);
        assert!(!lines.interrupt(&mut registers) && !lines.is_triggered(0, &mut registers));
    }
}
