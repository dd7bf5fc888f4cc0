//! A round bed: only the circle is probed, and Z follows all of it.

use super::rig::{PROBE_MM, profile, round, run, sheet_mm};

const SHEET: &str = "[mesh]\npoints = { x = 7, y = 7 }\nfade_mm = 0\n[mesh.sheet]\ntilt_mm = { x = 0.6, y = -0.4 }\n";

fn radius_mm([x, y]: [f64; 2]) -> f64 {
    (x - 100.0).hypot(y - 100.0)
}

/// Places of the probe at which Z turned at the bed, mm.
fn probed_mm(done: &super::rig::Done) -> Vec<[f64; 2]> {
    let is_down = |step: &super::rig::Step| step.axes & 4 != 0 && step.directions & 4 != 0;
    let is_up = |step: &super::rig::Step| step.axes & 4 != 0 && step.directions & 4 == 0;
    let turns = done.steps.windows(2).filter(|steps| is_down(&steps[0]) && is_up(&steps[1]));
    turns.map(|steps| [0, 1].map(|axis| steps[0].place_mm[axis] + PROBE_MM[axis])).collect()
}

#[test]
fn only_the_circle_is_probed() {
    let [all, on_circle] = [profile(SHEET), round(SHEET)].map(|machine| {
        let done = run(&machine, ["G28", "G29"]).well();
        probed_mm(&done)
    });
    // A rectangle's corners are probed, which this test would see.
    assert!(all.iter().any(|place| radius_mm(*place) > 130.0), "{all:?}");
    // 29 of 7 by 7 points are on the circle, each is approached twice.
    assert!((50..=62).contains(&on_circle.len()), "{}", on_circle.len());
    assert!(on_circle.iter().all(|place| radius_mm(*place) < 100.02), "{on_circle:?}");
}

/// The surface at the rim is right, also in cells with a corner beside the bed.
#[test]
fn z_follows_up_to_the_rim() {
    let machine = round(SHEET);
    for degrees in (0..360).step_by(15) {
        let (sine, cosine) = f64::from(degrees).to_radians().sin_cos();
        let [x, y] = [100.0 + 99.0 * cosine, 100.0 + 99.0 * sine];
        let done = run(&machine, ["G28", "G29", &format!("G1 X{x:.3} Y{y:.3} Z1 F6000")]).well();
        let [x, y, z] = done.place_mm();
        let gap = z - sheet_mm(&machine, [x, y]);
        assert!((gap - 1.0).abs() < 0.008, "{degrees}: {gap}");
    }
}

#[test]
fn places_beside_the_bed_are_refused() {
    let machine = round(SHEET);
    for line in ["G30 X10 Y10", "G30 X180 Y190", "M48 X5 Y60"] {
        let done = run(&machine, ["G28", line]);
        assert_eq!(done.failures.len(), 1, "{line}: {:?}", done.failures);
        let says = done.failures[0].1.to_string();
        assert!(says.contains("off the round bed"), "{line}: {says}");
        assert!(run(&profile(SHEET), ["G28", line]).failures.is_empty(), "{line}");
    }
    run(&machine, ["G28", "G30 X30 Y35", "G30 X0 Y100"]).well();
    // A probe that would miss the bed where Z homes.
    let done = run(&machine, ["M851 X70 Y70"]);
    assert!(done.failures[0].1.to_string().contains("off the round bed"), "{:?}", done.failures);
}
