//! Motion that ends before its plan: at a sensor, or by a stop.

use super::*;

#[test]
fn a_seek_ends_at_the_event_that_triggers() {
    with_queue(|queue, mut interrupt| {
        let queue = ModelledSensors::new(queue, profile().virtual_motors());
        let mut machine = Machine::new(&profile(), vec![Slot::EMPTY; 8], queue);
        // The head is truly at 60 mm, where the machine believes 0.
        let _ = machine.add(&travel(-100, 0)).unwrap();
        machine.begin_seek(0);
        run_until_idle(&mut machine, &mut interrupt);
        assert_eq!(machine.take_homing_result(), Some(Ok(HomingOutcome::Triggered)));
        assert_eq!(interrupt.motor_steps(), [-4800, 0, 0, 0]);
        assert_eq!(machine.position_10nm(), [-6_000_000, 0, 0]);
        machine.set_position([0; 3]);
        assert_eq!(machine.motor_steps(), [0; 4]);
        // Already there: not a step.
        let _ = machine.add(&travel(-10, 0)).unwrap();
        machine.begin_seek(0);
        run_until_idle(&mut machine, &mut interrupt);
        assert_eq!(
            (machine.take_homing_result(), interrupt.motor_steps()),
            (Some(Ok(HomingOutcome::Triggered)), [-4800, 0, 0, 0])
        );
        // Y is at 50 mm and goes 10 mm only.
        let _ = machine.add(&travel(0, -10)).unwrap();
        machine.begin_seek(1);
        assert_eq!(machine.take_homing_result(), None);
        run_until_idle(&mut machine, &mut interrupt);
        assert_eq!(
            (machine.take_homing_result(), interrupt.motor_steps()),
            (Some(Ok(HomingOutcome::Missed)), [-4800, -800, 0, 0])
        );
    });
}

#[test]
fn a_sensor_of_the_board_stops_the_motors_where_they_stand() {
    with_machine(32, |mut machine, mut interrupt| {
        // Fast, on steps that are queued far ahead: it triggers 1.5 mm on its way.
        interrupt.sensors.trigger_at.set(-120);
        machine.add(&travel(-30, 0)).unwrap();
        machine.begin_seek(0);
        assert_eq!(interrupt.sensors.watched.get(), Some(0));
        let mut planned = 0;
        while machine.take_homing_result().is_none_or(|result| {
            assert_eq!(result, Ok(HomingOutcome::Triggered));
            false
        }) {
            machine.work(NO_SILENCE);
            planned = planned.min(machine.motor_steps()[0]);
            interrupt.update();
        }
        assert!(planned < -1000, "{planned}");
        // Not one step after the one that triggered, and the machine reports the same.
        assert_eq!((interrupt.motor_steps()[0], machine.motor_steps()[0]), (-120, -120));
        assert_eq!((machine.position_10nm()[0], machine.stops()), (-150_000, 0));
        assert_eq!(interrupt.sensors.watched.get(), None);
        // Away from it, and towards it again from its released side.
        machine.add(&travel(3, 0)).unwrap();
        machine.flush();
        run_until_idle(&mut machine, &mut interrupt);
        assert_eq!(interrupt.motor_steps()[0], 240);
        // It is triggered already: no motor moves.
        interrupt.sensors.trigger_at.set(1000);
        machine.add(&travel(-30, 0)).unwrap();
        machine.begin_seek(0);
        assert_eq!(machine.take_homing_result(), Some(Ok(HomingOutcome::Triggered)));
        run_until_idle(&mut machine, &mut interrupt);
        assert_eq!((interrupt.motor_steps()[0], interrupt.sensors.watched.get()), (240, None));
        // It never triggers.
        interrupt.sensors.trigger_at.set(-10_000);
        machine.add(&travel(0, 0)).unwrap();
        machine.begin_seek(0);
        run_until_idle(&mut machine, &mut interrupt);
        assert_eq!(machine.take_homing_result(), Some(Ok(HomingOutcome::Missed)));
        assert_eq!((interrupt.motor_steps()[0], interrupt.sensors.watched.get()), (0, None));
    });
}

#[test]
fn a_requested_stop_during_a_seek_is_not_the_sensor_s() {
    with_machine(32, |mut machine, mut interrupt| {
        interrupt.sensors.trigger_at.set(-10_000);
        machine.add(&travel(-30, 0)).unwrap();
        machine.begin_seek(0);
        for _ in 0..100 {
            machine.work(NO_SILENCE);
            interrupt.update();
        }
        machine.request_stop();
        // The sensor comes too late.
        interrupt.player.link().request_sensor_stop();
        machine.work(NO_SILENCE);
        // The stop ends the seek with an error: a command that waits for it returns.
        assert_eq!((machine.stops(), machine.take_homing_result()), (1, Some(Err(MotionError::Stopped))));
        assert_eq!(interrupt.sensors.watched.get(), None);
        assert_eq!(machine.motor_steps(), interrupt.motor_steps());
        // And later still: it does not count as another stop.
        interrupt.player.link().request_sensor_stop();
        machine.work(NO_SILENCE);
        assert_eq!((machine.stops(), machine.is_idle()), (1, true));
    });
}

#[test]
fn a_sensor_s_edge_before_its_level_is_looked_at_ends_the_seek_once() {
    with_machine(32, |mut machine, mut interrupt| {
        // It triggers at the motor's present place: level and edge report the same.
        interrupt.sensors.trigger_at.set(1000);
        machine.add(&travel(-30, 0)).unwrap();
        machine.begin_seek(0);
        interrupt.player.link().request_sensor_stop();
        assert_eq!(machine.take_homing_result(), None);
        machine.work(NO_SILENCE);
        assert_eq!((machine.take_homing_result(), machine.stops()), (Some(Ok(HomingOutcome::Triggered)), 0));
        run_until_idle(&mut machine, &mut interrupt);
        assert_eq!(interrupt.motor_steps(), [0; 4]);
    });
}

#[test]
fn a_stop_before_a_seek_is_planned_ends_it() {
    with_machine(32, |mut machine, _| {
        machine.add(&travel(-30, 0)).unwrap();
        machine.request_stop();
        machine.begin_seek(0);
        machine.work(NO_SILENCE);
        assert_eq!((machine.take_homing_result(), machine.stops()), (Some(Err(MotionError::Stopped)), 1));
        // The move is gone; a seek that begins after it has no move to wait for, and reports so.
        machine.work(NO_SILENCE);
        assert_eq!(machine.take_homing_result(), Some(Err(MotionError::Stopped)));
    });
}

#[test]
fn a_stop_that_comes_while_another_is_followed_is_not_lost() {
    with_machine(32, |mut machine, interrupt| {
        machine.add(&travel(-30, 0)).unwrap();
        machine.begin_seek(0);
        machine.work(NO_SILENCE);
        interrupt.player.link().request_sensor_stop();
        machine.request_stop();
        machine.work(NO_SILENCE);
        assert_eq!((machine.take_homing_result(), machine.stops()), (Some(Err(MotionError::Stopped)), 1));
    });
}
