//! `show --rules` and `compare --rules`: the motion by another firmware's rules.

use std::path::Path;

use ferrostep_profiles::PlannedBy;
use ferrostep_show::{Kind, Node};
use ferrostep_testkit::program::{program, repository};
use ferrostep_testkit::shown::prints::shown_by;
use ferrostep_testkit::shown::{compare, errors, show};
use serde_json::Value;

use crate::show::pages::{description, job};

const FOREIGN: [PlannedBy; 4] =
    [PlannedBy::Klipper, PlannedBy::MarlinJunctionDeviation, PlannedBy::MarlinClassicJerk, PlannedBy::Rrf];

/// Time of the estimate of a file by these rules, s.
fn estimated_s(file: &Path, rules: &str) -> f64 {
    let output = std::process::Command::new(program())
        .arg("estimate")
        .arg(file)
        .args(["--rules", rules, "--json"])
        .output()
        .unwrap();
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
    summary["print_time_s"].as_f64().unwrap()
}

/// The page has the estimate's time, its limits, and as much path and filament as this
/// firmware's own page.
#[test]
fn a_page_has_the_times_of_the_estimate() {
    let cube = repository().join("examples/cube.gcode");
    let own = shown_by(PlannedBy::Own, &cube, "cartesian", usize::MAX);
    assert!(own.rules.is_none() && own.recording.nodes.iter().all(|node| node.limit == 0));
    for rules in FOREIGN {
        let print = shown_by(rules, &cube, "cartesian", usize::MAX);
        let (nodes, name) = (&print.recording.nodes, rules.name());
        assert!(nodes.windows(2).all(|pair| pair[0].time_s <= pair[1].time_s), "{name}");
        let time_s = nodes.last().unwrap().time_s;
        let expected = estimated_s(&cube, name);
        assert!((time_s - expected).abs() < 1e-3, "{name}: {time_s} s, expected {expected}");
        let [sums, own_sums] = [&print, &own].map(|print| print.recording.totals.kinds[Kind::Print as usize]);
        assert!((sums.path_mm / own_sums.path_mm - 1.0).abs() < 0.005, "{name}: {sums:?}, own {own_sums:?}");
        assert!((sums.volume_mm3 / own_sums.volume_mm3 - 1.0).abs() < 0.001, "{name}: {sums:?}, own {own_sums:?}");
        let said = print.rules.as_ref().unwrap();
        assert_eq!(said.name, name);
        let limited_s: f64 = said.times.iter().map(|limit| limit.seconds).sum();
        assert!((limited_s - print.figures.motion_time_s).abs() < 1e-6, "{name}: {limited_s} s");
        // Every part that moves has its limit, but homing.
        let unknown = |node: &&Node| node.limit == 0 && matches!(node.kind, Kind::Travel | Kind::Print | Kind::Retract);
        assert_eq!(nodes.iter().skip(1).find(unknown), None, "{name}");
        let asked = said.limits.iter().position(|limit| *limit == "asked speed").unwrap() + 1;
        for pair in nodes.windows(2).filter(|pair| usize::from(pair[1].limit) == asked && pair[1].kind.moves()) {
            let [before, node] = [pair[0], pair[1]];
            // A ramp may end in the speed that the next line asks for.
            let is_even = before.line == node.line && before.speed_mm_per_s == node.speed_mm_per_s;
            assert!(!is_even || (node.speed_mm_per_s - node.feed_mm_per_s).abs() < 1e-3, "{name}: {node:?}");
        }
    }
}

/// A move of 100 mm at 100 mm/s with 1000 mm/s^2: a ramp of 5 mm, and one back.
#[test]
fn a_move_is_drawn_in_its_three_phases() {
    let folder = job("G28\nG1 X100 F6000\n");
    for rules in FOREIGN {
        let output = show(folder.path(), ["job.gcode", "--rules", rules.name()]);
        assert!(output.status.success(), "{}", errors(&output));
        let page = std::fs::read_to_string(folder.path().join("job.html")).unwrap();
        let said = description(&page);
        assert_eq!(said["job"]["rules"]["name"], rules.name());
        assert_eq!(said["job"]["chances"], serde_json::json!([]));
        let path = folder.path().join("job.gcode");
        let print = shown_by(rules, &path, "cartesian", usize::MAX);
        let nodes = &print.recording.nodes;
        let last: Vec<&Node> = nodes.iter().filter(|node| node.line == 2).collect();
        let [ramp, cruise, end] = last[..] else { panic!("{last:?}") };
        let start_s = ramp.time_s - 0.1;
        for (node, x, speed, time_s) in [(ramp, 5.0, 100.0, 0.1), (cruise, 95.0, 100.0, 1.0), (end, 100.0, 0.0, 1.1)] {
            assert!((node.position_mm[0] - x).abs() < 0.1 && (node.speed_mm_per_s - speed).abs() < 1.0, "{node:?}");
            assert!((node.time_s - start_s - time_s).abs() < 2e-3, "{node:?}");
        }
        let limit = |node: &Node| print.rules.as_ref().unwrap().limits[usize::from(node.limit) - 1];
        assert_eq!(limit(cruise), "asked speed");
        assert!(limit(ramp).starts_with("acceleration") && limit(end).starts_with("acceleration"));
    }
}

/// Waits lie where they lie in the estimate, and after homing the path continues at its end.
#[test]
fn waits_and_homing_are_drawn() {
    let folder = job("M140 S50\nG28\nM190 S50\nG1 X50 F6000\nG4 P2500\nG1 Y30\n");
    let path = folder.path().join("job.gcode");
    let own = shown_by(PlannedBy::Own, &path, "cartesian", usize::MAX);
    for rules in FOREIGN {
        let print = shown_by(rules, &path, "cartesian", usize::MAX);
        for kind in [Kind::Homing, Kind::Heating, Kind::Wait] {
            let [time_s, own_s] = [&print, &own].map(|shown| shown.recording.totals.kinds[kind as usize].time_s);
            assert!((time_s - own_s).abs() < 0.05, "{}: {kind:?} {time_s} s, own {own_s}", rules.name());
        }
        let wait = print.recording.nodes.iter().find(|node| node.kind == Kind::Wait).unwrap();
        assert!((wait.position_mm[0] - 50.0).abs() < 1e-3, "{wait:?}");
    }
}

#[test]
fn two_prints_are_compared_by_rules() {
    let folder = job("G28\nG1 X100 F6000\nG1 X0\n");
    let arguments = ["job.gcode", "--set", "acceleration_mm_per_s2.print=500", "--rules", "klipper", "--json"];
    let output = compare(folder.path(), &arguments);
    assert!(output.status.success(), "{}", errors(&output));
    let said: Value = serde_json::from_slice(&output.stdout).unwrap();
    let time = |side: &str| said[side]["print_time_s"].as_f64().unwrap();
    // Two moves with two ramps each, of twice the time.
    assert!((time("b") - time("a") - 0.2).abs() < 2e-3, "{said:#}");
    assert_eq!(said["a"]["rules"], "klipper");
    assert_eq!(said["a"].get("max_deviation_mm"), None);
    let output = compare(folder.path(), &[&arguments[..], &["--frequency-x", "40"]].concat());
    assert_eq!(output.status.code(), Some(2));
    assert!(errors(&output).contains("--rules own"), "{}", errors(&output));
}
