//! The frame around a payload, made here and not by the crate's writer.

/// Frame 0 with this payload and the right checksum.
pub fn framed(payload: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0xa7, 0x5d];
    bytes.extend_from_slice(&(payload.len() as u16).to_le_bytes());
    bytes.extend_from_slice(&[0; 4]);
    bytes.extend_from_slice(payload);
    let sum = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&bytes);
    bytes.extend_from_slice(&sum.to_le_bytes());
    bytes
}
