//! The registers of the clocks, and of those of the chip's parts (RM0090 7.3, RM0390 6.3; alike on
//! all chips of the family).

use ferrostep_register_address::register;

use crate::registers::Registers;

/// The first register, RCC_CR.
pub const RCC: u32 = register!(RCC);
/// Source of the core's clock, and the buses' dividers.
pub const RCC_CFGR: u32 = register!(RCC.cfgr);
/// Bits of [`RCC_CFGR`] with the source of the core's clock; the internal oscillator is 0.
pub const SWS: u32 = 0b11 << 2;
const SWS_PLL: u32 = 0b10 << 2;
/// Clocks of the ports and DMA: port A is bit 0.
pub const RCC_AHB1ENR: u32 = register!(RCC.ahb1enr);
/// Clocks of AHB2, with the USB controller.
pub const RCC_AHB2ENR: u32 = register!(RCC.ahb2enr);
/// Clocks of the parts on the slow bus.
pub const RCC_APB1ENR: u32 = register!(RCC.apb1enr);
/// Clocks of the parts on the fast bus.
pub const RCC_APB2ENR: u32 = register!(RCC.apb2enr);
/// Clock of the power control, in [`RCC_APB1ENR`].
pub const POWER_CLOCK: u32 = 1 << 28;

/// Returns true if the core's clock comes from the PLL.
pub fn is_on_pll(registers: &mut impl Registers) -> bool {
    registers.read(RCC_CFGR) & SWS == SWS_PLL
}
