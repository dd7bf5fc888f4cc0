//! A power supply that the Octopus switches, and a light at one of its outputs for fans: by
//! command, at every halt, and after a crash of the firmware.

use ferrostep_mainboard::parts::heat::HeaterFault;
use ferrostep_testkit::boards::pin;

use crate::firmware::bench::Bench;
use crate::firmware::board_pins::{force_panic, jump_nowhere};
use crate::firmware::equipped::{boot, equipped};

/// The output PS-ON.
const SUPPLY: &str = "E11";

/// Long enough for the supply to fall, and for the image's last message, ms.
const A_WHILE_MS: u64 = 300;

/// The signal lasts for `debounce_s`, 6 ms, and is looked at every 2 ms.
const FAILURE_MS: u64 = 10;

/// Sets the signal of the module at PWR-DET.
fn set_signal(bench: &mut Bench, fails: bool) {
    bench.with(move |machine, _| {
        machine.plant.supply_fails = fails;
        machine.plant.refresh_inputs();
    });
}

/// True if the pin, which must be driven, switches the supply on; and true if motors and heaters
/// have their voltage.
fn supply(bench: &mut Bench) -> (bool, bool) {
    let state = bench.state();
    assert!(state.is_output(pin(SUPPLY)));
    let has_voltage = bench.with(|machine, _| machine.plant.motor_rail.on());
    (!state.is_high(pin(SUPPLY)), has_voltage)
}

#[test]
fn m80_and_m81_switch_the_supply_and_the_drivers_are_set_up_again() {
    let mut bench = boot();
    assert_eq!(supply(&mut bench), (true, true));
    // Only ever low or an input before the first command: the supply does not go off and
    // on at the start.
    assert!(!bench.port_writes().iter().any(|write| write.level(pin(SUPPLY)) == Some(true)));
    assert_eq!(bench.host.ask("M115", "Cap:SOFTWARE_POWER").unwrap(), "Cap:SOFTWARE_POWER:1");
    for line in ["G91", "G1 X1 F1200", "M400", "M104 S60"] {
        bench.host.send(line).unwrap();
    }
    bench.host.send("M81").unwrap();
    bench.pass(A_WHILE_MS);
    assert_eq!(supply(&mut bench), (false, false));
    assert!(!bench.any_heater_on() && bench.pins().motors_disabled());
    assert_eq!(bench.host.ask("M80 S", "PS:").unwrap(), "PS:0");
    for line in ["G1 X1", "M104 S60", "G28", "M17"] {
        bench.host.send_raw(format!("{line}\n").as_bytes()).unwrap();
        let refusal = bench.host.wait_for("a refusal", |text| text.contains("power supply")).unwrap();
        assert!(refusal.ends_with("the power supply is off: M80 switches it on"), "{line}: {refusal}");
        bench.host.wait_for("its ok", |text| text == "ok").unwrap();
    }
    // The drivers are reset by their supply; a move waits until they have confirmed their settings.
    bench.host.send("M80").unwrap();
    assert_eq!(supply(&mut bench), (true, true));
    for line in ["G91", "G1 X1 F1200", "M400"] {
        bench.host.send(line).unwrap();
    }
    let report = bench.host.ask("M122", "echo:driver X").unwrap();
    assert!(report.starts_with("echo:driver X: confirmed, "), "{report}");
    bench.with(|machine, _| {
        for driver in machine.plant.drivers.iter().take(2) {
            assert!(driver.energized(), "no current");
        }
    });
}

/// The host prints, so that there is no place to keep: motors and heaters go off, before the
/// module is empty.
#[test]
fn a_module_that_says_that_the_supply_fails_halts_the_machine() {
    let mut bench = boot();
    assert_eq!(
        bench.host.ask("M413", "echo:Power-loss").unwrap(),
        "echo:Power-loss recovery ON; the supply is right by its signal"
    );
    for line in ["M104 S200", "G91", "G1 X100 F3000"] {
        bench.host.send(line).unwrap();
    }
    bench.pass(200);
    assert!(bench.any_heater_on() && !bench.pins().events().is_empty());
    // A spike of 3 ms does not count.
    set_signal(&mut bench, true);
    bench.pass(3);
    set_signal(&mut bench, false);
    bench.pass(50);
    let before = bench.pins().events().len();
    bench.pass(10);
    assert!(bench.pins().events().len() > before, "a spike has stopped the motors");
    set_signal(&mut bench, true);
    let mut heard = bench.host.listen(FAILURE_MS).unwrap();
    let stopped = bench.pins().events().len();
    assert!(!bench.any_heater_on(), "heaters first");
    heard.extend(bench.host.listen(A_WHILE_MS).unwrap());
    let told = heard.iter().position(|line| line == "echo:power loss: the supply fails");
    let next = told.and_then(|told| heard.get(told + 1));
    assert!(next.is_some_and(|line| line.contains("kill() called!")), "{heard:?}");
    let pins = bench.pins();
    assert_eq!(pins.events().len(), stopped, "the motors went on");
    assert!(pins.motors_disabled() && !bench.any_heater_on());
    // It was a dip.
    set_signal(&mut bench, false);
    bench.pass(50);
    bench.host.send_raw(b"M999\nM413\n").unwrap();
    bench
        .host
        .wait_for("its state", |line| line == "echo:Power-loss recovery ON; the supply is right by its signal")
        .unwrap();
}

#[test]
fn every_halt_and_every_crash_switches_it_off() {
    let mut bench = boot();
    bench.host.send("M104 S60").unwrap();
    bench.host.send_raw(b"M112\n").unwrap();
    bench.host.wait_for("the end", |line| line.contains("kill() called!")).unwrap();
    bench.pass(A_WHILE_MS);
    assert_eq!(supply(&mut bench), (false, false));
    bench.host.send_raw(b"M999\n").unwrap();
    bench
        .host
        .wait_for("the supply's state", |line| line == "echo:the power supply is off: M80 switches it on")
        .unwrap();
    bench.pass(A_WHILE_MS);
    assert_eq!(supply(&mut bench), (false, false), "M999 switches nothing on");
    bench.host.send("M80").unwrap();
    assert_eq!(supply(&mut bench), (true, true));

    force_panic(&equipped().image, &mut bench);
    bench.host.wait_for("the panic", |line| line.starts_with("Error:firmware panic")).unwrap();
    bench.pass(A_WHILE_MS);
    assert_eq!(supply(&mut bench), (false, false));
    bench.press_reset();
    bench.host.wait_for("start", |line| line == "start").unwrap();
    bench.pass(A_WHILE_MS);
    assert_eq!(supply(&mut bench), (true, true), "as the profile says");

    let mut bench = boot();
    jump_nowhere(&mut bench);
    bench.host.wait_for("the fault", |line| line.starts_with("Error:firmware fault")).unwrap();
    bench.pass(A_WHILE_MS);
    assert_eq!(supply(&mut bench), (false, false));
}

/// The transistor of the nozzle's heater fails closed: its own switch has no effect,
/// the supply's has.
#[test]
fn a_transistor_that_has_failed_closed_is_without_power_when_it_is_noticed() {
    let mut bench = boot();
    let celsius = |bench: &mut Bench| {
        let now_ns = bench.now_ns();
        bench.with(move |machine, _| {
            let heaters = machine.plant.heaters.iter_mut();
            heaters.into_iter().find(|heater| heater.name == "nozzle").unwrap().heater.body_celsius(now_ns)
        })
    };
    bench.change(|plant, now_ns| {
        let heaters = plant.heaters.iter_mut();
        heaters
            .into_iter()
            .find(|heater| heater.name == "nozzle")
            .unwrap()
            .heater
            .set_fault(now_ns, Some(HeaterFault::StuckOn));
    });
    let error = bench.host.wait_for("a thermal error", |line| line.starts_with("Error:")).unwrap();
    assert!(error.starts_with("Error:Thermal Runaway, system stopped! Heater_ID: E0"), "{error}");
    bench.pass(A_WHILE_MS);
    assert_eq!(supply(&mut bench), (false, false));
    let noticed = celsius(&mut bench);
    bench.pass(30_000);
    let later = celsius(&mut bench);
    assert!(noticed > 30.0 && later < noticed, "{noticed} {later}");
}

#[test]
fn a_light_has_its_values_for_the_start_and_for_a_halt() {
    let mut bench = boot();
    let light = |bench: &mut Bench| {
        // Longer than a sample of the heaters' control, and than a period of the fans' timers.
        bench.pass(50);
        bench.with(|machine, _| machine.plant.fans.iter().find(|fan| fan.name == "fan2").unwrap().power)
    };
    assert!((light(&mut bench) - 0.5).abs() < 0.01);
    bench.host.send("M42 P0 S255").unwrap();
    assert!((light(&mut bench) - 1.0).abs() < 0.01);
    bench.host.send("SET_PIN PIN=light VALUE=0.2").unwrap();
    assert!((light(&mut bench) - 0.2).abs() < 0.01);
    bench.host.send_raw(b"M42 P5 S255\n").unwrap();
    bench.host.wait_for("a refusal", |line| line.ends_with("P: no output of the profile has this number")).unwrap();
    bench.host.send("M42 P0 S0").unwrap();
    assert!(light(&mut bench) < 0.01);
    bench.host.send_raw(b"M112\n").unwrap();
    bench.host.wait_for("the end", |line| line.contains("kill() called!")).unwrap();
    assert!((light(&mut bench) - 1.0).abs() < 0.01);
    bench.host.send_raw(b"M999\n").unwrap();
    bench.host.wait_for("ok", |line| line == "ok").unwrap();
    assert!(light(&mut bench) < 0.01);
    force_panic(&equipped().image, &mut bench);
    bench.host.wait_for("the panic", |line| line.starts_with("Error:firmware panic")).unwrap();
    bench.pass(A_WHILE_MS);
    let state = bench.state();
    assert!(state.is_output(pin("D12")) && state.is_high(pin("D12")), "the safe state lights it");
}
