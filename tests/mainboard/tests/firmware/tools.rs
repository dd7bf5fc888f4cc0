//! Two extruders on the Octopus: T1's motor in the socket e1, its nozzle at HE1 and TH1.
//!
//! The test compares the positions of the model's motors and its heaters' power, not what the
//! firmware reports.

use std::sync::OnceLock;

use ferrostep_mainboard::parts::heat::thermistor::SensorFault;
use ferrostep_testkit::boards::pin;

use crate::firmware::bench::Bench;
use crate::firmware::equipped::octopus;
use crate::firmware::images::{Variant, changed};

/// The motors among the board's: A, B, Z, `e`, `e1`.
const MOTORS: [usize; 5] = [0, 1, 2, 3, 4];

const OFFSET_MM: [f64; 3] = [24.5, -0.75, -0.3];

const TOOLS: &str = r#"
[tools]
lift_mm = 0.5
before_change = "BEFORE"
after_change = "AFTER"

[tools.t1]
motor = "e1"
offset_mm = { x = 24.5, y = -0.75, z = -0.3 }
heater = "nozzle1"
driver = { current_ma = 700, hold_current_percent = 60, microsteps = 16, interpolate = true, stealth_chop = false, spread_cycle_above_mm_per_s = 0, stall_threshold = 0 }

[tools.t1.nozzle]
max_celsius = 260
control_model = { power_w = 40, capacity_j_per_k = 12, loss_w_per_k = 0.11, fanned_loss_w_per_k = 0.13, sensor_per_s = 1 }

[macro.BEFORE]
gcode = "M118 before T{TO}"

[macro.AFTER]
gcode = "M118 after T{FROM}"
"#;

fn built() -> &'static Variant {
    static BUILT: OnceLock<Variant> = OnceLock::new();
    BUILT.get_or_init(|| {
        changed("btt-octopus-1.1", "corexy", "octopus-with-two-tools", |board| board, |profile| profile + TOOLS)
    })
}

fn boot() -> Bench {
    let Variant { board, profile, image } = built();
    Bench::boot_variant(octopus(), board, profile, image)
}

/// Positions of the motors, mm.
fn motors_mm(bench: &mut Bench) -> [f64; 5] {
    bench.host.send("M400").unwrap();
    bench.with(|machine, _| MOTORS.map(|motor| machine.plant.motion.motor_mm(motor)))
}

fn send(bench: &mut Bench, lines: &str) {
    for line in lines.lines() {
        bench.host.send(line).unwrap();
    }
}

/// Distances that the motors have moved since `before`, mm.
fn moved(bench: &mut Bench, before: [f64; 5]) -> [f64; 5] {
    let now = motors_mm(bench);
    std::array::from_fn(|motor| now[motor] - before[motor])
}

fn near(one: f64, other: f64) -> bool {
    (one - other).abs() < 0.01
}

#[test]
fn the_selected_tool_s_motor_alone_pushes_filament() {
    let mut bench = boot();
    send(&mut bench, "M302 P1\nG28\nG1 Z5 F600\nG1 X100 Y100 F6000\nM83");
    for (line, e, e1) in [
        ("G1 E2 F600", 2.0, 0.0),
        ("T1", 0.0, 0.0),
        ("G1 E3 F600", 0.0, 3.0),
        ("G1 X120 Y110 E1 F3000", 0.0, 1.0),
        ("G1 E-1.5", 0.0, -1.5),
        ("T0", 0.0, 0.0),
        ("G1 X100 Y100 E0.5 F3000", 0.5, 0.0),
        ("T1 S1", 0.0, 0.0),
        ("G1 E1", 0.0, 1.0),
    ] {
        let before = motors_mm(&mut bench);
        send(&mut bench, line);
        let [.., by_e, by_e1] = moved(&mut bench, before);
        assert!(near(by_e, e) && near(by_e1, e1), "{line}: {by_e} {by_e1}");
    }
    // A stop leaves the selected tool selected.
    send(&mut bench, "M410\nG1 E1");
    let before = motors_mm(&mut bench);
    send(&mut bench, "G1 E1");
    let [.., by_e, by_e1] = moved(&mut bench, before);
    assert!(near(by_e, 0.0) && near(by_e1, 1.0));
}

/// The carriage goes where the offset says, as X, Y and Z of the frame.
#[test]
fn the_new_nozzle_goes_to_where_the_old_one_was() {
    let mut bench = boot();
    send(&mut bench, "G28\nG1 Z5 F600\nG1 X100 Y100 F6000");
    let before = motors_mm(&mut bench);
    send(&mut bench, "T1");
    let [a, b, z, e, e1] = moved(&mut bench, before);
    assert!(near((a + b) / 2.0, -OFFSET_MM[0]) && near((a - b) / 2.0, -OFFSET_MM[1]), "{a} {b}");
    assert!(near(z, -OFFSET_MM[2]) && e == 0.0 && e1 == 0.0, "{z} {e} {e1}");
    let place = bench.host.ask("M114", "X:").unwrap();
    assert!(place.starts_with("X:100.00 Y:100.00 Z:5.00 E:0.00"), "{place}");
    send(&mut bench, "T0");
    let back = moved(&mut bench, before);
    assert!(back.iter().all(|mm| mm.abs() < 0.01), "{back:?}");
    let refused = bench.host.send("T2");
    assert!(format!("{refused:?}").contains("T0 and T1") || refused.is_ok(), "{refused:?}");
}

/// Levels of the heaters' outputs, 5 ms later: true for high.
fn highs(bench: &mut Bench) -> [bool; 2] {
    bench.pass(5);
    let state = bench.state();
    ["A2", "A3"].map(|name| state.is_high(pin(name)))
}

#[test]
fn each_nozzle_is_controlled_by_its_own_thermistor() {
    let mut bench = boot();
    bench.set_celsius("nozzle1", 150.0);
    send(&mut bench, "M104 T1 S180\nM109 T1 S180");
    let celsius = |bench: &mut Bench, name: &'static str| {
        let now_ns = bench.now_ns();
        bench.with(move |machine, _| {
            let place = machine.plant.heaters.iter_mut().find(|heater| heater.name == name).unwrap();
            place.heater.body_celsius(now_ns)
        })
    };
    let (first, second) = (celsius(&mut bench, "nozzle"), celsius(&mut bench, "nozzle1"));
    // The plant's thermistor follows its maker's beta, the image the table.
    assert!((172.0..188.0).contains(&second) && first < 30.0, "{first} {second}");
    // PA2 is the first nozzle's, PA3 the second's.
    let looks: Vec<[bool; 2]> = (0..200).map(|_| highs(&mut bench)).collect();
    assert!(looks.iter().all(|[first, _]| !first) && looks.iter().any(|[_, second]| *second));
    bench.host.send_raw(b"M105\n").unwrap();
    let said = bench.host.wait_for("temperatures", |line| line.starts_with("ok T:")).unwrap();
    assert!(said.contains(" T0:2") && said.contains(" T1:1") && said.contains(" @1:"), "{said}");
}

#[test]
fn a_broken_thermistor_of_t1_halts_the_printer() {
    let mut bench = boot();
    send(&mut bench, "M104 T1 S200\nM104 T0 S200\nG4 S2");
    bench.with(|machine, _| {
        let mut places = machine.plant.thermistors.iter_mut();
        places.find(|place| place.name == "nozzle1").unwrap().thermistor.set_fault(Some(SensorFault::Open));
    });
    let error = bench.host.wait_for("a thermal error", |line| line.starts_with("Error:")).unwrap();
    assert!(error.starts_with("Error:MINTEMP triggered, system stopped! Heater_ID: E1"), "{error}");
    bench.pass(300);
    assert!(!bench.any_heater_on());
}

#[test]
fn macros_come_before_and_after_a_change() {
    let mut bench = boot();
    send(&mut bench, "G28\nG1 Z5 F600\nG1 X100 Y100 F6000");
    let before = motors_mm(&mut bench);
    bench.host.send_raw(b"T1\n").unwrap();
    for line in ["before T1", "echo:Active Extruder: 1", "after T0", "ok"] {
        bench.host.wait_for(line, |said| said == line).unwrap();
    }
    let [a, b, ..] = moved(&mut bench, before);
    assert!(near((a + b) / 2.0, -OFFSET_MM[0]), "{a} {b}");
}

/// The chips' registers by the data sheet's formula (section 9): with 0.11 ohm and 0.18 V 979 mA
/// at a scale of 32.
#[test]
fn the_second_motor_s_driver_is_set_by_its_tool() {
    let mut bench = boot();
    let registers = |bench: &mut Bench| {
        bench.with(|machine, _| {
            [3, 4].map(|motor| {
                let registers = machine.plant.drivers[motor].registers();
                (registers.irun(), registers.spread_cycle())
            })
        })
    };
    send(&mut bench, "M17");
    let [first, second] = registers(&mut bench);
    assert_eq!(second, (22, true), "700 mA are 23 of 32");
    send(&mut bench, "M906 T1 E500\nM569 S1 T1 E\nM17");
    assert_eq!(registers(&mut bench), [first, (15, false)], "500 mA are 16 of 32");
    // Without T the selected one's.
    send(&mut bench, "T1 S1\nM906 E700\nM17");
    assert_eq!(registers(&mut bench), [first, (22, false)]);
    let line = bench.host.ask("M906 T1", "echo:driver E1:").unwrap();
    assert!(line.starts_with("echo:driver E1: 700 mA"), "{line}");
}
