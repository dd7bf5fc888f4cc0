//! The player against the virtual board's motors, which play the same entries the plain way.

use std::collections::VecDeque;

use super::*;
use crate::virtual_board::{StepObserver, StepTimer};
use proptest::prelude::*;

/// A timer with a preloaded reload register, pins, and a queue.
#[derive(Default)]
struct Bench {
    link: StepLink,
    queue: VecDeque<StepEntry>,
    player: StepPlayer,
    now: u64,
    /// Interval that runs, and the one written for after the next update.
    running: u32,
    preloaded: u32,
    directions: u8,
    events: Vec<(u64, u8, u8)>,
}

impl Bench {
    fn new(entries: &[StepEntry]) -> Self {
        Self { queue: entries.iter().copied().collect(), running: IDLE_TICKS, preloaded: IDLE_TICKS, ..Self::default() }
    }

    fn update(&mut self) {
        self.now += u64::from(self.running);
        self.running = self.preloaded;
        let axes = self.player.due_axes(&self.link);
        if axes != 0 {
            self.events.push((self.now, axes, self.directions & axes));
        }
        let queue = &mut self.queue;
        let next = self.player.advance(&self.link, || queue.pop_front());
        self.preloaded = next.interval_ticks;
        assert!((2..=1 << 21).contains(&self.preloaded));
        if let Some(directions) = next.directions {
            self.directions = directions;
        }
    }

    fn run(&mut self) {
        self.link.start();
        while self.link.is_busy() {
            self.update();
        }
    }
}

#[derive(Default)]
struct Events(Vec<(u64, u8, u8)>);

impl StepObserver for Events {
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        self.0.push((tick, axes, directions));
    }
}

fn any_entry() -> impl Strategy<Value = StepEntry> {
    prop_oneof![
        6 => (2u32..100_000, 1u16..70, 1u8..16, 0u8..16).prop_map(|(t, n, a, b)| StepEntry::stair(t, n, a, b).unwrap()),
        1 => (2u32..100_000_000, 1u16..4, 1u8..16).prop_map(|(t, n, a)| StepEntry::stair(t, n, a, 0).unwrap()),
        1 => (2u32..=u32::MAX).prop_map(StepEntry::wait),
        2 => (0u8..16).prop_map(StepEntry::directions),
    ]
}

proptest! {
    #[test]
    fn the_pins_show_what_the_entries_say(entries in proptest::collection::vec(any_entry(), 0..40)) {
        let (mut plain, mut expected) = (StepTimer::default(), Events::default());
        for entry in &entries {
            plain.play(*entry, &mut expected);
        }
        let mut bench = Bench::new(&entries);
        bench.run();
        prop_assert!(bench.link.take_ran_dry() && !bench.link.is_running());
        prop_assert_eq!(bench.directions, plain.directions());
        prop_assert_eq!(bench.events.len(), expected.0.len());
        // The motion clock starts when the first entry has been found.
        for (seen, meant) in bench.events.iter().zip(&expected.0) {
            prop_assert_eq!((seen.0 - 2 * u64::from(IDLE_TICKS), seen.1, seen.2), *meant);
        }
    }

    #[test]
    fn a_stop_counts_every_step_that_was_not_made(
        entries in proptest::collection::vec(any_entry(), 1..120), updates in 0usize..400,
    ) {
        let mut all = StepTimer::default();
        for entry in &entries {
            all.play(*entry, &mut ());
        }
        let mut bench = Bench::new(&entries);
        bench.link.start();
        for _ in 0..updates {
            bench.update();
        }
        let before = bench.events.len();
        bench.link.request_stop();
        prop_assert_eq!(bench.link.take_stopped(), None);
        let mut dropped = None;
        for _ in 0..8 {
            bench.update();
            dropped = dropped.or(bench.link.take_stopped());
        }
        prop_assert_eq!(bench.events.len(), before, "steps after the stop");
        let dropped = dropped.unwrap();
        let mut made = [0i64; 4];
        for (_, axes, directions) in &bench.events {
            for (motor, made) in made.iter_mut().enumerate() {
                *made += i64::from(axes >> motor & 1) * (1 - 2 * i64::from(directions >> motor & 1));
            }
        }
        all.take_back(dropped.signed, dropped.issued);
        prop_assert_eq!(all.motor_steps(), made);
        prop_assert_eq!(all.issued().iter().sum::<u64>(), bench.events.iter().map(|event| u64::from(event.1.count_ones())).sum());
        prop_assert_eq!(bench.directions, all.directions());
        // And it runs again.
        bench.queue.push_back(StepEntry::stair(100, 3, 1, 0).unwrap());
        bench.run();
        prop_assert_eq!(bench.events.len(), before + 3);
    }
}

#[test]
fn entries_wait_until_the_player_is_started() {
    let mut bench = Bench::new(&[StepEntry::stair(100, 3, 1, 0).unwrap()]);
    for _ in 0..10 {
        bench.update();
    }
    assert!(bench.events.is_empty() && !bench.link.is_busy());
    bench.run();
    assert_eq!(bench.events.len(), 3);
}
