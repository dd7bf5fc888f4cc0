//! The checksum of headers, frames and transfers.

/// [`CRC`] of bytes that are all there: three instructions a byte, a word at a time, where the
/// crate's loop has eight.
pub(crate) fn checksum(bytes: &[u8]) -> u32 {
    let [table] = CRC.table();
    let next = |sum: u32| table[(sum & 0xff) as usize] ^ (sum >> 8);
    let (words, rest) = bytes.as_chunks::<4>();
    let sum = words.iter().fold(u32::MAX, |sum, word| next(next(next(next(sum ^ u32::from_le_bytes(*word))))));
    !rest.iter().fold(sum, |sum, byte| next(sum ^ u32::from(*byte)))
}

/// CRC-32 as Ethernet, gzip and PNG have it.
pub(crate) static CRC: crc::Crc<u32, crc::Table<1>> = crc::Crc::<u32, crc::Table<1>>::new(&crc::CRC_32_ISO_HDLC);

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_word_at_a_time_gives_the_same_sum(bytes in proptest::collection::vec(any::<u8>(), 0..100)) {
            prop_assert_eq!(super::checksum(&bytes), super::CRC.checksum(&bytes));
        }
    }
}
