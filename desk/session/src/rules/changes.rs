//! Commands that change limits, in the words of the rules.

use ferrostep_gcode::{AxisWords, Command, Decimal};
use ferrostep_rules::{Change, Effect, Planner, VelocityLimit, Words};

/// Shows a planner a command. `unit_mm` is the unit of the command's lengths, mm.
///
/// A command that the firmware does not have or refuses changes nothing, as on that firmware. Returns the name of a command of
/// limits, and its effect.
pub(super) fn see(planner: &mut Planner, command: &Command<'_>, unit_mm: f64) -> Option<(&'static str, Effect)> {
    let list = |words: &[(char, Option<Decimal>)]| -> Vec<(char, f64)> {
        words.iter().filter_map(|(letter, value)| Some((*letter, (*value)?.to_f64() * unit_mm))).collect()
    };
    let (name, effect) = match command {
        Command::MaxAcceleration(words) => ("M201", planner.change(&Change::M201(Words::new(&list(&axes(words)))))),
        Command::MaxFeed(words) => ("M203", planner.change(&Change::M203(Words::new(&list(&axes(words)))))),
        Command::Acceleration { print, retract, travel, both } => {
            let words = list(&[('P', *print), ('R', *retract), ('T', *travel), ('S', *both)]);
            ("M204", planner.change(&Change::M204(Words::new(&words))))
        }
        Command::Junction { deviation, corner_velocity } => {
            let [x, y, z, e] = axes(corner_velocity);
            let words = list(&[('J', *deviation), x, y, z, e]);
            ("M205", planner.change(&Change::M205(Words::new(&words))))
        }
        Command::VelocityLimit { velocity, acceleration, corner, cruise_ratio, to_deceleration } => {
            let limit = VelocityLimit {
                velocity: velocity.map(Decimal::to_f64),
                accel: acceleration.map(Decimal::to_f64),
                square_corner_velocity: corner.map(Decimal::to_f64),
                minimum_cruise_ratio: cruise_ratio.map(Decimal::to_f64),
                accel_to_decel: to_deceleration.map(Decimal::to_f64),
            };
            ("SET_VELOCITY_LIMIT", planner.change(&Change::VelocityLimit(limit)))
        }
        _ => return None,
    };
    Some((name, effect))
}

fn axes(words: &AxisWords) -> [(char, Option<Decimal>); 4] {
    [('X', words.x), ('Y', words.y), ('Z', words.z), ('E', words.e)]
}
