//! The knob of the Buddy's display, which a person presses.

use crate::bench::Bench;
use crate::boards::BOARDS;

/// Longer than a contact bounces, ms.
const PRESS_MS: u64 = 60;

fn set_pressed(bench: &mut Bench, is_pressed: bool) {
    bench.with(move |machine, _| {
        machine.plant.is_button_pressed = is_pressed;
        machine.plant.refresh_inputs();
    });
}

fn press(bench: &mut Bench) {
    set_pressed(bench, true);
    bench.pass(PRESS_MS);
    set_pressed(bench, false);
    bench.pass(PRESS_MS);
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
        assert!(heard.iter().all(|line| line != "ok"), "nobody has pressed: {heard:?}");
        press(&mut bench);
        bench.host.wait_for("that it goes on", |line| line == "//action:resumed").unwrap();
        bench.host.wait_for("its ok", |line| line.starts_with("ok")).unwrap();
    }
}
