//! The chip's interface to rigless: the model of each bus slot, and the effects of a reset.

use rigless::device::{ErasedDevice, ResetCause};
use rigless::mcu::Mcu;
use rigless::soc::stm32f427::generated;
use rigless::soc::{Bus, Layout};
use rigless::time::VirtualNanos;

use super::Stm32f4;
use super::entry::Entry;
use super::instances::Instance;

impl Mcu for Stm32f4 {
    fn bus(&self) -> &Bus {
        &self.bus
    }

    fn bus_mut(&mut self) -> &mut Bus {
        &mut self.bus
    }

    /// A reset of the whole chip, RM0090 6.1.1. Levels on its pins stay, and so do the backup
    /// domain and the debug unit's registers, except at power-on (6.1.2, 6.1.3, 38.16.3).
    fn reset(&mut self, _at: VirtualNanos, cause: ResetCause) {
        // The description was built before, so it builds again.
        let Ok(mut fresh) = Self::build(self.model, self.late_clocks.fresh()) else { return };
        let (hse_hz, lse_hz) = self.rcc.crystals();
        fresh.rcc.attach_crystals(hse_hz, lse_hz);
        fresh.rcc.calibrate_lsi(self.rcc.lsi_hz());
        fresh.set_supply(self.pwr.supply());
        fresh.entry = Entry::new(self.entry.delay_ns());
        for (fresh, old) in fresh.usart.iter_mut().zip(&mut self.usart) {
            fresh.inherit(old);
        }
        for (fresh, old) in fresh.adc.iter_mut().zip(&self.adc) {
            fresh.inherit(old);
        }
        fresh.sdio.inherit(&mut self.sdio);
        fresh.card_pins = self.card_pins;
        let (optcr, optcr1) = self.flash.committed_options();
        let flash = fresh.slot(Instance::Flash);
        fresh.flash.keep_options(optcr, optcr1, fresh.bus.slot_mut(flash).registers_mut());
        if cause != ResetCause::PowerOn {
            let rcc = self.slot(Instance::Rcc);
            let flags = Self::registers(&self.bus, rcc).get(generated::rcc::Register::Csr);
            fresh.rcc.restarted(cause, flags, fresh.bus.slot_mut(rcc).registers_mut());
            let pwr = self.slot(Instance::Pwr);
            let regulator = Self::registers(&self.bus, pwr).get(generated::pwr::Register::Csr);
            fresh.pwr.keep_backup_regulator(regulator, fresh.bus.slot_mut(pwr).registers_mut());
            keep(&self.bus, &mut fresh.bus, rcc, [generated::rcc::Register::Bdcr]);
            keep(&self.bus, &mut fresh.bus, self.slot(Instance::Rtc), generated::rtc::Register::ALL);
            use generated::dbg::Register::{DbgmcuApb1Fz, DbgmcuApb2Fz, DbgmcuCr};
            keep(&self.bus, &mut fresh.bus, self.slot(Instance::Dbg), [DbgmcuCr, DbgmcuApb1Fz, DbgmcuApb2Fz]);
        }
        if fresh.bus.keep_added(&self.bus).is_err() {
            return;
        }
        // Levels driven from outside stay: the ports' models keep them through their own reset.
        std::mem::swap(&mut fresh.gpio, &mut self.gpio);
        for gpio in &mut fresh.gpio {
            rigless::device::Device::reset(gpio);
        }
        *self = fresh;
    }

    fn poll(&mut self, now: VirtualNanos) {
        for (usart, slot) in self.usart.iter_mut().zip(self.serial_slots) {
            let Some(slot) = slot else { continue };
            let (registers, mut context) = self.bus.drive(now, slot);
            rigless::device::Device::poll(usart, registers, &mut context);
        }
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        let instance = self.wiring.get(slot).copied().unwrap_or(Instance::None);
        let model: Option<&mut dyn ErasedDevice> = match instance {
            Instance::None => None,
            Instance::Rcc => Some(&mut self.rcc),
            Instance::Pwr => Some(&mut self.pwr),
            Instance::Flash => Some(&mut self.flash),
            Instance::Gpio(nth) => Some(&mut self.gpio[nth]),
            Instance::Usart(nth) => Some(&mut self.usart[nth]),
            Instance::Adc(nth) => Some(&mut self.adc[nth]),
            Instance::AdcCommon => Some(&mut self.adc_common),
            Instance::General(nth) => Some(&mut self.general[nth]),
            Instance::Advanced(nth) => Some(&mut self.advanced[nth]),
            Instance::Basic(nth) => Some(&mut self.basic[nth]),
            Instance::TwoChannels(nth) => Some(&mut self.two_channels[nth]),
            Instance::OneChannel(nth) => Some(&mut self.one_channel[nth]),
            Instance::Dma(nth) => Some(&mut self.dma[nth]),
            Instance::Exti => Some(&mut self.exti),
            Instance::Syscfg => Some(&mut self.syscfg),
            Instance::Otg => Some(&mut self.otg),
            Instance::Sdio => {
                let lines = self.card_lines();
                self.sdio.set_lines(lines);
                Some(&mut self.sdio)
            }
            Instance::Rtc => Some(&mut self.rtc),
            Instance::Dbg => Some(&mut self.dbg),
            Instance::Iwdg => Some(&mut self.iwdg),
            Instance::Dwt => Some(&mut self.dwt),
            Instance::Entry => Some(&mut self.entry),
            Instance::ClocksF446 => Some(&mut self.clocks_f446),
            Instance::LateClocks => Some(&mut self.late_clocks),
        };
        (&mut self.bus, model)
    }
}

/// Copies registers that a reset does not clear.
fn keep<L: Layout>(from: &Bus, to: &mut Bus, slot: usize, registers: impl IntoIterator<Item = L>) {
    for register in registers {
        let value = Stm32f4::registers(from, slot).get(register);
        to.slot_mut(slot).registers_mut().set(register, value);
    }
}
