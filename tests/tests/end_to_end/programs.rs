//! Unusual jobs: arbitrary bytes, and arbitrary valid programs.

pub mod generator;

use ferrostep_oracle::reference::{
    EXTRUDER_FRACTIONS_PER_UNIT, InterpretOptions, Job, ReferenceProfile, UNITS_PER_MM, interpret,
};
use ferrostep_oracle::trace_check::{Finding, TraceCheckOptions, check_trace};
use ferrostep_random_cases::share_of_cases;
use ferrostep_session::desk::LOOK_AHEAD_BLOCKS;
use proptest::prelude::*;

use crate::end_to_end::desk::{profile, rehearse, rehearse_traced};
use generator::{Program, program};

/// Lines with the parts that parsers look at, cut and glued at random.
fn almost_gcode() -> impl Strategy<Value = Vec<u8>> {
    let pieces = prop::sample::select(vec![
        "G1 ",
        "G0",
        "G2 ",
        "G3",
        "G28",
        "G92",
        "G91\n",
        "G90\n",
        "G10\n",
        "G11\n",
        "M82\n",
        "M83",
        "M302 P1\n",
        "M220 S50",
        "M104 S",
        "M114\n",
        "M201 X",
        "M204 P",
        "M205 J",
        "N5 ",
        "*33",
        "X10",
        "Y-2.5",
        "Z.2",
        "E1",
        "F3000",
        "I5",
        "J-3",
        "R7",
        "\n",
        "\r\n",
        "\r",
        ";",
        "(",
        ")",
        " ",
        "-",
        ".",
        "1",
        "99999999",
        "\u{feff}",
        "\0",
        "\t",
        "M112\n",
        "M999\n",
        "T0",
        "%",
        "*",
        "\u{e9}",
    ]);
    let piece = prop_oneof![
        8 => pieces.prop_map(|text| text.as_bytes().to_vec()),
        1 => prop::collection::vec(any::<u8>(), 1..4),
    ];
    prop::collection::vec(piece, 0..60).prop_map(|pieces| pieces.concat())
}

/// Checks that the job ends for any bytes, and names the line if it ends early.
fn ends_well(bytes: &[u8], machine: &str) -> Result<(), TestCaseError> {
    let profile = profile(machine);
    let ended = rehearse(&profile, LOOK_AHEAD_BLOCKS, &mut &bytes[..]);
    let lines = 1 + bytes.iter().filter(|&&byte| byte == b'\n' || byte == b'\r').count() as u32;
    prop_assert!(ended.lines <= lines, "{} of {lines} lines", ended.lines);
    match ended.outcome {
        Ok(()) => {}
        Err(ferrostep_session::job::JobError::Line { line, message, .. }) => {
            prop_assert_eq!(line, ended.lines);
            prop_assert!(!message.is_empty());
        }
        Err(error) => prop_assert!(false, "{}", error),
    }
    prop_assert_eq!(ended.figures.underruns, 0);
    // Byte by byte it is the same job.
    let mut bytewise = std::io::BufReader::with_capacity(1, bytes);
    let again = rehearse(&profile, LOOK_AHEAD_BLOCKS, &mut bytewise);
    prop_assert_eq!(again.figures.digests, ended.figures.digests);
    prop_assert_eq!((again.lines, again.logical_10nm, again.tally), (ended.lines, ended.logical_10nm, ended.tally));
    Ok(())
}

/// Returns true if X, Y, Z hardly move in a move in which much filament does: several
/// hundred times as far.
///
/// Such a move may or may not count as one of the extruder alone, and so may the ends of an arc's
/// chords. The speeds next to it depend on that, the positions do not.
fn has_almost_extruder_only_moves(job: &Job) -> bool {
    job.moves.iter().any(|one| {
        let way = one.start_10nm.iter().zip(one.end_10nm).map(|(from, to)| (to - from) as f64);
        let way_mm = way.map(|units| units * units).sum::<f64>().sqrt() / UNITS_PER_MM as f64;
        let filament = (one.extruder_end - one.extruder_start) as f64 / EXTRUDER_FRACTIONS_PER_UNIT as f64;
        way_mm > 0.0 && filament.abs() / UNITS_PER_MM as f64 > 500.0 * way_mm
    })
}

/// Prints a program; the reference checks every step.
fn prints_exactly(program: &Program) -> Result<(), TestCaseError> {
    let Program { text, machine, has_arcs } = program;
    let reference = match *machine {
        "cartesian" => ReferenceProfile::cartesian(),
        "corexy" => ReferenceProfile::corexy(),
        _ => ReferenceProfile::prusa_mini(),
    };
    let profile = profile(machine);
    let job = interpret(text.as_bytes(), &reference, InterpretOptions::default()).unwrap();
    let ended = rehearse_traced(&profile, &mut text.as_bytes());
    prop_assert!(ended.outcome.is_ok(), "{:?}", ended.outcome);
    prop_assert_eq!(ended.logical_10nm, job.logical_end_10nm);
    prop_assert_eq!(ended.lines, job.lines);
    prop_assert_eq!(ended.tally.moves, job.move_count() as u64);
    prop_assert_eq!(ended.notices.len() as u64, ended.tally.clamped_moves);
    if !has_arcs {
        prop_assert_eq!(ended.tally.clamped_moves, u64::from(job.clamped_moves));
    }
    let filament_mm = ended.tally.filament_100pm as f64 / 1e7;
    prop_assert!((filament_mm - job.filament_mm()).abs() < 1e-6, "{} mm", filament_mm);

    let options = TraceCheckOptions { findings_kept: usize::MAX, ..TraceCheckOptions::default() };
    let report = check_trace(ended.trace.as_slice(), text.as_bytes(), &reference, &options).unwrap();
    let law_is_open = *has_arcs || has_almost_extruder_only_moves(&job);
    let is_accepted =
        |finding: &Finding| law_is_open && matches!(finding, Finding::OffTheLaw { .. } | Finding::WrongDuration(_));
    prop_assert!(report.findings.iter().all(is_accepted), "{}", report);
    prop_assert_eq!(report.motor_steps, ended.figures.motor_steps);
    prop_assert_eq!(report.step_digest, ended.figures.digests.step);
    prop_assert_eq!(report.order_digest, ended.figures.digests.order);
    prop_assert_eq!((ended.figures.underruns, ended.figures.starvation_flushes), (0, 0));
    if !law_is_open {
        let difference_s = ended.figures.motion_time_s - report.planned_motion_time_s;
        let tolerance_s = 1e-5 + 2e-4 * report.planned_motion_time_s;
        prop_assert!(difference_s.abs() < tolerance_s, "{} of {} s", difference_s, report.planned_motion_time_s);
    }

    for look_ahead in [2, 5] {
        let narrow = rehearse(&profile, look_ahead, &mut text.as_bytes());
        prop_assert_eq!(narrow.figures.motor_steps, ended.figures.motor_steps);
        prop_assert_eq!(narrow.logical_10nm, ended.logical_10nm);
    }
    Ok(())
}

proptest! {
    #![proptest_config(share_of_cases(400))]

    #[test]
    fn any_bytes_end_without_panic(bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        ends_well(&bytes, "cartesian")?;
    }

    #[test]
    fn near_gcode_ends_without_panic(bytes in almost_gcode(), homed in any::<bool>()) {
        let prologue: &[u8] = if homed { b"G28\nM302 P1\n" } else { b"" };
        ends_well(&[prologue, &bytes].concat(), "corexy")?;
    }
}

proptest! {
    #![proptest_config(share_of_cases(150))]

    #[test]
    fn valid_programs_print_exactly(program in program()) {
        prints_exactly(&program)?;
    }
}
