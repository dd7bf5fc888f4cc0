//! A pin for each driver's line, and TIM7 that calls [`SoftwareSerial`] four times a bit while
//! something is on it.
//!
//! Addresses and bits: RM0090 2.3 (memory map), 7.3.13 (RCC_APB1ENR), 8.4 (GPIO), 20.4 (TIM6 and
//! TIM7); RM0390 is the same.

use ferrostep_register_address::register;

use crate::gpio::{self, BSRR, IDR, MODER, PULL_UP, PUPDR};
use crate::rcc::{RCC_AHB1ENR, RCC_APB1ENR};
use crate::registers::Registers;
use crate::software_serial::{PinAction, SoftwareSerial, TICKS_A_BIT};
use ferrostep_tmc2209::{LineBusy, SingleWireUart};

const TIM7_CLOCK: u32 = 1 << 5;
const TIM7_CR1: u32 = register!(TIM7.cr1);
const TIM7_DIER: u32 = register!(TIM7.dier);
const TIM7_SR: u32 = register!(TIM7.sr);
const TIM7_CNT: u32 = register!(TIM7.cnt);
const TIM7_ARR: u32 = register!(TIM7.arr);

/// Bits to listen for after a datagram: the longest delay of a reply, eight bytes, and a margin.
const LISTENED_BITS: u16 = 200;

/// The lines; TIM7's interrupt calls [`Self::interrupt`].
#[derive(Debug)]
pub struct PinLines<R, const N: usize = 4> {
    registers: R,
    /// Port (0 for A) and number of each.
    pins: [(u8, u8); N],
    serial: SoftwareSerial,
    driven: PinAction,
    /// Ticks until the end of any reply.
    ticks_left: u16,
}

impl<R: Registers, const N: usize> PinLines<R, N> {
    /// Pins with pull-ups, and a stopped timer. `timer_hz` is the clock of the timers on APB1.
    pub fn start(mut registers: R, pins: [(u8, u8); N], timer_hz: u32, baud: u32) -> Self {
        registers.switch_clocks_on(RCC_APB1ENR, TIM7_CLOCK);
        registers.write(TIM7_CR1, 0);
        let interval = timer_hz / (baud * u32::from(TICKS_A_BIT)).max(1);
        registers.write(TIM7_ARR, interval.saturating_sub(1).clamp(1, 0xffff));
        registers.write(TIM7_DIER, 1);
        for (port, number) in pins {
            registers.switch_clocks_on(RCC_AHB1ENR, 1 << port);
            let place = 2 * u32::from(number & 15);
            registers.modify(gpio::port(port) + PUPDR, 0b11 << place, PULL_UP << place);
        }
        Self { registers, pins, serial: SoftwareSerial::new(), driven: PinAction::Release, ticks_left: 0 }
    }

    /// Port's registers, and the number, of the line in use.
    fn pin(&self) -> (u32, u32) {
        let (port, number) = self.pins.get(usize::from(self.serial.line())).copied().unwrap_or_default();
        (gpio::port(port), u32::from(number & 15))
    }

    /// A quarter of a bit has passed. Must come within a tenth of it: 1.3 us at 19,200 baud.
    pub fn interrupt(&mut self) {
        self.registers.write(TIM7_SR, 0);
        let (port, number) = self.pin();
        let level = self.registers.read(port + IDR) >> number & 1 == 1;
        let action = self.serial.tick(level);
        if action != self.driven {
            self.drive(port, number, action);
        }
        if self.serial.is_sending() {
            self.ticks_left = LISTENED_BITS * u16::from(TICKS_A_BIT);
        }
        self.ticks_left = self.ticks_left.saturating_sub(1);
        if self.ticks_left == 0 && action == PinAction::Release {
            self.registers.write(TIM7_CR1, 0);
        }
    }

    /// The level first, then the direction: the line never sees another.
    fn drive(&mut self, port: u32, number: u32, action: PinAction) {
        let mode = if action == PinAction::Release { 0b00 } else { 0b01 };
        if action != PinAction::Release {
            self.registers.write(port + BSRR, if action == PinAction::High { 1 << number } else { 1 << (number + 16) });
        }
        if action == PinAction::Release || self.driven == PinAction::Release {
            self.registers.modify(port + MODER, 0b11 << (2 * number), mode << (2 * number));
        }
        self.driven = action;
    }
}

impl<R: Registers, const N: usize> SingleWireUart for PinLines<R, N> {
    fn send(&mut self, line: u8, bytes: &[u8], now_ticks: u32) -> Result<(), LineBusy> {
        if self.driven != PinAction::Release {
            return Err(LineBusy);
        }
        self.serial.send(line, bytes, now_ticks)?;
        self.ticks_left = 1;
        self.registers.write(TIM7_CNT, 0);
        self.registers.write(TIM7_CR1, 1);
        Ok(())
    }

    fn receive(&mut self, now_ticks: u32) -> Option<u8> {
        self.serial.receive(now_ticks)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use std::cell::RefCell;

    use crate::gpio::{GPIO, GPIO_STRIDE};

    use super::*;
    use crate::mini_drivers::MINI;
    use crate::registers::recorder::Recorder;
    use ferrostep_tmc2209::{DriverBank, DriverState, DriverWiring, LineTiming};
    use ferrostep_virtual_board::DriverChip;

    /// Sockets 0, 1, 2 and 4 of the Octopus: PC4, PD11, PC6, PF2.
    const PINS: [(u8, u8); 4] = [(2, 4), (3, 11), (2, 6), (5, 2)];

    #[test]
    fn the_timer_is_set_up_and_stands_still() {
        let lines = PinLines::start(Recorder::default(), PINS, 84_000_000, 19_200);
        let registers = &lines.registers;
        assert_eq!(registers.value(0x4002_3840), 1 << 5);
        // 84 MHz / 76,800 = 1093.75: 0.07 % fast.
        assert_eq!((registers.value(TIM7_ARR), registers.value(TIM7_DIER), registers.value(TIM7_CR1)), (1092, 1, 0));
        assert_eq!(registers.value(RCC_AHB1ENR), 1 << 2 | 1 << 3 | 1 << 5);
        assert_eq!(registers.value(0x4002_080c), 0b01 << 8 | 0b01 << 12);
        assert_eq!(registers.value(0x4002_0c0c), 0b01 << 22);
        // Nothing is driven.
        assert!(registers.stores.iter().all(|(to, _)| to % GPIO_STRIDE != MODER || *to < GPIO));
    }

    #[test]
    fn a_byte_on_the_pin() {
        let mut lines = PinLines::start(Recorder::default(), PINS, 84_000_000, 19_200);
        lines.registers.stores.clear();
        lines.send(3, &[0x05], 0).unwrap();
        assert_eq!(lines.registers.stores, [(TIM7_CNT, 0), (TIM7_CR1, 1)]);
        let port = 0x4002_1400;
        let mut levels = Vec::new();
        for _ in 0..40 {
            // The line as it is driven; released it is high.
            let driven = lines.registers.value(port + MODER) >> 4 & 0b11 == 0b01;
            let low = lines.registers.value(port + BSRR) == 1 << 18;
            lines.registers.fix(port + IDR, u32::from(!(driven && low)) << 2);
            lines.interrupt();
            levels.push(lines.registers.value(port + BSRR) == 1 << 2);
        }
        let bits: Vec<bool> = levels.chunks(4).map(|bit| bit[0]).collect();
        assert!(levels.chunks(4).all(|bit| bit.iter().all(|level| *level == bit[0])));
        // Start, 0x05 from its lowest bit, stop.
        assert_eq!(bits, [0, 1, 0, 1, 0, 0, 0, 0, 0, 1].map(|bit| bit == 1));
        // The start bit's level comes before the pin is an output.
        let positions = [(port + BSRR, 1 << 18), (port + MODER, 0b01 << 4)]
            .map(|store| lines.registers.stores.iter().position(|made| *made == store).unwrap());
        assert!(positions[0] < positions[1]);
        // Then it is released, sampled for a while, and the timer stops.
        lines.registers.fix(port + IDR, 1 << 2);
        let mut ticks = 0;
        while lines.registers.value(TIM7_CR1) == 1 {
            lines.interrupt();
            ticks += 1;
        }
        assert_eq!(lines.registers.value(port + MODER), 0);
        assert!((790..=810).contains(&ticks), "{ticks}");
        assert_eq!(lines.receive(0), Some(0x05));
    }

    const PORTS: std::ops::Range<u32> = GPIO..GPIO + 8 * GPIO_STRIDE;

    /// Wires with a chip on each, at its own port; a quarter of a bit at a time.
    #[derive(Default)]
    struct Wires {
        recorder: Recorder,
        outputs: [[u32; 2]; 8],
        chips: Vec<(DriverChip, SoftwareSerial, PinAction, Vec<u8>, bool)>,
    }

    impl Wires {
        fn level(&self, motor: usize) -> bool {
            let (port, number) = PINS[motor];
            let [mode, output] = self.outputs[usize::from(port)];
            let is_driven = mode >> (2 * number) & 0b11 == 0b01;
            let ours = !is_driven || output >> number & 1 == 1;
            ours && self.chips[motor].2 != PinAction::Low
        }

        fn tick(&mut self) {
            for motor in 0..4 {
                let level = self.level(motor);
                let (chip, serial, action, heard, is_replying) = &mut self.chips[motor];
                *action = serial.tick(level);
                while let Some(byte) = serial.receive(0) {
                    heard.push(byte);
                }
                // Its own reply, which it hears as well.
                if *is_replying {
                    *is_replying = !serial.is_quiet();
                    heard.clear();
                    continue;
                }
                let length = if heard.get(2).is_some_and(|register| register & 0x80 != 0) { 8 } else { 4 };
                if heard.len() == length && serial.is_quiet() {
                    if let Some(reply) = chip.hear(heard) {
                        serial.send(0, &reply, 0).unwrap();
                        *is_replying = true;
                    }
                    heard.clear();
                }
            }
        }
    }

    impl Registers for &RefCell<Wires> {
        fn read(&mut self, address: u32) -> u32 {
            let mut wires = self.borrow_mut();
            if PORTS.contains(&address) && address % GPIO_STRIDE == IDR {
                let port = ((address - GPIO) / GPIO_STRIDE) as u8;
                let motors = (0..4).filter(|motor| PINS[*motor].0 == port);
                return motors.fold(0, |word, motor| word | u32::from(wires.level(motor)) << PINS[motor].1);
            }
            wires.recorder.read(address)
        }

        fn write(&mut self, address: u32, value: u32) {
            let mut wires = self.borrow_mut();
            if PORTS.contains(&address) {
                let [mode, output] = &mut wires.outputs[((address - GPIO) / GPIO_STRIDE) as usize];
                match address % GPIO_STRIDE {
                    MODER => *mode = value,
                    BSRR => *output = *output & !(value >> 16) | value & 0xffff,
                    _ => {}
                }
            }
            wires.recorder.write(address, value);
        }
    }

    #[test]
    fn four_drivers_are_set_up_over_a_pin_each() {
        let chip = || (DriverChip::new(0), SoftwareSerial::new(), PinAction::Release, Vec::new(), false);
        let wires = RefCell::new(Wires { chips: (0..4).map(|_| chip()).collect(), ..Wires::default() });
        let mut lines = PinLines::start(&wires, PINS, 84_000_000, 19_200);
        let wiring = [0, 1, 2, 3].map(|line| Some((MINI, DriverWiring { line, address: 0, sense_milliohm: 110 })));
        // A tick is a quarter of a bit.
        let timing = LineTiming::new(76_800, 19_200);
        let mut bank = DriverBank::new(wiring, timing, 0);
        let mut calls = 0;
        for now in 0..150_000 {
            bank.poll(&mut lines, now);
            wires.borrow_mut().tick();
            if wires.borrow().recorder.value(TIM7_CR1) == 1 {
                lines.interrupt();
                calls += 1;
            }
        }
        assert_eq!([0, 1, 2, 3].map(|motor| bank.state(motor)), [Some(DriverState::Confirmed); 4]);
        // A silent line causes no interrupts.
        assert!(calls < 140_000, "{calls}");
    }
}
