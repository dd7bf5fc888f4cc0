//! Reports of Marlin's versions, and texts that are not reports.

use super::*;

fn report(settings: &[&str]) -> Result<Definitions, String> {
    let mut definitions = Definitions::default();
    let settings: Vec<String> = settings.iter().map(|line| (*line).to_owned()).collect();
    add(
        &["FIRMWARE_NAME:Marlin 2.1.2 (Jan  1 2024 10:00:00) MACHINE_TYPE:My printer EXTRUDER_COUNT:1".to_owned()],
        &settings,
        &mut definitions,
    )
    .map(|()| definitions)
}

#[track_caller]
fn says(settings: &[&str], expected: &[(&str, &str)]) {
    let definitions = report(settings).unwrap();
    for (name, value) in expected {
        assert_eq!(definitions.get(name).map(|definition| definition.value.as_str()), Some(*value), "{name}");
    }
}

#[test]
fn reports_of_all_ages_are_read() {
    says(
        &[
            "echo:Steps per unit:",
            "echo:  M92 X80.00 Y80.00 Z400.50 E94.30",
            "echo:  M203 X450.00 Y450.00 Z5.00 E25.00",
            "echo:Acceleration: S=acceleration, T=retract acceleration",
            "echo:  M204 S1000.00 T800.00",
            "echo:  M205 S0.00 T0.00 B20000 X8.00 Z0.40 E1.00",
            "echo:   M301 P33.41 I1.47 D189.27",
            "echo:   M851 Z-1.56",
        ],
        &[
            ("DEFAULT_AXIS_STEPS_PER_UNIT", "{ 80, 80, 400.5, 94.3 }"),
            ("DEFAULT_MAX_FEEDRATE", "{ 450, 450, 5, 25 }"),
            ("DEFAULT_ACCELERATION", "1000"),
            ("DEFAULT_TRAVEL_ACCELERATION", "1000"),
            ("DEFAULT_RETRACT_ACCELERATION", "800"),
            ("DEFAULT_XJERK", "8"),
            ("CLASSIC_JERK", ""),
            ("DEFAULT_KP", "33.41"),
            ("NOZZLE_TO_PROBE_OFFSET", "{ not_said, not_said, -1.56 }"),
            ("CUSTOM_MACHINE_NAME", "My printer"),
        ],
    );
    says(
        &[
            "G21    ; Units in mm (mm)",
            "  M92 X80.00 Y80.00 Z400.00",
            "  M92 T0 E93.00",
            "  M92 T1 E94.00",
            "  M204 P500.00 R1000.00 T1500.00",
            "  M205 B20000.00 S0.00 T0.00 J0.01 E5.00",
            "  M211 S1 ; ON",
            "  Min:  X-1.00 Y0.00 Z0.00   Max:  X235.00 Y230.00 Z250.00",
            "  M301 E0 P21.73 I1.54 D76.55",
            "  M301 E1 P30.00 I1.00 D70.00",
            "  M593 X F40.00 D0.15",
            "  M593 Y F37.50 D0.10",
            "  M906 X580 Y580 Z580",
            "  M906 T0 E650",
            "  M906 I1 Z600",
            "  M207 S3.00 W13.00 F2700.00 Z0.20",
            "  M218 T1 X18.20 Y0.10 Z0.00",
        ],
        &[
            ("DEFAULT_AXIS_STEPS_PER_UNIT", "{ 80, 80, 400, 93 }"),
            ("DEFAULT_TRAVEL_ACCELERATION", "1500"),
            ("JUNCTION_DEVIATION_MM", "0.01"),
            ("DEFAULT_EJERK", "5"),
            ("X_MIN_POS", "-1"),
            ("Z_MAX_POS", "250"),
            ("DEFAULT_KI", "1.54"),
            ("SHAPING_FREQ_X", "40"),
            ("SHAPING_ZETA_Y", "0.1"),
            ("Z_CURRENT", "580"),
            ("E0_CURRENT", "650"),
            ("RETRACT_FEEDRATE", "45"),
            ("HOTEND_OFFSET_X", "{ 0.0, 18.2 }"),
        ],
    );
}

#[test]
fn the_travel_is_that_of_m115_before_that_of_m211() {
    let mut definitions = Definitions::default();
    let area = "area:{full:{min:{x:-3.0000,y:0.0000,z:0.0000},max:{x:220.0000,y:221.5000,z:250.0000}},work:{min:{x:0,y:0,z:0},max:{x:1,y:1,z:1}}}";
    let lines = |lines: &[&str]| lines.iter().map(|line| (*line).to_owned()).collect::<Vec<_>>();
    let settings = lines(&["M92 X80 Y80 Z400 E93", "Min: X1 Y1 Z1   Max: X9 Y9 Z9"]);
    add(&lines(&["FIRMWARE_NAME:Marlin", area]), &settings, &mut definitions).unwrap();
    let value = |name: &str| definitions.get(name).unwrap().value.clone();
    assert_eq!(
        (value("X_MIN_POS"), value("Y_MAX_POS"), value("Z_MAX_POS")),
        ("-3".into(), "221.5".into(), "250".into())
    );
}

#[test]
fn what_is_no_report_is_refused() {
    for (settings, expected) in [
        (&["echo:Unknown command: \"M503\""][..], "DISABLE_M503"),
        (&[], "no steps per millimetre (M92), 0 lines"),
        (&["T:20.0 /0.0"], "no steps per millimetre"),
        (&["  G20 ; Units in inches", "  M92 X2032.00 Y2032.00 Z2.00 E2.00"], "send it G21"),
    ] {
        let error = report(settings).unwrap_err();
        assert!(error.contains(expected), "{settings:?}: {error}");
    }
    for (name, expected) in [
        ("Klipper", "--moonraker"),
        ("RepRapFirmware for Duet 2 WiFi/Ethernet", "config.g"),
        ("Ferrostep 0.2", "its image was built from a profile"),
    ] {
        let about = [format!("FIRMWARE_NAME:{name} FIRMWARE_VERSION: 3.4")];
        let error = add(&about, &[], &mut Definitions::default()).unwrap_err();
        assert!(error.contains(expected) && error.contains(name), "{error}");
    }
}
