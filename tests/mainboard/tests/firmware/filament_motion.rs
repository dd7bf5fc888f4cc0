//! A sensor that sees filament move, on the Octopus: its encoder is turned by the extruder's real
//! steps. A print is never paused by it, a jam pauses it, and afterwards it continues as if
//! nothing had jammed.

use ferrostep_mainboard::parts::encoder::{FilamentEncoder, FilamentFault};

use crate::firmware::bench::Bench;
use crate::firmware::equipped::{self, DETECTION_MM};
use crate::firmware::job::Job;
use crate::firmware::pins::PinLog;

/// Error to which the motion in the queue is known, plus the filament's way between two looks, mm.
const RESOLUTION_MM: f64 = 0.4;

/// Filament that is pushed until the line under way has been taken, mm: the next line reports it.
const LINE_MM: f64 = 1.5;

/// Lines before the jam.
const JAM_FROM: usize = 60;

/// Lines of the cube: two lines beside it, the skirt and a part of the first layer.
const LINES: usize = 160;

/// Switched on, still warm from another print.
fn boot() -> Bench {
    let mut bench = equipped::boot();
    bench.set_celsius("nozzle", 205.0);
    bench.set_celsius("bed", 59.0);
    bench
}

/// Asks the encoder.
fn encoder<T: Send + 'static>(bench: &mut Bench, ask: impl FnOnce(&mut FilamentEncoder) -> T + Send + 'static) -> T {
    bench.with(move |machine, _| ask(machine.plant.filament_encoder.as_mut().unwrap()))
}

/// Filament that the motor has pushed, mm.
fn pushed_mm(bench: &mut Bench) -> f64 {
    bench.with(|machine, _| machine.plant.motion.motor_mm(3))
}

/// The steps of X, Y and Z, in their order.
fn path(pins: &PinLog) -> Vec<(u8, u8)> {
    let events = pins.events().iter().map(|event| (event.axes & 7, event.directions & event.axes & 7));
    events.filter(|(axes, _)| *axes != 0).collect()
}

/// Sends a line of the print: its `ok`, or what the printer says instead because of the filament.
fn print_line(bench: &mut Bench, line: &str) -> String {
    bench.host.begin(line).unwrap();
    bench.host.wait_for("its answer", |text| text.starts_with("ok") || text.starts_with("echo:The filament")).unwrap()
}

/// Prints all lines; nothing may pause.
fn print_undisturbed(bench: &mut Bench, job: &Job) {
    for (index, line) in job.lines().enumerate() {
        let answer = print_line(bench, line);
        assert!(answer.starts_with("ok"), "{}: {answer}", job.source(index + 1));
    }
    bench.host.send("M400").unwrap();
    let report = bench.host.ask("M412", "echo:Filament runout").unwrap();
    assert_eq!(report, "echo:Filament runout ON; distance: 3 mm; filament: present; switch: present");
}

/// The first print's filament slips by 3 %, within the maker's margin of 4 %: nothing pauses it.
#[test]
fn a_jam_pauses_the_print_which_then_goes_on_as_if_there_had_been_none() {
    let job = Job::cube(LINES);
    let mut bench = boot();
    encoder(&mut bench, |encoder| encoder.set_fault(Some(FilamentFault::Slips(0.03))));
    print_undisturbed(&mut bench, &job);
    let (edges, filament_mm) = encoder(&mut bench, |encoder| (encoder.edges(), encoder.filament_mm()));
    eprintln!("{edges} edges, {filament_mm} mm of filament");
    assert!(edges > 10 && filament_mm > 10.0 * DETECTION_MM);
    let undisturbed = bench.switch_off();
    let mut bench = boot();
    let (mut jammed_mm, mut is_over) = (None, false);
    for (index, line) in job.lines().enumerate() {
        if index > JAM_FROM && jammed_mm.is_none() && line.contains(" E") && line.contains('X') {
            encoder(&mut bench, |encoder| encoder.set_fault(Some(FilamentFault::Jammed)));
            jammed_mm = Some(pushed_mm(&mut bench));
        }
        let answer = print_line(&mut bench, line);
        if answer.starts_with("ok") {
            continue;
        }
        assert_eq!(answer, "echo:The filament does not move, it is jammed or has run out; M412 S0 ignores the sensor");
        let unseen_mm = pushed_mm(&mut bench) - jammed_mm.unwrap();
        eprintln!("said with {unseen_mm:.2} mm pushed since the jam");
        assert!(!is_over && unseen_mm < DETECTION_MM + RESOLUTION_MM + LINE_MM, "{unseen_mm} mm");
        bench.host.wait_for("the pause", |text| text.starts_with("echo:Change the filament")).unwrap();
        // A person frees the spool.
        encoder(&mut bench, |encoder| encoder.set_fault(None));
        bench.pass(2_000);
        bench.host.send_raw(b"M108\n").unwrap();
        bench.host.wait_for("the end of the pause", |text| text == "//action:resumed").unwrap();
        bench.host.wait_for("the line's answer", |text| text.starts_with("ok")).unwrap();
        is_over = true;
    }
    assert!(is_over, "the jam was not noticed");
    // M108 has had its own `ok`: this answer comes after all motion.
    bench.host.send("M400").unwrap();
    bench.host.ask("M412", "echo:Filament runout ON; distance: 3 mm; filament: present").unwrap();
    let pins = bench.switch_off();
    assert_eq!(pins.displacement(), undisturbed.displacement());
    // The same path, with a way aside and back in its midst.
    let (expected, made) = (path(&undisturbed), path(&pins));
    let before = expected.iter().zip(&made).take_while(|(expected, made)| expected == made).count();
    let after = expected.iter().rev().zip(made.iter().rev()).take_while(|(expected, made)| expected == made).count();
    eprintln!("{} events, {before} before the way aside, {after} after it, {} made", expected.len(), made.len());
    assert!(before + after >= expected.len() && made.len() > expected.len());
}

/// The filament's end passes the switch, with some of it still between switch and encoder: the
/// switch speaks, and alone.
#[test]
fn the_switch_beside_it_pauses_the_print_and_says_so() {
    let job = Job::cube(LINES);
    let mut bench = boot();
    let (mut pulled_mm, mut pauses) = (None, 0);
    for (index, line) in job.lines().enumerate() {
        if index > JAM_FROM && pulled_mm.is_none() && line.contains(" E") && line.contains('X') {
            bench.change(|plant, _| plant.is_filament_at_switch = false);
            pulled_mm = Some(pushed_mm(&mut bench));
        }
        let answer = print_line(&mut bench, line);
        if answer.starts_with("ok") {
            continue;
        }
        assert_eq!(answer, "echo:The filament has run out; M412 S0 ignores the sensor");
        pauses += 1;
        eprintln!("said with {:.2} mm pushed since its end", pushed_mm(&mut bench) - pulled_mm.unwrap());
        bench.host.wait_for("the pause", |text| text.starts_with("echo:Change the filament")).unwrap();
        bench.change(|plant, _| plant.is_filament_at_switch = true);
        bench.pass(2_000);
        bench.host.send_raw(b"M108\n").unwrap();
        bench.host.wait_for("the end of the pause", |text| text == "//action:resumed").unwrap();
        bench.host.wait_for("the line's answer", |text| text.starts_with("ok")).unwrap();
    }
    assert_eq!(pauses, 1);
    bench.host.send("M400").unwrap();
    let report = bench.host.ask("M412", "echo:Filament runout").unwrap();
    assert_eq!(report, "echo:Filament runout ON; distance: 3 mm; filament: present; switch: present");
    bench.change(|plant, _| plant.is_filament_at_switch = false);
    bench.pass(1_000);
    let report = bench.host.ask("M412", "echo:Filament runout").unwrap();
    assert_eq!(report, "echo:Filament runout ON; distance: 3 mm; filament: present; switch: missing");
    assert_eq!(bench.host.ask("M119", "filament:").unwrap(), "filament: open");
}
