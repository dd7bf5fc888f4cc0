//! The share of long sweeps and slow tests that a run tries.
//!
//! The number of commits chooses it, so that [`SHARES`] commits in a row, each with its run, try
//! every case. A commit's hash would repeat shares: after twenty runs with hashes a third of all
//! cases (0.95^20) would not have been tried yet.

use std::fmt::{self, Display, Formatter};
use std::process::Command;
use std::str::FromStr;

use crate::steps::Failure;
use crate::system;

/// Environment variable with the tests' share.
pub const VARIABLE: &str = "FERROSTEP_SHARE";

/// Shares of a sweep.
pub const SHARES: u64 = 20;

/// A run's share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Share {
    /// The cases of one share, counted from 0.
    One(u64),
    /// All cases.
    All,
}

impl Share {
    /// The share of the commit that is checked out, and a line about it.
    pub fn of_this_commit() -> (Self, String) {
        let git = |arguments: &[&str]| system::output(Command::new("git").args(arguments).current_dir(system::root()));
        let count = git(&["rev-list", "--count", "HEAD"]).and_then(|count| count.parse::<u64>().ok());
        let Some(count) = count else { return (Self::One(0), "this folder is not a git clone: share 0".to_owned()) };
        let share = Self::One(count % SHARES);
        let hash = git(&["rev-parse", "--short", "HEAD"]).unwrap_or_default();
        (share, format!("commit {hash} is number {count}, and has share {share}"))
    }

    /// True if the test of this number, among those that take turns, is tried.
    pub fn has(self, number: u64, turns: u64) -> bool {
        match self {
            Self::All => true,
            Self::One(share) => number % turns == share % turns,
        }
    }

    /// Value of [`VARIABLE`].
    pub fn value(self) -> String {
        match self {
            Self::All => self.to_string(),
            Self::One(share) => format!("{share}/{SHARES}"),
        }
    }
}

impl Display for Share {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::All => formatter.write_str("all"),
            Self::One(share) => write!(formatter, "{share}"),
        }
    }
}

impl FromStr for Share {
    type Err = Failure;

    fn from_str(text: &str) -> Result<Self, Failure> {
        if text == "all" {
            return Ok(Self::All);
        }
        let share = text.parse().ok().filter(|share| *share < SHARES);
        share.map(Self::One).ok_or_else(|| format!("expected 0 to {} or all", SHARES - 1))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn twenty_commits_in_a_row_try_every_test() {
        for turns in [1, 2, 3, 5, 20] {
            for number in 0..100 {
                let runs = (1234..1234 + SHARES).filter(|commit| Share::One(commit % SHARES).has(number, turns));
                assert!(runs.count() > 0, "number {number} of {turns} turns");
            }
        }
        assert!(Share::All.has(3, 5));
    }

    #[test]
    fn a_share_is_read_as_it_is_printed() {
        for share in [Share::One(0), Share::One(SHARES - 1), Share::All] {
            assert_eq!(share.to_string().parse(), Ok(share));
        }
        assert_eq!("20".parse::<Share>(), Err("expected 0 to 19 or all".to_owned()));
        assert_eq!((Share::One(7).value(), Share::All.value()), ("7/20".to_owned(), "all".to_owned()));
    }

    #[test]
    fn a_commit_has_a_share() {
        let (share, said) = Share::of_this_commit();
        assert!(matches!(share, Share::One(_)), "{said}");
    }
}
