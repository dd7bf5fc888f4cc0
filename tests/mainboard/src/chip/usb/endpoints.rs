//! The driver's side of the endpoints: control registers, FIFOs, and popping received entries.

use rigless::device::{DeviceContext, RegisterFile};

use super::complaint::Complaint;
use super::fields as f;
use super::fifo::{Entry, MEMORY_WORDS, Status};
use super::{Core, Otg, Register, raise};

impl Otg {
    /// An entry of the receive FIFO, with the current frame number.
    pub(super) fn entry(
        &self,
        status: Status,
        endpoint: u8,
        toggle: bool,
        bytes: Vec<u8>,
        registers: &RegisterFile,
    ) -> Entry {
        let frame = f::dsts::FNSOF.get(registers.get(Register::Dsts)) as u16;
        Entry { status, endpoint, toggle, frame, bytes }
    }

    pub(super) fn write_in_control(
        &mut self,
        endpoint: u8,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let control = Register::Diepctl(endpoint);
        let mut value = registers.get(control);
        if usize::from(f::epctl::TXFNUM.get(value) as u8) >= self.core.endpoints() {
            self.complain(Complaint::FifoNumber, context);
        }
        value = self.apply_nak(value, context);
        let flags = Register::Diepint(endpoint);
        if f::epctl::SNAK.is_set(value) {
            raise(flags, f::diepint::INEPNE, registers);
        } else if f::epctl::CNAK.is_set(value) {
            registers.set(flags, f::diepint::INEPNE.set(registers.get(flags), 0));
        }
        if endpoint != 0 {
            value = apply_toggle(value, &mut self.input[usize::from(endpoint)].toggle);
        }
        if f::epctl::EPDIS.is_set(value) {
            if f::epctl::EPENA.is_set(value) {
                raise(flags, f::diepint::EPDISD, registers);
            }
            value = f::epctl::EPENA.set(value, 0);
        }
        registers.set(control, without_actions(value));
        if f::epctl::EPENA.is_set(value) {
            self.check_fifos(registers, context);
            if f::eptsiz::PKTCNT.get(registers.get(Register::Dieptsiz(endpoint))) == 0 {
                self.complain(Complaint::NoPacketsIn, context);
            }
        }
    }

    pub(super) fn write_out_control(
        &mut self,
        endpoint: u8,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let control = Register::Doepctl(endpoint);
        let mut value = self.apply_nak(registers.get(control), context);
        if endpoint != 0 {
            value = apply_toggle(value, &mut self.output[usize::from(endpoint)].toggle);
        }
        if f::epctl::EPDIS.is_set(value) {
            if f::epctl::EPENA.is_set(value) {
                raise(Register::Doepint(endpoint), f::doepint::EPDISD, registers);
                if !self.global_out_nak_effective {
                    self.complain(Complaint::DisableWithoutNak, context);
                }
            }
            value = f::epctl::EPENA.set(value, 0);
        }
        registers.set(control, without_actions(value));
        if f::epctl::EPENA.is_set(value) && f::eptsiz::PKTCNT.get(registers.get(Register::Doeptsiz(endpoint))) == 0 {
            self.complain(Complaint::NoPacketsOut, context);
        }
    }

    /// Applies SNAK and CNAK to NAKSTS.
    fn apply_nak(&mut self, value: u64, context: &mut DeviceContext<'_>) -> u64 {
        match (f::epctl::SNAK.is_set(value), f::epctl::CNAK.is_set(value)) {
            (true, clear) => {
                if clear {
                    self.complain(Complaint::SetAndClearNak, context);
                }
                f::epctl::NAKSTS.set(value, 1)
            }
            (false, true) => f::epctl::NAKSTS.set(value, 0),
            (false, false) => value,
        }
    }

    /// Starts a transfer when its size is written.
    pub(super) fn write_in_size(&mut self, endpoint: u8, registers: &RegisterFile) {
        let size = f::eptsiz::XFRSIZ.get(registers.get(Register::Dieptsiz(endpoint))) as u32;
        let input = &mut self.input[usize::from(endpoint)];
        input.to_send = size;
        input.loaded = 0;
    }

    /// Writes a word to an endpoint's FIFO. XFRSIZ counts down with each complete packet, 34.16.4.
    pub(super) fn write_fifo(
        &mut self,
        endpoint: u8,
        word: u32,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let fifo = self.fifo_of(endpoint, registers);
        let depth = Self::transmit_depth(fifo, registers);
        if !self.transmit[usize::from(fifo)].push(word, depth) {
            self.complain(Complaint::TransmitOverflow, context);
            return;
        }
        let size = Register::Dieptsiz(endpoint);
        let left = f::eptsiz::XFRSIZ.get(registers.get(size)) as u32;
        let packet = left.min(Self::packet_size(endpoint, Register::Diepctl(endpoint), registers));
        let input = &mut self.input[usize::from(endpoint)];
        input.loaded += 4;
        if packet > 0 && input.loaded >= packet {
            input.loaded = 0;
            registers.set(size, f::eptsiz::XFRSIZ.set(registers.get(size), u64::from(left - packet)));
        }
    }

    /// GRXSTSP: removes the front entry and applies its effects, 34.17.6.
    pub(super) fn pop(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let Some((entry, left_unread)) = self.receive.pop() else { return };
        if left_unread {
            self.complain(Complaint::UnreadPacket, context);
        }
        let flags = Register::Doepint(entry.endpoint);
        match entry.status {
            Status::GlobalOutNak => self.global_out_nak_effective = self.global_out_nak,
            Status::Setup => {}
            Status::Out => {
                let size = Register::Doeptsiz(entry.endpoint);
                let left = f::eptsiz::XFRSIZ.get(registers.get(size)).saturating_sub(entry.bytes.len() as u64);
                registers.set(size, f::eptsiz::XFRSIZ.set(registers.get(size), left));
            }
            Status::OutComplete => {
                raise(flags, f::doepint::XFRC, registers);
                self.end_when_popped(entry.endpoint, registers);
            }
            Status::SetupComplete => {
                raise(flags, f::doepint::STUP, registers);
                self.end_when_popped(entry.endpoint, registers);
            }
        }
    }

    fn end_when_popped(&self, endpoint: u8, registers: &mut RegisterFile) {
        if self.core == Core::F405 {
            disable(Register::Doepctl(endpoint), registers);
        }
    }

    /// Reports FIFOs in use that share words or end beyond the memory, 34.11.
    fn check_fifos(&mut self, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let receive = f::grxfsiz::RXFD.get(registers.get(Register::Grxfsiz)) as u32;
        let mut fifos: Vec<u8> = self
            .numbers()
            .filter(|endpoint| f::epctl::USBAEP.is_set(registers.get(Register::Diepctl(*endpoint))))
            .map(|endpoint| self.fifo_of(endpoint, registers))
            .collect();
        fifos.sort_unstable();
        fifos.dedup();
        let mut spans = vec![(0, receive)];
        spans.extend(fifos.into_iter().map(|fifo| {
            let size = registers.get(Register::Dieptxf(fifo));
            let start = f::dieptxf::SA.get(size) as u32;
            (start, start + f::dieptxf::FD.get(size) as u32)
        }));
        spans.sort_unstable();
        let overlap = spans.windows(2).any(|pair| pair[1].0 < pair[0].1);
        if overlap || spans.iter().any(|span| span.1 > MEMORY_WORDS) {
            self.complain(Complaint::Overlap, context);
        }
    }
}

/// Clears EPENA.
pub(super) fn disable(control: Register, registers: &mut RegisterFile) {
    registers.set(control, f::epctl::EPENA.set(registers.get(control), 0));
}

/// Applies SD0PID and SD1PID to the toggle and to DPID.
fn apply_toggle(value: u64, toggle: &mut bool) -> u64 {
    if f::epctl::SD0PID.is_set(value) {
        *toggle = false;
    }
    if f::epctl::SD1PID.is_set(value) {
        *toggle = true;
    }
    f::epctl::DPID.set(value, (*toggle).into())
}

/// A control register without its action bits.
fn without_actions(value: u64) -> u64 {
    let actions = [f::epctl::CNAK, f::epctl::SNAK, f::epctl::SD0PID, f::epctl::SD1PID, f::epctl::EPDIS];
    actions.iter().fold(value, |value, field| field.set(value, 0))
}
