//! A board's motors, and the ports that carry their signals.

use ferrostep_step_player::{OutputPorts, Pin};
use ferrostep_stm32f4::gpio::{self, BSRR};

/// A board's motors.
pub trait Motors<const PORTS: usize> {
    /// Constant of [`ferrostep_hal_shim::MotionWatch::FOLLOWS_FILAMENT`].
    const FOLLOWS_FILAMENT: bool = false;
    /// Constant of [`ferrostep_hal_shim::MotionWatch::HAS_FILAMENT_SWITCH`].
    const HAS_FILAMENT_SWITCH: bool = false;
    /// Number of motors that lift Z.
    const Z_MOTORS: usize = 1;
    /// Step pin of one of the motors that lift Z; the first is the axis's own.
    fn z_step_pin(_motor: usize) -> Option<Pin> {
        None
    }
    /// Number of extruders; one of them steps at a time.
    const EXTRUDERS: usize = 1;
    /// The step pin of a tool's extruder.
    fn extruder_step_pin(_tool: usize) -> Option<Pin> {
        None
    }
    /// Ports that carry the step and direction signals.
    fn ports(&self) -> MotorPorts<PORTS>;
    /// Switches the drivers in the mask on, and the others off. Drivers that share a signal are on
    /// while one of them is.
    fn enable(&self, on: u8);

    /// Reads a sensor as [`ferrostep_hal_shim::HomingSensors::is_sensor_triggered`] does.
    fn is_sensor_triggered(&self, _axis: usize) -> bool {
        false
    }
    /// Watches a sensor as [`ferrostep_hal_shim::HomingSensors::watch_sensor`] does.
    fn watch_sensor(&self, _axis: Option<usize>) {}
}

/// A port that carries step and direction signals.
#[derive(Clone, Copy, Debug)]
pub struct MotorPort {
    /// Address of the port's BSRR: one store sets and resets pins, without a read.
    bsrr: *mut u32,
}

// SAFETY: a store to BSRR is atomic, and its effect depends on the word alone.
unsafe impl Send for MotorPort {}
// SAFETY: as for `Send`.
unsafe impl Sync for MotorPort {}

impl MotorPort {
    /// Returns the port with this index: 0 is A (RM0090 2.3 and 8.4.7: all ports have the same
    /// layout).
    ///
    /// # Safety
    /// The caller must be entitled to every pin to which it will write.
    pub(crate) const unsafe fn of(index: u8) -> Self {
        Self { bsrr: (gpio::port(index) + BSRR) as *mut u32 }
    }

    /// Stores a word to BSRR, which sets and resets pins at once, without a read.
    #[inline(always)]
    pub(crate) fn write(self, word: u32) {
        // SAFETY: the address is a port's BSRR, always writable; zeros have no effect, and ones
        // name pins that are the caller's by the contract of `of`.
        unsafe { self.bsrr.write_volatile(word) }
    }
}

/// The ports of a board.
#[derive(Clone, Copy, Debug)]
pub struct MotorPorts<const PORTS: usize>(pub [MotorPort; PORTS]);

impl<const PORTS: usize> OutputPorts<PORTS> for MotorPorts<PORTS> {
    #[inline(always)]
    fn write(&self, port: usize, word: u32) {
        if let Some(port) = self.0.get(port) {
            port.write(word);
        }
    }
}
