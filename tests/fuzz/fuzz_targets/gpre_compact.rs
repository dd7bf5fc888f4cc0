//! Frames of bits: with any content, items come to an end and their values are in range.
#![no_main]

use ferrostep_gpre::compact::{Frame, HEAD_BYTES, MAX_FRAME_BYTES, frame_length};
use ferrostep_gpre::{Header, Item};
use libfuzzer_sys::fuzz_target;

/// 5 m, units of 10 nm.
const MAX_10NM: u64 = 500_000_000;

fn read(bytes: &[u8]) {
    let Ok(frame) = Frame::read(bytes, 0, None) else { return };
    let Ok(mut items) = frame.items() else { return };
    assert!(items.start().position_10nm.iter().all(|coordinate| coordinate.unsigned_abs() <= MAX_10NM));
    let mut count = 0;
    while let Ok(Some(item)) = items.next_item() {
        count += 1;
        assert!(count <= 8 * bytes.len());
        if let Item::Move(next) = item {
            assert!(next.target_10nm().iter().all(|coordinate| u64::from(coordinate.unsigned_abs()) <= MAX_10NM));
            assert!(next.feed_mm_per_s > 0.0 && next.feed_mm_per_s.is_finite());
        }
    }
}

fuzz_target!(|bytes: &[u8]| {
    // The bytes as a file, and as a payload in a frame with a right checksum, which no
    // random file has.
    let _ = Header::read(bytes);
    if let Some(head) = bytes.first_chunk::<HEAD_BYTES>()
        && let Ok(length) = frame_length(head)
    {
        assert!(length <= MAX_FRAME_BYTES);
        read(bytes.get(..length).unwrap_or(bytes));
    }
    let payload = &bytes[..bytes.len().min(600)];
    let mut frame = vec![0xa7, 0x5d];
    frame.extend_from_slice(&(payload.len() as u16).to_le_bytes());
    frame.extend_from_slice(&[0; 4]);
    frame.extend_from_slice(payload);
    let sum = crc32fast::hash(&frame);
    frame.extend_from_slice(&sum.to_le_bytes());
    assert!(Frame::read(&frame, 0, Some(0)).is_ok());
    read(&frame);
});
