//! The extruders of a desk machine with several tools: which one makes the steps of E, and how
//! many each has made.

use ferrostep_printer::MAX_TOOLS;

/// The steps of each tool's extruder. E's are the sum.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct DeskExtruders {
    selected: usize,
    /// E's steps when that was selected.
    counted: i64,
    steps: [i64; MAX_TOOLS],
}

impl DeskExtruders {
    /// The extruder of this tool makes the steps to come, from these steps of E on.
    pub fn select(&mut self, tool: u8, extruder_steps: i64) {
        self.steps = self.steps(extruder_steps);
        (self.selected, self.counted) = (usize::from(tool), extruder_steps);
    }

    /// The steps of each, when E has made these.
    pub fn steps(&self, extruder_steps: i64) -> [i64; MAX_TOOLS] {
        let mut steps = self.steps;
        if let Some(selected) = steps.get_mut(self.selected) {
            *selected += extruder_steps - self.counted;
        }
        steps
    }
}
