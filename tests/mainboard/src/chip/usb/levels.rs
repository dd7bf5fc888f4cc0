//! Register bits that are levels, and the interrupt line that follows from them.

use rigless::device::{DeviceContext, Level, RegisterFile};

use super::fields as f;
use super::fifo::MEMORY_WORDS;
use super::{OTG_FS, Otg, Register, raise};

impl Otg {
    /// The numbers of the core's endpoints.
    pub(super) fn numbers(&self) -> impl Iterator<Item = u8> + use<> {
        0..self.core.endpoints() as u8
    }

    /// The size of the receive FIFO, words.
    pub(super) fn receive_depth(registers: &RegisterFile) -> u32 {
        (f::grxfsiz::RXFD.get(registers.get(Register::Grxfsiz)) as u32).min(MEMORY_WORDS)
    }

    /// The transmit FIFO of an IN endpoint.
    pub(super) fn fifo_of(&self, endpoint: u8, registers: &RegisterFile) -> u8 {
        let number = f::epctl::TXFNUM.get(registers.get(Register::Diepctl(endpoint))) as u8;
        if usize::from(number) < self.core.endpoints() { number } else { endpoint }
    }

    /// The size of a transmit FIFO, words.
    pub(super) fn transmit_depth(fifo: u8, registers: &RegisterFile) -> u32 {
        (f::dieptxf::FD.get(registers.get(Register::Dieptxf(fifo))) as u32).min(MEMORY_WORDS)
    }

    /// DTXFSTS: the free words of an endpoint's FIFO.
    pub(super) fn free_words(&self, endpoint: u8, registers: &RegisterFile) -> u32 {
        let fifo = self.fifo_of(endpoint, registers);
        Self::transmit_depth(fifo, registers).saturating_sub(self.transmit[usize::from(fifo)].used())
    }

    /// Largest packet of an endpoint; endpoint 0 encodes it (64, 32, 16, 8).
    pub(super) fn packet_size(endpoint: u8, control: Register, registers: &RegisterFile) -> u32 {
        if endpoint == 0 {
            64 >> f::diepctl0::MPSIZ.get(registers.get(Register::Diepctl(0)))
        } else {
            f::epctl::MPSIZ.get(registers.get(control)) as u32
        }
    }

    /// DIEPINT including TXFE, the FIFO's level.
    pub(super) fn in_flags(&self, endpoint: u8, registers: &RegisterFile) -> u64 {
        let depth = Self::transmit_depth(self.fifo_of(endpoint, registers), registers);
        let free = self.free_words(endpoint, registers);
        let wholly = f::gahbcfg::TXFELVL.is_set(registers.get(Register::Gahbcfg));
        let empty = if wholly { free == depth } else { free >= depth.div_ceil(2) };
        f::diepint::TXFE.set(registers.get(Register::Diepint(endpoint)), empty.into())
    }

    /// DAINT: the endpoints with an unmasked flag.
    pub(super) fn endpoints_flagged(&self, registers: &RegisterFile) -> u64 {
        let in_mask = registers.get(Register::Diepmsk);
        let out_mask = registers.get(Register::Doepmsk);
        let empty_mask = registers.get(Register::Diepempmsk);
        self.numbers().fold(0, |flagged, number| {
            let empty = f::diepint::TXFE.mask();
            let flags = self.in_flags(number, registers);
            let input = flags & in_mask & !empty != 0 || (flags & empty != 0 && empty_mask >> number & 1 != 0);
            let output = registers.get(Register::Doepint(number)) & out_mask != 0;
            flagged | u64::from(input) << number | u64::from(output) << (16 + number)
        })
    }

    /// GINTSTS including the flags that are levels.
    pub(super) fn flags(&self, registers: &RegisterFile) -> u64 {
        let counted = self.endpoints_flagged(registers) & registers.get(Register::Daintmsk);
        let host = f::gusbcfg::FHMOD.is_set(registers.get(Register::Gusbcfg));
        let levels = [
            (f::gintsts::CMOD, host),
            (f::gintsts::OTGINT, registers.get(Register::Gotgint) != 0),
            (f::gintsts::RXFLVL, self.receive.front().is_some()),
            (f::gintsts::GINAKEFF, self.global_in_nak),
            (f::gintsts::GONAKEFF, self.global_out_nak_effective),
            (f::gintsts::IEPINT, f::daint::IEP.is_set(counted)),
            (f::gintsts::OEPINT, f::daint::OEP.is_set(counted)),
        ];
        levels.iter().fold(registers.get(Register::Gintsts), |flags, (field, on)| field.set(flags, (*on).into()))
    }

    /// Follows the session and drives the interrupt line: the last step of every change.
    pub(super) fn settle(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let session = self.session_valid(registers);
        if session != self.session {
            self.session = session;
            if session {
                raise(Register::Gintsts, f::gintsts::SRQINT, registers);
            } else {
                raise(Register::Gotgint, f::gotgint::SEDET, registers);
            }
        }
        if !self.connected(registers) {
            // For the host the device has left; the core answers after the next reset only.
            self.ready = false;
        }
        let enabled = f::gahbcfg::GINT.is_set(registers.get(Register::Gahbcfg));
        let line = enabled && self.flags(registers) & registers.get(Register::Gintmsk) != 0;
        if line != self.line {
            self.line = line;
            context.interrupt(OTG_FS, if line { Level::High } else { Level::Low });
        }
    }

    /// GRXSTSR for the entry at the front, 0 while the FIFO is empty.
    pub(super) fn front(&self) -> u64 {
        self.receive.front().map_or(0, |entry| {
            let mut word = f::grxsts::EPNUM.set(0, entry.endpoint.into());
            word = f::grxsts::BCNT.set(word, entry.bytes.len() as u64);
            word = f::grxsts::DPID.set(word, if entry.toggle { 2 } else { 0 });
            word = f::grxsts::PKTSTS.set(word, entry.status.code());
            f::grxsts::FRMNUM.set(word, u64::from(entry.frame) & 0xF)
        })
    }
}
