//! Guard that keeps the driver of the USB controller from values at which it would panic.

use ferrostep_stm32f4::usb_controller;

use crate::handlers;
use crate::pac::{OTG_FS_DEVICE, OTG_FS_GLOBAL};
use crate::volatile::Volatile;

/// Check of the controller before its driver accesses it.
#[derive(Debug)]
pub struct UsbGuard {
    registers: Volatile,
    is_off: bool,
}

impl UsbGuard {
    /// Creates the guard of a controller that has answered.
    pub fn new(_global: &OTG_FS_GLOBAL, _device: &OTG_FS_DEVICE) -> Self {
        // SAFETY: registers of the controller, which the caller has, and which its driver uses at
        // other times only: in the same interrupt.
        Self { registers: unsafe { Volatile::new() }, is_off: false }
    }

    /// Returns true if the driver may access the controller now. Otherwise the port leaves the bus
    /// for good.
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

    /// Ends the interrupt.
    pub fn complete(&self) {
        handlers::complete_stores();
    }
}
