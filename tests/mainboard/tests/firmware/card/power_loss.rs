//! Power cuts in a print from the card, and the place at which a new start continues.

use ferrostep_mainboard::machine::Machine;

use super::*;

/// As [`super::BEFORE`], for a print whose place is kept: the axes must be homed.
const BEFORE: &str = "M302 P1\nG28\nG1 Z2 F600\nG1 X285 Y285 F6000\n";

/// Somebody has pushed the head near the ends at which it homes, which saves the test's time.
fn pushed_home(machine: &mut Machine) {
    // A is X + Y, B is X - Y.
    let [x_mm, y_mm, z_mm] = [0, 1, 2].map(|axis| machine.plant.motion.position_mm(axis));
    let (dx_mm, dy_mm) = (296.0 - x_mm, 296.0 - y_mm);
    for (motor, by_mm) in [(0, dx_mm + dy_mm), (1, dx_mm - dy_mm), (2, 3.0 - z_mm)] {
        machine.plant.motion.turn_by_hand(motor, by_mm);
    }
}

/// Kinds of cuts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cut {
    /// All supplies fail.
    Power,
    /// The reset button: the card keeps its supply and its state.
    Reset,
}

/// The number after a word of the report of an interrupted print.
fn number_after(heard: &[String], word: &str) -> u32 {
    let report = heard.iter().find(|line| line.contains("was interrupted at")).unwrap();
    let rest = report.split_once(word).unwrap().1;
    rest.split(|it: char| !it.is_ascii_digit()).find(|digits| !digits.is_empty()).unwrap().parse().unwrap()
}

/// Waits for the card to write a block, 10 s at most.
fn wait_for_write(bench: &mut Bench) {
    for _ in 0..20_000 {
        bench.wait_us(500);
        let now_ns = bench.now_ns();
        if bench.with(move |machine, _| machine.card().unwrap().is_programming(now_ns)) {
            return;
        }
    }
    panic!("the card writes no place");
}

fn cut(bench: &mut Bench, how: Cut) {
    if how == Cut::Reset {
        return bench.press_reset();
    }
    let now_ns = bench.now_ns();
    bench.with(move |machine, _| {
        machine.plant.chip_rail.cut(now_ns);
        machine.plant.motor_rail.cut(now_ns);
    });
    bench.pass(200);
    let now_ns = bench.now_ns();
    bench.with(move |machine, _| {
        machine.plant.chip_rail.restore(now_ns);
        machine.plant.motor_rail.restore(now_ns);
    });
}

/// The report of the interrupted print, at the start.
fn report(bench: &mut Bench) -> Vec<String> {
    bench.host.wait_for("the start", |line| line == "start").unwrap();
    let heard = heard_until(bench, |line| line == "//action:prompt_show");
    bench.host.connect_again().unwrap();
    heard
}

/// Continues the print, whose steps must be the desk's after the line that the report says.
fn goes_on(bench: &mut Bench, heard: &[String], program: &str) {
    let line = number_after(heard, "after line ");
    let byte = number_after(heard, "at byte ") as usize;
    assert_eq!(count(&program[..byte]), line, "{heard:?}");
    let before = bench.pins().events().len();
    // At once: the drivers are still being set up.
    bench.host.send_raw(b"M1000\n").unwrap();
    done(bench);
    let made = of_axes(&bench.pins().events()[before..]);
    let missing = of_axes(rehearsed(BEFORE, program).events_after(count(BEFORE) + line));
    assert!(made.len() > missing.len(), "no approach");
    assert!(made.ends_with(&missing), "after line {line}: not the steps that were missing");
}

fn z_mm(bench: &mut Bench) -> f64 {
    bench.with(|machine, _| machine.plant.motion.position_mm(2))
}

#[test]
fn a_print_goes_on_after_each_kind_of_cut_with_the_steps_that_were_missing() {
    let program = program(2);
    let card = card(&[("A.GCO", &program)]);
    let mut bench = Bench::switch_on(octopus(), |machine| {
        pushed_home(machine);
        machine.insert_card(0, card);
    });
    bench.host.connect().unwrap();
    bench.with(|machine, _| machine.card().unwrap().set_program_ns(2 * MS));
    send(&mut bench, BEFORE);
    for how in [Cut::Reset, Cut::Power] {
        send(&mut bench, "G1 X285 Y285 F6000\nM400");
        // Height of the nozzle above the one that the printer knows.
        let error_mm = z_mm(&mut bench) - 2.0;
        start(&mut bench, "A.GCO");
        // The place of the second layer is the next block.
        bench.host.listen(4_500).unwrap();
        wait_for_write(&mut bench);
        // The supplies fail while the card writes it.
        if how == Cut::Reset {
            bench.host.listen(1_500).unwrap();
        }
        let cut_mm = z_mm(&mut bench);
        cut(&mut bench, how);
        let heard = report(&mut bench);
        let kept_mm = f64::from(number_after(&heard, "at Z0.")) / 100.0;
        // A block that was being written may be spoilt: then the place before counts.
        let is_newest = (cut_mm - error_mm - kept_mm).abs() < 0.01;
        assert!(is_newest || how == Cut::Power, "{how:?}: {heard:?}");
        goes_on(&mut bench, &heard, &program);
        // The height is wrong by what was not kept, and by what a motor turns without current.
        let (ends_mm, wanted_mm) = (z_mm(&mut bench), 2.0 + cut_mm - kept_mm);
        assert!((ends_mm - wanted_mm).abs() < 0.1, "{how:?}: the nozzle is at {ends_mm}, expected {wanted_mm}");
        assert_eq!(say(&mut bench, "M1000 S"), ["echo:power loss: no interrupted print is kept", "ok"]);
    }
}

/// A module at PWR-DET reports the cut before the supply is gone.
#[test]
fn a_failing_supply_keeps_the_line_that_the_motors_had_finished() {
    let program = program(2);
    let mut bench = equipped::boot();
    bench.with(|machine, _| pushed_home(machine));
    insert(&mut bench, card(&[("A.GCO", &program)]));
    assert!(say(&mut bench, "M21").contains(&"echo:SD card ok".to_owned()));
    send(&mut bench, BEFORE);
    bench.host.send("M400").unwrap();
    start(&mut bench, "A.GCO");
    bench.host.listen(4_500).unwrap();
    bench.change(|plant, _| plant.supply_fails = true);
    let heard = heard_until(&mut bench, |line| line.contains("kill() called!"));
    let told = "echo:power loss: the supply fails: the place of the print is kept";
    assert!(heard.iter().any(|line| line == told), "{heard:?}");
    assert!(!bench.any_heater_on());
    bench.host.listen(500).unwrap();
    let risen_mm = z_mm(&mut bench);
    assert!((risen_mm - 5.2).abs() < 0.1, "the nozzle is at {risen_mm}");
    cut(&mut bench, Cut::Power);
    bench.change(|plant, _| plant.supply_fails = false);
    let heard = report(&mut bench);
    // With lines of 1.4 s: those that the motors had, less what is read ahead.
    assert!((5..10).contains(&number_after(&heard, "after line ")), "{heard:?}");
    goes_on(&mut bench, &heard, &program);
    // The height to which the nozzle had risen was kept.
    let ends_mm = z_mm(&mut bench);
    assert!((ends_mm - 2.0).abs() < 0.1, "the nozzle is at {ends_mm}");
}
