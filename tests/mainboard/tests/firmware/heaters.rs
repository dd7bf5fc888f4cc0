//! Printer boards heat with the right pins, monitor their thermistors, and switch off when
//! these cannot be read.

use ferrostep_mainboard::machine::Machine;
use ferrostep_mainboard::parts::heat::thermistor::SensorFault;
use ferrostep_testkit::boards::{BOARDS, BoardFacts};

use crate::firmware::bench::Bench;
use crate::firmware::board_pins::{
    assert_all_off, assert_heaters_are_taken_from_timers, assert_nothing_heats, jump_nowhere,
};

/// Some periods of the heaters' pulses, ms.
const A_WHILE_MS: u64 = 1000;

/// Interval of polls of the heaters, ms.
const A_MOMENT_MS: u64 = 20;

/// Maximum polls before the powers must have settled: 10 s.
const MAX_POLLS: u32 = 500;

/// Minimum speed of a fan at full power, turns per minute.
const FULL_RPM: f64 = 5900.0;

fn printers() -> impl Iterator<Item = &'static BoardFacts> {
    BOARDS.iter().filter(|board| board.is_printer())
}

/// Waits until nozzle and bed have full power, or none.
fn wait_for_powers(board: &BoardFacts, bench: &mut Bench, powers: [bool; 2]) {
    for _ in 0..MAX_POLLS {
        if at_full_power(bench) == powers {
            return;
        }
        bench.wait_us(A_MOMENT_MS * 1000);
    }
    panic!("{}: the powers never become {powers:?}", board.name);
}

/// True for nozzle and bed each if it has full power.
fn at_full_power(bench: &mut Bench) -> [bool; 2] {
    ["nozzle", "bed"].map(|heater| bench.heater_power(heater) > 0.99)
}

/// Heats nozzle and bed one after the other, and checks their pins.
fn heat(board: &BoardFacts, bench: &mut Bench) {
    for (command, powers) in [("M104 S150", [true, false]), ("M140 S60", [true, true])] {
        bench.host.send(command).unwrap();
        wait_for_powers(board, bench, powers);
    }
    let state = bench.state();
    for other in &board.heater_pins()[2..] {
        assert!(!state.is_high(*other), "{}: {other:?}", board.name);
    }
}

fn assert_off(board: &BoardFacts, bench: &mut Bench) {
    let state = bench.state();
    for heater in board.heater_pins() {
        assert!(!state.is_high(heater), "{}: {heater:?}", board.name);
    }
    assert_nothing_heats(board, bench);
}

/// Unplugs a thermistor, or plugs it in again.
fn unplug(machine: &mut Machine, name: &str, out: bool) {
    let places = machine.plant.thermistors.iter_mut();
    let place = places.into_iter().find(|place| place.name == name).unwrap();
    place.thermistor.set_fault(out.then_some(SensorFault::Open));
}

#[test]
fn a_broken_thermistor_switches_all_heaters_off_with_an_error() {
    for board in printers() {
        let mut bench = Bench::boot_board(board);
        bench.host.send_raw(b"M105\n").unwrap();
        let temperatures = bench.host.wait_for("temperatures", |line| line.starts_with("ok T:")).unwrap();
        // The room's temperature.
        assert!(temperatures.starts_with("ok T:2") && temperatures.contains(" B:2"), "{temperatures}");
        let capability = bench.host.ask("M115", "Cap:THERMAL_PROTECTION").unwrap();
        assert_eq!(capability, "Cap:THERMAL_PROTECTION:1");
        heat(board, &mut bench);

        bench.with(|machine, _| unplug(machine, "nozzle", true));
        let error = bench.host.wait_for("a thermal error", |line| line.starts_with("Error:")).unwrap();
        // A sample during which the plug came out has a temperature, a later one has none.
        assert!(error.starts_with("Error:MINTEMP triggered, system stopped! Heater_ID: E0"), "{}: {error}", board.name);
        let next = bench.host.wait_for("the next line", |_| true).unwrap();
        assert_eq!(next, "Error:Printer halted. kill() called!");
        assert_off(board, &mut bench);
        assert_all_off(board, &bench.state());

        // Heating requires M999, which is refused while the thermistor is broken.
        bench.host.send_raw(b"M104 S60\n").unwrap();
        bench.host.wait_for("a refusal", |line| line.contains("M999")).unwrap();
        bench.host.send_raw(b"M999\n").unwrap();
        bench.host.wait_for("the repeated error", |line| line.starts_with("Error:MINTEMP triggered")).unwrap();
        bench.with(|machine, _| unplug(machine, "nozzle", false));
        bench.pass(A_WHILE_MS);
        assert_off(board, &mut bench);
        bench.host.send_raw(b"M999\nM105\n").unwrap();
        bench.host.wait_for("temperatures", |line| line.starts_with("ok T:")).unwrap();
        assert_off(board, &mut bench);
        bench.host.send_raw(b"M104 S150\nM400\n").unwrap();
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
        let mut bench = Bench::boot_patched(board);
        heat(board, &mut bench);
        jump_nowhere(&mut bench);
        bench.host.wait_for("a fault", |line| line.starts_with("Error:firmware fault")).unwrap();
        bench.pass(100);
        let state = bench.state();
        assert_all_off(board, &state);
        // The timer continues, but its output reaches no heater.
        assert_heaters_are_taken_from_timers(board, &state);
        assert_off(board, &mut bench);
    }
}

/// The speed of a fan, turns per minute.
fn rpm(bench: &mut Bench, name: &'static str) -> f64 {
    let now_ns = bench.now_ns();
    bench.with(move |machine, _| {
        machine.plant.fans.iter_mut().find(|fan| fan.name == name).map(|fan| fan.fan.rpm(now_ns)).unwrap()
    })
}

/// The nozzle's temperature at its sensor.
fn nozzle_celsius(bench: &mut Bench) -> f64 {
    let now_ns = bench.now_ns();
    bench.with(move |machine, _| {
        let nozzle = machine.plant.heaters.iter_mut().find(|heater| heater.name == "nozzle").unwrap();
        nozzle.heater.sensor_celsius(now_ns)
    })
}

#[test]
fn fans_turn_on_command_and_above_a_hot_nozzle() {
    for board in printers() {
        let mut bench = Bench::boot_board(board);
        bench.pass(2000);
        assert_eq!([rpm(&mut bench, "part"), rpm(&mut bench, "hotend")], [0.0; 2], "{}", board.name);
        for line in ["M106 S255", "M400"] {
            bench.host.send(line).unwrap();
        }
        bench.pass(5000);
        assert!(rpm(&mut bench, "part") > FULL_RPM && rpm(&mut bench, "hotend") == 0.0, "{}", board.name);
        // A hot nozzle is cooled until it is cold.
        bench.host.send("M109 S60").unwrap();
        bench.pass(2000);
        assert!(rpm(&mut bench, "hotend") > FULL_RPM, "{}: no fan above a hot nozzle", board.name);
        bench.host.send("M104 S0").unwrap();
        bench.set_celsius("nozzle", 51.0);
        while nozzle_celsius(&mut bench) > 47.0 {
            assert!(rpm(&mut bench, "hotend") > FULL_RPM, "{}: the fan stops too early", board.name);
            bench.pass(1000);
        }
        bench.set_celsius("nozzle", 40.0);
        while nozzle_celsius(&mut bench) > 36.0 {
            bench.pass(1000);
        }
        assert_eq!(rpm(&mut bench, "hotend"), 0.0, "{}: the fan does not stop", board.name);
        bench.host.send("M107").unwrap();
        bench.pass(10_000);
        assert_eq!([rpm(&mut bench, "part"), rpm(&mut bench, "hotend")], [0.0; 2], "{}", board.name);
    }
}

/// A board whose thermistors cannot be read from the start, as a bare one's.
#[test]
fn missing_thermistors_are_reported_and_prevent_heating() {
    for board in &BOARDS {
        let mut bench = Bench::switch_on(board, |machine| {
            ["nozzle", "bed"].into_iter().for_each(|name| unplug(machine, name, true));
        });
        let error = bench.host.wait_for("a thermal error", |line| line.starts_with("Error:MINTEMP")).unwrap();
        // A sample during which the plug came out has a temperature, a later one has none.
        assert!(error.starts_with("Error:MINTEMP triggered, system stopped! Heater_ID: E0"), "{}: {error}", board.name);
        let next = bench.host.wait_for("the next line", |_| true).unwrap();
        assert_eq!(next, "Error:Printer halted. kill() called!");
        bench.host.send_raw(b"M104 S200\nM999\nM104 S200\n").unwrap();
        bench.host.wait_for("the repeated error", |line| line.starts_with("Error:MINTEMP triggered")).unwrap();
        bench.pass(A_WHILE_MS);
        assert_off(board, &mut bench);
    }
}

/// A host that has vanished: after M86's time no heater of a real board has power, and the
/// machine is not halted.
#[test]
fn unused_heaters_go_off() {
    for board in printers() {
        let mut bench = Bench::boot_board(board);
        bench.host.send("M86 S4").unwrap();
        heat(board, &mut bench);
        bench.host.wait_for("the warning", |line| line.starts_with("echo:heaters go off in 2 s: ")).unwrap();
        bench.host.wait_for("the end", |line| line.starts_with("echo:heaters switched off: 4 s ")).unwrap();
        wait_for_powers(board, &mut bench, [false; 2]);
        assert_off(board, &mut bench);
        // A dwell is use, and the time begins at its end; any line keeps them on.
        heat(board, &mut bench);
        bench.host.send_raw(b"G4 S5\n").unwrap();
        bench.host.wait_for("the end of the dwell", |line| line == "ok").unwrap();
        assert_eq!(at_full_power(&mut bench), [true; 2], "{}", board.name);
        bench.host.wait_for("the warning", |line| line.starts_with("echo:heaters go off in 2 s: ")).unwrap();
        bench.host.send_raw(b"M105\n").unwrap();
        bench.host.wait_for("the repeated warning", |line| line.starts_with("echo:heaters go off in 2 s: ")).unwrap();
        assert_eq!(at_full_power(&mut bench), [true; 2], "{}", board.name);
        bench.host.wait_for("the end", |line| line.starts_with("echo:heaters switched off: 4 s ")).unwrap();
        wait_for_powers(board, &mut bench, [false; 2]);
        bench.host.send_raw(b"M105\n").unwrap();
        let report = bench.host.wait_for("temperatures", |line| line.starts_with("ok T:")).unwrap();
        assert!(report.ends_with(" @:0 B@:0"), "{report}");
    }
}
