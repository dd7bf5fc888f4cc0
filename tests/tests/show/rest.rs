//! The rest of a job that stops: what its lines ask for, beside what was executed.

use ferrostep_show::{Kind, Node, Recording};
use ferrostep_testkit::shown::prints::shown;

use crate::show::pages::job;

const BEGINNING: &str = "G28\nM302 P1\nM83\nG92 X0\n;LAYER_CHANGE\nG1 Z.2 F600\nG1 X50 Y20 F3000\nG1 X90 E1\n";

fn recorded(text: &str, max_nodes: usize) -> Recording {
    shown(&job(text).path().join("job.gcode"), "cartesian", max_nodes).recording
}

fn rest(recording: &Recording) -> Vec<(u32, Kind, [f32; 3], u32)> {
    let nodes = recording.nodes.iter().filter(|node| node.is_rest);
    nodes
        .map(|node| (node.line, node.kind, node.position_mm.map(|mm| (mm * 100.0).round() / 100.0), node.layer))
        .collect()
}

#[test]
fn the_rest_of_a_job_lies_where_its_lines_ask_for_and_counts_in_nothing() {
    // Below the refused line one that is too long.
    let damaged = "G1 X1 Y1 ".repeat(100);
    let stopped = format!(
        "{BEGINNING}G1 X10 Q\"<b>\nG1 Y60 E1\n;LAYER_CHANGE\nG91\nG0 Z.2\n{damaged}\nG90\nM83\nG1 X50 E1\nG2 X70 Y60 I10 J0\n"
    );
    let folder = job(&stopped);
    let with = shown(&folder.path().join("job.gcode"), "cartesian", usize::MAX);
    let folder = job(BEGINNING);
    let without = shown(&folder.path().join("job.gcode"), "cartesian", usize::MAX);
    assert!(with.stopped.is_some() && without.stopped.is_none());
    let first = &with.findings()[0];
    assert_eq!((first.weight, first.line), ("stop", Some(9)));

    let found = rest(&with.recording);
    let straight: Vec<_> = found.iter().filter(|(line, ..)| *line < 18).copied().collect();
    assert_eq!(
        straight,
        [
            (9, Kind::Travel, [10.0, 20.0, 0.2], 0),
            (10, Kind::Print, [10.0, 60.0, 0.2], 0),
            (13, Kind::Travel, [10.0, 60.0, 0.4], 1),
            (17, Kind::Print, [50.0, 60.0, 0.4], 1),
        ]
    );
    let arc = &found[straight.len()..];
    assert!(arc.len() > 20, "{arc:?}");
    assert!(arc.iter().all(|(_, _, [x, y, _], _)| ((x - 60.0).hypot(y - 60.0) - 10.0).abs() < 0.02 && *y >= 59.9));

    let executed =
        |recording: &Recording| -> Vec<Node> { recording.nodes.iter().copied().filter(|node| !node.is_rest).collect() };
    assert_eq!(executed(&with.recording), executed(&without.recording));
    assert_eq!(
        serde_json::to_value(&with.recording.totals).unwrap(),
        serde_json::to_value(&without.recording.totals).unwrap()
    );
    assert_eq!((with.moves, with.filament_mm), (without.moves, without.filament_mm));
    assert_eq!(with.figures.print_time_s, without.figures.print_time_s);
    // The G-code window has all of the file.
    assert!(with.text.kept.ends_with(b"I10 J0\n"));
}

#[test]
fn a_rest_of_any_length_fits_into_the_page() {
    let mut text = format!("{BEGINNING}G1 X10 Q\"\n");
    for layer in 0..20 {
        text += &format!(";LAYER_CHANGE\nG1 Z{:.1}\n", 0.4 + 0.2 * f64::from(layer));
        for line in 0..1000 {
            text += &format!("G1 X{} Y{:.2} E.1\n", 40 + line % 2 * 20, 50.0 + f64::from(line) * 0.04);
        }
    }
    let recording = recorded(&text, 2000);
    assert!(recording.nodes.len() <= 2000 && recording.left_out > 10_000, "{}", recording.left_out);
    // Every layer has its part.
    for layer in 1..=20 {
        let count = recording.nodes.iter().filter(|node| node.is_rest && node.layer == layer).count();
        assert!((30..300).contains(&count), "layer {layer}: {count} nodes");
    }
    assert_eq!(recorded(&text, usize::MAX).left_out, 0);
    // Even where there is no room at all.
    assert!(recorded(&text, 0).nodes.len() <= 16);
}

/// A job that stops before anything is printed asks for all of its part.
#[test]
fn a_job_that_stops_at_its_first_line_asks_for_its_part() {
    let part = "G28\nM302 P1\nM83\nG1 Z.2 F600\nG1 X50 Y20 F3000\nG1 X90 E1\n";
    let recording = recorded(&format!("G1 X1 Q\"\n{part}"), usize::MAX);
    let printed: Vec<_> = rest(&recording).into_iter().filter(|(_, kind, ..)| *kind == Kind::Print).collect();
    assert_eq!(printed, [(7, Kind::Print, [90.0, 20.0, 0.2], 0)]);
    let whole = recorded(part, usize::MAX);
    assert!(rest(&whole).is_empty());
}

/// A place five metres off is drawn, one a thousand kilometres off is damage.
#[test]
fn far_places_are_asked_for() {
    let text = format!("{BEGINNING}G1 X5000 Q\"\nG1 X5000 Y-5000 E1\nG1 X999999999\n");
    let far = rest(&recorded(&text, usize::MAX));
    assert_eq!(far[1..], [(10, Kind::Print, [5000.0, -5000.0, 0.2], 0)]);
}
