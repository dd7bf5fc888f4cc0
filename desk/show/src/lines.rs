//! State of the file at a line when its motion is executed, which is later than when
//! the line is read.

use std::collections::VecDeque;

/// Maximum number of changes that wait for their motion: a file of nothing but changes must not
/// fill the memory.
const MAX_WAITING: usize = 1 << 20;

/// The state of the file at a line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LineState {
    /// Layer, from 0; `None` where the file marks none.
    pub layer: Option<u32>,
    /// Number of the feature in the list of their names.
    pub feature: u8,
    /// The speed that the line asks for, mm/s.
    pub feed_mm_per_s: f32,
    /// True if the line homes or probes.
    pub homes: bool,
    /// The selected tool.
    pub tool: u8,
    /// Offset from the carriage's place to the tool's nozzle, mm.
    pub nozzle_mm: [f64; 3],
    /// Height and width of the bead by the slicer's comments, mm; 0 where they are unknown.
    pub height_mm: f32,
    /// See `height_mm`.
    pub width_mm: f32,
}

/// States by the line from which on they hold.
#[derive(Debug, Default)]
pub(crate) struct LineStates {
    waiting: VecDeque<(u32, LineState)>,
    /// The last one that was noted.
    noted: Option<LineState>,
    current: LineState,
}

impl LineStates {
    /// Notes the state from this line on.
    pub fn note(&mut self, line: u32, state: LineState) {
        if self.noted.replace(state) == Some(state) {
            return;
        }
        if self.waiting.len() == MAX_WAITING {
            self.waiting.pop_front();
        }
        self.waiting.push_back((line, state));
    }

    /// The state at a line; lines must not go back.
    pub fn at(&mut self, line: u32) -> LineState {
        while let Some((_, state)) = self.waiting.pop_front_if(|(from, _)| *from <= line) {
            self.current = state;
        }
        self.current
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_state_holds_from_its_line_on() {
        let mut states = LineStates::default();
        let layer = |layer| LineState { layer: Some(layer), ..LineState::default() };
        states.note(3, layer(1));
        states.note(5, layer(1));
        states.note(7, layer(2));
        assert_eq!([2, 3, 6, 7, 100].map(|line| states.at(line).layer), [None, Some(1), Some(1), Some(2), Some(2)]);
        for line in 0..2 * MAX_WAITING as u32 {
            states.note(1000 + line, layer(line + 10));
        }
        assert_eq!(states.waiting.len(), MAX_WAITING);
    }
}
