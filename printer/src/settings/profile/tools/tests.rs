//! A second tool for other modules' tests.

use std::boxed::Box;

use ferrostep_planner::{PressureAdvance, StepsPerMm};

use super::{FurtherTool, ToolChange, Tools};
use crate::settings::profile::z_motors::Kept;

/// Units of 10 nm in a millimetre.
const MM: i64 = 100_000;

/// A motor beside T0's, which pushes into the same nozzle.
pub(crate) fn second() -> FurtherTool {
    FurtherTool {
        socket: "e1",
        is_inverted: false,
        offset_10nm: [20 * MM, 0, 0],
        steps_per_mm: StepsPerMm::nearest(95.0),
        advance: PressureAdvance::NONE,
        driver: None,
        heater: None,
        fan: None,
    }
}

/// Two tools, and a change that moves no filament.
pub(crate) fn two(second: FurtherTool) -> Option<Kept<Tools>> {
    let change = ToolChange {
        lift_10nm: 0,
        travel_10nm_per_s: 100 * MM,
        retract_10nm: 0,
        retract_10nm_per_s: MM,
        prime_10nm: 0,
        prime_10nm_per_s: MM,
        before: None,
        after: None,
    };
    Some(Kept(Box::leak(Box::new(Tools { further: [Some(second)], change }))))
}
