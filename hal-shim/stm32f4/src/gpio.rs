//! Addresses of the ports' registers (RM0090 2.3 and 8.4, RM0390 2.2 and 7.4; alike on all
//! chips of the family).

use ferrostep_register_address::register;

/// Port A's first register.
pub const GPIO: u32 = register!(GPIOA);
/// Distance from a port to the next.
pub const GPIO_STRIDE: u32 = register!(GPIOB) - GPIO;
/// Offset of the modes: two bits a pin.
pub const MODER: u32 = register!(GPIOA.moder) - GPIO;
/// Offset of the output types: 0 push-pull, 1 open drain.
pub const OTYPER: u32 = register!(GPIOA.otyper) - GPIO;
/// Offset of the slew rates: two bits a pin.
pub const OSPEEDR: u32 = register!(GPIOA.ospeedr) - GPIO;
/// Offset of the pull-ups and pull-downs: two bits a pin.
pub const PUPDR: u32 = register!(GPIOA.pupdr) - GPIO;
/// Offset of the input levels.
pub const IDR: u32 = register!(GPIOA.idr) - GPIO;
/// Offset of the levels to set, and in the upper half to reset.
pub const BSRR: u32 = register!(GPIOA.bsrr) - GPIO;
/// Offset of the alternate functions: four bits a pin, in two registers.
pub const AFRL: u32 = register!(GPIOA.afrl) - GPIO;

/// Output, in MODER.
pub const OUTPUT: u32 = 0b01;
/// Alternate function, in MODER.
pub const ALTERNATE: u32 = 0b10;
/// Analogue, in MODER.
pub const ANALOGUE: u32 = 0b11;
/// Pull-up, in PUPDR.
pub const PULL_UP: u32 = 0b01;

/// Address of a port's first register; 0 is A.
pub const fn port(index: u8) -> u32 {
    GPIO + GPIO_STRIDE * index as u32
}
