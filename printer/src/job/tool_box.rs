//! The values that belong to each tool.

use ferrostep_planner::{PressureAdvance, StepsPerMm};

use crate::settings::profile::Profile;
use crate::settings::profile::tools::MAX_TOOLS;
use crate::settings::profile::z_motors::Kept;

/// Values of a tool; its heater's are kept elsewhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct OfTool {
    /// Offset from T0's nozzle to this one, units of 10 nm.
    pub offset_10nm: [i64; 3],
    pub steps_per_mm: StepsPerMm,
    pub advance: PressureAdvance,
    pub flow_percent: u16,
    /// Drawn back by G10.
    pub retracted: bool,
    /// Drawn back when it was left.
    pub drawn_back: bool,
}

/// The selected tool, and the values of each. Those of the selected one for steps, advance, flow
/// and retraction are in the same places as on a machine with one tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ToolBox {
    pub selected: u8,
    pub tools: [OfTool; MAX_TOOLS],
}

impl OfTool {
    fn of_profile(profile: &Profile, tool: u8) -> Self {
        let further = profile.tools.and_then(|Kept(tools)| tools.get(tool));
        let [.., steps_per_mm] = profile.steps_per_mm;
        Self {
            offset_10nm: further.map_or([0; 3], |tool| tool.offset_10nm),
            steps_per_mm: further.map_or(steps_per_mm, |tool| tool.steps_per_mm),
            advance: further.map_or(profile.motion.pressure_advance, |tool| tool.advance),
            flow_percent: 100,
            retracted: false,
            drawn_back: false,
        }
    }
}

impl ToolBox {
    /// T0 is selected.
    pub fn new(profile: &Profile) -> Self {
        let tools = core::array::from_fn(|tool| OfTool::of_profile(profile, tool as u8));
        Self { selected: 0, tools }
    }

    /// A tool by its number.
    pub fn get(&self, tool: u8) -> Option<&OfTool> {
        self.tools.get(usize::from(tool))
    }

    /// Offset from T0's nozzle to that of a tool, units of 10 nm.
    pub fn offset_10nm(&self, tool: u8) -> [i64; 3] {
        self.get(tool).map_or([0; 3], |tool| tool.offset_10nm)
    }
}
