//! Resets at any moment: the ring then reports exactly the events that the pins have shown.

use ferrostep_planner::{StepEntry, StepLedger};
use proptest::prelude::*;

use super::model::{Interrupt, SIGNALS, pins};
use super::play::{any_entry, seen};
use crate::*;

const RING: usize = 64;

/// A board that has played entries up to some update, and the expected motor positions at the end
/// of the queue.
struct Run<M: 'static, const PORTS: usize> {
    board: &'static Interrupt<M, PORTS, RING>,
    ledger: StepLedger,
    /// Number of entries queued.
    queued: usize,
}

impl<M: Stepping + 'static, const PORTS: usize> Run<M, PORTS> {
    fn go(&mut self, entries: &[StepEntry], updates: usize) -> StepFeeder<'static, M, PORTS, RING> {
        let mut feeder = self.board.feeder(SIGNALS).keeping_past();
        let mut left = entries.iter();
        let mut sealed = false;
        for now_ms in 0..updates as u32 {
            while feeder.room() > 0 && !sealed {
                match left.next() {
                    Some(entry) => {
                        feeder.push(*entry).unwrap();
                        self.ledger.play(*entry, &mut ());
                        self.queued += 1;
                    }
                    None => {
                        feeder.seal();
                        sealed = true;
                    }
                }
            }
            let steps = self.ledger.motor_steps().map(|steps| steps as i32);
            self.board.player.note_position(feeder.queued(), steps, now_ms);
            self.board.start(&mut feeder);
            self.board.update();
        }
        feeder
    }

    /// All slots of the past, and the number of their events that were played.
    fn past(&self) -> (Past, Vec<PastSlot>, u64) {
        let past = self.board.player.past();
        let numbers = (0..past.filled.wrapping_sub(past.oldest)).map(|place| past.oldest.wrapping_add(place));
        let slots: Vec<_> =
            numbers.map(|number| self.board.player.past_slot(number, &pins::<PORTS>()).unwrap()).collect();
        let played = past.next.wrapping_sub(past.oldest) as usize;
        let events: u64 = slots[..played].iter().map(|slot| u64::from(slot.events)).sum();
        (past, slots, events - u64::from(past.events_left))
    }

    /// Compares the replay with the pins since `begun`, an instant in ticks.
    fn assert_replayed(&self, begun: u64) -> usize {
        let (past, slots, events) = self.past();
        let mut replayed = Vec::new();
        let both_edges = M::EVENTS_A_STEP == 1;
        replay(&slots, both_edges, SIGNALS.pulse_ticks, past.directions, events, |step| {
            replayed.push((step.tick, step.axes, step.backwards));
        });
        let seen: Vec<_> = seen::<M, PORTS>(&self.board.ports).into_iter().filter(|(at, ..)| *at >= begun).collect();
        let last = &seen[seen.len().checked_sub(replayed.len()).unwrap()..];
        let offset = last.first().map_or(0, |(at, ..)| at - replayed[0].0);
        let last: Vec<_> = last.iter().map(|(at, axes, directions)| (at - offset, *axes, *directions)).collect();
        assert_eq!(replayed, last);
        replayed.len()
    }
}

fn assert_past<M: Stepping + 'static, const PORTS: usize>(entries: &[StepEntry], updates: usize, trusted: bool) {
    let board = Interrupt::<M, PORTS, RING>::leaked();
    let mut run = Run::<M, PORTS> { board, ledger: StepLedger::default(), queued: 0 };
    // Memory that was not a ring is emptied, even if the supply was not interrupted.
    board.player.restart(true);
    assert!(!board.player.past().is_kept);
    run.go(entries, updates);
    board.timer.mask();
    board.player.restart(trusted);
    if !trusted {
        let past = board.player.past();
        assert_eq!((past.oldest, past.next, past.filled, past.is_kept), (0, 0, 0, false));
        return;
    }
    run.assert_replayed(0);
    let (past, slots, _) = run.past();
    // A quarter of the ring keeps the past, as soon as a quarter was played.
    assert!(past.oldest == 0 || past.next - past.oldest >= RING as u32 / 4, "{past:?}");
    // One of the two notes is from before the newest slots, unless that was the first.
    let places = past.positions.map(|mark| mark.map(|mark| mark.filled));
    assert!(places[0].is_some() && places[0] != places[1], "{places:?}");
    // Nothing that was played and not overwritten is missing.
    assert!(slots.len() == RING - 1 || past.oldest == 0);
    // A second reset, without a motion in between, changes nothing.
    board.player.restart(true);
    let _ = board.feeder(SIGNALS);
    assert_eq!(run.past(), (past, slots, run.past().2));
    // The reset has put the pins to low.
    board.ports.iter().for_each(|port| port.put_out(0xffff_0000));
    // The next motion overwrites the record; only that motion is read afterwards.
    let begun = board.timer.now_cycles() / CYCLES_A_TICK + 1;
    let mut again = Run::<M, PORTS> { board, ledger: StepLedger::default(), queued: 0 };
    let stair = [StepEntry::directions(0b0110), StepEntry::stair(400, 20, 0b1111, 0b0100).unwrap()];
    let mut feeder = again.go(&stair, 13);
    // A stop keeps the slots played until then.
    board.stop();
    let dropped = feeder.drop_all();
    let moved = again.assert_replayed(begun);
    assert_eq!(dropped.issued[0] as usize + moved, 20);
    assert!(board.player.past().is_kept);
    // A second stop leaves the record unchanged.
    board.stop();
    assert_eq!(feeder.drop_all().issued, [0; 4]);
    assert_eq!(again.assert_replayed(begun), moved);
    board.player.restart(true);
    assert_eq!(again.assert_replayed(begun), moved);
}

proptest! {
    #![proptest_config(ferrostep_random_cases::cases(400))]
    #[test]
    fn the_ring_replays_what_the_pins_have_shown(
        entries in proptest::collection::vec(any_entry(), 1..200), updates in 1usize..6_000, trusted in prop::bool::weighted(0.9),
    ) {
        assert_past::<BothEdges, 1>(&entries, updates, trusted);
        assert_past::<Pulses, 1>(&entries, updates, trusted);
        assert_past::<BothEdges, 2>(&entries, updates, trusted);
        assert_past::<Pulses, 2>(&entries, updates, trusted);
    }

    /// Slots that no board produces.
    #[test]
    fn anything_can_be_replayed(
        slots in proptest::collection::vec(
            (any::<[u8; 4]>(), any::<u32>(), any::<u16>()).prop_map(|([first, then, turned, backwards], reload, events)| {
                PastSlot { first, then, turned, backwards, reload, events: events >> (reload & 15) }
            }), 0..20),
        both_edges: bool, pulse_ticks: u32, directions: u8, events in 0_u64..50_000,
    ) {
        let mut steps = 0;
        replay(&slots, both_edges, pulse_ticks, directions, events, |_| steps += 1);
        prop_assert!(steps <= events);
    }
}
