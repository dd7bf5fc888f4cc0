//! The header: what is written is read back; each rejection says what and where.
#![allow(clippy::unwrap_used)]

use ferrostep_gpre::header::{FIXED_BYTES, HeaderCheck};
use ferrostep_gpre::{Encoding, Fault, Header, Thumbnail, ThumbnailFormat};
use proptest::prelude::*;

const HEADER: Header = Header {
    encoding: Encoding::Compact,
    profile_hash: 0x0123_4567_89ab_cdef,
    planner_version: 1,
    frames: 376,
    moves: 100_056,
    motion_ms: 4_631_271,
    filament_100pm: -41_060_000_000,
    layers: 240,
    thumbnail: None,
};

fn check(bytes: &[u8]) -> Result<(), ferrostep_gpre::ReadError> {
    let (before, sum) = bytes.split_last_chunk::<4>().unwrap();
    let mut check = HeaderCheck::new();
    before.chunks(7).for_each(|some| check.pass(some));
    check.end(*sum)
}

proptest! {
    #[test]
    fn a_header_comes_back(
        numbers in any::<(u64, u32, u32, u64, u64, i64, u32)>(), wide in any::<bool>(), kind in 0u8..4,
        size in any::<(u16, u16)>(), picture in proptest::collection::vec(any::<u8>(), 1..300),
    ) {
        let (profile_hash, planner_version, frames, moves, motion_ms, filament_100pm, layers) = numbers;
        let formats = [None, Some(ThumbnailFormat::Png), Some(ThumbnailFormat::Jpeg), Some(ThumbnailFormat::Qoi)];
        let thumbnail = formats[usize::from(kind)]
            .map(|format| Thumbnail { format, width: size.0, height: size.1, length: picture.len() as u32 });
        let picture = if thumbnail.is_some() { &picture[..] } else { &[] };
        let encoding = if wide { Encoding::Wide } else { Encoding::Compact };
        let header = Header {
            encoding, profile_hash, planner_version, frames, moves, motion_ms, filament_100pm, layers, thumbnail,
        };
        let bytes = header.to_bytes(picture);
        prop_assert_eq!(bytes.len(), header.length() as usize);
        prop_assert_eq!(Header::read(&bytes).unwrap(), header);
        prop_assert_eq!(check(&bytes), Ok(()));
        let mut changed = bytes;
        changed[FIXED_BYTES - 20] ^= 4;
        let error = check(&changed).unwrap_err();
        prop_assert!(matches!(error.fault, Fault::Checksum { .. }), "{}", error);
    }

    #[test]
    fn any_bytes_are_answered(bytes in proptest::collection::vec(any::<u8>(), 0..100), marked in any::<bool>()) {
        let mut bytes = bytes;
        if marked {
            bytes.splice(..bytes.len().min(8), ferrostep_gpre::header::MAGIC);
        }
        let _ = Header::read(&bytes);
    }
}

#[track_caller]
fn refused(change: impl FnOnce(&mut Vec<u8>), expected: &str) {
    let mut bytes = HEADER.to_bytes(&[]);
    change(&mut bytes);
    let error = Header::read(&bytes).and_then(|header| header.matches(HEADER.profile_hash, HEADER.planner_version));
    assert_eq!(error.unwrap_err().to_string(), expected);
}

#[test]
fn each_refusal_says_what_and_where() {
    assert_eq!(HEADER.matches(HEADER.profile_hash, HEADER.planner_version), Ok(()));
    refused(|bytes| bytes[3] = b'Q', "at byte 0: not a prepared job: its first bytes are not those of GPRE");
    refused(|bytes| bytes.truncate(40), "at byte 40: the file is cut short: copy the file, or prepare the job, again");
    refused(|bytes| bytes[8] = 9, "at byte 8: written in version 9 of the format, expected at most 1");
    refused(|bytes| bytes[10] = 3, "at byte 10: encoding 3 is unknown, expected 1 (compact) or 2 (wide)");
    refused(
        |bytes| bytes[12] = 3,
        "at byte 12: damaged: no part of a file has 3 bytes: copy the file, or prepare the job, again",
    );
    refused(
        |bytes| bytes[15] = 0x80,
        "at byte 12: damaged: no part of a file has 2147483720 bytes: copy the file, or prepare the job, again",
    );
    refused(
        |bytes| bytes[60] = 4,
        "at byte 60: unreadable content, expected a thumbnail of a kind from 0 to 3: copy the file, or prepare the \
         job, again",
    );
    refused(
        |bytes| bytes[16] = 0,
        "at byte 16: prepared for another machine (profile 0123456789abcd00), expected this one's profile \
         0123456789abcdef: prepare the job again for this machine",
    );
    refused(
        |bytes| bytes[24] = 2,
        "at byte 24: planned by version 2 of the planner, expected version 1: prepare the job again",
    );
}
