//! A text that outlives a reset: the last words of a panic or a fault, in RAM that the
//! start leaves alone.

use core::fmt;
use core::sync::atomic::{AtomicU8, AtomicU32, Ordering};

/// Maximum length of the text, bytes; a longer one is cut.
pub const MAX_BYTES: usize = 160;

/// FNV-1a's first value and factor.
const BASIS: u32 = 0x811c_9dc5;
const FACTOR: u32 = 0x0100_0193;

/// The text and its check word. At power-on the memory is random, and the check
/// word does not match.
#[derive(Debug)]
pub struct CrashMessage {
    check: AtomicU32,
    length: AtomicU32,
    bytes: [AtomicU8; MAX_BYTES],
}

impl CrashMessage {
    /// No text.
    pub const fn new() -> Self {
        Self { check: AtomicU32::new(0), length: AtomicU32::new(0), bytes: [const { AtomicU8::new(0) }; MAX_BYTES] }
    }

    /// Keeps a text; it replaces the one before. Line ends and other characters than
    /// ASCII become spaces.
    pub fn keep(&self, text: fmt::Arguments<'_>) {
        self.length.store(0, Ordering::Relaxed);
        // Cut where it is too long.
        let _ = fmt::write(&mut Writer(self), text);
        self.check.store(self.sum(), Ordering::Relaxed);
    }

    /// The text, if there is one.
    pub fn get(&self) -> Option<impl fmt::Display> {
        let length = self.length.load(Ordering::Relaxed) as usize;
        let bytes = self.bytes.get(..length).filter(|bytes| !bytes.is_empty())?;
        let printable = bytes.iter().all(|byte| matches!(byte.load(Ordering::Relaxed), b' '..=b'~'));
        (printable && self.check.load(Ordering::Relaxed) == self.sum()).then_some(Shown(bytes))
    }

    /// Forgets the text.
    pub fn clear(&self) {
        self.length.store(0, Ordering::Relaxed);
    }

    /// Over length and bytes.
    fn sum(&self) -> u32 {
        let length = self.length.load(Ordering::Relaxed);
        let bytes = self.bytes.iter().take(length as usize).map(|byte| u32::from(byte.load(Ordering::Relaxed)));
        bytes.fold(BASIS ^ length, |sum, byte| (sum ^ byte).wrapping_mul(FACTOR))
    }
}

impl Default for CrashMessage {
    fn default() -> Self {
        Self::new()
    }
}

struct Writer<'a>(&'a CrashMessage);

impl fmt::Write for Writer<'_> {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for byte in text.bytes() {
            let length = self.0.length.load(Ordering::Relaxed);
            let place = self.0.bytes.get(length as usize).ok_or(fmt::Error)?;
            place.store(if matches!(byte, b' '..=b'~') { byte } else { b' ' }, Ordering::Relaxed);
            self.0.length.store(length + 1, Ordering::Relaxed);
        }
        Ok(())
    }
}

struct Shown<'a>(&'a [AtomicU8]);

impl fmt::Display for Shown<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        use fmt::Write;
        self.0.iter().try_for_each(|byte| out.write_char(char::from(byte.load(Ordering::Relaxed))))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn shown(kept: &CrashMessage) -> Option<String> {
        kept.get().map(|text| text.to_string())
    }

    #[test]
    fn what_is_kept_is_read_until_it_is_cleared() {
        let kept = CrashMessage::new();
        assert_eq!(shown(&kept), None);
        kept.keep(format_args!("panicked at app/src/main.rs:{}:2:\nattempt to add with overflow", 1));
        assert_eq!(shown(&kept).unwrap(), "panicked at app/src/main.rs:1:2: attempt to add with overflow");
        kept.keep(format_args!("x\u{e4}y"));
        assert_eq!(shown(&kept).unwrap(), "x  y");
        kept.clear();
        assert_eq!(shown(&kept), None);
        kept.keep(format_args!(""));
        assert_eq!(shown(&kept), None);
    }

    #[test]
    fn a_long_text_is_cut() {
        let kept = CrashMessage::new();
        kept.keep(format_args!("{}", "long ".repeat(100)));
        assert_eq!(shown(&kept).unwrap(), "long ".repeat(32));
    }

    proptest! {
        /// A byte that the reset has changed, or a length: no text, and not a wrong one.
        #[test]
        fn a_changed_text_is_none(text in "[ -~]{1,160}", place in any::<prop::sample::Index>(), bits in 1_u8..) {
            let kept = CrashMessage::new();
            kept.keep(format_args!("{text}"));
            prop_assert_eq!(shown(&kept).unwrap(), text.as_str());
            kept.bytes[place.index(text.len())].fetch_xor(bits, Ordering::Relaxed);
            prop_assert_eq!(shown(&kept), None);
        }

        /// Memory as it is when the supply comes.
        #[test]
        fn anything_is_no_text(check in any::<u32>(), length in any::<u32>(), byte in any::<u8>()) {
            let kept = CrashMessage::new();
            kept.bytes.iter().for_each(|place| place.store(byte, Ordering::Relaxed));
            kept.length.store(length, Ordering::Relaxed);
            kept.check.store(check, Ordering::Relaxed);
            // One chance in 2^32.
            prop_assert_eq!(shown(&kept), None);
        }
    }
}
