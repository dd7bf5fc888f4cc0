//! What the planner asks for.

use ferrostep_planner::{AccelerationProfile, ChoiceError, Interpolation, Kinematics, MotionChoice, MotionMethods};

use crate::pattern::PaperPattern;
use crate::staircase::StaircasePieces;
use crate::table::FrequencyTable;

/// All methods: the standard ones and the papers'.
#[derive(Clone, Copy, Debug)]
pub enum Papers {}

impl MotionMethods for Papers {
    type Pieces = StaircasePieces;
    type Rule = FrequencyTable;
    type Pattern = PaperPattern;

    fn pattern(choice: &MotionChoice, kinematics: Kinematics) -> Result<Option<PaperPattern>, ChoiceError> {
        let is_standard = choice.interpolation == Interpolation::StepBresenham;
        Ok((!is_standard).then(|| PaperPattern::new(choice, kinematics)))
    }

    fn rule(choice: &MotionChoice) -> Result<Option<FrequencyTable>, ChoiceError> {
        if choice.acceleration != AccelerationProfile::SCurveTable {
            return Ok(None);
        }
        let table = &choice.s_curve_table;
        let [start_hz, top_hz, jerk_hz_per_s2] = [table.start_hz, table.top_hz, table.jerk_hz_per_s2].map(f64::from);
        FrequencyTable::new(start_hz, top_hz, jerk_hz_per_s2).map(Some).map_err(|_| ChoiceError::Parameter)
    }
}
