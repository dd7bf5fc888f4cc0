//! Image tests that take turns: all but those that run in every check.

use std::collections::BTreeSet;

use crate::share::Share;
use crate::steps::Failure;
use crate::system;

/// File that lists the tests of every check, from the root.
const FILE: &str = "tests/mainboard/tests/turns.toml";

/// The rule by which image tests take turns.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Turns {
    /// Checks in a row that run every test once.
    pub turns: u64,
    /// Tests of every check: names, and modules, which end in `::`.
    always: Vec<String>,
}

impl Turns {
    /// Reads the rule of this project.
    ///
    /// # Errors
    /// The file cannot be read, or has no number of turns.
    pub fn read() -> Result<Self, Failure> {
        let path = system::root().join(FILE);
        let text = std::fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        Self::parse(&text).ok_or_else(|| format!("{}: no `turns = N`", path.display()))
    }

    /// Reads lines `turns = N` and `"NAME",`; `xtask` depends on no reader of TOML. A test of the image tests reads the file with one.
    fn parse(text: &str) -> Option<Self> {
        let turns =
            text.lines().find_map(|line| line.strip_prefix("turns = ")?.parse().ok()).filter(|turns| *turns > 0)?;
        let name = |line: &str| Some(line.trim().strip_prefix('"')?.strip_suffix("\",")?.to_owned());
        Some(Self { turns, always: text.lines().filter_map(name).collect() })
    }

    /// The tests that this share leaves to others: in the order of their names, those that take turns and whose number
    /// among these, counted from 0, does not have the share as its remainder by the number of turns.
    pub fn waiting<'a>(&self, names: &'a BTreeSet<String>, share: Share) -> impl Iterator<Item = &'a str> {
        let taking_turns = names.iter().filter(|name| !self.runs_always(name));
        (0..).zip(taking_turns).filter(move |(place, _)| !share.has(*place, self.turns)).map(|(_, name)| name.as_str())
    }

    fn runs_always(&self, name: &str) -> bool {
        self.always.iter().any(|listed| if listed.ends_with("::") { name.starts_with(listed) } else { name == listed })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    use crate::share::SHARES;

    fn names(names: &[&str]) -> BTreeSet<String> {
        names.iter().map(|name| (*name).to_owned()).collect()
    }

    #[test]
    fn each_test_runs_always_or_in_one_share_of_its_turns() {
        let turns = Turns::parse("turns = 2\nalways = [\n    \"heat::\",\n    \"pins::one\",\n]\n").unwrap();
        let all = names(&["card::a", "card::b", "heat::a", "pins::one", "pins::one_more"]);
        let waiting = |share: Share| turns.waiting(&all, share).collect::<Vec<_>>();
        assert_eq!(waiting(Share::One(0)), ["card::b"]);
        assert_eq!(waiting(Share::One(1)), ["card::a", "pins::one_more"]);
        assert!(waiting(Share::All).is_empty());
    }

    #[test]
    fn a_file_without_turns_is_refused() {
        assert_eq!(Turns::parse("always = [\n]\n"), None);
        assert_eq!(Turns::parse("turns = 0\n"), None);
    }

    #[test]
    fn twenty_checks_in_a_row_run_every_test_of_this_project() {
        let turns = Turns::read().unwrap();
        assert!(SHARES.is_multiple_of(turns.turns), "{} turns", turns.turns);
        assert!(!turns.always.is_empty());
    }
}
