//! A record: the values that differ from the profile's, by the names of their settings.
//!
//! | bytes | content |
//! |---|---|
//! | 1 | [`FORMAT`] |
//! | 2 | [`id_of`] the profile's name: the settings of one machine are not another's |
//! | 11 each | a value: [`id_of`] the setting's name (2), index among the setting's values (1), the value (IEEE 754, 8) |
//!
//! All numbers are little-endian. A reader skips the values of settings that it does not know, so a
//! record survives an update that adds or removes settings. A setting whose meaning or unit changes
//! must change its name.

use core::fmt;

/// Version of the layout above.
const FORMAT: u8 = 1;

const HEADER_BYTES: usize = 3;
const VALUE_BYTES: usize = 11;

/// Maximum number of values in a record.
pub const MAX_VALUES: usize = 84;

/// Length of the longest record, bytes.
pub const MAX_BYTES: usize = HEADER_BYTES + MAX_VALUES * VALUE_BYTES;

/// FNV-1a of a name, 32 bits.
pub const fn hash_of(name: &str) -> u32 {
    let bytes = name.as_bytes();
    let (mut hash, mut at) = (0x811c_9dc5_u32, 0);
    while at < bytes.len() {
        hash = (hash ^ bytes[at] as u32).wrapping_mul(0x0100_0193);
        at += 1;
    }
    hash
}

/// A name as records write it: the halves of [`hash_of`] combined. A test of the settings' table
/// checks that no two are the same.
pub const fn id_of(name: &str) -> u16 {
    let hash = hash_of(name);
    (hash >> 16 ^ hash & 0xffff) as u16
}

/// A stored value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry {
    /// [`id_of`] the setting's name.
    pub id: u16,
    /// Index of one of its values, such as an axis.
    pub index: u8,
    /// The value; any bits.
    pub value: f64,
}

/// Reason why a record cannot be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecordError {
    /// The record is shorter than its head, or ends within a value.
    Length,
    /// Another version of the firmware wrote the record, in this format.
    Format(u8),
    /// The record belongs to another profile.
    OtherProfile,
}

impl fmt::Display for RecordError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Length => out.write_str("they are cut short"),
            Self::Format(format) => write!(out, "their format {format} is another firmware's, expected {FORMAT}"),
            Self::OtherProfile => out.write_str("they are of another profile"),
        }
    }
}

/// A readable record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Record<'a>(&'a [u8]);

impl<'a> Record<'a> {
    /// The record in these bytes.
    ///
    /// # Errors
    /// The record has another format, length or profile.
    pub fn read(bytes: &'a [u8], profile: &str) -> Result<Self, RecordError> {
        let (format, rest) = bytes.split_first().ok_or(RecordError::Length)?;
        if *format != FORMAT {
            return Err(RecordError::Format(*format));
        }
        let (written, values) = rest.split_first_chunk().ok_or(RecordError::Length)?;
        if !values.len().is_multiple_of(VALUE_BYTES) {
            return Err(RecordError::Length);
        }
        if u16::from_le_bytes(*written) != id_of(profile) {
            return Err(RecordError::OtherProfile);
        }
        Ok(Self(values))
    }

    /// Values of the record.
    pub fn entries(self) -> impl Iterator<Item = Entry> + 'a {
        self.0.as_chunks::<VALUE_BYTES>().0.iter().filter_map(|bytes| {
            let (id, rest) = bytes.split_first_chunk()?;
            let (index, value) = rest.split_first()?;
            let value = f64::from_le_bytes(*value.first_chunk()?);
            Some(Entry { id: u16::from_le_bytes(*id), index: *index, value })
        })
    }
}

/// A record under construction.
#[derive(Debug)]
pub struct RecordWriter {
    bytes: [u8; MAX_BYTES],
    length: usize,
}

impl RecordWriter {
    /// An empty record of a profile.
    pub fn new(profile: &str) -> Self {
        let mut record = Self { bytes: [0; MAX_BYTES], length: 0 };
        record.put(&[FORMAT]);
        record.put(&id_of(profile).to_le_bytes());
        record
    }

    /// Adds a value; `false` if the record is full.
    pub fn add(&mut self, entry: Entry) -> bool {
        if self.bytes.len().saturating_sub(self.length) < VALUE_BYTES {
            return false;
        }
        self.put(&entry.id.to_le_bytes());
        self.put(&[entry.index]);
        self.put(&entry.value.to_le_bytes());
        true
    }

    fn put(&mut self, bytes: &[u8]) {
        if let Some(room) = self.bytes.get_mut(self.length..).and_then(|rest| rest.get_mut(..bytes.len())) {
            room.copy_from_slice(bytes);
            self.length = self.length.saturating_add(bytes.len());
        }
    }

    /// Bytes of the record.
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn values_come_back_bit_for_bit() {
        let values = [0.1, -0.0, f64::NAN, f64::INFINITY, 5e-324, 1_250.0];
        let mut record = RecordWriter::new("corexy");
        for (index, value) in (0..).zip(values) {
            assert!(record.add(Entry { id: id_of("limits"), index, value }));
        }
        let read: Vec<Entry> = Record::read(record.bytes(), "corexy").unwrap().entries().collect();
        assert_eq!(read.len(), values.len());
        for ((index, value), entry) in (0..).zip(values).zip(read) {
            assert_eq!((entry.id, entry.index, entry.value.to_bits()), (id_of("limits"), index, value.to_bits()));
        }
    }

    #[test]
    fn a_full_record_takes_no_more_and_stays_whole() {
        let mut record = RecordWriter::new("corexy");
        for index in 0..MAX_VALUES {
            assert!(record.add(Entry { id: 1, index: index as u8, value: 2.0 }), "{index}");
        }
        assert!(!record.add(Entry { id: 1, index: 0, value: 2.0 }));
        assert_eq!(record.bytes().len(), MAX_BYTES);
        assert_eq!(Record::read(record.bytes(), "corexy").unwrap().entries().count(), MAX_VALUES);
    }

    #[test]
    fn other_records_are_refused_by_their_reason() {
        let mut record = RecordWriter::new("corexy");
        record.add(Entry { id: 1, index: 0, value: 2.0 });
        let bytes = record.bytes();
        assert_eq!(Record::read(bytes, "cartesian"), Err(RecordError::OtherProfile));
        assert_eq!(Record::read(&bytes[..bytes.len() - 1], "corexy"), Err(RecordError::Length));
        assert_eq!(Record::read(&bytes[..2], "corexy"), Err(RecordError::Length));
        assert_eq!(Record::read(&[], "corexy"), Err(RecordError::Length));
        assert_eq!(Record::read(&[7, 0, 0], "corexy"), Err(RecordError::Format(7)));
    }

    /// The layout must not change: the stored settings of boards depend on it.
    #[test]
    fn the_layout_stays() {
        let mut record = RecordWriter::new("corexy");
        record.add(Entry { id: 0x1234, index: 3, value: 1.5 });
        let id = id_of("corexy").to_le_bytes();
        assert_eq!(record.bytes(), [1, id[0], id[1], 0x34, 0x12, 3, 0, 0, 0, 0, 0, 0, 0xf8, 0x3f]);
        // FNV-1a of "a" is 0xe40c292c.
        assert_eq!(id_of("a"), 0xe40c ^ 0x292c);
    }
}
