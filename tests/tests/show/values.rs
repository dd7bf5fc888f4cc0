//! Checks that the page shows what the steps do.

use ferrostep_show::{Kind, Node};
use ferrostep_testkit::shown::prints::{ARCS, CUBE, GYROID, Print, WINDOW_S, shown};

/// Place and speed at a time, as the page takes them: speed changes evenly in time
/// between two nodes.
fn at(nodes: &[Node], time_s: f64) -> ([f64; 3], f64) {
    let index = nodes.partition_point(|node| node.time_s < time_s).clamp(1, nodes.len() - 1);
    let (before, node) = (&nodes[index - 1], &nodes[index]);
    let passed = (time_s - before.time_s) / (node.time_s - before.time_s);
    let (from, to) = (f64::from(before.speed_mm_per_s), f64::from(node.speed_mm_per_s));
    let share = passed * (from + (to - from) * passed / 2.0) / ((from + to) / 2.0);
    let mix = |axis: usize| {
        let [from, to] = [before, node].map(|node| f64::from(node.position_mm[axis]));
        from + (to - from) * share
    };
    ([mix(0), mix(1), mix(2)], from + (to - from) * passed)
}

fn check(print: Print) {
    let shown = print.shown(usize::MAX);
    assert!(shown.stopped.is_none());
    let nodes = &shown.recording.nodes;
    assert!(nodes.windows(2).all(|pair| pair[0].time_s <= pair[1].time_s));
    for place in print.ten_places().iter() {
        let of_line = |node: &&Node| node.line == place.line && node.kind.moves();
        let end = nodes.iter().rfind(of_line).unwrap_or_else(|| panic!("no node of line {}", place.line));
        let middle_s = end.time_s - place.to_end_s;
        let (position_mm, speed) = at(nodes, middle_s);
        for axis in 0..3 {
            let off = (position_mm[axis] - place.position_mm[axis]).abs();
            // Two steps, and 2 ms.
            assert!(
                off < 0.03 + 0.002 * speed,
                "line {}: {position_mm:?}, expected {:?}",
                place.line,
                place.position_mm
            );
        }
        // The middle of the window has more or less than its mean where speed rises or falls.
        let middles = [-0.75, -0.25, 0.25, 0.75].map(|part| at(nodes, middle_s + part * WINDOW_S).1);
        let mean = middles.iter().sum::<f64>() / 4.0;
        let off = (mean - place.speed_mm_per_s).abs();
        assert!(off < 2.5 + 0.05 * mean, "line {}: {mean} mm/s, expected {}", place.line, place.speed_mm_per_s);
        assert!((speed - mean).abs() < 3.0 + 0.2 * mean, "line {}: {speed} mm/s within {mean}", place.line);
        if end.kind == Kind::Print {
            let path_mm: f64 = nodes
                .windows(2)
                .filter(|pair| of_line(&&pair[1]))
                .map(|pair| {
                    let squares = (0..3).map(|axis| pair[1].position_mm[axis] - pair[0].position_mm[axis]);
                    f64::from(squares.map(|side| side * side).sum::<f32>()).sqrt()
                })
                .sum();
            let filament_mm = f64::from(end.bead) * path_mm / 2.405_28;
            let off = (filament_mm - place.filament_mm).abs();
            // A step of the extruder at either end.
            assert!(off < 0.024 + 0.01 * filament_mm, "line {}: {filament_mm} mm, expected {place:?}", place.line);
        }
    }
    // The path without filters is the one asked for, to a step and the height of a chord.
    let farthest = nodes.iter().map(|node| node.deviation_mm).fold(0.0, f32::max);
    assert!(farthest > 0.0 && farthest < 0.03, "{farthest} mm off the path");
    let time_s = nodes.last().unwrap().time_s;
    let off = (time_s - shown.figures.print_time_s).abs();
    assert!(off < 0.02, "{time_s} s, expected {}", shown.figures.print_time_s);
    let counted: f64 = shown.recording.totals.kinds.iter().map(|share| share.time_s).sum();
    assert!((counted - time_s).abs() < 1e-3, "{counted} s are counted of {time_s}");
}

#[test]
fn the_cube_is_shown_as_it_steps() {
    check(CUBE);
}

#[test]
fn the_gyroid_is_shown_as_it_steps() {
    check(GYROID);
}

#[test]
fn arcs_on_corexy_are_shown_as_they_step() {
    check(ARCS);
}

/// A filter cuts corners, and one of a low frequency more than steps round.
#[test]
fn a_filter_takes_the_path_off_the_one_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("square.gcode");
    let [without, with] = ["", "M593 F20\n"].map(|filter| {
        let square = "G1 X60 Y60 E1\nG1 X60 Y100 E1\nG1 X100 Y100 E1\nG1 X100 Y60 E1\n".repeat(5);
        std::fs::write(&file, format!("G28\nM302 P1\nM83\n{filter}G1 X100 Y60 Z1 F6000\n{square}")).unwrap();
        shown(&file, "cartesian", usize::MAX).recording.totals.greatest_deviation.value
    });
    assert!(without < 0.02 && (0.05..1.0).contains(&with), "{without} and {with} mm");
}

/// A page with fewer nodes has the same sums, and its speeds and flow still reach their extremes.
#[test]
fn a_reduced_page_keeps_sums_and_extremes() {
    let whole = CUBE.shown(usize::MAX).recording;
    let reduced = CUBE.shown(8000).recording;
    assert_eq!(whole.left_out, 0);
    assert!(reduced.nodes.len() <= 8000 && reduced.left_out > 10_000, "{}, {}", reduced.nodes.len(), reduced.left_out);
    assert_eq!(serde_json::to_value(&whole.totals).unwrap(), serde_json::to_value(&reduced.totals).unwrap());
    let most = |nodes: &[Node], kind: Kind, value: fn(&Node) -> f32| {
        nodes.iter().filter(|node| node.kind == kind).map(value).fold(0.0, f32::max)
    };
    for (kind, value) in [
        (Kind::Print, (|node| node.speed_mm_per_s) as fn(&Node) -> f32),
        (Kind::Travel, |node| node.speed_mm_per_s),
        (Kind::Print, Node::flow_mm3_per_s),
        (Kind::Print, |node| node.pressure_mm3),
    ] {
        let (of_all, of_few) = (most(&whole.nodes, kind, value), most(&reduced.nodes, kind, value));
        assert!((of_all - of_few).abs() <= 0.1 * of_all, "{kind:?}: {of_few}, expected {of_all}");
    }
    let end = |nodes: &[Node]| nodes.last().map(|node| (node.time_s, node.position_mm, node.line));
    assert_eq!(end(&whole.nodes), end(&reduced.nodes));
}

/// Parts that cannot be joined with their neighbours do not fill the memory either.
#[test]
fn any_number_of_retractions_fits() {
    let mut text = "G28\nM302 P1\nM83\n".to_owned();
    for number in 0..20_000 {
        text += if number % 2 == 0 { "G1 E-.5 F6000\n" } else { "G1 E.5\n" };
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("retractions.gcode");
    std::fs::write(&file, text).unwrap();
    let recording = shown(&file, "cartesian", 1000).recording;
    assert!(recording.nodes.len() <= 1000 && recording.left_out > 10_000);
    assert_eq!(recording.totals.retractions, 10_000);
}
