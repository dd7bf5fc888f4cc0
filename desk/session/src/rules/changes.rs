//! Commands that change limits, in the words of the rules.

use ferrostep_gcode::{AxisWords, Command, Decimal};
use ferrostep_rules::{Change, Effect, Planner, VelocityLimit, Words};

use super::scale::Scale;

/// Shows a planner a command. `unit_mm` is the unit of the command's lengths, mm.
///
/// A command that the firmware does not have or refuses changes nothing, as on that firmware.
/// Returns the name of a command of limits, and its effect.
pub(super) fn see(
    planner: &mut Planner,
    scale: &Scale,
    command: &Command<'_>,
    unit_mm: f64,
) -> Option<(&'static str, Effect)> {
    let list = |words: &[(char, Option<Decimal>)], factor: f64| -> Vec<(char, f64)> {
        words.iter().filter_map(|(letter, value)| Some((*letter, (*value)?.to_f64() * unit_mm * factor))).collect()
    };
    let number = |value: &Option<Decimal>, factor: f64| value.map(|value| value.to_f64() * factor);
    let (name, effect) = match command {
        Command::MaxAcceleration(words) => {
            ("M201", planner.change(&Change::M201(Words::new(&list(&axes(words), scale.acceleration)))))
        }
        Command::MaxFeed(words) => {
            ("M203", planner.change(&Change::M203(Words::new(&list(&axes(words), scale.largest_speed)))))
        }
        Command::Acceleration { print, retract, travel, both } => {
            let words = list(&[('P', *print), ('R', *retract), ('T', *travel), ('S', *both)], scale.acceleration);
            ("M204", planner.change(&Change::M204(Words::new(&words))))
        }
        Command::Junction { deviation, corner_velocity } => {
            let [x, y, z, e] = axes(corner_velocity);
            let mut words = list(&[x, y, z, e], scale.corner);
            words.extend(list(&[('J', *deviation)], scale.corner * scale.corner));
            ("M205", planner.change(&Change::M205(Words::new(&words))))
        }
        Command::VelocityLimit { velocity, acceleration, corner, cruise_ratio, to_deceleration } => {
            let limit = VelocityLimit {
                velocity: number(velocity, scale.largest_speed),
                accel: number(acceleration, scale.acceleration),
                square_corner_velocity: number(corner, scale.corner),
                minimum_cruise_ratio: number(cruise_ratio, 1.0).map(|ratio| scale.ratio(ratio)),
                accel_to_decel: number(to_deceleration, scale.acceleration * scale.short_move),
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
