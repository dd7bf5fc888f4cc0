//! The flags between planner task and interrupt, above all after a stop.

use super::model::{Interrupt, SIGNALS};
use crate::*;
use ferrostep_planner::StepEntry;

type Board<M> = Interrupt<M, 1, 64>;

fn stair(count: u16) -> StepEntry {
    StepEntry::stair(1_000, count, 0b1, 0).unwrap()
}

/// Queues some steps and starts them.
fn start<M: Stepping + 'static>(board: &'static Board<M>, feeder: &mut StepFeeder<'static, M, 1, 64>, steps: u16) {
    feeder.push(stair(steps)).unwrap();
    feeder.seal();
    assert!(board.start(feeder));
}

/// Steps of the first motor.
fn steps<M: Stepping>(board: &Board<M>) -> usize {
    board.ports[0].changes().len() / M::EVENTS_A_STEP as usize
}

/// Checks that no flag is left after a stop, whenever it comes and whatever the flags were, and
/// that the next motion is complete.
fn assert_no_flag_is_left<M: Stepping + 'static>() {
    for updates in 0..30 {
        for sensor in [false, true] {
            let board = Board::<M>::leaked();
            let mut feeder = board.feeder(SIGNALS);
            let link = board.player.link();
            start(board, &mut feeder, 10);
            for _ in 0..updates {
                board.update();
            }
            board.timer.mask();
            if sensor {
                link.request_sensor_stop()
            } else {
                link.request_stop()
            }
            assert!(link.is_stopping());
            assert_eq!(feeder.drop_all().requested, !sensor);
            for (port, word) in board.ports.iter().zip(feeder.rest_words()) {
                port.put_out(word);
            }
            assert!(!link.is_running() && !link.is_stopping());
            assert!(!link.take_ran_dry(), "after {updates} updates it has run dry");
            assert!(!feeder.start(), "the queue is empty");
            // No step comes early, and none is added.
            let before = steps(board);
            start(board, &mut feeder, 7);
            assert_eq!(steps(board), before, "a step at the start, {updates} updates before the stop");
            for _ in 0..40 {
                board.update();
            }
            assert_eq!(steps(board) - before, 7);
            assert!(link.take_ran_dry() && !link.take_ran_dry() && !link.is_running());
        }
    }
}

#[test]
fn after_a_stop_no_flag_is_left() {
    assert_no_flag_is_left::<BothEdges>();
    assert_no_flag_is_left::<Pulses>();
}

/// A stop that was requested is never taken for the sensor's, whichever came first.
#[test]
fn a_sensor_does_not_hide_a_stop() {
    let link = StepLink::new();
    assert!(!link.is_stopping() && !link.stopped());
    link.request_sensor_stop();
    assert!(link.is_stopping() && !link.stopped());
    for sensor_first in [false, true] {
        if sensor_first {
            link.request_sensor_stop();
        }
        link.request_stop();
        if !sensor_first {
            link.request_sensor_stop();
        }
        assert!(link.is_stopping() && link.stopped());
        assert!(!link.is_stopping() && !link.stopped());
    }
}

/// Each flag reports what happened, once.
#[test]
fn flags_are_taken_once() {
    let link = StepLink::default();
    assert!(!link.is_running() && !link.take_ran_dry());
    link.start();
    assert!(link.is_running() && !link.take_ran_dry());
    link.run_dry();
    assert!(!link.is_running() && link.take_ran_dry() && !link.take_ran_dry());
}
