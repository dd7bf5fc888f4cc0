//! Reads records of an accelerometer, as Klipper and RepRapFirmware write them.

use std::fmt;

/// Axes of a record, in the order of its columns.
pub const AXES: [char; 3] = ['X', 'Y', 'Z'];

/// Standard gravity, RepRapFirmware's unit of acceleration, mm/s^2.
const GRAVITY_MM_PER_S2: f64 = 9806.65;

/// First line of RepRapFirmware's records of all axes.
const REPRAPFIRMWARE_HEADER: &str = "Sample,X,Y,Z";

/// Starts of lines that a printer sends between those of a record.
const ANSWERS: [&str; 4] = ["ok", "echo:", "//", "T:"];

/// Start of this firmware's line about a record that ended early.
const ENDED: &str = "echo:record ended: ";

/// Minimum length of a gap, in mean sampling intervals.
const GAP: f64 = 3.0;

/// Accelerations sampled at equal times.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// Sampling rate, Hz.
    pub rate_hz: f64,
    /// Accelerations of X, Y and Z, mm/s^2, with equal numbers of samples.
    pub acceleration_mm_per_s2: [Vec<f64>; 3],
}

/// Reason why a record cannot be read.
#[derive(Clone, Debug, PartialEq)]
pub enum RecordError {
    /// The first line is neither Klipper's nor RepRapFirmware's.
    Unknown {
        /// The first line.
        first_line: String,
    },
    /// A line does not have the columns of the first line.
    Line {
        /// Number of the line, counted from 1.
        line: usize,
        /// The line's text.
        text: String,
    },
    /// Samples are missing.
    Gap {
        /// Line of the first sample after the gap, counted from 1.
        line: usize,
        /// Time since the previous sample, s; not above 0 if time goes back.
        interval_s: f64,
    },
    /// The sample numbers show that samples are missing.
    Missing {
        /// Line after the missing samples, counted from 1.
        line: usize,
    },
    /// The printer ended the record early.
    Ended {
        /// Line with the printer's message, counted from 1.
        line: usize,
        /// Reason that the printer gives.
        reason: String,
    },
    /// RepRapFirmware's last line, which gives the rate, is missing.
    NoRate,
    /// RepRapFirmware lost samples; the number of overflows.
    Overflows(u32),
    /// The record has fewer than two samples.
    Empty,
}

impl fmt::Display for RecordError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown { first_line } => write!(
                out,
                "line 1: {first_line:?}: expected a record of an accelerometer, which begins with `#time,accel_x,accel_y,accel_z` \
                 (Klipper) or `Sample,X,Y,Z` (RepRapFirmware)"
            ),
            Self::Line { line, text } => {
                write!(out, "line {line}: {text:?}: expected four numbers with commas between them")
            }
            Self::Gap { line, interval_s } if *interval_s > 0.0 => write!(
                out,
                "line {line}: no sample for {interval_s:.4} s before this one: samples were lost, record it again"
            ),
            Self::Gap { line, .. } => {
                write!(out, "line {line}: its time is not after that of the line before: two records in one file?")
            }
            Self::Missing { line } => {
                write!(
                    out,
                    "line {line}: it has not the number after that of the sample before: lines were lost, record it again"
                )
            }
            Self::Ended { line, reason } => write!(out, "line {line}: the printer has ended the record: {reason}"),
            Self::NoRate => out.write_str("the last line is missing, expected one such as `Rate 1344, overflows 0`"),
            Self::Overflows(count) => {
                write!(out, "the accelerometer overflowed {count} times: samples were lost, record it again")
            }
            Self::Empty => out.write_str("there are no samples in it"),
        }
    }
}

impl std::error::Error for RecordError {}

impl Record {
    /// Reads a record.
    ///
    /// Klipper's lines have the time in seconds and accelerations in mm/s^2; RepRapFirmware's lines
    /// have a number and accelerations in g, and the last line has the rate. A RepRapFirmware
    /// record may be part of a printer's log, with answers around and between its lines.
    ///
    /// # Errors
    /// [`RecordError`], with the line.
    pub fn parse(text: &str) -> Result<Self, RecordError> {
        let mut lines = text.lines().enumerate().map(|(index, line)| (index + 1, line.trim()));
        let (_, first) = lines.next().unwrap_or((1, ""));
        let lower = first.trim_start_matches('\u{feff}').to_ascii_lowercase();
        if lower.starts_with("#time,accel_x,accel_y,accel_z") {
            klipper(lines)
        } else if lower.starts_with("sample,x,y,z")
            || lines.any(|(_, text)| text.eq_ignore_ascii_case(REPRAPFIRMWARE_HEADER))
        {
            reprapfirmware(lines)
        } else {
            Err(RecordError::Unknown { first_line: first.chars().take(60).collect() })
        }
    }

    /// Returns the number of samples.
    pub fn len(&self) -> usize {
        self.acceleration_mm_per_s2[0].len()
    }

    /// Returns true if there are no samples.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the record's duration, s.
    pub fn duration_s(&self) -> f64 {
        self.len() as f64 / self.rate_hz
    }

    fn of(rate_hz: f64, samples: &[[f64; 3]]) -> Self {
        let axis = |axis: usize| samples.iter().map(|sample| sample[axis]).collect();
        Self { rate_hz, acceleration_mm_per_s2: [axis(0), axis(1), axis(2)] }
    }
}

/// Parses four numbers separated by commas.
fn numbers(line: usize, text: &str) -> Result<[f64; 4], RecordError> {
    let mut fields = text.split(',').map(|field| field.trim().parse::<f64>().ok().filter(|number| number.is_finite()));
    let found = [fields.next(), fields.next(), fields.next(), fields.next()].map(Option::flatten);
    match (found, fields.next()) {
        ([Some(a), Some(b), Some(c), Some(d)], None) => Ok([a, b, c, d]),
        _ => Err(RecordError::Line { line, text: text.chars().take(60).collect() }),
    }
}

fn klipper<'a>(lines: impl Iterator<Item = (usize, &'a str)>) -> Result<Record, RecordError> {
    let mut times: Vec<(usize, f64)> = Vec::new();
    let mut samples = Vec::new();
    for (line, text) in lines.filter(|(_, text)| !text.is_empty() && !text.starts_with('#')) {
        let [time_s, sample @ ..] = numbers(line, text)?;
        times.push((line, time_s));
        samples.push(sample);
    }
    let ([(_, begin_s), .., (_, end_s)], true) = (times.as_slice(), times.len() > 1) else {
        return Err(RecordError::Empty);
    };
    let usual_s = (end_s - begin_s) / (times.len() - 1) as f64;
    for pair in times.windows(2) {
        let ((_, before_s), (line, at_s)) = (pair[0], pair[1]);
        let interval_s = at_s - before_s;
        if !(interval_s > 0.0 && interval_s < GAP * usual_s) {
            return Err(RecordError::Gap { line, interval_s });
        }
    }
    Ok(Record::of(1.0 / usual_s, &samples))
}

fn reprapfirmware<'a>(lines: impl Iterator<Item = (usize, &'a str)>) -> Result<Record, RecordError> {
    let mut samples = Vec::new();
    let mut rate_hz = None;
    let is_answer = |text: &str| ANSWERS.iter().any(|answer| text.starts_with(answer));
    for (line, text) in lines.filter(|(_, text)| !text.is_empty()) {
        if let Some(reason) = text.strip_prefix(ENDED) {
            return Err(RecordError::Ended { line, reason: reason.chars().take(200).collect() });
        }
        if is_answer(text) {
            continue;
        }
        if let Some(rest) = text.strip_prefix("Rate ") {
            let (rate, overflows) = rest.split_once(", overflows ").unwrap_or((rest, "0"));
            let parsed =
                (rate.trim().parse::<f64>().ok().filter(|rate| *rate > 0.0), overflows.trim().parse::<u32>().ok());
            let (Some(rate), Some(overflows)) = parsed else {
                return Err(RecordError::Line { line, text: text.chars().take(60).collect() });
            };
            if overflows > 0 {
                return Err(RecordError::Overflows(overflows));
            }
            rate_hz = Some(rate);
            break;
        }
        let [number, sample @ ..] = numbers(line, text)?;
        if number != samples.len() as f64 {
            return Err(RecordError::Missing { line });
        }
        samples.push(sample.map(|gravities| gravities * GRAVITY_MM_PER_S2));
    }
    let rate_hz = rate_hz.ok_or(RecordError::NoRate)?;
    if samples.len() < 2 { Err(RecordError::Empty) } else { Ok(Record::of(rate_hz, &samples)) }
}
