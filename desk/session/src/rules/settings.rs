//! The limits that a profile gives another firmware.

use ferrostep_planner::Kinematics;
use ferrostep_printer::{Profile, SQUARE_CORNER_SHARE};
use ferrostep_profiles::{PlannedBy, RuleKeys};
use ferrostep_rules::klipper::{FlushTimes, Klipper, KlipperSettings};
use ferrostep_rules::marlin::{Corner, JerkRule, Marlin, MarlinSettings};
use ferrostep_rules::rrf::{JerkPolicy, Rrf, RrfSettings};
use ferrostep_rules::{Planner, Rules, SettingError};

use super::scale::Scale;

/// Change of an axis's speed at a corner where the profile has no limit of it, mm/s: Marlin's
/// example configuration.
const JERK_MM_PER_S: f64 = 10.0;

/// A planner by another firmware's rules, with the limits of a machine.
#[derive(Clone, Debug)]
pub struct ByRules {
    /// The rules.
    pub rules: Rules,
    /// The planner.
    pub planner: Planner,
    /// Length of the chords of arcs, mm.
    pub arc_chord_mm: f64,
    /// Factors of the limits, those that commands set included.
    pub scale: Scale,
}

impl ByRules {
    /// Returns true if the firmware smooths its pressure advance.
    pub fn smooths_advance(&self) -> bool {
        self.rules == Rules::Klipper
    }

    /// The same with other limits of Klipper's corners, where one is given: its square corner
    /// velocity, mm/s, its minimum cruise ratio, and the filament's instantaneous corner velocity,
    /// mm/s. Other rules have none of them.
    ///
    /// # Errors
    /// Names the limit with which Klipper makes no plan.
    pub fn with_klippers_corners(
        mut self,
        square_corner_velocity_mm_per_s: Option<f64>,
        minimum_cruise_ratio: Option<f64>,
        instantaneous_corner_velocity_mm_per_s: Option<f64>,
    ) -> Result<Self, SettingError> {
        if let Planner::Klipper(planner) = &mut self.planner {
            let mut settings = *planner.settings();
            for (limit, given) in [
                (&mut settings.square_corner_velocity_mm_per_s, square_corner_velocity_mm_per_s),
                (&mut settings.minimum_cruise_ratio, minimum_cruise_ratio),
                (&mut settings.instantaneous_corner_velocity_mm_per_s, instantaneous_corner_velocity_mm_per_s),
            ] {
                *limit = given.unwrap_or(*limit);
            }
            planner.set(settings)?;
        }
        Ok(self)
    }
}

/// The planner that a profile asks for, or that is `asked` for instead; `None` for the rules
/// of this firmware.
///
/// # Errors
/// Names the limit with which those rules make no plan.
pub(super) fn of_profile(
    profile: &Profile,
    keys: &RuleKeys,
    asked: Option<PlannedBy>,
    scale: Scale,
) -> Result<Option<ByRules>, SettingError> {
    let (profile, keys) = &scale.apply(profile, keys);
    let jerk = jerk(profile, keys);
    let (rules, planner) = match asked.unwrap_or(keys.planned_by) {
        PlannedBy::Own => return Ok(None),
        PlannedBy::Klipper => (Rules::Klipper, Planner::Klipper(Klipper::new(klipper(profile, keys))?)),
        PlannedBy::MarlinJunctionDeviation => {
            let deviation_mm = profile.limits.junction_deviation_mm;
            let corner = Corner::JunctionDeviation { deviation_mm, handles_small_segments: true };
            (Rules::MarlinJunctionDeviation, Planner::Marlin(Marlin::new(marlin(profile, keys, corner))?))
        }
        PlannedBy::MarlinClassicJerk => {
            let corner = Corner::ClassicJerk { jerk_mm_per_s: jerk, rule: JerkRule::SafeSpeed };
            (Rules::MarlinClassicJerk, Planner::Marlin(Marlin::new(marlin(profile, keys, corner))?))
        }
        PlannedBy::Rrf => (Rules::Rrf, Planner::Rrf(Rrf::new(rrf(profile, keys, jerk))?)),
    };
    Ok(Some(ByRules { rules, planner, arc_chord_mm: keys.arc_chord_mm, scale }))
}

/// The jerk of each axis, mm/s.
fn jerk(profile: &Profile, keys: &RuleKeys) -> [f64; 4] {
    let of_corners = profile.limits.instantaneous_corner_velocity_mm_per_s;
    keys.jerk_mm_per_s.unwrap_or(of_corners.map(|jerk| if jerk.is_finite() { jerk } else { JERK_MM_PER_S }))
}

/// The speed of a square corner, mm/s: the profile's, else that of its deviation.
pub(super) fn square_corner_velocity(profile: &Profile, keys: &RuleKeys) -> f64 {
    let limits = &profile.limits;
    let made = limits.junction_deviation_mm * limits.print_acceleration_mm_per_s2 / SQUARE_CORNER_SHARE;
    keys.square_corner_velocity_mm_per_s.unwrap_or(made.sqrt())
}

/// Klipper has one limit for X and Y: the smaller one.
fn klipper(profile: &Profile, keys: &RuleKeys) -> KlipperSettings {
    let limits = &profile.limits;
    let [x_feed, y_feed, z_feed, e_feed] = limits.max_feed_mm_per_s;
    let [x, y, z, e] = limits.max_acceleration_mm_per_s2;
    let [.., filament_corner] = limits.instantaneous_corner_velocity_mm_per_s;
    KlipperSettings {
        max_velocity_mm_per_s: x_feed.min(y_feed),
        max_accel_mm_per_s2: limits.print_acceleration_mm_per_s2.min(x).min(y),
        max_z_velocity_mm_per_s: z_feed,
        max_z_accel_mm_per_s2: z,
        square_corner_velocity_mm_per_s: square_corner_velocity(profile, keys),
        minimum_cruise_ratio: keys.minimum_cruise_ratio,
        max_extrude_only_velocity_mm_per_s: e_feed,
        max_extrude_only_accel_mm_per_s2: limits.retract_acceleration_mm_per_s2.min(e),
        instantaneous_corner_velocity_mm_per_s: filament_corner,
        flush_times: FlushTimes::KLIPPER_0_13,
    }
}

fn marlin(profile: &Profile, keys: &RuleKeys, corner: Corner) -> MarlinSettings {
    let limits = &profile.limits;
    let example = MarlinSettings::example(corner);
    MarlinSettings {
        max_feed_mm_per_s: limits.max_feed_mm_per_s,
        max_acceleration_mm_per_s2: limits.max_acceleration_mm_per_s2,
        acceleration_mm_per_s2: limits.print_acceleration_mm_per_s2,
        travel_acceleration_mm_per_s2: limits.travel_acceleration_mm_per_s2,
        retract_acceleration_mm_per_s2: limits.retract_acceleration_mm_per_s2,
        steps_per_mm: Some(profile.steps_per_mm.map(ferrostep_planner::StepsPerMm::to_f64)),
        block_buffer_size: keys.queued_moves.unwrap_or(example.block_buffer_size),
        is_core_xy: profile.kinematics == Kinematics::CoreXy,
        ..example
    }
}

fn rrf(profile: &Profile, keys: &RuleKeys, jerk_mm_per_s: [f64; 4]) -> RrfSettings {
    let limits = &profile.limits;
    let defaults = RrfSettings::defaults();
    RrfSettings {
        max_feed_mm_per_s: limits.max_feed_mm_per_s,
        max_acceleration_mm_per_s2: limits.max_acceleration_mm_per_s2,
        jerk_mm_per_s,
        print_acceleration_mm_per_s2: limits.print_acceleration_mm_per_s2,
        travel_acceleration_mm_per_s2: limits.travel_acceleration_mm_per_s2,
        jerk_policy: if keys.joins_all_kinds { JerkPolicy::Always } else { JerkPolicy::SameKind },
        pressure_advance_s: profile.motion.pressure_advance.seconds,
        ring_length: keys.queued_moves.unwrap_or(defaults.ring_length),
        is_core_xy: profile.kinematics == Kinematics::CoreXy,
        ..defaults
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// The two lists of names, of profiles and of the rules themselves, agree.
    #[test]
    fn every_name_leads_to_the_rules_of_that_name() {
        let text = ferrostep_profiles::builtin_text("corexy").unwrap();
        let (profile, keys) = ferrostep_profiles::parse_with_rules(text, "corexy").unwrap();
        assert!(of_profile(&profile, &keys, None, Scale::NONE).unwrap().is_none());
        for (name, asked) in PlannedBy::NAMED {
            let found = of_profile(&profile, &keys, Some(asked), Scale::NONE).unwrap();
            assert_eq!(found.map_or("own", |found| found.rules.name()), name);
        }
    }

    #[test]
    fn klippers_limits_are_those_of_the_profile() {
        let base = ferrostep_profiles::builtin_text("cartesian").unwrap();
        let text = format!("{base}\n[rules]\nplanned_by = \"klipper\"\nminimum_cruise_ratio = 0.25\n");
        let (profile, keys) = ferrostep_profiles::parse_with_rules(&text, "test").unwrap();
        let Some(ByRules { planner: Planner::Klipper(planner), .. }) =
            of_profile(&profile, &keys, None, Scale::NONE).unwrap()
        else {
            panic!("expected Klipper's planner");
        };
        let settings = planner.settings();
        assert_eq!(settings.max_velocity_mm_per_s, 200.0);
        assert_eq!(settings.max_accel_mm_per_s2, 1000.0);
        assert_eq!(settings.minimum_cruise_ratio, 0.25);
        assert_eq!(settings.max_extrude_only_accel_mm_per_s2, 1500.0);
        // A deviation of 0.1 mm at 1000 mm/s^2.
        assert!((settings.square_corner_velocity_mm_per_s - (100.0f64 / (2f64.sqrt() - 1.0)).sqrt()).abs() < 1e-9);
    }
}
