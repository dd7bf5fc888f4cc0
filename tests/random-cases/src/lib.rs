//! Number of cases that the tests of all crates try: random cases of a property, and a run's share
//! of a long sweep. Also the sources for searches beyond properties: [`Random`] numbers, and
//! [`SlicerBlocks`] made of them.
//!
//! A property that sets no number tries proptest's 256 cases, or the number in `PROPTEST_CASES`. A
//! number that a test sets itself would win over the variable; [`cases`] lets the variable scale it
//! instead, so that a cheap property keeps trying more than an expensive one.
//!
//! A sweep too long for every run tries [`share_of`] its cases: `FERROSTEP_SHARE` says which share.
#![forbid(unsafe_code)]

mod random;
mod share;
mod slicer_blocks;

pub use random::Random;
pub use share::{Share, SharedCases, VARIABLE as SHARE_VARIABLE, share_of, share_of_cases};
pub use slicer_blocks::{SlicerBlock, SlicerBlocks};

use proptest::test_runner::Config;

/// Cases of a property that sets no number, unless `PROPTEST_CASES` is set.
const USUAL: u64 = 256;

/// Proptest's configuration with `count` cases, times `PROPTEST_CASES` / 256 where that is set. The
/// seed is that of `PROPTEST_RNG_SEED`, and failures are kept beside the tests, as everywhere.
///
/// ```
/// use ferrostep_random_cases::cases;
/// use proptest::prelude::*;
///
/// proptest! {
///     #![proptest_config(cases(1_000))]
///     # /*
///     #[test]
///     # */
///     fn sums_commute(a in 0..100, b in 0..100) {
///         prop_assert_eq!(a + b, b + a);
///     }
/// }
/// # sums_commute();
/// ```
pub fn cases(count: u32) -> Config {
    let config = Config::default();
    Config { cases: scaled(count, config.cases), ..config }
}

/// `count` cases where a property without a number tries `usual` instead of 256; at least one.
fn scaled(count: u32, usual: u32) -> u32 {
    let cases = u64::from(count) * u64::from(usual) / USUAL;
    u32::try_from(cases).unwrap_or(u32::MAX).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_variable_scales_a_test_s_own_number() {
        assert_eq!([scaled(64, 256), scaled(20_000, 256), scaled(1, 256)], [64, 20_000, 1]);
        assert_eq!([scaled(64, 4096), scaled(400, 512), scaled(64, 128)], [1024, 800, 32]);
        assert_eq!([scaled(64, 1), scaled(20_000, u32::MAX)], [1, u32::MAX]);
    }

    #[test]
    fn seed_and_persistence_are_proptest_s() {
        let (own, usual) = (cases(7), Config::default());
        assert_eq!(own.rng_seed, usual.rng_seed);
        assert_eq!(own.failure_persistence, usual.failure_persistence);
        assert_eq!(Config { cases: usual.cases, ..own }, usual);
    }
}
