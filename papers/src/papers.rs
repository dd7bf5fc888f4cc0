//! The papers' methods as a type parameter of the planner.

use core::fmt::{self, Debug};
use core::marker::PhantomData;

use ferrostep_planner::backlash::{BacklashCorrection, BacklashStage};
use ferrostep_planner::surface::{Bed, BedStage};
use ferrostep_planner::{AccelerationProfile, ChoiceError, Interpolation, Kinematics, MotionChoice, MotionMethods};

use crate::five_segments::FiveSegments;
use crate::laws::{PaperPieces, PaperRule};
use crate::pattern::PaperPattern;
use crate::table::FrequencyTable;

/// All methods: the standard ones and the papers'. `B` and `L` have the same meaning as in
/// [`ferrostep_planner::Standard`].
pub struct Papers<B = BedStage, L = BacklashStage>(PhantomData<fn() -> (B, L)>);

// A derived implementation would require a bed that can be cloned.
impl<B, L> Clone for Papers<B, L> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<B, L> Copy for Papers<B, L> {}

impl<B, L> Debug for Papers<B, L> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("Papers")
    }
}

impl<B: Bed, L: BacklashCorrection> MotionMethods for Papers<B, L> {
    type Pieces = PaperPieces;
    type Rule = PaperRule;
    type Pattern = PaperPattern;
    type Bed = B;
    type Backlash = L;

    // Large: not inlined, it is on the stack only once.
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
