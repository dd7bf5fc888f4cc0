//! Independent checks: a plain f64 reference planner and a reader of step traces; and a board in virtual time.
//!
//! No check shares code with the crates under test. [`mod@reference`] reads G-code and plans it a second time,
//! with floating point and all the memory it wants; [`trace`] reads the records that `ferrostep print --trace`
//! writes; [`trace_check`] holds one against the other. What they have in common is the written interface only.
//!
//! [`board_model`] is made of the crates under test: it runs them as the firmware does, at any speed of host and
//! processor. [`live_machine`] makes hostile conversations with it of any bytes. [`stress_file`] makes a print that asks much of both, [`feed_chart`] draws what came out. [`step_edges`]
//! plays a trace on the step interrupt's model at its latest.
#![deny(missing_docs)]
#![forbid(unsafe_code)]

pub mod board_model;
pub mod feed_chart;
pub mod hand_made;
pub mod hostile;
pub mod live_machine;
pub mod reference;
pub mod stack;
pub mod step_edges;
pub mod stress_file;
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
