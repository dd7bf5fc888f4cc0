//! The numbers as JSON.

use core::fmt;

use crate::figures::{Mean, StepEvents};
use crate::prepared::Prepared;
use crate::queue::Tally;
use crate::shaped::Shaped;

/// Cost of a line, from its end point to entries in the step queue. One build of this program
/// counts the instructions, the other the rest.
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
    /// Name in the report.
    pub name: &'static str,
    /// Classic Bresenham, an entry a step.
    pub classic: LineCost,
    /// Classic Bresenham, runs of equal steps in one entry.
    pub classic_coalesced: LineCost,
    /// Step Bresenham, an entry a stair: a division a stair, as the interpolator does it.
    pub step: LineCost,
    /// The same without a division.
    pub step_first_stair: LineCost,
    /// The same with one division a line.
    pub step_quotient: LineCost,
}

impl WuLine {
    /// The ways and their names.
    fn ways(&self) -> [(&'static str, LineCost); 5] {
        let Self { classic, classic_coalesced, step, step_first_stair, step_quotient, .. } = *self;
        [
            ("classic", classic),
            ("classic_coalesced", classic_coalesced),
            ("step", step),
            ("step_first_stair", step_first_stair),
            ("step_quotient", step_quotient),
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
    /// Classic Bresenham: see [`WuLine::classic`].
    pub classic: LineCost,
    /// Classic Bresenham with joined steps: see [`WuLine::classic_coalesced`].
    pub classic_coalesced: LineCost,
    /// Step Bresenham: see [`WuLine::step`].
    pub step: LineCost,
}

impl SlopeLine {
    /// The ways and their names.
    fn ways(&self) -> [(&'static str, LineCost); 3] {
        let Self { classic, classic_coalesced, step, .. } = *self;
        [("classic", classic), ("classic_coalesced", classic_coalesced), ("step", step)]
    }
}

/// All lines, ways and figures: memory for which the stack has no room.
#[derive(Debug)]
pub struct Lines {
    /// Wu's, for drivers that step at both edges.
    pub wu: heapless::Vec<WuLine, 5>,
    /// The same with pulses.
    pub wu_pulses: heapless::Vec<WuLine, 5>,
    /// Lines of every slope, for drivers that step at both edges.
    pub slopes: heapless::Vec<SlopeLine, 23>,
}

impl Lines {
    /// Lists without lines.
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

/// All figures.
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
    /// Motion through filters.
    pub shaped: Shaped,
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
        write!(out, ", \"shaped\": {}", self.shaped)?;
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

/// Text before an element of a list.
fn separator(index: usize) -> &'static str {
    if index == 0 { "" } else { ", " }
}

/// Amount of work to queue, from the build that counts it.
#[derive(Clone, Debug)]
pub struct Workload<'a> {
    /// The first trapezoid's.
    pub trapezoid: Tally,
    /// The other trapezoid's.
    pub trapezoid_one_axis: Tally,
    /// The whole print's.
    pub print: Tally,
    /// Costs of the lines of two axes.
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
