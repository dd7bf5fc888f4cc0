//! The digest of an order of events.

/// FNV-1a-64 over two bytes an event: its axes and its directions.
///
/// Source: the FNV hash of Fowler, Noll and Vo (IETF RFC 9923): offset basis and prime of 64 bits.
#[must_use]
pub fn order_digest(events: impl IntoIterator<Item = (u8, u8)>) -> u64 {
    let one = |digest: u64, byte: u8| (digest ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
    events.into_iter().fold(0xcbf2_9ce4_8422_2325, |digest, (axes, directions)| one(one(digest, axes), directions))
}
