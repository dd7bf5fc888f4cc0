//! A servo's signal at any pin, by TIM6: its interrupt sets the pin at the beginning of a pulse and
//! clears it at its end.
//!
//! A basic timer has neither channels nor pins, so no fan or heater can need it. It counts
//! microseconds and is stopped without pulses to send. Both edges come late by the entry of the
//! interrupt, so a pulse is wrong only by the difference of two entries.
//!
//! Addresses and bits: RM0090 2.3 (memory map), 7.3.13 (RCC_APB1ENR), 8.4 (GPIO), 20.4 (TIM6 and
//! TIM7); RM0390 is the same.

use core::sync::atomic::{AtomicU32, Ordering};

use ferrostep_hal_shim::ServoPulses;
use ferrostep_register_address::register;

use crate::gpio::{self, BSRR};
use crate::rcc::RCC_APB1ENR;
use crate::registers::Registers;

const TIM6_CLOCK: u32 = 1 << 4;
const TIM6_CR1: u32 = register!(TIM6.cr1);
const TIM6_DIER: u32 = register!(TIM6.dier);
const TIM6_SR: u32 = register!(TIM6.sr);
const TIM6_EGR: u32 = register!(TIM6.egr);
const TIM6_PSC: u32 = register!(TIM6.psc);
const TIM6_ARR: u32 = register!(TIM6.arr);

/// Present phase of the signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// The timer is stopped.
    Rest,
    /// The pin is high, for the rest of this width, microseconds.
    Pulse(u16),
    /// The pin is low until the next pulse.
    Pause,
}

/// The signal; TIM6's interrupt calls [`Self::interrupt`].
#[derive(Debug)]
pub struct ServoLine<R> {
    registers: R,
    /// BSRR of the pin's port, and the pin's bit.
    pin: (u32, u32),
    phase: Phase,
}

/// Sets TIM6 up and leaves it stopped. `timer_hz` is the clock of the timers on APB1.
pub fn start(registers: &mut impl Registers, timer_hz: u32) {
    registers.switch_clocks_on(RCC_APB1ENR, TIM6_CLOCK);
    registers.write(TIM6_CR1, 0);
    registers.write(TIM6_PSC, (timer_hz / 1_000_000).saturating_sub(1));
    // The prescaler takes effect with an update, whose flag does not end a phase.
    registers.write(TIM6_EGR, 1);
    registers.write(TIM6_SR, 0);
    registers.write(TIM6_DIER, 1);
}

impl<R: Registers> ServoLine<R> {
    /// A signal that rests, at an output that is low: port (0 for A) and number. [`start`] comes
    /// before its first interrupt.
    pub const fn at(registers: R, (port, number): (u8, u8)) -> Self {
        Self { registers, pin: (gpio::port(port) + BSRR, 1 << (number & 15)), phase: Phase::Rest }
    }

    /// A phase has ended, or there is something to send. The reload value holds at once: the
    /// counter has just begun anew.
    #[inline]
    pub fn interrupt(&mut self, pulses: &AtomicU32) {
        let is_update = self.registers.read(TIM6_SR) & 1 != 0;
        self.registers.write(TIM6_SR, 0);
        let (port, bit) = self.pin;
        match self.phase {
            // Somebody has other pulses to send: they begin with the next one.
            Phase::Pulse(_) | Phase::Pause if !is_update => {}
            Phase::Pulse(width_us) => {
                self.registers.write(port, bit << 16);
                self.registers.write(TIM6_ARR, u32::from(ServoPulses::PERIOD_US - width_us - 1));
                self.phase = Phase::Pause;
            }
            Phase::Rest | Phase::Pause => self.next(pulses),
        }
    }

    /// The pause has ended: the next pulse, or rest.
    fn next(&mut self, pulses: &AtomicU32) {
        let mut word = pulses.load(Ordering::Relaxed);
        if self.phase == Phase::Pause && word != 0 {
            word -= 1 << 16;
            word = if word >> 16 == 0 { 0 } else { word };
            // No task can store in between: this interrupt is above all of them.
            pulses.store(word, Ordering::Relaxed);
        }
        let Some(ServoPulses { width_us, .. }) = ServoPulses::from_word(word) else {
            self.registers.write(TIM6_CR1, 0);
            self.phase = Phase::Rest;
            return;
        };
        let width_us = width_us.clamp(1, ServoPulses::PERIOD_US / 2);
        let (port, bit) = self.pin;
        self.registers.write(port, bit);
        self.registers.write(TIM6_ARR, u32::from(width_us - 1));
        if self.phase == Phase::Rest {
            self.registers.write(TIM6_CR1, 1);
        }
        self.phase = Phase::Pulse(width_us);
    }
}

/// Maximum number of looks at the timer for a phase: more than its 20 ms take.
const MAX_LOOKS: u32 = 2_000_000;

/// Sends one pulse and waits for its end and the pause after it, where no interrupt comes any more.
/// A timer that was not set up gives a meaningless pulse.
pub fn send_one(registers: &mut impl Registers, (port, number): (u8, u8), width_us: u16) {
    let (port, bit) = (gpio::port(port) + BSRR, 1 << (number & 15));
    let width_us = width_us.clamp(1, ServoPulses::PERIOD_US / 2);
    registers.write(TIM6_CR1, 1);
    for (level, us) in [(bit, width_us), (bit << 16, ServoPulses::PERIOD_US - width_us)] {
        registers.write(TIM6_ARR, u32::from(us - 1));
        registers.write(TIM6_EGR, 1);
        registers.write(TIM6_SR, 0);
        registers.write(port, level);
        let _passed = (0..MAX_LOOKS).any(|_| registers.read(TIM6_SR) & 1 != 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registers::recorder::Recorder;

    const GPIOB_BSRR: u32 = 0x4002_0418;
    const HIGH: (u32, u32) = (GPIOB_BSRR, 1 << 6);
    const LOW: (u32, u32) = (GPIOB_BSRR, 1 << 22);

    fn line() -> ServoLine<Recorder> {
        let mut line = ServoLine::at(Recorder::default(), (1, 6));
        start(&mut line.registers, 90_000_000);
        assert_eq!(line.registers.value(TIM6_PSC), 89, "microseconds");
        assert_eq!((line.registers.value(TIM6_DIER), line.registers.value(TIM6_CR1)), (1, 0));
        assert_eq!(line.registers.value(RCC_APB1ENR), TIM6_CLOCK);
        line.registers.stores.clear();
        line
    }

    /// The interrupt's stores, its flag's left out.
    fn stores(line: &mut ServoLine<Recorder>, pulses: &AtomicU32, is_update: bool) -> Vec<(u32, u32)> {
        line.registers.fix(TIM6_SR, u32::from(is_update));
        line.interrupt(pulses);
        line.registers.stores.drain(..).filter(|(address, _)| *address != TIM6_SR).collect()
    }

    #[test]
    fn as_many_pulses_of_the_width_and_then_rest() {
        let (mut line, pulses) = (line(), AtomicU32::new(ServoPulses { width_us: 650, count: 2 }.word()));
        assert_eq!(stores(&mut line, &pulses, false), [HIGH, (TIM6_ARR, 649), (TIM6_CR1, 1)]);
        for _ in 0..2 {
            // Called again in between, without effect.
            assert_eq!(stores(&mut line, &pulses, false), []);
            assert_eq!(stores(&mut line, &pulses, true), [LOW, (TIM6_ARR, 19_349)]);
            assert_ne!(pulses.load(Ordering::Relaxed), 0, "the pause belongs to it");
            let next = stores(&mut line, &pulses, true);
            match pulses.load(Ordering::Relaxed) {
                0 => assert_eq!(next, [(TIM6_CR1, 0)]),
                _ => assert_eq!(next, [HIGH, (TIM6_ARR, 649)]),
            }
        }
        assert_eq!(pulses.load(Ordering::Relaxed), 0);
        assert_eq!(stores(&mut line, &pulses, false), [(TIM6_CR1, 0)]);
    }

    #[test]
    fn one_pulse_without_interrupts() {
        let mut registers = Recorder::default();
        registers.fix(TIM6_SR, 1);
        send_one(&mut registers, (1, 6), 1_475);
        let flag = |(address, _): &(u32, u32)| *address == TIM6_SR;
        let stores: Vec<(u32, u32)> = registers.stores.into_iter().filter(|store| !flag(store)).collect();
        let phase = |us: u32, level| [(TIM6_ARR, us - 1), (TIM6_EGR, 1), level];
        assert_eq!(stores[0], (TIM6_CR1, 1));
        assert_eq!(stores[1..], [phase(1_475, HIGH), phase(18_525, LOW)].concat());
    }

    /// The pin is high for no more than half of the period, whatever the requested width.
    #[test]
    fn other_pulses_begin_with_the_next_one() {
        let (mut line, pulses) = (line(), AtomicU32::new(ServoPulses { width_us: 650, count: 100 }.word()));
        stores(&mut line, &pulses, false);
        pulses.store(ServoPulses { width_us: u16::MAX, count: 9 }.word(), Ordering::Relaxed);
        assert_eq!(stores(&mut line, &pulses, true), [LOW, (TIM6_ARR, 19_349)]);
        assert_eq!(stores(&mut line, &pulses, true), [HIGH, (TIM6_ARR, 9_999)]);
        assert_eq!(stores(&mut line, &pulses, true), [LOW, (TIM6_ARR, 9_999)]);
    }
}
