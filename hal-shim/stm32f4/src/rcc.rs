//! The registers that switch the clocks of the chip's parts (RM0090 7.3, RM0390 6.3; alike on all chips of the family).

/// The first register, RCC_CR.
pub const RCC: u32 = 0x4002_3800;
/// Of the ports and DMA: port A is bit 0.
pub const RCC_AHB1ENR: u32 = 0x4002_3830;
/// Of AHB2, with the USB controller.
pub const RCC_AHB2ENR: u32 = 0x4002_3834;
/// Of the parts on the slow bus.
pub const RCC_APB1ENR: u32 = 0x4002_3840;
/// Of the parts on the fast bus.
pub const RCC_APB2ENR: u32 = 0x4002_3844;
/// In [`RCC_APB1ENR`]: the power control.
pub const POWER_CLOCK: u32 = 1 << 28;
