//! A sensor that sees filament move: it counts the filament that the motor has pushed, a print that
//! works is never paused, and a jam is.

use ferrostep_printer::machine::Pushed;
use ferrostep_printer::{FilamentSensor, FilamentSensorKind, Printer, Profile, SharedMotion};
use ferrostep_session::desk::{Desk, ExtruderNow, LOOK_AHEAD_BLOCKS, LiveMachine};
use ferrostep_session::{DeskPorts, LiveSession, Session};

use crate::end_to_end::command::example;
use crate::end_to_end::desk::profile;
use crate::end_to_end::refusals::Collector;
use crate::end_to_end::repeats::Seeded;

/// Detection length of BIGTREETECH's second smart filament sensor, mm, by its maker: an encoder
/// with an edge every 2.88 mm.
const DETECTION_MM: f64 = 3.0;

/// Error of a detected length, mm: marks of the queue lie a thirtieth of it apart, at these prints'
/// speed of filament and with a second of motion in it; and a look comes every 2 ms.
const RESOLUTION_MM: f64 = 0.4;

type Machine = LiveSession<Collector>;

/// The machine's printer.
type PrinterOf<'a> = Printer<'a, DeskPorts<'a, SharedMotion<LiveMachine<'a>>>>;

fn machine(advance_s: f64) -> Machine {
    let mut profile: Profile = profile("cartesian");
    let kind = FilamentSensorKind::Encoder { detection_10nm: (DETECTION_MM * 1e5) as u32 };
    profile.filament_sensor = Some(FilamentSensor { kind, debounce_ms: 5 });
    profile.motion.pressure_advance.seconds = advance_s;
    let machine = Session::live(profile, LOOK_AHEAD_BLOCKS, Collector::default());
    machine.desk().grant(u64::MAX / 2);
    machine
}

/// The commands of a file's first lines.
fn commands(text: &[u8], lines: usize) -> Vec<String> {
    let text = std::str::from_utf8(text).unwrap();
    let commands = text.lines().filter_map(|line| line.split(';').next()).map(str::trim);
    commands.filter(|command| !command.is_empty()).take(lines).map(str::to_owned).collect()
}

/// Sends lines as a host does that prints; calls `between` whenever time has passed. Returns the
/// printer's replies.
fn print(machine: &Machine, lines: &[String], mut between: impl FnMut(&Machine)) -> Vec<String> {
    let mut printer = machine.printer();
    for (number, line) in (1..).zip(lines) {
        machine.desk().set_host_awaited(false);
        machine.run_with(printer.execute_for_host(number, line, true), &mut between).unwrap();
        machine.desk().set_host_awaited(true);
    }
    machine.desk().set_host_awaited(false);
    machine.run_with(printer.finish(), &mut between).unwrap();
    machine.replies().take()
}

fn extruder(machine: &Machine) -> ExtruderNow {
    machine.desk().extruder_now().unwrap()
}

/// The last 20 lines that were sent, without `ok`.
fn last_of(machine: &Machine) -> Vec<String> {
    let said = machine.replies().take();
    let mut told: Vec<String> = said.into_iter().filter(|line| line != "ok").collect();
    told.split_off(told.len().saturating_sub(20))
}

fn pauses(said: &[String]) -> usize {
    said.iter().filter(|line| *line == "//action:paused").count()
}

/// The sensor's margin is 4 %, and its first edge is anywhere.
#[test]
fn a_print_whose_filament_moves_is_never_paused() {
    for (name, text, lines) in [
        ("cube", example("cube.gcode"), 3_000),
        ("supports", example("supports.gcode.gz"), 6_000),
        ("vase", example("vase.gcode.gz"), 3_000),
    ] {
        for (start_mm, advance_s) in [("0.7", 0.0), ("1.9", 0.05), ("2.6", 0.6)] {
            let machine = machine(advance_s);
            let mut commands = commands(&text, lines);
            commands
                .splice(0..0, ["M302 P1", "M83", &format!("G1 E{start_mm} F300"), "M82", "G92 E0"].map(str::to_owned));
            let mut furthest = 0;
            print(&machine, &commands, |machine| {
                furthest = furthest.max(extruder(machine).steps);
                let pushed_mm = furthest as f64 / extruder(machine).steps_per_mm;
                assert!(!machine.signals().is_filament_missing(), "{name}, {advance_s} s, after {pushed_mm} mm");
            });
            let pushed_mm = furthest as f64 / extruder(&machine).steps_per_mm;
            assert!(pushed_mm > 20.0 * DETECTION_MM, "{name}: {pushed_mm} mm");
        }
    }
}

#[test]
fn a_jam_pauses_a_print_within_the_length_and_the_print_ends_as_if_there_had_been_none() {
    let mut random = Seeded::new(41);
    let lines = commands(&example("cube.gcode"), 2_500);
    for advance_s in [0.0, 0.05] {
        let undisturbed = machine(advance_s);
        assert_eq!(pauses(&print(&undisturbed, &lines, |_| {})), 0);
        for _ in 0..6 {
            let machine = machine(advance_s);
            // The file's first extrusion is a separate prime line.
            let jams_at_mm = 20.0 + random.below(60) as f64;
            let (mut furthest_mm, mut jammed_mm, mut noticed_mm) = (0.0_f64, None, None);
            let (mut noticed_ns, mut stood_ns, mut waits_ms) = (0, 0, 0);
            let said = print(&machine, &lines, |machine| {
                let ExtruderNow { steps, steps_per_mm, .. } = extruder(machine);
                furthest_mm = furthest_mm.max(steps as f64 / steps_per_mm);
                let now_ns = machine.clock().now_ns();
                if jammed_mm.is_none() && furthest_mm >= jams_at_mm {
                    jammed_mm = Some(furthest_mm);
                    machine.set_filament_stuck(true);
                }
                if noticed_mm.is_none() && machine.signals().is_filament_missing() {
                    noticed_mm = Some(furthest_mm);
                    noticed_ns = now_ns;
                }
                if machine.signals().is_paused_for_user() {
                    assert!(waits_ms < 2_000, "{jams_at_mm} mm: a second pause: {:#?}", last_of(machine));
                    if stood_ns == 0 {
                        stood_ns = now_ns;
                    }
                    waits_ms += 1;
                    // A person comes, frees the spool, and presses the button.
                    if waits_ms == 1_000 {
                        machine.set_filament_stuck(false);
                        machine.signals().end_wait();
                    }
                }
            });
            assert_eq!(pauses(&said), 1, "{jams_at_mm}: {said:?}");
            let text = "echo:The filament does not move, it is jammed or has run out; M412 S0 ignores the sensor";
            assert!(said.iter().any(|line| line == text), "{said:?}");
            let unseen_mm = noticed_mm.unwrap() - jammed_mm.unwrap();
            assert!((0.0..DETECTION_MM + RESOLUTION_MM).contains(&unseen_mm), "{unseen_mm} mm after {jams_at_mm} mm");
            // The motion at hand when a person pauses takes 2.1 s (the book's page of hosts), the
            // way up 4 s at this machine's speed of Z, and then comes the way aside.
            let stop_s = (stood_ns - noticed_ns) as f64 * 1e-9;
            assert!(stop_s < 10.0, "{stop_s} s");
            assert_eq!(extruder(&machine).steps, extruder(&undisturbed).steps);
            assert_eq!(machine.desk().position_10nm(), undisturbed.desk().position_10nm());
        }
    }
}

/// The switch reports filament that ends, before as much has been pushed as the encoder wants; only
/// the encoder reports a jam.
#[test]
fn a_switch_beside_the_encoder_tells_the_end_of_the_filament_and_the_encoder_a_jam() {
    for (ends, text) in [
        (true, "echo:The filament has run out; M412 S0 ignores the sensor"),
        (false, "echo:The filament does not move, it is jammed or has run out; M412 S0 ignores the sensor"),
    ] {
        let profile = Profile {
            filament_switch: Some(FilamentSensor {
                kind: FilamentSensorKind::Switch { missing_is_low: true },
                debounce_ms: 500,
            }),
            ..*machine(0.0).profile()
        };
        let machine = Session::live(profile, LOOK_AHEAD_BLOCKS, Collector::default());
        machine.desk().grant(u64::MAX / 2);
        let lines = commands(&example("cube.gcode"), 2_500);
        let (mut has_ended, mut waits_ms) = (false, 0);
        let said = print(&machine, &lines, |machine| {
            let ExtruderNow { steps, steps_per_mm, .. } = extruder(machine);
            if !has_ended && steps as f64 / steps_per_mm >= 30.0 {
                has_ended = true;
                if ends { machine.set_filament_out(true) } else { machine.set_filament_stuck(true) }
            }
            if machine.signals().is_paused_for_user() {
                assert!(waits_ms < 2_000, "{text}: a second pause: {:#?}", last_of(machine));
                waits_ms += 1;
                if waits_ms == 1_000 {
                    machine.set_filament_out(false);
                }
                // The switch says for its time that it is back.
                if waits_ms == 1_500 {
                    machine.signals().end_wait();
                }
            }
        });
        assert_eq!(pauses(&said), 1, "{text}: {said:?}");
        let told: Vec<&String> = said.iter().filter(|line| line.starts_with("echo:The filament")).collect();
        assert_eq!(told, [text]);
    }
}

/// A person pushes filament that is not in the sensor yet, and prints then.
#[test]
fn what_a_person_pushes_pauses_no_print() {
    let machine = machine(0.0);
    machine.set_filament_stuck(true);
    let mut printer = machine.printer();
    for line in ["M302 P1", "M83", "M104 S200", "G1 E30 F300", "M400"] {
        machine.run(printer.execute_for_host(1, line, false)).unwrap();
    }
    let reports = |printer: &mut PrinterOf<'_>, filament: &str| {
        machine.replies().take();
        machine.run(printer.execute_for_host(1, "M412", false)).unwrap();
        let report = format!("echo:Filament runout ON; distance: 3 mm; filament: {filament}");
        assert!(machine.replies().take().contains(&report), "{filament}");
    };
    reports(&mut printer, "missing");
    machine.set_filament_stuck(false);
    for line in ["G1 X10 E0.5 F1200", "G1 X20 E0.5", "M400"] {
        machine.run(printer.execute_for_host(1, line, true)).unwrap();
    }
    assert_eq!(pauses(&machine.replies().take()), 0);
    reports(&mut printer, "present");
}

/// Lines, travels, retractions, wipes, and an advance: what has been pushed is between the two
/// counts all the time, and both are it when all has ended.
#[test]
fn what_is_counted_is_what_the_motor_has_pushed() {
    for seed in 1..=12 {
        let mut random = Seeded::new(seed);
        let machine = machine([0.0, 0.05, 0.4][seed as usize % 3]);
        let mut lines: Vec<String> = ["M302 P1", "M83", "G1 X50 Y50 Z1 F6000"].map(str::to_owned).into();
        for _ in 0..150 {
            let [x, y] = [random.below(100), random.below(100)];
            let feed = 300 + random.below(6_000);
            lines.push(match random.below(8) {
                0 => format!("G1 E-{}.5 F2400", random.below(5)),
                1 => format!("G1 E{}.5 F2400", random.below(5)),
                2 => format!("G0 X{x} Y{y} F9000"),
                // A wipe.
                3 => format!("G1 X{x} Y{y} E-0.6 F{feed}"),
                4 => format!("G4 P{}", random.below(300)),
                _ => format!("G1 X{x} Y{y} E{}.{} F{feed}", random.below(4), random.below(10)),
            });
        }
        lines.push("G1 E60 F600".to_owned());
        let (mut furthest, mut looks) = (0, 0);
        print(&machine, &lines, |machine| {
            let ExtruderNow { steps, pushed, steps_per_mm } = extruder(machine);
            furthest = furthest.max(steps);
            let [least, most] =
                [pushed.at_least, pushed.at_most].map(|pushed| i64::from(pushed.steps_since(Pushed::NONE)));
            // Between two looks, 2 ms, it may have been drawn back.
            let between = (0.2 * steps_per_mm) as i64;
            // The queue's end is checked with every eighth entry, and the extruder may step
            // once at each entry.
            let range = least - between..=most + 8;
            assert!(range.contains(&furthest), "seed {seed}: {furthest} not in {range:?}");
            looks += 1;
        });
        let ExtruderNow { steps, pushed, .. } = extruder(&machine);
        assert_eq!(pushed.at_least, pushed.at_most, "seed {seed}");
        assert_eq!(i64::from(pushed.at_least.steps_since(Pushed::NONE)), steps, "seed {seed}");
        assert!(looks > 1_000, "seed {seed}: {looks}");
    }
}
