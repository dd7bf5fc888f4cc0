//! The bench: an Olimex STM32-H405 or any bare STM32F405/407 board. STEP PC0 to PC3, DIR PC4 to PC7, ENABLE PC8 (low =
//! on), serial line USART1 on PA9 and PA10.
//!
//! It has neither drivers nor heaters nor sensors: the virtual board's models stand in for them.

use crate::pac::{GPIOA, GPIOC, RCC};

use ferrostep_hal_shim::stepping::{MotorPins, Pin, PinMap};

use crate::step_timer::{MotorPort, Motors};

/// Frequency of the crystal, MHz.
pub const CRYSTAL_MHZ: u8 = 8;

const STEP: u32 = 0b1111;
const DIRECTION_SHIFT: u32 = 4;
const ENABLE: u32 = 1 << 8;
/// In BSRR the upper half resets what the lower half sets.
const RESET_SHIFT: u32 = 16;

/// The motors' signals.
pub struct BenchPins {
    port: GPIOC,
}

impl BenchPins {
    /// Makes the pins outputs, drivers off, and connects the serial line's.
    pub fn new(port: GPIOC, serial: &GPIOA, rcc: &RCC) -> Self {
        rcc.ahb1enr().modify(|_, w| w.gpioaen().set_bit().gpiocen().set_bit());
        let pins = Self { port };
        pins.enable(false);
        // SAFETY: two bits a pin, 01 = output: PC0 to PC8.
        pins.port.moder().modify(|r, w| unsafe { w.bits(r.bits() & !0x3_ffff | 0x1_5555) });
        // SAFETY: two bits a pin, 10 = high speed (edges of some ns, as the step pulse wants): PC0 to PC7.
        pins.port.ospeedr().modify(|r, w| unsafe { w.bits(r.bits() & !0xffff | 0xaaaa) });
        // SAFETY: four bits a pin from PA8 on, 7 = USART1 (datasheet, table 9): PA9 and PA10.
        serial.afrh().modify(|r, w| unsafe { w.bits(r.bits() & !0xff0 | 0x770) });
        // SAFETY: two bits a pin, 01 = pull-up, so that an open line is silent: PA10.
        serial.pupdr().modify(|r, w| unsafe { w.bits(r.bits() & !(0b11 << 20) | 0b01 << 20) });
        // SAFETY: two bits a pin, 10 = alternate function: PA9 and PA10.
        serial.moder().modify(|r, w| unsafe { w.bits(r.bits() & !(0b1111 << 18) | 0b1010 << 18) });
        pins
    }

    #[inline]
    fn write(&self, word: u32) {
        write(&self.port, word);
    }
}

#[inline]
fn write(port: &crate::pac::gpioc::RegisterBlock, word: u32) {
    // SAFETY: every bit of BSRR sets or resets one pin, and zeros do nothing; the words here name PC0 to PC8 only.
    port.bsrr().write(|w| unsafe { w.bits(word) });
}

/// Step and direction pins of the motors.
pub const PINS: PinMap<1> = {
    let mut motors = [MotorPins { step: Pin { port: 0, number: 0 }, direction: Pin { port: 0, number: 0 } }; 4];
    let mut motor = 0;
    while motor < 4 {
        let number = motor as u8;
        motors[motor] = MotorPins {
            step: Pin { port: 0, number },
            direction: Pin { port: 0, number: number + DIRECTION_SHIFT as u8 },
        };
        motor += 1;
    }
    match PinMap::new(motors) {
        Some(map) => map,
        None => panic!("a port has 16 pins"),
    }
};

impl Motors<1> for BenchPins {
    fn ports(&self) -> [MotorPort; 1] {
        [MotorPort::new(&self.port)]
    }

    fn enable(&self, enabled: bool) {
        self.write(if enabled { ENABLE << RESET_SHIFT } else { ENABLE });
    }
}

// SAFETY: all that is done to the port is one store to BSRR, which is atomic.
unsafe impl Sync for BenchPins {}

/// For the panic and fault handlers: heaters off, then motors off.
pub(crate) fn all_off() {
    // The bench has no heater; on a board that has some this is the first line.
    // SAFETY: a single store to BSRR, at a moment when nothing else runs any more.
    let port = unsafe { &*GPIOC::ptr() };
    write(port, ENABLE | STEP << RESET_SHIFT);
}
