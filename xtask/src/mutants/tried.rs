//! The results of the mutants that were tried.

use std::collections::BTreeMap;

/// Results by file, from the root.
pub type Files = BTreeMap<String, Tried>;

/// The result of a file's mutants.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tried {
    /// Mutants that compile.
    pub mutants: usize,
    /// The survivors' changes without their lines, and how many make the same change.
    pub survivors: BTreeMap<String, usize>,
}

impl Tried {
    /// Number of survivors.
    pub fn survivors(&self) -> usize {
        self.survivors.values().sum()
    }
}
