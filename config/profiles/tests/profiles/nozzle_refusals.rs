//! The refusal of a nozzle's thermistor, and of a watch without effect.

use ferrostep_printer::{HeaterWatch, Profile};
use ferrostep_profiles::{Problem, ProfileError, parse};
use ferrostep_thermistor::ThermistorType;

use super::refusals::{line, text};

/// The cartesian profile with lines added to its nozzle.
fn with_nozzle(lines: &str) -> Result<Profile, ProfileError> {
    parse(&text().replace("[nozzle]\n", &format!("[nozzle]\n{lines}\n")), "test.toml")
}

/// The cartesian profile with this in place of its nozzle's thermistor.
fn with_sensor(lines: &str) -> Result<Profile, ProfileError> {
    parse(&text().replace("sensor = \"semitec-104gt-2\"", lines), "test.toml")
}

#[test]
fn a_sensor_is_a_name_or_numbers_of_a_data_sheet() {
    let kind = |lines| with_sensor(lines).unwrap().nozzle.thermistor.kind;
    assert_eq!(kind("sensor = \"semitec-104gt-2\""), ThermistorType::Semitec104Gt2);
    assert_eq!(kind("sensor = \"epcos-100k\""), ThermistorType::Epcos100k);
    assert_eq!(kind("sensor = \"pt1000\""), ThermistorType::Pt1000);
    let (celsius, ohm) = ([25.0, 150.0, 250.0], [100_000.0, 1642.0, 226.2]);
    let points = ThermistorType::through(celsius, ohm).unwrap();
    assert_eq!(kind("sensor = { celsius = [25, 150, 250], ohm = [100000, 1642, 226.2] }"), points);
    let beta = ThermistorType::Beta { r25_ohm: 100_000.0, beta_k: 3950.0 };
    assert_eq!(kind("sensor = { r25_ohm = 100000, beta_k = 3950 }"), beta);
    assert_eq!(kind("sensor.r25_ohm = 1e5\nsensor.beta_k = 3950.0"), beta);

    let nozzle = line("[nozzle]") + 1;
    for (lines, message) in [
        (
            "sensor = \"semitec\"",
            "nozzle.sensor = \"semitec\": expected \"semitec-104gt-2\", \"epcos-100k\" or \"pt1000\" or a table such as \
             { r25_ohm = 100000, beta_k = 3950 }",
        ),
        (
            "sensor = 5",
            "nozzle.sensor = 5: expected \"semitec-104gt-2\", \"epcos-100k\" or \"pt1000\" or a table such as \
             { r25_ohm = 100000, beta_k = 3950 }",
        ),
        ("sensor = { r25_ohm = 100000 }", "missing key \"nozzle.sensor.beta_k\", expected 2000 to 6000 K"),
        (
            "sensor = { beta = 3950, r25_ohm = 100000 }",
            "unknown key \"nozzle.sensor.beta\", expected \"celsius\", \"ohm\", \"r25_ohm\" or \"beta_k\"",
        ),
        ("sensor = { beta_k = 395, r25_ohm = 100000 }", "nozzle.sensor.beta_k = 395: expected 2000 to 6000 K"),
        ("sensor = { beta_k = 3950, r25_ohm = nan }", "nozzle.sensor.r25_ohm = nan: expected 1000 to 1000000 ohms"),
        (
            "sensor = { beta_k = \"x\", r25_ohm = 1000 }",
            "nozzle.sensor.beta_k = \"x\": expected a number from 2000 to 6000 K",
        ),
        (
            "sensor = { celsius = [25, 150, 250] }",
            "nozzle.sensor.celsius = [25, 150, 250]: expected ohm with it: three resistances, such as \
             [100000, 1642, 226.2]",
        ),
        (
            "sensor = { ohm = [100000, 1642, 226.2] }",
            "nozzle.sensor.ohm = [100000, 1642, 226.2]: expected celsius with it: three temperatures, such as \
             [25, 150, 250]",
        ),
        (
            "sensor = { celsius = [25, 150], ohm = [100000, 1642, 226.2] }",
            "nozzle.sensor.celsius = [25, 150]: expected 3 numbers within -50 to 500 degrees Celsius, such as [25, 150, 250]",
        ),
        (
            "sensor = { celsius = [150, 25, 250], ohm = [100000, 1642, 226.2] }",
            "nozzle.sensor.celsius = [150, 25, 250]: expected three rising temperatures",
        ),
        (
            "sensor = { celsius = [25, 150, 250], ohm = [226.2, 1642, 100000] }",
            "nozzle.sensor.ohm = [226.2, 1642, 100000]: expected three resistances that fall as a thermistor's do; or \
             r25_ohm and beta_k",
        ),
    ] {
        assert_eq!(with_sensor(lines).unwrap_err().to_string(), format!("test.toml:{nozzle}: {message}"));
    }
}

#[test]
fn limits_are_what_the_thermistor_can_read() {
    assert_eq!(with_nozzle("pull_up_ohm = 1000").unwrap().nozzle.thermistor.pull_up_ohm, 1000.0);
    let hot = text().replace("max_celsius = 275", "max_celsius = 301");
    assert_eq!(
        parse(&hot, "test.toml").unwrap_err().to_string(),
        format!(
            "test.toml:{}: nozzle.max_celsius = 301: expected -25 to 300 degrees Celsius, what nozzle.sensor can read \
             with pull_up_ohm = 4700",
            line("max_celsius = 275")
        )
    );
    // Platinum is read to the highest temperature of a nozzle.
    let platinum =
        text().replace("\"semitec-104gt-2\"", "\"pt1000\"").replace("max_celsius = 275", "max_celsius = 500");
    assert_eq!(parse(&platinum, "test.toml").unwrap().nozzle.max_celsius, 500.0);
    // 130 ohms at 275 degrees count as a short beside 100 kilohms, and 275 kilohms at 5 degrees as
    // an open circuit beside 100 ohms.
    assert_eq!(with_nozzle("pull_up_ohm = 100000").unwrap_err().key(), Some("nozzle.max_celsius"));
    assert_eq!(with_nozzle("pull_up_ohm = 100").unwrap_err().key(), Some("nozzle.min_celsius"));
    assert_eq!(with_nozzle("pull_up_ohm = 99").unwrap_err().key(), Some("nozzle.pull_up_ohm"));
    let cold = text().replacen("min_celsius = 5", "min_celsius = -50", 1);
    assert_eq!(parse(&cold, "test.toml").unwrap_err().key(), Some("nozzle.min_celsius"));
}

#[test]
fn the_watch_may_be_changed_but_not_away() {
    let watch =
        with_nozzle("watch_s = 30\nwatch_celsius = 3\nrunaway_s = 25.5\nrunaway_celsius = 2.3").unwrap().nozzle.watch;
    let expected = HeaterWatch { watch_ms: 30_000, watch_celsius: 3.0, runaway_ms: 25_500, runaway_celsius: 2.3 };
    assert_eq!(watch, expected);
    for key in ["watch_s", "watch_celsius", "runaway_s", "runaway_celsius"] {
        for bad in ["0", "-1", "0.9", "121", "1e9", "nan", "inf"] {
            let error = with_nozzle(&format!("{key} = {bad}")).unwrap_err();
            let blamed = format!("nozzle.{key}");
            assert!(matches!(error.problem(), Problem::OutOfRange { key, .. } if *key == blamed), "{error}");
            assert_eq!(error.line(), Some(line("[nozzle]") + 1), "{error}");
        }
    }
    // A window of 1 degree around the target would reach beyond the range of the runaway check.
    let wide = text().replacen("residency_window_celsius = 1", "residency_window_celsius = 5", 1);
    assert_eq!(
        parse(&wide, "test.toml").unwrap_err().to_string(),
        format!(
            "test.toml:{}: nozzle.residency_window_celsius = 5: expected at most nozzle.runaway_celsius = 4",
            line("residency_window_celsius = 1")
        )
    );
    let widest = text().replacen("residency_window_celsius = 1", "residency_window_celsius = 4", 1);
    assert_eq!(parse(&widest, "test.toml").unwrap().nozzle.residency_window_celsius, 4.0);
}
