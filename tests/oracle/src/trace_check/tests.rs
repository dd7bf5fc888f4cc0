//! A right trace passes, and each kind of error is found.
#![allow(clippy::unwrap_used)]

use super::synthetic::{TICK_HZ, bytes, records};
use super::*;

const JOB: &str = "G28\nM83\nG1 X40 Y10 Z.3 F6000\nG1 E2 F1800\nG1 X60 Y30 E1.3 F3000\nG1 X60 Y60 E1.31\n\
                   G1 X35.5 Y61.2 E.777\nG92 E0\nG10\nG0 X80 Y20 F9000\nG11\nM221 S93\nG1 X81 Y50 E1.05511\n\
                   G2 X100 Y60 I12 J-3 E.9\nG1 X100.003 Y60.001\nG1 X250 Y60.7\nG1 E-2 F2400\nG4 P5\nG1 Z5\nM84\n";

fn cartesian() -> ReferenceProfile {
    ReferenceProfile::cartesian()
}

fn check(profile: &ReferenceProfile, records: &[Record]) -> TraceReport {
    check_trace(bytes(profile, records).as_slice(), JOB.as_bytes(), profile, &TraceCheckOptions::default()).unwrap()
}

/// Makes the trace wrong and returns the findings.
fn findings_after(spoil: impl FnOnce(&mut Vec<Record>)) -> Vec<Finding> {
    let profile = cartesian();
    let mut records = records(JOB, &profile);
    spoil(&mut records);
    check(&profile, &records).findings
}

/// Index of the record that ends a line.
fn end_of(records: &[Record], line: u32) -> usize {
    records.iter().position(|record| matches!(record, Record::MoveEnd { line: one, .. } if *one == line)).unwrap()
}

/// The step events between the ends of two lines.
fn steps_between(records: &mut [Record], after: u32, until: u32) -> Vec<&mut StepEvent> {
    let (from, to) = (end_of(records, after) + 1, end_of(records, until));
    records[from..to]
        .iter_mut()
        .filter_map(|record| if let Record::Step(event) = record { Some(event) } else { None })
        .collect()
}

#[test]
fn a_trace_as_planned_passes_on_every_profile() {
    for profile in [cartesian(), ReferenceProfile::corexy(), ReferenceProfile::prusa_mini()] {
        let report = check(&profile, &records(JOB, &profile));
        assert!(report.passed(), "{report}");
        assert_eq!(report.moves, 12);
        // All but the moves after G10 and G11, and the arc.
        assert_eq!(report.laws_checked, 9);
        assert!((report.measured_s / report.planned_s - 1.0).abs() < 1e-6, "{report}");
        for deviation in report.largest_deviation {
            let deviation = deviation.unwrap();
            assert!(deviation.steps > 0.4 && deviation.steps <= 1.0, "{report}");
        }
        // Fast moves come near their limits, and the watch sees that.
        assert!(report.speed_ratio[2] > 0.9 && report.acceleration_ratio[2] > 0.3, "{report}");
        assert!(report.to_string().contains("findings           0"));
    }
}

#[test]
fn digests_are_those_of_the_records() {
    let profile = cartesian();
    let records = records(JOB, &profile);
    let whole = bytes(&profile, &records);
    let body = &whole[synthetic::header(&profile).len()..];
    let (mut order, mut steps, mut offset) = (Fnv1a64::default(), Fnv1a64::default(), 0);
    while offset < body.len() {
        let record = &body[offset..offset + 12];
        match record[8] {
            0 => {
                order.write(&record[9..11]);
                steps.write(record);
                offset += 12;
            }
            1 => offset += 28,
            _ => offset += 16,
        }
    }
    let report = check(&profile, &records);
    assert_eq!((report.order_digest, report.step_digest), (order.0, steps.0));
    assert_eq!(report.order_digest_hex().len(), 16);
    assert_ne!(report.order_digest, report.step_digest);
}

#[test]
fn a_lost_step_is_a_wrong_position_from_there_on() {
    let findings = findings_after(|records| {
        let lost = end_of(records, 5) + 10;
        records.remove(lost);
    });
    assert!(findings.iter().any(|one| matches!(one, Finding::WrongPosition { line: 6, .. })), "{findings:?}");
    assert!(!findings.iter().any(|one| matches!(one, Finding::WrongPosition { line: 5, .. })), "{findings:?}");
}

#[test]
fn a_step_the_wrong_way_is_a_wrong_position() {
    let findings = findings_after(|records| steps_between(records, 4, 5)[7].directions ^= 0b0001);
    assert!(findings.contains(&Finding::WrongPosition { line: 5, motor: 0, position: 4798, expected: 4800 }));
}

#[test]
fn an_extruder_that_rounds_each_move_is_caught() {
    // One extruder step too many in one block and one too few in the next: positions differ
    // between the two only.
    let findings = findings_after(|records| {
        let events = steps_between(records, 5, 6);
        let first = events.into_iter().find(|event| event.axes & 0b1000 != 0).unwrap();
        first.axes &= !0b1000;
        first.axes |= 0b0010;
    });
    assert!(findings.iter().any(|one| matches!(one, Finding::WrongPosition { line: 6, motor: 3, .. })), "{findings:?}");
}

#[test]
fn a_block_at_constant_speed_leaves_its_law() {
    let findings = findings_after(|records| {
        let mut events = steps_between(records, 5, 6);
        let (first, last, count) = (events[0].tick, events[events.len() - 1].tick, events.len() as u64);
        for (index, event) in events.iter_mut().enumerate() {
            event.tick = first + (last - first) * index as u64 / (count - 1);
        }
    });
    assert!(findings.iter().any(|one| matches!(one, Finding::OffTheLaw { motor: 1, .. })), "{findings:?}");
}

#[test]
fn a_burst_of_three_late_steps_leaves_the_law() {
    let findings = findings_after(|records| {
        let mut events = steps_between(records, 5, 6);
        let middle = events.len() / 2;
        let until = events[middle + 4].tick;
        for (index, event) in events[middle..middle + 4].iter_mut().enumerate() {
            event.tick = until - 170 * (4 - index as u64);
        }
    });
    assert!(findings.iter().any(|one| matches!(one, Finding::OffTheLaw { .. })), "{findings:?}");
}

#[test]
fn everything_at_double_speed_is_noticed_by_duration_and_limits() {
    let profile = cartesian();
    let mut records = records(JOB, &profile);
    for record in &mut records {
        let (Record::Step(StepEvent { tick, .. })
        | Record::PositionsRedefined { tick, .. }
        | Record::MoveEnd { tick, .. }) = record;
        *tick /= 2;
    }
    let options = TraceCheckOptions { findings_kept: usize::MAX, ..TraceCheckOptions::default() };
    let report = check_trace(bytes(&profile, &records).as_slice(), JOB.as_bytes(), &profile, &options).unwrap();
    let has = |wanted: fn(&Finding) -> bool| report.findings.iter().any(wanted);
    assert!(has(|one| matches!(one, Finding::WrongDuration(difference) if (difference.relative + 0.5).abs() < 1e-3)));
    assert!(has(|one| matches!(one, Finding::TooFast { axis: 0, .. })), "{report}");
    assert!(has(|one| matches!(one, Finding::TooMuchAcceleration { .. })), "{report}");
    assert_eq!(report.finding_count as usize, report.findings.len());
}

#[test]
fn limits_are_those_of_the_profile_and_of_m201_m203() {
    let profile = cartesian();
    let fast = records(JOB, &profile);
    let findings = |limits: &str| {
        let gcode = JOB.replace("M83\n", &format!("M83 ;\n{limits}")).replacen("M83 ;\nM", "M", 1);
        check_trace(bytes(&profile, &fast).as_slice(), gcode.as_bytes(), &profile, &TraceCheckOptions::default())
            .unwrap()
            .findings
    };
    // M83 is replaced by the limit, so that lines keep their numbers; the job's E words then have
    // another meaning, which does not matter here.
    assert!(findings("M203 X60\n").iter().any(|one| matches!(one, Finding::TooFast { axis: 0, .. })));
    assert!(!findings("M203 X200\n").iter().any(|one| matches!(one, Finding::TooFast { .. })));
    assert!(findings("M201 Y300\n").iter().any(|one| matches!(one, Finding::TooMuchAcceleration { axis: 1, .. })));
    assert!(!findings("M201 Y1500\n").iter().any(|one| matches!(one, Finding::TooMuchAcceleration { .. })));
}

#[test]
fn events_too_near_and_ticks_backwards_are_caught() {
    let findings = findings_after(|records| {
        let mut events = steps_between(records, 4, 5);
        let before = events[20].tick;
        events[21].tick = before + 167;
    });
    assert!(findings.iter().any(|one| matches!(one, Finding::EventsTooNear { gap_ticks: 167, .. })), "{findings:?}");
    let findings = findings_after(|records| steps_between(records, 4, 5)[21].tick -= TICK_HZ / 10);
    assert!(findings.iter().any(|one| matches!(one, Finding::TickDecreases { .. })), "{findings:?}");
}

#[test]
fn ends_of_moves_are_those_of_the_job() {
    let findings = findings_after(|records| {
        let end = end_of(records, 5);
        records.remove(end);
    });
    assert!(findings.contains(&Finding::WrongLine { line: 6, expected: 5 }), "{findings:?}");
    let findings = findings_after(|records| {
        let last = records.last().cloned().unwrap();
        records.push(last);
    });
    assert_eq!(findings, [Finding::UnexpectedMoveEnd { line: 19 }]);
    let findings = findings_after(|records| records.truncate(end_of(records, 7) + 1));
    assert!(findings.contains(&Finding::MissingMoves { count: 7 }), "{findings:?}");
}

#[test]
fn homing_is_in_the_trace_where_it_is_in_the_job() {
    let findings = findings_after(|records| {
        records.retain(|record| !matches!(record, Record::PositionsRedefined { .. }));
    });
    assert!(findings.contains(&Finding::MissingHoming { line: 3 }), "{findings:?}");
    assert!(findings.iter().any(|one| matches!(one, Finding::WrongPosition { line: 3, motor: 0, .. })));
    let findings = findings_after(|records| {
        let end = end_of(records, 5);
        let Record::MoveEnd { tick, .. } = records[end] else { unreachable!() };
        records.insert(end + 1, Record::PositionsRedefined { tick, positions: vec![0; 4] });
    });
    assert!(findings.iter().any(|one| matches!(one, Finding::UnexpectedHoming { .. })), "{findings:?}");
}

#[test]
fn what_cannot_be_checked_is_an_error() {
    let profile = cartesian();
    let whole = bytes(&profile, &records(JOB, &profile));
    let error = |trace: &[u8], gcode: &str, profile: &ReferenceProfile| {
        check_trace(trace, gcode.as_bytes(), profile, &TraceCheckOptions::default()).unwrap_err()
    };
    let cut = &whole[..whole.len() - 3];
    assert!(matches!(error(cut, JOB, &profile), TraceCheckError::Trace(TraceError::Truncated { .. })));
    let other = error(&whole, JOB, &ReferenceProfile::corexy());
    assert!(matches!(other, TraceCheckError::NotThisProfile("kinematics")));
    let other = error(&whole, JOB, &ReferenceProfile::prusa_mini());
    assert!(matches!(other, TraceCheckError::NotThisProfile("steps_per_mm")));
    assert!(matches!(error(&whole, "G1 X99999999999", &profile), TraceCheckError::Interpret(_)));
    let text = String::from_utf8_lossy(&whole[..200]).replace("\"z\"", "\"x\"");
    assert!(matches!(error(text.as_bytes(), JOB, &profile), TraceCheckError::Axes));
}
