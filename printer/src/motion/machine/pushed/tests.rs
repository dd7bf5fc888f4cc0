//! The count of pushed filament against the extruder's places themselves.

use proptest::prelude::*;

use super::*;
use crate::motion::machine::timeline::Timeline;

/// A slot of the queue: how long it lasts, ticks, and how far the extruder is moved in it, steps.
type Step = (u64, i64);

fn slots() -> impl Strategy<Value = Vec<Step>> {
    // Lines, travels, retractions and their recoveries, in runs of slots.
    let run = (1usize..60, 50_000u64..400_000, -3i64..=5);
    proptest::collection::vec(run, 1..60).prop_map(|runs| {
        runs.into_iter().flat_map(|(count, ticks, steps)| std::iter::repeat_n((ticks, steps), count)).collect()
    })
}

/// A queue as the planner fills it and the motors empty it, and the plain truth beside it: where
/// the extruder was after each slot.
#[derive(Default)]
struct Run {
    count: FilamentCount,
    timeline: Timeline,
    queued: Vec<Step>,
    tick: u64,
    extruder: i64,
    /// Slots played, and the extruder's steps in them.
    played: usize,
    played_extruder: i64,
    furthest: i64,
    new_steps: i64,
}

impl Run {
    fn queue(&mut self, (ticks, steps): Step) {
        self.tick += ticks;
        self.extruder += steps;
        self.queued.push((ticks, steps));
        self.count.follow(self.extruder);
        self.timeline.mark(self.queued.len() as u32, self.tick, self.count.at_end());
    }

    fn play(&mut self) {
        let Some(&(_, steps)) = self.queued.get(self.played) else { return };
        self.played += 1;
        self.played_extruder += steps;
        self.new_steps += (self.played_extruder - self.furthest).max(0);
        self.furthest = self.furthest.max(self.played_extruder);
        self.timeline.pass(self.played as u32);
    }

    /// Everything that was not played is dropped.
    fn stop(&mut self) {
        let played = self.timeline.pushed(self.count.at_end()).at_least;
        self.queued.truncate(self.played);
        self.extruder = self.played_extruder;
        self.count.stop_at(played, self.extruder);
        self.timeline.clear(self.tick, self.count.at_end());
    }

    fn pushed(&self) -> PushedFilament {
        self.timeline.pushed(self.count.at_end())
    }
}

fn steps(pushed: Pushed) -> i64 {
    i64::from(pushed.steps_since(Pushed::NONE))
}

proptest! {
    #[test]
    fn new_filament_is_between_two_marks_of_the_queue(slots in slots(), ahead in 1usize..400) {
        let mut run = Run::default();
        for (index, &slot) in slots.iter().enumerate() {
            run.queue(slot);
            if index >= ahead {
                run.play();
            }
            let PushedFilament { at_least, at_most } = run.pushed();
            prop_assert!(steps(at_least) <= run.new_steps, "{:?} of {}", at_least, run.new_steps);
            prop_assert!(run.new_steps <= steps(at_most), "{:?} of {}", at_most, run.new_steps);
            // Marks are a thirtieth of the queue apart, twice that where they were thinned out, and
            // no nearer than their slots.
            let spacing = (ahead as i64 / 12).max(1) + 2 * 2;
            prop_assert!(steps(at_most) - steps(at_least) <= 5 * 8 * spacing, "{:?}", run.pushed());
        }
        while run.played < slots.len() {
            run.play();
        }
        prop_assert_eq!(steps(run.count.at_end()), run.new_steps);
    }

    /// No filament that was drawn back counts as new after a stop, and only the part between
    /// two marks is lost.
    #[test]
    fn a_stop_forgets_what_was_not_played(
        before in slots(), after in slots(), played in 0usize..2000,
    ) {
        let mut run = Run::default();
        before.iter().for_each(|&slot| run.queue(slot));
        (0..played).for_each(|_| run.play());
        let [at_least, at_most] = [run.pushed().at_least, run.pushed().at_most].map(steps);
        run.stop();
        let unsure = at_most - at_least;
        after.iter().for_each(|&slot| run.queue(slot));
        after.iter().for_each(|_| run.play());
        let counted = steps(run.count.at_end());
        prop_assert!((run.new_steps - unsure..=run.new_steps + unsure).contains(&counted), "{counted} of {}", run.new_steps);
    }
}

#[test]
fn only_what_is_beyond_the_furthest_point_is_new_and_counts_wrap() {
    let mut count = FilamentCount::default();
    for (extruder, new) in [(10, 10), (4, 10), (10, 10), (11, 11)] {
        count.follow(extruder);
        assert_eq!(steps(count.at_end()), new, "{extruder}");
    }
    let mut extruder = 11;
    let earlier = loop {
        extruder += 1 << 29;
        count.follow(extruder);
        if extruder > 1 << 34 {
            break count.at_end();
        }
    };
    count.follow(extruder + 5);
    assert_eq!(count.at_end().steps_since(earlier), 5);
    assert_eq!(earlier.steps_since(count.at_end()), 0, "a later place");
}
