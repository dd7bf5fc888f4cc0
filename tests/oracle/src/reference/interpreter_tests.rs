//! Meaning of each command, on small jobs.
#![allow(clippy::unwrap_used)]

use super::*;
use proptest::prelude::*;

fn with(gcode: &str, profile: &ReferenceProfile) -> Job {
    interpret(gcode.as_bytes(), profile, InterpretOptions::default()).unwrap()
}

fn job(gcode: &str) -> Job {
    with(gcode, &ReferenceProfile::cartesian())
}

/// Ends of all moves in 10 nm.
fn ends(gcode: &str) -> Vec<[i64; 3]> {
    job(gcode).moves.iter().map(|one| one.end_10nm).collect()
}

/// The extruder's totals after each move, in mm.
fn extruder(gcode: &str) -> Vec<f64> {
    job(gcode).moves.iter().map(|one| one.extruder_end as f64 / 1e7).collect()
}

const MM: i64 = UNITS_PER_MM;

#[test]
fn positions_are_absolute_or_relative_and_exact() {
    assert_eq!(
        ends("G28\nG1 X87.153 Y.2\nG91\nG0 X-7.153\nG90\nG1 Z1"),
        [[8_715_300, 20_000, 0], [80 * MM, 20_000, 0], [80 * MM, 20_000, MM]]
    );
}

#[test]
fn only_what_displaces_something_is_a_move() {
    let job = job("G28\nG1 F1200\nG1 X0 Y0\nG1\nG1 E0\nG1 X1\nG1 X1\nG1 E1\n");
    assert_eq!(job.move_count(), 2);
    assert_eq!(job.moves.iter().map(|one| one.line).collect::<Vec<_>>(), [6, 8]);
    assert_eq!(job.lines, 8);
}

#[test]
fn extruder_follows_its_own_mode_and_the_flow() {
    assert_eq!(extruder("M83\nG1 E1\nG1 E1\nM82\nG1 E5\nG1 E5.5"), [1.0, 2.0, 5.0, 5.5]);
    assert_eq!(extruder("G91\nG1 E1\nG90\nG1 E3\nG92 E0\nG1 E1"), [1.0, 3.0, 4.0]);
    assert_eq!(extruder("M83\nG1 E1\nM221 S50\nG1 E1\nM221 S95\nG1 E-1"), [1.0, 1.5, 0.55]);
    // 0.05511 mm at 95 % has seven fraction digits.
    let job = job("M83\nM221 S95\nG1 E.05511\n");
    assert_eq!(job.moves[0].extruder_end, 5511 * 95);
}

#[test]
fn feed_is_modal_and_scaled() {
    let feeds: Vec<f64> =
        job("G1 X1\nG1 X2 F600\nG1 X3\nM220 S50\nG1 X4\nM220 B\nM220 S200\nG1 X5\nM220 R\nG1 X6 F0\n")
            .moves
            .iter()
            .map(|one| one.feed_mm_per_s)
            .collect();
    assert_eq!(feeds, [25.0, 10.0, 10.0, 5.0, 20.0, 5.0]);
}

#[test]
fn inches_are_25_4_mm() {
    let job = job("G20\nG1 X1 F60\nG1 X.001\nG21\nG1 X1\n");
    let ends: Vec<i64> = job.moves.iter().map(|one| one.end_10nm[0]).collect();
    assert_eq!(ends, [2_540_000, 2540, MM]);
    assert_eq!(job.moves[0].feed_mm_per_s, 25.4);
}

#[test]
fn g92_moves_the_coordinates_and_not_the_machine() {
    assert_eq!(ends("G28\nG1 X10\nG92 X0\nG1 X5\nG28 X\nG1 X5"), [[10 * MM, 0, 0], [15 * MM, 0, 0], [5 * MM, 0, 0]]);
}

#[test]
fn homing_puts_axes_at_their_ends() {
    let job = with("G28\nG1 Y10\nG28 Y\nG1 X299\n", &ReferenceProfile::corexy());
    assert_eq!(job.moves[0].start_10nm, [300 * MM, 300 * MM, 0]);
    assert!(job.moves[0].homing_before && job.moves[0].stop_before);
    assert_eq!(job.moves[1].start_10nm, [300 * MM, 300 * MM, 0]);
    assert_eq!(job.moves[1].end_10nm, [299 * MM, 300 * MM, 0]);
    assert!(!job.homed_at_end);
    assert!(super::interpreter_tests::job("G1 X1\nG28\n").homed_at_end);
}

#[test]
fn homed_axes_are_clamped_in_machine_coordinates() {
    let job = job("G1 X-5\nG28 X\nG1 X-5\nG1 X300\nG92 X0\nG1 X-300\nG1 X1 Y-3\n");
    let ends: Vec<[i64; 3]> = job.moves.iter().map(|one| one.end_10nm).collect();
    assert_eq!(ends, [[-5 * MM, 0, 0], [200 * MM, 0, 0], [0, 0, 0], [200 * MM, -3 * MM, 0]]);
    // The third G1 stays where it is: clamped, counted, and no move.
    assert_eq!((job.clamped_moves, job.move_count()), (4, 4));
}

#[test]
fn firmware_retraction_leaves_no_record_and_knows_no_flow() {
    let job =
        job("G28\nM221 S50\nM207 S1 F1200 Z.5\nM208 S.25 F600\nG1 X10 F600\nG10\nG10\nG1 X20\nG11\nG11\nG1 X30\n");
    let kinds: Vec<bool> = job.moves.iter().map(|one| one.kind.ends_with_a_record()).collect();
    assert_eq!(kinds, [true, false, false, true, false, false, true]);
    let heights: Vec<i64> = job.moves.iter().map(|one| one.end_10nm[2]).collect();
    assert_eq!(heights, [0, 0, MM / 2, MM / 2, 0, 0, 0]);
    let totals: Vec<i128> = job.moves.iter().map(|one| one.extruder_end / 100).collect();
    assert_eq!(totals, [0, -100_000, -100_000, -100_000, -100_000, 25_000, 25_000]);
    let feeds: Vec<f64> = job.moves.iter().map(|one| one.feed_mm_per_s).collect();
    assert_eq!(feeds, [10.0, 20.0, 10.0, 10.0, 10.0, 10.0, 10.0]);
}

#[test]
fn limits_change_as_in_marlin() {
    let gcode =
        "G1 X1\nM201 X500 E900\nM203 Z5\nM204 P800 T700 R600\nM205 J.05 X8\nG1 X2\nM204 S400\nM205 J.5\nG1 X3\n";
    let job = job(gcode);
    let of = |index: usize| job.limits[job.moves[index].limits];
    let cartesian = ReferenceProfile::cartesian();
    assert_eq!(of(0).max_feed_mm_per_s, cartesian.max_feed_mm_per_s);
    assert_eq!(of(1).max_acceleration_mm_per_s2, [500.0, 1500.0, 100.0, 900.0]);
    assert_eq!(of(1).max_feed_mm_per_s, [200.0, 200.0, 5.0, 60.0]);
    assert_eq!(of(1).acceleration_mm_per_s2, Acceleration { print: 800.0, travel: 700.0, retract: 600.0 });
    assert_eq!(of(2).acceleration_mm_per_s2, Acceleration { print: 400.0, travel: 400.0, retract: 600.0 });
    // 0.5 mm is outside what Marlin accepts.
    assert_eq!((of(1).junction_deviation_mm, of(2).junction_deviation_mm), (0.05, 0.05));
    let without = InterpretOptions { without_limits: true };
    let job = interpret(gcode.as_bytes(), &cartesian, without).unwrap();
    assert_eq!(job.limits.len(), 1);
}

#[test]
fn an_arc_is_chords_with_one_record() {
    let job = job("G28\nM83\nG1 X10 F600\nG2 X20 Y10 I10 E3\n");
    let chords = &job.moves[1..];
    assert!(chords.len() > 10);
    assert_eq!(chords.iter().filter(|one| one.kind.ends_with_a_record()).count(), 1);
    let last = chords.last().unwrap();
    assert_eq!(last.kind, MoveKind::ArcChord { last: true });
    assert_eq!(last.end_10nm, [20 * MM, 10 * MM, 0]);
    assert_eq!(last.extruder_end, i128::from(3 * MM) * EXTRUDER_FRACTIONS_PER_UNIT);
    for one in chords {
        let [x, y] = [one.end_10nm[0] - 20 * MM, one.end_10nm[1]];
        assert!(((x as f64).hypot(y as f64) - 10.0 * MM as f64).abs() < 2.0);
    }
    // Neither I, J nor R: refused, the coordinates stay.
    let refused = super::interpreter_tests::job("G28\nG1 X10\nG2 X20 E3\nG1 X11 E1\n");
    assert_eq!(refused.moves.len(), 2);
    assert_eq!(refused.moves[1].start_10nm, [10 * MM, 0, 0]);
    assert_eq!(refused.filament_mm(), 1.0);
}

#[test]
fn an_arc_that_clamping_flattens_still_ends_once() {
    // The arc leaves the machine at Y = 0 and comes back to its axis: its last
    // chords have no length.
    let job = job("G28\nG1 X10 F600\nG3 X0 Y0 I-5 J-.001\nG1 Y5\n");
    assert_eq!(job.move_count(), 3);
}

#[test]
fn numbers_beyond_reason_are_errors_and_not_overflows() {
    let error = |gcode: &str| {
        interpret(gcode.as_bytes(), &ReferenceProfile::cartesian(), InterpretOptions::default()).unwrap_err()
    };
    assert_eq!(error("G1 X1\nG1 X99999999999\n"), InterpretError::OutOfRange { line: 2 });
    assert_eq!(error("G91\nG1 X9999999\nG1 X9999999\n"), InterpretError::OutOfRange { line: 3 });
    assert_eq!(error("G20\nM83\nG1 E999999999\n"), InterpretError::OutOfRange { line: 3 });
}

#[test]
fn line_ends_and_numbers_of_all_kinds_are_read() {
    assert_eq!(ends("G28\r\nN1 G01X1Y2*33\r\n\r\n; G1 X9\nG1 X3 ; Y9").len(), 2);
    assert_eq!(job("").lines, 0);
    assert_eq!(job("\n").lines, 1);
    assert_eq!(job("G28").lines, 1);
}

proptest! {
    #[test]
    fn no_text_makes_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let profile = ReferenceProfile::cartesian();
        if let Ok(job) = interpret(&bytes, &profile, InterpretOptions::default()) {
            prop_assert!(plan(&job, None).motion_time_s >= 0.0);
        }
    }

    #[test]
    fn no_command_makes_it_panic(
        lines in prop::collection::vec(
            ("(G0|G1|G2|G3|G10|G11|G20|G28|G90|G91|G92|M82|M83|M201|M203|M204|M205|M207|M208|M220|M221)",
             prop::collection::vec("[A-Z][-+]?[0-9]{0,12}(\\.[0-9]{0,15})?", 0..6)),
            0..40,
        ),
    ) {
        let text: String = lines.iter().map(|(command, words)| format!("{command} {}\n", words.join(" "))).collect();
        let profile = ReferenceProfile::corexy();
        if let Ok(job) = interpret(text.as_bytes(), &profile, InterpretOptions::default()) {
            let time = plan(&job, None).motion_time_s;
            prop_assert!(time.is_finite() && time >= 0.0, "{time}");
        }
    }
}

#[test]
fn the_end_is_told_as_the_gcode_counts() {
    let end = |gcode: &str| job(gcode).logical_end_10nm.map(|units| units as f64 / MM as f64);
    assert_eq!(end("G28\nG1 X10 Y5 Z1 E3\nG92 X1 E0\nG91\nG1 X2 E.5"), [3.0, 5.0, 1.0, 0.5]);
    assert_eq!(end("G28\nM207 Z1\nG1 Z2\nG10\nG1 X1"), [1.0, 0.0, 2.0, 0.0]);
    assert_eq!(end("G28\nG1 X500 Z1\nG92 X1\nG28 X"), [0.0, 0.0, 1.0, 0.0]);
}
