//! The modelled instances, and their names on the bus.

use rigless::cpu::armv7m;
use rigless::soc::st::tim::Counter;
use rigless::soc::stm32f427::peripherals::usart::Kind;
use rigless::soc::stm32f427::peripherals::{ADC_COMMON, CONTROLLERS, CONVERTERS};

use super::{entry, late_clocks};

/// Ports A to I; the F446 has A to H.
pub const PORTS: [&str; 9] = ["GPIOA", "GPIOB", "GPIOC", "GPIOD", "GPIOE", "GPIOF", "GPIOG", "GPIOH", "GPIOI"];
/// Serial ports, each with the register table of its kind (RM0090 table 148).
pub const SERIAL_PORTS: [(&str, Kind); 6] = [
    ("USART1", Kind::Usart),
    ("USART2", Kind::Usart),
    ("USART3", Kind::Usart),
    ("USART6", Kind::Usart),
    ("UART4", Kind::Uart),
    ("UART5", Kind::Uart),
];
pub(super) const GENERAL: [(&str, Counter); 4] =
    [("TIM2", Counter::Wide), ("TIM3", Counter::Narrow), ("TIM4", Counter::Narrow), ("TIM5", Counter::Wide)];
pub(super) const ADVANCED: [&str; 2] = ["TIM1", "TIM8"];
pub(super) const BASIC: [&str; 2] = ["TIM6", "TIM7"];
pub(super) const TWO_CHANNELS: [&str; 2] = ["TIM9", "TIM12"];
pub(super) const ONE_CHANNEL: [&str; 4] = ["TIM10", "TIM11", "TIM13", "TIM14"];

/// An instance with a model on the bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Instance {
    /// A slot without a model.
    None,
    Rcc,
    Pwr,
    Flash,
    Gpio(usize),
    Usart(usize),
    Adc(usize),
    AdcCommon,
    General(usize),
    Advanced(usize),
    Basic(usize),
    TwoChannels(usize),
    OneChannel(usize),
    Dma(usize),
    Exti,
    Syscfg,
    Otg,
    Sdio,
    Rtc,
    Dbg,
    Iwdg,
    Dwt,
    Entry,
    ClocksF446,
    LateClocks,
}

impl Instance {
    pub(super) fn all() -> Vec<Self> {
        let mut all = vec![
            Self::Rcc,
            Self::Pwr,
            Self::Flash,
            Self::AdcCommon,
            Self::Exti,
            Self::Syscfg,
            Self::Otg,
            Self::Sdio,
            Self::Rtc,
            Self::Dbg,
            Self::Iwdg,
            Self::Dwt,
            Self::Entry,
            Self::LateClocks,
        ];
        all.extend((0..PORTS.len()).map(Self::Gpio));
        all.extend((0..SERIAL_PORTS.len()).map(Self::Usart));
        all.extend((0..CONVERTERS.len()).map(Self::Adc));
        all.extend((0..GENERAL.len()).map(Self::General));
        all.extend((0..ADVANCED.len()).map(Self::Advanced));
        all.extend((0..BASIC.len()).map(Self::Basic));
        all.extend((0..TWO_CHANNELS.len()).map(Self::TwoChannels));
        all.extend((0..ONE_CHANNEL.len()).map(Self::OneChannel));
        all.extend((0..CONTROLLERS.len()).map(Self::Dma));
        all
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::None => "",
            Self::Rcc => "RCC",
            Self::Pwr => "PWR",
            Self::Flash => "FLASH",
            Self::Gpio(nth) => PORTS[nth],
            Self::Usart(nth) => SERIAL_PORTS[nth].0,
            Self::Adc(nth) => CONVERTERS[nth],
            Self::AdcCommon => ADC_COMMON,
            Self::General(nth) => GENERAL[nth].0,
            Self::Advanced(nth) => ADVANCED[nth],
            Self::Basic(nth) => BASIC[nth],
            Self::TwoChannels(nth) => TWO_CHANNELS[nth],
            Self::OneChannel(nth) => ONE_CHANNEL[nth],
            Self::Dma(nth) => CONTROLLERS[nth].instance,
            Self::Exti => "EXTI",
            Self::Syscfg => "SYSCFG",
            Self::Otg => "OTG_FS_GLOBAL",
            Self::Sdio => "SDIO",
            Self::Rtc => "RTC",
            Self::Dbg => "DBG",
            Self::Iwdg => "IWDG",
            Self::Dwt => armv7m::DWT,
            Self::Entry => entry::PERIPHERAL.name,
            Self::ClocksF446 => entry::CLOCKS_F446.name,
            Self::LateClocks => late_clocks::PERIPHERAL.name,
        }
    }

    /// True if the instance has a clock enable and a reset bit. Exceptions are the clock tree
    /// itself, instances of the core, and those without a bus clock (RM0090 2.1.11, 6.2.9, 26.3.5).
    const fn is_gated(self) -> bool {
        // The converters' common block answers while any converter has a clock.
        !matches!(
            self,
            Self::None
                | Self::Rcc
                | Self::Flash
                | Self::Rtc
                | Self::Dbg
                | Self::Iwdg
                | Self::Dwt
                | Self::Exti
                | Self::AdcCommon
                | Self::Entry
                | Self::ClocksF446
                | Self::LateClocks
        )
    }
}

/// The instances that have a clock enable and a reset bit of their own.
pub(super) fn clocked() -> impl Iterator<Item = &'static str> {
    Instance::all().into_iter().filter(|instance| instance.is_gated()).map(Instance::name)
}
