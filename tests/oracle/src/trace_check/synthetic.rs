//! Traces made from a plan, for the tests of the checks: every motor steps at the moment at which
//! the law passes the middle between two steps.
#![allow(clippy::expect_used)]

use crate::reference::{InterpretOptions, MotorScale, Move, ReferenceProfile, Trapezoid, interpret, plan};
use crate::trace::{Record, StepEvent};

/// Ticks a second of the traces made here.
pub const TICK_HZ: u64 = 84_000_000;

/// Minimum interval of events, ticks: two microseconds.
const EVENT_INTERVAL_TICKS: u64 = 168;

/// The header line a profile's trace has.
pub fn header(profile: &ReferenceProfile) -> String {
    let (kinematics, axes) = profile.kinematics.names();
    let steps = profile.steps_per_mm.map(|steps| steps.to_f64());
    format!(
        r#"{{"format":"ferrostep-trace","version":1,"tick_hz":{TICK_HZ},"axes":{axes:?},"steps_per_mm":{steps:?},"kinematics":"{kinematics}"}}"#
    ) + "\n"
}

/// A trace's bytes.
pub fn bytes(profile: &ReferenceProfile, records: &[Record]) -> Vec<u8> {
    let mut bytes = header(profile).into_bytes();
    for record in records {
        let (tick, kind, axes, directions) = match record {
            Record::Step(event) => (event.tick, 0, event.axes, event.directions),
            Record::PositionsRedefined { tick, .. } => (*tick, 1, 0, 0),
            Record::MoveEnd { tick, .. } => (*tick, 2, 0, 0),
        };
        bytes.extend(tick.to_le_bytes());
        bytes.extend([kind, axes, directions, 0]);
        match record {
            Record::Step(_) => {}
            Record::PositionsRedefined { positions, .. } => {
                positions.iter().for_each(|position| bytes.extend(position.to_le_bytes()));
            }
            Record::MoveEnd { line, .. } => bytes.extend(line.to_le_bytes()),
        }
    }
    bytes
}

/// The records of a job that is executed exactly as planned.
pub fn records(gcode: &str, profile: &ReferenceProfile) -> Vec<Record> {
    let job = interpret(gcode.as_bytes(), profile, InterpretOptions::default()).expect("a job");
    let plan = plan(&job, None);
    let scale = MotorScale::new(profile);
    let mut records = Vec::new();
    let mut start_tick = 0;
    for (one, planned) in job.moves.iter().zip(&plan.moves) {
        if one.homing_before {
            start_tick = home(&mut records, start_tick, one, &scale);
        }
        let end_tick = start_tick + (planned.law.duration_s() * TICK_HZ as f64).round() as u64;
        let last_tick = block(&mut records, start_tick, one, &planned.law, &scale);
        start_tick = end_tick.max(last_tick);
        if one.kind.ends_with_a_record() {
            records.push(Record::MoveEnd { tick: start_tick, line: one.line });
        }
    }
    records
}

/// A few steps towards the end stops, then the positions.
fn home(records: &mut Vec<Record>, start_tick: u64, one: &Move, scale: &MotorScale) -> u64 {
    let mut tick = start_tick;
    for _ in 0..5 {
        tick += TICK_HZ / 1000;
        records.push(Record::Step(StepEvent { tick, axes: 0b0011, directions: 0b0011 }));
    }
    let [x, y, z] = scale.motors(one.start_10nm);
    let e = scale.extruder(one.extruder_start).rounded;
    let positions = [x, y, z, e].map(|steps| i32::try_from(steps).expect("a small position")).to_vec();
    records.push(Record::PositionsRedefined { tick, positions });
    tick
}

/// Appends the step events of one block and returns the last one's tick.
fn block(records: &mut Vec<Record>, start_tick: u64, one: &Move, law: &Trapezoid, scale: &MotorScale) -> u64 {
    let (from, to) = (scale.motors(one.start_10nm), scale.motors(one.end_10nm));
    let mut steps: Vec<(u64, u8, bool)> = Vec::new();
    for motor in 0..3 {
        let count = (to[motor] - from[motor]).unsigned_abs();
        for step in 0..count {
            let part = (step as f64 + 0.5) / count as f64;
            steps.push((start_tick + tick_at(law, part), motor as u8, to[motor] < from[motor]));
        }
    }
    let (from, to) = (scale.extruder(one.extruder_start), scale.extruder(one.extruder_end));
    let negative = one.extruder_end < one.extruder_start;
    let sign = if negative { -1.0 } else { 1.0 };
    for step in 0..(to.rounded - from.rounded).unsigned_abs() {
        let crossing = from.rounded as f64 + sign * (step as f64 + 0.5);
        let part = ((crossing - from.exact) / (to.exact - from.exact)).clamp(0.0, 1.0);
        steps.push((start_tick + tick_at(law, part), 3, negative));
    }
    steps.sort_unstable();
    let mut last_tick =
        records.iter().rev().find_map(|record| if let Record::Step(event) = record { Some(event.tick) } else { None });
    let mut first_of_block = true;
    for (tick, motor, negative) in steps {
        let (axes, directions) = (1 << motor, u8::from(negative) << motor);
        let near = last_tick.is_some_and(|last| tick < last + EVENT_INTERVAL_TICKS);
        match records.last_mut() {
            Some(Record::Step(event)) if near && !first_of_block && event.axes & axes == 0 => {
                event.axes |= axes;
                event.directions |= directions;
            }
            _ => {
                let tick = last_tick.map_or(tick, |last| tick.max(last + EVENT_INTERVAL_TICKS));
                records.push(Record::Step(StepEvent { tick, axes, directions }));
                last_tick = Some(tick);
            }
        }
        first_of_block = false;
    }
    last_tick.unwrap_or(start_tick)
}

/// Time at which the law has covered a part of its path, in ticks from its start.
fn tick_at(law: &Trapezoid, part: f64) -> u64 {
    let (mut early, mut late) = (0.0, law.duration_s());
    for _ in 0..60 {
        let middle = (early + late) / 2.0;
        if law.at(middle).0 < part * law.length_mm { early = middle } else { late = middle }
    }
    (late * TICK_HZ as f64).round() as u64
}
