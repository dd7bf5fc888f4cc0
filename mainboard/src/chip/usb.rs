//! stand-in
use rigless::soc::Peripheral;
pub use rigless::soc::stm32f427::peripherals::otg::Otg;
/// x
pub const PERIPHERAL: Peripheral = rigless::soc::stm32f427::generated::OTG_FS_GLOBAL;
