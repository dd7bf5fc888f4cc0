//! A second opinion that shares no code with the planner that it judges: a plain f64 planner and a
//! reader of step traces.
//!
//! [`mod@reference`] reads G-code and plans it a second time, in floating point and without a
//! limit on memory; [`trace`] reads the records that `ferrostep print --trace` writes;
//! [`trace_check`] compares one with the other, and [`trace_ends`] counts whether every motor ends
//! every move where it should. This crate depends on no other crate of Ferrostep: they share only
//! the written interface.
#![deny(missing_docs)]
#![forbid(unsafe_code)]

pub mod reference;
pub mod trace;
pub mod trace_check;
pub mod trace_ends;

use std::io::{self, Read};

/// Returns the text of a G-code file, unpacked when the bytes begin with gzip's magic number.
///
/// # Errors
/// The decoder's error when the bytes claim to be gzip and are damaged.
pub fn gcode_text(bytes: &[u8]) -> io::Result<Vec<u8>> {
    if !bytes.starts_with(&[0x1f, 0x8b]) {
        return Ok(bytes.to_vec());
    }
    let mut text = Vec::new();
    flate2::read::MultiGzDecoder::new(bytes).read_to_end(&mut text)?;
    Ok(text)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use std::io::Write;

    #[test]
    fn gzip_is_recognised_by_its_magic_number() {
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(b"G28\nG1 X1\n").unwrap();
        let packed = encoder.finish().unwrap();
        assert_eq!(gcode_text(&packed).unwrap(), b"G28\nG1 X1\n");
        assert_eq!(gcode_text(b"G28\n").unwrap(), b"G28\n");
        assert!(gcode_text(&packed[..packed.len() / 2]).is_err());
    }
}
