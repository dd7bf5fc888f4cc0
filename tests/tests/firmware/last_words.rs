//! What is said after a reset: its cause, and the last words of the program that ended before.

use crate::board_pins::force_panic;
use crate::boards::{BOARDS, BoardFacts};
use crate::image::Bench;
use ferrostep_tests::qemu::Register;

/// Below all that the stack comes down to.
const PROGRAM: u32 = 0x2000_0200;

/// Stores r0's key to AIRCR, whose address it makes: a reset by software (PM0214, 4.4.5).
///
///     movw r1, #0xed0c; movt r1, #0xe000; str r0, [r1]; b .
const RESET: [u16; 6] = [0xf64e, 0x510c, 0xf2ce, 0x0100, 0x6008, 0xe7fe];
const RESET_KEY: u32 = 0x05fa_0004;

fn reset(bench: &mut Bench) {
    let mut debugger = bench.host.port().halt().unwrap();
    let program: Vec<u8> = RESET.into_iter().flat_map(u16::to_le_bytes).collect();
    debugger.write_memory(PROGRAM, &program).unwrap();
    debugger.set_register(Register::R0, RESET_KEY).unwrap();
    debugger.set_register(Register::ProgramCounter, PROGRAM).unwrap();
    debugger.resume().unwrap();
}

/// What the image says at its start, up to its reset's cause and what follows.
fn greeting(bench: &mut Bench) -> Vec<String> {
    bench.host.wait_for("start", |line| line == "start").unwrap();
    bench.host.listen(std::time::Duration::from_millis(300)).unwrap()
}

fn last_words(greeting: &[String]) -> Vec<&str> {
    greeting.iter().filter_map(|line| line.strip_prefix("echo:last ")).collect()
}

fn boot(board: &BoardFacts) -> Bench {
    let mut bench = Bench::boot_board(board);
    let heard = bench.host.listen(std::time::Duration::from_millis(100)).unwrap();
    assert!(last_words(&heard).is_empty(), "{heard:?}");
    bench
}

#[test]
fn a_panic_is_told_after_the_reset_and_once() {
    for board in &BOARDS {
        let mut bench = boot(board);
        force_panic(board, &mut bench).resume().unwrap();
        bench.host.wait_for("the panic", |line| line.starts_with("Error:firmware panic")).unwrap();
        bench.host.listen(std::time::Duration::from_millis(300)).unwrap();
        reset(&mut bench);
        let heard = greeting(&mut bench);
        let expected = "panic: panicked at nowhere.rs:1:1: attempt to add with overflow";
        assert_eq!(last_words(&heard), [expected], "{}: {heard:?}", board.name);
        // The emulator's chip has no flags of resets.
        assert!(heard.contains(&"echo:reset: unknown".to_owned()), "{heard:?}");
        reset(&mut bench);
        let heard = greeting(&mut bench);
        assert!(last_words(&heard).is_empty() && !heard.is_empty(), "{}: {heard:?}", board.name);
    }
}

#[test]
fn a_fault_is_told_after_the_reset() {
    let board = &BOARDS[0];
    let mut bench = boot(board);
    let mut debugger = bench.host.port().halt().unwrap();
    debugger.set_register(Register::ProgramCounter, 0x6000_0000).unwrap();
    debugger.resume().unwrap();
    bench.host.wait_for("the fault", |line| line.starts_with("Error:firmware fault")).unwrap();
    bench.host.listen(std::time::Duration::from_millis(300)).unwrap();
    reset(&mut bench);
    assert_eq!(last_words(&greeting(&mut bench)), ["fault at 0x60000000"]);
}
