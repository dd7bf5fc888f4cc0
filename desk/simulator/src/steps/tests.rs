#![allow(clippy::unwrap_used)]

use super::*;
use crate::frame::FrameSettings;
use crate::law::{Law, Piece, ShapedLaw, step_times};
use crate::measures::Report;
use crate::nozzle::NozzleSettings;
use crate::plan::{ExtruderFilter, Filters, MoveSpeeds, Plan, durations_s, simulate};
use crate::shapers::{Shaper, ShaperKind};
use ferrostep_oracle::reference::{InterpretOptions, Job, Kinematics, ReferenceProfile, interpret, plan};
use ferrostep_oracle::trace::{StepEvent, TraceReader};
use ferrostep_random_cases::cases;
use proptest::prelude::*;

const FILAMENT_MM2: f64 = 1.75 * 1.75 * std::f64::consts::FRAC_PI_4;

const TICK_HZ: u64 = 84_000_000;

fn header(kinematics: Kinematics, steps_per_mm: f64) -> TraceHeader {
    let (_, names) = kinematics.names();
    TraceHeader {
        tick_hz: TICK_HZ,
        axes: names.map(String::from).to_vec(),
        steps_per_mm: vec![steps_per_mm; 4],
        kinematics,
    }
}

/// Plans a square with a travel, a retraction and a slope, without homing records.
fn job() -> (Job, Vec<MoveSpeeds>) {
    let gcode = b"G28\nM83\nG1 X20 F6000\nG1 X40 E.75 F4800\nG1 Y20 E.75\nG1 X20 E.75\nG1 E-1 F2100\nG1 X10 Y10 F9000\nG1 E1 F2100\nG1 X35 Y0 E1 F3000\n";
    let job = interpret(gcode, &ReferenceProfile::cartesian(), InterpretOptions::default()).unwrap();
    let speeds = plan(&job, None).moves.iter().map(|one| MoveSpeeds::from(one.law)).collect();
    (job, speeds)
}

/// Returns the records of a job whose motors step where the plan passes the middle between two
/// steps.
fn records(job: &Job, speeds: &[MoveSpeeds], kinematics: Kinematics, steps_per_mm: f64) -> Vec<Record> {
    let plans = Plan::of_job(job, speeds, FILAMENT_MM2);
    records_of(&plans[0], &Filters::default(), &header(kinematics, steps_per_mm))
}

fn records_of(plan: &Plan, filters: &Filters, header: &TraceHeader) -> Vec<Record> {
    let mut records = Vec::new();
    let see = |record: &Record| -> Result<(), ()> {
        records.push(record.clone());
        Ok(())
    };
    planned::records(header, plan, filters, 0.0, see).unwrap();
    records
}

fn sum(x: &Law, y: &Law, factor: f64) -> Law {
    let pieces = x.pieces().iter().zip(y.pieces());
    Law::new(pieces.map(|(x, y)| Piece { motion: x.motion.plus(factor, y.motion), ..*x }).collect()).unwrap()
}

/// Every motor steps when it does in the reference, which has one law for each motor and no time
/// windows.
#[test]
fn a_plan_steps_where_the_reference_does() {
    let (job, speeds) = job();
    let plans = Plan::of_job(&job, &speeds, FILAMENT_MM2);
    let [x, y, z] = plans[0].axes();
    let zv = Shaper::new(ShaperKind::Zv, 40.0, 0.1).unwrap();
    let extruder = ExtruderFilter { advance_s: 0.04, ..ExtruderFilter::default() };
    let filters = Filters { shapers: [zv.clone(), zv.clone()], extruder };
    let (zv, identity) = (zv.centred(), Shaper::identity());
    // Half a shaper's length and a sample; ticks resolve 12 ns.
    let begins_s = zv.impulses()[1].delay_s.max(-zv.impulses()[0].delay_s) + SAMPLE_S;
    for kinematics in [Kinematics::Cartesian, Kinematics::CoreXy, Kinematics::CoreXz] {
        let records = records_of(&plans[0], &filters, &header(kinematics, 80.0));
        let laws = match kinematics {
            Kinematics::Cartesian => [(x.clone(), &zv), (y.clone(), &zv), (z.clone(), &identity)],
            Kinematics::CoreXy => [(sum(x, y, 1.0), &zv), (sum(x, y, -1.0), &zv), (z.clone(), &identity)],
            // Z, which has no shaper, does not move.
            Kinematics::CoreXz => [(sum(x, z, 1.0), &zv), (y.clone(), &zv), (sum(x, z, -1.0), &zv)],
        };
        for (motor, (law, shaper)) in laws.iter().enumerate() {
            let steps = records.iter().filter_map(|record| match record {
                Record::Step(event) if event.axes == 1 << motor => Some((event.tick, event.directions != 0)),
                _ => None,
            });
            let steps: Vec<_> = steps.collect();
            let expected = step_times(&ShapedLaw { law, impulses: shaper.impulses() }, 80.0);
            assert_eq!(steps.len(), expected.len(), "{kinematics:?} {motor}");
            for ((tick, negative), expected) in steps.into_iter().zip(&expected) {
                let off_ticks = (expected.time_s + begins_s) * TICK_HZ as f64 - tick as f64;
                // The step time of a motor that hardly moves is less certain than its position.
                assert!(
                    off_ticks.abs() < 1000.0 && negative == expected.negative,
                    "{kinematics:?} {motor}: {off_ticks}"
                );
            }
        }
        let filament = records.iter().map(|record| match record {
            Record::Step(StepEvent { axes: 8, directions, .. }) => {
                if *directions == 0 {
                    1
                } else {
                    -1
                }
            }
            _ => 0,
        });
        // 0.75 mm three times, a retraction and a recovery, and 1 mm.
        assert_eq!(filament.sum::<i32>(), 260);
        let ends = records.iter().filter(|record| matches!(record, Record::MoveEnd { .. })).count();
        assert_eq!(ends, job.moves.len());
    }
}

/// A plan by other rules steps the extruder in whole steps, as this firmware does; fine steps
/// measure the same as no steps.
#[test]
fn coarse_steps_of_the_extruder_are_seen_at_a_corner() {
    let (job, speeds) = job();
    let plans = Plan::of_job(&job, &speeds, FILAMENT_MM2);
    let mzv = [50.0, 40.0].map(|hz| Shaper::new(ShaperKind::Mzv, hz, 0.1).unwrap());
    let filters = Filters { shapers: mzv, extruder: ExtruderFilter::klipper(0.04, 0.04) };
    let mut measures = Measures::default();
    let time_s = simulate(&plans, &filters, &Machine::default(), FILAMENT_MM2, &mut measures).unwrap();
    let (unstepped, _) = measures.finish(time_s);
    let stepped = |extruder_steps_per_mm: f64| {
        let mut header = header(Kinematics::Cartesian, 400.0);
        header.steps_per_mm[3] = extruder_steps_per_mm;
        let path = PathSource::of_job(&job, durations_s(&job, &speeds), FILAMENT_MM2);
        let mut steps =
            StepSimulation::new(header, &Machine::default(), FILAMENT_MM2, path, Measures::default()).unwrap();
        assert_eq!(steps.play_plans(&plans, &filters).unwrap(), time_s);
        steps.finish().unwrap().0.finish(time_s).0
    };
    let (fine, coarse) = (stepped(3000.0), stepped(95.0));
    let corner = |report: &Report| report.bead.corner_volume_mm3;
    assert!((corner(&fine) - corner(&unstepped)).abs() < 0.001, "{fine:?} {unstepped:?}");
    assert!(corner(&coarse) > corner(&fine) + 0.004, "{coarse:?} {fine:?}");
    let error = |report: &Report| report.contour_error_um.p99;
    assert!((error(&fine) - error(&unstepped)).abs() < 2.0, "{fine:?} {unstepped:?}");
    assert_eq!((fine.bead.corners, fine.bead.ends), (unstepped.bead.corners, unstepped.bead.ends));
}

fn play(header: TraceHeader, machine: &Machine, path: PathSource, records: &[Record]) -> Result<Report, StepsError> {
    let mut steps = StepSimulation::new(header, machine, FILAMENT_MM2, path, Measures::default())?;
    for record in records {
        steps.play(record)?;
    }
    let (measures, time_s) = steps.finish()?;
    Ok(measures.finish(time_s).0)
}

fn planned(job: &Job, speeds: &[MoveSpeeds], machine: &Machine) -> Report {
    let mut measures = Measures::default();
    let plans = Plan::of_job(job, speeds, FILAMENT_MM2);
    let time_s = simulate(&plans, &Filters::default(), machine, FILAMENT_MM2, &mut measures).unwrap();
    measures.finish(time_s).0
}

/// Fine steps measure the same as the plan without steps, on both kinematics, with the path from
/// the G-code and with the path from the steps.
#[test]
fn steps_measure_as_their_plan_does() {
    let (job, speeds) = job();
    let machine =
        Machine { frame: FrameSettings::default(), nozzle: NozzleSettings { time_constant_s: 0.06, second: None } };
    let expected = planned(&job, &speeds, &machine);
    for kinematics in [Kinematics::Cartesian, Kinematics::CoreXy] {
        let records = records(&job, &speeds, kinematics, 400.0);
        for path in
            [PathSource::of_job(&job, durations_s(&job, &speeds), FILAMENT_MM2), PathSource::of_steps(FILAMENT_MM2)]
        {
            let report = play(header(kinematics, 400.0), &machine, path, &records).unwrap();
            let near = |value: f64, expected: f64, slack: f64| {
                assert!(
                    (value - expected).abs() < slack + 0.05 * expected,
                    "{value}: {report:?} instead of {expected:?}"
                );
            };
            near(report.time_s, expected.time_s, 0.0);
            near(report.contour_error_um.rms, expected.contour_error_um.rms, 1.5);
            near(report.contour_error_um.p99, expected.contour_error_um.p99, 4.0);
            near(report.contour_error_um.max, expected.contour_error_um.max, 4.0);
            near(report.bead.corner_volume_mm3, expected.bead.corner_volume_mm3, 0.004);
            near(report.bead.end_volume_mm3, expected.bead.end_volume_mm3, 0.03);
            near(report.ringing.max_um, expected.ringing.max_um, 3.0);
            near(report.true_acceleration_mm_per_s2.max, expected.true_acceleration_mm_per_s2.max, 1500.0);
            near(report.extruder.max_speed_mm_per_s, expected.extruder.max_speed_mm_per_s, 1.0);
            assert_eq!((report.bead.corners, report.ringing.stops), (expected.bead.corners, expected.ringing.stops));
        }
    }
}

/// Stops and time of homing do not count, and a changed origin is not motion.
#[test]
fn homing_is_no_part_of_the_job() {
    let machine = Machine::default();
    let step = |tick, axes| Record::Step(StepEvent { tick, axes, directions: 0 });
    let mut records: Vec<_> = (0..800).map(|index| step(index * 100_000, 1)).collect();
    records.push(Record::PositionsRedefined { tick: 2 * TICK_HZ, positions: vec![-40_000, 12_000, 0, 0] });
    // 10 mm at 10.5 mm/s.
    records.extend((0..800).map(|index| step(2 * TICK_HZ + index * 100_000, 2)));
    records.push(Record::MoveEnd { tick: 2 * TICK_HZ + 80_000_000, line: 9 });
    let of_steps = || PathSource::of_steps(FILAMENT_MM2);
    let report = play(header(Kinematics::Cartesian, 80.0), &machine, of_steps(), &records).unwrap();
    assert_eq!(report.ringing.stops, 1);
    // An abrupt stop: speed over omega.
    let expected_um = 10.5 / (std::f64::consts::TAU * 40.0) * 1000.0;
    assert!((report.ringing.max_um - expected_um).abs() < 0.15 * expected_um, "{report:?}");
    assert!((report.time_s - 80.0 / 84.0).abs() < 1e-9, "{report:?}");
    // A trace with extrusion is a job whose origin changes on the way.
    records.insert(5, step(450_000, 8));
    let report = play(header(Kinematics::Cartesian, 80.0), &machine, of_steps(), &records).unwrap();
    assert_eq!(report.ringing.stops, 2);
    assert!(report.time_s > 2.9);
}

#[test]
fn what_cannot_be_simulated_is_named() {
    let machine = Machine::default();
    let steps = || PathSource::of_steps(FILAMENT_MM2);
    let step = |tick| Record::Step(StepEvent { tick, axes: 1, directions: 0 });
    let error = play(header(Kinematics::Cartesian, 80.0), &machine, steps(), &[step(500), step(499)]).unwrap_err();
    assert_eq!(
        error.to_string(),
        "trace: a record at tick 499 comes after one at tick 500, expected ticks that never go back"
    );
    let mut three = header(Kinematics::Cartesian, 80.0);
    three.axes[0] = "\u{1b}[2J".to_owned();
    three.axes.pop();
    three.steps_per_mm.pop();
    let error = play(three, &machine, steps(), &[]).unwrap_err();
    assert!(matches!(error, StepsError::Motors(_)) && !error.to_string().contains('\u{1b}'), "{error}");
    assert!(matches!(play(header(Kinematics::Cartesian, 0.0), &machine, steps(), &[]), Err(StepsError::Scale(_))));
    let (job, speeds) = job();
    let of_job = || PathSource::of_job(&job, durations_s(&job, &speeds), FILAMENT_MM2);
    let end = |line| Record::MoveEnd { tick: 5, line };
    let error = play(header(Kinematics::Cartesian, 80.0), &machine, of_job(), &[end(9)]).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the trace has a move of line 9 where the G-code has one of line 3: is the trace of this file?"
    );
    let error = play(header(Kinematics::Cartesian, 80.0), &machine, of_job(), &[end(3)]).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the trace ends before the G-code's move of line 4: is the trace of this file, and complete?"
    );
    assert!(play(header(Kinematics::Cartesian, 80.0), &machine, of_job().may_end_early(), &[end(3)]).is_ok());
}

#[test]
fn a_long_pause_costs_neither_time_nor_memory() {
    let step = |tick| Record::Step(StepEvent { tick, axes: 1, directions: 0 });
    let records = [step(0), step(u64::MAX / 2), step(u64::MAX / 2 + 10)];
    let path = PathSource::of_steps(FILAMENT_MM2);
    let report = play(header(Kinematics::Cartesian, 80.0), &Machine::default(), path, &records).unwrap();
    assert!((report.time_s / (u64::MAX as f64 / 2.0 / TICK_HZ as f64) - 1.0).abs() < 1e-9);
}

#[test]
fn after_a_pause_of_ages_time_is_still_exact() {
    // In an f64 the sum of such ticks at 1 Hz is exact only to a thousand seconds.
    let mut slow = header(Kinematics::Cartesian, 80.0);
    slow.tick_hz = 1;
    let step = |tick| Record::Step(StepEvent { tick, axes: 1, directions: 0 });
    let path = PathSource::of_steps(FILAMENT_MM2);
    let mut steps = StepSimulation::new(slow, &Machine::default(), FILAMENT_MM2, path, Measures::default()).unwrap();
    for (tick, expected_s) in [(0, 0.0), (u64::MAX / 2 + 777, 2.0), (u64::MAX / 2 + 778, 3.0), (u64::MAX, 5.0)] {
        steps.play(&step(tick)).unwrap();
        assert_eq!(steps.time_s, expected_s, "{tick}");
    }
    let (_, time_s) = steps.finish().unwrap();
    assert_eq!(time_s, u64::MAX as f64);
}

#[test]
fn new_numbers_far_away_are_no_path() {
    let redefined = |tick, place| Record::PositionsRedefined { tick, positions: vec![place; 4] };
    let step = |tick| Record::Step(StepEvent { tick, axes: 0b1001, directions: 0 });
    let mut records = vec![redefined(0, 0), step(10), redefined(20, i32::MAX)];
    records.extend((0..4000).map(|index| step(TICK_HZ + index * 20_000)));
    let path = PathSource::of_steps(FILAMENT_MM2);
    let coarse = header(Kinematics::Cartesian, 100.0);
    let mut steps = StepSimulation::new(coarse, &Machine::default(), FILAMENT_MM2, path, Measures::default()).unwrap();
    for record in &records {
        steps.play(record).unwrap();
    }
    let (measures, _) = steps.finish().unwrap();
    assert!((measures.path_mm() - 40.0).abs() < 0.1, "{} mm of path", measures.path_mm());
}

#[test]
fn slow_steps_without_ends_of_moves_are_measured_as_they_come() {
    let path = PathSource::of_steps(FILAMENT_MM2);
    let header = header(Kinematics::Cartesian, 80.0);
    let mut steps = StepSimulation::new(header, &Machine::default(), FILAMENT_MM2, path, Measures::default()).unwrap();
    for index in 0..2000 {
        steps.play(&Record::Step(StepEvent { tick: index * TICK_HZ / 20, axes: 1, directions: 0 })).unwrap();
    }
    // 100 s are 400,000 samples.
    assert!(steps.measures.waiting_samples() < 100_000, "{}", steps.measures.waiting_samples());
}

#[test]
fn a_move_of_the_gcode_that_never_ends_is_not_waited_for_for_ever() {
    let (job, speeds) = job();
    let path = PathSource::of_job(&job, durations_s(&job, &speeds), FILAMENT_MM2);
    let header = header(Kinematics::Cartesian, 80.0);
    let mut steps = StepSimulation::new(header, &Machine::default(), FILAMENT_MM2, path, Measures::default()).unwrap();
    for index in 0..500 {
        steps.play(&Record::Step(StepEvent { tick: 2 * index * TICK_HZ, axes: 1, directions: 0 })).unwrap();
    }
    // 1000 s are 4 million samples.
    assert!(steps.measures.waiting_samples() < 3_000_000, "{}", steps.measures.waiting_samples());
}

#[test]
fn a_motor_with_absurd_steps_is_named_without_its_control_characters() {
    let refused = |scale: f64, name: &str| {
        let mut header = header(Kinematics::Cartesian, scale);
        header.axes[0] = name.to_owned();
        play(header, &Machine::default(), PathSource::of_steps(FILAMENT_MM2), &[]).unwrap_err().to_string()
    };
    for scale in [-80.0, 0.0, 1e-300, 0.05, 2e6, f64::INFINITY, f64::NAN] {
        let text = refused(scale, "x\u{1b}[2J");
        assert!(text.contains("expected 0.1 to 1000000") && !text.contains('\u{1b}'), "{text}");
    }
}

const TEXT: &str = concat!(
    r#"{"format":"ferrostep-trace","version":1,"tick_hz":84000000,"axes":["x","y","z","e"],"#,
    r#""steps_per_mm":[80,80,400,95],"kinematics":"cartesian"}"#,
    "\n"
);

/// Plays the bytes of a trace, valid or not.
fn play_bytes(bytes: &[u8]) -> Result<Report, StepsError> {
    let reader = TraceReader::new(bytes).map_err(StepsError::Trace)?;
    let path = PathSource::of_steps(FILAMENT_MM2);
    let mut steps =
        StepSimulation::new(reader.header().clone(), &Machine::default(), FILAMENT_MM2, path, Measures::default())?;
    for record in reader {
        steps.play(&record.map_err(StepsError::Trace)?)?;
    }
    let (measures, time_s) = steps.finish()?;
    Ok(measures.finish(time_s).0)
}

proptest! {
    #![proptest_config(cases(64))]

    /// Any records, and any truncation of them, give measures or a named error: finite numbers, and
    /// no panic.
    #[test]
    fn any_trace_is_measured_or_refused(
        records in prop::collection::vec((0u64..30_000_000, 0u8..4, any::<u8>(), any::<u8>(), any::<i32>()), 0..60),
        cut in 0.0f64..1.0,
    ) {
        let (mut bytes, mut tick) = (TEXT.as_bytes().to_vec(), 0u64);
        for (pause, kind, axes, directions, number) in records {
            tick += pause;
            bytes.extend(tick.to_le_bytes());
            bytes.extend([kind % 3, if kind == 0 { axes & 0b1111 } else { 0 }, directions, 0]);
            match kind % 3 {
                0 => {}
                1 => (0..4).for_each(|_| bytes.extend(number.to_le_bytes())),
                _ => bytes.extend(number.to_le_bytes()),
            }
        }
        let whole = bytes.len();
        bytes.truncate((cut * whole as f64) as usize);
        for bytes in [&bytes[..], &bytes[..bytes.len() / 2]] {
            if let Ok(report) = play_bytes(bytes) {
                let error = report.contour_error_um;
                prop_assert!([error.rms, error.p99, error.max, report.bead.end_volume_mm3, report.time_s].iter().all(|one| one.is_finite()));
            }
        }
    }
}
