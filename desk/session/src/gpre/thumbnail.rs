//! The picture that slicers write into the comments at a file's start, or into a block
//! of binary G-code.

use std::io::{self, BufRead};

use ferrostep_gpre::{Thumbnail, ThumbnailFormat};

use crate::input::Input;

/// Maximum number of bytes of a file that are searched for a picture.
const MAX_BYTES: u64 = 2 << 20;

/// A picture's format and size, and its bytes.
type Picture = (Thumbnail, Vec<u8>);

/// Reads the picture from a job that is about to be read; the job stays complete.
///
/// # Errors
/// The job cannot be read.
pub fn take(input: &mut Input) -> io::Result<Option<Picture>> {
    if let Some(description) = input.description() {
        let pictures = description.thumbnails.iter().filter(|(_, bytes)| fits(bytes));
        return Ok(pictures.max_by_key(|(_, bytes)| bytes.len()).cloned());
    }
    let (picture, read) = find(&mut *input)?;
    input.put_back(read);
    Ok(picture)
}

/// Returns true if a picture fits into a prepared job.
fn fits(bytes: &[u8]) -> bool {
    !bytes.is_empty() && bytes.len() < ferrostep_gpre::header::MAX_THUMBNAIL_BYTES as usize
}

/// The largest thumbnail before the first command, and all that was read: lines between
/// `; thumbnail begin 220x124 1234` (also `thumbnail_JPG`, `thumbnail_QOI`) and
/// `; thumbnail end`, in base 64.
fn find(input: impl BufRead) -> io::Result<(Option<Picture>, Vec<u8>)> {
    let mut found: Option<Picture> = None;
    let mut open: Option<(ThumbnailFormat, u16, u16, String)> = None;
    let mut input = input.take(MAX_BYTES);
    let mut read = Vec::new();
    loop {
        let start = read.len();
        input.read_until(b'\n', &mut read)?;
        let line = String::from_utf8_lossy(&read[start..]);
        let comment = line.trim().strip_prefix(';');
        let is_blank = line.trim().is_empty();
        let Some(comment) = comment else {
            if is_blank && read.len() > start {
                continue;
            }
            return Ok((found, read));
        };
        let comment = comment.trim();
        if let Some((format, width, height, text)) = &mut open {
            if !comment.starts_with("thumbnail") {
                text.push_str(comment);
                continue;
            }
            let bytes = from_base_64(text);
            let (format, width, height) = (*format, *width, *height);
            open = None;
            let larger = |bytes: &Vec<u8>| found.as_ref().is_none_or(|(_, before)| bytes.len() > before.len());
            if let Some(bytes) = bytes.filter(|bytes| larger(bytes) && fits(bytes)) {
                found = Some((Thumbnail { format, width, height, length: bytes.len() as u32 }, bytes));
            }
        } else {
            open = begins(comment).map(|(format, width, height)| (format, width, height, String::new()));
        }
    }
}

/// `thumbnail begin 220x124 1234`.
fn begins(comment: &str) -> Option<(ThumbnailFormat, u16, u16)> {
    let mut words = comment.split_whitespace();
    let format = match words.next()? {
        "thumbnail" => ThumbnailFormat::Png,
        "thumbnail_JPG" => ThumbnailFormat::Jpeg,
        "thumbnail_QOI" => ThumbnailFormat::Qoi,
        _ => return None,
    };
    if words.next()? != "begin" {
        return None;
    }
    let (width, height) = words.next()?.split_once('x')?;
    Some((format, width.parse().ok()?, height.parse().ok()?))
}

/// Bytes of a text in base 64; `None` if it is malformed.
fn from_base_64(text: &str) -> Option<Vec<u8>> {
    let mut bytes = Vec::with_capacity(text.len() * 3 / 4);
    let (mut bits, mut count) = (0u32, 0);
    for byte in text.trim_end_matches('=').bytes() {
        let value = match byte {
            b'A'..=b'Z' => byte - b'A',
            b'a'..=b'z' => byte - b'a' + 26,
            b'0'..=b'9' => byte - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return None,
        };
        bits = bits << 6 | u32::from(value);
        count += 6;
        if count >= 8 {
            count -= 8;
            bytes.push((bits >> count) as u8);
        }
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn the_largest_is_found() {
        let text = "; made by hand\n\n; thumbnail begin 16x16 4\n; AAEC\n; thumbnail end\n; thumbnail_QOI begin 32x24 8\n\
                    ; AAEC\n; AwQ=\n; thumbnail_QOI end\nG28\n; thumbnail begin 99x99 8\n; AAECAwQF\n; thumbnail end\n";
        let (picture, read) = find(text.as_bytes()).unwrap();
        let (thumbnail, bytes) = picture.unwrap();
        assert_eq!(bytes, [0, 1, 2, 3, 4]);
        assert_eq!((thumbnail.format, thumbnail.width, thumbnail.height), (ThumbnailFormat::Qoi, 32, 24));
        // The search ended at the first command.
        assert!(text.as_bytes().starts_with(&read) && read.ends_with(b"\nG28\n"));
        for without in ["G28\n", "", "\n\nG28", "; thumbnail begin 16x16 4\n; ???\n; thumbnail end\n"] {
            assert_eq!(find(without.as_bytes()).unwrap(), (None, without.into()), "{without:?}");
        }
    }

    #[test]
    fn no_more_is_read_than_pictures_take() {
        let endless = io::BufReader::new(io::repeat(b';'));
        let (picture, read) = find(endless).unwrap();
        assert_eq!((picture, read.len() as u64), (None, MAX_BYTES));
    }
}
