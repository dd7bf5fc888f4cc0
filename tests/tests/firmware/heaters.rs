//! Printer boards heat: by the right pins, watched by their thermistors, and off when those cannot be read.

use std::time::Duration;

use ferrostep_tests::qemu::{PortState, Register, Sleep};

use crate::board_pins::{
    assert_all_off, assert_heaters_are_taken_from_timers, assert_heaters_come_first, assert_no_timer_heats,
};
use crate::boards::{BOARDS, BoardFacts, pin};
use crate::image::{Bench, image_of};
use crate::thermistors::{reading, set_reading};

/// Some periods of the heaters' pulses. The emulator's seconds are ten times as fast as the wall's: a nozzle whose
/// thermistor stays cold trips after two of those.
const A_WHILE: Duration = Duration::from_millis(200);

/// Between two looks at the pins.
const A_MOMENT: Duration = Duration::from_millis(20);

/// Far longer than the emulator takes on a busy computer.
const MOST_MOMENTS: u32 = 500;

/// Nothing is here.
const NOWHERE: u32 = 0x6000_0000;

fn printers() -> impl Iterator<Item = &'static BoardFacts> {
    BOARDS.iter().filter(|board| board.is_printer())
}

/// The pins after all stores so far.
fn state(bench: &mut Bench) -> PortState {
    let mut state = PortState::new();
    bench.port_writes().into_iter().for_each(|write| state.apply(write));
    state
}

/// Waits until nozzle and bed have full power, or none.
fn wait_for_powers(board: &BoardFacts, bench: &mut Bench, powers: [bool; 2]) {
    for _ in 0..MOST_MOMENTS {
        if at_full_power(board, bench) == powers {
            return;
        }
        bench.host.listen(A_MOMENT).unwrap();
    }
    panic!("{}: the powers are not {powers:?}", board.name);
}

/// Whether nozzle and bed have full power.
fn at_full_power(board: &BoardFacts, bench: &mut Bench) -> [bool; 2] {
    match board.heater_timers {
        Some(compares) => {
            let state = state(bench);
            compares
                .map(|compare| bench.register(compare) == 1000)
                .map(|full| full && board.heater_pins().iter().all(|heater| state.is_alternate(*heater)))
        }
        None => {
            let state = state(bench);
            [0, 1].map(|heater| state.is_high(board.heater_pins()[heater]))
        }
    }
}

/// Heats nozzle and bed one after the other, and checks that it is theirs that are on.
fn heat(board: &BoardFacts, bench: &mut Bench) {
    for (command, powers) in [("M104 S60", [true, false]), ("M140 S50", [true, true])] {
        bench.host.send(command).unwrap();
        wait_for_powers(board, bench, powers);
    }
    let state = state(bench);
    for other in &board.heater_pins()[2..] {
        assert!(!state.is_high(*other), "{}: {other:?}", board.name);
    }
}

fn assert_off(board: &BoardFacts, bench: &mut Bench) {
    let state = state(bench);
    for heater in board.heater_pins() {
        assert!(!state.is_high(heater), "{}: {heater:?}", board.name);
    }
    assert_no_timer_heats(board, bench);
}

#[test]
fn a_broken_thermistor_switches_all_heaters_off_and_is_said() {
    for board in printers() {
        let mut bench = Bench::boot_board(board);
        bench.host.send_raw(b"M105\n").unwrap();
        let temperatures = bench.host.wait_for("temperatures", |line| line.starts_with("ok T:")).unwrap();
        assert!(temperatures.starts_with("ok T:2") && temperatures.contains(" B:25.0"), "{temperatures}");
        let capability = bench.host.ask("M115", "Cap:THERMAL_PROTECTION").unwrap();
        assert_eq!(capability, "Cap:THERMAL_PROTECTION:1");
        heat(board, &mut bench);

        set_reading(&mut bench, u16::MAX);
        let error = bench.host.wait_for("a thermal error", |line| line.starts_with("Error:")).unwrap();
        assert_eq!(error, "Error:MINTEMP triggered, system stopped! Heater_ID: E0", "{}", board.name);
        let next = bench.host.wait_for("the next line", |_| true).unwrap();
        assert_eq!(next, "Error:Printer halted. kill() called!");
        assert_off(board, &mut bench);
        assert_all_off(board, &state(&mut bench));

        // Nothing heats again before M999, and that is refused while it is broken.
        bench.host.send_raw(b"M104 S60\n").unwrap();
        bench.host.wait_for("a refusal", |line| line.contains("M999")).unwrap();
        bench.host.send_raw(b"M999\n").unwrap();
        bench.host.wait_for("the same again", |line| line.starts_with("Error:MINTEMP triggered")).unwrap();
        set_reading(&mut bench, reading(25.0));
        bench.host.listen(A_WHILE).unwrap();
        assert_off(board, &mut bench);
        bench.host.send_raw(b"M999\nM105\n").unwrap();
        bench.host.wait_for("temperatures", |line| line.starts_with("ok T:")).unwrap();
        assert_off(board, &mut bench);
        bench.host.send_raw(b"M104 S60\nM400\n").unwrap();
        wait_for_powers(board, &mut bench, [true, false]);
    }
}

#[test]
fn m112_switches_heaters_off_at_once() {
    for board in printers() {
        let mut bench = Bench::boot_board(board);
        heat(board, &mut bench);
        bench.host.send_raw(b"M112\n").unwrap();
        bench.host.wait_for("the end", |line| line.contains("kill() called!")).unwrap();
        assert_off(board, &mut bench);
    }
}

#[test]
fn a_fault_while_heating_takes_the_pins_from_the_timers_first() {
    for board in printers() {
        let mut bench = Bench::boot_board(board);
        heat(board, &mut bench);
        let mut debugger = bench.host.port().halt().unwrap();
        let before = bench.port_writes().len();
        debugger.set_register(Register::ProgramCounter, NOWHERE).unwrap();
        debugger.resume().unwrap();
        bench.host.wait_for("a fault", |line| line.starts_with("Error:firmware fault")).unwrap();
        bench.host.listen(A_WHILE).unwrap();
        let writes = bench.port_writes();
        assert_heaters_come_first(board, &writes[before..]);
        let state = state(&mut bench);
        assert_all_off(board, &state);
        // Whatever the timer goes on to do, it reaches no heater.
        assert_heaters_are_taken_from_timers(board, &state);
    }
}

#[test]
fn fans_turn_when_they_are_told_to_and_above_a_hot_nozzle() {
    for board in printers() {
        let mut bench = Bench::boot_board(board);
        assert_eq!(bench.logged(board.full_fan), 0, "{}", board.name);
        for line in ["M106 S255", "M400"] {
            bench.host.send(line).unwrap();
        }
        bench.host.listen(A_WHILE).unwrap();
        assert_eq!(bench.logged(board.full_fan), 1, "{}", board.name);
        // The Octopus's hot-end fan has no timer, and can be seen.
        if board.name == "btt-octopus-1.1" {
            let fan = pin("E5");
            assert!(!state(&mut bench).is_high(fan));
            for (celsius, is_on) in [(55.0, true), (47.0, true), (40.0, false)] {
                set_reading(&mut bench, reading(celsius));
                bench.host.listen(A_WHILE).unwrap();
                assert_eq!(state(&mut bench).is_high(fan), is_on, "{celsius}");
            }
        }
    }
}

/// The emulator's converter never converts: a board whose thermistors cannot be read at all.
#[test]
fn a_converter_that_does_not_run_is_said_and_nothing_heats() {
    for board in printers() {
        let mut bench = Bench::switch_on(&image_of(board.name), Sleep::RealTime);
        let error = bench.host.wait_for("a thermal error", |line| line.starts_with("Error:MINTEMP")).unwrap();
        assert_eq!(error, "Error:MINTEMP triggered, system stopped! Heater_ID: E0", "{}", board.name);
        let next = bench.host.wait_for("the next line", |_| true).unwrap();
        assert_eq!(next, "Error:Printer halted. kill() called!");
        bench.host.send_raw(b"M104 S200\nM999\nM104 S200\n").unwrap();
        bench.host.wait_for("the same again", |line| line.starts_with("Error:MINTEMP triggered")).unwrap();
        bench.host.listen(A_WHILE).unwrap();
        assert_off(board, &mut bench);
    }
}

/// A host that has gone: after M86's time no heater of a real board has power, and the machine is not halted.
#[test]
fn heaters_that_nothing_uses_go_off() {
    for board in printers() {
        let mut bench = Bench::boot_board(board);
        bench.host.send("M86 S4").unwrap();
        heat(board, &mut bench);
        bench.host.wait_for("the warning", |line| line.starts_with("echo:heaters go off in 2 s: ")).unwrap();
        bench.host.wait_for("the end", |line| line.starts_with("echo:heaters switched off: 4 s ")).unwrap();
        wait_for_powers(board, &mut bench, [false; 2]);
        assert_off(board, &mut bench);
        // In a dwell the same, and a line that waits its turn keeps them on.
        heat(board, &mut bench);
        bench.host.send_raw(b"G4 S9\n").unwrap();
        bench.host.wait_for("the warning", |line| line.starts_with("echo:heaters go off in 2 s: ")).unwrap();
        bench.host.send_raw(b"M105\n").unwrap();
        bench.host.wait_for("the warning anew", |line| line.starts_with("echo:heaters go off in 2 s: ")).unwrap();
        assert_eq!(at_full_power(board, &mut bench), [true; 2], "{}", board.name);
        bench.host.wait_for("the end", |line| line.starts_with("echo:heaters switched off: 4 s ")).unwrap();
        wait_for_powers(board, &mut bench, [false; 2]);
        let report = bench.host.wait_for("temperatures", |line| line.starts_with("ok T:")).unwrap();
        assert!(report.ends_with(" @:0 B@:0"), "{report}");
    }
}
