//! The blocks' checksum.

/// The CRC-32 of every block.
pub(crate) const CRC: crc::Crc<u32> = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
