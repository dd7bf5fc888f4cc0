//! Deflate, in zlib's wrapping.

use core::ops::Range;

use miniz_oxide::inflate::TINFLStatus;
use miniz_oxide::inflate::core::inflate_flags::{
    TINFL_FLAG_COMPUTE_ADLER32, TINFL_FLAG_HAS_MORE_INPUT, TINFL_FLAG_PARSE_ZLIB_HEADER,
};
use miniz_oxide::inflate::core::{DecompressorOxide, decompress};

/// Bytes of the window: the furthest that Deflate refers back.
const WINDOW_BYTES: usize = 32 * 1024;

/// A decompressor of one block.
#[derive(Clone)]
pub(crate) struct Inflate {
    state: DecompressorOxide,
    window: [u8; WINDOW_BYTES],
    /// Bytes of the window that are not handed out yet.
    ready: Range<usize>,
    /// The window was full before all was decompressed.
    has_more: bool,
    is_done: bool,
    /// The data after the ready bytes is damaged.
    is_damaged: bool,
}

impl Inflate {
    /// Creates a decoder at the start of a block.
    pub fn new() -> Self {
        Self {
            state: DecompressorOxide::new(),
            window: [0; WINDOW_BYTES],
            ready: 0..0,
            has_more: false,
            is_done: false,
            is_damaged: false,
        }
    }

    /// Begins a block.
    pub fn restart(&mut self) {
        self.state.init();
        (self.ready, self.has_more, self.is_done, self.is_damaged) = (0..0, false, false, false);
    }

    /// The next byte, or `None` after it has taken all of `input`.
    ///
    /// # Errors
    /// The bytes are not Deflate's, or continue after its end.
    pub fn next(&mut self, input: &mut &[u8]) -> Result<Option<u8>, ()> {
        loop {
            if let Some(place) = self.ready.next() {
                return Ok(self.window.get(place).copied());
            }
            if self.is_damaged {
                return Err(());
            }
            if self.is_done {
                return if input.is_empty() { Ok(None) } else { Err(()) };
            }
            if input.is_empty() && !self.has_more {
                return Ok(None);
            }
            let start = self.ready.end % WINDOW_BYTES;
            let flags = TINFL_FLAG_PARSE_ZLIB_HEADER | TINFL_FLAG_COMPUTE_ADLER32 | TINFL_FLAG_HAS_MORE_INPUT;
            let (status, used, made) = decompress(&mut self.state, input, &mut self.window, start, flags);
            *input = input.get(used..).unwrap_or_default();
            self.ready = start..start + made;
            self.has_more = status == TINFLStatus::HasMoreOutput;
            match status {
                TINFLStatus::Done => self.is_done = true,
                TINFLStatus::NeedsMoreInput if input.is_empty() => {}
                TINFLStatus::HasMoreOutput if used + made > 0 => {}
                _ => self.is_damaged = true,
            }
        }
    }

    /// Returns true if the data has ended and all of it was taken.
    pub fn is_done(&self) -> bool {
        self.is_done && self.ready.is_empty()
    }
}
