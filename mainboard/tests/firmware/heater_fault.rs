//! A heater that gets too hot: everything off, and said as hosts expect, by the image itself.

use crate::bench::Bench;

/// So near below the nozzle's maximum of 275 degrees that it is held only as long as nothing happens.
const WAIT_FOR_NOZZLE: &str = "M109 S274.5";

/// Moves of 32,000 steps that are planned when the nozzle is too hot: 160 s of motion.
const MOVES: usize = 20;

/// Long enough for thousands of steps, ms.
const A_WHILE_MS: u64 = 2000;

/// Two adjacent lines of the host's, and nothing of the kind after them.
fn assert_told_once(bench: &mut Bench) {
    let error = bench.host.wait_for("a thermal error", |line| line.starts_with("Error:")).unwrap();
    assert!(error.starts_with("Error:MAXTEMP triggered, system stopped! Heater_ID: E0 (temp: 275.0"), "{error}");
    let next = bench.host.wait_for("the next line", |_| true).unwrap();
    assert_eq!(next, "Error:Printer halted. kill() called!");
    let at_once = bench.pins();
    assert!(at_once.motors_disabled(), "the motors are still switched on");
    let heard = bench.host.listen(A_WHILE_MS).unwrap();
    assert!(!heard.iter().any(|line| line.starts_with("Error:")), "told twice: {heard:?}");
    let later = bench.pins();
    assert_eq!(later.events().len(), at_once.events().len(), "the motors went on");
    assert!(later.motors_disabled(), "the motors are switched on again");
}

/// The part-cooling fan goes off, and with it an eighth of what the nozzle loses: before the control has taken that back,
/// the nozzle is beyond its maximum.
#[test]
fn an_overheated_nozzle_stops_everything_and_is_reported() {
    let mut bench = Bench::boot();
    for line in ["M106 S255", "M140 S60", WAIT_FOR_NOZZLE] {
        bench.host.send(line).unwrap();
    }
    let moves = "G1 X400 F3000\nG1 X0\n".repeat(MOVES / 2);
    bench.host.send_raw(format!("G4 S60\nM107\n{moves}M400\n").as_bytes()).unwrap();
    assert_told_once(&mut bench);
    assert!(bench.pins().events().len() < MOVES * 32_000, "the motion was over: nothing can be stopped");

    // Only M999 makes it listen again, and switches nothing on; the bed was none of the fault, and is off as well.
    bench.host.send_raw(b"G1 X5\n").unwrap();
    bench.host.wait_for("a refusal", |line| line.contains("M999")).unwrap();
    bench.host.wait_for("ok", |line| line == "ok").unwrap();
    bench.host.send_raw(b"M999\nM105\n").unwrap();
    let temperatures = bench.host.wait_for("temperatures", |line| line.starts_with("ok T:")).unwrap();
    assert_eq!(temperatures.matches("/0.00").count(), 2, "a target is left: {temperatures}");
    assert!(temperatures.ends_with(" @:0 B@:0"), "a heater is on: {temperatures}");
    bench.host.send_raw(b"M104 S50\nM105\n").unwrap();
    bench.host.wait_for("the new target", |line| line.contains("/50.00")).unwrap();
}

/// No command is at work that would notice the halt.
#[test]
fn an_overheated_nozzle_at_rest_switches_motors_off() {
    let mut bench = Bench::boot();
    for line in ["M106 S255", WAIT_FOR_NOZZLE, "G4 S60", "G1 X10 F3000", "M400"] {
        bench.host.send(line).unwrap();
    }
    assert!(!bench.pins().motors_disabled());
    bench.host.send_raw(b"M107\n").unwrap();
    bench.host.wait_for("ok", |line| line == "ok").unwrap();
    assert_told_once(&mut bench);
    bench.host.send_raw(b"M999\nM105\n").unwrap();
    bench.host.wait_for("temperatures", |line| line.starts_with("ok T:")).unwrap();
}
