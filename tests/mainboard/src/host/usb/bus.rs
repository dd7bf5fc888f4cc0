//! The transactions between a host and a device on a full-speed bus.

/// A transaction as the host starts it, USB 2.0 section 8.5.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Token<'a> {
    /// Address of the device, 0 before SET_ADDRESS.
    pub address: u8,
    /// Number of the endpoint, without its direction.
    pub endpoint: u8,
    /// The kind of transaction.
    pub kind: Kind<'a>,
}

/// The kinds of transaction.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Kind<'a> {
    /// SETUP with its eight bytes, always DATA0.
    Setup([u8; 8]),
    /// Data to the device.
    Out {
        /// DATA1 rather than DATA0.
        toggle: bool,
        /// Up to one packet.
        data: &'a [u8],
    },
    /// Data from the device.
    In {
        /// The host's handshake reaches the device. Without it the device sends the packet again.
        acknowledged: bool,
    },
}

/// The answer of the device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Answer {
    /// The data were accepted.
    Ack,
    /// Not ready.
    Nak,
    /// The endpoint is halted, or the device refuses the request.
    Stall,
    /// A packet to the host.
    Data {
        /// DATA1 rather than DATA0.
        toggle: bool,
        /// Bytes of the packet.
        bytes: Vec<u8>,
    },
    /// No answer: the host's turnaround timer runs out.
    Silence,
}

/// The bus as the host drives it. Each call happens at the run's current instant.
pub trait Bus {
    /// True if a device's pull-up holds D+ high.
    fn connected(&mut self) -> bool;
    /// Switches the 5 V of the cable.
    fn set_vbus(&mut self, on: bool);
    /// Drives the reset state (SE0) from now on, or ends it.
    fn set_reset(&mut self, active: bool);
    /// Signals that the bus has been idle for 3 ms, which suspends a device.
    fn suspend(&mut self);
    /// Drives the resume state.
    fn resume(&mut self);
    /// Sends a start of frame with this number, 0 to 2047.
    fn start_of_frame(&mut self, frame: u16);
    /// Runs one transaction.
    fn transact(&mut self, token: &Token<'_>) -> Answer;
}
