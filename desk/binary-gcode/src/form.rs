//! Blocks written anew, in the form that they had.

use alloc::borrow::Cow;
use alloc::vec::Vec;

use ferrostep_gcode::meatpack;
use miniz_oxide::deflate::compress_to_vec_zlib;

use crate::checksum::CRC;
use crate::decoder;
use crate::format::{self, CRC_BYTES, Compression, FILE_HEADER_BYTES, Head, MAX_HEAD_BYTES};
use crate::heatshrink::encoder;
use crate::{BlockKind, Reason};

/// Deflate's effort, 0 to 10.
const DEFLATE_LEVEL: u8 = 6;

/// The form of a file: blocks with checksums, or without.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileForm {
    has_checksums: bool,
}

impl FileForm {
    /// Bytes of a file before its first block.
    pub const BYTES: usize = FILE_HEADER_BYTES;

    /// Reads the form from a file's first [`Self::BYTES`].
    ///
    /// # Errors
    /// It is not binary G-code, or of a kind that is not known here.
    pub fn of(header: &[u8]) -> Result<Self, Reason> {
        format::file_header(header).map(|has_checksums| Self { has_checksums })
    }
}

/// The form of a block: kind, compression and encoding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Form {
    head: Head,
    head_bytes: usize,
    has_checksum: bool,
}

impl Form {
    /// Maximum number of bytes of a block before its data.
    pub const MAX_HEAD_BYTES: usize = MAX_HEAD_BYTES;

    /// Reads the form from a block's first [`Self::MAX_HEAD_BYTES`], or all bytes that remain.
    ///
    /// # Errors
    /// The block is cut off, or of a kind that is not known here.
    pub fn of(file: FileForm, bytes: &[u8]) -> Result<Self, Reason> {
        let head_bytes = Head::length(bytes)?;
        if bytes.len() < head_bytes {
            return Err(Reason::Truncated);
        }
        Ok(Self { head: Head::of(bytes)?, head_bytes, has_checksum: file.has_checksums })
    }

    /// Kind of the block's contents.
    pub const fn kind(&self) -> BlockKind {
        self.head.kind
    }

    /// Bytes of the whole block in its file.
    pub const fn block_bytes(&self) -> u64 {
        let checksum = if self.has_checksum { CRC_BYTES } else { 0 };
        self.head.stored_bytes as u64 + (self.head_bytes + checksum) as u64
    }

    /// The contents of a block of this form. Its checksum is not compared.
    ///
    /// # Errors
    /// The block is cut off or damaged.
    pub fn contents(&self, block: &[u8]) -> Result<Vec<u8>, Reason> {
        let data = block.get(self.head_bytes..).and_then(|data| data.get(..self.head.stored_bytes as usize));
        decoder::contents(self.head, data.ok_or(Reason::Truncated)?)
    }

    /// A block of this form with other contents. G-code that is not UTF-8 is never packed.
    pub fn block(&self, contents: &[u8]) -> Vec<u8> {
        let (encoding, data) = self.encoded(contents);
        let stored = match self.head.compression {
            Compression::None => Cow::Borrowed(&*data),
            Compression::Deflate => Cow::Owned(compress_to_vec_zlib(&data, DEFLATE_LEVEL)),
            Compression::Heatshrink(window_bits) => Cow::Owned(encoder::compress(&data, window_bits)),
        };
        let mut block = Vec::with_capacity(MAX_HEAD_BYTES + stored.len() + CRC_BYTES);
        block.extend(format::kind_number(self.head.kind).to_le_bytes());
        block.extend(self.head.compression.number().to_le_bytes());
        block.extend((data.len() as u32).to_le_bytes());
        if self.head.compression != Compression::None {
            block.extend((stored.len() as u32).to_le_bytes());
        }
        block.extend(encoding.to_le_bytes());
        if let BlockKind::Thumbnail { width, height, .. } = self.head.kind {
            block.extend([width.to_le_bytes(), height.to_le_bytes()].concat());
        }
        block.extend_from_slice(&stored);
        if self.has_checksum {
            block.extend(CRC.checksum(&block).to_le_bytes());
        }
        block
    }

    /// The encoding of contents, and its bytes.
    fn encoded<'a>(&self, contents: &'a [u8]) -> (u16, Cow<'a, [u8]>) {
        let is_packed = self.head.kind == BlockKind::Gcode && self.head.encoding != 0;
        match core::str::from_utf8(contents) {
            Ok(text) if is_packed => {
                let mut packed = meatpack::BEGIN.to_vec();
                meatpack::pack(text, |byte| packed.push(byte));
                (self.head.encoding, Cow::Owned(packed))
            }
            _ if is_packed => (0, Cow::Borrowed(contents)),
            _ => (self.head.encoding, Cow::Borrowed(contents)),
        }
    }
}
