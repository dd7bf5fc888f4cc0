//! The motors of the virtual board and the end stops they drive into.

use ferrostep_planner::kinematics::UNITS_PER_MM;
use ferrostep_planner::{Geometry, StepEntry, StepLedger, StepObserver};

use super::{EndStopFailure, StallSignal, VirtualProbe};
use crate::pin::VirtualPin;
use ferrostep_hal_shim::Approach;

/// True position of the tool head when a virtual machine is switched on, units of 10 nm
/// from its origin.
pub const START_10NM: [i64; 3] = [6_000_000, 5_000_000, 1_200_000];

/// The sensor an axis homes with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VirtualEndStop {
    /// Machine coordinate at which it triggers, or of the frame's end, units of 10 nm.
    pub position_10nm: i64,
    /// True if it triggers at and above that coordinate, false for at and below.
    pub at_max: bool,
}

/// Motors that count their steps since they were switched on, and the sensors that the
/// tool head meets.
#[derive(Debug)]
pub struct VirtualMotors {
    /// The steps that the motors have made.
    pub ledger: StepLedger,
    geometry: Geometry,
    end_stops: [VirtualEndStop; 3],
    failures: [Option<EndStopFailure>; 3],
    /// Distance that motors have pushed against the frame, past an end stop that did not trigger.
    pushed_10nm: [i64; 3],
    /// Motor positions, in steps from the machine's true origin, when the ledger's were zero.
    start_steps: [i64; 3],
    /// Axes without a switch: the frame ends where it would be.
    framed: u8,
    /// Z's end stop is this probe, which triggers at its coordinate where it is above the sheet.
    probe: Option<VirtualProbe>,
    /// The probe triggers by this pin, where it would without.
    pin: Option<VirtualPin>,
    /// Height above the sheet at which the probe's present approach ends, and the state of
    /// its random numbers.
    scattered_10nm: i64,
    random: u64,
    /// Stall signal of the driver of the axis that homes by a stall; `None` if it never comes.
    stall_signal: Option<StallSignal>,
    /// Tick of that motor's last step.
    last_step_tick: u64,
}

impl VirtualMotors {
    /// Motors whose tool head truly is at `true_position_10nm`, which the
    /// printer does not know.
    pub fn new(geometry: Geometry, end_stops: [VirtualEndStop; 3], true_position_10nm: [i64; 3]) -> Self {
        Self {
            ledger: StepLedger::default(),
            geometry,
            end_stops,
            failures: [None; 3],
            pushed_10nm: [0; 3],
            start_steps: geometry.motor_steps(true_position_10nm).map(i64::from),
            framed: 0,
            probe: None,
            pin: None,
            scattered_10nm: 0,
            random: 0x9e37_79b9_7f4a_7c15,
            stall_signal: None,
            last_step_tick: 0,
        }
    }

    /// Axes in the mask have no switch, but a frame that holds them where it would be.
    pub fn set_framed(&mut self, axes: u8) {
        self.framed = axes;
    }

    /// Z has this probe.
    pub fn set_probe(&mut self, probe: VirtualProbe) {
        self.probe = Some(probe);
    }

    /// Z's probe has a pin, which is in.
    pub fn set_pin(&mut self) {
        self.pin = Some(VirtualPin::default());
    }

    /// Pulses of this width for the servo of that pin, microseconds.
    pub fn tell_pin(&mut self, width_us: u16) {
        if let Some(pin) = &mut self.pin {
            let [.., failure] = self.failures;
            pin.tell(width_us, failure);
        }
    }

    /// Makes the sensor that homes X (0), Y (1) or Z (2) fail, or mends it.
    pub fn set_end_stop_failure(&mut self, axis: usize, failure: Option<EndStopFailure>) {
        if let Some(of_axis) = self.failures.get_mut(axis) {
            *of_axis = failure;
        }
    }

    /// Reading of a failed sensor that does not depend on the position; `None` if it reads
    /// as a working one.
    fn said_by_failure(&self, axis: usize) -> Option<bool> {
        match self.failures.get(axis).copied().flatten()? {
            EndStopFailure::NeverTriggers => Some(false),
            EndStopFailure::AlwaysTriggered => Some(true),
            EndStopFailure::PinStaysIn | EndStopFailure::PinStaysOut => None,
        }
    }

    /// The stall signal of the axis that homes next, if it is framed.
    pub fn set_stall_signal(&mut self, signal: Option<StallSignal>) {
        self.stall_signal = signal;
    }

    /// True if an axis has no switch.
    pub fn is_framed(&self, axis: usize) -> bool {
        self.framed >> axis & 1 == 1
    }

    /// True position of the tool head, units of 10 nm.
    pub fn true_position_10nm(&self) -> [i64; 3] {
        let mut position = self.driven_to_10nm();
        for (axis, (position, stop)) in position.iter_mut().zip(&self.end_stops).enumerate() {
            if self.is_framed(axis) {
                let end = stop.position_10nm;
                *position = if stop.at_max { (*position).min(end) } else { (*position).max(end) };
            }
        }
        position
    }

    /// Position at which an axis's sensor triggers, units of 10 nm.
    fn trigger_10nm(&self, axis: usize, position_10nm: [i64; 3]) -> Option<i64> {
        let stop_10nm = self.end_stops.get(axis)?.position_10nm;
        match &self.probe {
            Some(probe) if axis == 2 => Some(stop_10nm + probe.sheet_height_10nm(position_10nm) + self.scattered_10nm),
            _ => Some(stop_10nm),
        }
    }

    /// The next approach of the probe ends elsewhere (xorshift, Marsaglia 2003).
    fn scatter(&mut self) {
        let Some(most) = self.probe.map(|probe| probe.shape.scatter_10nm).filter(|most| *most > 0) else { return };
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        let range = most.unsigned_abs().saturating_mul(2).saturating_add(1);
        self.scattered_10nm = ((self.random >> 11) % range).cast_signed() - most;
    }

    /// Position to which the motors have driven the tool head, units of 10 nm, as if
    /// nothing stopped it.
    fn driven_to_10nm(&self) -> [i64; 3] {
        let mut motors = self.start_steps;
        for (motor, steps) in motors.iter_mut().zip(self.ledger.motor_steps()) {
            *motor += steps;
        }
        self.geometry.position_10nm(motors)
    }

    /// True if the driver of a framed axis reports a stall after an event. A motor that lags too
    /// far behind falls back.
    fn stalls(&mut self, axis: usize, steps_before: [i64; 4]) -> bool {
        let (Some(before), Some(now)) = (steps_before.get(axis), self.ledger.motor_steps().get(axis).copied()) else {
            return false;
        };
        if *before == now {
            return false;
        }
        let interval_ticks = self.ledger.tick() - self.last_step_tick;
        self.last_step_tick = self.ledger.tick();
        let Some(signal) = self.stall_signal else { return false };
        let driven = self.geometry.motor_steps(self.driven_to_10nm());
        let held = self.geometry.motor_steps(self.true_position_10nm());
        // Both motors of a CoreXY machine are held back; the axis's own tells.
        let lag = |motor: usize| driven.get(motor).zip(held.get(motor)).map_or(0, |(to, at)| i64::from(to - at));
        let lag_steps = lag(axis).abs();
        let is_there = signal.is_there(lag_steps, interval_ticks);
        let falls_back = signal.falls_back(lag_steps);
        let is_there = self.said_by_failure(axis).unwrap_or(is_there);
        if !is_there && falls_back > 0 {
            for (motor, offset) in self.start_steps.iter_mut().enumerate() {
                *offset -= lag(motor).signum() * falls_back;
            }
        }
        is_there
    }

    /// Plays an entry, event by event, up to the one that triggers the sensor of `axis` (homing).
    pub fn play_until_triggered(
        &mut self,
        entry: StepEntry,
        axis: usize,
        observer: &mut impl StepObserver,
    ) -> Approach {
        if self.is_framed(axis) {
            return self.play_until_stalled(entry, axis, observer);
        }
        let approach = self.play_until_met(entry, axis, observer);
        self.hold(axis);
        approach
    }

    /// Distance that motors have pushed against the frame, which begins where an end stop that does
    /// not trigger should be, units of 10 nm.
    pub fn pushed_10nm(&self) -> [i64; 3] {
        self.pushed_10nm
    }

    /// The frame holds what an end stop that never triggers lets drive on: the motors
    /// lose those steps.
    fn hold(&mut self, axis: usize) {
        if self.is_framed(axis) || self.said_by_failure(axis) != Some(false) {
            return;
        }
        let mut place = self.driven_to_10nm();
        let trigger = self.trigger_10nm(axis, place);
        let (Some(stop), Some(at), Some(trigger)) = (self.end_stops.get(axis), place.get_mut(axis), trigger) else {
            return;
        };
        let beyond = if stop.at_max { *at - trigger } else { trigger - *at };
        if beyond <= 0 {
            return;
        }
        *at = trigger;
        if let Some(pushed) = self.pushed_10nm.get_mut(axis) {
            *pushed += beyond;
        }
        let counted = self.ledger.motor_steps();
        for ((start, held), counted) in self.start_steps.iter_mut().zip(self.geometry.motor_steps(place)).zip(counted) {
            *start = i64::from(held) - counted;
        }
    }

    fn play_until_met(&mut self, entry: StepEntry, axis: usize, observer: &mut impl StepObserver) -> Approach {
        // Where the head is costs more than an event: it is computed only where the
        // end stop can be.
        let mut apart = self.events_apart(axis);
        for (index, event) in (1..).zip(entry.events()) {
            self.ledger.play(event, observer);
            if apart > 0 {
                apart -= 1;
            } else if self.is_triggered(axis) {
                if axis == 2 {
                    self.scatter();
                }
                return Approach { added: entry.first_events(index), triggered: true };
            } else {
                apart = self.events_apart(axis);
            }
        }
        Approach { added: Some(entry), triggered: false }
    }

    /// Events that cannot reach the end stop of an axis: none takes the head further than a
    /// step of one motor.
    fn events_apart(&self, axis: usize) -> u64 {
        if self.is_triggered(axis) {
            return 0;
        }
        let steps_per_mm = self.geometry.steps_per_mm.get(axis).map_or(0.0, |steps| steps.to_f64());
        let place = self.true_position_10nm();
        let position = place.get(axis).copied();
        let apart_10nm = |(trigger, position): (i64, i64)| (trigger - position).unsigned_abs();
        let apart_10nm = self.trigger_10nm(axis, place).zip(position).map_or(0, apart_10nm);
        // Less a step for the rounding of both, and one for the event that would be there.
        ((apart_10nm as f64 / UNITS_PER_MM as f64 * steps_per_mm) as u64).saturating_sub(2)
    }

    /// Plays an entry, event by event, up to the one at which the driver of `axis` says that
    /// its motor stalls.
    fn play_until_stalled(&mut self, entry: StepEntry, axis: usize, observer: &mut impl StepObserver) -> Approach {
        for (index, event) in (1..).zip(entry.events()) {
            let before = self.ledger.motor_steps();
            self.ledger.play(event, observer);
            if self.stalls(axis, before) {
                return Approach { added: entry.first_events(index), triggered: true };
            }
        }
        Approach { added: Some(entry), triggered: false }
    }

    /// True if the sensor that homes X (0), Y (1) or Z (2) is triggered.
    pub fn is_triggered(&self, axis: usize) -> bool {
        if let Some(said) = self.said_by_failure(axis) {
            return said;
        }
        let place = self.true_position_10nm();
        let (Some(stop), Some(position), Some(trigger)) =
            (self.end_stops.get(axis), place.get(axis).copied(), self.trigger_10nm(axis, place))
        else {
            return false;
        };
        // Only a motor in motion can stall.
        if self.is_framed(axis) {
            return false;
        }
        let is_beside = axis == 2 && self.probe.is_some_and(|probe| !probe.is_above_sheet(place));
        let is_there = !is_beside && if stop.at_max { position >= trigger } else { position <= trigger };
        match self.pin {
            Some(pin) if axis == 2 => pin.is_triggered(is_there),
            _ => is_there,
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::SheetShape;
    use ferrostep_planner::{Kinematics, StepsPerMm};

    fn motors(kinematics: Kinematics) -> VirtualMotors {
        let steps = |value| StepsPerMm::from_f64(value).unwrap();
        let geometry = Geometry {
            kinematics,
            steps_per_mm: [steps(80.0), steps(80.0), steps(400.0), steps(95.0)],
            minimum_event_interval_ticks: 168,
            event_cost_ticks: 0,
            move_cost_ticks: 0,
        };
        let stop = VirtualEndStop { position_10nm: 0, at_max: false };
        VirtualMotors::new(geometry, [stop; 3], [100_000, 200_000, 300_000])
    }

    fn whole(entry: StepEntry) -> Approach {
        Approach { added: Some(entry), triggered: false }
    }

    #[test]
    fn an_end_stop_triggers_where_the_head_truly_is() {
        let mut motors = motors(Kinematics::CoreXy);
        assert!(!motors.is_triggered(0));
        // 1 mm towards -X is 80 steps back of both motors.
        motors.ledger.play(StepEntry::directions(0b11), &mut ());
        motors.ledger.play(StepEntry::stair(1_000, 79, 0b11, 0).unwrap(), &mut ());
        assert!(!motors.is_triggered(0));
        motors.ledger.play(StepEntry::stair(1_000, 1, 0b11, 0).unwrap(), &mut ());
        assert!(motors.is_triggered(0) && !motors.is_triggered(1));
        assert_eq!(motors.true_position_10nm(), [0, 200_000, 300_000]);
    }

    #[test]
    fn an_entry_is_played_up_to_the_event_that_triggers() {
        let mut motors = motors(Kinematics::Cartesian);
        let directions = StepEntry::directions(0b1);
        assert_eq!(motors.play_until_triggered(directions, 0, &mut ()), whole(directions));
        let short = StepEntry::stair(1_000, 20, 0b1, 0b1000).unwrap();
        assert_eq!(motors.play_until_triggered(short, 0, &mut ()), whole(short));
        let long = StepEntry::stair(1_000, 100, 0b1, 0b1000).unwrap();
        let approach = motors.play_until_triggered(long, 0, &mut ());
        // The event that triggers is not the entry's last: what is added to that one
        // has not stepped.
        assert_eq!(approach, Approach { added: StepEntry::stair(1_000, 60, 0b1, 0), triggered: true });
        assert_eq!(motors.ledger.motor_steps(), [-80, 0, 0, 1]);
        assert_eq!(motors.ledger.tick(), 80_000);
    }

    /// Nearer or further, on either machine, within an entry or at its end.
    #[test]
    fn no_event_before_the_end_stop_triggers_and_none_behind_it_is_played() {
        for (kinematics, axes) in [(Kinematics::Cartesian, 0b1), (Kinematics::CoreXy, 0b11)] {
            for steps in [1, 2, 3, 79, 80] {
                for entry_steps in [1, 7, 60] {
                    let mut motors = motors(kinematics);
                    motors.start_steps[0] -= i64::from(80 - steps);
                    motors.start_steps[1] -= if axes == 0b11 { i64::from(80 - steps) } else { 0 };
                    motors.play_until_triggered(StepEntry::directions(axes), 0, &mut ());
                    let entry = StepEntry::stair(1_000, entry_steps, axes, 0).unwrap();
                    while !motors.play_until_triggered(entry, 0, &mut ()).triggered {}
                    assert_eq!(
                        motors.ledger.motor_steps()[0],
                        -i64::from(steps),
                        "{kinematics:?} {steps} {entry_steps}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_probe_triggers_above_the_sheet_only() {
        for (left_10nm, sees) in [(0, true), (150_000, true), (150_001, false)] {
            let mut motors = motors(Kinematics::Cartesian);
            let sheet_10nm = [[left_10nm, 1_000_000], [0, 1_000_000]];
            motors.set_probe(VirtualProbe { offset_10nm: [0, 0], sheet_10nm, shape: SheetShape::FLAT });
            let down = StepEntry::stair(1_000, 2_000, 0b100, 0).unwrap();
            motors.play_until_triggered(StepEntry::directions(0b100), 2, &mut ());
            assert_eq!(motors.play_until_triggered(down, 2, &mut ()).triggered, sees);
            assert_eq!(motors.ledger.motor_steps()[2], if sees { -1_200 } else { -2_000 });
        }
    }

    #[test]
    fn a_failed_end_stop_says_one_thing_wherever_the_head_is() {
        for (failure, says) in [
            (EndStopFailure::NeverTriggers, false),
            (EndStopFailure::AlwaysTriggered, true),
            (EndStopFailure::PinStaysIn, true),
        ] {
            let mut motors = motors(Kinematics::Cartesian);
            motors.set_end_stop_failure(0, Some(failure));
            motors.play_until_triggered(StepEntry::directions(0b1), 0, &mut ());
            let there = StepEntry::stair(1_000, 100, 0b1, 0).unwrap();
            assert_eq!(motors.play_until_triggered(there, 0, &mut ()).triggered, says, "{failure:?}");
            assert_eq!(motors.is_triggered(0), says, "{failure:?}");
            assert!(!motors.is_triggered(1), "{failure:?}");
            let always = failure == EndStopFailure::AlwaysTriggered;
            let steps = if always {
                -1
            } else if says {
                -80
            } else {
                -100
            };
            assert_eq!(motors.ledger.motor_steps()[0], steps, "{failure:?}");
            // The frame has held the last 20 of 100 steps, 0.25 mm.
            let [pushed, ..] = motors.pushed_10nm();
            assert_eq!(pushed, if says { 0 } else { 25_000 }, "{failure:?}");
            motors.set_end_stop_failure(0, None);
            assert_eq!(motors.is_triggered(0), !always, "{failure:?}");
        }
    }
}
