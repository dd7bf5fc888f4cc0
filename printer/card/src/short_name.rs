//! Short names (8.3) as hosts read and send them.

use embedded_sdmmc::DirEntry;

/// A short name as hosts read and send it: ASCII only, since the code page of other
/// letters is unknown.
pub fn short_name(entry: &DirEntry) -> heapless::String<16> {
    let mut name = heapless::String::new();
    let part = |name: &mut heapless::String<16>, bytes: &[u8]| {
        for &byte in bytes {
            // The name has at most 12 characters.
            let _ = name.push(if byte.is_ascii_graphic() && byte != b'/' { char::from(byte) } else { '_' });
        }
    };
    part(&mut name, entry.name.base_name());
    if !entry.name.extension().is_empty() {
        let _ = name.push('.');
        part(&mut name, entry.name.extension());
    }
    name
}
