//! The papers' methods as the planner's type parameter.

use ferrostep_planner::surface::{BedStage, NoBed};
use ferrostep_planner::{AccelerationProfile, ChoiceError, Interpolation, Kinematics, MotionChoice, MotionMethods};

use crate::five_segments::FiveSegments;
use crate::laws::{PaperPieces, PaperRule};
use crate::pattern::PaperPattern;
use crate::table::FrequencyTable;

/// All methods: the standard ones and the papers'.
#[derive(Clone, Copy, Debug)]
pub enum Papers {}

impl MotionMethods for Papers {
    type Pieces = PaperPieces;
    type Rule = PaperRule;
    type Pattern = PaperPattern;
    type Bed = BedStage;

    // Large: inlined, it is once on the stack.
    #[inline(always)]
    fn pattern(choice: &MotionChoice, kinematics: Kinematics) -> Result<Option<PaperPattern>, ChoiceError> {
        let is_standard = choice.interpolation == Interpolation::StepBresenham;
        Ok((!is_standard).then(|| PaperPattern::new(choice, kinematics)))
    }

    fn rule(choice: &MotionChoice) -> Result<Option<PaperRule>, ChoiceError> {
        let rule = match choice.acceleration {
            AccelerationProfile::Trapezoid | AccelerationProfile::SCurve => return Ok(None),
            AccelerationProfile::SCurveTable => {
                let table = &choice.s_curve_table;
                let [start, top, jerk] = [table.start_hz, table.top_hz, table.jerk_hz_per_s2].map(f64::from);
                FrequencyTable::new(start, top, jerk).ok().map(PaperRule::Table)
            }
            AccelerationProfile::SCurveFiveSegments => {
                FiveSegments::new(choice.jerk_mm_per_s3).map(PaperRule::FiveSegments)
            }
        };
        rule.map(Some).ok_or(ChoiceError::Parameter)
    }
}

/// As [`Papers`], where Z follows no bed: without the memory for a mesh.
#[derive(Clone, Copy, Debug)]
pub enum PapersOffBed {}

impl MotionMethods for PapersOffBed {
    type Pieces = PaperPieces;
    type Rule = PaperRule;
    type Pattern = PaperPattern;
    type Bed = NoBed;

    #[inline(always)]
    fn pattern(choice: &MotionChoice, kinematics: Kinematics) -> Result<Option<PaperPattern>, ChoiceError> {
        Papers::pattern(choice, kinematics)
    }

    fn rule(choice: &MotionChoice) -> Result<Option<PaperRule>, ChoiceError> {
        Papers::rule(choice)
    }
}
