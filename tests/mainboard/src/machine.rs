//! The machine: the chip, the printer around it, and the decoder of its step pins.

pub mod mailbox;
mod ports;
mod stores;

use std::num::{NonZeroU32, NonZeroU64};

use rigless::cpu::armv7m as core;
use rigless::machine::armv7m::{self, Fpu, MpuRegions, Variant};
use rigless::machine::{Board as Rigless, Target};
use rigless::mcu::{Mcu, Operate};
use rigless::store;
use rigless::time::VirtualNanos;

use crate::chip::Stm32f4;
use crate::decode::Decoder;
use crate::host::usb::{State, UsbHost};
use crate::parts::sd_card::SdCard;
use crate::plant::Plant;
use crate::wiring::{Board, Printer};
use mailbox::Mailbox;
use ports::Ports;
pub use stores::Store;

/// Instructions per second of virtual time. The cycle model of the step interrupt averages 1.4
/// cycles an instruction (docs/src/stepping.md); at 168 MHz that is 120 million.
pub const INSTRUCTIONS_PER_SECOND: u64 = 120_000_000;
/// The core's clock; SysTick counts eighths of it.
const CORE_HZ: u64 = 168_000_000;
/// Steps of different motors within this time are one event: one store a port, with some
/// instructions in between.
const EVENT_WINDOW_NS: u64 = 400;
/// The serial line of the host.
pub const HOST_PORT: &str = "USART1";
/// The serial line that drivers share on some boards.
const DRIVER_PORT: &str = "USART2";
/// Time that the computer waits before it polls the printer again after a NAK, ns: longer than on a
/// real bus, which would interrupt the run every 50 us without any data.
const NAK_RETRY_NS: u64 = 250_000;
/// Falling thresholds of the brown-out reset by its level in the option bytes, mV: DS8626 table
/// 22 (typical). Level 3 switches the brown-out reset off and leaves the threshold of the
/// power-down reset.
const BROWN_OUT_MV: [f64; 4] = [2830.0, 2500.0, 2190.0, 1680.0];
const BROWN_OUT_HYSTERESIS_MV: f64 = 100.0;

/// A board with a printer around it.
#[derive(Debug)]
pub struct Machine {
    /// The chip.
    pub chip: Stm32f4,
    /// The printer.
    pub plant: Plant,
    /// The decoder of the step pins.
    pub decoder: Decoder,
    /// The computer at the USB plug.
    pub usb_host: UsbHost,
    /// Stores to peripherals, from the call of [`Machine::keep_stores`] on.
    stores: Option<Vec<Store>>,
    ports: Ports,
    instructions_per_second: NonZeroU64,
    powered: bool,
    shares_line: bool,
    resets_seen: usize,
    records_steps: bool,
}

store!(Machine {
    values: [plant, decoder, usb_host, stores, ports, powered, resets_seen],
    parts: [chip],
    built: [instructions_per_second, shares_line, records_steps],
});

impl Machine {
    /// A board and a printer according to their files, with everything off except the supply.
    ///
    /// # Errors
    /// The files contradict each other, or rigless's description of the chip is inconsistent.
    pub fn new(board: &Board, printer: &Printer, seed: u64) -> Result<Self, String> {
        let mut chip =
            Stm32f4::new(board.chip).map_err(|error| format!("the chip's model is inconsistent: {error}"))?;
        chip.set_crystal(u64::from(board.crystal_hz));
        chip.set_supply(3300);
        let shares_line = board.driver_uart.is_some();
        for (port, one_wire) in [(HOST_PORT, false), (DRIVER_PORT, shares_line)] {
            if let Some(line) = chip.serial_port(port) {
                line.attach(Mailbox::new(one_wire));
            }
        }
        if let Some(slot) = board.card {
            chip.connect_card(slot);
        }
        let plant = Plant::new(board, printer, seed)?;
        Ok(Self {
            chip,
            ports: Ports::new(board, &plant),
            plant,
            decoder: Decoder::new(board, printer, EVENT_WINDOW_NS),
            usb_host: {
                let mut host = UsbHost::new();
                host.timing.nak_retry_ns = NAK_RETRY_NS;
                host
            },
            stores: None,
            instructions_per_second: NonZeroU64::new(INSTRUCTIONS_PER_SECOND).unwrap_or(NonZeroU64::MIN),
            powered: true,
            shares_line,
            resets_seen: 0,
            records_steps: true,
        })
    }

    /// Sets the core's rate, by default [`INSTRUCTIONS_PER_SECOND`]: a lower rate stands
    /// for wait states.
    pub fn set_instructions_per_second(&mut self, rate: NonZeroU64) {
        self.instructions_per_second = rate;
    }

    /// Keeps no record of steps, for a machine that runs for days without a trace to compare.
    pub fn stop_recording_steps(&mut self) {
        self.records_steps = false;
    }

    /// The far end of a serial port.
    pub fn mailbox(&mut self, port: &str) -> Option<&mut Mailbox> {
        self.chip.serial_port(port)?.chip_mut::<Mailbox>()
    }

    /// Records every store to a peripheral from now on: some ten bytes each, millions in a print.
    pub fn keep_stores(&mut self) {
        self.stores.get_or_insert_default();
    }

    /// The recorded stores, in program order.
    #[must_use]
    pub fn stores(&self) -> &[Store] {
        self.stores.as_deref().unwrap_or_default()
    }

    /// Follows a store of the firmware to a peripheral's register.
    pub fn record_store(&mut self, at_ns: u64, address: u64, value: u64) {
        if let Some(stores) = &mut self.stores {
            let (address, value) = (address as u32, value as u32);
            match stores.last_mut() {
                Some(last) if (last.address, last.value) == (address, value) => {
                    last.times = last.times.saturating_add(1);
                    last.until_ns = at_ns;
                }
                _ => stores.push(Store { at_ns, until_ns: at_ns, times: 1, address, value }),
            }
        }
        self.port_reached(at_ns, address);
    }

    fn port_reached(&mut self, now_ns: u64, address: u64) {
        if let Some(port) = Ports::at(address) {
            self.update_port(now_ns, port);
        }
    }

    fn update_port(&mut self, now_ns: u64, port: usize) {
        let Some(registers) = self.chip.port_registers(port) else { return };
        for (pin, level, is_edge) in self.ports.changes(port, registers) {
            if let Some(high) = level
                && self.records_steps
                && (is_edge || !self.ports.is_step(pin))
            {
                self.decoder.edge(now_ns, pin, high);
            }
            self.plant.output(now_ns, pin, level);
        }
        if let Some((pin, level)) = self.plant.take_answer() {
            self.chip.drive_pin(VirtualNanos(now_ns), pin, level);
        }
    }

    /// Advances everything around the chip to `now_ns`.
    pub fn advance(&mut self, now_ns: u64, resets: usize) {
        if self.resets_seen != resets {
            self.resets_seen = resets;
            for port in 0..ports::COUNT {
                self.update_port(now_ns, port);
            }
            self.follow_timers(now_ns);
        }
        self.exchange_with_drivers();
        if self.usb_host.next_event_ns() <= now_ns {
            let host = &mut self.usb_host;
            self.chip.with_usb(VirtualNanos(now_ns), |cable| host.advance(now_ns, cable));
        }
        if self.plant.advance(now_ns) {
            self.follow_timers(now_ns);
            for (adc, millivolts) in self.plant.voltages(now_ns) {
                if let Some(converter) = self.chip.converter(adc.converter) {
                    converter.set_input(adc.channel, millivolts);
                }
            }
            self.follow_rail(now_ns);
        }
        self.drive_inputs(now_ns);
    }

    /// Drives the chip's inputs as the printer around it does now.
    pub fn drive_inputs(&mut self, now_ns: u64) {
        for (pin, level) in self.plant.take_inputs() {
            self.chip.drive_pin(VirtualNanos(now_ns), pin, level);
        }
    }

    /// The next event of the computer at the USB plug, ns.
    #[must_use]
    pub fn usb_next_ns(&self) -> Option<u64> {
        (self.usb_host.state() != State::Unplugged).then(|| self.usb_host.next_event_ns())
    }

    /// Passes the duty cycles of timer outputs to heaters and fans.
    fn follow_timers(&mut self, now_ns: u64) {
        for heater in 0..self.plant.heaters.len() {
            let switched = self.plant.heaters[heater].switched;
            if let Some(power) = self.ports.timer_power(&self.chip, switched) {
                self.plant.power_heater(now_ns, heater, power);
            }
        }
        for fan in 0..self.plant.fans.len() {
            let switched = self.plant.fans[fan].switched;
            if let Some(power) = self.ports.timer_power(&self.chip, switched) {
                self.plant.power_fan(now_ns, fan, power);
            }
        }
    }

    fn exchange_with_drivers(&mut self) {
        if !self.shares_line {
            return;
        }
        let bit_ns = self.chip.bit_ns(DRIVER_PORT);
        let Some(mailbox) = self.chip.serial_port(DRIVER_PORT).and_then(|line| line.chip_mut::<Mailbox>()) else {
            return;
        };
        let sent: Vec<(u64, u16)> = mailbox.take().collect();
        for (ended_ns, word) in sent {
            self.plant.serial_byte(ended_ns.saturating_sub(10 * bit_ns), bit_ns, word as u8);
        }
        let replies = self.plant.take_replies();
        if let Some(mailbox) = self.mailbox(DRIVER_PORT) {
            for (due_ns, byte) in replies {
                mailbox.send(due_ns, u16::from(byte));
            }
        }
    }

    /// Passes the supply voltage to the chip; below the threshold the chip stands in reset
    /// (RM0090 5.2.2, 5.2.3).
    fn follow_rail(&mut self, now_ns: u64) {
        let millivolts = self.plant.chip_rail.millivolts(now_ns);
        let threshold = BROWN_OUT_MV[self.chip.brown_out_level()];
        let powered =
            if self.powered { millivolts >= threshold } else { millivolts >= threshold + BROWN_OUT_HYSTERESIS_MV };
        if powered != self.powered {
            self.powered = powered;
            self.chip.set_power(VirtualNanos(now_ns), powered);
            self.plant.power_logic(now_ns, powered);
            if let Some(card) = self.chip.card_slot().card_mut() {
                card.set_power(now_ns, powered);
            }
            if !powered {
                // Pins without supply float: the gates' pull-down resistors switch off.
                self.plant.release_gates(now_ns);
            }
        }
        if powered {
            self.chip.set_supply(millivolts.round() as u32);
        }
    }

    /// Puts a card into the slot; returns the one that was in it.
    pub fn insert_card(&mut self, now_ns: u64, card: SdCard) -> Option<SdCard> {
        self.exchange_card(now_ns, Some(card))
    }

    /// Pulls the card out of the slot.
    pub fn pull_card(&mut self, now_ns: u64) -> Option<SdCard> {
        self.exchange_card(now_ns, None)
    }

    fn exchange_card(&mut self, now_ns: u64, card: Option<SdCard>) -> Option<SdCard> {
        self.plant.is_card_inserted = card.is_some();
        self.plant.refresh_inputs();
        self.chip.card_slot().exchange(now_ns, card, self.powered)
    }

    /// The card in the slot.
    pub fn card(&mut self) -> Option<&mut SdCard> {
        self.chip.card_slot().card_mut()
    }

    /// The number of resets so far.
    #[must_use]
    pub const fn resets(&self) -> usize {
        self.resets_seen
    }

    /// True if the chip has its supply.
    #[must_use]
    pub const fn powered(&self) -> bool {
        self.powered
    }
}

impl Rigless for Machine {
    fn name(&self) -> &'static str {
        "mainboard"
    }

    fn target_names(&self) -> Vec<&'static str> {
        vec!["mcu"]
    }

    fn mcu(&mut self, target: usize) -> Option<&mut dyn Mcu> {
        (target == 0).then_some(&mut self.chip)
    }

    fn targets(&mut self) -> Vec<Target<'_>> {
        let one = NonZeroU32::MIN;
        let core = armv7m::Core {
            variant: Variant::M4,
            clock_hz: NonZeroU64::new(CORE_HZ).unwrap_or(NonZeroU64::MIN),
            interrupt_lines: NonZeroU32::new(u32::from(self.chip.cpu().interrupt_lines)).unwrap_or(one),
            priority_bits: 4,
            refclk_divider: NonZeroU32::new(8).unwrap_or(one),
            instructions_per_second: self.instructions_per_second,
            boot: "flash",
        }
        .spec_with_parts(&core::windows(self.chip.bus()), Fpu::FpV4Sp, MpuRegions::Eight);
        vec![Target::new("mcu", &mut self.chip, core)]
    }
}
