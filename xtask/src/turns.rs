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
    /// Tests that share a turn, as those of an image that nothing else needs.
    together: Vec<Vec<String>>,
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

    /// Reads the line `turns = N`, and lists with a line `"NAME",` or `["NAME", "NAME"],` for each
    /// entry; `xtask` depends on no reader of TOML.
    fn parse(text: &str) -> Option<Self> {
        let turns =
            text.lines().find_map(|line| line.strip_prefix("turns = ")?.parse().ok()).filter(|turns| *turns > 0)?;
        let entries = |list: &str| {
            let lines = text.lines().skip_while(|line| line.strip_suffix(" = [") != Some(list)).skip(1);
            let lines = lines.take_while(|line| *line != "]").map(str::trim).filter(|line| !line.starts_with('#'));
            lines.map(|line| quoted(line).map(str::to_owned).collect::<Vec<_>>()).collect::<Vec<_>>()
        };
        Some(Self { turns, always: entries("always").concat(), together: entries("together") })
    }

    /// The tests that this share leaves to others. Those that take turns are counted from 0 in the
    /// order of their names, tests that share a turn as one; it is the turn of those whose number
    /// has the share as its remainder by the number of turns.
    pub fn waiting<'a>(&self, names: &'a BTreeSet<String>, share: Share) -> impl Iterator<Item = &'a str> {
        let taking_turns: Vec<&str> = names.iter().map(String::as_str).filter(|name| !self.runs_always(name)).collect();
        let places: BTreeSet<&str> = taking_turns.iter().map(|name| self.place(name)).collect();
        let their_turn: BTreeSet<String> = (0..)
            .zip(places)
            .filter(|(number, _)| share.has(*number, self.turns))
            .map(|(_, of)| of.to_owned())
            .collect();
        let waits: Vec<&str> = taking_turns.into_iter().filter(|name| !their_turn.contains(self.place(name))).collect();
        waits.into_iter()
    }

    /// True for a test of every check.
    pub fn runs_always(&self, name: &str) -> bool {
        self.always.iter().any(|listed| is_of(name, listed))
    }

    /// The names and modules of the file that match no test.
    pub fn unknown(&self, names: &BTreeSet<String>) -> Vec<&str> {
        let listed = self.always.iter().chain(self.together.iter().flatten());
        listed.filter(|listed| !names.iter().any(|name| is_of(name, listed))).map(String::as_str).collect()
    }

    /// The name by which a test is counted: its own, or the first of those with which
    /// it shares a turn.
    fn place<'a>(&'a self, name: &'a str) -> &'a str {
        let shared = self.together.iter().find(|listed| listed.iter().any(|listed| is_of(name, listed)));
        shared.and_then(|listed| listed.first()).map_or(name, String::as_str)
    }
}

/// The texts between quotation marks.
fn quoted(line: &str) -> impl Iterator<Item = &str> {
    line.split('"').skip(1).step_by(2)
}

fn is_of(name: &str, listed: &str) -> bool {
    if listed.ends_with("::") { name.starts_with(listed) } else { name == listed }
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
    fn tests_that_share_a_turn_count_as_one() {
        let text = "turns = 2\nalways = [\n]\ntogether = [\n    # One image.\n    [\"lift::\", \"tools::\"],\n]\n";
        let turns = Turns::parse(text).unwrap();
        let all = names(&["card::a", "card::b", "lift::a", "lift::b", "pins::a", "tools::a"]);
        let waiting = |share: Share| turns.waiting(&all, share).collect::<Vec<_>>();
        assert_eq!(waiting(Share::One(0)), ["card::b", "pins::a"]);
        assert_eq!(waiting(Share::One(1)), ["card::a", "lift::a", "lift::b", "tools::a"]);
        assert!(waiting(Share::All).is_empty());
        assert_eq!(turns.unknown(&names(&["lift::a"])), ["tools::"]);
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
        assert!(!turns.always.is_empty() && !turns.together.is_empty());
    }
}
