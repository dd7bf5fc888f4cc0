//! Comparison of the pins with the entries' steps.

use super::model::{CYCLES_A_TICK, Edges, Interrupt, SIGNALS, any_stair};
use crate::*;
use ferrostep_planner::StepEntry;
use ferrostep_planner::{StepLedger, StepObserver};
use proptest::prelude::*;

#[derive(Default)]
struct Events(Vec<(u64, u8, u8)>);

impl StepObserver for Events {
    fn stepped(&mut self, tick: u64, axes: u8, directions: u8) {
        self.0.push((tick, axes, directions));
    }
}

fn plain(entries: &[StepEntry]) -> (StepLedger, Vec<(u64, u8, u8)>) {
    let (mut plain, mut expected) = (StepLedger::default(), Events::default());
    for entry in entries {
        plain.play(*entry, &mut expected);
    }
    (plain, expected.0)
}

pub fn any_entry() -> impl Strategy<Value = StepEntry> {
    prop_oneof![
        6 => any_stair(200..100_000),
        2 => any_stair(200..220),
        1 => (200u32..100_000_000, 1u16..4, 1u8..16).prop_map(|(t, n, a)| StepEntry::stair(t, n, a, 0).unwrap()),
        1 => (200u32..=u32::MAX).prop_map(StepEntry::wait),
        2 => (0u8..16).prop_map(StepEntry::directions),
    ]
}

/// Edges of the step pins of all ports: tick, motors that stepped, their directions.
pub fn seen<M: Stepping, const PORTS: usize>(ports: &[Edges; PORTS]) -> Vec<(u64, u8, u8)> {
    let mut times: Vec<u64> = ports.iter().flat_map(Edges::levels).map(|(now, _)| now).collect();
    times.sort_unstable();
    times.dedup();
    let logs = ports.each_ref().map(Edges::levels);
    let mut next = [0; PORTS];
    let mut levels = [0u16; PORTS];
    let mut events = Vec::new();
    for now in times {
        let before = levels;
        for port in 0..PORTS {
            while logs[port].get(next[port]).is_some_and(|(at, _)| *at == now) {
                levels[port] = logs[port][next[port]].1;
                next[port] += 1;
            }
        }
        let (mut axes, mut directions) = (0, 0);
        for motor in 0..4 {
            let (was, is) = (before[motor % PORTS] >> motor & 1, levels[motor % PORTS] >> motor & 1);
            let stepped = if M::EVENTS_A_STEP == 1 { was != is } else { was < is };
            axes |= u8::from(stepped) << motor;
            directions |= (u8::from(stepped) & (levels[(motor + 1) % PORTS] >> (motor + 4) & 1) as u8) << motor;
        }
        if axes != 0 {
            events.push((now / CYCLES_A_TICK, axes, directions));
        }
    }
    events
}

/// Plays entries on time; returns the ports' edges, and the tick at which the motion clock started.
fn play<M: Stepping + 'static, const PORTS: usize>(
    entries: &[StepEntry],
    signals: Signals,
) -> (&'static [Edges; PORTS], u64) {
    let board = Interrupt::<M, PORTS, 64>::leaked();
    let mut feeder = board.feeder(signals);
    let mut entries = entries.iter();
    let mut started = None;
    let mut sealed = false;
    loop {
        while feeder.room() > 0 && !sealed {
            match entries.next() {
                Some(entry) => feeder.push(*entry).unwrap(),
                None => {
                    feeder.seal();
                    sealed = true;
                }
            }
        }
        // The first slot begins with an event without steps, so the clock starts with the next
        // update.
        if started.is_none() && board.start(&mut feeder) {
            let pulse_ticks = if M::EVENTS_A_STEP == 2 { u64::from(signals.pulse_ticks) } else { 0 };
            started = Some(board.timer.next_at() / CYCLES_A_TICK - pulse_ticks);
        }
        board.update();
        if sealed && feeder.waiting() == 0 {
            assert!(!board.player.link().is_running() && board.player.link().take_ran_dry() || entries.len() == 0);
            return (&board.ports, started.unwrap_or(0));
        }
    }
}

fn assert_played<M: Stepping + 'static, const PORTS: usize>(entries: &[StepEntry], signals: Signals) {
    let (_, expected) = plain(entries);
    let (ports, start) = play::<M, PORTS>(entries, signals);
    let seen: Vec<_> =
        seen::<M, PORTS>(ports).into_iter().map(|(tick, axes, directions)| (tick - start, axes, directions)).collect();
    // Reports the first difference only.
    if let Some((seen, expected)) = seen.iter().zip(&expected).find(|(seen, expected)| seen != expected) {
        assert_eq!(seen, expected);
    }
    assert_eq!(seen.len(), expected.len());
    for port in ports {
        let mut last_change = [None; 16];
        let mut last_level = 0;
        for (now, level) in port.levels() {
            for (pin, last) in
                last_change.iter_mut().enumerate().filter(|(pin, _)| (level ^ last_level) >> pin & 1 == 1)
            {
                if let Some(last) = last.replace(now)
                    && pin < 4
                {
                    assert!(now - last >= u64::from(signals.pulse_ticks) * CYCLES_A_TICK, "a pulse is too short");
                }
            }
            last_level = level;
        }
    }
}

proptest! {
    #[test]
    fn both_edges_on_one_port(entries in proptest::collection::vec(any_entry(), 0..40)) {
        assert_played::<BothEdges, 1>(&entries, SIGNALS);
    }

    #[test]
    fn both_edges_on_three_ports(entries in proptest::collection::vec(any_entry(), 0..40)) {
        assert_played::<BothEdges, 3>(&entries, SIGNALS);
    }

    #[test]
    fn both_edges_on_four_ports(entries in proptest::collection::vec(any_entry(), 0..40)) {
        assert_played::<BothEdges, 4>(&entries, SIGNALS);
    }

    #[test]
    fn pulses_on_one_port(entries in proptest::collection::vec(any_entry(), 0..40), pulse_ticks in 84u32..100) {
        assert_played::<Pulses, 1>(&entries, Signals { pulse_ticks, ..SIGNALS });
    }

    #[test]
    fn pulses_on_two_ports(entries in proptest::collection::vec(any_entry(), 0..40), pulse_ticks in 84u32..100) {
        assert_played::<Pulses, 2>(&entries, Signals { pulse_ticks, ..SIGNALS });
    }
}

/// Time between the last change of a motor's direction signal and each of its steps.
#[test]
fn a_direction_is_set_up_before_the_step() {
    let entries: Vec<_> = (0..40)
        .flat_map(|k| {
            [StepEntry::directions(k as u8 & 1), StepEntry::stair(170 + k, 1 + (k % 3) as u16, 1, 0).unwrap()]
        })
        .collect();
    let signals = Signals { pulse_ticks: 84, direction_setup_ticks: 80 };
    for ports in [play::<BothEdges, 1>(&entries, signals).0, play::<Pulses, 1>(&entries, signals).0] {
        let (mut turned, mut before) = (0, 0);
        let mut steps = 0;
        for (now, level) in ports[0].levels() {
            if (level ^ before) >> 4 & 1 == 1 {
                turned = now;
            }
            if (level & !before) & 1 == 1 {
                steps += 1;
                assert!(
                    now - turned >= 80 * CYCLES_A_TICK || turned == 0,
                    "set up only {} cycles before",
                    now - turned
                );
            }
            before = level;
        }
        assert!(steps >= 39);
    }
}

#[test]
fn what_cannot_be_played_is_refused_and_changes_nothing() {
    let board = Interrupt::<Pulses, 1, 8>::leaked();
    let mut feeder = board.feeder(Signals { pulse_ticks: 84, direction_setup_ticks: 17 });
    // Two pulse levels are the minimum.
    assert_eq!(feeder.push(StepEntry::stair(167, 1, 1, 0).unwrap()), Err(FeedError::TooNear));
    assert_eq!(feeder.push(StepEntry::wait(1)), Err(FeedError::TooNear));
    assert_eq!((feeder.waiting(), feeder.room()), (0, 1));
    feeder.push(StepEntry::stair(168, 1, 1, 0).unwrap()).unwrap();
    let mut taken = 1;
    while feeder.push(StepEntry::stair(168, 1, 1, 0).unwrap()).is_ok() {
        taken += 1;
    }
    assert_eq!(feeder.push(StepEntry::stair(168, 1, 1, 0).unwrap()), Err(FeedError::Full));
    // The newest is held back.
    assert_eq!(feeder.waiting(), taken + 1);
    // The direction changes in a separate event, at least as far from the others as events may be.
    let set_up = Signals { pulse_ticks: 2, direction_setup_ticks: 100 };
    let board = Interrupt::<BothEdges, 1, 8>::leaked();
    let mut feeder = board.feeder(set_up);
    feeder.push(StepEntry::directions(1)).unwrap();
    assert_eq!(feeder.push(StepEntry::stair(99 + MIN_GAP_TICKS, 1, 1, 0).unwrap()), Err(FeedError::TooNear));
    feeder.push(StepEntry::stair(100 + MIN_GAP_TICKS, 1, 1, 0).unwrap()).unwrap();
}

#[test]
fn entries_wait_until_the_player_is_started() {
    let board = Interrupt::<BothEdges, 1, 16>::leaked();
    let link = board.player.link();
    let mut feeder = board.feeder(SIGNALS);
    feeder.push(StepEntry::stair(200, 3, 1, 0).unwrap()).unwrap();
    feeder.seal();
    board.update();
    assert!(board.timer.is_masked() && !link.is_running());
    assert!(board.start(&mut feeder) && !board.start(&mut feeder));
    for _ in 0..4 {
        assert!(!link.take_ran_dry());
        board.update();
    }
    assert_eq!(board.ports[0].changes().len(), 3);
    assert!(link.take_ran_dry() && !link.is_running() && board.timer.is_masked());
}

#[test]
fn a_start_after_a_stop_moves_nothing() {
    let board = Interrupt::<BothEdges, 1, 64>::leaked();
    let mut feeder = board.feeder(SIGNALS);
    feeder.push(StepEntry::stair(1_000, 20, 0b1, 0).unwrap()).unwrap();
    feeder.push(StepEntry::stair(1_000, 20, 0b1, 0).unwrap()).unwrap();
    // The producer looked before the stop came, and starts after it.
    board.stop();
    board.start(&mut feeder);
    assert!(board.timer.is_masked());
    for _ in 0..10 {
        board.update();
    }
    assert_eq!(board.ports[0].steps(), [0; 4]);
    assert_eq!(feeder.drop_all().issued, [40, 0, 0, 0]);
    // The next motion is complete.
    feeder.push(StepEntry::stair(1_000, 20, 0b1, 0).unwrap()).unwrap();
    feeder.seal();
    assert!(board.start(&mut feeder));
    for _ in 0..60 {
        board.update();
    }
    assert_eq!(board.ports[0].steps(), [20, 0, 0, 0]);
}

#[test]
fn entries_at_once_are_played_like_one_by_one() {
    fn play_both<M: Stepping + 'static>(entries: &[StepEntry]) {
        let [singly, at_once] = [false, true].map(|at_once| {
            let board = Interrupt::<M, 2, 128>::leaked();
            let mut feeder = board.feeder(SIGNALS);
            if at_once {
                feeder.push_all(entries).unwrap();
            } else {
                entries.iter().for_each(|entry| feeder.push(*entry).unwrap());
            }
            feeder.seal();
            board.start(&mut feeder);
            while feeder.waiting() > 0 {
                board.update();
            }
            board.ports.each_ref().map(Edges::levels)
        });
        assert_eq!(singly, at_once);
        assert!(singly.iter().all(|levels| levels.len() > 12));
    }
    let stair = |interval, count, axes, added| StepEntry::stair(interval, count, axes, added).unwrap();
    let mut entries = vec![stair(500, 1, 1, 0); 8];
    entries.extend([stair(400, 5, 3, 4), stair(300, 1, 2, 0), StepEntry::directions(3), stair(300, 1, 3, 8)]);
    entries.extend([StepEntry::wait(1_000), stair(300, 4, 3, 0), stair(168, 7, 15, 0), stair(200, 1, 15, 0)]);
    play_both::<BothEdges>(&entries);
    play_both::<Pulses>(&entries);
}

#[test]
fn a_stair_of_more_events_than_a_slot_holds_is_played_to_its_end() {
    fn play_long<M: Stepping + 'static>() {
        let entries = [StepEntry::directions(1), StepEntry::stair(200, u16::MAX, 1, 2).unwrap()];
        assert_played::<M, 1>(&entries, SIGNALS);
    }
    play_long::<BothEdges>();
    play_long::<Pulses>();
}

/// Checks that every event is as late as its own interrupt and no later, whatever happens between
/// the interrupts.
fn assert_late_by_its_own_latency<M: Stepping + 'static>(entries: &[StepEntry], latencies: &[u64]) {
    let most = latencies.iter().copied().max().unwrap_or_default();
    let (_, expected) = plain(entries);
    let board = Interrupt::<M, 1, 1024>::leaked();
    let mut feeder = board.feeder(SIGNALS);
    feeder.push_all(entries).unwrap();
    feeder.seal();
    board.start(&mut feeder);
    let mut latencies = latencies.iter().cycle();
    while feeder.waiting() > 0 {
        board.timer.next_update();
        board.timer.pass(*latencies.next().unwrap());
        if board.timer.is_called() {
            board.call();
        }
    }
    let changes = board.ports[0].changes();
    let steps: Vec<_> = changes
        .iter()
        .filter_map(|(now, level, changed)| {
            let stepped = if M::EVENTS_A_STEP == 1 { *changed } else { changed & level };
            (stepped != 0).then_some((*now, stepped as u8))
        })
        .collect();
    assert_eq!(steps.len(), expected.len());
    let Some((&(first, _), &(first_due, ..))) = steps.first().zip(expected.first()) else { return };
    for ((now, axes), (due, due_axes, _)) in steps.iter().zip(&expected) {
        assert_eq!(axes, due_axes);
        let late = (now - first) as i64 - ((due - first_due) * CYCLES_A_TICK) as i64;
        assert!(late.unsigned_abs() <= most, "{late} cycles late at tick {due}, interrupts at most {most}");
    }
}

proptest! {
    #[test]
    fn an_interrupt_that_is_late_delays_its_own_event_only(
        entries in proptest::collection::vec(any_entry(), 1..40),
        latencies in proptest::collection::vec(12u64..2 * u64::from(MIN_GAP_TICKS), 1..50),
    ) {
        assert_late_by_its_own_latency::<BothEdges>(&entries, &latencies);
        assert_late_by_its_own_latency::<Pulses>(&entries, &latencies);
    }
}
