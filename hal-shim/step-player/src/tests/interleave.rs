//! Every interleaving of the planner task with the step interrupt.
//!
//! The interrupt runs to completion; the task may be interrupted between any two accesses to shared
//! memory. So a schedule is a list of how many times the interrupt comes at each access. All
//! schedules of a small ring are tried.

use std::cell::RefCell;
use std::collections::VecDeque;

use crate::interrupted_access::interrupted;

/// All choices of how often the interrupt comes at each access, up to a total number of interrupts:
/// a depth-first walk over the tree of choices.
#[derive(Default)]
struct Choices {
    taken: Vec<(u32, u32)>,
    at: usize,
}

impl Choices {
    fn choose(&mut self, options: u32) -> u32 {
        if self.at == self.taken.len() {
            self.taken.push((0, options));
        }
        let (choice, _) = self.taken[self.at];
        self.at += 1;
        choice
    }

    /// Advances to the next path; `false` after the last.
    fn advance(&mut self) -> bool {
        self.at = 0;
        while let Some((choice, options)) = self.taken.pop() {
            if choice + 1 < options {
                self.taken.push((choice + 1, options));
                return true;
            }
        }
        false
    }
}

use super::model::{Interrupt, SIGNALS};
use crate::*;
use ferrostep_planner::StepEntry;
use std::rc::Rc;

type Board = Interrupt<BothEdges, 1, 8>;

/// Runs the task once for every schedule of at most `most` interrupts.
fn every_schedule(most: u32, mut task: impl FnMut(&'static Board, &mut dyn FnMut(&mut dyn FnMut()))) -> u64 {
    let choices = Rc::new(RefCell::new(Choices::default()));
    let mut schedules = 0;
    loop {
        // Leaked, a few hundred bytes per schedule: the borrow checker cannot see that the
        // interrupt does not outlive it.
        let machine = Board::leaked();
        let left = Rc::new(std::cell::Cell::new(most));
        let mut run = |piece: &mut dyn FnMut()| {
            let (choices, left) = (choices.clone(), left.clone());
            let interrupt = move || {
                let times = choices.borrow_mut().choose(left.get().min(2) + 1);
                left.set(left.get() - times);
                for _ in 0..times {
                    machine.update();
                }
            };
            interrupted(interrupt, piece);
        };
        task(machine, &mut run);
        schedules += 1;
        if !choices.borrow_mut().advance() {
            return schedules;
        }
    }
}

/// Steps in the port's log, as masks of changed pins.
fn toggles(machine: &Board) -> Vec<u16> {
    machine.ports[0].changes().into_iter().map(|(_, _, changed)| changed).collect()
}

#[test]
fn no_schedule_loses_or_doubles_an_event() {
    let schedules = every_schedule(4, |machine, run| {
        let mut feeder = machine.feeder(SIGNALS);
        let entries = [
            StepEntry::stair(400, 1, 1, 2).unwrap(),
            StepEntry::stair(190, 2, 2, 0).unwrap(),
            StepEntry::stair(180, 1, 3, 0).unwrap(),
        ];
        let mut expected: VecDeque<u16> = VecDeque::from([3, 2, 2, 3]);
        machine.start(&mut feeder);
        let mut pushed = entries.iter();
        run(&mut || {
            for entry in pushed.by_ref() {
                feeder.push(*entry).unwrap();
                machine.start(&mut feeder);
            }
            feeder.seal();
            machine.start(&mut feeder);
        });
        for _ in 0..20 {
            machine.update();
            machine.start(&mut feeder);
        }
        for toggle in toggles(machine) {
            assert_eq!(Some(toggle), expected.pop_front());
        }
        assert!(expected.is_empty());
        assert_eq!(feeder.waiting(), 0);
    });
    assert!(schedules > 10_000, "{schedules}");
}

#[test]
fn a_full_ring_is_refused_and_filled_again_in_every_schedule() {
    let schedules = every_schedule(3, |machine, run| {
        let mut feeder = machine.feeder(SIGNALS);
        let entry = StepEntry::stair(200, 1, 1, 0).unwrap();
        let mut pushed = 0;
        while feeder.push(entry).is_ok() {
            pushed += 1;
        }
        machine.start(&mut feeder);
        run(&mut || {
            for _ in 0..2 {
                pushed += usize::from(feeder.push(entry).is_ok());
            }
        });
        feeder.seal();
        for _ in 0..30 {
            machine.update();
            machine.start(&mut feeder);
        }
        assert_eq!(toggles(machine).len(), pushed);
    });
    assert!(schedules > 20, "{schedules}");
}

#[test]
fn a_stop_at_every_moment_knows_what_was_not_played() {
    let schedules = every_schedule(4, |machine, run| {
        let mut feeder = machine.feeder(SIGNALS);
        machine.start(&mut feeder);
        let mut dropped = None;
        run(&mut || {
            feeder.push(StepEntry::stair(200, 2, 1, 2).unwrap()).unwrap();
            feeder.push(StepEntry::directions(1)).unwrap();
            feeder.push(StepEntry::stair(200, 2, 1, 0).unwrap()).unwrap();
            machine.start(&mut feeder);
        });
        // From here on the interrupt is masked.
        dropped = dropped.or(Some(feeder.drop_all()));
        let dropped = dropped.unwrap();
        let played = machine.ports[0].steps();
        assert_eq!([dropped.signed[0] + played[0], dropped.signed[1] + played[1]], [0, 1]);
        // The interrupt runs again, from the present signal levels.
        let before = machine.ports[0].steps();
        feeder.push(StepEntry::stair(200, 3, 3, 0).unwrap()).unwrap();
        feeder.seal();
        machine.start(&mut feeder);
        for word in feeder.rest_words() {
            machine.ports[0].put_out(word);
        }
        for _ in 0..10 {
            machine.update();
        }
        let after = machine.ports[0].steps();
        assert_eq!([after[0] - before[0], after[1] - before[1]], [-3, 3]);
    });
    assert!(schedules > 1_000, "{schedules}");
}
