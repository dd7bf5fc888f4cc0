//! A machine whose axes are not at right angles, and one whose firmware knows it.

use std::fs;

use serde_json::Value;

use crate::end_to_end::command::{directory, ferrostep, file, repository};

/// A printed square's corners A, B, C and D, in the order of [`MEASURES`]'s lengths.
const SIDE_MM: f64 = 150.0;
const CORNERS_MM: [[f64; 2]; 4] = [[20.0, 20.0], [20.0, 170.0], [170.0, 170.0], [170.0, 20.0]];

/// Angles of the machines, degrees, by which Y leans towards +X, Z towards +X, and Z towards +Y. If
/// the first two are both large, the measurements of Y and Z contain their product, which the
/// makers' formula does not know: at 1 degree each that is 0.03 %.
const LEANS_DEGREES: [[f64; 3]; 4] = [[0.15, 0.0, 0.0], [-0.8, 0.0, 0.0], [0.3, 0.2, -0.25], [1.0, 0.0, 1.2]];

/// Frame of a real machine: unit vectors of its axes in a space with right angles. The firmware
/// does not use it.
struct Frame {
    axes: [[f64; 3]; 3],
}

impl Frame {
    fn of(leans_degrees: [f64; 3]) -> Self {
        let [xy, xz, yz] = leans_degrees.map(|degrees| degrees.to_radians().tan());
        let unit = |axis: [f64; 3]| {
            let length = axis.iter().map(|part| part * part).sum::<f64>().sqrt();
            axis.map(|part| part / length)
        };
        Self { axes: [[1.0, 0.0, 0.0], unit([xy, 1.0, 0.0]), unit([xz, yz, 1.0])] }
    }

    /// Place of the nozzle for these positions of the motors, mm.
    fn place(&self, motors_mm: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|part| (0..3).map(|axis| motors_mm[axis] * self.axes[axis][part]).sum())
    }
}

fn distance(one: [f64; 3], other: [f64; 3]) -> f64 {
    (0..3).map(|part| (one[part] - other[part]).powi(2)).sum::<f64>().sqrt()
}

/// AC, BD and AD of the square that a machine prints in a plane of two of its axes without
/// knowing of its lean.
fn measures(frame: &Frame, [first, second]: [usize; 2]) -> [f64; 3] {
    let [a, b, c, d] = CORNERS_MM.map(|[along, across]| {
        let mut motors_mm = [0.0; 3];
        (motors_mm[first], motors_mm[second]) = (along, across);
        frame.place(motors_mm)
    });
    [distance(a, c), distance(b, d), distance(a, d)]
}

const CARTESIAN_STEPS_PER_MM: [f64; 3] = [80.0, 80.0, 400.0];

/// Positions of the motors of the cartesian profile, with further keys, after some lines, mm.
fn motors_mm(keys: &str, lines: &str) -> [f64; 3] {
    let directory = directory();
    let text = fs::read_to_string(repository().join("config/profiles/cartesian.toml")).unwrap();
    let profile = file(&directory, "profile.toml", format!("{text}\n{keys}"));
    let job = file(&directory, "job.gcode", format!("G28\n{lines}\n"));
    let arguments = ["print", job.to_str().unwrap(), "--profile", profile.to_str().unwrap(), "--json"];
    let outcome = ferrostep(arguments);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    let steps = outcome.json();
    let steps = steps["motor_steps"].clone();
    let at = |axis: usize| match &steps {
        Value::Array(steps) => steps[axis].as_f64().unwrap(),
        steps => steps[["x", "y", "z"][axis]].as_f64().unwrap(),
    };
    std::array::from_fn(|axis| at(axis) / CARTESIAN_STEPS_PER_MM[axis])
}

/// Prints the calibration square of each plane on each machine. Uncorrected its diagonals differ as
/// they were measured; corrected by these measures, in the profile and by each maker's command,
/// they are equal within a step of X and Y.
#[test]
fn the_squares_diagonals_are_equal() {
    let planes = [("xy", [0, 1]), ("xz", [0, 2]), ("yz", [1, 2])];
    for leans in LEANS_DEGREES {
        let frame = Frame::of(leans);
        let mut keys = String::new();
        let mut set = "SET_SKEW".to_owned();
        for (name, plane) in planes {
            let [ac, bd, ad] = measures(&frame, plane);
            keys += &format!("[skew.{name}]\nac_mm = {ac:.9}\nbd_mm = {bd:.9}\nad_mm = {ad:.9}\n");
            set += &format!(" {}={ac:.9},{bd:.9},{ad:.9}", name.to_uppercase());
        }
        for (name, [first, second]) in planes {
            let mut diagonals = [0.0; 3];
            for (corrected, keys, set) in [(0, "", ""), (1, keys.as_str(), ""), (2, "", set.as_str())] {
                let corners = CORNERS_MM.map(|[along, across]| {
                    let mut asked = [0.0, 0.0, 10.0];
                    (asked[first], asked[second]) = (along, across);
                    let [x, y, z] = asked;
                    frame.place(motors_mm(keys, &format!("{set}\nG1 X{x} Y{y} Z{z} F3000")))
                });
                let [a, b, c, d] = corners;
                diagonals[corrected] = distance(a, c) - distance(b, d);
                if corrected > 0 {
                    let sides = [distance(a, b), distance(b, c), distance(c, d), distance(d, a)];
                    // An axis that leans by p is longer by 1 / cos p than its height, which no
                    // correction of angles sees.
                    let longest = SIDE_MM
                        * leans.into_iter().fold(0.0f64, |most, lean| most.max(lean.abs().to_radians())).powi(2);
                    let right = sides.into_iter().all(|side| (side - SIDE_MM).abs() < 0.0125 * 1.5 + longest);
                    assert!(right, "{leans:?} {name}: {sides:?}");
                }
            }
            let [uncorrected, profile, command] = diagonals;
            let [ac, bd, _] = measures(&frame, [first, second]);
            assert!((uncorrected - (ac - bd)).abs() < 0.02, "{leans:?} {name}: {uncorrected}, measured {}", ac - bd);
            for corrected in [profile, command] {
                assert!(corrected.abs() < 0.0125 * 1.5, "{leans:?} {name}: the diagonals differ by {corrected} mm");
            }
        }
    }
}

/// X may go at 2 mm/s: a move along Y, for which X goes 5 % as far, takes as long as X needs, and
/// one without skew as Y does.
#[test]
fn the_limits_are_those_of_the_axes() {
    let time_s = |factor: f64| {
        let directory = directory();
        let text = fs::read_to_string(repository().join("config/profiles/cartesian.toml")).unwrap();
        let profile = file(&directory, "profile.toml", format!("{text}\n[skew]\nxy.factor = {factor}\n"));
        let job = file(&directory, "job.gcode", "G28\nM203 X2\nM205 X0.1\nG1 Y180 F9000\n");
        let arguments = ["print", job.to_str().unwrap(), "--profile", profile.to_str().unwrap(), "--json"];
        let outcome = ferrostep(arguments);
        assert_eq!(outcome.status, Some(0), "{outcome:#?}");
        outcome.json()["motion_time_s"].as_f64().unwrap()
    };
    let (straight, skew) = (time_s(0.0), time_s(-0.05));
    // 180 mm at 150 mm/s, and 9 mm at 2 mm/s.
    assert!(
        (3.0..4.0).contains(&(skew - straight)) || (skew - straight - (4.5 - 1.2)).abs() < 0.5,
        "{straight} {skew}"
    );
}

/// A machine without skew is unchanged: the same steps to the bit, also where no skew is written,
/// set and taken back.
#[test]
fn no_skew_is_as_ever() {
    let digest = |keys: &str, before: &str| {
        let directory = directory();
        let text = fs::read_to_string(repository().join("config/profiles/cartesian.toml")).unwrap();
        let profile = file(&directory, "profile.toml", format!("{text}\n{keys}"));
        let cube = fs::read_to_string(repository().join("examples/cube.gcode")).unwrap();
        let job = file(&directory, "job.gcode", format!("{before}{cube}"));
        let arguments = ["print", job.to_str().unwrap(), "--profile", profile.to_str().unwrap(), "--json"];
        let outcome = ferrostep(arguments);
        assert_eq!(outcome.status, Some(0), "{outcome:#?}");
        outcome.json()["step_digest"].clone()
    };
    let before = digest("", "");
    assert_eq!(digest("[skew]\nxy.factor = 0.0\n", ""), before);
    assert_eq!(digest("", "M852 I0.01 J0.01 K-0.01\nM852 I0 J0 K0\n"), before);
    assert_ne!(digest("[skew]\nxy.factor = 0.001\n", ""), before);
}

/// A prepared job is planned for right angles: it is refused by name where it is made, and
/// where it is printed.
#[test]
fn no_job_is_prepared_for_skew_axes() {
    let directory = directory();
    let text = fs::read_to_string(repository().join("config/profiles/cartesian.toml")).unwrap();
    let straight = file(&directory, "straight.toml", &text);
    let skew = file(&directory, "skew.toml", format!("{text}\n[skew]\nyz.factor = 0.001\n"));
    let (straight, skew) = (straight.to_str().unwrap(), skew.to_str().unwrap());
    let job = directory.path().join("job.gpre");
    let job = job.to_str().unwrap();
    let outcome = ferrostep(["preprocess", "examples/cube.gcode", "-o", job, "--profile", skew]);
    assert!(outcome.stderr.contains("and the profile's are skew: print the G-code"), "{outcome:#?}");
    let set = file(&directory, "set.gcode", "G28\nM852 I0.001\nG1 X10 F6000\n");
    let outcome = ferrostep(["preprocess", set.to_str().unwrap(), "-o", job, "--profile", straight]);
    assert!(outcome.stderr.contains("line 2: a prepared job is planned for axes at right angles"), "{outcome:#?}");
    let outcome = ferrostep(["preprocess", "examples/cube.gcode", "-o", job, "--profile", straight]);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    // The skew is measured on each machine anew and binds no job: the machine itself refuses.
    let outcome = ferrostep(["print", job, "--profile", skew]);
    assert!(outcome.stderr.contains("send M852 I0 J0 K0 first, or print its G-code"), "{outcome:#?}");
}

#[test]
fn a_profile_says_what_is_wrong_with_its_skew() {
    let directory = directory();
    let text = fs::read_to_string(repository().join("config/profiles/cartesian.toml")).unwrap();
    for (keys, says) in [
        ("xy.factor = 0.06", "skew.xy.factor"),
        ("xy.ac_mm = 141.4", "either factor, or ac_mm, bd_mm and ad_mm"),
        ("xz = { factor = 0.01, ac_mm = 140, bd_mm = 140, ad_mm = 100 }", "either factor, or ac_mm, bd_mm and ad_mm"),
        ("yz = { ac_mm = 150, bd_mm = 130, ad_mm = 100 }", "at most 5 % out of square, not 14.4 %"),
        ("yz = { ac_mm = 100, bd_mm = 100, ad_mm = 300 }", "the diagonals and the side of one parallelogram"),
    ] {
        let profile = file(&directory, "profile.toml", format!("{text}\n[skew]\n{keys}\n"));
        let outcome = ferrostep(["print", "examples/cube.gcode", "--profile", profile.to_str().unwrap()]);
        assert!(outcome.status != Some(0) && outcome.stderr.contains(says), "{keys}: {outcome:#?}");
    }
}
