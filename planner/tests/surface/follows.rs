//! Z is at the surface, and the other motors do not change.

use ferrostep_planner::Kinematics;
use ferrostep_planner::surface::{Bed, BedStage, Mesh};
use proptest::prelude::*;

use crate::surface::machine::{Event, MM, Machine, Sink, Z, without_z};
use crate::surface::meshes::{any_mesh, any_path};
use crate::surface::reference::Surface;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// X, Y and the extruder keep their steps and times to the tick, and Z is at the
    /// surface at every event.
    #[test]
    fn only_z_changes_and_it_is_at_the_surface(
        mesh in any_mesh(), path in any_path(), core in any::<bool>(), shaped in any::<bool>(),
    ) {
        let mut machine = Machine::new(if core { Kinematics::CoreXy } else { Kinematics::Cartesian });
        machine.shaped = shaped;
        let start = machine.start(&mesh);
        let plain = machine.run(start, &path, None, true);
        let followed = machine.run(start, &path, Some(&mesh), true);
        prop_assert_eq!(followed.miscounts, 0);
        prop_assert_eq!(without_z(&followed.seen.0), without_z(&plain.seen.0));
        check_surface(&machine, &mesh, start, &plain.seen.0, &followed)?;
    }
}

/// Follows both runs by their events.
fn check_surface(
    machine: &Machine,
    mesh: &Mesh,
    start_10nm: [i64; 3],
    plain: &[Event],
    followed: &Sink,
) -> Result<(), TestCaseError> {
    let surface = Surface::new(mesh, machine);
    let mut plan = machine.geometry().motor_steps(start_10nm).map(i64::from);
    let mut issued = followed.ledger.motor_steps()[2];
    for (_, axes, directions) in &followed.seen.0 {
        if axes & Z != 0 {
            issued -= if directions & Z == 0 { 1 } else { -1 };
        }
    }
    // Initial position of Z's motor.
    let mut z = issued;
    let mut events = followed.seen.0.iter().peekable();
    // Three quarters of a step. Where the plan steps Z too, and events are so near to each other
    // that no step fits between, the next one makes the step: the surface is a little farther
    // away until then.
    const MOST: [f64; 2] = [0.75 + 0.01, 1.0];
    let mut before = 0;
    for (tick, axes, directions) in plain {
        for (motor, steps) in plan.iter_mut().enumerate() {
            if axes >> motor & 1 == 1 {
                *steps += if directions >> motor & 1 == 0 { 1 } else { -1 };
            }
        }
        while let Some((_, axes, directions)) = events.next_if(|event| event.0 <= *tick) {
            if axes & Z != 0 {
                z += if directions & Z == 0 { 1 } else { -1 };
            }
        }
        let z_mm = plan[2] as f64 / machine.steps_per_mm[2];
        let away = (z - plan[2]) as f64 - surface.height_steps(machine.place(plan), z_mm);
        let [most, near] = MOST;
        let most = if axes & Z != 0 && tick - before < 2 * 168 { near } else { most };
        before = *tick;
        prop_assert!(away.abs() <= most, "{} steps away at tick {} and {:?}", away, tick, plan);
    }
    Ok(())
}

proptest! {
    /// The surface is at the measured points where they were measured, whatever is between them;
    /// and never higher than it says.
    #[test]
    fn curves_pass_through_the_measured_points(mesh in any_mesh(), at in [0.0f64..1.0, 0.0..1.0]) {
        let machine = Machine::new(Kinematics::Cartesian);
        let geometry = machine.geometry();
        let mut stage = BedStage::new(&geometry);
        *stage.mesh().unwrap() = mesh.clone();
        stage.mesh().unwrap().set_fade_10nm(0);
        stage.switch(true).unwrap();
        let grid = mesh.grid();
        for row in 0..grid.points[1] {
            for column in 0..grid.points[0] {
                let [x, y] = grid.place_10nm([column, row]).map(i64::from);
                let height_um = mesh.height_um([column, row]).unwrap();
                let correction = stage.stand(geometry.motor_steps([x, y, 0]).map(i64::from), 0);
                let away = correction as f64 - f64::from(height_um) * 0.4;
                // Half a step, and what the surface rises in half a step of X and Y.
                prop_assert!(away.abs() <= 0.55, "{column} {row}: {away}");
            }
        }
        let highest = f64::from(stage.mesh().unwrap().highest_10nm()) / MM as f64;
        let surface = Surface::new(&mesh, &machine);
        let place = at.map(|share| -60.0 + 260.0 * share);
        prop_assert!(surface.height_mm(place) <= highest + 1e-9, "{} above {highest}", surface.height_mm(place));
    }
}
