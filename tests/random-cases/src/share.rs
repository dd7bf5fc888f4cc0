//! Shares of long sweeps: a run tries one case of each N, and N runs in turn try each case once.

use std::env;
use std::thread;

use proptest::test_runner::{Config, RngSeed};

use crate::cases;

/// Tells the tests their share: `K/N` with K below N, or `all`.
pub const VARIABLE: &str = "FERROSTEP_SHARE";

/// The share of a run that was not told one: always the same, so that a failure is
/// caused by the change.
const USUAL: Share = Share { index: 0, of: 20 };

/// Random cases that a property tries even in the smallest share.
const FEWEST_CASES: u32 = 8;

/// One of `of` shares of a sweep.
///
/// Cases are dealt out in rounds of one to each share, and each round begins one share later than
/// the round before. So a share's cases are `of` - 1 apart, and it gets even and odd ones: a sweep
/// often alternates between kinds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Share {
    index: u64,
    of: u64,
}

impl Share {
    /// All cases.
    pub const ALL: Self = Self { index: 0, of: 1 };

    /// The share that [`VARIABLE`] names; 0/20 without it.
    ///
    /// # Panics
    /// If the variable is neither `K/N` nor `all`.
    pub fn of_this_run() -> Self {
        let Ok(given) = env::var(VARIABLE) else { return USUAL };
        let Some(share) = Self::parse(&given) else {
            panic!("{VARIABLE} is {given:?}: expected K/N with K below N, as 3/20, or all");
        };
        share
    }

    fn parse(given: &str) -> Option<Self> {
        if given == "all" {
            return Some(Self::ALL);
        }
        let (index, of) = given.split_once('/')?;
        let share = Self { index: index.parse().ok()?, of: of.parse().ok()? };
        (share.index < share.of).then_some(share)
    }

    /// The share's cases of `total`, in order. A sweep of fewer cases than shares has some in
    /// several shares, so that no share is empty.
    ///
    /// If the test panics in one of them, a line names the case and the command that
    /// repeats it alone.
    pub fn cases(self, total: u64) -> SharedCases {
        let index = if total < self.of { self.index % total.max(1) } else { self.index };
        let test = thread::current().name().unwrap_or_default().to_owned();
        SharedCases { share: Self { index, ..self }, next: 0, total, current: None, test }
    }

    /// True if all cases are tried: a test may then ask for results that only all of them show.
    pub fn is_all(self) -> bool {
        self.of == 1
    }

    /// True for a case of this number in the share.
    pub fn has(self, case: u64) -> bool {
        (case % self.of + case / self.of % self.of) % self.of == self.index
    }
}

/// The cases of a sweep that this run tries.
#[derive(Debug)]
pub struct SharedCases {
    share: Share,
    next: u64,
    total: u64,
    current: Option<u64>,
    /// The thread that asked is the test's own, and bears its name.
    test: String,
}

impl SharedCases {
    /// The case that is being tried, and the command that tries it alone: case K of N is share K/N.
    fn repeat_line(&self) -> Option<String> {
        let case = self.current?;
        let package = env::var("CARGO_PKG_NAME").unwrap_or_else(|_| "PACKAGE".to_owned());
        let (total, test) = (self.total, &self.test);
        Some(format!("case {case} of {total}; again: {VARIABLE}={case}/{total} cargo test -p {package} {test}"))
    }
}

impl Iterator for SharedCases {
    type Item = u64;

    fn next(&mut self) -> Option<u64> {
        self.current = (self.next..self.total).find(|&case| self.share.has(case));
        self.next = self.current.map_or(self.total, |case| case + 1);
        self.current
    }
}

impl Drop for SharedCases {
    fn drop(&mut self) {
        if let Some(line) = self.repeat_line().filter(|_| thread::panicking()) {
            eprintln!("{line}");
        }
    }
}

/// This run's cases of a sweep of `total`.
///
/// ```
/// for seed in ferrostep_random_cases::share_of(10_000) {
///     assert!(seed < 10_000);
/// }
/// ```
pub fn share_of(total: u64) -> SharedCases {
    Share::of_this_run().cases(total)
}

/// Proptest's configuration with this run's share of `count` random cases, scaled as by [`cases`].
/// Each share has its own seed, so that N runs in turn try `count` different cases; all of
/// them at once have the seed of `PROPTEST_RNG_SEED`.
pub fn share_of_cases(count: u32) -> Config {
    let (share, whole) = (Share::of_this_run(), cases(count));
    Config { cases: portion(whole.cases, share), rng_seed: seed(whole.rng_seed, share), ..whole }
}

/// A share of these random cases.
fn portion(cases: u32, share: Share) -> u32 {
    let portion = u64::from(cases).div_ceil(share.of);
    u32::try_from(portion).unwrap_or(u32::MAX).max(FEWEST_CASES.min(cases))
}

/// The share's own seed.
fn seed(whole: RngSeed, share: Share) -> RngSeed {
    match whole {
        RngSeed::Fixed(seed) => RngSeed::Fixed(seed.wrapping_add(share.index)),
        RngSeed::Random => RngSeed::Random,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn parsed(given: &str) -> Option<(u64, u64)> {
        Share::parse(given).map(|share| (share.index, share.of))
    }

    #[test]
    fn a_share_is_a_number_below_the_count_or_all() {
        assert_eq!([parsed("0/20"), parsed("19/20"), parsed("all")], [Some((0, 20)), Some((19, 20)), Some((0, 1))]);
        for wrong in ["20/20", "0/0", "-1/20", "3", "/", "1/2/3", "All", ""] {
            assert_eq!(parsed(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn over_all_shares_each_case_occurs_once() {
        for of in [1, 2, 7, 20, 64] {
            for total in (of..of + 45).chain([1_000, 9_999, 10_000]) {
                let mut all: Vec<_> = (0..of).flat_map(|index| Share { index, of }.cases(total)).collect();
                all.sort_unstable();
                assert!(all.into_iter().eq(0..total), "{total} cases in {of} shares");
            }
        }
    }

    #[test]
    fn no_share_of_few_cases_is_empty_and_no_case_is_left_out() {
        for total in 1..20 {
            let mut seen = vec![false; total as usize];
            for index in 0..20 {
                let cases: Vec<_> = Share { index, of: 20 }.cases(total).collect();
                assert_eq!(cases.len(), 1, "{total} cases, share {index}");
                seen[cases[0] as usize] = true;
            }
            assert!(seen.into_iter().all(|seen| seen), "{total} cases");
        }
        assert_eq!(USUAL.cases(0).count(), 0);
    }

    #[test]
    fn a_case_is_in_the_share_that_yields_it() {
        let share = Share { index: 3, of: 20 };
        assert!((0..100).filter(|&case| share.has(case)).eq(share.cases(100)));
        // A case in each round of twenty, and one place earlier in each.
        assert!(share.cases(100).eq([3, 22, 41, 60, 99]));
    }

    #[test]
    fn the_line_of_a_failure_tries_its_case_alone() {
        let mut cases = Share { index: 3, of: 20 }.cases(1_000);
        assert_eq!(cases.repeat_line(), None);
        assert_eq!(cases.nth(2), Some(41));
        let line = cases.repeat_line().unwrap();
        assert!(line.starts_with("case 41 of 1000; again: FERROSTEP_SHARE=41/1000 cargo test -p "), "{line}");
        assert!(line.ends_with("the_line_of_a_failure_tries_its_case_alone"), "{line}");
        assert!(Share::parse("41/1000").unwrap().cases(1_000).eq([41]));
    }

    #[test]
    fn shares_of_random_cases_differ_and_none_is_tiny() {
        let third = Share { index: 2, of: 20 };
        assert_eq!([portion(2_000, third), portion(100, third), portion(3, third)], [100, 8, 3]);
        assert_eq!(portion(300, Share::ALL), 300);
        assert_eq!(seed(RngSeed::Fixed(7), third), RngSeed::Fixed(9));
        assert_eq!(seed(RngSeed::Fixed(7), Share::ALL), RngSeed::Fixed(7));
    }
}
