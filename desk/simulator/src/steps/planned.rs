//! Plays the steps of a plan: every motor steps where its filtered position passes the middle
//! between two steps.

use super::{MOTORS, StepSimulation, StepsError};
use crate::law::{ShapedCursor, ShapedLaw, StepTime, follow};
use crate::measures::SAMPLE_S;
use crate::motion::Motion;
use crate::plan::{ExtruderSamples, Filters, Plan};
use crate::shapers::Shaper;
use ferrostep_oracle::reference::Kinematics;
use ferrostep_oracle::trace::{Record, StepEvent, TraceHeader};

impl StepSimulation {
    /// Plays the steps of plans one after the other, and the ends of their moves. Returns the total
    /// duration of the plans, s.
    ///
    /// # Errors
    /// The plans do not match the path.
    pub fn play_plans(&mut self, plans: &[Plan], filters: &Filters) -> Result<f64, StepsError> {
        let mut begins_s = 0.0;
        for plan in plans {
            begins_s = self.play_plan(plan, filters, begins_s)?;
        }
        Ok(plans.iter().map(Plan::duration_s).sum())
    }

    /// Plays the steps of a plan that starts no earlier than `begins_s`. Returns the time after
    /// which nothing moves, s.
    fn play_plan(&mut self, plan: &Plan, filters: &Filters, begins_s: f64) -> Result<f64, StepsError> {
        let header = self.header.clone();
        records(&header, plan, filters, begins_s, |record| self.play(record))
    }
}

/// Passes to `see` the records that a trace of the plan would have; the header's motors are three
/// for the axes and one for the extruder. Returns the time after which nothing moves, s.
pub(super) fn records<E>(
    header: &TraceHeader,
    plan: &Plan,
    filters: &Filters,
    begins_s: f64,
    mut see: impl FnMut(&Record) -> Result<(), E>,
) -> Result<f64, E> {
    // Filters begin before the plan and end after it.
    let lead_s = filters.half_length_s() + SAMPLE_S;
    let windows = ((plan.duration_s() + 2.0 * lead_s) / SAMPLE_S).ceil() as u64;
    let tick = |time_s: f64| ((begins_s + lead_s + time_s) * header.tick_hz as f64).round() as u64;
    let shapers = filters.shapers.clone().map(Shaper::centred);
    let extruder_shaper = filters.extruder.shaper.clone().centred();
    let advanced = plan.advanced_filament(filters.extruder.advance_s);
    let shaped_filament = ShapedLaw { law: &advanced, impulses: extruder_shaper.impulses() };
    let unshaped = Shaper::identity();
    let [x, y, z] = plan.axes();
    let axes = [(x, &shapers[0]), (y, &shapers[1]), (z, &unshaped)]
        .map(|(law, shaper)| ShapedCursor::new(ShapedLaw { law, impulses: shaper.impulses() }));
    let filament = ExtruderSamples::new(shaped_filament, &filters.extruder.boxes_s, -lead_s);
    let mut motors = Motors::new(header, axes, filament, -lead_s);
    let positions = motors.places.map(|place| place as i32).to_vec();
    see(&Record::PositionsRedefined { tick: tick(-lead_s), positions })?;
    let mut ends = plan.ends().iter().peekable();
    let mut found = Vec::new();
    for window in 1..=windows {
        let until_s = window as f64 * SAMPLE_S - lead_s;
        motors.step_until(until_s, |motor, step| {
            let (tick, axes) = (tick(step.time_s), 1 << motor);
            let directions = if step.negative { axes } else { 0 };
            found.push((tick, Record::Step(StepEvent { tick, axes, directions })));
        });
        while let Some(end) = ends.next_if(|end| end.time_s <= until_s) {
            let tick = tick(end.time_s);
            found.push((tick, Record::MoveEnd { tick, line: end.line }));
        }
        found.sort_by_key(|(tick, _)| *tick);
        for (_, record) in found.drain(..) {
            see(&record)?;
        }
    }
    Ok(begins_s + windows as f64 * SAMPLE_S)
}

/// Motors moving through a plan.
struct Motors<'a> {
    kinematics: Kinematics,
    steps_per_mm: [f64; MOTORS],
    time_s: f64,
    axes: [ShapedCursor<'a>; 3],
    filament: ExtruderSamples<'a>,
    filament_mm: f64,
    /// Positions of the motors, whole steps.
    places: [f64; MOTORS],
    found: Vec<StepTime>,
}

impl<'a> Motors<'a> {
    /// Starts the motors at the whole steps nearest to the plan's start.
    fn new(header: &TraceHeader, axes: [ShapedCursor<'a>; 3], filament: ExtruderSamples<'a>, time_s: f64) -> Self {
        let mut steps_per_mm = [0.0; MOTORS];
        steps_per_mm.iter_mut().zip(&header.steps_per_mm).for_each(|(scale, header)| *scale = *header);
        let kinematics = header.kinematics;
        let mut motors = Self {
            kinematics,
            steps_per_mm,
            time_s,
            axes,
            filament,
            filament_mm: 0.0,
            places: [0.0; MOTORS],
            found: Vec::new(),
        };
        let [a, b, c] = motors.motion(time_s).map(|motor| motor.position_mm);
        motors.filament_mm = motors.filament.next_mm();
        let mm = [a, b, c, motors.filament_mm];
        motors.places = std::array::from_fn(|motor| (mm[motor] * steps_per_mm[motor]).round());
        motors
    }

    /// Returns the motion of the axes' motors from now on, if no acceleration changes before
    /// `until_s`.
    fn motion(&mut self, until_s: f64) -> [Motion; 3] {
        // The middle lies within one piece for every impulse; the ends, because of rounding, may
        // not.
        let half_s = 0.5 * (until_s - self.time_s);
        let axes = self.axes.each_mut().map(|axis| axis.at(self.time_s + half_s).after(-half_s));
        self.kinematics.motors(axes)
    }

    /// Passes the steps until the next sample to `see`, those of each motor in order.
    fn step_until(&mut self, sample_s: f64, mut see: impl FnMut(usize, StepTime)) {
        let start_s = self.time_s;
        while self.time_s < sample_s {
            let now_s = self.time_s;
            let change_s = |axis: &mut ShapedCursor<'_>| axis.next_breakpoint_s(now_s);
            let until_s = self.axes.iter_mut().map(change_s).fold(sample_s, f64::min);
            for (motor, motion) in self.motion(until_s).into_iter().enumerate() {
                self.follow(motor, motion, [now_s, until_s], &mut see);
            }
            self.time_s = until_s;
        }
        // After the averages so little of the filament's acceleration is left that its motion is
        // taken as linear between samples.
        let before_mm = std::mem::replace(&mut self.filament_mm, self.filament.next_mm());
        let speed_mm_per_s = (self.filament_mm - before_mm) / (sample_s - start_s);
        let motion = Motion { speed_mm_per_s, ..Motion::standing(before_mm) };
        self.follow(MOTORS - 1, motion, [start_s, sample_s], &mut see);
    }

    fn follow(&mut self, motor: usize, motion: Motion, between_s: [f64; 2], see: &mut impl FnMut(usize, StepTime)) {
        follow(&mut self.found, &mut self.places[motor], motion, between_s, self.steps_per_mm[motor]);
        self.found.drain(..).for_each(|step| see(motor, step));
    }
}
