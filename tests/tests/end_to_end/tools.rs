//! Two extruders on one carriage: T0 and T1.

use ferrostep_hal_shim::Heater;
use ferrostep_printer::{MAX_TOOLS, Profile};
use ferrostep_profiles::{builtin_text, parse};
use ferrostep_session::Session;
use ferrostep_session::desk::{Desk as _, LOOK_AHEAD_BLOCKS};
use ferrostep_virtual_board::HeaterFailure;
use proptest::prelude::*;

use crate::end_to_end::desk::profile;
use crate::end_to_end::hosts::{Conversation, Machine, machine};
use crate::end_to_end::refusals::Collector;

const OFFSET_MM: [f64; 3] = [24.5, -0.75, -0.3];
const T1: &str = "motor = \"e1\"\noffset_mm = { x = 24.5, y = -0.75, z = -0.3 }\n";
const HEATED: &str = "heater = \"nozzle1\"\n";

fn text(tools: &str, t1: &str) -> String {
    format!("{}\n[tools]\n{tools}\n[tools.t1]\n{T1}{t1}\n", builtin_text("cartesian").unwrap())
}

fn two(tools: &str, t1: &str) -> Profile {
    parse(&text(tools, t1), "two.toml").unwrap()
}

/// Steps of X, Y and Z, and of each extruder.
fn steps(machine: &Machine) -> ([i64; 3], [i64; MAX_TOOLS]) {
    let state = machine.desk().state().borrow();
    let [x, y, z, _] = state.motor_steps();
    ([x, y, z], state.queue().extruder_steps())
}

/// Place of the carriage, mm.
fn carriage_mm(machine: &Machine) -> [f64; 3] {
    let ([x, y, z], _) = steps(machine);
    [x as f64 / 80.0, y as f64 / 80.0, z as f64 / 400.0]
}

/// Executes lines, to the end of their motion; checks that none is refused.
fn run(host: &mut Conversation<'_>, lines: &str) -> Vec<String> {
    let mut said = Vec::new();
    for line in lines.lines() {
        let replies = host.say(line);
        assert!(
            !replies.iter().any(|reply| reply.starts_with("echo:line") || reply.starts_with("Error")),
            "{line}: {replies:?}"
        );
        said.extend(replies);
    }
    host.finish();
    said
}

fn near(one: [f64; 3], other: [f64; 3]) -> bool {
    one.iter().zip(other).all(|(one, other)| (one - other).abs() < 0.007)
}

const WARM: &str = "M302 S0\nG28\nG1 Z5 F600\nG1 X60 Y50 F6000";

#[test]
fn the_new_nozzle_goes_to_where_the_old_one_was() {
    let machine = machine(&two("", ""));
    let mut host = Conversation::new(&machine);
    run(&mut host, WARM);
    assert!(near(carriage_mm(&machine), [60.0, 50.0, 5.0]));
    let said = run(&mut host, "T1");
    assert!(said.iter().any(|line| line == "echo:Active Extruder: 1"), "{said:?}");
    // T1's nozzle is at the carriage plus its offset.
    let there = std::array::from_fn(|axis| [60.0, 50.0, 5.0][axis] - OFFSET_MM[axis]);
    assert!(near(carriage_mm(&machine), there), "{:?}", carriage_mm(&machine));
    assert_eq!(host.position_mm(), [60.0, 50.0, 5.0, 0.0]);
    run(&mut host, "G1 X80 Y60 Z2");
    assert!(near(carriage_mm(&machine), std::array::from_fn(|axis| [80.0, 60.0, 2.0][axis] - OFFSET_MM[axis])));
    run(&mut host, "T0");
    assert!(near(carriage_mm(&machine), [80.0, 60.0, 2.0]));
    assert_eq!(host.position_mm(), [80.0, 60.0, 2.0, 0.0]);
    // The same tool again makes no move; T alone reports the tool.
    let before = steps(&machine);
    run(&mut host, "T0");
    assert_eq!(host.say("T"), ["Active Extruder: 0", "ok"]);
    assert!(host.say("M115")[0].contains("EXTRUDER_COUNT:2"));
    assert_eq!(steps(&machine), before);
}

/// Marlin's `T1 S1`, Klipper's ACTIVATE_EXTRUDER, and a machine that does not know where it is.
#[test]
fn without_a_move_the_position_is_that_of_the_new_nozzle() {
    let machine = machine(&two("", ""));
    let mut host = Conversation::new(&machine);
    run(&mut host, "T1");
    assert_eq!(host.position_mm(), [24.5, -0.75, -0.3, 0.0]);
    run(&mut host, "T0\nG28\nG1 Z5 F600\nG1 X60 Y50 F6000");
    let before = steps(&machine);
    for (line, [x, y, z]) in [
        ("T1 S1", [84.5, 49.25, 4.7]),
        ("T0 S1", [60.0, 50.0, 5.0]),
        ("ACTIVATE_EXTRUDER EXTRUDER=extruder1", [84.5, 49.25, 4.7]),
        ("ACTIVATE_EXTRUDER EXTRUDER=extruder", [60.0, 50.0, 5.0]),
    ] {
        run(&mut host, line);
        assert_eq!((steps(&machine), host.position_mm()), (before, [x, y, z, 0.0]), "{line}");
    }
}

/// No nozzle is lower during a change than the old one was before.
#[test]
fn no_nozzle_drags() {
    let machine = machine(&two("lift_mm = 0.5", ""));
    let mut host = Conversation::new(&machine);
    run(&mut host, WARM);
    for (tool, offsets) in [(1, [0.0, OFFSET_MM[2]]), (0, [OFFSET_MM[2], 0.0])] {
        let mut before = steps(&machine).0;
        let start_mm = before[2] as f64 / 400.0;
        let nozzle_mm = start_mm + offsets[0];
        let mut highest = f64::MIN;
        host.say_while(format!("T{tool}\n").as_bytes(), |machine| {
            let now = steps(machine).0;
            let height_mm = now[2] as f64 / 400.0;
            highest = highest.max(height_mm);
            if now[0] != before[0] || now[1] != before[1] {
                for offset in [0.0, OFFSET_MM[2]] {
                    assert!(height_mm + offset >= nozzle_mm - 0.003, "T{tool}: {height_mm} {offset} {nozzle_mm}");
                }
            }
            before = now;
        });
        host.finish();
        assert!((highest - (start_mm.max(nozzle_mm - offsets[1]) + 0.5)).abs() < 0.005, "T{tool}: {highest}");
    }
}

/// A line of a print: the tool, X, Y and the filament.
fn print_line(host: &mut Conversation<'_>, machine: &Machine, line: &str) -> ([i64; 3], i64) {
    run(host, line);
    let (place, extruders) = steps(machine);
    (place, extruders.iter().sum())
}

/// T1's part of a print of two colours is the print of a machine with one tool, shifted by the
/// offset, step by step; and each extruder makes the steps of its lines.
#[test]
fn two_colours_are_two_prints_of_one_tool_each() {
    let lines: Vec<(u8, String)> = (0..40)
        .map(|index| {
            let (x, y) = (60.0 + f64::from(index * 7 % 31), 70.0 + f64::from(index * 11 % 23) * 0.35);
            ((index / 5 % 2) as u8, format!("G1 X{x:.2} Y{y:.2} E{:.4} F1800", f64::from(index) * 0.613))
        })
        .collect();
    let (both, one) = (machine(&two("", "")), machine(&profile("cartesian")));
    let (mut host_both, mut host_one) = (Conversation::new(&both), Conversation::new(&one));
    for host in [&mut host_both, &mut host_one] {
        run(host, WARM);
        run(host, "G1 X60 Y70");
    }
    let shift: [i64; 3] = std::array::from_fn(|axis| (OFFSET_MM[axis] * [80.0, 80.0, 400.0][axis]).round() as i64);
    let mut selected = 0;
    let mut made = [0; MAX_TOOLS];
    for (tool, line) in &lines {
        if *tool != selected {
            run(&mut host_both, &format!("T{tool}"));
            selected = *tool;
        }
        let (_, before) = steps(&one);
        let (place_one, e_one) = print_line(&mut host_one, &one, line);
        let (place, e) = print_line(&mut host_both, &both, line);
        let shift = if *tool == 1 { shift } else { [0; 3] };
        assert_eq!(place, std::array::from_fn(|axis| place_one[axis] - shift[axis]), "T{tool} {line}");
        assert_eq!(e, e_one, "{line}");
        made[usize::from(*tool)] += e_one - before.iter().sum::<i64>();
    }
    assert_eq!(steps(&both).1, made);
    assert!(made.iter().all(|steps| *steps > 100), "{made:?}");
}

proptest! {
    #![proptest_config(ferrostep_random_cases::cases(12))]

    /// Each extruder makes the steps of its filament after any changes, and carriage and
    /// coordinates stay together.
    #[test]
    fn random_changes_lose_no_step(
        changes in proptest::collection::vec((0u8..2, -2_000i32..4_000, 40i32..120, 40i32..120, any::<bool>()), 1..25),
    ) {
        let machine = machine(&two("", "steps_per_mm = 80\n"));
        let mut host = Conversation::new(&machine);
        run(&mut host, WARM);
        run(&mut host, "M83");
        let mut filament_um = [0_i64; MAX_TOOLS];
        for (tool, um, x, y, stays) in changes {
            run(&mut host, if stays { ["T0 S1", "T1 S1"][usize::from(tool)] } else { ["T0", "T1"][usize::from(tool)] });
            run(&mut host, &format!("G1 X{x} Y{y} Z6 E{:.3} F3000", f64::from(um) / 1e3));
            filament_um[usize::from(tool)] += i64::from(um);
            let offset = if tool == 1 { OFFSET_MM } else { [0.0; 3] };
            let wanted = std::array::from_fn(|axis| [f64::from(x), f64::from(y), 6.0][axis] - offset[axis]);
            prop_assert!(near(carriage_mm(&machine), wanted), "T{tool}: {:?} {wanted:?}", carriage_mm(&machine));
        }
        let (_, extruders) = steps(&machine);
        for ((made, um), steps_per_mm) in extruders.into_iter().zip(filament_um).zip([95.0, 80.0]) {
            let wanted = um as f64 / 1e3 * steps_per_mm;
            // Fractions of a step stay where the extruder was changed.
            prop_assert!((made as f64 - wanted).abs() <= 13.0, "{extruders:?} {filament_um:?}");
        }
    }
}

#[test]
fn filament_is_drawn_back_and_pushed_at_a_change() {
    let machine = machine(&two("retract_mm = 2\nprime_mm = 0.5", ""));
    let mut host = Conversation::new(&machine);
    run(&mut host, WARM);
    for (line, e0, e1) in [("T1", -2.0, 0.5), ("T0", 0.5, -1.5), ("T1 S1", -1.5, 1.0)] {
        run(&mut host, line);
        let (_, made) = steps(&machine);
        for (made, wanted) in made.into_iter().zip([e0, e1]) {
            assert!((made as f64 - wanted * 95.0_f64).abs() <= 1.0, "{line}: {made} {wanted}");
        }
        assert_eq!(host.position_mm()[3], 0.0);
    }
}

#[test]
fn filament_stays_in_a_cold_nozzle() {
    let machine = machine(&two("retract_mm = 2\nprime_mm = 0.5", ""));
    let mut host = Conversation::new(&machine);
    run(&mut host, "G28\nG1 Z5 F600\nG1 X60 Y50 F6000\nT1");
    assert_eq!(steps(&machine).1, [0, 0]);
}

/// G10 and G11, M221 and M900 are separate for each tool.
#[test]
fn a_tool_keeps_what_belongs_to_it() {
    let machine = machine(&two("", ""));
    let mut host = Conversation::new(&machine);
    run(&mut host, WARM);
    run(&mut host, "M83\nM207 S2 F2400 Z0.4\nG10\nT1\nM221 S90\nM900 K0.05\nG1 X70 E1 F1200");
    assert!((host.position_mm()[2] - 5.0).abs() < 1e-9 && near(carriage_mm(&machine), [45.5, 50.75, 5.3]));
    let (_, [first, second]) = steps(&machine);
    assert_eq!((first, second), (-190, 85));
    assert_eq!(host.say("M221")[0], "echo:E0 Flow: 90%");
    assert_eq!(host.say("M221 T0")[0], "echo:E0 Flow: 100%");
    assert!(host.say("M900")[0].contains("0.05"));
    assert!(!host.say("M900 T0")[0].contains("0.05"));
    run(&mut host, "G10\nT0\nG11\nG1 X75 E1");
    assert_eq!(host.say("M221")[0], "echo:E0 Flow: 100%");
    let (_, [first, second]) = steps(&machine);
    assert!((first - 95).abs() <= 1 && (second - (85 - 190)).abs() <= 1, "{first} {second}");
    // Settings of the tool that is not selected.
    run(&mut host, "M221 T1 S110\nM92 T1 E100\nT1");
    assert_eq!(host.say("M221")[0], "echo:E0 Flow: 110%");
    assert!(host.say("M92")[0].contains("E100.00"));
    run(&mut host, "T0");
    assert!(host.say("M92")[0].contains("E95.00"));
}

#[test]
fn homing_and_coordinates_are_right_under_an_offset() {
    let machine = machine(&two("", ""));
    let mut host = Conversation::new(&machine);
    run(&mut host, WARM);
    run(&mut host, "T1\nG28");
    assert!(near(carriage_mm(&machine), [0.0; 3]));
    assert_eq!(host.position_mm(), [24.5, -0.75, -0.3, 0.0]);
    run(&mut host, "G1 Z5 F600\nG1 X50 Y50 F6000\nG92 X0 Y0\nG1 X10 Y10\nT0");
    assert!(near(carriage_mm(&machine), [60.0, 60.0, 5.0]));
    assert_eq!(host.position_mm(), [10.0, 10.0, 5.0, 0.0]);
    run(&mut host, "G28 X\nT1 S1");
    assert_eq!(host.position_mm(), [24.5, 9.25, 4.7, 0.0]);
}

#[test]
fn m218_sets_the_offset_and_m500_keeps_it() {
    let machine = machine(&two("", ""));
    let mut host = Conversation::new(&machine);
    run(&mut host, WARM);
    assert!(host.say("M218").contains(&"echo:  M218 T1 X24.5 Y-0.75 Z-0.3 ; (mm)".to_owned()));
    run(&mut host, "M218 T1 X20 Z0.1\nT1");
    assert!(near(carriage_mm(&machine), [40.0, 50.75, 4.9]));
    // M218 of the selected tool leaves the carriage where it is.
    run(&mut host, "M218 X21");
    assert!(near(carriage_mm(&machine), [40.0, 50.75, 4.9]));
    assert_eq!(host.position_mm(), [61.0, 50.0, 5.0, 0.0]);
    let said = host.say("M503");
    assert!(said.iter().any(|line| line == "echo:  M218 T1 X21.00 Y-0.75 Z0.10"), "{said:#?}");
    for line in ["M218 T0 X3", "M218 T1 X900", "M218 T2 X3"] {
        assert!(host.say(line)[0].starts_with("echo:line"), "{line}");
    }
    run(&mut host, "M502");
    assert_eq!(host.position_mm(), [64.5, 50.0, 4.6, 0.0]);
}

#[test]
fn what_cannot_be_is_refused_by_name() {
    let machine = machine(&two("", HEATED));
    let mut host = Conversation::new(&machine);
    run(&mut host, WARM);
    for (line, says) in [
        ("T2", "this machine has T0 and T1"),
        ("T99", "this machine has T0 and T1"),
        ("M104 T2 S200", "this machine has T0 and T1"),
        ("M109 T2 S200", "this machine has T0 and T1"),
        ("M221 T7 S90", "this machine has T0 and T1"),
        ("M900 T2 K0.1", "this machine has T0 and T1"),
        ("M301 E2 P10", "this machine has T0 and T1"),
        ("M303 E2", "this machine has T0 and T1"),
        ("M600 T1", "sets the selected tool"),
        ("M701 T1 L10", "sets the selected tool"),
    ] {
        let before = steps(&machine);
        let said = host.say(line);
        assert!(said[0].starts_with("echo:line") && said[0].contains(says), "{line}: {said:?}");
        assert_eq!((host.say("T")[0].as_str(), steps(&machine)), ("Active Extruder: 0", before));
    }
    // The new nozzle is lower: the carriage would have to rise above its travel.
    run(&mut host, "G1 Z200 F600");
    let before = steps(&machine);
    let said = host.say("T1");
    assert!(said[0].contains("the new nozzle is lower"), "{said:?}");
    host.finish();
    assert_eq!((host.say("T")[0].as_str(), steps(&machine)), ("Active Extruder: 0", before));
    // Beside the travel along X and Y the nozzle goes as far as it can, as in every move.
    run(&mut host, "G1 Z5\nG1 X10 Y50 F6000");
    let said = host.say("T1");
    assert!(said.iter().any(|line| line.contains("outside the soft limits, X")), "{said:?}");
    host.finish();
    assert!(near(carriage_mm(&machine), [0.0, 50.75, 5.3]));
    assert_eq!(host.position_mm(), [24.5, 50.0, 5.0, 0.0]);
}

#[test]
fn a_second_nozzle_has_its_own_heat() {
    let machine = machine(&two("", HEATED));
    let mut host = Conversation::new(&machine);
    run(&mut host, "M104 T1 S180\nM104 S60");
    let said = host.say("M109 T1 S180");
    assert!(said.iter().any(|line| line.contains(" T0:") && line.contains(" T1:")), "{said:?}");
    let celsius = [Heater::Nozzle, Heater::Nozzle1].map(|heater| machine.heaters().true_celsius(heater));
    assert!((170.0..190.0).contains(&celsius[1]) && celsius[0] < 70.0, "{celsius:?}");
    // Marlin's order: first the selected one's, then each.
    let said = host.say("M105").concat();
    assert!(said.starts_with("ok T:") && said.contains(" /60.00 B:") && said.contains(" /180.00 @:"), "{said}");
    assert!(said.contains(" @0:") && said.contains(" @1:"), "{said}");
    // T0 is cold, T1 is not.
    assert!(
        host.say("G1 X1 E1 F300")[0].contains("the nozzle is too cold")
            || host.say("G1 X1 E1 F300")[0].starts_with("echo:line")
    );
    run(&mut host, "T1\nG92 E0\nG1 E1 F300");
    assert_eq!(steps(&machine).1, [0, 95]);
    assert!(host.say("M105")[0].contains(" /180.00 B:"));
    run(&mut host, "M104 S0\nM104 T0 S0");
    host.say("G4 S1");
    assert_eq!(Heater::ALL.map(|heater| machine.heaters().power(heater)), [0.0; Heater::COUNT]);
    run(&mut host, "SET_HEATER_TEMPERATURE HEATER=extruder1 TARGET=100\nM301 E1 P20");
    assert!(host.say("M301 E1")[0].starts_with("echo:M301 E1 P20"));
    run(&mut host, "TURN_OFF_HEATERS");
    host.say("G4 S1");
    assert_eq!(machine.heaters().power(Heater::Nozzle1), 0.0);
}

#[test]
fn faults_of_the_second_nozzle_halt_the_printer() {
    for (failure, says) in [
        (HeaterFailure::ThermistorOpen, "Error:MINTEMP triggered, system stopped! Heater_ID: E1"),
        (HeaterFailure::ThermistorShorted, "Error:MAXTEMP triggered, system stopped! Heater_ID: E1"),
        (HeaterFailure::Dead, "Error:Heating failed, system stopped! Heater_ID: E1"),
    ] {
        let machine = machine(&two("", HEATED));
        let mut host = Conversation::new(&machine);
        run(&mut host, "M104 T1 S200\nM104 S200\nG4 S3");
        machine.set_heater_failure(Heater::Nozzle1, Some(failure));
        let said = host.say("G4 S90");
        assert!(said.iter().any(|line| line.starts_with(says)), "{failure:?}: {said:?}");
        assert_eq!(Heater::ALL.map(|heater| machine.heaters().power(heater)), [0.0; Heater::COUNT], "{failure:?}");
    }
}

#[test]
fn without_a_nozzle_of_its_own_it_shares_the_first() {
    let machine = machine(&two("", ""));
    let mut host = Conversation::new(&machine);
    run(&mut host, "M104 T1 S200");
    assert!(machine.heating().0.borrow().heaters().power(Heater::Nozzle1) == 0.0);
    assert!(host.say("M105")[0].contains(" /200.00 B:") && !host.say("M105")[0].contains(" T1:"));
}

/// The start code that slicers write before a print of two colours works.
#[test]
fn start_code_of_slicers_works() {
    let machine = machine(&two("", HEATED));
    let mut host = Conversation::new(&machine);
    run(
        &mut host,
        "T0\nM104 S120 T1\nM104 S190 T0\nG28\nG1 Z5 F600\nM109 S190 T0\nM109 T1 S120\nG92 E0\nM83\nG1 X60 Y60 E2 F900\nM109 R190 T1\nT1\n\
         G92 E0\nG1 X70 Y60 E2 F900\nM104 T0 S150\nT0\nM107\nM104 S0 T0\nM104 S0 T1",
    );
    assert_eq!(steps(&machine).1, [190, 190]);
}

#[test]
fn a_pause_keeps_the_tool_and_its_heat() {
    let machine = machine(&two("", HEATED));
    let mut host = Conversation::new(&machine);
    run(&mut host, "M109 T1 S190\nG28\nG1 Z5 F600\nG1 X60 Y50 F6000\nT1\nM83\nG1 X70 E1 F900");
    let before = steps(&machine);
    let signals = machine.signals();
    let mut asked = false;
    let said = host.say_while(b"M600\n", |_| {
        if !std::mem::replace(&mut asked, true) || signals.is_paused_for_user() {
            signals.end_wait();
        }
    });
    assert!(said.iter().any(|line| line.contains("paused")), "{said:?}");
    host.finish();
    assert_eq!(steps(&machine), before);
    assert_eq!(host.position_mm()[..3], [70.0, 50.0, 5.0]);
}

/// A machine with one tool is unchanged.
#[test]
fn one_tool_stays_one() {
    let machine = machine(&profile("cartesian"));
    let mut host = Conversation::new(&machine);
    assert_eq!(host.say("T0"), ["ok"]);
    assert!(host.say("T1")[0].contains("this machine has one extruder, T0: slice the job for one"));
    let said = host.say("M104 T1 S200");
    assert!(said[0].contains("T: this machine has one extruder, 0; no effect"), "{said:?}");
    assert!(!host.say("M105")[0].contains(" T0:"));
    assert_eq!(machine.heating().0.borrow().heaters().power(Heater::Nozzle), 0.0);
}

#[test]
fn a_profiles_mistakes_are_named() {
    let chamber = "\n[chamber]\nthermistor = \"nozzle1\"\nsensor = \"epcos-100k\"\nmin_celsius = 0\nmax_celsius = 80\nheater = \"nozzle1\"\n";
    for (t1, says) in [
        ("heater = \"nozzle1\"\n[tools.t1.nozzle]\nmax_celsius = 3000", "tools.t1.nozzle.max_celsius"),
        ("thermistor = \"nozzle1\"", "tools.t1.thermistor"),
        ("[tools.t1.nozzle]\nmax_celsius = 250", "tools.t1.nozzle"),
        ("part_fan = \"nowhere\"", "tools.t1.part_fan"),
        ("steps_per_mm = 0", "tools.t1.steps_per_mm"),
        ("lift_mm = 3", "tools.t1.lift_mm"),
        (&format!("heater = \"nozzle1\"\n{chamber}"), "tools.t1.heater"),
    ] {
        let error = parse(&text("", t1), "two.toml").unwrap_err().to_string();
        assert!(error.contains(says), "{t1}: {error}");
    }
    for (from, to, says) in [
        ("motor = \"e1\"\n", "", "tools.t1.motor"),
        ("\"e1\"", "\"x\"", "tools.t1.motor"),
        ("x = 24.5", "x = 2400.5", "tools.t1.offset_mm"),
    ] {
        let error = parse(&text("", "").replace(from, to), "two.toml").unwrap_err().to_string();
        assert!(error.contains(says), "{error}");
    }
}

#[test]
fn a_change_needs_a_session_that_makes_steps_no_more_than_an_estimate() {
    let session = Session::estimate(two("", ""), LOOK_AHEAD_BLOCKS, Collector::default());
    let mut printer = session.printer();
    for line in WARM.lines().chain(["T1", "G1 X70 E1 F900", "T0"]) {
        session.run(printer.execute(1, line)).unwrap();
    }
    assert_eq!(printer.logical_10nm()[..3], [7_000_000, 5_000_000, 500_000]);
}

/// A machine with macros at a change.
fn with_macros(before: &str, after: &str, macros: &str) -> Profile {
    let keys = format!("before_change = \"{before}\"\nafter_change = \"{after}\"\nlift_mm = 0");
    parse(&format!("{}\n{macros}", text(&keys, "")), "two.toml").unwrap()
}

/// Lines that M118 has sent, and those that name the selected tool.
fn marks(said: &[String]) -> Vec<&str> {
    said.iter().map(String::as_str).filter(|line| line.starts_with('#') || line.contains("Extruder")).collect()
}

const SAY: &str = "[macro.BEFORE]\ngcode = '''\nM118 #before {FROM} {TO}\nT\nG1 X100 F6000\n'''\n\
    [macro.AFTER]\ngcode = '''\nM118 #after {FROM} {TO}\nT\nG1 Y{Y=90}\n'''\n";

#[test]
fn macros_come_before_and_after_a_change() {
    let both = "[macro.BOTH]\ngcode = '''\nT1\nM118 #between\nT0\nM118 #end\n'''\n";
    let machine = machine(&with_macros("BEFORE", "AFTER", &format!("{SAY}{both}")));
    let mut host = Conversation::new(&machine);
    run(&mut host, WARM);
    let said = run(&mut host, "T1");
    let to_second =
        ["#before 0 1", "Active Extruder: 0", "echo:Active Extruder: 1", "#after 0 1", "Active Extruder: 1"];
    let to_first = ["#before 1 0", "Active Extruder: 1", "echo:Active Extruder: 0", "#after 1 0", "Active Extruder: 0"];
    assert_eq!(marks(&said), to_second);
    assert_eq!(said.iter().filter(|line| *line == "ok").count(), 1, "{said:?}");
    // The change is made where the first macro has left the nozzle.
    assert_eq!(host.position_mm(), [100.0, 90.0, 5.0, 0.0]);
    // The same tool again, and changes without moves, have none.
    assert_eq!(marks(&run(&mut host, "T1")), ["echo:Active Extruder: 1"]);
    assert_eq!(marks(&run(&mut host, "T0 S1")), ["echo:Active Extruder: 0"]);
    // Within a macro they run as well.
    let said = run(&mut host, "BOTH");
    assert_eq!(marks(&said), [&to_second[..], &["#between"], &to_first[..], &["#end"]].concat());
    assert_eq!(said.iter().filter(|line| *line == "ok").count(), 1, "{said:?}");
    // Before all axes are homed nothing moves.
    run(&mut host, "M18");
    assert_eq!(marks(&run(&mut host, "T1")), ["echo:Active Extruder: 1"]);
}

#[test]
fn a_macro_that_fails_ends_the_change() {
    let failing = "[macro.FAIL]\ngcode = '''\nM118 #begun\nM104 S{HOT=99}9\nM118 #never\n'''\n\
        [macro.SWITCH]\ngcode = '''\nT1\nM118 #never\n'''\n[macro.QUIET]\ngcode = \"G4 P1\"\n";
    for (before, after, selected) in [("FAIL", "QUIET", 0), ("QUIET", "FAIL", 1)] {
        let machine = machine(&with_macros(before, after, failing));
        let mut host = Conversation::new(&machine);
        run(&mut host, WARM);
        for line in ["T1", "SWITCH"] {
            host.say("T0 S1");
            let said = host.say(line);
            let place =
                said.iter().position(|said| said.contains("FAIL, line 2: \"M104 S999\" ends the macro")).unwrap();
            assert_eq!(said[place + 1], format!("Active Extruder: {selected}"), "{said:?}");
            assert_eq!(
                said.iter().any(|said| said.contains("SWITCH, line 1: \"T1\" ends the macro")),
                line == "SWITCH"
            );
            assert!(marks(&said).contains(&"#begun") && !marks(&said).contains(&"#never"), "{said:?}");
            assert_eq!(said.last().unwrap(), "ok");
            host.finish();
            assert_eq!(host.say("T"), [format!("Active Extruder: {selected}"), "ok".to_owned()]);
        }
    }
}

/// A change that cannot begin runs no macros: nothing has moved.
#[test]
fn a_refused_change_has_no_macros() {
    let machine = machine(&with_macros("BEFORE", "AFTER", SAY));
    let mut host = Conversation::new(&machine);
    run(&mut host, WARM);
    let before = steps(&machine);
    let said = host.say("T2");
    assert!(said.iter().any(|line| line.contains("T0 and T1")) && marks(&said).is_empty(), "{said:?}");
    host.finish();
    assert_eq!(steps(&machine), before);
}
