//! Maps Marlin's definitions to a profile's keys.

mod axes;
mod backlash;
mod drivers;
mod fans;
mod filament;
mod filters;
mod heaters;
mod identity;
mod machine;
mod mesh;
mod probe;
mod reasons;
mod sensor;
mod skew;
mod supply;
mod tools;
mod z_motors;

use std::collections::HashSet;

use toml::Value;

use crate::c_macros::is_enabled;
use crate::definitions::{Definition, Definitions};
use crate::draft::Draft;
use crate::error::ImportError;
use crate::expression::{list, number};
use crate::imported::{Imported, Row};
use crate::text::shown;
use reasons::reason;

/// Reason for which a value is not kept though the profile has a key for it.
const NO_NUMBER: &str = "not a number that can be worked out here";

/// Kinds of machines that no profile describes.
const OTHER_MACHINES: [&str; 16] = [
    "DELTA",
    "MORGAN_SCARA",
    "MP_SCARA",
    "AXEL_TPARA",
    "POLAR",
    "POLARGRAPH",
    "COREYZ",
    "COREZY",
    "COREZX",
    "ARTICULATED_ROBOT_ARM",
    "TPARA",
    "DUAL_X_CARRIAGE",
    "MAGNETIC_PARKING_EXTRUDER",
    "MARKFORGED_XY",
    "MARKFORGED_YX",
    "FOAMCUTTER_XYUV",
];

struct Reading<'a> {
    definitions: &'a Definitions,
    /// The same with the values that Marlin works out of them.
    values: Definitions,
    draft: Draft,
    seen: HashSet<String>,
}

/// Makes a profile of a configuration.
///
/// # Errors
/// The machine is of another kind than profiles know.
pub fn map(definitions: &Definitions, assume: bool) -> Result<Imported, ImportError> {
    let is_on = |name: &&str| is_enabled(name, definitions).unwrap_or(true);
    if let Some(other) = OTHER_MACHINES.iter().filter(|name| is_on(name)).find_map(|name| definitions.get(name)) {
        let kinds = "profiles know Cartesian, CoreXY and CoreXZ machines with one carriage only";
        let what = format!("{}: {kinds}", other.name);
        return Err(ImportError::Machine(other.file.clone(), other.line, what));
    }
    if definitions.get("DEFAULT_AXIS_STEPS_PER_UNIT").is_none() && definitions.missing.is_empty() {
        return Err(ImportError::Unknown);
    }
    let mut values = definitions.clone();
    add_derived(&mut values.values);
    let mut reading = Reading { definitions, values, draft: Draft::new(), seen: HashSet::new() };
    reading.draft.put("name", "imported");
    reading.machine();
    reading.motion();
    for (index, axis) in ["x", "y", "z"].into_iter().enumerate() {
        reading.axis(index, axis);
    }
    reading.probe();
    reading.mesh();
    reading.z_motors();
    reading.skew();
    reading.backlash();
    reading.fans();
    reading.filament_sensor();
    reading.power_supply();
    reading.supply_signal();
    reading.heaters();
    for axis in ["x", "y", "z", "e"] {
        reading.driver(axis);
    }
    reading.filters();
    reading.identity();
    reading.rest();
    reading.draft.finish(assume)
}

/// Names that Marlin works out of a configuration and that configurations use.
fn add_derived(values: &mut std::collections::HashMap<String, String>) {
    for axis in ["X", "Y", "Z"] {
        let length = format!("({axis}_MAX_POS - ({axis}_MIN_POS))");
        // The bed's size was the travel before it had its own setting.
        let bed =
            if values.contains_key(&format!("{axis}_BED_SIZE")) { format!("{axis}_BED_SIZE") } else { length.clone() };
        let middle = if values.contains_key("BED_CENTER_AT_0_0") { "0".to_owned() } else { format!("({bed} / 2)") };
        for (name, value) in [("MAX_LENGTH", length), ("CENTER", middle)] {
            values.entry(format!("{axis}_{name}")).or_insert(value);
        }
    }
}

impl<'a> Reading<'a> {
    fn row(&mut self, definition: &Definition, why: &str) -> Row {
        self.seen.insert(definition.name.clone());
        Row {
            file: definition.file.clone(),
            line: definition.line,
            key: definition.key(),
            value: shown(&definition.value),
            kept: None,
            why: why.to_owned(),
            refused: false,
        }
    }

    fn get(&self, name: &str) -> Option<&'a Definition> {
        self.definitions.get(name)
    }

    /// Reads a switch, which is on without a value. `None` where it is not there or
    /// cannot be worked out.
    fn flag(&self, name: &str) -> Option<bool> {
        let definition = self.get(name)?;
        if definition.value.is_empty() {
            return Some(true);
        }
        number(name, &self.values).map(|number| number != 0.0)
    }

    /// Tells whether a signal's state is low. A state that cannot be worked out is a gap in
    /// what the machine is.
    fn is_low(&mut self, name: &str, path: &str) -> Option<bool> {
        let definition = self.get(name)?;
        let state = number(name, &self.values).map(|number| number == 0.0);
        if state.is_none() {
            let row = self.row(definition, NO_NUMBER);
            self.draft.gap(path, Some(row), "expected HIGH or LOW, or what can be worked out to one of them");
        }
        state
    }

    fn number(&self, name: &str) -> Option<f64> {
        number(&self.get(name)?.value, &self.values)
    }

    fn list(&self, name: &str) -> Option<Vec<Option<f64>>> {
        list(&self.get(name)?.value, &self.values)
    }

    fn keep(&mut self, name: &str, path: &str, value: impl Into<Value>, why: &str) {
        if let Some(definition) = self.get(name) {
            let row = self.row(definition, why);
            self.draft.keep(path, value, row);
        }
    }

    fn keep_number<T: Into<toml::Value>>(&mut self, name: &str, path: &str, change: impl Fn(f64) -> T) -> Option<f64> {
        let number = self.number(name);
        match number {
            Some(number) => self.keep(name, path, change(number), ""),
            None => self.lose(name, NO_NUMBER),
        }
        number
    }

    /// The numbers of a list as the axes of a key.
    fn keep_axes(&mut self, name: &str, path: &str, axes: &[&str]) {
        let numbers = self.list(name).unwrap_or_default();
        if numbers.iter().zip(axes).filter(|(number, _)| number.is_some()).count() < axes.len() {
            self.lose(name, NO_NUMBER);
        }
        for (axis, number) in axes.iter().zip(numbers) {
            if let Some(number) = number {
                self.keep(name, &format!("{path}.{axis}"), number, "");
            }
        }
    }

    fn lose(&mut self, name: &str, why: &str) {
        if let Some(definition) = self.get(name) {
            let row = self.row(definition, why);
            self.draft.note(row);
        }
    }

    /// Rows for all definitions that have none yet.
    fn rest(&mut self) {
        for definition in &self.definitions.all {
            if !self.seen.contains(&definition.name) {
                let row = self.row(definition, reason(&definition.name));
                self.draft.add(row);
            }
        }
        for definition in &self.definitions.replaced {
            let row = self.row(definition, "the running printer says otherwise");
            self.draft.add(row);
        }
    }
}
