//! The motors that lift Z, where it has several, and how they are aligned.

use ferrostep_checked_toml::{Range, Section, range};
use ferrostep_printer::{Kept, SafeHoming, ZAlignment, ZMotor, ZMotors};

use crate::axes::units_10nm;
use crate::names::check_name;

const PLACE: Range = range(-1_000.0, 2_000.0, "mm");
const CORRECTION: Range = range(0.1, 20.0, "mm");
/// Klipper's for a gantry on four belts (`max_adjust`).
const DEFAULT_CORRECTION_MM: f64 = 4.0;
/// The motor of an axis, and the board's other sockets.
const FIRST: &str = "z";
pub(crate) const SOCKETS: [&str; 4] = ["z2", "e1", "e2", "e3"];
/// Longest name of a point, bytes.
const MAX_NAME: usize = 24;
/// Maximum ratio of the error at a motor to that of the probe at the points, all of them in the
/// worst directions.
const MAX_LEVER: f64 = 10.0;

/// The motors of Z, if the profile names several; `reach_mm` is the part of the bed that the probe
/// reaches along X and Y.
pub(crate) fn z_motors(
    keys: &Section<'_>,
    reach_mm: &[[f64; 2]; 2],
    safe: &SafeHoming,
    is_measured: bool,
    has_own_motor: bool,
) -> Option<Kept<ZMotors>> {
    let about = "the [motors that lift Z together](z-motors.md), and where they are aligned (G34)";
    let table = keys.optional_section("z_motors", "one motor", about)?;
    if !has_own_motor {
        keys.refuse("z_motors", "kinematics = \"cartesian\" or \"corexy\" with it: on others Z shares its motor");
    }
    let correction = table.number("max_correction_mm", CORRECTION).or(
        DEFAULT_CORRECTION_MM,
        "maximum misalignment of the motors that G34 corrects, and how far below its height at home it probes for the \
         bed",
    );
    let motors = table.named_sections(
        "motors",
        "NAME",
        "",
        "2 to 4 motors, by their names in the board's file: `z`, and any of `z2`, `e1`, `e2` and `e3`",
        "this motor",
    );
    let mut places_mm = Vec::new();
    let mut further = [None; ZMotors::FURTHER];
    let mut free = further.iter_mut();
    for (name, section) in &motors {
        let place = ["x", "y"].map(|axis| {
            section.number(axis, PLACE).optional(
                "with `points`: required",
                "position of the pivot or belt where the motor lifts the bed or gantry",
            )
        });
        places_mm.push(place);
        let is_inverted =
            section.flag("inverted").or(false, "direction of the motor is inverted (for `z`, see `driver.inverted`)");
        if *name == FIRST {
            if is_inverted {
                section.refuse("inverted", "false: driver.inverted sets it for z");
            }
        } else if let Some(motor) = free.next() {
            *motor = Some(ZMotor { socket: name, is_inverted });
        }
        if *name != FIRST && !SOCKETS.contains(name) && *name != "NAME" {
            table.refuse("motors", format!("z, {}, not {name}", SOCKETS.join(", ")));
        }
    }
    let is_first_there = motors.iter().any(|(name, _)| *name == FIRST);
    if !is_first_there || !(2..=ZMotors::FURTHER + 1).contains(&motors.len()) {
        table.refuse("motors", format!("z, and 1 to {} others", ZMotors::FURTHER));
    }
    // The table's order is the motors'; that of an axis is the first of them.
    let first = motors.iter().position(|(name, _)| *name == FIRST).unwrap_or_default();
    places_mm.get_mut(..=first).unwrap_or_default().rotate_right(1);
    let points_mm = points(&table, reach_mm, safe, is_measured);
    let alignment = alignment(&table, &places_mm, &points_mm, correction);
    // A profile is leaked: its parts are `'static`.
    Some(Kept(Box::leak(Box::new(ZMotors { further, alignment }))))
}

/// The places where the probe measures the heights of the motors.
fn points(table: &Section<'_>, reach_mm: &[[f64; 2]; 2], safe: &SafeHoming, is_measured: bool) -> Vec<[f64; 2]> {
    let places = table.named_sections(
        "points",
        "NAME",
        "no alignment",
        "with a probe: probe positions, at least one per motor and at most 8, far apart",
        "a position of this name",
    );
    let mut points_mm = Vec::new();
    for (name, section) in &places {
        let place_mm = ["x", "y"]
            .map(|axis| section.number(axis, PLACE).required("probe position, within what the probe reaches"));
        for (axis, (place, [least, most])) in ["x", "y"].into_iter().zip(place_mm.into_iter().zip(*reach_mm)) {
            if is_measured && !(least..=most).contains(&place) {
                section.refuse(axis, format!("{least} to {most} mm: the probe does not reach it"));
            }
        }
        if is_measured && !safe.is_above_bed(place_mm.map(units_10nm)) {
            section.refuse("x", "a place on the round bed (homing.bed_mm)");
        }
        check_name(table, &format!("points.{name}"), name, MAX_NAME);
        points_mm.push(place_mm);
    }
    if !is_measured && !points_mm.is_empty() {
        table.refuse("points", "no such table without homing.z.sensor = \"probe\"");
    }
    points_mm
}

/// Alignment of the motors; `None` without points, or with a fault.
fn alignment(
    table: &Section<'_>,
    places_mm: &[[Option<f64>; 2]],
    points_mm: &[[f64; 2]],
    correction_mm: f64,
) -> Option<ZAlignment> {
    if points_mm.is_empty() {
        return None;
    }
    let motors = places_mm.len();
    if !(motors..=ZAlignment::MAX_POINTS).contains(&points_mm.len()) {
        table.refuse("points", format!("{motors} to {} places for {motors} motors", ZAlignment::MAX_POINTS));
        return None;
    }
    let places: Option<Vec<[f64; 2]>> = places_mm.iter().map(|[x, y]| Some([(*x)?, (*y)?])).collect();
    let Some(places) = places else {
        table.refuse("motors", "x and y of each motor, as points are given");
        return None;
    };
    let shape = Shape::of(&places).filter(|shape| shape.weights(&places, &places).is_some());
    let Some(shape) = shape else {
        let expected = match motors {
            2 => "two motors in different places",
            3 => "three motors that are not on one line",
            _ => "four motors at the corners of a frame along X and Y",
        };
        table.refuse("motors", expected);
        return None;
    };
    let weights = shape.weights(points_mm, &places);
    let lever = |weights: &Vec<Vec<f64>>| {
        weights.iter().map(|row| row.iter().map(|weight| weight.abs()).sum::<f64>()).fold(0.0, f64::max)
    };
    let Some(weights) = weights.filter(|weights| lever(weights) <= MAX_LEVER) else {
        let expected = format!(
            "places that are farther apart, in each direction in which the motors are: an error of the probe would be more than \
             {MAX_LEVER} times as large at a motor"
        );
        table.refuse("points", expected);
        return None;
    };
    let mut alignment = ZAlignment {
        places_10nm: [[0; 2]; ZMotors::FURTHER + 1],
        points_10nm: [None; ZAlignment::MAX_POINTS],
        weights: [[0.0; ZAlignment::MAX_POINTS]; ZMotors::FURTHER + 1],
        max_correction_10nm: units_10nm(correction_mm),
    };
    for (kept, place) in alignment.places_10nm.iter_mut().zip(&places) {
        *kept = place.map(units_10nm);
    }
    for (kept, point) in alignment.points_10nm.iter_mut().zip(points_mm) {
        *kept = Some(point.map(units_10nm));
    }
    for (row, weights) in alignment.weights.iter_mut().zip(&weights) {
        for (kept, weight) in row.iter_mut().zip(weights) {
            *kept = *weight as f32;
        }
    }
    Some(alignment)
}

/// The weights with which the heights of Z's motors, at these places, make that of another place;
/// lengths in units of 10 nm. `None` for places that no profile may have.
pub fn heights_by_motors(motors_10nm: &[[i64; 2]], place_10nm: [i64; 2]) -> Option<Vec<f64>> {
    let mm = |place: [i64; 2]| place.map(|length| length as f64 / 100_000.0);
    let motors_mm: Vec<[f64; 2]> = motors_10nm.iter().map(|place| mm(*place)).collect();
    Shape::of(&motors_mm)?.weights(&motors_mm, &[mm(place_10nm)])?.pop()
}

/// Shape of the surface between the motors. Two motors lift a line, and leave what is across it
/// alone. Three lift a plane. Four at the corners of a frame lift its sides, which are straight,
/// and between them each line along X is straight, and each along Y.
struct Shape {
    motors: usize,
    /// Middle of the motors, and how far apart they are: numbers near 1 keep the sums exact.
    middle_mm: [f64; 2],
    size_mm: f64,
    /// Two motors: the direction from one to the other.
    along: [f64; 2],
}

impl Shape {
    fn of(places_mm: &[[f64; 2]]) -> Option<Self> {
        let motors = places_mm.len();
        let mean = |axis: usize| places_mm.iter().map(|place| place[axis]).sum::<f64>() / motors.max(1) as f64;
        let middle_mm = [mean(0), mean(1)];
        let away = |place: &[f64; 2]| (place[0] - middle_mm[0]).hypot(place[1] - middle_mm[1]);
        let size_mm = places_mm.iter().map(away).fold(0.0, f64::max);
        let (from, to) = (places_mm.first()?, places_mm.get(1)?);
        let length = (to[0] - from[0]).hypot(to[1] - from[1]);
        (size_mm > 1.0 && length > 1.0).then(|| Self {
            motors,
            middle_mm,
            size_mm,
            along: [(to[0] - from[0]) / length, (to[1] - from[1]) / length],
        })
    }

    /// The terms whose sum is the height at a place: one for each motor.
    fn parts(&self, place_mm: [f64; 2]) -> Vec<f64> {
        let [x, y] = [0, 1].map(|axis| (place_mm[axis] - self.middle_mm[axis]) / self.size_mm);
        match self.motors {
            2 => vec![1.0, x * self.along[0] + y * self.along[1]],
            3 => vec![1.0, x, y],
            _ => vec![1.0, x, y, x * y],
        }
    }

    /// Weights of the heights at the points for the height at each motor's place: those of the
    /// surface of this shape that is nearest to the heights (least squares). `None` if the points
    /// do not determine one.
    fn weights(&self, points_mm: &[[f64; 2]], places_mm: &[[f64; 2]]) -> Option<Vec<Vec<f64>>> {
        let rows: Vec<Vec<f64>> = points_mm.iter().map(|point| self.parts(*point)).collect();
        // The normal equations, each point's height a column of their right side.
        let equations = (0..self.motors).map(|row| {
            let left = (0..self.motors).map(|column| rows.iter().map(|parts| parts[row] * parts[column]).sum());
            left.chain(rows.iter().map(|parts| parts[row])).collect()
        });
        let solved = solve(equations.collect())?;
        let at = |place: &[f64; 2]| {
            let parts = self.parts(*place);
            let weight =
                |point: usize| parts.iter().zip(&solved).map(|(part, row)| part * row[self.motors + point]).sum();
            (0..points_mm.len()).map(weight).collect()
        };
        Some(places_mm.iter().map(at).collect())
    }
}

/// Solves linear equations, one a row, for all columns after the square (Gauss and Jordan, with the
/// largest pivot); `None` if they do not have one solution.
fn solve(mut rows: Vec<Vec<f64>>) -> Option<Vec<Vec<f64>>> {
    for column in 0..rows.len() {
        let pivot = (column..rows.len()).max_by(|&a, &b| rows[a][column].abs().total_cmp(&rows[b][column].abs()))?;
        if rows[pivot][column].abs() < 1e-6 {
            return None;
        }
        rows.swap(column, pivot);
        let scale = rows[column][column];
        let pivot_row: Vec<f64> = rows[column].iter().map(|value| value / scale).collect();
        for (index, row) in rows.iter_mut().enumerate() {
            let factor = row[column];
            for (value, pivot) in row.iter_mut().zip(&pivot_row) {
                *value = if index == column { *pivot } else { *value - factor * pivot };
            }
        }
    }
    Some(rows)
}
