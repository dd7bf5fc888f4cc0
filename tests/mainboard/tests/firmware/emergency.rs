//! M112: motors stop, heaters go off, and the host gets the reply that it expects.

use crate::firmware::bench::Bench;
use crate::firmware::halted::errors_by_themselves;
use crate::firmware::job::Job;
use crate::firmware::rehearsal::Rehearsal;
use crate::firmware::same_steps::LINES;

/// Marlin's text.
const KILLED: &str = "Error:Printer halted. kill() called!";

/// Lines of the cube after which the look-ahead ring is full and the motors run.
const LINES_INTO_THE_PRINT: usize = 100;

/// Long enough for thousands of steps, ms.
const A_WHILE_MS: u64 = 500;

/// Sends M112 out of turn and checks that all motion has ended when the reply arrives.
fn stop(bench: &mut Bench) {
    bench.host.send_raw(b"M112\n").unwrap();
    bench.host.wait_for(KILLED, |line| line == KILLED).unwrap();
    let at_once = bench.pins().events().len();
    let heard = bench.host.listen(A_WHILE_MS).unwrap();
    let pins = bench.pins();
    assert_eq!(pins.events().len(), at_once, "the motors went on");
    assert!(pins.motors_disabled(), "the motors are still switched on");
    assert!(errors_by_themselves(&heard).is_empty(), "killed twice: {heard:?}");
}

/// Checks that the machine accepts commands after M999 only, and that its heaters are off.
fn assert_cold_after_restart(bench: &mut Bench) {
    bench.host.send_raw(b"M104 S200\n").unwrap();
    bench.host.wait_for("a refusal", |line| line.contains("M999")).unwrap();
    bench.host.wait_for("ok", |line| line == "ok").unwrap();
    bench.host.send_raw(b"M999\nM105\n").unwrap();
    let temperatures = bench.host.wait_for("temperatures", |line| line.starts_with("ok T:")).unwrap();
    assert_eq!(temperatures.matches("/0.00").count(), 2, "a target remains: {temperatures}");
    assert!(temperatures.ends_with(" @:0 B@:0"), "a heater is on: {temperatures}");
}

#[test]
fn an_emergency_stop_ends_a_print_at_once() {
    let job = Job::cube(LINES).without_heating().without_homing();
    let mut bench = Bench::boot();
    for line in job.lines().take(LINES_INTO_THE_PRINT) {
        bench.host.send(line).unwrap();
    }
    let before = bench.pins().events().len();
    stop(&mut bench);
    assert_cold_after_restart(&mut bench);
    let pins = bench.switch_off();
    let rehearsal = Rehearsal::of(&job);
    rehearsal.assert_begins_with(&job, &pins);
    assert!(before > 0, "nothing had moved yet");
    let (seen, whole) = (pins.events().len(), rehearsal.event_count());
    assert!(seen < whole, "the print had already ended");
}

#[test]
fn an_emergency_stop_ends_a_wait_for_heat() {
    let mut bench = Bench::boot();
    bench.host.send("M140 S60").unwrap();
    bench.host.send_raw(b"M109 S210\n").unwrap();
    let waiting = bench.host.wait_for("a report of the wait", |line| line.contains(" W:")).unwrap();
    assert!(waiting.contains("/210.00") && waiting.contains("/60.00"), "{waiting}");
    assert!(!waiting.contains(" @:0 "), "the nozzle is not heated: {waiting}");
    stop(&mut bench);
    assert_cold_after_restart(&mut bench);
    assert_eq!(bench.switch_off().events(), []);
}
