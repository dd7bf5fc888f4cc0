//! Data for the page in columns: differences of whole numbers, their bytes apart,
//! deflated, in base64.

use std::io::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use base64::write::EncoderStringWriter;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use serde::Serialize;

/// A column's place among the bytes.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Column {
    name: &'static str,
    /// Values.
    length: usize,
    /// Bytes of a value's difference: 1, 2 or 4.
    bytes: usize,
    /// Factor from the whole number to the value.
    unit: f64,
}

/// Columns, and their bytes.
#[derive(Debug, Default)]
pub(crate) struct Columns {
    columns: Vec<Column>,
    bytes: Vec<u8>,
}

impl Columns {
    /// Adds a column; values are rounded to whole units.
    pub fn add(&mut self, name: &'static str, unit: f64, values: impl Iterator<Item = f64>) {
        let mut before = 0;
        // Differences modulo 2^32, so that any two numbers have one; small ones of either sign
        // become small numbers.
        let differences = values.map(|value| {
            let whole = (value / unit).round() as i64 as i32;
            let difference = whole.wrapping_sub(std::mem::replace(&mut before, whole));
            (difference.wrapping_shl(1) ^ (difference >> 31)).cast_unsigned()
        });
        let differences: Vec<u32> = differences.collect();
        let largest = differences.iter().copied().max().unwrap_or(0);
        let bytes = match largest {
            0..=0xff => 1,
            0x100..=0xffff => 2,
            _ => 4,
        };
        for byte in 0..bytes {
            self.bytes.extend(differences.iter().map(|difference| difference.to_le_bytes()[byte]));
        }
        self.columns.push(Column { name, length: differences.len(), bytes, unit });
    }

    /// The places of the columns, and their bytes as text.
    ///
    /// # Errors
    /// The bytes cannot be packed.
    pub fn pack(self) -> std::io::Result<(Vec<Column>, String)> {
        Ok((self.columns, packed(&self.bytes)?))
    }
}

/// Deflated, in base64.
///
/// # Errors
/// The bytes cannot be packed.
pub(crate) fn packed(bytes: &[u8]) -> std::io::Result<String> {
    let mut encoder = ZlibEncoder::new(EncoderStringWriter::new(&STANDARD), Compression::new(5));
    encoder.write_all(bytes)?;
    Ok(encoder.finish()?.into_inner())
}

/// Encodes bytes in base64.
pub(crate) fn base64(bytes: &[u8]) -> String {
    STANDARD.encode(bytes)
}
