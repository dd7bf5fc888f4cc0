//! An endpoint of the open port, and the duration of its transactions.

/// Bytes of a bulk transaction besides its data, USB 2.0 table 5-9.
const OVERHEAD_BYTES: u64 = 13;

/// The duration of a transaction with this many bytes of data, ns: at 12 Mbit/s a frame holds 19
/// packets of 64 bytes.
pub(super) fn duration_ns(bytes: u64) -> u64 {
    (OVERHEAD_BYTES + bytes) * 2_000 / 3
}

/// One endpoint of the port, on the host's side.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(super) struct Pipe {
    pub endpoint: u8,
    pub size: u16,
    /// The next packet is DATA1.
    pub toggle: bool,
    pub attempts: u8,
    /// Earliest instant of the next transaction.
    pub ready_ns: u64,
    /// Frames between two polls, 0 for a bulk endpoint.
    pub interval: u16,
}
