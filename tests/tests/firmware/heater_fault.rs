//! A heater that gets too hot: everything off, and said as hosts expect, by the image itself.

use std::time::Duration;

use crate::image::Bench;

/// A target so near to the nozzle's maximum of 275 degrees that the loop overshoots it.
const TOO_NEAR: &str = "M104 S200";

#[test]
fn a_nozzle_that_gets_too_hot_stops_everything_and_says_so() {
    let mut bench = Bench::boot();
    for line in ["M302 P1", TOO_NEAR] {
        bench.host.send(line).unwrap();
    }
    // More motion than the nozzle needs to get there.
    bench.host.send_raw(b"G1 X400 F60\nM400\n").unwrap();
    let error = bench.host.wait_for("a thermal error", |line| line.starts_with("Error:")).unwrap();
    assert!(error.starts_with("Error:Heating failed, system stopped! Heater_ID: E0 (temp: 2"), "{error}");
    let at_once = bench.pins().events().len();
    let next = bench.host.wait_for("the next line", |_| true).unwrap();
    assert_eq!(next, "Error:Printer halted. kill() called!");
    let heard = bench.host.listen(Duration::from_millis(500)).unwrap();
    assert!(!heard.iter().any(|line| line.starts_with("Error:")), "told twice: {heard:?}");
    let pins = bench.pins();
    assert!(at_once > 0, "nothing had moved yet");
    assert_eq!(pins.events().len(), at_once, "the motors went on");
    assert!(pins.motors_disabled(), "the motors are still switched on");

    bench.host.send_raw(b"G1 X5\n").unwrap();
    bench.host.wait_for("a refusal", |line| line.contains("M999")).unwrap();
    // It has cooled below its maximum long ago.
    bench.host.send_raw(b"M999\nM105\n").unwrap();
    let temperatures = bench.host.wait_for("temperatures", |line| line.starts_with("ok T:")).unwrap();
    assert_eq!(temperatures.matches("/0.00").count(), 2, "a target is left: {temperatures}");
    assert!(temperatures.ends_with(" @:0 B@:0"), "a heater is on: {temperatures}");
    bench.host.send_raw(b"M104 S50\nM105\n").unwrap();
    bench.host.wait_for("the new target", |line| line.contains("/50.00")).unwrap();
}
