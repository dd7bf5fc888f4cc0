//! Each adapter that switches a clock on, with parts that lose the first load or store after it.

use core::sync::atomic::AtomicU16;

use super::{
    CONVERSIONS, Converter, ConverterNumber, OutputPin, PwmClocks, PwmOutput, TimerChannel, set_brown_out_level,
};
use crate::rcc::RCC_APB1ENR;
use crate::registers::Registers;
use crate::registers::recorder::{Recorder, Sluggish};
use crate::sensor_lines::{SensorLines, SensorPin};
use crate::{HalfDuplexLine, PinLines};

fn memory() -> &'static [AtomicU16] {
    (0..CONVERSIONS).map(|_| AtomicU16::new(0)).collect::<Vec<_>>().leak()
}

/// Makes an adapter start on such a chip.
fn lost_by(start: impl FnOnce(&mut Sluggish<Recorder>)) -> u32 {
    let mut registers = Sluggish::new(Recorder::default());
    start(&mut registers);
    registers.lost
}

#[test]
fn no_adapter_loses_what_it_stores() {
    let clocks = PwmClocks { slow_hz: 84_000_000, fast_hz: 168_000_000 };
    for timer in ["TIM3_CH4", "TIM1_CH1"] {
        let pin = OutputPin { port: 1, number: 1, channel: TimerChannel::named(timer) };
        assert_eq!(lost_by(|registers| _ = PwmOutput::start(pin, 10, clocks, registers)), 0, "{timer}");
    }
    let converter = |registers: &mut _| _ = Converter::start(ConverterNumber::One, &[3], memory(), 0, registers);
    assert_eq!(lost_by(converter), 0, "converter");
    let sensor = SensorPin { port: 4, number: 2, triggers_low: false };
    assert_eq!(lost_by(|registers| _ = SensorLines::start([Some(sensor); 3], registers)), 0, "sensors");
    assert_eq!(lost_by(crate::backup_memory::start), 0, "backup memory");
    let shared = |registers: &mut _| _ = HalfDuplexLine::start(registers, (3, 5), 42_000_000, 115_200);
    assert_eq!(lost_by(shared), 0, "USART2");
    let own = |registers: &mut _| _ = PinLines::start(registers, [(2, 1); 4], 84_000_000, 19_200);
    assert_eq!(lost_by(own), 0, "TIM7");
    assert_eq!(lost_by(|registers| crate::servo_line::start(registers, 84_000_000)), 0, "TIM6");
}

/// PWR_CR holds the voltage's scale as well: an STM32F407 that reads it as 0 and stores it again
/// runs at 168 MHz with a voltage that is enough for 144 MHz.
#[test]
fn the_brown_out_level_leaves_the_voltage_as_it_is() {
    const PWR_CR: u32 = 0x4000_7000;
    let options = Recorder::default().with(0x4002_3c14, 0x0fff_aaed).with(PWR_CR, 1 << 14);
    let mut registers = Sluggish::new(options);
    set_brown_out_level(&mut registers);
    assert_eq!(registers.lost, 0);
    assert_eq!(registers.registers.value(PWR_CR) & 1 << 14, 1 << 14);
}

#[test]
fn a_clock_that_is_not_read_back_loses_a_store() {
    let lost = lost_by(|registers| {
        registers.modify(RCC_APB1ENR, 0, 1);
        registers.write(0x4000_0000, 1);
        registers.write(0x4000_0000, 1);
    });
    assert_eq!(lost, 1);
}
