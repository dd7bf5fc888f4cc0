//! The play of the drives.

use ferrostep_checked_toml::{Range, Section, range};
use ferrostep_planner::Kinematics;
use ferrostep_planner::backlash::Backlash;

use crate::axes::AXES;

const PLAY: Range = range(0.0, Backlash::MAX_MM, "mm");
const PART: Range = range(0.0, 1.0, "");
const WAY: Range = range(0.0, Backlash::MAX_SMOOTHING_MM, "mm");

/// The play of the drives; `None` without the table: none is taken up, and M425 has no effect.
pub(crate) fn backlash(keys: &Section<'_>, kinematics: Kinematics) -> Option<Backlash> {
    let table = keys.optional_section(
        "backlash",
        "not compensated",
        "[backlash](backlash.md) of X, Y and Z, compensated where a motor reverses (M425)",
    )?;
    let play_mm = table
        .numbers("play_mm", AXES, [PLAY; 3])
        .or([0.0; 3], "backlash: motor travel after a reversal before the axis follows; 0 on axes that share motors");
    let correction = table.number("correction", PART).or(1.0, "share of the backlash to compensate (M425 F)");
    let smoothing_mm = table
        .number("smoothing_mm", WAY)
        .or(Backlash::SMOOTHING_MM, "distance over which the correction is spread, X, Y and Z added (M425 S)");
    let backlash = Backlash { play_mm, correction, smoothing_mm };
    if let Some(axis) = backlash.shared_axis(kinematics) {
        let name = AXES[axis];
        let expected = format!(
            "0: on {} its motors also move another axis, and turn where {name} does not; tighten the belts",
            kinematics.name()
        );
        table.refuse(&format!("play_mm.{name}"), expected);
    }
    Some(backlash)
}
