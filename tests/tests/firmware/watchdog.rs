//! The watchdog is fed while every task runs, and no longer when one does not. The emulator has none, and logs what is
//! stored to it.

use std::time::Duration;

use ferrostep_tests::qemu::Register;

use crate::board_pins::{force_panic, halted_asleep};
use crate::boards::BOARDS;
use crate::image::Bench;

/// Below all that the stack comes down to.
const PROGRAM: u32 = 0x2000_0200;

/// In the place of the idle task: what masks interrupts of RTIC's priority 4 and below, the planner and all under it, for
/// ever. `movs r0, #0xc0; msr basepri, r0; b .`
const NO_PLANNER: [u16; 4] = [0x20c0, 0xf380, 0x8811, 0xe7fe];

/// What masks all interrupts: `cpsid i; b .`
const NOTHING: [u16; 2] = [0xb672, 0xe7fe];

/// Far more than a sample of the heaters' control.
const A_WHILE: Duration = Duration::from_millis(500);

/// The emulator takes its address, 0x40003000, for another's.
const STARTED: &str = "I2S2ext: unimplemented device write (size 4, offset 0x000, value 0x0000cccc)";
const FED: &str = "I2S2ext: unimplemented device write (size 4, offset 0x000, value 0x0000aaaa)";

/// Lets the image come to nothing but this code; how often the watchdog had been fed until then.
fn run(bench: &mut Bench, code: &[u16]) -> usize {
    let mut debugger = halted_asleep(bench);
    let bytes: Vec<u8> = code.iter().flat_map(|half| half.to_le_bytes()).collect();
    debugger.write_memory(PROGRAM, &bytes).unwrap();
    debugger.set_register(Register::ProgramCounter, PROGRAM).unwrap();
    let fed = bench.logged(FED);
    debugger.resume().unwrap();
    fed
}

/// How often the watchdog is fed while some time passes.
fn feeds(bench: &mut Bench, time: Duration) -> usize {
    let before = bench.logged(FED);
    bench.host.listen(time).unwrap();
    bench.logged(FED) - before
}

#[test]
fn the_watchdog_is_fed_while_every_task_runs() {
    for board in &BOARDS {
        let mut bench = Bench::boot_board(board);
        assert_eq!(bench.logged(STARTED), 1, "{}", board.name);
        let fed = feeds(&mut bench, A_WHILE);
        // A hundred times a second; the emulator's seconds are ten times as fast and more, where it keeps up.
        assert!((5..=10_000).contains(&fed), "{}: fed {fed} times", board.name);
    }
}

#[test]
fn a_planner_that_does_not_run_any_more_starves_it() {
    let mut bench = Bench::boot_board(&BOARDS[0]);
    let before = run(&mut bench, &NO_PLANNER);
    bench.host.listen(Duration::from_secs(2)).unwrap();
    assert_eq!(feeds(&mut bench, A_WHILE), 0);
    // It may be silent for a second, a hundred samples of the heaters' control, which goes on.
    let after = bench.logged(FED) - before;
    assert!((50..=105).contains(&after), "fed {after} times");
}

#[test]
fn a_processor_that_does_nothing_any_more_starves_it() {
    let mut bench = Bench::boot_board(&BOARDS[0]);
    run(&mut bench, &NOTHING);
    bench.host.listen(A_WHILE).unwrap();
    assert_eq!(feeds(&mut bench, A_WHILE), 0);
}

/// What is off shall stay off until someone comes.
#[test]
fn the_rest_after_a_panic_is_no_reset() {
    let mut bench = Bench::boot_board(&BOARDS[0]);
    force_panic(&BOARDS[0], &mut bench).resume().unwrap();
    bench.host.wait_for("the panic", |line| line.starts_with("Error:firmware panic")).unwrap();
    bench.host.listen(A_WHILE).unwrap();
    assert!(feeds(&mut bench, A_WHILE) > 0);
}
