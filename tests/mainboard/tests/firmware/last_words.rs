//! The messages after a reset: its cause, and the last message of the program that ended before.

use ferrostep_testkit::boards::{BOARDS, BoardFacts};

use crate::firmware::bench::Bench;
use crate::firmware::board_pins::{force_panic, jump_nowhere};
use crate::firmware::foreign_code::{STAND_STILL, load};
use crate::firmware::images::image_of;

/// AIRCR and the value that requests a software reset (PM0214, 4.4.5).
const AIRCR: u32 = 0xe000_ed0c;
const RESET_KEY: u32 = 0x05fa_0004;

/// `str r0, [r1]`.
const STORE: u16 = 0x6008;

/// The image's messages at its start, with the cause of the reset and everything after it.
fn greeting(bench: &mut Bench) -> Vec<String> {
    bench.host.wait_for("start", |line| line == "start").unwrap();
    bench.host.listen(300).unwrap()
}

fn last_words(greeting: &[String]) -> Vec<&str> {
    greeting.iter().filter_map(|line| line.strip_prefix("echo:last ")).collect()
}

fn assert_cause(board: &BoardFacts, greeting: &[String], cause: &str) {
    assert!(greeting.contains(&format!("echo:reset: {cause}")), "{}: {greeting:?}", board.name);
}

fn boot(board: &'static BoardFacts) -> Bench {
    let mut bench = Bench::switch_on_patched(board);
    let heard = greeting(&mut bench);
    assert!(last_words(&heard).is_empty(), "{heard:?}");
    assert_cause(board, &heard, "power-on");
    bench
}

#[test]
fn a_panic_is_reported_once_after_the_reset() {
    for board in &BOARDS {
        let mut bench = boot(board);
        let place = force_panic(&image_of(board.name), &mut bench);
        bench.host.wait_for("the panic", |line| line.starts_with("Error:firmware panic")).unwrap();
        bench.pass(50);
        bench.press_reset();
        let heard = greeting(&mut bench);
        let expected = format!("panic at {place:#010x}");
        assert_eq!(last_words(&heard), [expected], "{}: {heard:?}", board.name);
        assert_cause(board, &heard, "pin");
        bench.press_reset();
        let heard = greeting(&mut bench);
        assert!(last_words(&heard).is_empty() && !heard.is_empty(), "{}: {heard:?}", board.name);
    }
}

#[test]
fn a_fault_is_reported_after_the_reset() {
    let mut bench = boot(&BOARDS[0]);
    jump_nowhere(&mut bench);
    bench.host.wait_for("the fault", |line| line.starts_with("Error:firmware fault")).unwrap();
    bench.pass(50);
    bench.press_reset();
    assert_eq!(last_words(&greeting(&mut bench)), ["fault at 0x60000000"]);
}

#[test]
fn a_software_reset_is_reported() {
    for board in &BOARDS {
        let mut bench = boot(board);
        let program = [&load(0, RESET_KEY)[..], &load(1, AIRCR), &[STORE, STAND_STILL]].concat();
        bench.execute(&program);
        let heard = greeting(&mut bench);
        assert_cause(board, &heard, "software");
        assert!(last_words(&heard).is_empty(), "{}: {heard:?}", board.name);
    }
}
