//! Which machine a job was prepared for, as a number.

use ferrostep_planner::{Kinematics, Limits};

use crate::profile::Profile;

/// FNV-1a, 64 bits.
struct Hash(u64);

impl Hash {
    fn number(&mut self, value: u64) {
        for byte in value.to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }
}

impl Profile {
    /// A hash of all that a plan depends on, and of what it must not exceed: kinematics, size, steps, limits, methods, the
    /// processor's budget, where the machine homes to and the heaters' ends. Two machines with the same hash may execute
    /// each other's prepared jobs.
    pub fn hash(&self) -> u64 {
        let mut hash = Hash(0xcbf2_9ce4_8422_2325);
        hash.number(u64::from(self.kinematics == Kinematics::CoreXy));
        self.size_10nm.iter().for_each(|size| hash.number(size.cast_unsigned()));
        self.steps_per_mm.iter().for_each(|steps| hash.number(steps.hundred_thousandths().cast_unsigned()));
        let Limits {
            max_feed_mm_per_s,
            max_acceleration_mm_per_s2,
            print_acceleration_mm_per_s2,
            travel_acceleration_mm_per_s2,
            retract_acceleration_mm_per_s2,
            junction_deviation_mm,
            instantaneous_corner_velocity_mm_per_s,
        } = self.limits;
        let rest = [
            print_acceleration_mm_per_s2,
            travel_acceleration_mm_per_s2,
            retract_acceleration_mm_per_s2,
            junction_deviation_mm,
        ];
        let corners = &instantaneous_corner_velocity_mm_per_s;
        for limit in max_feed_mm_per_s.iter().chain(&max_acceleration_mm_per_s2).chain(&rest).chain(corners) {
            hash.number(limit.to_bits());
        }
        hash.number(self.motion.interpolation as u64);
        hash.number(self.motion.acceleration as u64);
        hash.number(u64::from(self.motion.dual_rate.shortest_ns) << 32 | u64::from(self.motion.dual_rate.longest_ns));
        for ticks in [self.minimum_event_interval_ticks, self.event_cost_ticks, self.move_cost_ticks] {
            hash.number(ticks.into());
        }
        self.homing.iter().for_each(|homing| hash.number(homing.position_10nm.cast_unsigned()));
        // Without these the hash is that of before they were there. Where a probe triggers is measured on each machine.
        let safe = &self.safe_homing;
        let places = safe.home_at_10nm.unwrap_or_default();
        for length in
            self.lower_end_10nm.into_iter().chain(places).chain([safe.raise_10nm]).filter(|length| *length != 0)
        {
            hash.number(length.cast_unsigned());
        }
        for heater in [&self.nozzle, &self.bed] {
            hash.number(u64::from(heater.max_celsius.to_bits()));
        }
        hash.number(u64::from(self.min_extrusion_celsius.to_bits()));
        hash.0
    }
}
