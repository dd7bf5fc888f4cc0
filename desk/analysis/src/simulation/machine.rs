//! A profile as the oracle and the simulator see it.

use ferrostep_oracle::reference::{Acceleration, Decimal, FirmwareRetraction, Kinematics, ReferenceProfile};
use ferrostep_oracle::trace::TraceHeader;
use ferrostep_planner::TICKS_PER_SECOND;
use ferrostep_planner::kinematics::UNITS_PER_MM;
use ferrostep_printer::Profile;

/// Cross-section of a machine's filament.
pub fn filament_mm2(profile: &Profile) -> f64 {
    let diameter_mm = profile.extrusion.filament_diameter_10nm as f64 / UNITS_PER_MM as f64;
    diameter_mm * diameter_mm * std::f64::consts::FRAC_PI_4
}

/// Units of 10 nm to mm.
fn mm(units: i64) -> f64 {
    units as f64 / UNITS_PER_MM as f64
}

/// The oracle's names of a kinematics are the firmware's.
fn kinematics(profile: &Profile) -> Kinematics {
    Kinematics::from_name(profile.kinematics.name()).unwrap_or(Kinematics::Cartesian)
}

/// The machine for the oracle's interpreter and planner.
pub fn reference_profile(profile: &Profile) -> ReferenceProfile {
    let limits = &profile.limits;
    let retraction = &profile.retraction;
    let safe = &profile.safe_homing;
    let [x, y, z] = profile.homing.map(|axis| axis.position_10nm);
    ReferenceProfile {
        kinematics: kinematics(profile),
        steps_per_mm: profile
            .steps_per_mm
            .map(|steps| Decimal::from_f64(steps.to_f64()).unwrap_or(Decimal::from_integer(1))),
        max_feed_mm_per_s: limits.max_feed_mm_per_s,
        max_acceleration_mm_per_s2: limits.max_acceleration_mm_per_s2,
        acceleration_mm_per_s2: Acceleration {
            print: limits.print_acceleration_mm_per_s2,
            travel: limits.travel_acceleration_mm_per_s2,
            retract: limits.retract_acceleration_mm_per_s2,
        },
        junction_deviation_mm: limits.junction_deviation_mm,
        corner_velocity_mm_per_s: limits.instantaneous_corner_velocity_mm_per_s,
        size_mm: profile.size_10nm.map(mm),
        lower_end_mm: profile.lower_end_10nm.map(mm),
        home_mm: [mm(x), mm(y), mm(z) - mm(safe.probe_offset_10nm[2])],
        home_at_mm: safe.home_at_10nm.map(|place| place.map(mm)),
        raise_mm: mm(safe.raise_10nm),
        firmware_retraction: FirmwareRetraction {
            length_mm: mm(retraction.length_10nm),
            retract_mm_per_s: mm(retraction.retract_10nm_per_s),
            extra_recover_mm: mm(retraction.extra_recover_10nm),
            recover_mm_per_s: mm(retraction.recover_10nm_per_s),
            lift_mm: mm(retraction.lift_10nm),
        },
        minimum_event_interval_us: f64::from(profile.minimum_event_interval_ticks) * 1e6 / f64::from(TICKS_PER_SECOND),
    }
}

/// The header that a trace of this machine has.
pub(super) fn trace_header(profile: &Profile) -> TraceHeader {
    let kinematics = kinematics(profile);
    let (_, names) = kinematics.names();
    TraceHeader {
        tick_hz: u64::from(TICKS_PER_SECOND),
        axes: names.map(String::from).to_vec(),
        steps_per_mm: profile.steps_per_mm.map(|steps| steps.to_f64()).to_vec(),
        kinematics,
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn the_oracle_sees_what_it_reads_from_the_profile_itself() {
        for name in ferrostep_profiles::builtin_names() {
            let profile = ferrostep_profiles::load(name).unwrap();
            let read = ReferenceProfile::from_toml(ferrostep_profiles::builtin_text(name).unwrap()).unwrap();
            assert_eq!(reference_profile(&profile), read, "{name}");
        }
    }
}
