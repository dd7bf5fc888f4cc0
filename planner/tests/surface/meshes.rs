//! Meshes and paths to try, and meshes that are refused.

use ferrostep_planner::surface::{Bed, BedStage, Mesh, MeshError, MeshGrid, MeshInterpolation};
use ferrostep_planner::{Kinematics, Move};
use proptest::prelude::*;

use crate::surface::machine::{MM, Machine, START};

/// A mesh with these heights, row by row, um, from 20 mm to 120 mm.
pub fn mesh_of(points: [u8; 2], heights_um: &[i16], fade_10nm: i32) -> Mesh {
    mesh_between(MeshInterpolation::Bilinear, points, heights_um, fade_10nm)
}

pub fn mesh_between(interpolation: MeshInterpolation, points: [u8; 2], heights_um: &[i16], fade_10nm: i32) -> Mesh {
    let mut mesh = Mesh::NONE;
    mesh.begin(&MeshGrid::over([[2_000_000, 12_000_000]; 2], points).unwrap(), interpolation);
    let places = (0..points[1]).flat_map(|row| (0..points[0]).map(move |column| [column, row]));
    for (place, height) in places.zip(heights_um.iter().cycle()) {
        assert!(mesh.set_height_um(place, *height));
    }
    mesh.set_fade_10nm(fade_10nm);
    mesh
}

pub fn any_mesh() -> impl Strategy<Value = Mesh> {
    let points = [2u8..7, 2u8..7];
    let fade = prop_oneof![Just(0i32), 200_000i32..1_500_000];
    let between = prop_oneof![Just(MeshInterpolation::Bilinear), Just(MeshInterpolation::Bicubic)];
    (between, points, proptest::collection::vec(-150i16..150, 36), fade).prop_map(|(between, points, heights, fade)| {
        // Curves through such heights, and their continuations beyond them, are steeper
        // than straight lines.
        let share = if between == MeshInterpolation::Bicubic { 4 } else { 1 };
        let heights: Vec<_> = heights.into_iter().map(|height| height / share).collect();
        mesh_between(between, points, &heights, fade)
    })
}

/// Paths within 0 and 140 mm, beyond the mesh too; now and then Z moves, alone or along, and
/// the filament alone.
pub fn any_path() -> impl Strategy<Value = Vec<Move>> {
    let length = prop_oneof![1 => -200i64..200, 3 => -3 * MM..3 * MM, 2 => -60 * MM..60 * MM];
    let step = (length.clone(), length, -MM..MM);
    let kind = 0u8..10;
    let feed = prop_oneof![Just(10f32), Just(60.0), Just(250.0)];
    proptest::collection::vec((step, kind, feed, 0i64..3_000_000), 3..25).prop_map(|moves| {
        let mut target_10nm = START;
        let mut line = 0;
        let made = moves.into_iter().map(|((x, y, z), kind, feed_mm_per_s, filament_100pm)| {
            let moves_xy = kind < 8;
            if moves_xy {
                target_10nm[0] = (target_10nm[0] + x).clamp(0, 140 * MM);
                target_10nm[1] = (target_10nm[1] + y).clamp(0, 140 * MM);
            }
            if (7..9).contains(&kind) {
                target_10nm[2] = (target_10nm[2] + z).clamp(0, 20 * MM);
            }
            line += 1;
            let filament_100pm = if kind % 2 == 0 { filament_100pm } else { 0 };
            Move { target_10nm, filament_100pm, feed_mm_per_s, line, ends_move: true }
        });
        made.collect()
    })
}

#[test]
fn meshes_that_z_cannot_follow() {
    let machine = Machine::new(Kinematics::Cartesian);
    let switched = |machine: &Machine, mesh: &Mesh| {
        let mut stage = BedStage::new(&machine.geometry());
        *stage.mesh().unwrap() = mesh.clone();
        stage.switch(true)
    };
    assert_eq!(switched(&machine, &Mesh::NONE), Err(MeshError::Incomplete));
    let mut incomplete = Mesh::NONE;
    incomplete.begin(&MeshGrid::over([[0, 1_000_000]; 2], [2, 2]).unwrap(), MeshInterpolation::Bicubic);
    assert!((0..3).all(|index| incomplete.set_height_um([index % 2, index / 2], 0)));
    assert_eq!(switched(&machine, &incomplete), Err(MeshError::Incomplete));
    assert!(!incomplete.set_height_um([2, 0], 0));
    // 6 mm over 100 mm.
    let steep = mesh_of([2, 2], &[0, 6_000, 0, 6_000], 0);
    assert!(
        matches!(switched(&machine, &steep), Err(MeshError::TooSteep { slope, .. }) if (slope - 0.06).abs() < 1e-4)
    );
    let uneven = mesh_of([2, 2], &[0, 500, 0, 500], 199_000);
    assert_eq!(switched(&machine, &uneven), Err(MeshError::FadesTooSoon { least_10nm: 200_000 }));
    // Steep enough for Z's step rate: 0.2 mm of Z for 1 mm of X and Y.
    let fine = Machine { steps_per_mm: [20.0, 20.0, 3200.0], ..machine };
    assert!(
        matches!(switched(&fine, &mesh_of([2, 2], &[0, 500, 0, 500], 0)), Err(MeshError::TooSteep { maximum, .. }) if maximum < 0.004)
    );
    let shared = Machine { kinematics: Kinematics::CoreXz, ..machine };
    assert_eq!(switched(&shared, &mesh_of([2, 2], &[0], 0)), Err(MeshError::SharedMotor));
    for points in [[1, 2], [2, 16], [0, 0]] {
        assert_eq!(MeshGrid::over([[0, 1_000_000]; 2], points), None, "{points:?}");
    }
    assert_eq!(MeshGrid::over([[0, 1_000_000], [5, 5]], [2, 2]), None);
}
