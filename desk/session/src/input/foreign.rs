//! Files that are not jobs, recognised by their first bytes, so that the error can
//! say how to mend it.

use std::fmt;

/// A kind of file that is not a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Foreign {
    /// A 3MF project: a zip archive with a model, and without G-code.
    ThreeMf,
    /// Some other zip archive.
    Zip,
    /// A model in STL.
    Stl,
    /// Text in UTF-16.
    Utf16,
    /// Compressed in a format that this program does not read: its name.
    Compressed(&'static str),
}

/// First bytes of compressed files.
const COMPRESSED: [(&[u8], &str); 4] =
    [(b"\x28\xb5\x2f\xfd", "zstd"), (b"\xfd7zXZ\0", "xz"), (b"BZh", "bzip2"), (b"7z\xbc\xaf\x27\x1c", "7-Zip")];

/// Bytes of an STL file before its first facet, and of a facet, in the binary form.
const STL_HEADER_BYTES: usize = 84;
const STL_FACET_BYTES: usize = 50;

impl Foreign {
    /// Recognises a file by its first bytes and its size, if that is known.
    pub fn of(start: &[u8], size: Option<u64>) -> Option<Self> {
        let contains = |text: &[u8]| memchr::memmem::find(start, text).is_some();
        if let Some((_, name)) = COMPRESSED.iter().find(|(first, _)| start.starts_with(first)) {
            return Some(Self::Compressed(name));
        }
        if is_utf16(start) {
            return Some(Self::Utf16);
        }
        let is_stl = start.starts_with(b"solid") && contains(b"facet") || is_binary_stl(start, size);
        is_stl.then_some(Self::Stl)
    }
}

/// A byte order mark, or every other byte 0.
fn is_utf16(start: &[u8]) -> bool {
    let is_ascii = |pair: &[u8]| matches!(pair, [0, text] | [text, 0] if *text != 0 && text.is_ascii());
    let pairs = start.get(..4).into_iter().flat_map(|pairs| pairs.chunks(2));
    start.starts_with(b"\xff\xfe")
        || start.starts_with(b"\xfe\xff")
        || pairs.clone().count() == 2 && pairs.clone().all(is_ascii)
}

/// The number of facets agrees with the size; or, where that is not known, all facets end in the
/// two zeros that are usual there.
fn is_binary_stl(start: &[u8], size: Option<u64>) -> bool {
    let Some((header, facets)) = start.split_at_checked(STL_HEADER_BYTES) else { return false };
    let count = header.last_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes));
    let expected = STL_HEADER_BYTES as u64 + STL_FACET_BYTES as u64 * u64::from(count);
    let mut whole = facets.as_chunks::<STL_FACET_BYTES>().0.iter().take(count as usize).peekable();
    let mut looks_right = || whole.peek().is_some() && whole.all(|facet| facet.ends_with(&[0, 0]));
    count > 0 && expected >= start.len() as u64 && (size == Some(expected) || looks_right())
}

impl fmt::Display for Foreign {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let slice = "slice it, and give the G-code that the slicer exports";
        match self {
            Self::ThreeMf => write!(out, "this is a 3MF project, which holds a model and no G-code: {slice}"),
            Self::Stl => write!(out, "this is a model in STL: {slice}"),
            Self::Zip => write!(out, "this is a zip archive: unpack it, and give the G-code that is in it"),
            Self::Utf16 => write!(out, "this is text in UTF-16: save it as UTF-8"),
            Self::Compressed(name) => {
                write!(out, "this is compressed with {name}: unpack it first (gzip is unpacked here)")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A binary STL with this many facets.
    fn stl(count: u32, attribute: u8) -> Vec<u8> {
        let mut bytes = b"made by hand".to_vec();
        bytes.resize(80, 0);
        bytes.extend(count.to_le_bytes());
        for _ in 0..count {
            bytes.extend([0x41; 48]);
            bytes.extend([attribute, attribute]);
        }
        bytes
    }

    #[test]
    fn each_is_known() {
        let colourful = stl(9, 7);
        let size = colourful.len() as u64;
        for (start, size, expected) in [
            (&b"\x28\xb5\x2f\xfd\0"[..], None, Some(Foreign::Compressed("zstd"))),
            (b"solid cube\n facet normal 0 0 1\n", None, Some(Foreign::Stl)),
            (&stl(12, 0), None, Some(Foreign::Stl)),
            (&stl(3000, 0)[..65_536], None, Some(Foreign::Stl)),
            (&colourful, Some(size), Some(Foreign::Stl)),
            (&colourful, Some(size + 1), None),
            (&colourful, None, None),
            (b"\xff\xfeG\x002\x008\0", None, Some(Foreign::Utf16)),
            (b"\xfe\xff\0G\x002", None, Some(Foreign::Utf16)),
            (b"G\x002\x008\0\n\0", None, Some(Foreign::Utf16)),
            (b"\0G\x002\x008", None, Some(Foreign::Utf16)),
            (b"\0\0\0\0", None, None),
            (b"G28\n", None, None),
            (b"G", None, None),
            (b"; solid facet\n", None, None),
            (&[b'a'; 200], None, None),
            (&[0; 200], Some(200), None),
        ] {
            assert_eq!(Foreign::of(start, size), expected, "{:?}", &start[..start.len().min(20)]);
        }
    }
}
