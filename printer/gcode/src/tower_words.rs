//! Words of TUNING_TOWER.

use crate::Decimal;

/// Relation between a tower's value and the height.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TowerCourse {
    /// FACTOR: evenly.
    Linear {
        /// Change of the value a millimetre.
        factor: Decimal,
    },
    /// FACTOR and BAND: as evenly, in bands, each with the value of its middle.
    Bands {
        /// Change of the value a millimetre.
        factor: Decimal,
        /// Height of a band, mm, above 0.
        band: Decimal,
    },
    /// STEP_DELTA and STEP_HEIGHT: in steps.
    Steps {
        /// Change of the value a step.
        delta: Decimal,
        /// Height of a step, mm, above 0.
        height: Decimal,
    },
}

/// Quantity that TUNING_TOWER changes with the height.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TowerWords<'a> {
    /// COMMAND: what is executed, with further words; for the machine to know.
    pub command: &'a str,
    /// PARAMETER: the command's word that gets the value.
    pub parameter: &'a str,
    /// START: the value at the bottom.
    pub start: Decimal,
    /// SKIP: the height of the bottom, mm, not negative.
    pub skip: Decimal,
    /// FACTOR and BAND, or STEP_DELTA and STEP_HEIGHT.
    pub course: TowerCourse,
}
