//! The conversions against the makers' tables.

use super::*;
use proptest::prelude::*;

/// 104GT by Semitec's table of resistances (GT thermistors, nominal values): degrees
/// Celsius and kilohms.
const SEMITEC_TABLE: [(f32, f32); 21] = [
    (-30.0, 2132.0),
    (-20.0, 1127.0),
    (-10.0, 620.0),
    (0.0, 353.7),
    (10.0, 208.6),
    (20.0, 126.8),
    (30.0, 79.36),
    (40.0, 50.96),
    (60.0, 22.51),
    (80.0, 10.80),
    (100.0, 5.556),
    (120.0, 3.043),
    (140.0, 1.758),
    (160.0, 1.064),
    (180.0, 0.6714),
    (200.0, 0.4393),
    (220.0, 0.2969),
    (240.0, 0.2065),
    (260.0, 0.1475),
    (280.0, 0.1079),
    (300.0, 0.08065),
];

/// B57560G104F by others' chart of its data sheet, in ohms: rounded, and smoothed between
/// the printed values.
const EPCOS_CHART: [(f32, f32); 7] = [
    (0.0, 333_964.0),
    (49.4667, 36_272.8),
    (100.7, 6263.39),
    (150.0, 1659.67),
    (200.267, 555.762),
    (250.533, 226.126),
    (300.0, 107.8),
];

/// A platinum resistor by the standard's table (IEC 60751, table 1, PT100 times ten): degrees
/// Celsius and ohms.
const PLATINUM_TABLE: [(f32, f32); 10] = [
    (-50.0, 803.1),
    (-20.0, 921.6),
    (0.0, 1000.0),
    (25.0, 1097.3),
    (50.0, 1194.0),
    (100.0, 1385.1),
    (200.0, 1758.6),
    (300.0, 2120.5),
    (400.0, 2470.9),
    (500.0, 2809.8),
];

/// The maker's 104GT through other points than the built-in ones.
fn through_the_table() -> ThermistorType {
    ThermistorType::through([40.0, 140.0, 260.0], [50_960.0, 1758.0, 147.5]).unwrap()
}

const FALLING: [ThermistorType; 4] = [
    ThermistorType::Semitec104Gt2,
    ThermistorType::Epcos100k,
    ThermistorType::Beta { r25_ohm: 100_000.0, beta_k: 3950.0 },
    ThermistorType::Beta { r25_ohm: 10_000.0, beta_k: 3435.0 },
];

fn on_usual_board(kind: ThermistorType) -> Thermistor {
    Thermistor { kind, pull_up_ohm: Thermistor::USUAL_PULL_UP_OHM }
}

#[test]
fn the_104gt_is_within_a_tenth_of_a_degree_of_its_table() {
    for (celsius, kilohm) in SEMITEC_TABLE {
        let converted = ThermistorType::Semitec104Gt2.celsius(kilohm * 1000.0);
        assert!((converted - celsius).abs() < 0.1, "{converted} at {celsius}");
    }
}

#[test]
fn the_epcos_keeps_its_data_sheet_and_is_near_its_chart() {
    let kind = ThermistorType::Epcos100k;
    for (celsius, ohm) in [(25.0, 100_000.0), (150.0, 1641.9), (250.0, 226.15)] {
        assert!((kind.celsius(ohm) - celsius).abs() < 0.01, "{} at {celsius}", kind.celsius(ohm));
    }
    // B25/100 = 4092 K.
    let beta_k = libm::logf(kind.ohm(25.0) / kind.ohm(100.0)) / (1.0 / NOMINAL_K - 1.0 / 373.15);
    assert!((beta_k - 4092.0).abs() < 4.0, "{beta_k}");
    for (celsius, ohm) in EPCOS_CHART {
        let converted = kind.celsius(ohm);
        assert!((converted - celsius).abs() < 0.75, "{converted} at {celsius}");
    }
}

#[test]
fn beta_is_its_definition() {
    // 100 kilohms, beta 3950 K: R(100) = 100k exp(3950 (1/373.15 - 1/298.15)) = 6975 ohms.
    let kind = ThermistorType::Beta { r25_ohm: 100_000.0, beta_k: 3950.0 };
    assert!((kind.celsius(100_000.0) - 25.0).abs() < 0.001);
    assert!((kind.ohm(100.0) - 6975.0).abs() < 1.0, "{}", kind.ohm(100.0));
    assert!((kind.celsius(6975.0) - 100.0).abs() < 0.01);
}

#[test]
fn platinum_is_within_a_tenth_of_a_degree_of_the_standards_table() {
    for (celsius, ohm) in PLATINUM_TABLE {
        let converted = ThermistorType::Pt1000.celsius(ohm);
        assert!((converted - celsius).abs() < 0.1, "{converted} at {celsius}");
        assert!((ThermistorType::Pt1000.ohm(celsius) - ohm).abs() < 0.2, "at {celsius}");
    }
    let sensor = on_usual_board(ThermistorType::Pt1000);
    assert!(sensor.can_tell(-50.0) && sensor.can_tell(500.0) && !sensor.can_tell(501.0));
    // A hotter sensor reads more, with no step of a reading wider than a sixteenth of a degree.
    for reading in sensor.reading(-50.0)..sensor.reading(500.0) {
        let step = sensor.celsius(reading + 1).unwrap() - sensor.celsius(reading).unwrap();
        assert!(step > 0.0 && step < 0.0625, "{step} at {reading}");
    }
}

#[test]
fn three_points_make_the_makers_curve() {
    for (celsius, kilohm) in SEMITEC_TABLE.into_iter().filter(|(celsius, _)| *celsius >= 0.0) {
        let converted = through_the_table().celsius(kilohm * 1000.0);
        assert!((converted - celsius).abs() < 0.3, "{converted} at {celsius}");
    }
    assert_eq!(through_the_table().highest_celsius(), 300.0);
    let hot = ThermistorType::through([25.0, 150.0, 450.0], [100_000.0, 1642.0, 13.0]).unwrap();
    assert_eq!(hot.highest_celsius(), 450.0);
}

#[test]
fn points_of_no_thermistor_are_refused() {
    let celsius = [25.0, 150.0, 250.0];
    for ohm in [
        [100_000.0, 100_000.0, 226.15],
        [226.15, 1641.9, 100_000.0],
        [1000.0, 1573.0, 1940.0],
        [100_000.0, 226.15, 1641.9],
        // Bent the other way.
        [100_000.0, 1000.0, 300.0],
        [f64::NAN, 1641.9, 226.15],
        [100_000.0, 1641.9, 0.0],
    ] {
        assert_eq!(ThermistorType::through(celsius, ohm), None, "{ohm:?}");
    }
}

#[test]
fn readings_at_the_ends_are_open_or_shorted() {
    for kind in FALLING.into_iter().chain([through_the_table(), ThermistorType::Pt1000]) {
        let thermistor = on_usual_board(kind);
        for open in [65_535, 65_520, OPEN] {
            assert_eq!(thermistor.celsius(open), Err(SensorError::Open));
        }
        for shorted in [0, 16, BLIND_END] {
            assert_eq!(thermistor.celsius(shorted), Err(SensorError::Shorted));
        }
        assert!(thermistor.celsius(OPEN - 1).is_ok() && thermistor.celsius(BLIND_END + 1).is_ok());
    }
}

#[test]
fn what_can_be_told_depends_on_the_resistor() {
    let usual = on_usual_board(ThermistorType::Semitec104Gt2);
    assert!(usual.can_tell(0.0) && usual.can_tell(300.0));
    assert!(!usual.can_tell(300.1), "beyond what it is made for");
    assert!(!usual.can_tell(-40.0), "4.2 megohms look like an open circuit");
    let large = Thermistor { pull_up_ohm: 100_000.0, ..usual };
    assert!(!large.can_tell(300.0), "81 ohms look like a short circuit");
    let small = Thermistor { pull_up_ohm: 100.0, ..usual };
    assert!(!small.can_tell(22.0), "116 kilohms look like an open circuit");
    for bad in [f32::NAN, f32::INFINITY] {
        assert!(!usual.can_tell(bad));
    }
}

proptest! {
    /// A temperature, converted to a reading and back, differs by at most the half step
    /// of the rounding.
    #[test]
    fn a_temperature_and_its_reading_are_one(
        kind in prop_oneof![
            proptest::sample::select(&FALLING),
            Just(through_the_table()),
            Just(ThermistorType::Pt1000),
        ],
        celsius in 0.0_f32..300.0,
    ) {
        let thermistor = on_usual_board(kind);
        let reading = thermistor.reading(celsius);
        let back = thermistor.celsius(reading).unwrap();
        let step = (thermistor.celsius(reading - 1).unwrap() - thermistor.celsius(reading + 1).unwrap()).abs();
        prop_assert!((back - celsius).abs() < step * 0.5 + 0.002, "{celsius} is read as {back}, steps of {step}");
    }

    /// Hotter is less: a higher reading is never a higher temperature.
    #[test]
    fn every_reading_has_an_answer_and_they_fall(kind in proptest::sample::select(&FALLING), reading in 0..u16::MAX) {
        let thermistor = on_usual_board(kind);
        if let (Ok(hotter), Ok(colder)) = (thermistor.celsius(reading), thermistor.celsius(reading + 1)) {
            prop_assert!(hotter.is_finite() && hotter >= colder - 1e-4);
        }
    }
}
