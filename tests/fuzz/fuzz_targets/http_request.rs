//! Any bytes are the head of an HTTP request or are refused, and in portions of any size alike.
//!
//! A fuzzer does not find a whole head: by the first byte the input is a whole head, or the
//! header lines of one.
#![no_main]

use std::io::{self, Read};

use ferrostep_web::reads_head;
use libfuzzer_sys::fuzz_target;

/// Bytes in portions.
struct Portions<'a>(&'a [u8], usize);

impl Read for Portions<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let length = self.1.min(buffer.len());
        self.0.read(&mut buffer[..length])
    }
}

fuzz_target!(|input: &[u8]| {
    let Some((&mode, bytes)) = input.split_first() else { return };
    let head = [b"POST /line HTTP/1.1\r\n", bytes, b"\r\n\r\n"].concat();
    let head = if mode & 1 == 0 { bytes } else { &head };
    let whole = reads_head(&mut &*head);
    assert!(matches!(whole, Ok(_) | Err(400 | 411 | 431)), "{whole:?}");
    assert_eq!(reads_head(&mut Portions(head, 1 + usize::from(mode >> 1))), whole);
});
