//! Several motors of Z: the table `z_motors`.

use ferrostep_printer::{Profile, ZAlignment, ZMotor};
use ferrostep_profiles::{ProfileError, builtin_text, parse};
use proptest::prelude::*;

const TWO: &str = "\n[z_motors.motors]\nz = {}\nz2 = {}\n";
const THREE: &str = "\n[z_motors]\nmax_correction_mm = 3\n[z_motors.motors]\nz2 = { x = 190, y = 10, inverted = true }\n\
                     z = { x = -10, y = 10 }\ne1 = { x = 90, y = 200 }\n[z_motors.points]\nleft = { x = 20, y = 20 }\n\
                     right = { x = 140, y = 20 }\nback = { x = 80, y = 160 }\n";

fn mini(table: &str) -> Result<Profile, ProfileError> {
    parse(&format!("{}{table}", builtin_text("prusa-mini").unwrap()), "mini.toml")
}

fn aligned(motors: &[(&str, [f64; 2])], points: &[[f64; 2]]) -> Result<ZAlignment, String> {
    let motors: String = motors.iter().map(|(name, [x, y])| format!("{name} = {{ x = {x}, y = {y} }}\n")).collect();
    let points: String = (0..).zip(points).map(|(n, [x, y])| format!("p{n} = {{ x = {x}, y = {y} }}\n")).collect();
    let table = format!("\n[z_motors.motors]\n{motors}[z_motors.points]\n{points}");
    mini(&table).map(|profile| profile.z_motors.unwrap().0.alignment.unwrap()).map_err(|error| error.to_string())
}

#[test]
fn the_axis_own_motor_is_the_first() {
    let motors = mini(TWO).unwrap().z_motors.unwrap().0;
    assert_eq!((motors.count(), motors.alignment), (2, None));
    assert_eq!(motors.further, [Some(ZMotor { socket: "z2", is_inverted: false }), None, None]);
    assert_eq!(mini("").unwrap().z_motors, None);
    let motors = mini(THREE).unwrap().z_motors.unwrap().0;
    assert_eq!(motors.count(), 3);
    let further = [("z2", true), ("e1", false)].map(|(socket, is_inverted)| Some(ZMotor { socket, is_inverted }));
    assert_eq!(motors.further[..2], further);
    let alignment = motors.alignment.unwrap();
    let mm = |[x, y]: [i64; 2]| [x * 100_000, y * 100_000];
    assert_eq!(alignment.places_10nm, [[-10, 10], [190, 10], [90, 200], [0, 0]].map(mm));
    assert_eq!(alignment.points_10nm[..3], [[20, 20], [140, 20], [80, 160]].map(|point| Some(mm(point))));
    assert_eq!((alignment.points_10nm[3], alignment.max_correction_10nm), (None, 300_000));
    // The number of motors that lift the bed changes no plan.
    assert_eq!(mini(THREE).unwrap().plan_hash, mini("").unwrap().plan_hash);
}

/// Heights at the points, of a surface of the motors' shape: they give its height at each motor.
fn assert_exact(alignment: &ZAlignment, motors: usize, height: impl Fn([f64; 2]) -> f64) {
    let mm = |[x, y]: [i64; 2]| [x as f64 / 1e5, y as f64 / 1e5];
    for (weights, place) in alignment.weights.iter().zip(alignment.places_10nm).take(motors) {
        let points = alignment.points_10nm.iter().flatten();
        let found: f64 = points.zip(weights).map(|(point, weight)| height(mm(*point)) * f64::from(*weight)).sum();
        let wanted = height(mm(place));
        assert!((found - wanted).abs() < 1e-4, "{place:?}: {found}, {wanted}");
    }
    for (motor, weights) in alignment.weights.iter().enumerate() {
        let sum: f32 = weights.iter().sum();
        // A bed that is higher everywhere is higher at each motor.
        assert!((sum - if motor < motors { 1.0 } else { 0.0 }).abs() < 1e-5, "{motor}: {sum}");
    }
}

proptest! {
    #[test]
    fn surfaces_of_the_motors_shape_are_found(
        [a, b, c, d] in [-2.0f64..2.0, -0.01..0.01, -0.01..0.01, -0.000_04..0.000_04],
    ) {
        // Two motors on a line along X that is not quite one; the points are beside it.
        let two = aligned(&[("z", [-30.0, 90.0]), ("e1", [210.0, 90.0])], &[[20.0, 20.0], [140.0, 150.0]]).unwrap();
        assert_exact(&two, 2, |[x, _]| a + b * x);
        let places = [("z", [-10.0, 10.0]), ("z2", [190.0, 5.0]), ("e2", [90.0, 200.0])];
        let points = [[20.0, 20.0], [140.0, 20.0], [80.0, 160.0], [20.0, 150.0]];
        assert_exact(&aligned(&places, &points[..3]).unwrap(), 3, |[x, y]| a + b * x + c * y);
        assert_exact(&aligned(&places, &points).unwrap(), 3, |[x, y]| a + b * x + c * y);
        let places = [("z", [-10.0, -10.0]), ("z2", [-10.0, 190.0]), ("e1", [190.0, 190.0]), ("e2", [190.0, -10.0])];
        let points = [[20.0, 20.0], [20.0, 160.0], [140.0, 160.0], [140.0, 20.0], [80.0, 90.0]];
        let twisted = |[x, y]: [f64; 2]| a + b * x + c * y + d * x * y;
        assert_exact(&aligned(&places, &points[..4]).unwrap(), 4, twisted);
        assert_exact(&aligned(&places, &points).unwrap(), 4, twisted);
    }
}

#[test]
fn bad_values_are_refused_by_name() {
    for (table, says) in [
        ("\n[z_motors.motors]\nz = {}\n".to_owned(), "z_motors.motors"),
        ("\n[z_motors.motors]\nz2 = {}\ne1 = {}\n".to_owned(), "expected z, and 1 to 3 others"),
        (
            "\n[z_motors.motors]\nz = {}\nz2 = {}\ne1 = {}\ne2 = {}\ne3 = {}\n".to_owned(),
            "expected z, and 1 to 3 others",
        ),
        ("\n[z_motors.motors]\nz = {}\ne4 = {}\n".to_owned(), "expected z, z2, e1, e2, e3, not e4"),
        ("\n[z_motors.motors]\nz = { inverted = true }\nz2 = {}\n".to_owned(), "driver.inverted sets it for z"),
        (
            format!("{TWO}[z_motors.points]\na = {{ x = 20, y = 20 }}\nb = {{ x = 140, y = 20 }}\n"),
            "x and y of each motor",
        ),
        (THREE.replace("back = { x = 80, y = 160 }", ""), "expected 3 to 8 places for 3 motors"),
        (THREE.replace("y = 160", "y = 21"), "farther apart"),
        (THREE.replace("y = 160", "y = 20"), "farther apart"),
        (THREE.replace("y = 200", "y = 10"), "three motors that are not on one line"),
        (THREE.replace("x = 140", "x = 152"), "z_motors.points.right.x = 152: expected 0 to 151.4 mm"),
        (THREE.replace("right =", "\"to the right\" ="), "a name of letters, digits and _"),
        (THREE.replace("= 3\n", "= 30\n"), "z_motors.max_correction_mm = 30: expected 0.1 to 20 mm"),
    ] {
        let error = mini(&table).expect_err(&table).to_string();
        assert!(error.contains(says), "{table}: {error}");
    }
    let diamond = [("z", [-10.0, 90.0]), ("z2", [90.0, 190.0]), ("e1", [190.0, 90.0]), ("e2", [90.0, -10.0])];
    let points = [[20.0, 20.0], [20.0, 160.0], [140.0, 160.0], [140.0, 20.0]];
    let error = aligned(&diamond, &points).unwrap_err();
    assert!(error.contains("four motors at the corners of a frame along X and Y"), "{error}");
    let error = aligned(&[("z", [0.0, 0.0]), ("z2", [0.0, 0.0])], &points[..2]).unwrap_err();
    assert!(error.contains("two motors in different places"), "{error}");
    // Without a probe several motors may lift Z all the same.
    let cartesian = builtin_text("cartesian").unwrap();
    assert!(parse(&format!("{cartesian}{TWO}"), "own.toml").unwrap().z_motors.is_some());
    let error = parse(&format!("{cartesian}{THREE}"), "own.toml").unwrap_err().to_string();
    assert!(error.contains("homing.z.sensor = \"probe\""), "{error}");
}
