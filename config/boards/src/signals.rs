//! The chips' pin functions besides inputs and outputs: analogue channels, timer
//! channels, serial lines.
//!
//! The tables hold for all three chips; pins that a package lacks are refused before. Analogue
//! channels: DS8626, table 7, and DS10693, table 10. Timers and serial lines: DS8626, table 9, and
//! DS10693, table 11 (alternate functions).

use crate::pin::Pin;

/// Pins of the channels of the converters 1 and 2, and of 3 where it has the pin as well.
const SHARED_CHANNELS: [(&str, u8, bool); 16] = [
    ("PA0", 0, true),
    ("PA1", 1, true),
    ("PA2", 2, true),
    ("PA3", 3, true),
    ("PA4", 4, false),
    ("PA5", 5, false),
    ("PA6", 6, false),
    ("PA7", 7, false),
    ("PB0", 8, false),
    ("PB1", 9, false),
    ("PC0", 10, true),
    ("PC1", 11, true),
    ("PC2", 12, true),
    ("PC3", 13, true),
    ("PC4", 14, false),
    ("PC5", 15, false),
];

/// Pins that only converter 3 has.
const CHANNELS_OF_3: [(&str, u8); 8] =
    [("PF3", 9), ("PF4", 14), ("PF5", 15), ("PF6", 4), ("PF7", 5), ("PF8", 6), ("PF9", 7), ("PF10", 8)];

/// Timers that the firmware uses itself: steps, motion clock, count of updates.
pub const TIMERS_IN_USE: [(&str, &str); 3] =
    [("TIM2", "makes the steps"), ("TIM5", "is the motion clock"), ("TIM9", "counts the step timer's updates")];

/// Channels of the other timers that have outputs, and their pins.
const TIMER_CHANNELS: [(&str, &[&str]); 22] = [
    ("TIM1_CH1", &["PA8", "PE9"]),
    ("TIM1_CH2", &["PA9", "PE11"]),
    ("TIM1_CH3", &["PA10", "PE13"]),
    ("TIM1_CH4", &["PA11", "PE14"]),
    ("TIM3_CH1", &["PA6", "PB4", "PC6"]),
    ("TIM3_CH2", &["PA7", "PB5", "PC7"]),
    ("TIM3_CH3", &["PB0", "PC8"]),
    ("TIM3_CH4", &["PB1", "PC9"]),
    ("TIM4_CH1", &["PB6", "PD12"]),
    ("TIM4_CH2", &["PB7", "PD13"]),
    ("TIM4_CH3", &["PB8", "PD14"]),
    ("TIM4_CH4", &["PB9", "PD15"]),
    ("TIM8_CH1", &["PC6"]),
    ("TIM8_CH2", &["PC7"]),
    ("TIM8_CH3", &["PC8"]),
    ("TIM8_CH4", &["PC9"]),
    ("TIM10_CH1", &["PB8", "PF6"]),
    ("TIM11_CH1", &["PB9", "PF7"]),
    ("TIM12_CH1", &["PB14"]),
    ("TIM12_CH2", &["PB15"]),
    ("TIM13_CH1", &["PA6", "PF8"]),
    ("TIM14_CH1", &["PA7", "PF9"]),
];

/// Pins of USART1, alternate function 7.
pub const USART1_TX: [&str; 2] = ["PA9", "PB6"];
/// The other end of it.
pub const USART1_RX: [&str; 2] = ["PA10", "PB7"];
/// Pins of USART2's transmitter, alternate function 7: the line that drivers share.
pub const USART2_TX: [&str; 2] = ["PA2", "PD5"];
/// The full-speed USB's pins, minus and plus.
pub const USB_PINS: [&str; 2] = ["PA11", "PA12"];
/// The SDIO's pins, alternate function 12: clock, command, four data lines.
pub const SDIO_PINS: [&str; 6] = ["PC12", "PD2", "PC8", "PC9", "PC10", "PC11"];
/// Pins of the debug probe, and their names there.
pub const DEBUG_PINS: [(&str, &str); 2] = [("PA13", "SWDIO"), ("PA14", "SWCLK")];

/// A converter's channel, and the pin it measures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AnalogueChannel {
    /// The converter, 1 to 3.
    pub converter: u8,
    /// The converter's channel, 0 to 15.
    pub channel: u8,
}

impl std::fmt::Display for AnalogueChannel {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "ADC{}_IN{}", self.converter, self.channel)
    }
}

/// The channels that a pin has, by converter.
pub fn analogue_channels(pin: Pin) -> Vec<AnalogueChannel> {
    let name = pin.to_string();
    let mut channels = Vec::new();
    for (_, channel, is_of_3) in SHARED_CHANNELS.into_iter().filter(|(of, ..)| *of == name) {
        let converters = if is_of_3 { 1..=3 } else { 1..=2 };
        channels.extend(converters.map(|converter| AnalogueChannel { converter, channel }));
    }
    for (_, channel) in CHANNELS_OF_3.into_iter().filter(|(of, _)| *of == name) {
        channels.push(AnalogueChannel { converter: 3, channel });
    }
    channels
}

/// The channels that a pin has of timers that the firmware does not need.
pub fn timer_channels(pin: Pin) -> Vec<&'static str> {
    let name = pin.to_string();
    TIMER_CHANNELS.iter().filter(|(_, pins)| pins.contains(&name.as_str())).map(|(channel, _)| *channel).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_pin_has_the_channels_of_the_tables() {
        let shown = |name| analogue_channels(Pin::named(name).unwrap()).iter().map(ToString::to_string).collect();
        let channels: Vec<Vec<String>> = ["PC0", "PA4", "PF4", "PE0"].map(shown).into();
        assert_eq!(channels[0], ["ADC1_IN10", "ADC2_IN10", "ADC3_IN10"]);
        assert_eq!(channels[1], ["ADC1_IN4", "ADC2_IN4"]);
        assert_eq!(channels[2], ["ADC3_IN14"]);
        assert!(channels[3].is_empty());
        assert_eq!(timer_channels(Pin::named("PC6").unwrap()), ["TIM3_CH1", "TIM8_CH1"]);
        assert!(timer_channels(Pin::named("PA1").unwrap()).is_empty());
    }

    #[test]
    fn every_timer_channel_can_be_set_up() {
        for (name, _) in TIMER_CHANNELS {
            assert!(ferrostep_stm32f4::TimerChannel::named(name).is_some(), "{name}");
        }
    }

    #[test]
    fn every_pin_in_the_tables_is_one() {
        let timers = TIMER_CHANNELS.iter().flat_map(|(_, pins)| pins.iter().copied());
        let analogue = SHARED_CHANNELS.iter().map(|(pin, ..)| *pin).chain(CHANNELS_OF_3.iter().map(|(pin, _)| *pin));
        let others = USART1_TX
            .into_iter()
            .chain(USART1_RX)
            .chain(USB_PINS)
            .chain(SDIO_PINS)
            .chain(DEBUG_PINS.map(|(pin, _)| pin));
        for name in timers.chain(analogue).chain(others) {
            assert!(Pin::named(name).is_some(), "{name}");
        }
    }
}
