//! The printers for slicers in `examples/slicers/`.
#![allow(clippy::unwrap_used, reason = "files of the repository")]

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde_json::Value;

use crate::program::repository;

/// The machines: their name in the slicers, their file for Cura, and the firmware's profile.
pub const MACHINES: [(&str, &str, &str); 3] = [
    ("Ferrostep Cartesian", "ferrostep_cartesian", "cartesian"),
    ("Ferrostep CoreXY", "ferrostep_corexy", "corexy"),
    ("Ferrostep Prusa MINI", "ferrostep_prusa_mini", "prusa-mini"),
];

/// Folder of the slicers.
pub fn folder() -> PathBuf {
    repository().join("examples/slicers")
}

/// The sections of PrusaSlicer's bundle: keys and values by the section's name.
///
/// # Panics
/// The bundle cannot be read.
pub fn bundle() -> BTreeMap<String, BTreeMap<String, String>> {
    let text = std::fs::read_to_string(folder().join("prusaslicer/ferrostep.ini")).unwrap();
    let mut sections = BTreeMap::<_, BTreeMap<_, _>>::new();
    let mut section = String::new();
    for line in text.lines().filter(|line| !line.is_empty() && !line.starts_with('#')) {
        if let Some(name) = line.strip_prefix('[').and_then(|line| line.strip_suffix(']')) {
            section = name.to_owned();
        } else {
            let (key, value) = line.split_once(" = ").unwrap();
            sections.entry(section.clone()).or_default().insert(key.to_owned(), value.to_owned());
        }
    }
    sections
}

/// A printer definition of Cura's.
///
/// # Panics
/// The definition cannot be read.
pub fn definition(name: &str) -> Value {
    let path = folder().join(format!("cura/definitions/{name}.def.json"));
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}
