//! The watchdog is fed while every task runs; when one stops, the watchdog resets the chip.

use ferrostep_testkit::boards::BOARDS;

use crate::firmware::bench::Bench;
use crate::firmware::board_pins::force_panic;
use crate::firmware::foreign_code::STAND_STILL;
use crate::firmware::images::image_of;

/// Replaces the idle task: masks interrupts of RTIC's priority 4 and below, the planner and all
/// lower tasks, for good. `movs r0, #0xc0; msr basepri, r0; b .`
pub const NO_PLANNER: [u16; 4] = [0x20c0, 0xf380, 0x8811, STAND_STILL];

/// Masks all interrupts: `cpsid i; b .`
const NO_INTERRUPTS: [u16; 2] = [0xb672, STAND_STILL];

/// The watchdog's key register (RM0090, 21.4.1), and the values that start and feed it.
const KEY: u32 = 0x4000_3000;
const START: u32 = 0xcccc;
const FEED: u32 = 0xaaaa;

/// 32,000 cycles of its 32 kHz oscillator (500 times 64), s.
const TIMEOUT_S: f64 = 1.0;

/// The number of feedings while some time passes.
fn feeds(bench: &mut Bench, time_ms: u64) -> usize {
    let before = bench.stored(KEY, FEED);
    bench.pass(time_ms);
    bench.stored(KEY, FEED) - before
}

/// Waits for the watchdog's reset; returns the time from the last feeding to it, s.
fn starved_s(bench: &mut Bench) -> f64 {
    bench.host.wait_for("start", |line| line == "start").unwrap();
    let heard = bench.host.listen(300).unwrap();
    assert!(heard.contains(&"echo:reset: watchdog".to_owned()), "{heard:?}");
    let stores = bench.stores();
    let restart = stores.iter().rposition(|store| (store.address, store.value) == (KEY, START)).unwrap();
    let fed = stores[..restart].iter().rfind(|store| (store.address, store.value) == (KEY, FEED)).unwrap();
    (stores[restart].at_ns - fed.until_ns) as f64 / 1e9
}

#[test]
fn the_watchdog_is_fed_while_every_task_runs() {
    for board in &BOARDS {
        let mut bench = Bench::boot_board(board);
        assert_eq!(bench.stored(KEY, START), 1, "{}", board.name);
        // A hundred times a second.
        let fed = feeds(&mut bench, 1000);
        assert!((98..=102).contains(&fed), "{}: fed {fed} times in a second", board.name);
        // The same in motion.
        bench.host.send_raw(b"M302 P1\nG91\nG1 X20 Y20 F300\n").unwrap();
        let fed = feeds(&mut bench, 3000);
        assert!((290..=310).contains(&fed), "{}: fed {fed} times in 3 s", board.name);
        assert!(!bench.pins().events().is_empty(), "{}: nothing has moved", board.name);
    }
}

#[test]
fn a_stuck_planner_starves_the_watchdog() {
    for board in &BOARDS {
        let mut bench = Bench::boot_patched(board);
        let before = bench.stored(KEY, FEED);
        bench.execute(&NO_PLANNER);
        let silent_s = starved_s(&mut bench);
        assert!((0.95..1.1).contains(&(silent_s / TIMEOUT_S)), "{}: {silent_s} s", board.name);
        // The planner may be silent for a second, a hundred samples of the heaters' control,
        // which continues.
        let stores = bench.stores();
        let restart = stores.iter().rposition(|store| (store.address, store.value) == (KEY, START)).unwrap();
        let feeds = stores[..restart].iter().filter(|store| (store.address, store.value) == (KEY, FEED));
        let until: usize = feeds.map(|store| store.times as usize).sum();
        let after = until - before;
        assert!((50..=105).contains(&after), "{}: fed {after} times", board.name);
    }
}

#[test]
fn a_stuck_processor_starves_the_watchdog() {
    let mut bench = Bench::boot_patched(&BOARDS[0]);
    bench.execute(&NO_INTERRUPTS);
    let silent_s = starved_s(&mut bench);
    assert!((0.95..1.1).contains(&(silent_s / TIMEOUT_S)), "{silent_s} s");
    // Afterwards the board works like any other.
    bench.host.connect_again().unwrap();
    let fed = feeds(&mut bench, 1000);
    assert!((98..=102).contains(&fed), "fed {fed} times in a second");
}

/// Outputs that a panic has switched off must stay off until a person resets the board.
#[test]
fn a_panic_keeps_the_watchdog_fed() {
    let board = &BOARDS[0];
    let mut bench = Bench::boot_patched(board);
    force_panic(&image_of(board.name), &mut bench);
    bench.host.wait_for("the panic", |line| line.starts_with("Error:firmware panic")).unwrap();
    bench.pass(100);
    let fed = bench.stored(KEY, FEED);
    // Far longer than the watchdog's time-out.
    let heard = bench.host.listen(1600).unwrap();
    assert!(bench.stored(KEY, FEED) > fed);
    assert!(heard.is_empty(), "{heard:?}");
}
