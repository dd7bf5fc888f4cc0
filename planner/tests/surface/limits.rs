//! Z keeps its limits.

use ferrostep_planner::{Kinematics, Move, TICKS_PER_SECOND};

use crate::surface::machine::{MM, Machine, START, Sink, Z, without_z};
use crate::surface::meshes::mesh_of;

/// Z's steps: when, and by which sign.
fn z_steps(sink: &Sink) -> Vec<(f64, f64)> {
    let second = f64::from(TICKS_PER_SECOND);
    let of_z = sink.seen.0.iter().filter(|(_, axes, _)| axes & Z != 0);
    of_z.map(|(tick, _, back)| (*tick as f64 / second, if back & Z == 0 { 1.0 } else { -1.0 })).collect()
}

/// Greatest speed and acceleration of Z, mm/s and mm/s^2, by its steps, over windows of `window`
/// steps on each side, all of one sign: the times of steps are rounded to those of other events,
/// which a shorter window would show.
fn fastest(steps: &[(f64, f64)], window: usize, steps_per_mm: f64) -> (f64, f64) {
    let mut most = (0.0f64, 0.0f64);
    for part in steps.windows(2 * window + 1) {
        if part.iter().any(|step| step.1 != part[0].1) {
            continue;
        }
        let [start, middle, end] = [0, window, 2 * window].map(|index| part[index].0);
        let speed = |time: f64| window as f64 / steps_per_mm / time;
        let (first, second) = (speed(middle - start), speed(end - middle));
        most.0 = most.0.max(first);
        most.1 = most.1.max((second - first).abs() / (0.5 * (end - start)));
    }
    most
}

/// A slope of 1 % at 10,000 mm/s^2, X and Y to and fro, and a Z that could not follow.
#[test]
fn z_keeps_its_limits_on_a_slope() {
    let mut machine = Machine::new(Kinematics::Cartesian);
    machine.limits.max_feed_mm_per_s[2] = 2.0;
    machine.limits.max_acceleration_mm_per_s2[2] = 6.0;
    // 1 mm over the 100 mm of the mesh.
    let mesh = mesh_of([2, 2], &[-500, 500, -500, 500], 0);
    let targets = [[120, 70], [20, 70], [120, 80], [70, 80]].map(|[x, y]| [x * MM, y * MM, MM / 5]);
    let path: Vec<Move> = (1..)
        .zip(targets)
        .map(|(line, target_10nm)| Move { target_10nm, filament_100pm: 0, feed_mm_per_s: 300.0, line, ends_move: true })
        .collect();
    let (speed, acceleration) = fastest(&z_steps(&machine.run(START, &path, Some(&mesh), true)), 30, 400.0);
    assert!((1.96..2.02).contains(&speed), "{speed} mm/s");
    assert!((5.7..6.3).contains(&acceleration), "{acceleration} mm/s^2");
    // Speed and acceleration would be 3 mm/s and 100 mm/s^2 without the bounds; these windows
    // see a part of that.
    let (speed, acceleration) = fastest(&z_steps(&machine.run(START, &path, Some(&mesh), false)), 30, 400.0);
    assert!(speed > 2.9 && acceleration > 20.0, "{speed} mm/s, {acceleration} mm/s^2");
    // A Z that is fast enough slows nothing down.
    let machine = Machine::new(Kinematics::Cartesian);
    let plain = machine.run(START, &path, None, true);
    assert_eq!(without_z(&machine.run(START, &path, Some(&mesh), true).seen.0), without_z(&plain.seen.0));
}

/// Z's speed changes at once over a ridge, by no more than it may at a corner.
#[test]
fn z_keeps_its_corner_velocity_over_a_ridge() {
    for (limit, most) in [(1.0, 1.03), (60.0, 9.1)] {
        let mut machine = Machine::new(Kinematics::Cartesian);
        machine.limits.instantaneous_corner_velocity_mm_per_s[2] = limit;
        // Up 1.5 % and down again.
        let mesh = mesh_of([3, 2], &[0, 750, 0, 0, 750, 0], 0);
        let start = [20 * MM, 70 * MM, MM / 5];
        let request = Move {
            target_10nm: [120 * MM, 70 * MM, MM / 5],
            filament_100pm: 0,
            feed_mm_per_s: 300.0,
            line: 1,
            ends_move: true,
        };
        let steps = z_steps(&machine.run(start, &[request], Some(&mesh), true));
        let turn = steps.iter().position(|step| step.1 < 0.0).unwrap();
        let speed = |part: &[(f64, f64)]| (part.len() - 1) as f64 / 400.0 / (part[part.len() - 1].0 - part[0].0);
        let jump = speed(&steps[turn - 41..turn]) + speed(&steps[turn..turn + 41]);
        assert!(jump <= most && jump >= 0.9 * most, "{jump} mm/s of {limit}");
    }
}

/// A surface that is twisted: Z accelerates at constant speed in the plane.
#[test]
fn z_keeps_its_acceleration_over_a_twist() {
    let mut machine = Machine::new(Kinematics::CoreXy);
    machine.limits.max_acceleration_mm_per_s2[2] = 12.0;
    let mesh = mesh_of([2, 2], &[600, -600, -600, 600], 0);
    let start = [22 * MM, 22 * MM, MM / 5];
    let target_10nm = [118 * MM, 118 * MM, MM / 5];
    let request = Move { target_10nm, filament_100pm: 0, feed_mm_per_s: 300.0, line: 1, ends_move: true };
    let (_, acceleration) = fastest(&z_steps(&machine.run(start, &[request], Some(&mesh), true)), 30, 400.0);
    assert!(acceleration < 12.6, "{acceleration} mm/s^2");
    let (_, acceleration) = fastest(&z_steps(&machine.run(start, &[request], Some(&mesh), false)), 30, 400.0);
    assert!(acceleration > 20.0, "{acceleration} mm/s^2");
}

/// A path along a contour line, of whose steps each goes a little up or down, turns Z hardly ever.
#[test]
fn a_contour_line_turns_z_once() {
    let machine = Machine::new(Kinematics::Cartesian);
    // The surface rises along X + Y by 0.4 % each.
    let mesh = mesh_of([2, 2], &[-400, 0, 0, 400], 0);
    let path: Vec<Move> = (1..=40)
        .map(|line| {
            // Each at another place between two steps of Z.
            let by = i64::from(line) * 11_000;
            let target_10nm =
                if line % 2 == 0 { [30 * MM + by, 110 * MM, MM / 5] } else { [110 * MM + by, 30 * MM, MM / 5] };
            Move { target_10nm, filament_100pm: 0, feed_mm_per_s: 100.0, line: line as u32, ends_move: true }
        })
        .collect();
    let steps = z_steps(&machine.run(START, &path, Some(&mesh), true));
    let turns = steps.windows(2).filter(|pair| pair[0].1 != pair[1].1).count();
    assert!(turns < 80, "{turns} turns in {} steps of 40 moves", steps.len());
}
