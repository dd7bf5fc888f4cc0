//! A board in memory, in virtual time: motors that count, end stops, heaters with a thermal model, a fan.
//!
//! Time passes only when someone lets it pass: by playing step entries, or by waiting.

mod clock;
mod event_rate;
mod step_timer;
mod thermal_model;

pub use clock::{VirtualClock, VirtualDelay};
pub use event_rate::EventRate;
pub use step_timer::{StepObserver, StepTimer};
pub use thermal_model::ThermalModel;

use crate::{EndStops, Fan, Heater, MotorEnable, SensorError, ThermalBoard};
use ferrostep_planner::Geometry;

/// The sensor an axis homes with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VirtualEndStop {
    /// Machine coordinate at which it triggers, units of 10 nm.
    pub position_10nm: i64,
    /// Whether it triggers at and above that coordinate (else at and below).
    pub at_max: bool,
}

/// The board.
#[derive(Debug)]
pub struct VirtualBoard {
    /// Plays step entries and counts.
    pub steps: StepTimer,
    geometry: Geometry,
    end_stops: [VirtualEndStop; 3],
    /// Motor positions, in steps from the machine's true origin, when all counters were zero.
    true_offset: [i64; 3],
    heaters: [ThermalModel; 2],
    powers: [f32; 2],
    fan_power: u8,
    enabled: u8,
}

impl VirtualBoard {
    /// A cold board whose tool head truly stands at `true_position_10nm`, which the printer doesn't know.
    pub fn new(geometry: Geometry, end_stops: [VirtualEndStop; 3], true_position_10nm: [i64; 3]) -> Self {
        Self {
            steps: StepTimer::default(),
            geometry,
            end_stops,
            true_offset: geometry.motor_steps(true_position_10nm).map(i64::from),
            heaters: [ThermalModel::nozzle(), ThermalModel::bed()],
            powers: [0.0; 2],
            fan_power: 0,
            enabled: 0,
        }
    }

    /// Lets the heaters and what they heat run for a while.
    pub fn advance_heat(&mut self, seconds: f32) {
        for (model, power) in self.heaters.iter_mut().zip(self.powers) {
            model.advance(power, self.fan_power, seconds);
        }
    }

    /// The fan's power, 0 to 255.
    pub fn fan_power(&self) -> u8 {
        self.fan_power
    }

    /// Mask of the motors that are switched on.
    pub fn enabled_motors(&self) -> u8 {
        self.enabled
    }

    /// Says that the motors stand at these positions (homing); where they truly stand does not change.
    pub fn redefine_motor_steps(&mut self, motor_steps: [i64; 3]) {
        let [x, y, z, _] = self.steps.motor_steps();
        for (offset, (was, is)) in self.true_offset.iter_mut().zip([x, y, z].into_iter().zip(motor_steps)) {
            *offset += was - is;
        }
        self.steps.redefine_motor_steps(motor_steps);
    }

    /// Where the tool head truly is, units of 10 nm.
    pub fn true_position_10nm(&self) -> [i64; 3] {
        let mut motors = self.true_offset;
        for (motor, steps) in motors.iter_mut().zip(self.steps.motor_steps()) {
            *motor += steps;
        }
        self.geometry.position_10nm(motors)
    }
}

impl EndStops for VirtualBoard {
    fn is_triggered(&self, axis: usize) -> bool {
        let (Some(stop), Some(position)) = (self.end_stops.get(axis), self.true_position_10nm().get(axis).copied())
        else {
            return false;
        };
        if stop.at_max { position >= stop.position_10nm } else { position <= stop.position_10nm }
    }
}

impl ThermalBoard for VirtualBoard {
    fn celsius(&mut self, heater: Heater) -> Result<f32, SensorError> {
        Ok(self.heaters[heater.index()].celsius())
    }

    fn set_power(&mut self, heater: Heater, power: f32) {
        self.powers[heater.index()] = power.clamp(0.0, 1.0);
    }
}

impl Fan for VirtualBoard {
    fn set_fan_power(&mut self, power: u8) {
        self.fan_power = power;
    }
}

impl MotorEnable for VirtualBoard {
    fn set_motors_enabled(&mut self, axes: u8, enabled: bool) {
        self.enabled = if enabled { self.enabled | axes } else { self.enabled & !axes };
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use ferrostep_planner::{Kinematics, StepEntry, StepsPerMm};

    fn board(kinematics: Kinematics) -> VirtualBoard {
        let steps = |value| StepsPerMm::from_f64(value).unwrap();
        let geometry = Geometry {
            kinematics,
            steps_per_mm: [steps(80.0), steps(80.0), steps(400.0), steps(95.0)],
            minimum_event_interval_ticks: 168,
        };
        let stop = VirtualEndStop { position_10nm: 0, at_max: false };
        VirtualBoard::new(geometry, [stop; 3], [100_000, 200_000, 300_000])
    }

    #[test]
    fn an_end_stop_triggers_where_the_head_truly_is() {
        let mut board = board(Kinematics::CoreXy);
        assert!(!board.is_triggered(0));
        // 1 mm towards -X is 80 steps back of both motors.
        board.steps.play(StepEntry::directions(0b11), &mut ());
        board.steps.play(StepEntry::stair(1_000, 79, 0b11, 0).unwrap(), &mut ());
        assert!(!board.is_triggered(0));
        board.steps.play(StepEntry::stair(1_000, 1, 0b11, 0).unwrap(), &mut ());
        assert!(board.is_triggered(0) && !board.is_triggered(1));
        assert_eq!(board.true_position_10nm(), [0, 200_000, 300_000]);
    }

    #[test]
    fn redefining_positions_moves_nothing() {
        let mut board = board(Kinematics::Cartesian);
        board.steps.play(StepEntry::stair(1_000, 10, 0b1, 0).unwrap(), &mut ());
        let before = board.true_position_10nm();
        board.redefine_motor_steps([5, 6, 7]);
        assert_eq!(board.true_position_10nm(), before);
        assert_eq!(board.steps.motor_steps(), [5, 6, 7, 0]);
        assert_eq!(board.steps.issued(), [10, 0, 0, 0]);
    }
}
