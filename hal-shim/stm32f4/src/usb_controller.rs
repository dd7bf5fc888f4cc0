//! The full-speed USB controller (OTG_FS) as far as leaving the bus needs it.
//!
//! Addresses and bits: RM0090 34.16, RM0390 31.15.

use ferrostep_register_address::register;

use crate::registers::Registers;

/// The controller's clock in [`RCC_AHB2ENR`](crate::rcc::RCC_AHB2ENR).
pub const CLOCK: u32 = 1 << 7;

/// Device control.
pub const DCTL: u32 = register!(OTG_FS_DEVICE.dctl);
/// Bit of [`DCTL`] that leaves the bus, as if the cable had been pulled (SDIS).
pub const SOFT_DISCONNECT: u32 = 1 << 1;

const GAHBCFG: u32 = register!(OTG_FS_GLOBAL.gahbcfg);
/// GAHBCFG: the controller may interrupt.
const GINT: u32 = 1 << 0;
const GINTSTS: u32 = register!(OTG_FS_GLOBAL.gintsts);
/// GINTSTS: the host has reset the bus, and the speed is known.
const ENUMDNE: u32 = 1 << 13;
const DSTS: u32 = register!(OTG_FS_DEVICE.dsts);
/// DSTS: the speed; 11 is full speed, and the only one that this controller has.
const ENUMSPD: u32 = 0b11 << 1;

/// Returns true if the controller reports another speed than its own after a bus reset. Its driver
/// panics at such a value.
pub fn has_wrong_speed(registers: &mut impl Registers) -> bool {
    registers.read(GINTSTS) & ENUMDNE != 0 && registers.read(DSTS) & ENUMSPD != ENUMSPD
}

/// Takes the device off the bus: no interrupts any more, and the host sees it unplugged.
pub fn switch_off(registers: &mut impl Registers) {
    registers.modify(GAHBCFG, GINT, 0);
    registers.modify(DCTL, 0, SOFT_DISCONNECT);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registers::recorder::Recorder;

    /// The speeds of the manual's table: high, two that are reserved on this controller, full.
    #[test]
    fn only_full_speed_is_right() {
        for (speed, is_wrong) in [(0b00, true), (0b01, true), (0b10, true), (0b11, false)] {
            // The other bits of DSTS are the frame's number and more.
            let status = speed << 1 | 0x003f_fff9;
            let mut registers = Recorder::default().with(0x5000_0808, status).with(0x5000_0014, 1 << 13);
            assert_eq!(has_wrong_speed(&mut registers), is_wrong, "{speed:#b}");
            // Until a bus reset has ended the speed has no meaning.
            registers.fix(0x5000_0014, !(1 << 13));
            assert!(!has_wrong_speed(&mut registers));
        }
    }

    #[test]
    fn off_is_silent_and_gone() {
        let mut registers = Recorder::default().with(0x5000_0008, 0x81).with(0x5000_0804, 0x400);
        switch_off(&mut registers);
        assert_eq!(registers.stores, [(0x5000_0008, 0x80), (0x5000_0804, 0x402)]);
    }
}
