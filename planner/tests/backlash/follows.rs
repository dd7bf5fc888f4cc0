//! The axes are where the plan has them, and the plan's own steps come when they would.

use ferrostep_planner::Move;
use ferrostep_planner::backlash::Backlash;
use proptest::prelude::*;

use crate::backlash::axis::Axis;
use crate::backlash::machine::{Bench, Event, LIMITS, MM, STEPS_PER_MM, any_backlash, any_path, plan};

/// Steps of the play of each axis.
pub fn play_steps(backlash: &Backlash) -> [i64; 3] {
    [0, 1, 2].map(|axis| (backlash.play_mm[axis] * backlash.correction * STEPS_PER_MM[axis]).round() as i64)
}

/// Progress of the plan since a motor turned.
#[derive(Clone, Copy, Default)]
struct Since {
    way_10nm: i64,
    /// Ticks since the last of the events in which the motor can have taken up play, and how
    /// many there were.
    ticks: u64,
    events: i64,
    /// Steps of the motor.
    steps: i64,
    was_in_place: bool,
    is_in_place: bool,
}

impl Since {
    /// True if the play is taken up by now, and the axis moves along: one that turned before it was
    /// there stays where it was until its motor has moved on by the play.
    fn is_far(&self, play: i64, backlash: &Backlash) -> bool {
        // The last step may be late by some events: where two of them are near each other,
        // none fits between. A stop may have undone the first of them, and the way to the next
        // one is whole then.
        let far_10nm = (1.1 * backlash.smoothing_mm * MM as f64) as i64 + 20_000;
        self.way_10nm > far_10nm && self.events > 2 * play + 5 && (self.was_in_place || self.steps > play)
    }
}

/// Three axes with play, the plan, and how long ago its motors turned.
pub struct Axes {
    axes: [Axis; 3],
    motors: [i64; 3],
    plan: [i64; 3],
    ways: [i64; 3],
    since: [Since; 3],
    tick: u64,
    /// Expected offset of an axis from its plan: it begins at the side to which its
    /// motor moves first.
    offsets: [Option<i64>; 3],
    /// Events at which an axis had to be at its place.
    pub looked_at: usize,
    /// The most that an axis was off in these.
    pub most: i64,
}

impl Axes {
    pub fn new(backlash: &Backlash) -> Self {
        Self {
            axes: play_steps(backlash).map(Axis::new),
            motors: [0; 3],
            plan: [0; 3],
            ways: [0; 3],
            since: [Since { was_in_place: true, ..Since::default() }; 3],
            tick: 0,
            offsets: [None; 3],
            looked_at: 0,
            most: 0,
        }
    }

    /// Steps of each motor for its play.
    pub fn taken_up(&self) -> [i64; 3] {
        [0, 1, 2].map(|axis| self.motors[axis] - self.plan[axis])
    }

    /// Takes note of a standstill: the axes are not checked until their motors have moved far
    /// enough anew. The motors' next event is at this tick or later.
    pub fn rest(&mut self, tick: u64) {
        (self.since, self.tick) = ([Since::default(); 3], tick);
    }

    /// Takes an event of the motors.
    pub fn step(&mut self, (_, axes, directions): Event) {
        for axis in (0..3).filter(|axis| axes >> axis & 1 == 1) {
            let way = if directions >> axis & 1 == 0 { 1 } else { -1 };
            if self.offsets[axis].is_none() {
                let play = play_of(&self.axes[axis]);
                let offset = if way == 1 { -play } else { 0 };
                (self.axes[axis].place, self.offsets[axis]) = (offset, Some(offset));
            }
            self.motors[axis] += way;
            self.axes[axis].follow(self.motors[axis]);
        }
    }

    /// Takes an event of the plan, after the motors' steps up to its tick, and checks the
    /// places of the axes.
    pub fn plan(&mut self, (tick, axes, directions): Event, backlash: &Backlash) {
        let way_10nm: i64 =
            (0..3).filter(|axis| axes >> axis & 1 == 1).map(|axis| (MM as f64 / STEPS_PER_MM[axis]) as i64).sum();
        for (axis, play) in (0..3).zip(play_steps(backlash)) {
            let since = &mut self.since[axis];
            since.way_10nm += way_10nm;
            since.ticks += tick - self.tick;
            if since.ticks as f64 >= 84e6 / (LIMITS.max_feed_mm_per_s[axis] * STEPS_PER_MM[axis] * 0.25) {
                (since.ticks, since.events) = (0, since.events + 1);
            }
            if axes >> axis & 1 == 1 {
                let way = if directions >> axis & 1 == 0 { 1 } else { -1 };
                if way != self.ways[axis] {
                    self.ways[axis] = way;
                    *since = Since { way_10nm, was_in_place: since.is_in_place, ..Since::default() };
                }
                since.steps += 1;
                self.plan[axis] += way;
            }
            let Some(offset) = self.offsets[axis] else { continue };
            let off = (self.axes[axis].place - self.plan[axis] - offset).abs();
            assert!(off <= play, "axis {axis} is off by {off} of {play} steps");
            since.is_in_place |= since.is_far(play, backlash);
            if since.is_in_place {
                self.looked_at += 1;
                self.most = self.most.max(off);
            }
        }
        self.tick = tick;
    }

    /// Follows both runs.
    pub fn follow(&mut self, plain: &[Event], corrected: &[Event], backlash: &Backlash) {
        let mut events = corrected.iter().peekable();
        for event in plain {
            while let Some(step) = events.next_if(|step| step.0 <= event.0) {
                self.step(*step);
            }
            self.plan(*event, backlash);
        }
        // After a stop, a step may come before the plan's next one.
        events.for_each(|step| self.step(*step));
    }
}

fn play_of(axis: &Axis) -> i64 {
    let mut other = *axis;
    other.follow(axis.place + 1_000_000);
    axis.place + 1_000_000 - other.place
}

/// Each step of the plan is among the others, at its time.
fn check_plan(plain: &[Event], corrected: &[Event]) -> Result<(), TestCaseError> {
    let mut events = corrected.iter();
    for (tick, axes, directions) in plain {
        let found = events.find(|event| event.0 == *tick);
        let Some((_, all, ways)) = found else { return Err(TestCaseError::fail(format!("no event at {tick}"))) };
        prop_assert_eq!(all & axes, *axes);
        prop_assert_eq!(ways & axes, *directions);
    }
    prop_assert_eq!(events.next(), None);
    Ok(())
}

proptest! {
    #![proptest_config(ferrostep_random_cases::cases(300))]

    /// The axes are in their place soon after each reversal, and never off by more than the play.
    #[test]
    fn axes_follow_the_plan(path in any_path(), backlash in any_backlash(), shaped in any::<bool>()) {
        let portions = plan(&path, shaped);
        let (mut plain, mut corrected) = (Bench::new(&Backlash::NONE), Bench::new(&backlash));
        plain.run(&portions, false);
        corrected.run(&portions, false);
        prop_assert_eq!((plain.miscounts, corrected.miscounts), (0, 0));
        check_plan(&plain.seen.0, &corrected.seen.0)?;
        let mut axes = Axes::new(&backlash);
        axes.follow(&plain.seen.0, &corrected.seen.0, &backlash);
        prop_assert_eq!(axes.most, 0);
    }
}

/// X and Y there and back, as infill has it.
fn zigzag() -> Vec<Move> {
    let place = |line: i64| if line % 2 == 1 { [20 * MM, line * MM / 2, 0] } else { [0, line * MM / 2 - MM, 0] };
    let to = |line| Move {
        target_10nm: place(line),
        filament_100pm: 0,
        feed_mm_per_s: 80.0,
        line: line as u32,
        ends_move: true,
    };
    (1..40).map(to).collect()
}

#[test]
fn an_infill_is_where_it_is_to_be_but_for_the_way_after_a_reversal() {
    let backlash = Backlash { play_mm: [0.2, 0.1, 0.0], correction: 1.0, smoothing_mm: 2.0 };
    let portions = plan(&zigzag(), false);
    let mut plain = Bench::new(&Backlash::NONE);
    plain.run(&portions, false);
    // Uncorrected axes are off by the play on every second line.
    let mut axes = Axes::new(&backlash);
    axes.follow(&plain.seen.0, &plain.seen.0, &backlash);
    assert_eq!(axes.most, 16);
    let mut corrected = Bench::new(&backlash);
    corrected.run(&portions, false);
    let mut axes = Axes::new(&backlash);
    axes.follow(&plain.seen.0, &corrected.seen.0, &backlash);
    assert_eq!(axes.most, 0);
    // Two of the three axes: Z never moves.
    assert!(axes.looked_at * 10 > plain.seen.0.len() * 2 * 8, "{} of {}", axes.looked_at, plain.seen.0.len());
    // The steps are spread over the way: no two of X's are nearer than half of the time between
    // two of the plan's.
    let nearest = |events: &[Event]| {
        let ticks: Vec<u64> = events.iter().filter(|event| event.1 & 1 == 1).map(|event| event.0).collect();
        ticks.windows(2).map(|pair| pair[1] - pair[0]).min().unwrap()
    };
    assert!(nearest(&corrected.seen.0) * 2 + 2 >= nearest(&plain.seen.0));
}

#[test]
fn without_play_nothing_changes() {
    let portions = plan(&zigzag(), true);
    let (mut plain, mut corrected) =
        (Bench::new(&Backlash::NONE), Bench::new(&Backlash { play_mm: [0.0, 0.0, 0.05], ..Backlash::NONE }));
    plain.run(&portions, false);
    corrected.run(&portions, false);
    assert_eq!(plain.entries, corrected.entries);
}

#[test]
fn towards_a_sensor_play_is_taken_up_as_soon_as_the_motor_can() {
    let backlash = Backlash { play_mm: [0.2, 0.0, 0.0], correction: 1.0, smoothing_mm: 50.0 };
    let to = |x: i64, line| Move {
        target_10nm: [x * MM, 0, 0],
        filament_100pm: 0,
        feed_mm_per_s: 20.0,
        line,
        ends_move: true,
    };
    let mut bench = Bench::new(&backlash);
    let portions = plan(&[to(5, 1), to(4, 2)], false);
    bench.run(&portions, true);
    let [x, ..] = bench.ledger.motor_steps();
    assert_eq!(x, 4 * 80 - 16);
}
