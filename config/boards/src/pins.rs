//! The pins of a board as its keys claim them: each once, and only those that the chip has.

use std::collections::BTreeMap;

use ferrostep_checked_toml::{Reader, Section};

use crate::chip::Chip;
use crate::pin::Pin;
use crate::signals::DEBUG_PINS;

/// A pin's use.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Use {
    /// Any use without special rules.
    Any,
    /// A motor's enable signal: motors may share it.
    Enable,
    /// An input that interrupts: of each number only one port's pin can.
    Input,
}

/// The pins used so far.
pub(crate) struct Pins<'r> {
    reader: &'r Reader<'r>,
    chip: Chip,
    used: BTreeMap<Pin, (Use, String)>,
    notes: Vec<String>,
}

const PIN: &str = "a pin's name, such as \"PA0\"";

impl<'r> Pins<'r> {
    /// No pin is used.
    pub fn new(reader: &'r Reader<'r>, chip: Chip) -> Self {
        Self { reader, chip, used: BTreeMap::new(), notes: Vec::new() }
    }

    /// Returns the notes on the board's pins for its users.
    pub fn into_notes(self) -> Vec<String> {
        self.notes
    }

    /// The pin that a key must name, for this use.
    pub fn take(&mut self, table: &Section<'_>, key: &'static str, usage: Use, about: &'static str) -> Pin {
        let name = table.text(key, PIN, |name| Pin::named(name).is_some()).required(about);
        self.take_named(&table.path(key), &name, usage)
    }

    /// The pin that a key may name.
    pub fn take_some(
        &mut self,
        table: &Section<'_>,
        key: &'static str,
        usage: Use,
        absent: &'static str,
        about: &'static str,
    ) -> Option<Pin> {
        let name = table.text(key, PIN, |name| Pin::named(name).is_some()).optional(absent, about)?;
        Some(self.take_named(&table.path(key), &name, usage))
    }

    /// The pin of this name. A name that is not a pin's is refused already; PA0 replaces it then.
    pub fn take_named(&mut self, path: &str, name: &str, usage: Use) -> Pin {
        let Some(pin) = Pin::named(name) else { return Pin { port: 0, number: 0 } };
        let line = |path: &str| self.reader.line(path).unwrap_or_default();
        if !self.chip.has(pin) {
            let Chip { name, package, .. } = self.chip;
            self.reader.refuse(path, format!("a pin of the {name} in {package} that is not the crystal's"));
        } else if let Some((before, other)) = self.used.get(&pin)
            && (usage, *before) != (Use::Enable, Use::Enable)
        {
            let expected = format!("a pin that nothing else uses: it is {other} already (line {})", line(other));
            self.reader.refuse(path, expected);
        } else if usage == Use::Input
            && let Some((_, (_, other))) =
                self.used.iter().find(|(used, (of, _))| *of == Use::Input && used.number == pin.number)
        {
            let expected = format!(
                "an input of another number: {other} (line {}) has the interrupt line {} already",
                line(other),
                pin.number
            );
            self.reader.refuse(path, expected);
        }
        if let Some((_, debug)) = DEBUG_PINS.into_iter().find(|(debug, _)| *debug == name) {
            self.notes
                .push(format!("{path} = {pin} is the debug probe's {debug}: while it is used, no probe is heard"));
        }
        self.used.entry(pin).or_insert_with(|| (usage, path.to_owned()));
        pin
    }
}
