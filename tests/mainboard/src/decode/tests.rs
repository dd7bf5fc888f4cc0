#![allow(clippy::unwrap_used, clippy::expect_used)]

use proptest::prelude::*;

use super::*;
use crate::pins::Pin;
use crate::wiring::{Board, Printer};

const TICK_HZ: u64 = 84_000_000;
const BUDDY: &str = include_str!("../../../../config/boards/prusa-buddy.toml");
const MINI: &str = include_str!("../../../../config/profiles/prusa-mini.toml");
const WINDOW_NS: u64 = 400;

fn pin(name: &str) -> Pin {
    name.parse().unwrap()
}

fn wires(motor: u8, inverted: bool) -> MotorWires {
    let at = |number| Pin { port: motor, number };
    MotorWires { step: at(0), direction: at(1), enable: at(2), inverted }
}

/// Four motors with pins on ports A to D, step 0, direction 1, enable 2; both edges
/// step; z is inverted.
fn decoder(both_edges: bool) -> Decoder {
    Decoder::with_wires((0..4).map(|motor| wires(motor, motor == 2)).collect(), both_edges, WINDOW_NS)
}

fn step(motor: u8) -> Pin {
    wires(motor, false).step
}

fn event(at_ns: u64, axes: u8, directions: u8) -> Event {
    Event { at_ns, axes, directions }
}

#[test]
fn the_board_gives_the_pins_and_the_profile_their_inversion() {
    let board = Board::parse("board", BUDDY).unwrap();
    let printer = Printer::parse("profile", MINI).unwrap();
    let mut decoder = Decoder::new(&board, &printer, WINDOW_NS);
    decoder.edge(10, pin("PD3"), false);
    decoder.edge(1_000, pin("PD1"), true);
    decoder.edge(1_200, pin("PD4"), true);
    decoder.edge(3_000, pin("PD0"), true);
    decoder.edge(4_000, pin("PD1"), false);
    decoder.edge(5_000, pin("PC13"), true);
    assert_eq!(decoder.finish(), [event(1_000, 0b101, 0b001), event(4_000, 0b001, 0)], "x is inverted, z is not");
    assert_eq!((decoder.position(0), decoder.position(2)), (0, 1));
    assert_eq!((decoder.steps_while_off(0), decoder.steps_while_off(2)), (0, 1));
    assert_eq!((decoder.foreign_edges(), decoder.repeated_levels()), (1, 0));
}

#[test]
fn with_one_edge_per_step_rising_edges_count_and_both_times_are_measured() {
    let mut decoder = decoder(false);
    for (at, high) in [(1_000, true), (2_100, false), (5_000, true), (6_050, false), (7_060, true)] {
        decoder.edge(at, step(0), high);
    }
    assert_eq!(decoder.finish().len(), 3);
    assert_eq!((decoder.steps(0), decoder.position(0)), (3, 3));
    let smallest = decoder.smallest();
    assert_eq!((smallest.high_ns, smallest.low_ns, smallest.gap_ns), (1_050, 1_010, 2_060));
    assert_eq!(smallest.pulse_ns(), 1_010);
}

#[test]
fn set_up_and_hold_are_measured_at_the_motor_of_the_direction() {
    let mut decoder = decoder(true);
    let direction = wires(0, false).direction;
    decoder.edge(500, direction, true);
    decoder.edge(800, step(0), true);
    decoder.edge(900, step(1), true);
    decoder.edge(1_250, direction, false);
    decoder.edge(1_500, step(1), false);
    decoder.edge(3_250, step(0), false);
    // The set-up of a change without a step before the next change is not measured.
    decoder.edge(9_000, step(0), true);
    let smallest = decoder.smallest();
    assert_eq!((smallest.direction_setup_ns, smallest.direction_hold_ns), (300, 450));
    assert_eq!(decoder.position(0), 1);
}

#[test]
fn steps_of_different_motors_within_the_window_are_one_event() {
    let mut decoder = decoder(true);
    decoder.edge(1_000, step(0), true);
    decoder.edge(1_400, step(1), true);
    decoder.edge(1_401, step(3), true);
    decoder.edge(1_500, step(3), false);
    assert_eq!(decoder.events(), [event(1_000, 0b11, 0), event(1_401, 0b1000, 0)], "the last event may still grow");
    assert_eq!(decoder.finish().len(), 3);
    assert_eq!(decoder.smallest().gap_ns, 99);
}

#[test]
fn a_repeated_level_is_counted_and_makes_no_step() {
    let mut decoder = decoder(true);
    decoder.edge(1_000, step(0), true);
    decoder.edge(2_000, step(0), true);
    decoder.edge(1_500, step(0), false);
    assert_eq!((decoder.steps(0), decoder.repeated_levels(), decoder.out_of_order()), (2, 1, 1));
}

#[test]
fn the_digest_is_fnv_1a() {
    // Published test vectors of FNV-1a-64: "" and "foobar".
    assert_eq!(order_digest([]), 0xcbf2_9ce4_8422_2325);
    assert_eq!(order_digest([(b'f', b'o'), (b'o', b'b'), (b'a', b'r')]), 0x8594_4171_f739_67e8);
}

/// The bytes of a trace.
fn trace(records: &[(u64, u8, u8, u8, &[u32])]) -> Vec<u8> {
    let header = r#"{"format":"ferrostep-trace","version":1,"tick_hz":84000000,"axes":["x","y","z","e"],"more":1}"#;
    let mut bytes = header.as_bytes().to_vec();
    bytes.push(b'\n');
    for (tick, kind, axes, directions, words) in records {
        bytes.extend(tick.to_le_bytes());
        bytes.extend([*kind, *axes, *directions, 0]);
        bytes.extend(words.iter().flat_map(|word| word.to_le_bytes()));
    }
    bytes
}

#[test]
fn a_trace_is_read_with_homing_and_source_lines() {
    let records: [(u64, u8, u8, u8, &[u32]); 6] = [
        (84, 0, 4, 4, &[]),
        (85, 1, 0, 0, &[0, u32::MAX, 1600, 0]),
        (168, 0, 1, 0, &[]),
        (336, 0, 3, 2, &[]),
        (336, 2, 0, 0, &[30]),
        (400, 0, 8, 0, &[]),
    ];
    let bytes = trace(&records);
    let read = Trace::parse(&bytes).unwrap();
    assert_eq!((read.tick_hz, read.axes.len()), (TICK_HZ, 4));
    assert_eq!(read.redefined, [Redefined { tick: 85, before_step: 1, positions: vec![0, -1, 1600, 0] }]);
    assert_eq!(read.steps.iter().map(|step| step.line).collect::<Vec<_>>(), [0, 30, 30, 0]);
    assert_eq!(read.steps_after_homing().len(), 3);
    assert_eq!(read.order_digest(), order_digest([(4, 4), (1, 0), (3, 2), (8, 0)]));
    let first_record = bytes.iter().position(|byte| *byte == b'\n').unwrap() + 1;
    let whole = [0, 12, 40, 52, 64, 80, 92].map(|length| first_record + length);
    for length in 0..bytes.len() {
        assert_eq!(Trace::parse(&bytes[..length]).is_ok(), whole.contains(&length), "{length}");
    }
}

#[test]
fn malformed_traces_are_refused() {
    let good = String::from_utf8(trace(&[])).unwrap();
    for (from, to) in [
        ("\"version\":1", "\"version\":2"),
        ("ferrostep-trace", "trace"),
        ("84000000", "0"),
        ("[\"x\",\"y\",\"z\",\"e\"]", "[]"),
        ("{", ""),
    ] {
        assert!(Trace::parse(good.replacen(from, to, 1).as_bytes()).is_err(), "{to}");
    }
    assert!(Trace::parse(&trace(&[(1, 3, 0, 0, &[])])).unwrap_err().contains("kind 3"));
    assert!(Trace::parse(&trace(&[(2, 0, 1, 0, &[]), (1, 0, 1, 0, &[])])).unwrap_err().contains("earlier"));
}

fn nanoseconds(tick: u64) -> u64 {
    (u128::from(tick) * 1_000_000_000 / u128::from(TICK_HZ)) as u64
}

fn desk(intervals: &[u64], masks: &[(u8, u8)]) -> Vec<TraceStep> {
    let mut tick = 0;
    let steps = intervals.iter().zip(masks).map(|(interval, (axes, directions))| {
        tick += interval;
        TraceStep { tick, axes: *axes, directions: axes & directions, line: 7 }
    });
    steps.collect()
}

/// The pins' events: the desk's, each delayed by `delay_ns` and its own jitter.
fn late_events(desk: &[TraceStep], delay_ns: u64, jitter: &[u64]) -> Vec<Event> {
    let event = |(step, jitter): (&TraceStep, &u64)| Event {
        at_ns: nanoseconds(step.tick) + delay_ns + jitter,
        axes: step.axes,
        directions: step.directions,
    };
    desk.iter().zip(jitter).map(event).collect()
}

#[test]
fn only_a_rest_or_a_late_gap_ends_a_run() {
    let rules = Rules::default();
    let masks = [(1, 0); 7];
    // 1 ms each, then 25 ms (a rest), then 2 ms, one of which waits 3 ms for its move.
    let desk = desk(&[84_000, 84_000, 84_000, 2_100_000, 168_000, 168_000, 168_000], &masks);
    let mut pins = late_events(&desk, 1_000, &[0, 50, 0, 700, 0, 900, 0]);
    for event in &mut pins[5..] {
        event.at_ns += 3_000_000;
    }
    let found = compare(&pins, &desk, TICK_HZ, &rules);
    assert_eq!((found.runs, found.too_late, found.difference), (3, 0, None));
    assert_eq!(found.latest.unwrap(), Late { index: 5, at_ns: pins[5].at_ns, line: 7, latency_ns: 900 });
    assert_eq!((found.largest_disagreement_ns, found.largest_wait_ns), (900, 3_000_900));
    assert_eq!(found.histogram[..4], [5, 0, 0, 2]);
    assert!(found.agrees());
    // The same wait within a fast move is not a pause, but delays the events after it.
    let strict = Rules { pause_ns: 10_000_000, ..rules };
    let found = compare(&pins, &desk, TICK_HZ, &strict);
    assert_eq!((found.runs, found.too_late, found.first_too_late.unwrap().index), (2, 2, 5));
    assert!(!found.agrees());
}

#[test]
fn an_empty_log_agrees_with_an_empty_trace_only() {
    let rules = Rules::default();
    assert!(compare(&[], &[], TICK_HZ, &rules).agrees());
    let found = compare(&[event(5, 1, 0)], &[], TICK_HZ, &rules);
    assert_eq!(
        found.difference.unwrap().to_string(),
        "event 0: the pins step 0001 (backwards 0000) at 0.000000 s, the desk makes no further step"
    );
    assert!(!compare(&[], &desk(&[1], &[(1, 0)]), TICK_HZ, &rules).agrees());
}

/// Intervals of 2 us to 900 us with masks of motors and directions, and a jitter that
/// keeps events apart.
fn motion() -> impl Strategy<Value = (Vec<u64>, Vec<(u8, u8)>, Vec<u64>)> {
    prop::collection::vec((168_u64..75_600, 1_u8..16, 0_u8..16, 0_u64..500), 2..200).prop_map(|events| {
        let intervals = events.iter().map(|event| event.0).collect();
        let masks = events.iter().map(|event| (event.1, event.2)).collect();
        (intervals, masks, events.iter().map(|event| event.3).collect())
    })
}

/// The edges of these events on the wires of [`decoder`], steps of one event 50 ns apart.
fn edges(events: &[Event]) -> Vec<(u64, Pin, bool)> {
    let mut edges = Vec::new();
    let (mut steps, mut directions) = ([false; 4], [false; 4]);
    for event in events {
        let moving = || (0..4_u8).filter(|motor| event.axes >> motor & 1 == 1);
        for motor in moving() {
            let index = usize::from(motor);
            let high = (event.directions >> motor & 1 == 1) != (motor == 2);
            if std::mem::replace(&mut directions[index], high) != high {
                edges.push((event.at_ns - 200, wires(motor, false).direction, high));
            }
        }
        for (order, motor) in moving().enumerate() {
            let index = usize::from(motor);
            steps[index] = !steps[index];
            edges.push((event.at_ns + 50 * order as u64, step(motor), steps[index]));
        }
    }
    edges
}

fn decoded(edges: &[(u64, Pin, bool)]) -> Decoder {
    let mut decoder = decoder(true);
    for (at_ns, pin, high) in edges {
        decoder.edge(*at_ns, *pin, *high);
    }
    decoder.finish();
    decoder
}

proptest! {
    #[test]
    fn edges_decode_to_the_events_that_made_them((intervals, masks, jitter) in motion()) {
        let desk = desk(&intervals, &masks);
        let pins = late_events(&desk, 1_000, &jitter);
        let decoder = decoded(&edges(&pins));
        prop_assert_eq!(decoder.events(), &pins[..]);
        prop_assert_eq!(decoder.repeated_levels() + decoder.out_of_order() + decoder.foreign_edges(), 0);
        prop_assert_eq!(decoder.order_digest(), order_digest(desk.iter().map(|step| (step.axes, step.directions))));
    }

    #[test]
    fn jitter_is_measured_as_latency((intervals, masks, jitter) in motion(), delay in 0_u64..1_000_000_000) {
        let desk = desk(&intervals, &masks);
        let pins = late_events(&desk, delay, &jitter);
        let found = compare(&pins, &desk, TICK_HZ, &Rules::default());
        let least = jitter.iter().min().unwrap();
        let most = jitter.iter().max().unwrap();
        let latest = found.latest.unwrap();
        prop_assert!(found.agrees() && found.runs == 1);
        prop_assert_eq!(latest.latency_ns, most - least);
        prop_assert_eq!(jitter[latest.index], *most);
        prop_assert_eq!(found.histogram.iter().sum::<u64>(), jitter.len() as u64);
        let disagreement = jitter.windows(2).map(|pair| pair[0].abs_diff(pair[1])).max().unwrap();
        prop_assert_eq!(found.largest_disagreement_ns, disagreement);
    }

    #[test]
    fn a_lost_doubled_or_swapped_edge_is_detected((intervals, masks, jitter) in motion(), at in any::<prop::sample::Index>(), what in 0..3) {
        let desk = desk(&intervals, &masks);
        let mut edges = edges(&late_events(&desk, 1_000, &jitter));
        let steps: Vec<usize> = (0..edges.len()).filter(|edge| edges[*edge].1.number == 0).collect();
        let place = steps[at.index(steps.len())];
        match what {
            0 => {
                edges.remove(place);
            }
            1 => {
                // A glitch: the pin changes back, and again 20 ns later.
                let (at_ns, pin, high) = edges[place];
                edges.insert(place + 1, (at_ns + 10, pin, !high));
                edges.insert(place + 2, (at_ns + 20, pin, high));
            }
            _ => {
                // The edge swaps with the next one of another event, unless both are equal.
                let later = steps.iter().copied().find(|later| edges[*later].0 > edges[place].0 + 1_000);
                let Some(later) = later.filter(|later| edges[*later].1 != edges[place].1) else { return Ok(()) };
                let (first, second) = (edges[place], edges[later]);
                edges[place] = (first.0, second.1, second.2);
                edges[later] = (second.0, first.1, first.2);
            }
        }
        let decoder = decoded(&edges);
        let found = compare(decoder.events(), &desk, TICK_HZ, &Rules::default());
        prop_assert!(found.difference.is_some(), "{found:?}");
    }
}
