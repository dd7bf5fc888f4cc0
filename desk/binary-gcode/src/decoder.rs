//! Decodes the file's bytes into the contents of its blocks.

use crc::Digest;
use ferrostep_gcode::meatpack::{Unpacked, Unpacker};

use crate::checksum::CRC;
use crate::format::{self, CRC_BYTES, Compression, FILE_HEADER_BYTES, Head, MAX_HEAD_BYTES, PLAIN_HEADER_BYTES};
use crate::heatshrink::Heatshrink;
#[cfg(feature = "deflate")]
use crate::inflate::Inflate;
use crate::{BlockKind, Error, Reason};

/// The table of the checksums.
static TABLE: crc::Crc<u32> = CRC;

/// Blocks whose contents a [`Decoder`] returns. The checksums of all others are also checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Selection {
    gcode: bool,
    metadata: bool,
    thumbnails: bool,
}

impl Selection {
    /// The G-code.
    pub const GCODE: Self = Self { gcode: true, metadata: false, thumbnails: false };

    /// All that is not G-code: metadata and thumbnails.
    pub const DESCRIPTION: Self = Self { gcode: false, metadata: true, thumbnails: true };

    /// All blocks.
    pub const ALL: Self = Self { gcode: true, metadata: true, thumbnails: true };

    const fn has(self, kind: BlockKind) -> bool {
        match kind {
            BlockKind::Gcode => self.gcode,
            BlockKind::Thumbnail { .. } => self.thumbnails,
            BlockKind::FileMetadata
            | BlockKind::SlicerMetadata
            | BlockKind::PrinterMetadata
            | BlockKind::PrintMetadata => self.metadata,
        }
    }
}

/// Result of a call of [`Decoder::advance`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// No contents yet: the decoder wants the bytes at its new [`Decoder::position`].
    More,
    /// Number of bytes of a block's contents, at the start of the output. A line of G-code may
    /// continue in the next portion.
    Contents(BlockKind, usize),
    /// The file has ended.
    End,
}

/// Reads a file of binary G-code.
///
/// A block with a checksum is read twice: its bytes are compared with the checksum first, and only
/// then are its contents given out, so that no damaged line ever is. [`Self::position`] says which
/// bytes come next; it goes back to the start of the block's data once.
#[derive(Clone)]
pub struct Decoder {
    selection: Selection,
    position: u64,
    stage: Stage,
    has_checksums: bool,
    has_gcode: bool,
    /// Number of the present block, from 1.
    block: u32,
    /// Offset of the block in the file, bytes.
    offset: u64,
    /// A header whose rest is still to come.
    gathered: [u8; MAX_HEAD_BYTES],
    gathered_bytes: usize,
    contents: Contents,
}

/// Kind of the next bytes.
#[derive(Clone)]
enum Stage {
    FileHeader,
    BlockHeader,
    /// A block's data, before its contents are returned.
    Checked {
        head: Head,
        left: u32,
        digest: Digest<'static, u32>,
    },
    Checksum {
        head: Head,
        computed: u32,
    },
    Contents {
        head: Head,
        left: u32,
    },
    End,
    Failed(Error),
}

impl Decoder {
    /// Creates a decoder at the start of a file.
    pub fn new(selection: Selection) -> Self {
        Self {
            selection,
            position: 0,
            stage: Stage::FileHeader,
            has_checksums: false,
            has_gcode: false,
            block: 0,
            offset: 0,
            gathered: [0; MAX_HEAD_BYTES],
            gathered_bytes: 0,
            contents: Contents::new(),
        }
    }

    /// Returns the place in the file at which the next call's bytes begin.
    pub const fn position(&self) -> u64 {
        self.position
    }

    /// Returns the place in the file of the block whose [`Progress::Contents`] were returned last.
    pub const fn block_offset(&self) -> u64 {
        self.offset
    }

    /// Takes bytes of the file, those at [`Self::position`], as many as there are: none at all
    /// means that the file has ended. `output` takes the contents, and must not be empty.
    ///
    /// # Errors
    /// The file is damaged, or of a kind that is not known here. Nothing of the block is given out
    /// that its checksum does not vouch for. Each later call returns the same error.
    pub fn advance(&mut self, input: &[u8], output: &mut [u8]) -> Result<Progress, Error> {
        let outcome = self.stages(input, output);
        if let Err(error) = outcome {
            self.stage = Stage::Failed(error);
        }
        outcome
    }

    fn stages(&mut self, mut input: &[u8], output: &mut [u8]) -> Result<Progress, Error> {
        if input.is_empty() {
            return self.file_ended(output);
        }
        loop {
            match &mut self.stage {
                Stage::Failed(error) => return Err(*error),
                Stage::End => return Ok(Progress::End),
                Stage::FileHeader => {
                    let Some(header) = self.gather(FILE_HEADER_BYTES, &mut input) else { return Ok(Progress::More) };
                    self.has_checksums = format::file_header(&header).map_err(|reason| self.error(reason))?;
                    self.begin_block();
                }
                Stage::BlockHeader => {
                    if self.gathered_bytes == 0 && input.is_empty() {
                        return Ok(Progress::More);
                    }
                    let Some((head, digest)) = self.head(&mut input)? else { return Ok(Progress::More) };
                    self.has_gcode |= head.kind == BlockKind::Gcode;
                    if !self.has_checksums && self.selection.has(head.kind) {
                        self.begin_contents(head)?;
                    } else {
                        self.stage = Stage::Checked { head, left: head.stored_bytes, digest };
                    }
                }
                Stage::Checked { head, left, digest } => {
                    let bytes = take(left, &mut input);
                    digest.update(bytes);
                    let (head, left, computed) = (*head, *left, digest.clone());
                    self.pass(bytes.len());
                    if left > 0 {
                        return Ok(Progress::More);
                    }
                    if self.has_checksums {
                        self.stage = Stage::Checksum { head, computed: computed.finalize() };
                    } else {
                        self.begin_block();
                    }
                }
                Stage::Checksum { head, computed } => {
                    let (head, computed) = (*head, *computed);
                    let Some(bytes) = self.gather(CRC_BYTES, &mut input) else { return Ok(Progress::More) };
                    let stored = format::u32_at(&bytes, 0);
                    if stored != computed {
                        return Err(self.error_in(head, Reason::Checksum { stored, computed }));
                    }
                    if !self.selection.has(head.kind) {
                        self.begin_block();
                        continue;
                    }
                    // Back to the start of the data.
                    self.position -= u64::from(head.stored_bytes) + CRC_BYTES as u64;
                    self.begin_contents(head)?;
                    return Ok(Progress::More);
                }
                Stage::Contents { head, left } => {
                    let head = *head;
                    let mut block = input.get(..input.len().min(*left as usize)).unwrap_or_default();
                    let offered = block.len();
                    let made = self.contents.fill(&mut block, output);
                    let used = offered - block.len();
                    *left -= used as u32;
                    let is_over = *left == 0;
                    self.pass(used);
                    let made = made.map_err(|reason| self.error_in(head, reason))?;
                    if made > 0 {
                        return Ok(Progress::Contents(head.kind, made));
                    }
                    if !is_over {
                        return Ok(Progress::More);
                    }
                    self.end_contents(head)?;
                    return Ok(Progress::More);
                }
            }
        }
    }

    /// Handles the end of the file.
    fn file_ended(&mut self, output: &mut [u8]) -> Result<Progress, Error> {
        match &self.stage {
            Stage::Failed(error) => Err(*error),
            Stage::End => Ok(Progress::End),
            Stage::BlockHeader if self.gathered_bytes == 0 => {
                if !self.has_gcode {
                    return Err(Error { block: 0, kind: None, offset: self.offset, reason: Reason::NoGcode });
                }
                self.stage = Stage::End;
                Ok(Progress::End)
            }
            Stage::FileHeader
                if !format::MAGIC.starts_with(self.gathered.get(..self.gathered_bytes.min(4)).unwrap_or_default()) =>
            {
                Err(self.error(Reason::NotBinaryGcode))
            }
            // The last bytes may be returned only now.
            Stage::Contents { head, left } => {
                let (head, left) = (*head, *left);
                match self.contents.fill(&mut &[][..], output) {
                    Ok(0) if left > 0 => Err(self.error_in(head, Reason::Truncated)),
                    Ok(0) => self.end_contents(head).map(|()| Progress::More),
                    Ok(made) => Ok(Progress::Contents(head.kind, made)),
                    Err(reason) => Err(self.error_in(head, reason)),
                }
            }
            Stage::Checked { head, .. } | Stage::Checksum { head, .. } => Err(self.error_in(*head, Reason::Truncated)),
            Stage::FileHeader | Stage::BlockHeader => Err(self.error(Reason::Truncated)),
        }
    }

    /// A block's header and parameters, once they are whole, and the checksum so far.
    fn head(&mut self, input: &mut &[u8]) -> Result<Option<(Head, Digest<'static, u32>)>, Error> {
        if !self.collect(PLAIN_HEADER_BYTES, input) {
            return Ok(None);
        }
        let length = Head::length(&self.gathered).map_err(|reason| self.error(reason))?;
        let Some(bytes) = self.gather(length, input) else { return Ok(None) };
        let head = Head::of(&bytes).map_err(|reason| self.error(reason))?;
        let mut digest = TABLE.digest();
        digest.update(bytes.get(..length).unwrap_or_default());
        Ok(Some((head, digest)))
    }

    fn begin_contents(&mut self, head: Head) -> Result<(), Error> {
        self.contents.begin(head).map_err(|reason| self.error_in(head, reason))?;
        self.stage = Stage::Contents { head, left: head.stored_bytes };
        Ok(())
    }

    /// A block's contents have been returned; its checksum was compared before.
    fn end_contents(&mut self, head: Head) -> Result<(), Error> {
        self.contents.end().map_err(|reason| self.error_in(head, reason))?;
        if self.has_checksums {
            self.pass(CRC_BYTES);
        }
        self.begin_block();
        Ok(())
    }

    fn begin_block(&mut self) {
        self.stage = Stage::BlockHeader;
        self.block = self.block.saturating_add(1);
        self.offset = self.position;
    }

    /// Takes bytes until this many are gathered; whether they all are.
    fn collect(&mut self, count: usize, input: &mut &[u8]) -> bool {
        while self.gathered_bytes < count {
            let Some((&byte, rest)) = input.split_first() else { return false };
            if let Some(place) = self.gathered.get_mut(self.gathered_bytes) {
                *place = byte;
            }
            *input = rest;
            self.gathered_bytes += 1;
            self.pass(1);
        }
        true
    }

    /// Collects bytes as [`Self::collect`] does, and takes them out.
    fn gather(&mut self, count: usize, input: &mut &[u8]) -> Option<[u8; MAX_HEAD_BYTES]> {
        if !self.collect(count, input) {
            return None;
        }
        self.gathered_bytes = 0;
        Some(self.gathered)
    }

    fn pass(&mut self, bytes: usize) {
        self.position = self.position.saturating_add(bytes as u64);
    }

    fn error(&self, reason: Reason) -> Error {
        Error { block: self.block, kind: None, offset: self.offset, reason }
    }

    fn error_in(&self, head: Head, reason: Reason) -> Error {
        Error { kind: Some(head.kind), ..self.error(reason) }
    }
}

/// Takes as many of the bytes as belong to the rest of a block.
fn take<'a>(left: &mut u32, input: &mut &'a [u8]) -> &'a [u8] {
    let (bytes, rest) = input.split_at(input.len().min(*left as usize));
    *left -= bytes.len() as u32;
    *input = rest;
    bytes
}

/// The contents of one block, by the bytes of its data.
#[cfg(feature = "write")]
pub(crate) fn contents(head: Head, mut stored: &[u8]) -> Result<alloc::vec::Vec<u8>, Reason> {
    let mut contents = Contents::new();
    contents.begin(head)?;
    let (mut text, mut portion) = (alloc::vec::Vec::new(), [0; 1024]);
    loop {
        match contents.fill(&mut stored, &mut portion)? {
            0 => break,
            made => text.extend_from_slice(portion.get(..made).unwrap_or_default()),
        }
    }
    contents.end()?;
    Ok(text)
}

/// A block's contents, decompressed and decoded.
#[derive(Clone)]
struct Contents {
    compression: Compression,
    heatshrink: Heatshrink,
    #[cfg(feature = "deflate")]
    inflate: Inflate,
    /// Unpacker of the G-code, if it is packed.
    meatpack: Option<Unpacker>,
    /// Bytes that had no room in the output, from `waiting_from`.
    waiting: Unpacked,
    waiting_from: usize,
    /// A packed line has just ended.
    after_line_end: bool,
    /// Bytes by the block's header, and those decompressed so far.
    expected: u32,
    decompressed: u32,
    /// Reason for which no more contents come.
    failed: Option<Reason>,
}

impl Contents {
    fn new() -> Self {
        Self {
            compression: Compression::None,
            heatshrink: Heatshrink::new(),
            #[cfg(feature = "deflate")]
            inflate: Inflate::new(),
            meatpack: None,
            waiting: Unpacked::default(),
            waiting_from: 0,
            after_line_end: false,
            expected: 0,
            decompressed: 0,
            failed: None,
        }
    }

    fn begin(&mut self, head: Head) -> Result<(), Reason> {
        self.meatpack = match (head.kind, head.encoding) {
            (BlockKind::Thumbnail { .. }, _) | (_, 0) => None,
            (BlockKind::Gcode, 1 | 2) => Some(Unpacker::new()),
            (_, encoding) => return Err(Reason::Encoding(encoding)),
        };
        match head.compression {
            Compression::None => {}
            Compression::Heatshrink(window_bits) => self.heatshrink.restart(window_bits),
            #[cfg(feature = "deflate")]
            Compression::Deflate => self.inflate.restart(),
            #[cfg(not(feature = "deflate"))]
            Compression::Deflate => return Err(Reason::DeflateNotSupported),
        }
        (self.waiting, self.waiting_from, self.after_line_end) = (Unpacked::default(), 0, false);
        (self.compression, self.expected, self.decompressed) = (head.compression, head.bytes, 0);
        self.failed = None;
        Ok(())
    }

    /// Decodes until the input is used up or the output is full; returns the number of bytes
    /// made. Bytes made before an error are returned first, so that the size of the portions
    /// makes no difference.
    fn fill(&mut self, input: &mut &[u8], output: &mut [u8]) -> Result<usize, Reason> {
        let mut made = 0;
        for place in output {
            let next = match self.failed {
                Some(reason) => Err(reason),
                None => self.next(input),
            };
            match next {
                Ok(Some(byte)) => *place = byte,
                Ok(None) => break,
                Err(reason) => {
                    self.failed = Some(reason);
                    return if made > 0 { Ok(made) } else { Err(reason) };
                }
            }
            made += 1;
        }
        Ok(made)
    }

    fn next(&mut self, input: &mut &[u8]) -> Result<Option<u8>, Reason> {
        loop {
            while let Some(&byte) = self.waiting.bytes().get(self.waiting_from) {
                self.waiting_from += 1;
                // Prusa's packer ends lines of G commands twice; its unpacker also
                // drops empty lines.
                let is_line_end = byte == b'\n';
                if !(core::mem::replace(&mut self.after_line_end, is_line_end) && is_line_end) {
                    return Ok(Some(byte));
                }
            }
            let Some(byte) = self.decompress(input)? else { return Ok(None) };
            if self.decompressed == self.expected {
                return Err(Reason::Length { expected: self.expected });
            }
            self.decompressed += 1;
            let Some(unpacker) = &mut self.meatpack else { return Ok(Some(byte)) };
            (self.waiting, self.waiting_from) = (unpacker.feed(byte), 0);
        }
    }

    fn decompress(&mut self, input: &mut &[u8]) -> Result<Option<u8>, Reason> {
        match self.compression {
            Compression::None => Ok(input.split_off_first().copied()),
            Compression::Heatshrink(_) => Ok(self.heatshrink.next(input)),
            #[cfg(feature = "deflate")]
            Compression::Deflate => self.inflate.next(input).map_err(|()| Reason::Deflate),
            #[cfg(not(feature = "deflate"))]
            Compression::Deflate => Err(Reason::DeflateNotSupported),
        }
    }

    /// All of the block's bytes have been decoded.
    fn end(&self) -> Result<(), Reason> {
        #[cfg(feature = "deflate")]
        if self.compression == Compression::Deflate && self.expected > 0 && !self.inflate.is_done() {
            return Err(Reason::Deflate);
        }
        if self.decompressed < self.expected {
            return Err(Reason::Length { expected: self.expected });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
