//! Three motors lift the Octopus's Z and are at different heights: G34 brings them to one, and
//! every stop leaves them together again.
//!
//! The test compares the positions of the model's motors, not what the firmware reports.

use std::sync::OnceLock;

use ferrostep_mainboard::parts::motion::lift::Lift;

use crate::firmware::bench::Bench;
use crate::firmware::equipped::{octopus, without_homing_of_z};
use crate::firmware::images::{Variant, changed};

/// The motors among the board's: `z`, `z2`, `e1`.
const MOTORS: [usize; 3] = [2, 7, 4];
const PLACES: [[f64; 2]; 3] = [[-10.0, 0.0], [310.0, 0.0], [150.0, 310.0]];
const POINTS: [[f64; 2]; 3] = [[20.0, 20.0], [240.0, 30.0], [130.0, 280.0]];

/// Further motors that a hand has turned before, mm.
const OFF_MM: [f64; 2] = [1.0, -0.7];

fn tables() -> String {
    let motor = |name: &str, [x, y]: [f64; 2], more: &str| format!("{name} = {{ x = {x}, y = {y}{more} }}\n");
    let [z, z2, e1] = PLACES;
    let motors = motor("z", z, "") + &motor("z2", z2, ", inverted = true") + &motor("e1", e1, "");
    let points: String = ["left", "right", "back"].into_iter().zip(POINTS).map(|(n, p)| motor(n, p, "")).collect();
    format!(
        "[homing]\nraise_mm = 10\nhome_at_mm = {{ x = 150, y = 150 }}\nprobe_offset_mm = {{ x = -40, y = -10, z = -1 }}\n\n\
         [mesh]\npoints = {{ x = 3, y = 3 }}\nlift_mm = 3\n\n[z_motors.motors]\n{motors}\n[z_motors.points]\n{points}\n\
         [homing.z]\nend = \"min\"\nsensor = \"probe\"\nposition_mm = 0\nfast_mm_per_s = 10\nslow_mm_per_s = 2\n\
         back_off_mm = 3\n"
    )
}

fn built() -> &'static Variant {
    static BUILT: OnceLock<Variant> = OnceLock::new();
    BUILT.get_or_init(|| {
        changed(
            "btt-octopus-1.1",
            "corexy",
            "octopus-with-three-z",
            |board| board,
            |profile| without_homing_of_z(&profile) + &tables(),
        )
    })
}

/// Switched on, after a hand has turned the screws.
fn boot() -> Bench {
    let Variant { board, profile, image } = built();
    let mut bench = Bench::boot_variant(octopus(), board, profile, image);
    turn(&mut bench);
    bench
}

fn turn(bench: &mut Bench) {
    bench.change(|plant, _| {
        for (motor, off_mm) in MOTORS[1..].iter().zip(OFF_MM) {
            plant.motion.turn_by_hand(*motor, off_mm);
        }
    });
}

/// Positions of the motors, in 1/256 of a full step.
fn fields(bench: &mut Bench) -> [i64; 3] {
    bench.with(|machine, _| MOTORS.map(|motor| machine.plant.motion.field_256(motor)))
}

/// Heights of the further motors above the axis's own, mm.
fn apart(bench: &mut Bench) -> [f64; 2] {
    bench.with(|machine, _| {
        let mm = |motor: usize| machine.plant.motion.motor_mm(motor);
        [MOTORS[1], MOTORS[2]].map(|motor| mm(motor) - mm(MOTORS[0]))
    })
}

/// Difference in height of the lifted part between the points, mm.
fn tilt(bench: &mut Bench) -> f64 {
    let lift = Lift::new(MOTORS.into_iter().zip(PLACES).collect()).unwrap();
    bench.with(move |machine, _| {
        let heights = POINTS.map(|point| lift.raised_mm(point, |motor| machine.plant.motion.motor_mm(motor)));
        heights.into_iter().fold(f64::MIN, f64::max) - heights.into_iter().fold(f64::MAX, f64::min)
    })
}

/// The nozzle was never pressed into the bed; how high it is above it.
fn height(bench: &mut Bench) -> f64 {
    bench.with(|machine, _| {
        assert_eq!(machine.plant.motion.sheet().crash(), None);
        let (motion, lift) = (&machine.plant.motion, Lift::new(MOTORS.into_iter().zip(PLACES).collect()).unwrap());
        let place = [motion.position_mm(0), motion.position_mm(1)];
        motion.position_mm(2) + lift.raised_mm(place, |motor| motion.motor_mm(motor))
    })
}

/// Moves of all axes: the motors of Z make the same steps, to the last one.
fn assert_together(bench: &mut Bench) {
    let before = fields(bench);
    let mut least = i64::MAX;
    for layer in 1..4 {
        let z = f64::from(layer) * 0.31 + 3.0;
        for line in [
            format!("G1 X{} Y120 Z{z} F9000", 100 + 10 * layer),
            format!("G1 X140 Y{} Z{}", 90 + layer, z + 0.2),
            format!("G1 Z{z}"),
            format!("G1 X{} Y100", 120 - layer),
        ] {
            bench.host.send(&line).unwrap();
        }
        bench.host.send("M400").unwrap();
        let now = fields(bench);
        let moved: [i64; 3] = std::array::from_fn(|motor| now[motor] - before[motor]);
        assert_eq!(moved, [moved[0]; 3], "layer {layer}");
        least = least.min(moved[0]);
    }
    let after = fields(bench);
    assert_ne!(after[0], before[0] + least, "Z has not moved");
}

/// Sends a line that fails; what it says.
fn refused(bench: &mut Bench, line: &str) -> String {
    bench.host.send_raw(format!("{line}\n").as_bytes()).unwrap();
    let says = bench.host.wait_for("a refusal", |text| text.starts_with("echo:line ")).unwrap();
    bench.host.wait_for("its ok", |text| text == "ok").unwrap();
    says
}

#[test]
fn motors_apart_are_brought_together() {
    let mut bench = boot();
    bench.host.send("G28").unwrap();
    let [second, third] = apart(&mut bench);
    // Motors that get current snap to the nearest place of their field: at most two full
    // steps of 0.04 mm.
    assert!((second - OFF_MM[0]).abs() < 0.09 && (third - OFF_MM[1]).abs() < 0.09, "{second} {third}");
    assert!(tilt(&mut bench) > 1.0);
    bench.host.send("G34").unwrap();
    let left = tilt(&mut bench);
    println!("the points differ by {left:.4} mm, the motors by {:?}", apart(&mut bench));
    assert!(left < 0.02, "{left}");
    // Z is home: the nozzle is where the G-code says.
    bench.host.send("G1 X100 Y100 Z5 F6000").unwrap();
    bench.host.send("M400").unwrap();
    let height = height(&mut bench);
    assert!((height - 5.0).abs() < 0.03, "{height}");
    assert_together(&mut bench);
    // What is aligned is left alone.
    let before = fields(&mut bench);
    bench.host.send("Z_TILT_ADJUST").unwrap();
    let now = fields(&mut bench);
    assert_eq!(now.map(|field| field - now[0]), before.map(|field| field - before[0]));
}

/// Each way to end G34 while one motor moves alone: nothing moves any more, Z is not home, and all
/// motors step together again.
#[test]
fn a_stop_in_the_midst_leaves_no_motor_out() {
    let mut bench = boot();
    bench.host.send("G28").unwrap();
    for stop in ["M410", "M112", "reset"] {
        let begun = apart(&mut bench);
        bench.host.send_raw(b"G34\n").unwrap();
        let mut looks = 0;
        // The second motor is the lowest but one, or the third the lowest: one of them moves alone,
        // or both beside the first.
        while apart(&mut bench).iter().zip(begun).all(|(now, begun)| (now - begun).abs() < 0.15) {
            bench.wait_us(2_000);
            looks += 1;
            assert!(looks < 30_000, "no motor moves alone");
        }
        if stop == "reset" {
            // The chip of a further motor loses its supply for a moment.
            bench.change(|plant, now_ns| {
                plant.disturb_driver(now_ns, MOTORS[2], |driver| {
                    driver.set_supply(now_ns, false);
                    driver.set_supply(now_ns, true);
                })
            });
            let says = bench.host.wait_for("the driver", |text| text.contains("driver Z3")).unwrap();
            assert!(says.starts_with("Error:driver Z3 has been reset"), "{says}");
        } else {
            bench.host.send_raw(format!("{stop}\n").as_bytes()).unwrap();
        }
        bench.pass(1_500);
        let stopped = fields(&mut bench);
        bench.pass(500);
        assert_eq!(fields(&mut bench), stopped, "{stop}");
        if stop != "M410" {
            bench.host.send_raw(b"M999\n").unwrap();
            bench.host.wait_for("ok", |line| line == "ok").unwrap();
        }
        let says = refused(&mut bench, "G34");
        assert!(says.contains("is not homed"), "{stop}: {says}");
        bench.host.send("G28").unwrap();
        assert_together(&mut bench);
    }
    bench.host.send("G34").unwrap();
    let left = tilt(&mut bench);
    assert!(left < 0.02, "{left}");
    assert_together(&mut bench);
    height(&mut bench);
}

/// Two motors are plugged in the wrong way round: what G34 does makes it worse, and it ends.
#[test]
fn swapped_motors_are_noticed() {
    let Variant { board, profile, image } = built();
    let text = std::fs::read_to_string(profile).unwrap();
    let [_, [x, y], [other_x, other_y]] = PLACES;
    let swapped = text
        .replace(&format!("z2 = {{ x = {x}, y = {y}"), &format!("z2 = {{ x = {other_x}, y = {other_y}"))
        .replace(&format!("e1 = {{ x = {other_x}, y = {other_y}"), &format!("e1 = {{ x = {x}, y = {y}"));
    assert_ne!(swapped, text);
    let of_model = profile.with_file_name("swapped.toml");
    std::fs::write(&of_model, swapped).unwrap();
    let mut bench = Bench::boot_variant(octopus(), board, &of_model, image);
    turn(&mut bench);
    bench.host.send("G28").unwrap();
    let says = refused(&mut bench, "G34");
    assert!(says.contains("is each plugged in where the profile says"), "{says}");
    let says = refused(&mut bench, "G34");
    assert!(says.contains("Z is not homed"), "{says}");
}

/// Drivers of all motors have Z's settings, and are looked after.
#[test]
fn every_motors_driver_is_set() {
    let mut bench = boot();
    bench.host.send("M17").unwrap();
    bench.host.send("M906 Z450").unwrap();
    bench.host.send("M569 S0 Z").unwrap();
    bench.host.send_raw(b"M122\n").unwrap();
    for name in ["Z", "Z2", "Z3"] {
        let line = bench.host.wait_for(name, |text| text.starts_with(&format!("echo:driver {name}: "))).unwrap();
        assert!(line.contains("confirmed") && line.contains("spreadCycle"), "{line}");
    }
    bench.host.wait_for("ok", |line| line == "ok").unwrap();
    let registers = bench.with(|machine, _| {
        MOTORS.map(|motor| {
            let driver = &machine.plant.drivers[motor];
            (driver.energized(), driver.registers().irun(), driver.registers().spread_cycle())
        })
    });
    assert_eq!(registers, [registers[0]; 3]);
    assert!(registers[0].0 && registers[0].2, "{registers:?}");
    bench.host.send("M84 Z").unwrap();
    let powered = bench.with(|machine, _| MOTORS.map(|motor| machine.plant.drivers[motor].energized()));
    assert_eq!(powered, [false; 3]);
}
