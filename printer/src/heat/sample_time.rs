//! Period at which heater control takes samples.

/// Time from one sample to the next, ms.
pub const SAMPLE_MS: u32 = 10;

/// The same in seconds.
pub(crate) const SAMPLE_S: f32 = SAMPLE_MS as f32 * 1e-3;
