//! The black box after a panic, a watchdog's reset, the reset button and M112, each in the midst of
//! a move: the steps that it replays are the edges at the pins.

use ferrostep_black_box::Contents;
use ferrostep_host::send::fetch_black_box;
use ferrostep_mainboard::decode::Event;
use ferrostep_session::black_box::{BlackBoxReport, Image, replay_made};
use ferrostep_testkit::boards::{BOARDS, BoardFacts};

use crate::firmware::bench::Bench;
use crate::firmware::board_pins::force_panic;
use crate::firmware::images::image_of;
use crate::firmware::prepared::{Line, PATIENCE};
use crate::firmware::watchdog::NO_PLANNER;

/// A tick of the motion clock, ns.
const TICK_NS: f64 = 1e9 / 84e6;

/// Greatest distance of an edge from its tick, ns: less than a tick. The emulated chip has one of
/// its 120 million instructions a second between two ports' stores, so that motors on different
/// ports do not step at the same time.
const TOLERANCE_NS: f64 = 40.0;

/// RCC_AHB1ENR with BKPSRAMEN, and PWR_CR with DBP (RM0090 7.3.10, 5.4.1): the emulated memory
/// needs neither, a chip's both.
const CLOCKS: (u32, u32) = (0x4002_3830, 1 << 18);
const POWER: (u32, u32) = (0x4000_7000, 1 << 8);

/// Moves enough for some seconds, of many short stairs each: the ring is overwritten several times.
fn moves() -> String {
    let path = ["G2 X6 Y0 I3 J0", "G3 X-6 Y0 I-3 J0", "G1 X2 Y1.5"].map(|part| format!("{part} F4000\n"));
    format!("M302 P1\nG91\nG1 X5 Y4 Z0.2 F3000\n{}", path.concat().repeat(12))
}

/// Boots a board and lets it move for a while.
fn moving(board: &'static BoardFacts, time_ms: u64) -> Bench {
    let mut bench = Bench::boot_patched(board);
    let stores = bench.stores();
    for (address, bit) in [CLOCKS, POWER] {
        let last = stores.iter().rfind(|store| store.address == address).map(|store| store.value);
        assert!(last.is_some_and(|value| value & bit != 0), "{}: {address:#x} {last:x?}", board.name);
    }
    bench.host.send_raw(moves().as_bytes()).unwrap();
    bench.pass(time_ms);
    bench
}

/// The step events at the pins so far.
fn events(bench: &mut Bench) -> Vec<Event> {
    bench.with(|machine, _| machine.decoder.clone().finish().to_vec())
}

/// The motors and directions of the replayed steps.
fn replayed_motors(contents: &Contents<'_>) -> Vec<(u8, u8)> {
    let mut motors = Vec::new();
    replay_made(contents, |step| motors.push((step.axes, step.backwards)));
    motors
}

/// Removes the edges by which the safe state lowers the step signals, of motors without current:
/// where both edges step, the decoder counts them as an event of the signals that were high. A last
/// step that leaves all signals low looks the same: then the replay ends with it.
fn without_safe_state(board: &BoardFacts, mut events: Vec<Event>, bytes: &[u8]) -> Vec<Event> {
    let replayed = replayed_motors(&Contents::read(bytes).unwrap());
    let pins: Vec<_> = events.iter().map(|event| (event.axes, event.directions)).collect();
    if board.both_edges
        && !pins.ends_with(&replayed)
        && let Some((last, before)) = events.split_last()
        && before.iter().fold(0, |high, event| high ^ event.axes) == last.axes
    {
        events.pop();
    }
    events
}

fn fetch(bench: &mut Bench) -> Vec<u8> {
    fetch_black_box(&mut Line::new(&mut bench.host, None), PATIENCE, |_| {}).unwrap()
}

/// Compares the replay with the newest events at the pins; returns the report.
fn assert_replayed(board: &BoardFacts, bytes: &[u8], events: &[Event]) -> BlackBoxReport {
    let contents = Contents::read(bytes).unwrap();
    assert_eq!((contents.identity.board, contents.identity.profile), (board.name, board.profile));
    assert!(!contents.is_damaged && contents.has_memory);
    let mut replayed = Vec::new();
    replay_made(&contents, |step| replayed.push((step.tick, step.axes, step.backwards)));
    // A quarter of the ring is kept for what was played: 2048 slots with one port of
    // motors, 1024 with two.
    assert!(contents.past.next > 100 && replayed.len() > 250, "{}: {} events", board.name, replayed.len());
    let newest = &events[events.len().checked_sub(replayed.len()).unwrap()..];
    let offset_ns = newest[0].at_ns as f64 - replayed[0].0 as f64 * TICK_NS;
    let mut farthest_ns = 0.0_f64;
    for (place, (event, (tick, axes, backwards))) in newest.iter().zip(&replayed).enumerate() {
        assert_eq!((event.axes, event.directions), (*axes, *backwards), "{}: event {place}", board.name);
        let late_ns = event.at_ns as f64 - offset_ns - *tick as f64 * TICK_NS;
        farthest_ns = farthest_ns.max(late_ns.abs());
        assert!(late_ns.abs() < TOLERANCE_NS, "{}: event {place} of {}: {late_ns} ns", board.name, replayed.len());
    }
    let profile = ferrostep_profiles::load(board.profile).unwrap();
    let report = BlackBoxReport::new(&contents, Some(&profile));
    eprintln!(
        "{}: {} bytes, {} slots and {} in wait, {} of {} events, at most {farthest_ns:.1} ns from their ticks, {} records",
        board.name,
        bytes.len(),
        report.steps.slots[0],
        report.steps.slots[1],
        replayed.len(),
        events.len(),
        report.records.len()
    );
    // The board has not homed: its motors began at 0.
    let mut stood = [0_i64; 4];
    for event in events {
        for (motor, steps) in stood.iter_mut().enumerate() {
            let sign = 1 - 2 * i64::from(event.directions >> motor & 1);
            *steps += i64::from(event.axes >> motor & 1) * sign;
        }
    }
    assert_eq!(report.steps.motor_steps, Some(stood), "{}", board.name);
    assert_eq!(report.damaged_records, 0);
    report
}

fn texts<'a>(report: &'a BlackBoxReport, kind: &str) -> Vec<&'a str> {
    report.records.iter().filter(|record| record.kind == kind).map(|record| record.text.as_str()).collect()
}

/// Checks that the image tells where in the planner's source it was, and that another is refused.
fn assert_located(board: &BoardFacts, report: &mut BlackBoxReport, bytes: &[u8]) {
    let identity = Contents::read(bytes).unwrap().identity;
    report.locate(&Image::open(&image_of(board.name), &identity).unwrap());
    let [place] = report.records.iter().filter_map(|record| record.place.as_deref()).collect::<Vec<_>>()[..] else {
        panic!("{}: {:?}", board.name, report.records)
    };
    assert!(place.contains("planner/src/"), "{}: {place}", board.name);
    let other = BOARDS.iter().find(|other| other.name != board.name).unwrap();
    let refused = Image::open(&image_of(other.name), &identity).err().unwrap();
    assert!(refused.contains("expected the ferrostep.elf that was flashed"), "{refused}");
}

#[test]
fn after_a_panic_the_last_steps_are_those_of_the_pins() {
    for board in &BOARDS {
        let mut bench = moving(board, 2600);
        let place = force_panic(&image_of(board.name), &mut bench);
        bench.host.wait_for("the panic", |line| line.starts_with("Error:firmware panic")).unwrap();
        bench.pass(50);
        let events = events(&mut bench);
        bench.press_reset();
        bench.host.wait_for("start", |line| line == "start").unwrap();
        bench.pass(300);
        let bytes = fetch(&mut bench);
        let events = without_safe_state(board, events, &bytes);
        let mut report = assert_replayed(board, &bytes, &events);
        assert!(report.is_kept && report.steps.slots[1] > 10, "{}: {:?}", board.name, report.steps);
        // The ring was full, and its oldest slots were overwritten.
        assert!(report.steps.events < events.len() as u64, "{}", board.name);
        assert_eq!(texts(&report, "reset"), ["pin"]);
        assert_eq!(texts(&report, "last words"), [format!("panic at {place:#010x}")]);
        assert_located(board, &mut report, &bytes);
        assert!(texts(&report, "command").contains(&"G2 X6 Y0 I3 J0 F4000"), "{:?}", report.records);
        assert!(!texts(&report, "temperatures").is_empty());
        // Nothing has moved: it is still there, and once more after another reset.
        bench.pass(3000);
        bench.press_reset();
        bench.host.wait_for("start", |line| line == "start").unwrap();
        bench.pass(300);
        let again = fetch(&mut bench);
        assert_replayed(board, &again, &events);
        // Emptied, it begins anew.
        bench.host.connect_again().unwrap();
        bench.host.send("M791 R").unwrap();
        let empty = fetch(&mut bench);
        let contents = Contents::read(&empty).unwrap();
        assert_eq!(contents.slots.count(), 0);
    }
}

#[test]
fn the_reset_button_may_be_pressed_at_any_time() {
    let board = &BOARDS[0];
    let mut bench = moving(board, 900);
    for _ in 0..4 {
        let events = events(&mut bench);
        bench.press_reset();
        bench.host.wait_for("start", |line| line == "start").unwrap();
        bench.pass(300);
        let bytes = fetch(&mut bench);
        let contents = Contents::read(&bytes).unwrap();
        let replayed = replayed_motors(&contents);
        let pins: Vec<_> = events.iter().map(|event| (event.axes, event.directions)).collect();
        // The reset may have come between an edge and its count.
        assert!(replayed.len() > 500, "{} events", replayed.len());
        assert!(pins.ends_with(&replayed) || pins[..pins.len() - 1].ends_with(&replayed), "{} events", replayed.len());
        // The next motion overwrites it.
        bench.host.connect_again().unwrap();
        bench.host.send_raw(moves().as_bytes()).unwrap();
        bench.pass(613);
    }
}

#[test]
fn a_watchdog_leaves_the_black_box() {
    let board = &BOARDS[0];
    let mut bench = moving(board, 1200);
    bench.execute(&NO_PLANNER);
    // The step queue runs out, and then the watchdog.
    bench.pass(700);
    let events = events(&mut bench);
    bench.host.wait_for("start", |line| line == "start").unwrap();
    bench.pass(300);
    let bytes = fetch(&mut bench);
    let report = assert_replayed(board, &bytes, &events);
    assert_eq!(report.steps.slots[1], 0, "{:?}", report.steps);
    assert_eq!(texts(&report, "reset"), ["watchdog"]);
}

#[test]
fn a_stop_leaves_the_black_box_without_a_reset() {
    for board in &BOARDS {
        let mut bench = moving(board, 2200);
        bench.host.send_raw(b"M112\n").unwrap();
        bench.pass(400);
        let events = events(&mut bench);
        let bytes = fetch(&mut bench);
        let report = assert_replayed(board, &bytes, &events);
        assert!(report.is_kept && report.steps.slots[1] > 10, "{}: {:?}", board.name, report.steps);
        assert_eq!(texts(&report, "halt"), ["by M112 or a motor's driver"]);
        // Reading changes nothing.
        assert_eq!(
            Contents::read(&fetch(&mut bench)).unwrap().events_played(),
            Contents::read(&bytes).unwrap().events_played()
        );
    }
}

#[test]
fn after_power_on_it_is_empty_and_says_so() {
    let mut bench = Bench::boot();
    let bytes = fetch(&mut bench);
    let contents = Contents::read(&bytes).unwrap();
    assert_eq!((contents.slots.clone().count(), contents.past.is_kept), (0, false));
    let text = BlackBoxReport::new(&contents, None).to_string();
    assert!(text.contains("steps: none since the power came on"), "{text}");
}
