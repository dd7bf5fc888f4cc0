//! Distance between Z and beds that are bent.

use ferrostep_planner::surface::{MeshGrid, MeshInterpolation};
use ferrostep_planner::{Kinematics, Move};

use crate::surface::machine::{MM, Machine, Z};
use crate::surface::meshes::mesh_between;

/// A bed that is bent like a wave: the largest distance between it and the surface that Z follows,
/// mm, by the motors' steps on rows of moves over all of the mesh.
fn gap_mm(interpolation: MeshInterpolation, points: u8, bed_mm: impl Fn([f64; 2]) -> f64) -> f64 {
    let machine = Machine::new(Kinematics::Cartesian);
    let grid = MeshGrid::over([[2_000_000, 12_000_000]; 2], [points; 2]).unwrap();
    let places = (0..points).flat_map(|row| (0..points).map(move |column| [column, row]));
    let heights_um: Vec<_> = places
        .map(|point| (bed_mm(grid.place_10nm(point).map(|units| f64::from(units) / MM as f64)) * 1000.0).round() as i16)
        .collect();
    let mesh = mesh_between(interpolation, [points; 2], &heights_um, 0);
    let start = machine.start(&mesh);
    let mut moves = Vec::new();
    for row in 0..=20 {
        let (y, x) = ((20 + row * 5) * MM, if row % 2 == 0 { 120 * MM } else { 20 * MM });
        let from_x = 140 * MM - x;
        for target_10nm in [[from_x, y, start[2]], [x, y, start[2]]] {
            moves.push(Move { target_10nm, filament_100pm: 0, feed_mm_per_s: 100.0, line: 1, ends_move: true });
        }
    }
    let followed = machine.run(start, &moves, Some(&mesh), true);
    let mut place = machine.geometry().motor_steps(start).map(i64::from);
    let plan_z = place[2];
    place[2] = followed.ledger.motor_steps()[2];
    for (_, axes, directions) in &followed.seen.0 {
        place[2] -= if axes & Z == 0 {
            0
        } else if directions & Z == 0 {
            1
        } else {
            -1
        };
    }
    let mut most: f64 = 0.0;
    for (_, axes, directions) in &followed.seen.0 {
        for (motor, steps) in place.iter_mut().enumerate() {
            if axes >> motor & 1 == 1 {
                *steps += if directions >> motor & 1 == 0 { 1 } else { -1 };
            }
        }
        let [x, y] = machine.place(place);
        if (20.0..=120.0).contains(&x) && (20.0..=120.0).contains(&y) {
            most = most.max(((place[2] - plan_z) as f64 / 400.0 - bed_mm([x, y])).abs());
        }
    }
    most
}

/// Curves leave a smaller gap on bent beds than straight lines between the same points.
#[test]
fn curves_fit_a_bent_bed_better() {
    use MeshInterpolation::{Bicubic, Bilinear};
    type Bed = fn([f64; 2]) -> f64;
    let bowl: Bed = |[x, y]| 0.5 * (((x - 70.0) / 50.0).powi(2) + ((y - 70.0) / 50.0).powi(2)) - 0.4;
    let wave: Bed = |[x, y]| 0.3 * (x / 25.0).sin() + 0.2 * (y / 30.0).cos();
    let saddle: Bed = |[x, y]| (x - 70.0) * (y - 60.0) / 5000.0 + 0.2 * (x / 40.0).sin();
    for (name, bed, points, share) in [
        ("bowl", bowl, 4, 0.1),
        ("bowl", bowl, 5, 0.15),
        ("wave", wave, 5, 0.5),
        ("wave", wave, 7, 0.4),
        ("saddle", saddle, 4, 0.5),
    ] {
        let [straight, curved] = [Bilinear, Bicubic].map(|between| gap_mm(between, points, bed));
        println!("{name}, {points} by {points} points: {straight:.4} mm bilinear, {curved:.4} mm bicubic");
        // Z keeps within 3/4 of a step of 2.5 um.
        assert!(curved < 0.003 + share * straight, "{name}, {points}: {straight} mm, {curved} mm");
    }
}
