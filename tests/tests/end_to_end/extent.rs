//! The extent of a file: where it extrudes, as its lines ask for it.

use serde_json::json;

use super::command::{directory, ferrostep, file};

#[test]
fn the_extent_is_that_of_the_extruding_moves_before_any_soft_limit() {
    let directory = directory();
    let hot = "M104 S210\nG28\nM109 S210\nM83\nG0 Z0.2 F3000\n";
    for (lines, extent) in [
        // Travel, priming on the spot and retraction have none.
        (
            "G0 X190 Y190\nG1 E1\nG1 X10 Y20\nG1 X50 Y30 E1\nG1 X5 E-1\nG0 Z9",
            json!({"x": [10.0, 50.0], "y": [20.0, 30.0], "z": [0.2, 0.2]}),
        ),
        // The next move begins where the one before was asked for.
        (
            "G0 X300 Y10\nM106 S1\nG1 X310 E1\nG1 X320 Z0.4 E1",
            json!({"x": [300.0, 320.0], "y": [10.0, 10.0], "z": [0.2, 0.4]}),
        ),
        // An arc reaches farther than its ends.
        ("G0 X40 Y50\nG3 X60 Y50 I10 E2", json!({"x": [40.0, 60.0], "y": [40.0, 50.0], "z": [0.2, 0.2]})),
        // Other coordinates of the same place, and inches.
        ("G0 X10 Y10\nG92 X0\nG20\nG1 X1 E0.1", json!({"x": [10.0, 35.4], "y": [10.0, 10.0], "z": [0.2, 0.2]})),
        ("G0 X10\nG1 Y50", json!(null)),
    ] {
        let job = file(&directory, "job.gcode", format!("{hot}{lines}\nM104 S0\n"));
        for command in ["estimate", "print"] {
            let outcome = ferrostep([command.as_ref(), job.as_os_str(), "--json".as_ref()]);
            assert_eq!(outcome.json()["extent_mm"], extent, "{command} {lines}: {outcome:#?}");
        }
    }
    let job = file(&directory, "job.gcode", format!("{hot}G0 X10 Y20\nG1 X50 Y30 E1\nM104 S0\n"));
    let outcome = ferrostep(["estimate".as_ref(), job.as_os_str()]);
    assert!(
        outcome.stdout.contains("\n  extent       X 10.0 to 50.0, Y 20.0 to 30.0, Z 0.2 to 0.2 mm\n"),
        "{outcome:#?}"
    );
}
