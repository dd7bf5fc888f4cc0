//! A TMC2209 as its serial line shows it: it answers datagrams like the chip, and can
//! be made to fail.

use super::StallSignal;
use ferrostep_tmc2209::{DriverStatus, GlobalStatus, Register, VERSION, crc8};

/// Registers that the model keeps: all addresses of seven bits.
const ADDRESSES: usize = 128;

/// Values at reset that are not 0 (TMC2209 data sheet, section 5).
const RESET_VALUES: [(Register, u32); 4] = [
    (Register::Gconf, 0x101),
    (Register::ChopConf, 0x1000_0053),
    (Register::PwmConf, 0xc10d_0024),
    (Register::Tpowerdown, 20),
];

/// The chip.
#[derive(Clone, Copy, Debug)]
pub struct DriverChip {
    address: u8,
    registers: [u32; ADDRESSES],
    accepted: u8,
    status: GlobalStatus,
    flags: u32,
    is_silent: bool,
    version: u8,
}

impl DriverChip {
    /// A chip that has just got its supply, at the address of its pins.
    #[must_use]
    pub fn new(address: u8) -> Self {
        let mut chip = Self {
            address,
            registers: [0; ADDRESSES],
            accepted: 0,
            status: GlobalStatus::default(),
            flags: 0,
            is_silent: false,
            version: VERSION,
        };
        chip.reset();
        chip
    }

    /// The supply was away for a moment: all registers are at their defaults, and GSTAT says so.
    pub fn reset(&mut self) {
        self.registers = [0; ADDRESSES];
        for (register, value) in RESET_VALUES {
            self.keep(register, value);
        }
        self.accepted = 0;
        self.flags = 0;
        self.status = GlobalStatus { reset: true, ..GlobalStatus::default() };
    }

    /// Makes the chip neither receive nor reply, as without supply.
    pub fn set_silent(&mut self, is_silent: bool) {
        self.is_silent = is_silent;
    }

    /// Says that it is another chip.
    pub fn set_version(&mut self, version: u8) {
        self.version = version;
    }

    /// Flags of DRV_STATUS; those that switch the motor off set GSTAT's too.
    pub fn set_flags(&mut self, flags: u32) {
        self.flags = flags;
        self.status.driver_error |= DriverStatus::from_bits(flags).fatal() != 0;
    }

    /// Value of a register.
    #[must_use]
    pub fn register(&self, register: Register) -> u32 {
        match register {
            Register::Gstat => self.status.bits(),
            Register::Ifcnt => u32::from(self.accepted),
            Register::Ioin => u32::from(self.version) << 24,
            // Standing still.
            Register::DrvStatus => self.flags | 1 << 31,
            Register::Tstep => 0xf_ffff,
            Register::SgResult => 100,
            _ => self.registers.get(usize::from(register.address())).copied().unwrap_or_default(),
        }
    }

    /// The conditions of its stall signal; `None`: never.
    #[must_use]
    pub fn stall_signal(&self) -> Option<StallSignal> {
        StallSignal::from_registers(|register| self.register(register)).filter(|_| !self.is_silent)
    }

    fn keep(&mut self, register: Register, value: u32) {
        if let Some(place) = self.registers.get_mut(usize::from(register.address())) {
            *place = value;
        }
    }

    /// Hears a datagram, and replies if it is a good request for its own address. Anything
    /// else it ignores.
    pub fn hear(&mut self, datagram: &[u8]) -> Option<[u8; 8]> {
        let (crc, head) = datagram.split_last()?;
        let is_good = !self.is_silent && crc8(head) == *crc;
        match *head {
            [sync, address, register] if is_good && sync & 15 == 5 && address == self.address && register < 0x80 => {
                // Write-only and unknown registers read as 0.
                let known = Register::ALL.into_iter().find(|known| known.address() == register);
                let value = known.filter(|known| known.is_readable()).map_or(0, |known| self.register(known));
                let [d3, d2, d1, d0] = value.to_be_bytes();
                let reply = [0x05, 0xff, register, d3, d2, d1, d0];
                Some([0x05, 0xff, register, d3, d2, d1, d0, crc8(&reply)])
            }
            [sync, address, register, d3, d2, d1, d0]
                if is_good && sync & 15 == 5 && address == self.address && register >= 0x80 =>
            {
                self.write(register & 0x7f, u32::from_be_bytes([d3, d2, d1, d0]));
                None
            }
            _ => None,
        }
    }

    fn write(&mut self, address: u8, value: u32) {
        self.accepted = self.accepted.wrapping_add(1);
        let known = Register::ALL.into_iter().find(|known| known.address() == address);
        match known {
            Some(Register::Gstat) => {
                self.status = GlobalStatus::from_bits(self.status.bits() & !value);
            }
            Some(register) if register.is_writable() => self.keep(register, value),
            _ => {}
        }
    }
}
