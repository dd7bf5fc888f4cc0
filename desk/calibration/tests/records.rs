//! Tests the modes found in records that are generated from a known frame, noise and drift.
#![allow(clippy::unwrap_used)]

use std::f64::consts::TAU;
use std::fmt::Write as _;

use ferrostep_calibration::{Choice, Mode, ModeError, Record, RecordError, Spectrum, SpectrumError, compare};
use ferrostep_random_cases::share_of;
use proptest::prelude::*;

/// Frame, accelerometer, and kind of excitation.
#[derive(Clone, Copy, Debug)]
struct Case {
    frequency_hz: f64,
    damping: f64,
    /// True to add a second mode at 1.7 times the frequency with a quarter of the motion.
    second: bool,
    rate_hz: f64,
    /// Standard deviation of the noise, mm/s^2.
    noise: f64,
    /// Drift of the zero over the record, mm/s^2.
    drift: f64,
    /// True for a sweep; false for random stops, as RepRapFirmware records them.
    sweep: bool,
    seed: u64,
}

/// Pseudo-random numbers (Marsaglia 2003).
struct Random(u64);

impl Random {
    fn share(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Returns a number from a normal distribution (Box and Muller 1958).
    fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.share()).ln()).sqrt() * (TAU * self.share()).cos()
    }
}

/// Mass on a spring and a damper whose other end is moved; computes the mass's acceleration.
struct Spring {
    omega: f64,
    damping: f64,
    /// Position and speed of the mass relative to the machine's.
    state: [f64; 2],
}

impl Spring {
    fn next(&mut self, acceleration: f64, interval_s: f64) -> f64 {
        // Eight small steps, each of second order (velocity Verlet).
        let mut of_mass = 0.0;
        for _ in 0..8 {
            let h = interval_s / 8.0;
            let force =
                |[place, speed]: [f64; 2]| -2.0 * self.damping * self.omega * speed - self.omega.powi(2) * place;
            let [place, speed] = self.state;
            let middle = [place + 0.5 * h * speed, speed + 0.5 * h * (force(self.state) - acceleration)];
            self.state = [place + h * middle[1], speed + h * (force(middle) - acceleration)];
            of_mass = force(self.state);
        }
        of_mass
    }
}

/// Records the acceleration of X; Y and Z have a twentieth of it, and all have noise.
fn record(case: &Case) -> Record {
    let mut random = Random(case.seed | 1);
    let interval_s = 1.0 / case.rate_hz;
    let spring = |part: f64| Spring { omega: TAU * case.frequency_hz * part, damping: case.damping, state: [0.0; 2] };
    let (mut first, mut second) = (spring(1.0), spring(1.7));
    let (begin_hz, end_hz) = (5.0, 135.0);
    let duration_s = if case.sweep { end_hz - begin_hz } else { 40.0 };
    let count = (duration_s * case.rate_hz) as usize;
    let (mut phase, mut acceleration, mut change_s) = (0.0f64, 0.0, 0.0);
    let mut axes = [Vec::with_capacity(count), Vec::new(), Vec::new()];
    for at in 0..count {
        let time_s = at as f64 * interval_s;
        if case.sweep {
            // Klipper's test: one hertz per second, with an acceleration proportional to the
            // frequency.
            let frequency_hz = begin_hz + time_s;
            phase += TAU * frequency_hz * interval_s;
            acceleration = 60.0 * frequency_hz * phase.sin();
        } else if time_s >= change_s {
            // Moves to and fro, each with one of three accelerations.
            acceleration = 5000.0 * [-1.0, 0.0, 1.0][(random.share() * 3.0) as usize];
            change_s = time_s + 0.02 + 0.2 * random.share();
        }
        let mass = first.next(acceleration, interval_s);
        let mass = if case.second { 0.8 * mass + 0.2 * second.next(acceleration, interval_s) } else { mass };
        let drift = case.drift * time_s / duration_s;
        axes[0].push(mass + drift + case.noise * random.normal());
        axes[1].push(0.05 * mass - drift + case.noise * random.normal());
        axes[2].push(9800.0 + 0.05 * mass + case.noise * random.normal());
    }
    Record { rate_hz: case.rate_hz, acceleration_mm_per_s2: axes }
}

fn mode(case: &Case) -> Mode {
    Mode::of(&Spectrum::of(&record(case), 0).unwrap()).unwrap()
}

/// Returns a hundred frames from a fixed seed.
fn cases(sweep: bool, second: bool) -> Vec<Case> {
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    let mut between = |low: f64, high: f64| low + (high - low) * random.share();
    (1..=100)
        .map(|number| Case {
            frequency_hz: between(22.0, 100.0),
            damping: between(0.03, 0.15),
            second,
            rate_hz: if sweep { between(3100.0, 3300.0) } else { between(1300.0, 1400.0) },
            noise: between(20.0, 400.0),
            drift: between(0.0, 1000.0),
            sweep,
            seed: number * 0x1234_5677,
        })
        .collect()
}

/// Returns the largest error of the frequency in this run's share of the frames. At most one
/// frequency and one damping in twenty may lie outside their intervals.
fn judge(cases: &[Case]) -> f64 {
    let (mut worst_hz, mut tried, mut within, mut damping_within) = (0.0f64, 0, 0, 0);
    for number in share_of(cases.len() as u64) {
        let case = &cases[number as usize];
        tried += 1;
        let mode = mode(case);
        let error_hz = (mode.frequency_hz - case.frequency_hz).abs();
        worst_hz = worst_hz.max(error_hz);
        within += usize::from(error_hz <= mode.frequency_uncertainty_hz);
        damping_within += usize::from((mode.damping - case.damping).abs() <= mode.damping_uncertainty);
        if std::env::var_os("FERROSTEP_SHOW").is_some() {
            println!("{case:?} {mode:?}");
        }
    }
    println!("worst {worst_hz:.3} Hz, {within} and {damping_within} of {tried} within");
    let enough = tried - usize::div_ceil(tried, 20);
    assert!(within >= enough && damping_within >= enough, "{within}, {damping_within} of {tried}");
    worst_hz
}

#[test]
fn a_sweep_shows_the_frequency_within_half_a_hertz_and_says_how_well() {
    let worst_hz = judge(&cases(true, false));
    assert!(worst_hz < 0.5, "{worst_hz}");
}

#[test]
fn a_second_mode_leaves_the_first_where_it_is() {
    let worst_hz = judge(&cases(true, true));
    assert!(worst_hz < 0.5, "{worst_hz}");
}

#[test]
fn moves_to_and_fro_show_it_too() {
    // Random moves excite the frame's frequency less often than a sweep does.
    let worst_hz = judge(&cases(false, false));
    assert!(worst_hz < 2.0, "{worst_hz}");
}

/// Formats a record as Klipper does.
fn klippers(record: &Record) -> String {
    let [x, y, z] = &record.acceleration_mm_per_s2;
    let mut text = "#time,accel_x,accel_y,accel_z\n".to_owned();
    for (at, ((x, y), z)) in x.iter().zip(y).zip(z).enumerate() {
        writeln!(text, "{:.6},{x:.6},{y:.6},{z:.6}", 1000.0 + at as f64 / record.rate_hz).unwrap();
    }
    text
}

/// Formats a record as RepRapFirmware does.
fn reprapfirmwares(record: &Record) -> String {
    let [x, y, z] = &record.acceleration_mm_per_s2;
    let mut text = "Sample,X,Y,Z\n".to_owned();
    for (at, ((x, y), z)) in x.iter().zip(y).zip(z).enumerate() {
        writeln!(text, "{at},{:.6},{:.6},{:.6}", x / 9806.65, y / 9806.65, z / 9806.65).unwrap();
    }
    writeln!(text, "Rate {}, overflows 0", record.rate_hz).unwrap();
    text
}

const USUAL: Case = Case {
    frequency_hz: 48.0,
    damping: 0.06,
    second: false,
    rate_hz: 3200.0,
    noise: 100.0,
    drift: 300.0,
    sweep: true,
    seed: 7,
};

#[test]
fn both_firmwares_files_say_the_same() {
    let record = record(&USUAL);
    let (klippers, reprapfirmwares) =
        (Record::parse(&klippers(&record)).unwrap(), Record::parse(&reprapfirmwares(&record)).unwrap());
    assert_eq!(klippers.len(), record.len());
    for read in [&klippers, &reprapfirmwares] {
        assert!((read.rate_hz / record.rate_hz - 1.0).abs() < 1e-6, "{}", read.rate_hz);
        let (made, found) = (mode(&USUAL), Mode::of(&Spectrum::of(read, 0).unwrap()).unwrap());
        assert!((made.frequency_hz - found.frequency_hz).abs() < 1e-3, "{made:?} {found:?}");
    }
}

/// A stiff frame with little damping needs no long shaper; the recommendation follows from the
/// table by its rule.
#[test]
fn the_shaper_to_take_leaves_little_and_rounds_least() {
    for case in [USUAL, Case { second: true, ..USUAL }, Case { frequency_hz: 30.0, damping: 0.12, ..USUAL }] {
        let spectrum = Spectrum::of(&record(&case), 0).unwrap();
        let mode = Mode::of(&spectrum).unwrap();
        let comparison = compare(Some(&spectrum), &mode);
        assert_eq!(comparison.scores.len(), 7);
        let taken = &comparison.scores[comparison.choice.index()];
        assert!((0.9..1.5).contains(&(taken.frequency_hz / case.frequency_hz)), "{taken:?}");
        for score in &comparison.scores {
            match comparison.choice {
                Choice::RoundsLeast(_) => assert!(
                    taken.left <= 0.05 && (score.left > 0.05 || score.rounding_s2 >= taken.rounding_s2),
                    "{comparison:?}"
                ),
                Choice::LeavesLeast(_) => assert!(score.left > 0.05 && score.left >= taken.left, "{comparison:?}"),
            }
        }
    }
}

#[test]
fn waves_on_a_print_are_a_mode() {
    // Five waves over 10 mm at 100 mm/s, read to 0.3 mm.
    let mode = Mode::of_waves(5.0, 10.0, 0.3, 100.0).unwrap();
    assert_eq!(mode.frequency_hz, 50.0);
    assert!((mode.frequency_uncertainty_hz - 1.5).abs() < 1e-9, "{mode:?}");
    let comparison = compare(None, &mode);
    assert!((comparison.change - 0.03).abs() < 1e-9);
    let Choice::RoundsLeast(index) = comparison.choice else { panic!("{comparison:?}") };
    assert!((45.0..56.0).contains(&comparison.scores[index].frequency_hz), "{comparison:?}");
    for (waves, over_mm, reading_mm, speed) in [
        (0.0, 10.0, 0.3, 100.0),
        (5.0, 0.0, 0.3, 100.0),
        (5.0, 10.0, 10.0, 100.0),
        (5.0, 10.0, 0.3, f64::NAN),
        (5.0, 10.0, 0.3, 1.0),
    ] {
        assert_eq!(Mode::of_waves(waves, over_mm, reading_mm, speed), Err(ModeError::Waves));
    }
}

#[test]
fn records_that_tell_nothing_are_refused_by_name() {
    let parse = |text: &str| Record::parse(text).unwrap_err();
    let header = "#time,accel_x,accel_y,accel_z";
    for (text, error) in [
        ("", RecordError::Unknown { first_line: String::new() }),
        ("freq,psd_x\n1,2", RecordError::Unknown { first_line: "freq,psd_x".to_owned() }),
        (&format!("{header}\n0,1,2,3\n0.1,1,x,3"), RecordError::Line { line: 3, text: "0.1,1,x,3".to_owned() }),
        (&format!("{header}\n0,1,2,3\n0.1,1,2"), RecordError::Line { line: 3, text: "0.1,1,2".to_owned() }),
        (&format!("{header}\n0,1,2,NaN"), RecordError::Line { line: 2, text: "0,1,2,NaN".to_owned() }),
        (&format!("{header}\n0,1,2,3"), RecordError::Empty),
        (&format!("{header}\n0,1,2,3\n1,1,2,3\n2,1,2,3\n1.5,1,2,3"), RecordError::Gap { line: 5, interval_s: -0.5 }),
        ("Sample,X,Y,Z\n0,0,0,1\n1,0,0,1", RecordError::NoRate),
        ("Sample,X,Y,Z\n0,0,0,1\nRate 1344, overflows 3", RecordError::Overflows(3)),
        ("Sample,X,Y,Z\n0,0,0,1\nok\n2,0,0,1\nRate 1344, overflows 0", RecordError::Missing { line: 4 }),
        (
            "Sample,X,Y,Z\n0,0,0,1\necho:record ended: its lines were not read, send M956 again\nok",
            RecordError::Ended { line: 3, reason: "its lines were not read, send M956 again".to_owned() },
        ),
        ("start\nSample,X,Y,Z\n0,0,0,1\nBusy\n", RecordError::Line { line: 4, text: "Busy".to_owned() }),
    ] {
        assert_eq!(parse(text), error, "{text}");
    }
    let still =
        Record { rate_hz: 1000.0, acceleration_mm_per_s2: [vec![0.0; 4000], vec![0.0; 4000], vec![9800.0; 4000]] };
    assert_eq!(Spectrum::of(&still, 0), Err(SpectrumError::Still));
    let cut = |rate_hz: f64, count: usize| Record {
        rate_hz,
        acceleration_mm_per_s2: record(&USUAL).acceleration_mm_per_s2.map(|axis| axis[..count].to_vec()),
    };
    assert_eq!(Spectrum::of(&cut(200.0, 4000), 0), Err(SpectrumError::Rate(200.0)));
    assert_eq!(Spectrum::of(&cut(3200.0, 3200), 0), Err(SpectrumError::Duration(1.0)));
    let other = Spectrum::of(&record(&USUAL), 1).unwrap_err();
    assert!(matches!(other, SpectrumError::OtherAxis { axis: 'Y', strongest: 'X', .. }), "{other:?}");
    let mut random = Random(5);
    let noise = Record {
        rate_hz: 1000.0,
        acceleration_mm_per_s2: [0; 3].map(|_| (0..20_000).map(|_| 100.0 * random.normal()).collect()),
    };
    assert_eq!(Mode::of(&Spectrum::of(&noise, 0).unwrap()), Err(ModeError::NoPeak));
}

proptest! {
    /// Any text is read or refused, without a panic.
    #[test]
    fn any_text_is_read_or_refused(
        header in prop::sample::select(vec!["#time,accel_x,accel_y,accel_z\n", "Sample,X,Y,Z\n", ""]),
        body in "([0-9.eE+,-]{0,24}\n|Rate [0-9.]{0,5}, overflows [0-9]{0,3}\n|.{0,20}\n){0,40}",
    ) {
        if let Ok(record) = Record::parse(&format!("{header}{body}"))
            && let Ok(spectrum) = Spectrum::of(&record, 0)
        {
            let _ = Mode::of(&spectrum);
        }
    }

    /// A printer's answers between the lines of a record change nothing; a missing, doubled or
    /// swapped line is detected.
    #[test]
    fn a_log_is_the_record_in_it_or_refused(
        samples in prop::collection::vec(prop::array::uniform3(-16.0..16.0_f64), 2..40),
        answers in prop::collection::vec((0_usize..60, prop::sample::select(vec!["ok", "echo:busy: processing", "// note", "T:20.0 /0.0", ""])), 0..8),
        damaged in 0_usize..40,
    ) {
        let lines: Vec<String> =
            samples.iter().enumerate().map(|(number, [x, y, z])| format!("{number},{x:.5},{y:.5},{z:.5}")).collect();
        let text = |lines: &[String]| format!("start\nSample,X,Y,Z\n{}\nRate 800, overflows 0\nok\n", lines.join("\n"));
        let clean = Record::parse(&text(&lines)).unwrap();
        prop_assert_eq!(clean.len(), samples.len());
        let mut log = lines.clone();
        for (place, answer) in answers {
            log.insert(place.min(log.len()), answer.to_owned());
        }
        prop_assert_eq!(Record::parse(&text(&log)), Ok(clean));
        let at = damaged % lines.len();
        let (mut missing, mut doubled, mut swapped) = (lines.clone(), lines.clone(), lines.clone());
        missing.remove(at);
        doubled.insert(at, lines[at].clone());
        swapped.swap(at, (at + 1) % lines.len());
        // A record without its last sample is shorter but consistent; the printer's `overflows`
        // reports the loss.
        for (log, is_shorter) in [(missing, at + 1 == lines.len()), (doubled, false), (swapped, false)] {
            let read = Record::parse(&text(&log));
            prop_assert!(is_shorter || matches!(read, Err(RecordError::Missing { .. })), "{read:?}");
        }
    }

    /// No samples, however extreme, cause a panic.
    #[test]
    fn any_samples_have_a_mode_or_none(
        rate_hz in 500.0..10_000.0_f64,
        samples in prop::collection::vec(prop::sample::select(vec![0.0, 1.0, -1.0, 1e9, -1e9, 1e-9, 1e300]), 8..400),
        repeats in 1_usize..200,
    ) {
        let axis: Vec<f64> = samples.iter().copied().cycle().take(samples.len() * repeats).collect();
        let record = Record { rate_hz, acceleration_mm_per_s2: [axis.clone(), axis.clone(), axis] };
        if let Ok(spectrum) = Spectrum::of(&record, 0)
            && let Ok(mode) = Mode::of(&spectrum)
        {
            let comparison = compare(Some(&spectrum), &mode);
            prop_assert!(comparison.scores.is_empty() || comparison.choice.index() < comparison.scores.len());
        }
    }
}
