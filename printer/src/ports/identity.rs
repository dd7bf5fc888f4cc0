//! The identity of the board and its firmware, which M115 reports.

/// Data of the board and its firmware for M115, beside those of the profile.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Identity<'a> {
    /// Version of the firmware, `0.1.0 (commit abcdef0)`.
    pub version: &'a str,
    /// The board's own number.
    pub identifier: Option<[u32; 3]>,
    /// M112, M108 and M410 are acted on as their bytes arrive.
    pub emergency_parser: bool,
    /// The ports' bytes may be packed.
    pub meatpack: bool,
    /// Prepared jobs may be sent (M790).
    pub receives_jobs: bool,
}

impl Identity<'_> {
    /// Identity of this version, without a commit, on a board without further data.
    pub const fn new() -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION"),
            identifier: None,
            emergency_parser: false,
            meatpack: false,
            receives_jobs: false,
        }
    }
}
