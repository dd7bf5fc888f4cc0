//! The knob of the Buddy's display, which a person presses.

use ferrostep_testkit::boards::BOARDS;

use crate::firmware::bench::Bench;

/// Longer than a contact bounces, ms.
const PRESS_MS: u64 = 60;

/// Longer than the way back to the print, ms.
const A_WHILE_MS: u64 = 1_000;

fn set_pressed(bench: &mut Bench, is_pressed: bool) {
    bench.with(move |machine, _| {
        machine.plant.is_button_pressed = is_pressed;
        machine.plant.refresh_inputs();
    });
}

/// A press, and what the printer says from its begin on.
fn press(bench: &mut Bench) -> Vec<String> {
    set_pressed(bench, true);
    let mut heard = bench.host.listen(PRESS_MS).unwrap();
    set_pressed(bench, false);
    heard.extend(bench.host.listen(A_WHILE_MS).unwrap());
    heard
}

#[test]
fn a_press_goes_on_with_a_print_that_waits_and_with_nothing_else() {
    let board = BOARDS.iter().find(|board| board.name == "prusa-buddy").unwrap();
    let mut bench = Bench::boot_board(board);
    // A press from before is no answer.
    press(&mut bench);
    for _ in 0..2 {
        bench.host.begin("M0").unwrap();
        bench.host.wait_for("that it waits", |line| line == "echo:busy: paused for user").unwrap();
        let heard = bench.host.listen(3_000).unwrap();
        assert!(heard.iter().all(|line| line != "ok"), "it went on without a press: {heard:?}");
        let heard = press(&mut bench);
        let resumed = heard.iter().position(|line| line == "//action:resumed");
        let answered = heard.iter().position(|line| line.starts_with("ok"));
        assert!(resumed.is_some() && resumed < answered, "{heard:?}");
    }
}
