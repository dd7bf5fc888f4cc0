//! The firmware's side of the port.

use ferrostep_gcode::Emergency;
use ferrostep_gcode::meatpack;

/// The firmware's side of the port.
pub trait Buffers {
    /// Takes a received byte, or a [`BREAK`](crate::BREAK); returns true if there was room for it.
    fn put(&mut self, byte: u8) -> bool;
    /// The next byte to send.
    fn take(&mut self) -> Option<u8>;
    /// Takes a command that does not wait its turn; its bytes also go through [`Self::put`], before
    /// or after.
    fn emergency(&mut self, emergency: Emergency);
    /// Notes that a line of text has ended, so its host is present. The line itself may have to
    /// wait its turn.
    fn note_line(&mut self) {}
    /// Reports the MeatPack settings, for which a host waits that has switched MeatPack on or off
    /// or asks for them.
    fn report_packing(&mut self, _: meatpack::Settings) {}
}
