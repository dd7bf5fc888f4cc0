//! Keeps the USB controller's driver from values at which it would panic.

use ferrostep_stm32f4::usb_controller;

use crate::handlers;
use crate::pac::{OTG_FS_DEVICE, OTG_FS_GLOBAL};
use crate::volatile::Volatile;

/// Looks at the controller before its driver does.
#[derive(Debug)]
pub struct UsbGuard {
    registers: Volatile,
    is_off: bool,
}

impl UsbGuard {
    /// A guard of a controller that has answered.
    pub fn new(_global: &OTG_FS_GLOBAL, _device: &OTG_FS_DEVICE) -> Self {
        // SAFETY: registers of the controller, which the caller has, and which its driver uses at
        // other times only: in the same interrupt.
        Self { registers: unsafe { Volatile::new() }, is_off: false }
    }

    /// Returns true if the driver may look at the controller now. If not, the port leaves
    /// the bus for good.
    pub fn is_sound(&mut self) -> bool {
        if !self.is_off && usb_controller::has_wrong_speed(&mut self.registers) {
            usb_controller::switch_off(&mut self.registers);
            self.is_off = true;
        }
        !self.is_off
    }

    /// Returns true if the port has left the bus.
    pub fn is_off(&self) -> bool {
        self.is_off
    }

    /// The end of the interrupt.
    pub fn complete(&self) {
        handlers::complete_stores();
    }
}
