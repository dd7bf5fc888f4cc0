//! An overheated heater: everything off, and the error that hosts expect, from the image itself.

use crate::firmware::bench::Bench;
use crate::firmware::halted::errors_by_themselves;

/// A nozzle that heats, and its temperature far above the maximum of 275 degrees: the mainboard's
/// thermistor follows its B constant, by which it reads 20 degrees less there.
const HEAT: &str = "M104 S260";
const TOO_HOT_CELSIUS: f64 = 310.0;

/// Moves of 32,000 steps that are planned when the nozzle overheats: 160 s of motion.
const MOVES: usize = 20;

/// Long enough for thousands of steps, ms.
const A_WHILE_MS: u64 = 2000;

/// Checks for the two adjacent lines of the error, without a repetition.
fn assert_reported_once(bench: &mut Bench) {
    let error = bench.host.wait_for("a thermal error", |line| line.starts_with("Error:")).unwrap();
    assert!(error.starts_with("Error:MAXTEMP triggered, system stopped! Heater_ID: E0 (temp: 2"), "{error}");
    let next = bench.host.wait_for("the next line", |_| true).unwrap();
    assert_eq!(next, "Error:Printer halted. kill() called!");
    let at_once = bench.pins();
    assert!(at_once.motors_disabled(), "the motors are still switched on");
    let heard = bench.host.listen(A_WHILE_MS).unwrap();
    assert!(errors_by_themselves(&heard).is_empty(), "reported twice: {heard:?}");
    let later = bench.pins();
    assert_eq!(later.events().len(), at_once.events().len(), "the motors went on");
    assert!(later.motors_disabled(), "the motors are switched on again");
}

#[test]
fn an_overheated_nozzle_stops_everything_with_an_error() {
    let mut bench = Bench::boot();
    for line in ["M140 S60", HEAT] {
        bench.host.send(line).unwrap();
    }
    let moves = "G1 X400 F3000\nG1 X0\n".repeat(MOVES / 2);
    bench.host.send_raw(format!("{moves}M400\n").as_bytes()).unwrap();
    bench.pass(A_WHILE_MS);
    assert!(!bench.pins().events().is_empty() && bench.heater_power("nozzle") > 0.99);
    bench.set_celsius("nozzle", TOO_HOT_CELSIUS);
    assert_reported_once(&mut bench);
    assert!(bench.pins().events().len() < MOVES * 32_000, "the motion was over: nothing can be stopped");

    // The machine accepts commands after M999 only, which switches nothing on; the bed is off too,
    // although it did not fail.
    bench.host.send_raw(b"G1 X5\n").unwrap();
    bench.host.wait_for("a refusal", |line| line.contains("M999")).unwrap();
    bench.host.wait_for("ok", |line| line == "ok").unwrap();
    bench.set_celsius("nozzle", 100.0);
    bench.pass(A_WHILE_MS);
    bench.host.send_raw(b"M999\nM105\n").unwrap();
    let temperatures = bench.host.wait_for("temperatures", |line| line.starts_with("ok T:")).unwrap();
    assert_eq!(temperatures.matches("/0.00").count(), 2, "a target remains: {temperatures}");
    assert!(temperatures.ends_with(" @:0 B@:0"), "a heater is on: {temperatures}");
    bench.host.send_raw(b"M104 S50\nM105\n").unwrap();
    bench.host.wait_for("the new target", |line| line.contains("/50.00")).unwrap();
}

/// Without a running command that would notice the halt.
#[test]
fn an_overheated_nozzle_releases_the_motors_of_an_idle_machine() {
    let mut bench = Bench::boot();
    for line in [HEAT, "G1 X10 F3000", "M400"] {
        bench.host.send(line).unwrap();
    }
    assert!(!bench.pins().motors_disabled());
    bench.set_celsius("nozzle", TOO_HOT_CELSIUS);
    assert_reported_once(&mut bench);
    bench.set_celsius("nozzle", 100.0);
    bench.pass(A_WHILE_MS);
    bench.host.send_raw(b"M999\nM105\n").unwrap();
    bench.host.wait_for("temperatures", |line| line.starts_with("ok T:")).unwrap();
}
