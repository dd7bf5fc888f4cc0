//! Figures of pieces and of step events, as JSON.

use core::fmt;

/// A mean of instruction counts.
#[derive(Clone, Copy, Debug, Default)]
pub struct Mean {
    instructions: u64,
    units: u64,
}

impl Mean {
    /// Adds a piece of work, with its instructions and the units that it got done.
    pub fn add(&mut self, instructions: u32, units: u32) {
        self.instructions += u64::from(instructions);
        self.units += u64::from(units);
    }

    /// The same for each of these units.
    pub fn each_of(self, units: u32) -> Self {
        Self { units: u64::from(units), ..self }
    }

    /// Adds each unit's share of instructions that were executed once for `units` of them.
    pub fn with_share_of(self, instructions: u32, units: u64) -> Self {
        let share = u64::from(instructions) * self.units / units.max(1);
        Self { instructions: self.instructions + share, ..self }
    }

    /// Total number of instructions.
    pub fn total(self) -> u64 {
        self.instructions
    }

    /// Adds another mean's instructions to this one, each once for this one's units.
    pub fn plus(self, other: Self) -> Self {
        Self { instructions: self.instructions + other.instructions, ..self }
    }
}

impl fmt::Display for Mean {
    /// Writes one decimal: the count is exact, its mean need not be whole.
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let tenths = (self.instructions * 10 + self.units / 2) / self.units.max(1);
        write!(out, "{}.{}", tenths / 10, tenths % 10)
    }
}

/// A number, or `null` without one.
pub struct OrNull(pub Option<u32>);

impl fmt::Display for OrNull {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(number) => write!(out, "{number}"),
            None => out.write_str("null"),
        }
    }
}

/// The step interrupt's events inside a stair, and the one that ends a stair and fetches the next.
#[derive(Clone, Copy, Debug, Default)]
pub struct Events {
    /// Maximum number of events inside a stair.
    pub within: Option<u32>,
    /// The event inside a stair with most to do.
    pub most_within: Option<u32>,
    /// The event with the fetch.
    pub new: Option<u32>,
}

/// The step interrupt, from vector to return.
#[derive(Clone, Copy, Debug, Default)]
pub struct StepEvents {
    /// One motor steps.
    pub one_axis: Events,
    /// Four motors step at once.
    pub four_axes: Events,
    /// Step signals as the profile's drivers want them: with pulses a step is two events.
    pub profile: Events,
    /// Motors on two ports.
    pub two_ports: Events,
    /// Motors on three ports.
    pub three_ports: Events,
    /// Stairs of one event each, four motors: everything in every event.
    pub single: Option<u32>,
    /// Instructions at the start of a motion, before its first event.
    pub start_of_motion: u32,
    /// Instructions of a motion's last event.
    pub end_of_motion: u32,
    /// Mean of a real print.
    pub mean: Mean,
    /// Maximum of any event of a real print, between its start and its end.
    pub worst: u32,
}

impl fmt::Display for StepEvents {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let axes = [("1_axis", self.one_axis), ("4_axes", self.four_axes)];
        out.write_str("{")?;
        for (name, Events { within, most_within, new }) in axes {
            let (within, most_within, new) = (OrNull(within), OrNull(most_within), OrNull(new));
            write!(out, "\"within_stair_{name}\": {within}, \"most_within_stair_{name}\": {most_within}, ")?;
            write!(out, "\"new_stair_{name}\": {new}, ")?;
        }
        for (name, Events { within, new, .. }) in
            [("profile", self.profile), ("two_ports", self.two_ports), ("three_ports", self.three_ports)]
        {
            let (within, new) = (OrNull(within), OrNull(new));
            write!(out, "\"{name}\": {{\"within_stair\": {within}, \"new_stair\": {new}}}, ")?;
        }
        write!(out, "\"single_event_stair_4_axes\": {}, ", OrNull(self.single))?;
        let Self { start_of_motion, end_of_motion, mean, worst, .. } = self;
        write!(out, "\"start_of_motion\": {start_of_motion}, \"end_of_motion\": {end_of_motion}, ")?;
        write!(out, "\"mean\": {mean}, \"worst\": {worst}}}")
    }
}
