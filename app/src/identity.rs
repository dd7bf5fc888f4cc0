//! The image's own description: for a host by M115, for a person by `strings`.

use core::ops::Range;

/// A text, and where in it the version is.
pub struct Identity {
    text: &'static str,
    version: Range<usize>,
}

impl Identity {
    /// `0.1.0 (commit abcdef0)`.
    pub fn version(&self) -> &'static str {
        self.text.get(self.version.clone()).unwrap_or_default()
    }
}

/// Identity that `build.rs` has found: `ferrostep 0.1.0 (commit abcdef0) prusa-buddy prusa-mini`.
pub static IDENTITY: Identity = include!(concat!(env!("OUT_DIR"), "/identity.rs"));
