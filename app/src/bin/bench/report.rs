//! The numbers as JSON.

use core::fmt;

/// A mean of instruction counts.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mean {
    instructions: u64,
    units: u64,
}

impl Mean {
    /// Adds a piece of work that took so many instructions and got so many units done.
    pub fn add(&mut self, instructions: u32, units: u32) {
        self.instructions += u64::from(instructions);
        self.units += u64::from(units);
    }
}

impl fmt::Display for Mean {
    /// With one decimal: the count is exact, its mean need not be whole.
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let tenths = (self.instructions * 10 + self.units / 2) / self.units.max(1);
        write!(out, "{}.{}", tenths / 10, tenths % 10)
    }
}

/// Instructions for each piece.
#[derive(Clone, Copy, Debug, Default)]
pub struct Report {
    /// The bytes of a line to a command.
    pub parse_line: Mean,
    /// The text of a line to a block in the full look-ahead ring, parsing included.
    pub line_to_block: Mean,
    /// A block that leaves the ring to step entries, for each step event in them.
    pub block_to_queue_per_step: Mean,
    /// The same for each entry: a stair of many events is one.
    pub block_to_queue_per_entry: Mean,
    /// The step interrupt, for each event that steps a motor.
    pub step_event: Mean,
}

impl fmt::Display for Report {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let pieces = [
            ("parse_line", self.parse_line),
            ("line_to_block", self.line_to_block),
            ("block_to_queue_per_step", self.block_to_queue_per_step),
            ("block_to_queue_per_entry", self.block_to_queue_per_entry),
            ("step_event", self.step_event),
        ];
        let mut separator = "{";
        for (name, mean) in pieces {
            write!(out, "{separator}\"target.{name}\": {mean}")?;
            separator = ", ";
        }
        out.write_str("}")
    }
}
