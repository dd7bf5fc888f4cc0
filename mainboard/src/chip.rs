//! The chip: an STM32F405, F407 or F446 of rigless's models, and of our own for what it lacks.
//!
//! The models are rigless's, written from RM0090 for the STM32F427, of which these chips have less: clock tree, supply, flash
//! interface, ports, DMA, converters, serial ports, TIM1 to TIM5 and TIM8, watchdog, card interface, cycle counter. Ours are the
//! EXTI and SYSCFG ([`exti`]), the other timers and the wires between timers ([`timers`]), and USB ([`usb`]). Which instances a
//! chip has, and its memories, is in [`map`].
//!
//! **Where an F405, F407 or F446 is not an F427, and the model is the F427's**
//!
//! | Section | What | What comes of it |
//! |---|---|---|
//! | 5.4.1 | the F405's and F407's voltage scale is one bit (14), the F427's and F446's two (15 and 14) | a scale that an F405 calls 1 reads as the F427's 3; nothing here judges a scale against the clock.  |
//! | RM0390 6.3.2 | the F446's PLL has an output R | nothing runs on it |
//! | RM0390 6.3.28 | DCKCFGR2 chooses USB's clock on an F446 | at reset it is the PLL's Q, which is what boards here use; another choice is reported |
//! | 3.9.2 | the F405's and F446's flash latency has three or four bits | as the F427's |

pub mod entry;
pub mod exti;
pub mod halt;
pub mod late_clocks;
pub mod map;
mod part;
pub mod timers;
pub mod usb;

use rigless::cpu::armv7m::{self, Dwt};
use rigless::device::{Level, RegisterFile};
use rigless::mcu::Operate;
use rigless::soc::st::tim::{Channel, Counter, Tim};
use rigless::soc::stm32f427::generated;
use rigless::soc::stm32f427::peripherals::adc::{Adc, AdcCommon};
use rigless::soc::stm32f427::peripherals::dbg::Dbg;
use rigless::soc::stm32f427::peripherals::dma::Dma;
use rigless::soc::stm32f427::peripherals::flash::Flash;
use rigless::soc::stm32f427::peripherals::gpio::{Gpio, Pin};
use rigless::soc::stm32f427::peripherals::iwdg::Iwdg;
use rigless::soc::stm32f427::peripherals::pwr::Pwr;
use rigless::soc::stm32f427::peripherals::rcc::{self, Rcc};
use rigless::soc::stm32f427::peripherals::rtc::Rtc;
use rigless::soc::stm32f427::peripherals::sdio::Sdio;
use rigless::soc::stm32f427::peripherals::usart::{Kind, Usart};
use rigless::soc::stm32f427::peripherals::{ADC_COMMON, CONTROLLERS, CONVERTERS};
use rigless::soc::{Bus, Error};
use rigless::store;
use rigless::time::VirtualNanos;

use crate::wiring::Chip as Model;
use entry::{ClocksF446, ENTRY_NS, Entry};
use exti::{Exti, Syscfg};
use halt::Halt;
use late_clocks::LateClocks;
use timers::{Advanced, Basic, General, Linked, OneChannel, TwoChannels};
use usb::Otg;

/// Ports A to I; the F446 has A to H.
pub const PORTS: [&str; 9] = ["GPIOA", "GPIOB", "GPIOC", "GPIOD", "GPIOE", "GPIOF", "GPIOG", "GPIOH", "GPIOI"];
/// Serial ports, with the table that each answers from (RM0090 table 148).
pub const SERIAL_PORTS: [(&str, Kind); 6] = [
    ("USART1", Kind::Usart),
    ("USART2", Kind::Usart),
    ("USART3", Kind::Usart),
    ("USART6", Kind::Usart),
    ("UART4", Kind::Uart),
    ("UART5", Kind::Uart),
];
const GENERAL: [(&str, Counter); 4] =
    [("TIM2", Counter::Wide), ("TIM3", Counter::Narrow), ("TIM4", Counter::Narrow), ("TIM5", Counter::Wide)];
const ADVANCED: [&str; 2] = ["TIM1", "TIM8"];
const BASIC: [&str; 2] = ["TIM6", "TIM7"];
const TWO_CHANNELS: [&str; 2] = ["TIM9", "TIM12"];
const ONE_CHANNEL: [&str; 4] = ["TIM10", "TIM11", "TIM13", "TIM14"];

/// All clocks are the internal oscillator's after a reset (RM0090 6.2.2, 6.3.3).
const RESET_HZ: u64 = rcc::HSI_HZ;

/// Which field answers for a slot of the bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Field {
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

impl Field {
    fn all() -> Vec<Self> {
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

    fn instance(self) -> &'static str {
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

    /// Whether the instance has a clock enable and a reset bit: all but the clock tree itself, what the core brings, and
    /// what runs without a bus clock (RM0090 2.1.11, 6.2.9, 26.3.5).
    const fn is_gated(self) -> bool {
        // The converters' common block answers while any converter is clocked.
        // What else is named here is the clock tree, what the core brings, and what has no enable.
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

/// The chip, with nothing on its pins.
#[derive(Debug)]
pub struct Stm32f4 {
    model: Model,
    /// Clock tree.
    pub rcc: Rcc,
    pwr: Pwr,
    flash: Flash,
    gpio: [Gpio; PORTS.len()],
    usart: [Usart; SERIAL_PORTS.len()],
    adc: [Adc; CONVERTERS.len()],
    adc_common: AdcCommon,
    general: [Linked<General>; GENERAL.len()],
    advanced: [Linked<Advanced>; ADVANCED.len()],
    basic: [Tim<Basic>; BASIC.len()],
    two_channels: [Linked<TwoChannels>; TWO_CHANNELS.len()],
    one_channel: [Tim<OneChannel>; ONE_CHANNEL.len()],
    dma: [Dma; CONTROLLERS.len()],
    exti: Exti,
    syscfg: Syscfg,
    otg: Otg,
    sdio: Sdio,
    rtc: Rtc,
    dbg: Dbg,
    iwdg: Iwdg,
    dwt: Dwt,
    entry: Entry,
    clocks_f446: ClocksF446,
    late_clocks: LateClocks,
    halt: Halt,
    bus: Bus,
    wiring: Box<[Field]>,
}

store!(Stm32f4 {
    values: [
        rcc,
        pwr,
        flash,
        gpio,
        adc,
        adc_common,
        general,
        advanced,
        basic,
        two_channels,
        one_channel,
        exti,
        syscfg,
        rtc,
        dbg,
        iwdg,
        dwt,
        otg,
        entry,
        clocks_f446,
        late_clocks,
        halt,
    ],
    parts: [usart, dma, sdio, bus],
    built: [model, wiring],
});

impl Stm32f4 {
    /// The chip after power-on.
    pub fn new(model: Model) -> Result<Self, Error> {
        Self::build(model, LateClocks::default())
    }

    fn build(model: Model, late_clocks: LateClocks) -> Result<Self, Error> {
        let bus = map::bus(model, late_clocks.is_on())?;
        let mut wiring = vec![Field::None; bus.slots().len()].into_boxed_slice();
        for field in Field::all() {
            wiring[bus.slot(field.instance())?] = field;
        }
        if let Some(slot) = bus.slot_of(entry::CLOCKS_F446.name) {
            wiring[slot] = Field::ClocksF446;
        }
        let adc_common = AdcCommon::with_clock(RESET_HZ);
        let mut chip = Self {
            model,
            rcc: Rcc::new(),
            pwr: Pwr::new(),
            flash: Flash::with_clock(RESET_HZ),
            gpio: std::array::from_fn(|_| Gpio::default()),
            usart: std::array::from_fn(|nth| Usart::with_clock(SERIAL_PORTS[nth].1, RESET_HZ)),
            adc: std::array::from_fn(|_| Adc::with_clock(RESET_HZ / 2) /* ADCPRE is 0 after a reset, 13.13.16 */),
            adc_common,
            general: std::array::from_fn(|nth| Linked::new(GENERAL[nth].0, RESET_HZ, GENERAL[nth].1)),
            advanced: std::array::from_fn(|nth| {
                let tim = Tim::with_clock(RESET_HZ, Counter::Narrow).breaks_on("RCC", rcc::CLOCK_FAILURE);
                Linked::wrap(ADVANCED[nth], RESET_HZ, tim)
            }),
            basic: std::array::from_fn(|_| Tim::with_clock(RESET_HZ, Counter::Narrow)),
            two_channels: std::array::from_fn(|nth| Linked::new(TWO_CHANNELS[nth], RESET_HZ, Counter::Narrow)),
            one_channel: std::array::from_fn(|_| Tim::with_clock(RESET_HZ, Counter::Narrow)),
            dma: std::array::from_fn(|nth| {
                let controller = &CONTROLLERS[nth];
                Dma::new(controller.wiring, controller.last_data, controller.reaches_memory)
            }),
            exti: Exti::default(),
            syscfg: Syscfg::default(),
            otg: Otg::new(match model {
                Model::F405 | Model::F407 => usb::Core::F405,
                Model::F446 => usb::Core::F446,
            }),
            sdio: Sdio::with_clock(0),
            rtc: Rtc,
            dbg: Dbg,
            iwdg: Iwdg::new(),
            dwt: Dwt::with_clock(RESET_HZ),
            entry: Entry::new(ENTRY_NS),
            clocks_f446: ClocksF446,
            late_clocks,
            halt: Halt::Runs,
            bus,
            wiring,
        };
        chip.check()?;
        Ok(chip)
    }

    /// Which chip it is.
    #[must_use]
    pub const fn model(&self) -> Model {
        self.model
    }

    /// The instances that have a clock enable and a reset bit of their own.
    pub(crate) fn clocked_instances() -> impl Iterator<Item = &'static str> {
        Field::all().into_iter().filter(|field| field.is_gated()).map(Field::instance)
    }

    fn registers(bus: &Bus, slot: usize) -> &RegisterFile {
        bus.slots()[slot].registers()
    }

    fn slot(&self, field: Field) -> usize {
        self.wiring.iter().position(|wired| *wired == field).unwrap_or_default()
    }

    /// The 3.3 V rail, mV: what brown-out and the flash interface compare with, and the converters' reference.
    pub fn set_supply(&mut self, millivolts: u32) {
        let slot = self.slot(Field::Pwr);
        self.pwr.set_supply(millivolts, self.bus.slot_mut(slot).registers_mut());
        if let Some(millivolts) = std::num::NonZeroU32::new(millivolts) {
            self.flash.set_supply(millivolts);
        }
        for converter in &mut self.adc {
            converter.set_reference(millivolts);
            converter.set_backup_battery(millivolts);
        }
    }

    /// How long an interrupt takes until the first instruction of its handler, ns; [`ENTRY_NS`] if never set.
    pub fn set_interrupt_entry(&mut self, delay_ns: u64) {
        self.entry = Entry::new(delay_ns);
    }

    /// Whether the core is entering a handler: it runs nothing meanwhile.
    #[must_use]
    pub fn is_entering(&self) -> bool {
        self.entry.is_entering()
    }

    /// The crystal at the high-speed pins, Hz; 0 for none, or one that does not swing.
    pub fn set_crystal(&mut self, hz: u64) {
        self.rcc.attach_crystals(hz, 0);
    }

    /// The crystal stops swinging at `at`; the clock security system notices if it is on (RM0090 6.2.7).
    pub fn stop_crystal(&mut self, at: VirtualNanos) {
        let slot = self.slot(Field::Rcc);
        let (registers, mut context) = self.bus.drive(at, slot);
        self.rcc.fail_hse(registers, &mut context);
    }

    /// The outside drives a pin from `at` on (none: it lets go).
    pub fn drive_pin(&mut self, at: VirtualNanos, pin: crate::pins::Pin, level: Option<bool>) {
        let port = usize::from(pin.port);
        let slot = self.slot(Field::Gpio(port));
        if let (Some(gpio), Some(pin)) = (self.gpio.get_mut(port), Pin::new(pin.number)) {
            let (registers, mut context) = self.bus.drive(at, slot);
            gpio.drive(pin, level.map(Level::from), registers, &mut context);
        }
    }

    /// A port's registers.
    #[must_use]
    pub fn port_registers(&self, port: usize) -> Option<&RegisterFile> {
        (port < PORTS.len()).then(|| Self::registers(&self.bus, self.slot(Field::Gpio(port))))
    }

    /// The share of time for which a timer's channel drives its pin high; none where it drives nothing.
    #[must_use]
    pub fn duty(&self, timer: u8, channel: u8) -> Option<f64> {
        let name = format!("TIM{timer}");
        let channel = Channel::new(channel)?;
        if let Some(nth) = GENERAL.iter().position(|(general, _)| *general == name) {
            let registers = Self::registers(&self.bus, self.slot(Field::General(nth)));
            return duty(&self.general[nth].tim, channel, registers);
        }
        let nth = ADVANCED.iter().position(|advanced| *advanced == name)?;
        let registers = Self::registers(&self.bus, self.slot(Field::Advanced(nth)));
        duty(&self.advanced[nth].tim, channel, registers)
    }

    /// The time of a bit on a serial port, ns, as its divider says (RM0090 30.3.4, oversampling by 16).
    #[must_use]
    pub fn bit_ns(&self, instance: &str) -> u64 {
        use generated::usart6::Register::Brr;
        let Some(nth) = SERIAL_PORTS.iter().position(|(name, _)| *name == instance) else { return 0 };
        let divider = Self::registers(&self.bus, self.slot(Field::Usart(nth))).get(Brr);
        let tree = Self::registers(&self.bus, self.slot(Field::Rcc));
        let hz = match instance {
            "USART1" | "USART6" => self.rcc.pclk2(tree),
            _ => self.rcc.pclk1(tree),
        };
        (divider * 1_000_000_000).checked_div(hz).unwrap_or(0)
    }

    /// BOR_LEV of the option bytes, RM0090 3.9.10: 0 is the highest threshold, 3 is off.
    #[must_use]
    pub fn brown_out_level(&self) -> usize {
        (self.flash.committed_options().0 >> 2 & 0b11) as usize
    }

    /// The chip's supply goes, or comes back: all is as after power-on.
    pub fn set_power(&mut self, at: VirtualNanos, on: bool) {
        let slot = self.slot(Field::Pwr);
        let (_, mut context) = self.bus.drive(at, slot);
        context.request_power(on);
    }

    /// The chip's end of the USB cable, at `at`.
    pub fn with_usb<T>(&mut self, at: VirtualNanos, cable: impl FnOnce(&mut usb::Port<'_, '_>) -> T) -> T {
        let slot = self.slot(Field::Otg);
        let (registers, mut context) = self.bus.drive(at, slot);
        cable(&mut self.otg.port(registers, &mut context))
    }

    /// The serial port called `instance`.
    pub fn serial_port(&mut self, instance: &str) -> Option<&mut Usart> {
        let nth = SERIAL_PORTS.iter().position(|(name, _)| *name == instance)?;
        self.usart.get_mut(nth)
    }

    /// Converter 1, 2 or 3.
    pub fn converter(&mut self, number: u8) -> Option<&mut Adc> {
        self.adc.get_mut(usize::from(number).checked_sub(1)?)
    }
}

fn duty<F: rigless::soc::st::tim::Family>(tim: &Tim<F>, channel: Channel, registers: &RegisterFile) -> Option<f64> {
    if let Some(pulse) = tim.pulse(channel, registers) {
        return (pulse.period.0 > 0).then(|| pulse.width.0 as f64 / pulse.period.0 as f64);
    }
    tim.output(channel, registers).map(|level| if level == Level::High { 1.0 } else { 0.0 })
}

#[cfg(test)]
mod tests;
