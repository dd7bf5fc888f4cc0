//! The chip: an STM32F405, F407 or F446, built from rigless's models and from own models for
//! what rigless lacks.
//!
//! rigless's models were written from RM0090 for the STM32F427, of which these chips have a subset:
//! clock tree, supply, flash interface, ports, DMA, converters, serial ports, TIM1 to TIM5 and
//! TIM8, watchdog, cycle counter. Own models are the EXTI and SYSCFG ([`exti`]), endless scans of
//! the converters ([`converter`]), the other timers and the connections between timers
//! ([`timers`]), USB ([`usb`]), and the SDIO with a card's slot ([`sdio`]). [`map`] lists each
//! chip's instances and memories.
//!
//! **Where an F405, F407 or F446 differs from an F427 and the model is the F427's**
//!
//! | Section | Difference | Effect |
//! |---|---|---|
//! | 5.4.1 | the voltage scale has one bit (14) on the F405 and F407, two (15 and 14) on the F427 and F446 | scale 1 of
//! an F405 reads as scale 3 of the F427; no model compares a scale with the clock |
//! | RM0390 6.3.2 | the F446's PLL has an output R | no instance uses it |
//! | RM0390 6.3.28 | DCKCFGR2 selects USB's clock on an F446 | at reset it is the PLL's Q, which boards here use;
//! another selection is reported |
//! | 3.9.2 | the flash latency has three bits on the F405 and four on the F446 | modelled like the F427's |

pub mod converter;
pub mod entry;
pub mod exti;
mod halt;
mod instances;
pub mod late_clocks;
pub mod map;
mod part;
pub mod sdio;
pub mod timers;
pub mod usb;

use rigless::cpu::armv7m::Dwt;
use rigless::device::{Level, RegisterFile, ResetCause};
use rigless::emulator::AccessKind;
use rigless::mcu::{Mcu, Operate};
use rigless::soc::st::tim::{Channel, Counter, Tim};
use rigless::soc::stm32f427::generated;
use rigless::soc::stm32f427::peripherals::adc::AdcCommon;
use rigless::soc::stm32f427::peripherals::dbg::Dbg;
use rigless::soc::stm32f427::peripherals::dma::Dma;
use rigless::soc::stm32f427::peripherals::flash::Flash;
use rigless::soc::stm32f427::peripherals::gpio::{Gpio, Pin};
use rigless::soc::stm32f427::peripherals::iwdg::Iwdg;
use rigless::soc::stm32f427::peripherals::pwr::Pwr;
use rigless::soc::stm32f427::peripherals::rcc::{self, Rcc};
use rigless::soc::stm32f427::peripherals::rtc::Rtc;
use rigless::soc::stm32f427::peripherals::usart::Usart;
use rigless::soc::stm32f427::peripherals::{CONTROLLERS, CONVERTERS};
use rigless::soc::{Bus, Error};
use rigless::store;
use rigless::time::VirtualNanos;

use crate::wiring::{CardSlot, Chip as Model};
use converter::Converter;
use entry::{ClocksF446, ENTRY_NS, Entry};
use exti::{Exti, Syscfg};
use instances::{ADVANCED, BASIC, GENERAL, Instance, ONE_CHANNEL, TWO_CHANNELS};
pub use instances::{PORTS, SERIAL_PORTS};
use late_clocks::LateClocks;
use sdio::Sdio;
use timers::{Advanced, Basic, General, Linked, OneChannel, TwoChannels};
use usb::Otg;

/// Clock of all instances after a reset: the internal oscillator's (RM0090 6.2.2, 6.3.3).
const RESET_HZ: u64 = rcc::HSI_HZ;

/// State of the core: running, or held by something.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Halt {
    /// The core runs.
    #[default]
    Runs,
    /// A debugger.
    Debugger,
    /// The core itself: locked up, or in a loop with its interrupts off.
    Stuck,
}

/// The chip, with unconnected pins.
#[derive(Debug)]
pub struct Stm32f4 {
    model: Model,
    /// Clock tree.
    pub rcc: Rcc,
    pwr: Pwr,
    flash: Flash,
    gpio: [Gpio; PORTS.len()],
    usart: [Usart; SERIAL_PORTS.len()],
    adc: [Converter; CONVERTERS.len()],
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
    card_pins: Option<CardSlot>,
    rtc: Rtc,
    dbg: Dbg,
    iwdg: Iwdg,
    dwt: Dwt,
    entry: Entry,
    clocks_f446: ClocksF446,
    late_clocks: LateClocks,
    halt: Halt,
    bus: Bus,
    wiring: Box<[Instance]>,
    /// Slots of the ports and of the serial ports, which every store to a pin and
    /// every stop looks up.
    port_slots: [usize; PORTS.len()],
    serial_slots: [Option<usize>; SERIAL_PORTS.len()],
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
        sdio,
    ],
    parts: [usart, dma, bus],
    built: [model, wiring, port_slots, serial_slots, card_pins],
});

impl Stm32f4 {
    /// The chip after power-on.
    pub fn new(model: Model) -> Result<Self, Error> {
        Self::build(model, LateClocks::default())
    }

    fn build(model: Model, late_clocks: LateClocks) -> Result<Self, Error> {
        let bus = map::bus(model, late_clocks.is_on())?;
        let mut wiring = vec![Instance::None; bus.slots().len()].into_boxed_slice();
        for instance in Instance::all() {
            wiring[bus.slot(instance.name())?] = instance;
        }
        if let Some(slot) = bus.slot_of(entry::CLOCKS_F446.name) {
            wiring[slot] = Instance::ClocksF446;
        }
        let slot_of = |instance: Instance| wiring.iter().position(|wired| *wired == instance);
        let port_slots = std::array::from_fn(|port| slot_of(Instance::Gpio(port)).unwrap_or_default());
        let serial_slots = std::array::from_fn(|port| slot_of(Instance::Usart(port)));
        let adc_common = AdcCommon::with_clock(RESET_HZ);
        let mut chip = Self {
            model,
            rcc: Rcc::new(),
            pwr: Pwr::new(),
            flash: Flash::with_clock(RESET_HZ),
            gpio: std::array::from_fn(|_| Gpio::default()),
            usart: std::array::from_fn(|nth| Usart::with_clock(SERIAL_PORTS[nth].1, RESET_HZ)),
            adc: std::array::from_fn(
                |_| Converter::with_clock(RESET_HZ / 2), /* ADCPRE is 0 after a reset, 13.13.16 */
            ),
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
            sdio: Sdio::new(),
            card_pins: None,
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
            port_slots,
            serial_slots,
        };
        chip.check()?;
        Ok(chip)
    }

    /// The chip's type.
    #[must_use]
    pub const fn model(&self) -> Model {
        self.model
    }

    fn registers(bus: &Bus, slot: usize) -> &RegisterFile {
        bus.slots()[slot].registers()
    }

    fn slot(&self, instance: Instance) -> usize {
        self.wiring.iter().position(|wired| *wired == instance).unwrap_or_default()
    }

    /// Sets the 3.3 V rail, mV: the voltage that brown-out and flash interface compare, and the
    /// converters' reference.
    pub fn set_supply(&mut self, millivolts: u32) {
        let slot = self.slot(Instance::Pwr);
        self.pwr.set_supply(millivolts, self.bus.slot_mut(slot).registers_mut());
        if let Some(millivolts) = std::num::NonZeroU32::new(millivolts) {
            self.flash.set_supply(millivolts);
        }
        for converter in &mut self.adc {
            converter.set_reference(millivolts);
            converter.set_backup_battery(millivolts);
        }
    }

    /// Sets the time from an interrupt's request to its handler's first instruction, ns;
    /// [`ENTRY_NS`] by default.
    pub fn set_interrupt_entry(&mut self, delay_ns: u64) {
        self.entry = Entry::new(delay_ns);
    }

    /// True if the core is entering a handler, during which it executes no instruction.
    #[must_use]
    pub fn is_entering(&self) -> bool {
        self.entry.is_entering()
    }

    /// Switches [`late_clocks`] on and resets the chip as at power-on.
    pub fn start_clocks_late(&mut self) {
        self.late_clocks.switch_on();
        Mcu::reset(self, VirtualNanos(0), ResetCause::PowerOn);
    }

    /// True if clock enables take effect late.
    #[must_use]
    pub const fn clocks_start_late(&self) -> bool {
        self.late_clocks.is_on()
    }

    /// Follows an access of the firmware: a write to a clock enable starts its
    /// delay, a read ends it.
    pub fn reached(&mut self, at: VirtualNanos, kind: AccessKind, address: u64) {
        if !self.late_clocks.is_on() {
            return;
        }
        let Some((copy, enable)) = late_clocks::enable_at(address) else { return };
        let tree = Self::registers(&self.bus, self.slot(Instance::Rcc));
        let enabled = tree.get(enable);
        let delay_ns = late_clocks::delay_ns(enable, tree.get(generated::rcc::Register::Cfgr));
        let slot = self.slot(Instance::LateClocks);
        let (registers, mut context) = self.bus.drive(at, slot);
        match kind {
            AccessKind::Write => self.late_clocks.written(copy, enabled, delay_ns, registers, &mut context),
            AccessKind::Read => self.late_clocks.open(registers, |_, waiting| waiting == copy),
        }
    }

    /// Sets the crystal's frequency, Hz; 0 without a crystal or with one that does not oscillate.
    pub fn set_crystal(&mut self, hz: u64) {
        self.rcc.attach_crystals(hz, 0);
    }

    /// Stops the crystal at `at`; the clock security system reports it if it is on (RM0090 6.2.7).
    pub fn stop_crystal(&mut self, at: VirtualNanos) {
        let slot = self.slot(Instance::Rcc);
        let (registers, mut context) = self.bus.drive(at, slot);
        self.rcc.fail_hse(registers, &mut context);
    }

    /// Drives a pin from outside from `at` on; `None` releases it.
    pub fn drive_pin(&mut self, at: VirtualNanos, pin: crate::pins::Pin, level: Option<bool>) {
        let port = usize::from(pin.port);
        if let (Some(gpio), Some(&slot), Some(pin)) =
            (self.gpio.get_mut(port), self.port_slots.get(port), Pin::new(pin.number))
        {
            let (registers, mut context) = self.bus.drive(at, slot);
            gpio.drive(pin, level.map(Level::from), registers, &mut context);
        }
    }

    /// A port's registers.
    #[must_use]
    pub fn port_registers(&self, port: usize) -> Option<&RegisterFile> {
        self.port_slots.get(port).map(|slot| Self::registers(&self.bus, *slot))
    }

    /// The share of time for which a timer's channel drives its pin high; `None` if it does
    /// not drive the pin.
    #[must_use]
    pub fn duty(&self, timer: u8, channel: u8) -> Option<f64> {
        let name = format!("TIM{timer}");
        let channel = Channel::new(channel)?;
        if let Some(nth) = GENERAL.iter().position(|(general, _)| *general == name) {
            let registers = Self::registers(&self.bus, self.slot(Instance::General(nth)));
            return duty(&self.general[nth].tim, channel, registers);
        }
        let nth = ADVANCED.iter().position(|advanced| *advanced == name)?;
        let registers = Self::registers(&self.bus, self.slot(Instance::Advanced(nth)));
        duty(&self.advanced[nth].tim, channel, registers)
    }

    /// The duration of a bit on a serial port, ns, from its divider (RM0090 30.3.4,
    /// oversampling by 16).
    #[must_use]
    pub fn bit_ns(&self, instance: &str) -> u64 {
        use generated::usart6::Register::Brr;
        let Some(nth) = SERIAL_PORTS.iter().position(|(name, _)| *name == instance) else { return 0 };
        let divider = Self::registers(&self.bus, self.slot(Instance::Usart(nth))).get(Brr);
        let tree = Self::registers(&self.bus, self.slot(Instance::Rcc));
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

    /// Switches the chip's supply off, or on again with a power-on reset.
    pub fn set_power(&mut self, at: VirtualNanos, on: bool) {
        let slot = self.slot(Instance::Pwr);
        let (_, mut context) = self.bus.drive(at, slot);
        context.request_power(on);
    }

    /// Lends the chip's end of the USB cable at `at`.
    pub fn with_usb<T>(&mut self, at: VirtualNanos, cable: impl FnOnce(&mut usb::bus_side::Port<'_, '_>) -> T) -> T {
        let slot = self.slot(Instance::Otg);
        let (registers, mut context) = self.bus.drive(at, slot);
        cable(&mut self.otg.port(registers, &mut context))
    }

    /// Connects a slot for a card to these pins.
    pub fn connect_card(&mut self, slot: CardSlot) {
        self.card_pins = Some(slot);
    }

    /// Lends the SDIO with the slot.
    pub fn card_slot(&mut self) -> &mut Sdio {
        &mut self.sdio
    }

    /// Data lines that reach the slot: its pins are at the SDIO's alternate function (RM0090 8.4.1,
    /// 8.4.9, DS8626 table 9).
    fn card_lines(&self) -> u8 {
        use generated::gpioa::Register::{Afrh, Afrl, Moder};
        const ALTERNATE: u64 = 0b10;
        const SDIO: u64 = 12;
        let Some(slot) = &self.card_pins else { return 0 };
        let is_connected = |pin: &crate::pins::Pin| {
            let Some(registers) = self.port_registers(usize::from(pin.port)) else { return false };
            let function = registers.get(if pin.number < 8 { Afrl } else { Afrh }) >> (4 * (pin.number % 8)) & 0b1111;
            registers.get(Moder) >> (2 * pin.number) & 0b11 == ALTERNATE && function == SDIO
        };
        let [d0, ..] = &slot.data;
        if ![&slot.clock, &slot.command, d0].into_iter().all(is_connected) {
            return 0;
        }
        if slot.data.iter().all(is_connected) { 4 } else { 1 }
    }

    /// The serial port called `instance`.
    pub fn serial_port(&mut self, instance: &str) -> Option<&mut Usart> {
        let nth = SERIAL_PORTS.iter().position(|(name, _)| *name == instance)?;
        self.usart.get_mut(nth)
    }

    /// Converter 1, 2 or 3.
    pub fn converter(&mut self, number: u8) -> Option<&mut Converter> {
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
