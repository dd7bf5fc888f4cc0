//! Commands that change limits, in the words of the rules.

use ferrostep_gcode::{AxisWords, Command, Decimal};
use ferrostep_rules::{Change, Planner, VelocityLimit, Words};

/// Shows a planner a command. `unit_mm` is the unit of the command's lengths, mm.
///
/// A command that the firmware does not have or refuses changes nothing, as on that firmware.
pub(super) fn see(planner: &mut Planner, command: &Command<'_>, unit_mm: f64) {
    let list = |words: &[(char, Option<Decimal>)]| -> Vec<(char, f64)> {
        words.iter().filter_map(|(letter, value)| Some((*letter, (*value)?.to_f64() * unit_mm))).collect()
    };
    match command {
        Command::MaxAcceleration(words) => planner.change(&Change::M201(Words::new(&list(&axes(words))))),
        Command::MaxFeed(words) => planner.change(&Change::M203(Words::new(&list(&axes(words))))),
        Command::Acceleration { print, retract, travel, both } => {
            let words = list(&[('P', *print), ('R', *retract), ('T', *travel), ('S', *both)]);
            planner.change(&Change::M204(Words::new(&words)))
        }
        Command::Junction { deviation, corner_velocity } => {
            let [x, y, z, e] = axes(corner_velocity);
            planner.change(&Change::M205(Words::new(&list(&[('J', *deviation), x, y, z, e]))))
        }
        Command::VelocityLimit { velocity, acceleration, corner } => {
            planner.change(&Change::VelocityLimit(VelocityLimit {
                velocity: velocity.map(Decimal::to_f64),
                accel: acceleration.map(Decimal::to_f64),
                square_corner_velocity: corner.map(Decimal::to_f64),
                minimum_cruise_ratio: None,
            }))
        }
        _ => return,
    };
}

fn axes(words: &AxisWords) -> [(char, Option<Decimal>); 4] {
    [('X', words.x), ('Y', words.y), ('Z', words.z), ('E', words.e)]
}
