//! The planner as a whole, over arbitrary moves: positions, order, spacing and the time law of every block.

#![allow(clippy::unwrap_used, missing_docs)]

use ferrostep_planner::extruder::{Extruder, rounded_steps};
use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::{
    AccelerationProfile, Geometry, Kinematics, Limits, MotionChoice, Move, MoveError, Moved, Notice, Pace,
    PlannedBlock, Planner, Progress, Speed, StepDigests, StepEntry, StepKind, StepSink, StepsPerMm, TICKS_PER_SECOND,
};
use proptest::prelude::*;

const MINIMUM_INTERVAL: u32 = 168;

#[derive(Clone, Copy, Debug, PartialEq)]
struct Event {
    tick: u64,
    axes: u8,
    directions: u8,
}

/// Plays entries into events, as the step interrupt would.
#[derive(Default)]
struct Player {
    tick: u64,
    directions: u8,
    events: Vec<Event>,
    notices: Vec<Notice>,
    entries: usize,
}

impl StepSink for Player {
    fn entry(&mut self, entry: StepEntry) {
        self.entries += 1;
        match entry.kind() {
            StepKind::Directions { directions } => self.directions = directions,
            StepKind::Wait { interval_ticks } => self.tick += u64::from(interval_ticks),
            StepKind::Stair { interval_ticks, count, axes, added } => {
                for index in 1..=count {
                    self.tick += u64::from(interval_ticks);
                    let axes = if index == count { axes ^ added } else { axes };
                    let directions = self.directions & axes;
                    self.events.push(Event { tick: self.tick, axes, directions });
                }
            }
        }
    }

    fn notice(&mut self, notice: Notice) {
        self.notices.push(notice);
    }
}

fn geometry(kinematics: Kinematics, steps_per_mm: [f64; 4]) -> Geometry {
    Geometry {
        kinematics,
        steps_per_mm: steps_per_mm.map(|steps| StepsPerMm::from_f64(steps).unwrap()),
        minimum_event_interval_ticks: MINIMUM_INTERVAL,
        event_cost_ticks: 0,
        move_cost_ticks: 0,
    }
}

fn limits() -> Limits {
    Limits {
        max_feed_mm_per_s: [300.0, 250.0, 15.0, 60.0],
        max_acceleration_mm_per_s2: [5000.0, 4000.0, 300.0, 5000.0],
        print_acceleration_mm_per_s2: 2000.0,
        travel_acceleration_mm_per_s2: 3000.0,
        retract_acceleration_mm_per_s2: 1500.0,
        junction_deviation_mm: 0.05,
    }
}

/// Moves of every kind: long and shorter than a step, with and without filament, filament alone.
fn moves() -> impl Strategy<Value = Vec<Move>> {
    let coordinate = prop_oneof![-2_000i64..2_000, -200_000i64..200_000, -8_000_000i64..8_000_000];
    let filament = prop_oneof![Just(0i64), -50_000i64..50_000, -20_000_000i64..20_000_000];
    let one = (
        proptest::array::uniform3(coordinate),
        0u8..8,
        filament,
        prop_oneof![0.5f32..20.0, 20.0f32..400.0],
        any::<bool>(),
    );
    proptest::collection::vec(one, 1..40).prop_map(|list| {
        let mut target = [0i64; 3];
        (1..)
            .zip(list)
            .map(|(line, (delta, which, filament_100pm, feed_mm_per_s, ends_move))| {
                for axis in 0..3 {
                    // Z moves less, and rarely.
                    let delta = if axis == 2 { delta[axis] / 20 } else { delta[axis] };
                    if which >> axis & 1 == 1 {
                        target[axis] += delta;
                    }
                }
                Move { target_10nm: target, filament_100pm, feed_mm_per_s, line, ends_move }
            })
            .collect()
    })
}

fn planner(geometry: Geometry, ring: usize) -> Planner<Vec<Slot>> {
    Planner::new(geometry, limits(), vec![Slot::EMPTY; ring])
}

/// The same machine under another law of acceleration.
fn planner_under(acceleration: AccelerationProfile, geometry: Geometry, ring: usize) -> Planner<Vec<Slot>> {
    let mut planner = planner(geometry, ring);
    assert!(planner.set_motion_choice(&MotionChoice { acceleration, ..MotionChoice::DEFAULT }));
    planner
}

fn accelerations() -> impl Strategy<Value = AccelerationProfile> {
    proptest::sample::select(&AccelerationProfile::ALL[..])
}

/// Everything a job of moves becomes.
fn play(geometry: Geometry, ring: usize, moves: &[Move], pause: impl FnMut() -> usize) -> Player {
    play_on(planner(geometry, ring), moves, pause)
}

/// The same under any law of acceleration.
fn play_on(mut planner: Planner<Vec<Slot>>, moves: &[Move], mut pause: impl FnMut() -> usize) -> Player {
    let mut player = Player::default();
    for each in moves {
        // Work a random amount before the next move comes, and as much as is needed to make room.
        for _ in 0..pause() {
            planner.advance(&mut player);
        }
        while let Err(MoveError::NoRoom) = planner.add(each) {
            assert_eq!(planner.advance(&mut player), Progress::Worked);
        }
    }
    planner.flush();
    while planner.advance(&mut player) == Progress::Worked {}
    assert!(planner.is_idle());
    player
}

/// The same plan as blocks.
fn blocks(geometry: Geometry, ring: usize, moves: &[Move]) -> Vec<PlannedBlock> {
    let mut planner = planner(geometry, ring);
    let mut blocks = Vec::new();
    for each in moves {
        while let Err(MoveError::NoRoom) = planner.add(each) {
            blocks.extend(planner.next_planned());
        }
    }
    planner.flush();
    while let Some(block) = planner.next_planned() {
        blocks.push(block);
    }
    blocks
}

/// The textbook trapezoid, in f64, independent of the planner's own.
struct Law {
    ramps: [(f64, f64, f64); 3],
    length: f64,
}

impl Law {
    fn new(planned: &PlannedBlock) -> Self {
        let (v1, v2) = (planned.entry.mm_per_s(), planned.exit.mm_per_s());
        let v = planned.block.nominal.mm_per_s().max(v1).max(v2);
        let (a, s) = (planned.block.acceleration.mm_per_s2(), planned.block.length_mm());
        let peak = ((2.0 * a * s + v1 * v1 + v2 * v2) / 2.0).sqrt().min(v).max(v1).max(v2);
        let up = ((peak * peak - v1 * v1) / (2.0 * a)).min(s);
        let down = ((peak * peak - v2 * v2) / (2.0 * a)).min(s - up);
        let cruise = s - up - down;
        let time = |length: f64, from: f64, to: f64| if length > 0.0 { 2.0 * length / (from + to) } else { 0.0 };
        let ramps =
            [(time(up, v1, peak), v1, peak), (time(cruise, peak, peak), peak, peak), (time(down, peak, v2), peak, v2)];
        Self { ramps, length: s }
    }

    fn share(&self, mut t: f64) -> f64 {
        let mut s = 0.0;
        for (duration, from, to) in self.ramps {
            let part = t.clamp(0.0, duration);
            if duration > 0.0 {
                s += from * part + (to - from) / duration * part * part / 2.0;
            }
            t -= part;
        }
        (s / self.length).clamp(0.0, 1.0)
    }

    fn duration(&self) -> f64 {
        self.ramps.iter().map(|ramp| ramp.0).sum()
    }
}

fn machines() -> impl Strategy<Value = Geometry> {
    (
        any::<bool>(),
        prop_oneof![
            Just([80.0, 80.0, 400.0, 95.0]),
            Just([160.0, 160.0, 800.0, 400.0]),
            Just([100.33, 99.87, 401.5, 415.3])
        ],
    )
        .prop_map(|(core, steps)| geometry(if core { Kinematics::CoreXy } else { Kinematics::Cartesian }, steps))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn motors_end_every_move_exactly_where_it_ends(
        machine in machines(), moves in moves(), ring in 2usize..40, law in accelerations(),
    ) {
        let player = play_on(planner_under(law, machine, ring), &moves, || 0);
        let mut extruder = Extruder::new(machine.steps_per_mm[3]);
        let mut motors = [0i64; 4];
        let mut events = player.events.iter().peekable();
        let mut ends = player.notices.iter();
        let mut position = [0; 3];
        for each in &moves {
            extruder.advance(each.filament_100pm);
            let nothing = each.target_10nm == position && each.filament_100pm == 0;
            position = each.target_10nm;
            if !each.ends_move || nothing {
                continue;
            }
            let Some(&Notice::MoveEnded { tick, line }) = ends.next() else { panic!("move of line {} has no end", each.line) };
            prop_assert_eq!(line, each.line);
            while let Some(event) = events.next_if(|event| event.tick <= tick) {
                for (motor, steps) in motors.iter_mut().enumerate() {
                    if event.axes >> motor & 1 == 1 {
                        *steps += if event.directions >> motor & 1 == 1 { -1 } else { 1 };
                    }
                }
            }
            let [x, y, z] = machine.motor_steps(each.target_10nm).map(i64::from);
            prop_assert_eq!(motors, [x, y, z, rounded_steps(extruder.position_256ths())], "line {}", line);
        }
        prop_assert!(ends.next().is_none());
    }

    #[test]
    fn events_keep_their_distance(machine in machines(), moves in moves(), law in accelerations()) {
        let player = play_on(planner_under(law, machine, 16), &moves, || 0);
        for pair in player.events.windows(2) {
            prop_assert!(pair[1].tick - pair[0].tick >= u64::from(MINIMUM_INTERVAL));
        }
        prop_assert!(player.events.iter().all(|event| event.axes != 0 && event.axes < 16));
    }

    #[test]
    fn no_motor_is_more_than_a_step_from_its_law(machine in machines(), moves in moves()) {
        let player = play(machine, 24, &moves, || 0);
        let mut events = player.events.iter().peekable();
        let mut motors = [0i64; 4];
        let (mut start_tick, mut start, mut filament) = (0u64, [0i64; 3], 0i64);
        for planned in blocks(machine, 24, &moves) {
            let law = Law::new(&planned);
            let duration = (law.duration() * f64::from(TICKS_PER_SECOND)).round() as u64;
            let end_tick = start_tick + duration;
            let steps = planned.block.steps.map(i64::from);
            let filament_end = filament + i64::from(planned.block.extruder_256ths);
            let [x, y, z] = steps.map(i64::abs);
            let mut left = [x, y, z, (rounded_steps(filament_end) - rounded_steps(filament)).abs()];
            let fastest = planned.block.nominal.mm_per_s() / law.length;
            // The last events of a block may be late by the minimum interval, where the next begins.
            let latest = end_tick + 2 * u64::from(MINIMUM_INTERVAL);
            while let Some(event) = events.next_if(|event| left != [0; 4] && event.tick <= latest) {
                let check = |motors: &[i64; 4], tick: u64| -> Result<(), TestCaseError> {
                    let share = law.share((tick.saturating_sub(start_tick)) as f64 / f64::from(TICKS_PER_SECOND));
                    for motor in 0..4 {
                        let (from, delta) = match motor {
                            3 => (filament as f64 / 256.0, f64::from(planned.block.extruder_256ths) / 256.0),
                            _ => (start[motor] as f64, steps[motor] as f64),
                        };
                        let ideal = from + delta * share;
                        // An event that joins another, or keeps its distance from one, is up to two intervals off.
                        let joined = delta.abs() * fastest * 2.0 * f64::from(MINIMUM_INTERVAL) / f64::from(TICKS_PER_SECOND);
                        let off = (motors[motor] as f64 - ideal).abs();
                        prop_assert!(off <= 1.0 + 1e-3 + joined, "motor {} is {} off", motor, off);
                    }
                    Ok(())
                };
                check(&motors, event.tick)?;
                for (motor, steps) in motors.iter_mut().enumerate() {
                    if event.axes >> motor & 1 == 1 {
                        *steps += if event.directions >> motor & 1 == 1 { -1 } else { 1 };
                        left[motor] -= 1;
                    }
                }
                check(&motors, event.tick)?;
            }
            prop_assert_eq!(left, [0; 4]);
            for axis in 0..3 {
                start[axis] += steps[axis];
                prop_assert_eq!(motors[axis], start[axis]);
            }
            filament = filament_end;
            start_tick = end_tick;
        }
        prop_assert!(events.next().is_none());
    }

    #[test]
    fn speeds_join_and_limits_hold(machine in machines(), moves in moves(), ring in 2usize..40) {
        let mut speed = 0.0;
        for planned in blocks(machine, ring, &moves) {
            prop_assert_eq!(planned.entry.mm_per_s(), speed);
            speed = planned.exit.mm_per_s();
            let nominal = planned.block.nominal.mm_per_s();
            prop_assert!(planned.entry <= planned.block.nominal && planned.exit <= planned.block.nominal);
            let change = (planned.exit.squared() - planned.entry.squared()).abs();
            let reach = 2.0 * planned.block.acceleration.mm_per_s2() * planned.block.length_mm();
            prop_assert!(change <= reach * (1.0 + 1e-9) + 0.05, "{} > {}", change, reach);
            prop_assert!(nominal <= 400.0 * (1.0 + 1e-9));
        }
        prop_assert_eq!(speed, 0.0);
    }

    #[test]
    fn the_plan_does_not_depend_on_when_moves_come(
        machine in machines(), moves in moves(), ring in 2usize..40, seed in any::<u64>(), law in accelerations(),
    ) {
        let mut state = seed | 1;
        let random = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state % 400) as usize
        };
        let prompt = play_on(planner_under(law, machine, ring), &moves, || 0);
        let halting = play_on(planner_under(law, machine, ring), &moves, random);
        prop_assert_eq!(digest(&prompt), digest(&halting));
        prop_assert_eq!(prompt.notices, halting.notices);
    }

    #[test]
    fn an_estimate_takes_as_long_as_the_motion(
        machine in machines(), moves in moves(), ring in 2usize..40, law in accelerations(),
    ) {
        let mut player = Player::default();
        let mut planned = planner_under(law, machine, ring);
        let mut played = planner_under(law, machine, ring);
        let mut speed = Speed::ZERO;
        for each in &moves {
            while let Err(MoveError::NoRoom) = planned.add(each) {
                let block = planned.next_planned().unwrap();
                prop_assert_eq!(block.entry, speed);
                speed = block.exit;
            }
            while let Err(MoveError::NoRoom) = played.add(each) {
                played.advance(&mut player);
            }
        }
        planned.flush();
        played.flush();
        while let Some(block) = planned.next_planned() {
            prop_assert_eq!(block.entry, speed);
            speed = block.exit;
        }
        while played.advance(&mut player) == Progress::Worked {}
        prop_assert_eq!(speed, Speed::ZERO);
        prop_assert_eq!(planned.motion_ticks(), played.motion_ticks());
        prop_assert!(!played.is_in_motion());
    }

    #[test]
    fn extruder_speed_and_acceleration_keep_their_limits(moves in moves()) {
        let machine = geometry(Kinematics::Cartesian, [80.0, 80.0, 400.0, 95.0]);
        for planned in blocks(machine, 24, &moves) {
            let limits = limits();
            for (axis, per_mm) in machine_share(&machine, &planned).into_iter().enumerate() {
                // A rounded step end may be half a step off at each side.
                let slack = 1.0 / (machine.steps_per_mm[axis].to_f64() * planned.block.length_mm());
                let share = (per_mm - slack).max(0.0);
                prop_assert!(planned.block.nominal.mm_per_s() * share <= limits.max_feed_mm_per_s[axis] * (1.0 + 1e-6));
                prop_assert!(planned.block.acceleration.mm_per_s2() * share <= limits.max_acceleration_mm_per_s2[axis] * (1.0 + 1e-6));
            }
        }
    }
}

/// Travel of each axis for a millimetre of path.
fn machine_share(machine: &Geometry, planned: &PlannedBlock) -> [f64; 4] {
    let [x, y, z] = planned.block.steps.map(|steps| f64::from(steps.abs()));
    let e = f64::from(planned.block.extruder_256ths.abs()) / 256.0;
    let travel = [x, y, z, e];
    [0, 1, 2, 3].map(|axis| travel[axis] / machine.steps_per_mm[axis].to_f64() / planned.block.length_mm())
}

fn digest(player: &Player) -> StepDigests {
    let mut digests = StepDigests::default();
    for event in &player.events {
        digests.add(event.tick, event.axes, event.directions);
    }
    digests
}

fn request(target_10nm: [i64; 3], filament_100pm: i64, feed_mm_per_s: f32) -> Move {
    Move { target_10nm, filament_100pm, feed_mm_per_s, line: 1, ends_move: true }
}

#[test]
fn bad_moves_are_refused_and_change_nothing() {
    let mut planner = planner(geometry(Kinematics::Cartesian, [80.0, 80.0, 400.0, 95.0]), 4);
    let far = 600_000_000;
    assert_eq!(planner.add(&request([far, 0, 0], 0, 10.0)), Err(MoveError::TooFar));
    assert_eq!(planner.add(&request([i64::MIN, 0, 0], 0, 10.0)), Err(MoveError::TooFar));
    assert_eq!(planner.add(&request([0; 3], i64::MIN, 10.0)), Err(MoveError::TooMuchFilament));
    for feed in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert_eq!(planner.add(&request([1_000, 0, 0], 0, feed)), Err(MoveError::Feed));
    }
    assert_eq!(planner.add(&request([0; 3], 0, 10.0)), Ok(Moved::Nothing));
    assert!(planner.is_idle());
    assert_eq!(planner.position_10nm(), [0; 3]);
}

#[test]
fn a_slope_of_one_in_fifty_takes_an_entry_for_fifty_steps() {
    // 250 mm by 5 mm at constant speed: 20,000 by 400 steps, hardly any ramp.
    let machine = geometry(Kinematics::Cartesian, [80.0, 80.0, 400.0, 95.0]);
    let player = play(machine, 4, &[request([25_000_000, 500_000, 0], 0, 5.0)], || 0);
    assert_eq!(player.events.len(), 20_000);
    assert!(player.entries < 450, "{}", player.entries);
}

#[test]
fn a_step_that_takes_minutes_is_waited_for() {
    // One step a millimetre and 0.01 mm/s: 100 s between steps, twice what 32 bits of ticks hold.
    let machine = geometry(Kinematics::Cartesian, [1.0, 80.0, 400.0, 95.0]);
    let player = play(machine, 4, &[request([1_000_000, 0, 0], 0, 0.000_01)], || 0);
    assert_eq!(player.events.len(), 10);
    for pair in player.events.windows(2) {
        let seconds = (pair[1].tick - pair[0].tick) as f64 / f64::from(TICKS_PER_SECOND);
        // Speeds are whole multiples of 2^-16 mm/s.
        assert!((seconds - 100.0).abs() < 0.1, "{seconds}");
    }
}

#[test]
fn after_a_stop_motion_goes_on_from_where_the_motors_stand() {
    for law in AccelerationProfile::ALL {
        goes_on_after_a_stop(law);
    }
}

fn goes_on_after_a_stop(law: AccelerationProfile) {
    let machine = geometry(Kinematics::CoreXy, [160.0, 160.0, 800.0, 400.0]);
    let mut planner = planner_under(law, machine, 8);
    let mut player = Player::default();
    planner.add(&request([5_000_000, 3_000_000, 0], 100_000_000, 100.0)).unwrap();
    planner.flush();
    for _ in 0..500 {
        planner.advance(&mut player);
    }
    let mut motors = [0i64; 4];
    for event in &player.events {
        for (motor, steps) in motors.iter_mut().enumerate() {
            *steps += i64::from(event.axes >> motor & 1) - 2 * i64::from(event.directions >> motor & 1);
        }
    }
    planner.stand_at(motors, player.tick, player.directions);
    assert!(planner.is_idle());
    let here = planner.position_10nm();
    assert_eq!(machine.motor_steps(here).map(i64::from), [motors[0], motors[1], motors[2]]);
    let before = player.events.len();
    planner.add(&request([0; 3], 0, 100.0)).unwrap();
    planner.flush();
    while planner.advance(&mut player) == Progress::Worked {}
    for event in &player.events[before..] {
        for (motor, steps) in motors.iter_mut().enumerate() {
            *steps += i64::from(event.axes >> motor & 1) - 2 * i64::from(event.directions >> motor & 1);
        }
    }
    assert_eq!(motors[..3], [0, 0, 0]);
}

#[test]
fn the_law_changes_at_a_standstill_only() {
    let machine = geometry(Kinematics::Cartesian, [80.0, 80.0, 400.0, 95.0]);
    let mut planner = planner(machine, 8);
    let choice = |acceleration, jerk_mm_per_s3, top_hz| {
        let mut choice = MotionChoice { acceleration, jerk_mm_per_s3, ..MotionChoice::DEFAULT };
        choice.s_curve_table.top_hz = top_hz;
        choice
    };
    let good = choice(AccelerationProfile::SCurve, 5_000.0, 2_000);
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(!planner.set_motion_choice(&choice(AccelerationProfile::SCurve, bad, 2_000)));
    }
    assert!(!planner.set_motion_choice(&choice(AccelerationProfile::SCurveTable, 1.0, 1_000)));
    assert_eq!(*planner.motion_choice(), MotionChoice::DEFAULT);
    planner.add(&request([1_000_000, 0, 0], 0, 50.0)).unwrap();
    assert!(!planner.set_motion_choice(&good));
    planner.flush();
    let mut player = Player::default();
    while planner.advance(&mut player) == Progress::Worked {}
    let trapezoid = planner.motion_ticks();
    assert!(planner.set_motion_choice(&good));
    planner.add(&request([0; 3], 0, 50.0)).unwrap();
    planner.flush();
    while planner.advance(&mut player) == Progress::Worked {}
    assert_eq!(player.events.len(), 1_600);
    // Less jerk takes longer.
    assert!(planner.motion_ticks() > 2 * trapezoid + trapezoid / 10);
}

/// A job and its plan, with a fan change after each move that keeps it from merging with the next, or without.
fn plan(geometry: Geometry, moves: &[Move], apart: bool) -> (Planner<Vec<Slot>>, Player) {
    let mut planner = planner(geometry, 1_000);
    let mut player = Player::default();
    for each in moves {
        planner.add(each).unwrap();
        assert!(!apart || planner.add_fan_power(1));
        while !planner.has_room() {
            assert_eq!(planner.advance(&mut player), Progress::Worked);
        }
    }
    planner.flush();
    while planner.advance(&mut player) == Progress::Worked {}
    (planner, player)
}

fn ends(player: &Player) -> Vec<(u64, u32)> {
    let ends = player.notices.iter().filter_map(|notice| match *notice {
        Notice::MoveEnded { tick, line } => Some((tick, line)),
        Notice::FanPower { .. } => None,
    });
    ends.collect()
}

/// Short moves that go on nearly as the ones before, some of them in units that suit the motors.
fn short_moves() -> impl Strategy<Value = Vec<Move>> {
    let one = (prop_oneof![Just(5_000i64), Just(1_250), 1_000i64..20_000], -3i64..=3, any::<u8>(), any::<bool>());
    let directions = (0usize..6, prop_oneof![Just(0i64), 1i64..100], 10.0f32..100.0);
    (directions, proptest::collection::vec(one, 2..120)).prop_map(|((direction, filament, feed_mm_per_s), list)| {
        let [dx, dy] = [[1, 0], [0, 1], [-1, 1], [2, 1], [-3, -1], [5, 4]][direction];
        let mut target = [0i64; 3];
        (1..)
            .zip(list)
            .map(|(line, (length, off, turn, ends_move))| {
                target[0] += dx * length + if turn < 30 { off } else { 0 };
                target[1] += dy * length + if turn < 20 { off * 40 } else { 0 };
                let filament_100pm = filament * length / 10;
                Move { target_10nm: target, filament_100pm, feed_mm_per_s, line, ends_move: ends_move || turn > 20 }
            })
            .collect()
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    #[test]
    fn merging_changes_no_end_and_no_time(machine in machines(), moves in short_moves()) {
        let (merged_planner, merged) = plan(machine, &moves, false);
        let (apart_planner, apart) = plan(machine, &moves, true);
        prop_assert_eq!(apart_planner.merged_moves(), 0);
        let (ends, expected) = (ends(&merged), ends(&apart));
        prop_assert_eq!(ends.len(), expected.len());
        let count = |player: &Player, tick: u64| {
            let mut motors = [0i64; 4];
            for event in player.events.iter().take_while(|event| event.tick <= tick) {
                for (motor, steps) in motors.iter_mut().enumerate() {
                    if event.axes >> motor & 1 == 1 {
                        *steps += if event.directions >> motor & 1 == 1 { -1 } else { 1 };
                    }
                }
            }
            motors
        };
        for (&(tick, line), &(expected_tick, expected_line)) in ends.iter().zip(&expected) {
            prop_assert_eq!(line, expected_line);
            prop_assert_eq!(count(&merged, tick), count(&apart, expected_tick), "line {}", line);
            // A speed is cut to 2^-16 mm/s and a duration rounded to a tick at each end of a block; an event that
            // keeps its distance may put an end off.
            let slack = 1e-6 * tick as f64 + 4.0 * f64::from(MINIMUM_INTERVAL) + 200.0;
            prop_assert!((tick as f64 - expected_tick as f64).abs() < slack, "{} {} {}", line, tick, expected_tick);
        }
        prop_assert_eq!(merged_planner.position_10nm(), apart_planner.position_10nm());
    }

    #[test]
    fn no_block_is_faster_than_the_budget(machine in machines(), moves in prop_oneof![moves(), short_moves()]) {
        let machine = Geometry { event_cost_ticks: 2_100, move_cost_ticks: 84_000, ..machine };
        let mut extruder = 0i64;
        for planned in blocks(machine, 24, &moves) {
            let block = planned.block;
            let extruder_steps = rounded_steps(extruder + i64::from(block.extruder_256ths)).abs_diff(rounded_steps(extruder));
            extruder += i64::from(block.extruder_256ths);
            let master = block.steps.iter().map(|steps| u64::from(steps.unsigned_abs())).max().unwrap();
            let lines = 1 + block.inner_ends.iter(block.line).count() as u64;
            let cost_ticks = (master + extruder_steps) * 2_100 + lines * 84_000;
            let ticks = Law::new(&planned).duration() * f64::from(TICKS_PER_SECOND);
            prop_assert!(ticks >= cost_ticks as f64 * (1.0 - 1e-6), "{} {}", ticks, cost_ticks);
        }
    }

    #[test]
    fn any_pace_keeps_the_limits(machine in machines(), moves in moves(), ring in 2usize..40, paces in proptest::collection::vec(0u16..300, 1..40)) {
        let mut planner = planner(machine, ring);
        let mut planned = Vec::new();
        let mut paces = paces.into_iter().cycle();
        let mut next = |planner: &mut Planner<Vec<Slot>>| {
            let pace = Pace::from_256ths(paces.next().unwrap());
            planner.set_pace(pace);
            planner.next_planned().map(|block| (pace, block))
        };
        for each in &moves {
            while let Err(MoveError::NoRoom) = planner.add(each) {
                planned.extend(next(&mut planner));
            }
        }
        planner.flush();
        while let Some(one) = next(&mut planner) {
            planned.push(one);
        }
        let full = blocks(machine, ring, &moves);
        prop_assert_eq!(planned.len(), full.len());
        let mut speed = Speed::ZERO;
        for ((pace, planned), full) in planned.into_iter().zip(full) {
            prop_assert_eq!(planned.entry, speed);
            speed = planned.exit;
            let reach = 2.0 * planned.block.acceleration.mm_per_s2() * planned.block.length_mm();
            let change = planned.exit.squared() - planned.entry.squared();
            prop_assert!(change.abs() <= reach * (1.0 + 1e-9) + 0.05, "{} > {}", change, reach);
            let capped = pace.of(full.block.nominal);
            prop_assert_eq!(planned.block.nominal, capped.max(planned.entry).max(planned.exit));
            prop_assert!(planned.block.nominal <= full.block.nominal && planned.exit <= full.exit);
            // Above the pace only what the length cannot take away.
            let least = (planned.entry.squared() - reach).max(0.0).sqrt();
            prop_assert!(planned.exit <= capped || planned.exit.mm_per_s() <= least * (1.0 + 1e-6) + 1e-3);
        }
        prop_assert_eq!(speed, Speed::ZERO);
    }
}

/// A straight line in pieces of 0.05 mm, four steps each.
fn pieces_of_a_line(filament_100pm: i64) -> Vec<Move> {
    (1..=800).map(|line| Move { line, ..request([i64::from(line) * 5_000, 0, 0], filament_100pm, 60.0) }).collect()
}

#[test]
fn a_line_in_short_pieces_takes_an_eighth_of_the_places() {
    let machine = geometry(Kinematics::Cartesian, [80.0, 80.0, 400.0, 95.0]);
    assert_eq!(blocks(machine, 128, &pieces_of_a_line(0)).len(), 100);
    let (planner, player) = plan(machine, &pieces_of_a_line(0), false);
    assert_eq!(planner.merged_moves(), 700);
    assert_eq!(ends(&player).iter().map(|end| end.1).collect::<Vec<_>>(), (1..=800).collect::<Vec<_>>());
    // The extruder's steps need not fall as evenly.
    let with_filament = blocks(machine, 128, &pieces_of_a_line(40_000)).len();
    assert!(with_filament < 120, "{with_filament}");
}

#[test]
fn a_circle_in_short_pieces_takes_fewer_places_than_pieces() {
    // 50 mm radius, 0.05 mm a piece: a third of the ends fall on the steps of a longer chord.
    let machine = geometry(Kinematics::Cartesian, [80.0, 80.0, 400.0, 95.0]);
    let pieces = 6_283;
    let moves: Vec<_> = (1..=pieces)
        .map(|line| {
            let angle = f64::from(line) / f64::from(pieces) * core::f64::consts::TAU;
            let [x, y] = [angle.cos() - 1.0, angle.sin()].map(|share| (share * 5_000_000.0).round() as i64);
            Move { line, ..request([x, y, 0], 20_000, 60.0) }
        })
        .collect();
    let count = blocks(machine, 128, &moves).len();
    assert!(count < 4_600, "{count}");
}
