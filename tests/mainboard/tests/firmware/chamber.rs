//! A chamber at the Octopus's connectors for a second nozzle: the image heats it, reads it
//! and halts for it.

use ferrostep_mainboard::parts::heat::thermistor::SensorFault;
use ferrostep_testkit::boards::pin;

use crate::firmware::bench::Bench;
use crate::firmware::equipped::boot;

/// The heater's output.
const HEATER: &str = "A3";

/// True if the heater's pin is high at any time within a fifth of a second.
fn is_heated(bench: &mut Bench) -> bool {
    (0..40).any(|_| {
        bench.pass(5);
        bench.state().is_high(pin(HEATER))
    })
}

#[test]
fn m191_heats_the_chamber_s_output_until_its_thermistor_is_warm() {
    let mut bench = boot();
    assert_eq!(bench.host.ask("M115", "Cap:CHAMBER").unwrap(), "Cap:CHAMBER_TEMPERATURE:1");
    assert!(bench.state().is_output(pin(HEATER)) && !is_heated(&mut bench));
    bench.host.send_raw(b"M105\n").unwrap();
    let cold = bench.host.wait_for("temperatures", |line| line.starts_with("ok T:")).unwrap();
    assert!(cold.contains(" C:2") && cold.contains(" C@:0"), "{cold}");
    bench.host.send("M141 S45").unwrap();
    assert!(is_heated(&mut bench));
    bench.host.send("M191 S45").unwrap();
    bench.host.send_raw(b"M105\n").unwrap();
    let warm = bench.host.wait_for("temperatures", |line| line.starts_with("ok T:")).unwrap();
    assert!(warm.contains(" C:4") && warm.contains(" /45.00 @:0 B@:0"), "{warm}");
    let now_ns = bench.now_ns();
    let celsius = bench.with(move |machine, _| {
        let place = machine.plant.heaters.iter_mut().find(|heater| heater.name == "nozzle1").unwrap();
        place.heater.body_celsius(now_ns)
    });
    assert!((43.0..47.0).contains(&celsius), "{celsius}");
    bench.host.send("M141 S0").unwrap();
    bench.pass(200);
    assert!(!is_heated(&mut bench));
}

#[test]
fn a_broken_thermistor_of_the_chamber_halts_the_printer() {
    let mut bench = boot();
    bench.host.send("M141 S45").unwrap();
    assert!(is_heated(&mut bench));
    bench.with(|machine, _| {
        let mut places = machine.plant.thermistors.iter_mut();
        places.find(|place| place.name == "nozzle2").unwrap().thermistor.set_fault(Some(SensorFault::Open));
    });
    let error = bench.host.wait_for("a thermal error", |line| line.starts_with("Error:")).unwrap();
    assert!(error.starts_with("Error:MINTEMP triggered, system stopped! Heater_ID: chamber"), "{error}");
    bench.pass(300);
    assert!(!is_heated(&mut bench) && !bench.any_heater_on());
}
