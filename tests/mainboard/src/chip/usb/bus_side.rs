//! The host's side of the core: the pull-up, bus states and transactions.

use rigless::device::{DeviceContext, Level, RegisterFile};
use rigless::time::VirtualNanos;

use super::complaint::Complaint;
use super::endpoints::disable;
use super::fields as f;
use super::fifo::Status;
use super::{Core, Otg, Register, WAKEUP, raise};
use crate::host::usb::bus::{Answer, Bus, Kind, Token};

/// Minimum duration of SE0 that a device accepts as a reset, USB 2.0 section 7.1.7.5.
pub const RESET_SEEN_NS: u64 = 2_500;
/// Time from the end of a reset to ENUMDNE. The manual gives none; the core has a single speed and
/// nothing to detect.
pub const ENUMERATION_NS: u64 = 10_000;
/// The clock of a full-speed device: 48 MHz within 0.25 %, USB 2.0 section 7.1.11.
const CLOCK_HZ: std::ops::RangeInclusive<u64> = 47_880_000..=48_120_000;

/// The core with its registers and its clock at one instant, as the host drives it.
#[derive(Debug)]
pub struct Port<'a, 'b> {
    otg: &'a mut Otg,
    registers: &'a mut RegisterFile,
    context: &'a mut DeviceContext<'b>,
}

impl Otg {
    /// The host's side of the core at this instant.
    pub fn port<'a, 'b>(
        &'a mut self,
        registers: &'a mut RegisterFile,
        context: &'a mut DeviceContext<'b>,
    ) -> Port<'a, 'b> {
        Port { otg: self, registers, context }
    }
}

impl Bus for Port<'_, '_> {
    fn connected(&mut self) -> bool {
        self.otg.connected(self.registers)
    }

    fn set_vbus(&mut self, on: bool) {
        self.otg.vbus = on;
        if !on {
            self.otg.ready = false;
            self.otg.in_reset = false;
            self.otg.reset_seen = None;
            self.otg.enumerated = None;
        }
        self.otg.settle(self.registers, self.context);
    }

    fn set_reset(&mut self, active: bool) {
        let now = self.context.now().0;
        if active && !self.otg.in_reset {
            self.otg.ready = false;
            self.otg.enumerated = None;
            self.otg.reset_seen = Some(self.context.schedule(VirtualNanos(now + RESET_SEEN_NS)));
        } else if !active && self.otg.in_reset && self.otg.reset_seen.take().is_none() {
            self.otg.enumerated = Some(self.context.schedule(VirtualNanos(now + ENUMERATION_NS)));
        }
        self.otg.in_reset = active;
    }

    fn suspend(&mut self) {
        if self.otg.connected(self.registers) {
            raise(Register::Gintsts, f::gintsts::ESUSP, self.registers);
            raise(Register::Gintsts, f::gintsts::USBSUSP, self.registers);
            raise(Register::Dsts, f::dsts::SUSPSTS, self.registers);
            self.otg.settle(self.registers, self.context);
        }
    }

    fn resume(&mut self) {
        let status = self.registers.get(Register::Dsts);
        if self.otg.connected(self.registers) && f::dsts::SUSPSTS.is_set(status) {
            self.registers.set(Register::Dsts, f::dsts::SUSPSTS.set(status, 0));
            raise(Register::Gintsts, f::gintsts::WKUPINT, self.registers);
            self.context.request(WAKEUP, Level::High);
            self.context.request(WAKEUP, Level::Low);
            self.otg.settle(self.registers, self.context);
        }
    }

    fn start_of_frame(&mut self, frame: u16) {
        if self.otg.listening(self.registers) {
            let status = self.registers.get(Register::Dsts);
            self.registers.set(Register::Dsts, f::dsts::FNSOF.set(status, frame.into()));
            raise(Register::Gintsts, f::gintsts::SOF, self.registers);
            self.otg.settle(self.registers, self.context);
        }
    }

    fn transact(&mut self, token: &Token<'_>) -> Answer {
        let answer = self.otg.transact(token, self.registers, self.context);
        self.otg.settle(self.registers, self.context);
        answer
    }
}

impl Otg {
    /// True if a B session is valid, 34.16.2 (GCCFG, GOTGCTL).
    pub(super) fn session_valid(&self, registers: &RegisterFile) -> bool {
        let config = registers.get(Register::Gccfg);
        match self.core {
            // Bit 21 is NOVBUSSENS.
            Core::F405 => f::gccfg::BIT21.is_set(config) || (f::gccfg::VBUSBSEN.is_set(config) && self.vbus),
            // Bit 21 is VBDEN; the software may set the session's validity instead.
            Core::F446 => {
                let control = registers.get(Register::Gotgctl);
                if f::gotgctl::BVALOEN.is_set(control) {
                    f::gotgctl::BVALOVAL.is_set(control)
                } else {
                    f::gccfg::BIT21.is_set(config) && self.vbus
                }
            }
        }
    }

    /// True if the pull-up is on.
    pub(super) fn connected(&self, registers: &RegisterFile) -> bool {
        CLOCK_HZ.contains(&self.clock_hz)
            && f::gccfg::PWRDWN.is_set(registers.get(Register::Gccfg))
            && !f::dctl::SDIS.is_set(registers.get(Register::Dctl))
            && !f::gusbcfg::FHMOD.is_set(registers.get(Register::Gusbcfg))
            && self.session_valid(registers)
    }

    /// True if the core receives from the bus.
    fn listening(&self, registers: &RegisterFile) -> bool {
        let gates = f::pcgcctl::STPPCLK.mask() | f::pcgcctl::GATEHCLK.mask();
        self.ready && !self.in_reset && self.connected(registers) && registers.get(Register::Pcgcctl) & gates == 0
    }

    /// Sets USBRST and resets what the core resets by itself.
    pub(super) fn on_bus_reset(&mut self, registers: &mut RegisterFile) {
        if !self.connected(registers) {
            return;
        }
        raise(Register::Gintsts, f::gintsts::USBRST, registers);
        let status = registers.get(Register::Dsts);
        registers.set(Register::Dsts, f::dsts::SUSPSTS.set(f::dsts::ENUMSPD.set(status, 0), 0));
        for endpoint in self.numbers().skip(1) {
            for control in [Register::Diepctl(endpoint), Register::Doepctl(endpoint)] {
                registers.set(control, f::epctl::USBAEP.set(registers.get(control), 0));
            }
        }
        self.output[0].setup_open = false;
        self.control_open = false;
    }

    /// A packet without data at endpoint 0 ends a control transfer; an address that came in
    /// it takes effect.
    fn end_control(&mut self, endpoint: u8, length: usize, registers: &RegisterFile) {
        if endpoint == 0 && length == 0 {
            self.control_open = false;
            self.address = f::dcfg::DAD.get(registers.get(Register::Dcfg)) as u8;
        }
    }

    /// ENUMDNE: full speed with a transceiver of 48 MHz, the only possible answer.
    pub(super) fn on_enumerated(&mut self, registers: &mut RegisterFile) {
        if !self.connected(registers) {
            return;
        }
        registers.set(Register::Dsts, f::dsts::ENUMSPD.set(registers.get(Register::Dsts), 3));
        raise(Register::Gintsts, f::gintsts::ENUMDNE, registers);
        self.ready = true;
    }

    fn transact(&mut self, token: &Token<'_>, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) -> Answer {
        let present = usize::from(token.endpoint) < self.core.endpoints();
        if !self.listening(registers) || self.address != token.address || !present {
            return Answer::Silence;
        }
        if token.endpoint == 0 && !matches!(token.kind, Kind::Setup(_)) {
            self.end_setup(registers);
        }
        match token.kind {
            Kind::Setup(bytes) if token.endpoint == 0 => self.setup(bytes, registers, context),
            Kind::Setup(_) => Answer::Silence,
            Kind::Out { toggle, data } => self.out(token.endpoint, toggle, data, registers, context),
            Kind::In { acknowledged } => self.input(token.endpoint, acknowledged, registers),
        }
    }

    /// Writes the end of the SETUP stage at the first token after it.
    fn end_setup(&mut self, registers: &RegisterFile) {
        if std::mem::take(&mut self.output[0].setup_open) {
            let end = self.entry(Status::SetupComplete, 0, false, Vec::new(), registers);
            self.receive.push(end);
        }
    }

    fn setup(&mut self, bytes: [u8; 8], registers: &mut RegisterFile, context: &mut DeviceContext<'_>) -> Answer {
        if !self.receive.takes_setup(Self::receive_depth(registers)) {
            self.complain(Complaint::SetupLost, context);
            return Answer::Silence;
        }
        let size = registers.get(Register::Doeptsiz(0));
        let left = f::doeptsiz0::STUPCNT.get(size);
        if left == 0 {
            raise(Register::Doepint(0), f::doepint::B2BSTUP, registers);
        }
        registers.set(Register::Doeptsiz(0), f::doeptsiz0::STUPCNT.set(size, left.saturating_sub(1)));
        let entry = self.entry(Status::Setup, 0, false, bytes.to_vec(), registers);
        self.receive.push(entry);
        self.output[0].setup_open = true;
        self.control_open = true;
        self.output[0].toggle = true;
        self.input[0].toggle = true;
        for control in [Register::Diepctl(0), Register::Doepctl(0)] {
            let value = f::epctl::STALL.set(registers.get(control), 0);
            registers.set(control, f::epctl::NAKSTS.set(value, 1));
        }
        if self.core == Core::F446 {
            disable(Register::Doepctl(0), registers);
        }
        Answer::Ack
    }

    fn out(
        &mut self,
        endpoint: u8,
        toggle: bool,
        data: &[u8],
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Answer {
        let register = Register::Doepctl(endpoint);
        let control = registers.get(register);
        if !f::epctl::USBAEP.is_set(control) {
            return Answer::Silence;
        }
        if f::epctl::STALL.is_set(control) {
            return Answer::Stall;
        }
        let largest = Self::packet_size(endpoint, register, registers) as usize;
        if data.len() > largest {
            self.complain(Complaint::Babble, context);
            return Answer::Silence;
        }
        let enabled = f::epctl::EPENA.is_set(control);
        if !enabled && endpoint == 0 {
            raise(Register::Doepint(0), f::doepint::OTEPDIS, registers);
        }
        if !enabled || f::epctl::NAKSTS.is_set(control) || self.global_out_nak {
            return Answer::Nak;
        }
        if toggle != self.output[usize::from(endpoint)].toggle {
            // The host missed the acknowledgement: the packet is a repetition.
            return Answer::Ack;
        }
        let active = |endpoint: &u8| f::epctl::USBAEP.is_set(registers.get(Register::Doepctl(*endpoint)));
        let transfers = self.numbers().filter(active).count() as u32;
        if !self.receive.takes_packet(data.len(), Self::receive_depth(registers), transfers) {
            self.complain(Complaint::ReceiveFull, context);
            return Answer::Nak;
        }
        let entry = self.entry(Status::Out, endpoint, toggle, data.to_vec(), registers);
        self.receive.push(entry);
        self.output[usize::from(endpoint)].toggle = !toggle;
        self.end_control(endpoint, data.len(), registers);
        let size = Register::Doeptsiz(endpoint);
        let left = f::eptsiz::PKTCNT.get(registers.get(size)).saturating_sub(1);
        registers.set(size, f::eptsiz::PKTCNT.set(registers.get(size), left));
        let mut control = registers.get(register);
        if endpoint != 0 {
            control = f::epctl::DPID.set(control, (!toggle).into());
        }
        if left == 0 || data.len() < largest {
            control = f::epctl::NAKSTS.set(control, 1);
            if self.core == Core::F446 {
                control = f::epctl::EPENA.set(control, 0);
            }
            let end = self.entry(Status::OutComplete, endpoint, false, Vec::new(), registers);
            self.receive.push(end);
        }
        registers.set(register, control);
        Answer::Ack
    }

    fn input(&mut self, endpoint: u8, acknowledged: bool, registers: &mut RegisterFile) -> Answer {
        let register = Register::Diepctl(endpoint);
        let control = registers.get(register);
        if !f::epctl::USBAEP.is_set(control) {
            return Answer::Silence;
        }
        if f::epctl::STALL.is_set(control) {
            return Answer::Stall;
        }
        let fifo = usize::from(self.fifo_of(endpoint, registers));
        let flags = Register::Diepint(endpoint);
        let size = Register::Dieptsiz(endpoint);
        let packets = f::eptsiz::PKTCNT.get(registers.get(size));
        let input = self.input[usize::from(endpoint)];
        let length = input.to_send.min(Self::packet_size(endpoint, register, registers)) as usize;
        let armed = f::epctl::EPENA.is_set(control) && packets > 0;
        if self.transmit[fifo].used() == 0 && !(armed && length == 0) {
            raise(flags, f::diepint::ITTXFE, registers);
        }
        if !armed || f::epctl::NAKSTS.is_set(control) || self.global_in_nak {
            return Answer::Nak;
        }
        let Some(bytes) = self.transmit[fifo].peek_packet(length) else { return Answer::Nak };
        let toggle = input.toggle;
        if !acknowledged {
            raise(flags, f::diepint::TOC, registers);
            return Answer::Data { toggle, bytes };
        }
        self.transmit[fifo].drop_packet(length);
        self.end_control(endpoint, length, registers);
        let input = &mut self.input[usize::from(endpoint)];
        input.toggle = !toggle;
        input.to_send -= length as u32;
        registers.set(size, f::eptsiz::PKTCNT.set(registers.get(size), packets - 1));
        let mut control = control;
        if endpoint != 0 {
            control = f::epctl::DPID.set(control, (!toggle).into());
        }
        if packets == 1 {
            control = f::epctl::EPENA.set(control, 0);
            raise(flags, f::diepint::XFRC, registers);
        }
        registers.set(register, control);
        Answer::Data { toggle, bytes }
    }
}
