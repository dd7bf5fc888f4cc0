//! Any bytes are a trace or an error that can be told, read in portions of any size; and what is
//! read is measured in finite numbers, on any kinematics, or refused.
//!
//! A fuzzer does not find headers: the first byte says whether the input is a whole file, or
//! records to which a header is added, whose ticks are made to go forwards.
#![no_main]

use std::io::{self, Read};

use ferrostep_oracle::reference::{InterpretOptions, ReferenceProfile, interpret, plan};
use ferrostep_oracle::trace::{Record, TraceReader};
use ferrostep_simulator::measures::Measures;
use ferrostep_simulator::plan::{Machine, MoveSpeeds, durations_s};
use ferrostep_simulator::steps::{PathSource, StepSimulation};
use libfuzzer_sys::fuzz_target;

const FILAMENT_MM2: f64 = 2.4;

/// Records are played so far: a pause of one costs up to two seconds of samples.
const MAX_RECORDS: usize = 100;

/// Bytes in portions.
struct Portions<'a>(&'a [u8], usize);

impl Read for Portions<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let length = self.1.min(buffer.len());
        self.0.read(&mut buffer[..length])
    }
}

/// A header with steps/mm from the input, and records whose ticks are pauses.
fn with_header(mode: u8, bytes: &[u8]) -> Option<Vec<u8>> {
    let (scale, mut records) = bytes.split_first_chunk::<8>()?;
    let scale = f64::from_le_bytes(*scale);
    let scale = if scale.is_finite() { scale } else { 80.0 };
    let (kinematics, axes) = match mode >> 1 & 3 {
        0 => ("corexy", ["a", "b", "z", "e"]),
        1 => ("corexz", ["a", "y", "c", "e"]),
        _ => ("cartesian", ["x", "y", "z", "e"]),
    };
    let tick_hz = [1, 1_000, 84_000_000, u64::MAX][usize::from(mode >> 3 & 3)];
    let mut trace = format!(
        "{{\"format\":\"ferrostep-trace\",\"version\":1,\"tick_hz\":{tick_hz},\"axes\":{axes:?},\
         \"steps_per_mm\":[{scale:e},80,400,95],\"kinematics\":\"{kinematics}\"}}\n"
    )
    .into_bytes();
    let mut tick = 0u64;
    while let Some((pause, rest)) = records.split_first_chunk::<4>() {
        // Mostly short: the upper byte is an exponent.
        let pause = u32::from_le_bytes(*pause);
        tick = tick.wrapping_add(u64::from(pause & 0xff_ffff) << (pause >> 24 & 31));
        let Some((kinds, rest)) = rest.split_first_chunk::<4>() else { break };
        let kind = kinds[0] % 4;
        let length = [0, 16, 4, 0][usize::from(kind)].min(rest.len());
        trace.extend(tick.to_le_bytes());
        trace.extend([kind, if kind == 0 { kinds[1] & 15 } else { 0 }, kinds[2], 0]);
        trace.extend(&rest[..length]);
        records = &rest[length..];
    }
    Some(trace)
}

fn play(bytes: &[u8], path: PathSource) {
    let Ok(reader) = TraceReader::new(bytes) else { return };
    let measures = Measures::with_snapshots();
    let simulation =
        StepSimulation::new(reader.header().clone(), &Machine::default(), FILAMENT_MM2, path, measures);
    let mut simulation = match simulation {
        Ok(simulation) => simulation,
        Err(error) => return assert!(!error.to_string().is_empty()),
    };
    for record in reader.take(MAX_RECORDS).map_while(Result::ok) {
        if let Err(error) = simulation.play(&record) {
            return assert!(!error.to_string().is_empty());
        }
    }
    let (measures, time_s) = match simulation.finish() {
        Ok(finished) => finished,
        Err(error) => return assert!(!error.to_string().is_empty()),
    };
    let (report, _) = measures.finish(time_s);
    let (error, bead, acceleration) = (report.contour_error_um, report.bead, report.true_acceleration_mm_per_s2);
    let numbers = [
        report.time_s,
        error.rms,
        error.p99,
        error.max,
        bead.corner_volume_mm3,
        bead.end_volume_mm3,
        bead.elsewhere_volume_mm3,
        report.ringing.rms_um,
        report.ringing.max_um,
        acceleration.p99,
        acceleration.max,
        report.extruder.max_speed_mm_per_s,
        report.extruder.max_acceleration_mm_per_s2,
        report.printing_time_s,
    ];
    assert!(numbers.iter().all(|number| number.is_finite() && *number >= 0.0), "{report:?}");
    assert!(error.p99 <= error.max && error.rms <= error.max * 1.000_001, "{error:?}");
}

/// Records and the error at the end, as text.
fn read(input: impl Read) -> (Vec<Record>, Option<String>) {
    let mut records = Vec::new();
    let reader = match TraceReader::new(input) {
        Ok(reader) => reader,
        Err(error) => return (records, Some(error.to_string())),
    };
    for record in reader {
        match record {
            Ok(record) => records.push(record),
            Err(error) => return (records, Some(error.to_string())),
        }
    }
    (records, None)
}

fuzz_target!(|input: &[u8]| {
    let Some((&mode, bytes)) = input.split_first() else { return };
    let trace = if mode & 1 == 0 { bytes.to_vec() } else { with_header(mode, bytes).unwrap_or_default() };
    let whole = read(&trace[..]);
    assert_eq!(read(Portions(&trace, 1 + usize::from(mode >> 6))), whole);
    assert!(whole.1.is_none_or(|error| !error.is_empty()));
    if mode & 32 == 0 {
        play(&trace, PathSource::of_steps(FILAMENT_MM2));
        return;
    }
    let text = b"M83\nG1 X2 F6000\nG1 X3 E.1\nG2 X4 Y1 I1 J1 E.1\nG1 E-1\nG1 Y5\n";
    let job = interpret(text, &ReferenceProfile::cartesian(), InterpretOptions::default()).expect("a job");
    let speeds: Vec<MoveSpeeds> = plan(&job, None).moves.iter().map(|one| MoveSpeeds::from(one.law)).collect();
    let path = PathSource::of_job(&job, durations_s(&job, &speeds), FILAMENT_MM2);
    play(&trace, if mode & 64 == 0 { path } else { path.may_end_early() });
});
