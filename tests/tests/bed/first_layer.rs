//! A first layer on a sheet that is tilted and bent by 1 mm.

use std::io::Read;

use super::rig::{Done, profile, run, sheet_mm};
use ferrostep_printer::Profile;

/// A sheet of 200 mm that rises by 1 mm to the right, falls by 0.6 mm to the back, and whose middle
/// is 1 mm above its corners.
const SHEET: &str = "[mesh.sheet]\ntilt_mm = { x = 1, y = -0.6 }\nbend_mm = 1\n";

fn bent(points: u8) -> Profile {
    profile(&format!("[mesh]\npoints = {{ x = {points}, y = {points} }}\nfade_mm = 0\ndepth_mm = 2\n{SHEET}"))
}

/// Smallest and largest gap between nozzle and sheet at the steps of the extruder after
/// `from_tick`, mm.
fn gaps(profile: &Profile, done: &Done, from_tick: u64) -> [f64; 2] {
    let pushed = done.steps.iter().filter(|step| step.pushes && step.tick > from_tick);
    let gap = |[x, y, z]: [f64; 3]| z - sheet_mm(profile, [x, y]);
    let mut count = 0;
    let ends = pushed.map(|step| gap(step.place_mm)).fold([f64::INFINITY, -f64::INFINITY], |[least, most], gap| {
        count += 1;
        [least.min(gap), most.max(gap)]
    });
    assert!(count > 2_000, "{count} steps of the extruder");
    ends
}

/// The lines of the first layer of a sliced file, as the slicer has written them: without those
/// that heat and home, and without the moves before its first line.
fn first_layer(name: &str) -> Vec<String> {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples").join(name);
    let mut text = String::new();
    flate2::read::GzDecoder::new(std::fs::File::open(path).unwrap()).read_to_string(&mut text).unwrap();
    let layer: Vec<_> = text.split(";LAYER_CHANGE").nth(1).unwrap().lines().map(str::to_owned).collect();
    assert!(layer.len() > 200, "{name}: {} lines", layer.len());
    layer
}

/// The whole first layer of a real file, over all of the bed that it covers.
#[test]
fn the_gap_is_as_asked_over_a_whole_first_layer() {
    let machine = bent(11);
    let layer = first_layer("four-cubes-labelled.gcode.gz");
    let mut lines = vec!["G28", "G29", "M302 P1", "M83", "G90"];
    lines.extend(layer.iter().map(String::as_str));
    let done = run(&machine, lines).well();
    let z_mm = done.logical_mm[2];
    let [least, most] = gaps(&machine, &done, 0);
    println!("asked for {z_mm} mm, gap {least:.4} to {most:.4} mm");
    assert!((0.15..0.35).contains(&z_mm), "{z_mm}");
    assert!(least > z_mm - 0.02 && most < z_mm + 0.02, "asked for {z_mm} mm, gap {least:.4} to {most:.4} mm");
    // Without the mesh the same layer is partly in the sheet, partly in the air.
    let mut lines = vec!["G28", "M302 P1", "M83", "G90"];
    lines.extend(layer.iter().map(String::as_str));
    let [least, most] = gaps(&machine, &run(&machine, lines).well(), 0);
    assert!(most - least > 0.1, "{least} to {most}");
}

/// The test goes to and fro over all that the nozzle reaches, the corners included.
#[test]
fn the_gap_is_as_asked_from_edge_to_edge() {
    let machine = bent(11);
    let mut lines: Vec<String> = ["G28", "G29", "M302 P1", "M83", "G1 X0 Y0 Z0.2 F6000"].map(str::to_owned).into();
    for row in 0..21 {
        let (y, x) = (row * 10, if row % 2 == 0 { 200 } else { 0 });
        lines.push(format!("G1 Y{y} E0.1 F6000"));
        lines.push(format!("G1 X{x} E10"));
    }
    let done = run(&machine, lines.iter().map(String::as_str)).well();
    let [least, most] = gaps(&machine, &done, 0);
    println!("asked for 0.2 mm, gap {least:.4} to {most:.4} mm");
    assert!(least > 0.18 && most < 0.22, "gap {least:.4} to {most:.4} mm");
}

/// A coarse mesh leaves the gap as far off as the sheet is from the straight lines between its
/// points: this shows that the test above would see an error.
#[test]
fn a_coarse_mesh_is_seen() {
    let machine = bent(3);
    let lines = ["G28", "G29", "M302 P1", "M83", "G1 X0 Y50 Z0.2 F6000", "G1 X200 E100"];
    let [least, most] = gaps(&machine, &run(&machine, lines).well(), 0);
    // 1 mm / (100 mm)^2 times (100 mm)^2 / 8.
    assert!(least < 0.2 && most - least > 0.1 && most < 0.2 + 0.26, "gap {least:.4} to {most:.4} mm");
}

/// Curves through four by four points on the bent sheet leave a tenth of the gap that straight
/// lines leave, over a whole first layer of a real file.
#[test]
fn curves_through_few_points_fit_the_sheet() {
    let layer = first_layer("four-cubes-labelled.gcode.gz");
    let mut lines = vec!["G28", "G29", "M302 P1", "M83", "G90"];
    lines.extend(layer.iter().map(String::as_str));
    let [straight, curved] = ["bilinear", "bicubic"].map(|interpolation| {
        let mesh = "points = { x = 4, y = 4 }\nfade_mm = 0\ndepth_mm = 2";
        let machine = profile(&format!("[mesh]\n{mesh}\ninterpolation = \"{interpolation}\"\n{SHEET}"));
        let done = run(&machine, lines.iter().copied()).well();
        let z_mm = done.logical_mm[2];
        let [least, most] = gaps(&machine, &done, 0);
        println!("{interpolation}: asked for {z_mm} mm, gap {least:.4} to {most:.4} mm");
        (least - z_mm).abs().max((most - z_mm).abs())
    });
    assert!(straight > 0.05 && curved < 0.012, "{straight} mm, {curved} mm");
}

/// X, Y and the extruder step when they would without the mesh, to the tick: Z's limits do not
/// bind on such a bed.
#[test]
fn x_y_and_the_extruder_keep_their_steps() {
    let machine = bent(11);
    let layer = first_layer("supports.gcode.gz");
    let steps = |on: &str| {
        let mut lines =
            vec!["G28", "G29", "M420 S0", "G1 X100 Y100 Z5 F6000", "M302 P1", "M83", "G90", on, "G1 Z5", "M400", "M17"];
        lines.extend(layer.iter().map(String::as_str));
        let done = run(&machine, lines).well();
        // Steps from the first push of the layer on, whose tick is 0.
        let start = done.steps.iter().position(|step| step.pushes).unwrap();
        let tick = done.steps[start].tick;
        let rest = done.steps[start..]
            .iter()
            .map(move |step| (step.tick - tick, step.axes & 0b1011, step.directions & 0b1011));
        rest.filter(|step| step.1 != 0).collect::<Vec<_>>()
    };
    let (with, without) = (steps("M420 S1"), steps("M420 S0"));
    assert!(with.len() > 20_000, "{}", with.len());
    assert!(with == without, "{} and {} steps", with.len(), without.len());
}
