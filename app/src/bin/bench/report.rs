//! The numbers as JSON.

use core::fmt;

use crate::prepared::Prepared;
use crate::queue::Tally;

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

    /// The same for each of so many units.
    pub fn each_of(self, units: u32) -> Self {
        Self { units: u64::from(units), ..self }
    }

    /// All of it.
    pub fn total(self) -> u64 {
        self.instructions
    }

    /// Both, each once for the units of the first.
    pub fn plus(self, other: Self) -> Self {
        Self { instructions: self.instructions + other.instructions, ..self }
    }
}

impl fmt::Display for Mean {
    /// With one decimal: the count is exact, its mean need not be whole.
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let tenths = (self.instructions * 10 + self.units / 2) / self.units.max(1);
        write!(out, "{}.{}", tenths / 10, tenths % 10)
    }
}

/// A number, or `null` for what there is none of.
struct OrNull(Option<u32>);

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
    /// Inside: most of them.
    pub within: Option<u32>,
    /// Inside: the one with most to do.
    pub most_within: Option<u32>,
    /// With the fetch.
    pub new: Option<u32>,
}

/// The step interrupt, from vector to return.
#[derive(Clone, Copy, Debug, Default)]
pub struct StepEvents {
    /// One motor steps.
    pub one_axis: Events,
    /// Four motors step at once.
    pub four_axes: Events,
    /// An event that follows so soon that the handler stays for it.
    pub staying: Events,
    /// Step signals as the profile's drivers want them: with pulses a step is two events.
    pub profile: Events,
    /// Motors on two ports.
    pub two_ports: Events,
    /// Motors on three ports.
    pub three_ports: Events,
    /// Stairs of one event each, four motors: everything in every event.
    pub single: Option<u32>,
    /// What a motion begins with, before its first event.
    pub start_of_motion: u32,
    /// Its last event.
    pub end_of_motion: u32,
    /// Of a real print.
    pub mean: Mean,
    /// The most of any event of a real print, between its start and its end.
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
        let Events { within, new, .. } = self.staying;
        write!(out, "\"staying_within_stair\": {}, \"staying_new_stair\": {}, ", OrNull(within), OrNull(new))?;
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

/// What a line costs, from its end point to entries in the step queue. One build of this program tells the instructions,
/// the other the rest.
#[derive(Clone, Copy, Debug, Default)]
pub struct LineCost {
    /// Instructions.
    pub instructions: u32,
    /// Entries.
    pub entries: u32,
    /// Decision values compared with zero.
    pub decisions: u32,
}

/// A line of Wu 2024's tables 1 to 5.
#[derive(Clone, Copy, Debug)]
pub struct WuLine {
    /// Its name here.
    pub name: &'static str,
    /// Classic Bresenham, an entry a step.
    pub classic: LineCost,
    /// Classic Bresenham, runs of equal steps in one entry.
    pub classic_coalesced: LineCost,
    /// Step Bresenham, an entry a stair: one division a line.
    pub step: LineCost,
    /// The same without a division.
    pub step_first_stair: LineCost,
    /// The same with a division a stair.
    pub step_division: LineCost,
}

impl WuLine {
    /// The ways and their names.
    fn ways(&self) -> [(&'static str, LineCost); 5] {
        let Self { classic, classic_coalesced, step, step_first_stair, step_division, .. } = *self;
        [
            ("classic", classic),
            ("classic_coalesced", classic_coalesced),
            ("step", step),
            ("step_first_stair", step_first_stair),
            ("step_division", step_division),
        ]
    }
}

/// A line of some slope.
#[derive(Clone, Copy, Debug)]
pub struct SlopeLine {
    /// Steps of X.
    pub dx: u32,
    /// Steps of Y.
    pub dy: u32,
    /// See [`WuLine::classic`].
    pub classic: LineCost,
    /// See [`WuLine::classic_coalesced`].
    pub classic_coalesced: LineCost,
    /// See [`WuLine::step`].
    pub step: LineCost,
}

impl SlopeLine {
    /// The ways and their names.
    fn ways(&self) -> [(&'static str, LineCost); 3] {
        let Self { classic, classic_coalesced, step, .. } = *self;
        [("classic", classic), ("classic_coalesced", classic_coalesced), ("step", step)]
    }
}

/// All lines, ways and figures: memory that the stack has not got.
#[derive(Debug)]
pub struct Lines {
    /// Wu's, for drivers that step at both edges.
    pub wu: heapless::Vec<WuLine, 5>,
    /// The same with pulses.
    pub wu_pulses: heapless::Vec<WuLine, 5>,
    /// Of every slope, for drivers that step at both edges.
    pub slopes: heapless::Vec<SlopeLine, 23>,
}

impl Lines {
    /// None yet.
    pub const NONE: Self =
        Self { wu: heapless::Vec::new(), wu_pulses: heapless::Vec::new(), slopes: heapless::Vec::new() };

    /// Wu's, by kind of queue.
    fn wu_by_kind(&self) -> [(&'static str, &[WuLine]); 2] {
        [("bresenham", &self.wu), ("bresenham_pulses", &self.wu_pulses)]
    }
}

/// Mean instructions for each G0 or G1 of a whole print.
#[derive(Clone, Copy, Debug, Default)]
pub struct Print {
    /// Bytes to a command.
    pub parse: Mean,
    /// Command to a block in the full ring.
    pub plan: Mean,
    /// Blocks to entries in the step queue.
    pub interpolate: Mean,
    /// Lines with G0 or G1.
    pub moves: u32,
}

/// Everything.
#[derive(Clone, Debug)]
pub struct Report<'a> {
    /// The step interrupt.
    pub step_event: StepEvents,
    /// The bytes of a line to a command.
    pub parse_line: Mean,
    /// The text of a line to a block in the full look-ahead ring, parsing included.
    pub line_to_block: Mean,
    /// A move to a block in the full look-ahead ring, with the reverse pass.
    pub block_full_look_ahead: Mean,
    /// A long trapezoid to the step queue: X, Y and filament.
    pub trapezoid: u32,
    /// The same along X, with filament.
    pub trapezoid_one_axis: u32,
    /// Lines of two axes.
    pub lines: &'a Lines,
    /// Moves as G-code and prepared.
    pub prepared: Prepared,
    /// A whole print.
    pub print: Print,
}

impl fmt::Display for Report<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{{\"target\": {{\"step_event\": {}", self.step_event)?;
        let Print { parse, plan, interpolate, moves } = self.print;
        let pieces = [
            ("parse_line", self.parse_line),
            ("line_to_block", self.line_to_block),
            ("block_full_look_ahead", self.block_full_look_ahead),
            ("line_to_queue_mean", parse.plus(plan).plus(interpolate)),
        ];
        for (name, mean) in pieces {
            write!(out, ", \"{name}\": {mean}")?;
        }
        write!(out, ", \"line_to_queue\": {{\"parse\": {parse}, \"plan\": {plan}, \"interpolate\": {interpolate}}}")?;
        let Prepared { compact, wide, line } = self.prepared;
        for (index, (name, ways)) in [("compact", compact), ("wide", wide), ("line", line)].into_iter().enumerate() {
            let before = if index == 0 { ", \"gpre\": {" } else { ", " };
            write!(out, "{before}\"{name}_to_block\": {}, \"{name}_to_queue\": {}", ways.to_block, ways.to_queue)?;
        }
        out.write_str("}")?;
        for (kind, lines) in self.lines.wu_by_kind() {
            write!(out, ", \"{kind}\": {{")?;
            for (index, line) in lines.iter().enumerate() {
                write!(out, "{}\"{}\": {{", separator(index), line.name)?;
                for (index, (name, cost)) in line.ways().into_iter().enumerate() {
                    write!(out, "{}\"{name}\": {}", separator(index), cost.instructions)?;
                }
                out.write_str("}")?;
            }
            out.write_str("}")?;
        }
        out.write_str(", \"bresenham_slopes\": [")?;
        for (index, line) in self.lines.slopes.iter().enumerate() {
            write!(out, "{}{{\"dx\": {}, \"dy\": {}", separator(index), line.dx, line.dy)?;
            for (name, cost) in line.ways() {
                write!(out, ", \"{name}\": {{\"instructions\": {}}}", cost.instructions)?;
            }
            out.write_str("}")?;
        }
        out.write_str("]")?;
        let Self { trapezoid, trapezoid_one_axis, .. } = self;
        write!(out, "}}, \"moves\": {moves}, \"interpolation\": {{\"trapezoid\": {trapezoid}, ")?;
        write!(out, "\"trapezoid_one_axis\": {trapezoid_one_axis}, \"print\": {}}}}}", interpolate.total())
    }
}

/// What stands before an element of a list.
fn separator(index: usize) -> &'static str {
    if index == 0 { "" } else { ", " }
}

/// What there is to queue, from the build that counts it.
#[derive(Clone, Debug)]
pub struct Workload<'a> {
    /// Of the first trapezoid.
    pub trapezoid: Tally,
    /// Of the other.
    pub trapezoid_one_axis: Tally,
    /// Of the whole print.
    pub print: Tally,
    /// Of the lines of two axes.
    pub lines: &'a Lines,
}

/// Entries and decisions.
impl fmt::Display for LineCost {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{{\"entries\": {}, \"decisions\": {}}}", self.entries, self.decisions)
    }
}

impl fmt::Display for Workload<'_> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { trapezoid, trapezoid_one_axis, print, lines } = self;
        let tallies = [("trapezoid", trapezoid), ("trapezoid_one_axis", trapezoid_one_axis), ("print", print)];
        out.write_str("{")?;
        for (name, Tally { entries, events }) in tallies {
            write!(out, "\"{name}\": {{\"entries\": {entries}, \"events\": {events}}}, ")?;
        }
        for (kind, lines) in lines.wu_by_kind() {
            write!(out, "\"{kind}\": {{")?;
            for (index, line) in lines.iter().enumerate() {
                write!(out, "{}\"{}\": {{", separator(index), line.name)?;
                for (index, (name, cost)) in line.ways().into_iter().enumerate() {
                    write!(out, "{}\"{name}\": {cost}", separator(index))?;
                }
                out.write_str("}")?;
            }
            out.write_str("}, ")?;
        }
        out.write_str("\"bresenham_slopes\": [")?;
        for (index, line) in lines.slopes.iter().enumerate() {
            write!(out, "{}{{", separator(index))?;
            for (index, (name, cost)) in line.ways().into_iter().enumerate() {
                write!(out, "{}\"{name}\": {cost}", separator(index))?;
            }
            out.write_str("}")?;
        }
        out.write_str("]}")
    }
}
