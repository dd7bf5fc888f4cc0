//! The definitions of Marlin's configuration that are in force.

use std::collections::HashMap;

/// A definition that is in force.
#[derive(Clone, Debug)]
pub struct Definition {
    /// The definition's file.
    pub file: String,
    /// The definition's line, from 1.
    pub line: usize,
    /// The definition's name.
    pub name: String,
    /// The definition's value; empty for a switch.
    pub value: String,
    /// The command by which a running printer says it.
    pub by: Option<String>,
}

impl Definition {
    /// Names it, with the command by which a running printer says it.
    pub fn key(&self) -> String {
        match &self.by {
            Some(by) if self.name.starts_with(by.as_str()) => by.clone(),
            Some(by) => format!("{by} ({})", self.name),
            None => self.name.clone(),
        }
    }
}

/// Abilities that a running printer reports beside its settings.
#[derive(Clone, Copy, Debug)]
pub struct Running {
    /// The printer has a probe of the bed.
    pub has_probe: bool,
}

/// All definitions in force, in their order.
#[derive(Clone, Debug, Default)]
pub struct Definitions {
    /// The definitions.
    pub all: Vec<Definition>,
    /// Values by name.
    pub values: HashMap<String, String>,
    /// Macros with arguments by name: the arguments' names, and what they make.
    pub functions: HashMap<String, (Vec<String>, String)>,
    /// Includes that were not found: file, line, name, why.
    pub missing: Vec<(String, usize, String, String)>,
    /// The file's definitions that a running printer's have replaced.
    pub replaced: Vec<Definition>,
    /// A running printer's, without a file.
    pub running: Option<Running>,
    /// Files that were read.
    pub files: Vec<String>,
}

impl Definitions {
    /// Starts without definitions, for a running printer.
    pub fn of_running(running: Running) -> Self {
        Self { running: Some(running), ..Self::default() }
    }

    /// Adds one.
    pub fn add(&mut self, file: &str, line: usize, name: &str, value: &str) {
        let (name, value) = (name.to_owned(), value.to_owned());
        self.values.insert(name.clone(), value.clone());
        self.all.push(Definition { file: file.to_owned(), line, name, value, by: None });
    }

    /// Removes all definitions of a name, as a running printer's replace them.
    pub fn replace(&mut self, name: &str) {
        self.values.remove(name);
        let is_other = |definition: &mut Definition| definition.name == name;
        let replaced: Vec<Definition> = self.all.extract_if(.., is_other).collect();
        self.replaced.extend(replaced.into_iter().filter(|definition| definition.by.is_none()));
    }

    /// The definition of a name that holds.
    pub fn get(&self, name: &str) -> Option<&Definition> {
        crate::effort::count();
        self.all.iter().rev().find(|definition| definition.name == name)
    }
}
