//! `ferrostep import`: texts that are not a configuration of a known machine, and any text.

use ferrostep_import::{ImportError, of_text};
use proptest::prelude::*;

use crate::end_to_end::command::{Outcome, directory, ferrostep, file};

fn refused(text: &str) -> ImportError {
    of_text("printer.cfg", text, &mut |_| Err("none".to_owned())).unwrap_err()
}

#[test]
fn what_is_no_configuration_of_a_known_machine_is_refused_by_name() {
    for (text, expected) in [
        ("", "neither Klipper's printer.cfg"),
        ("[mcu]\nserial: x\n", "neither Klipper's printer.cfg"),
        (
            "[printer]\nkinematics: delta\n",
            "printer.cfg:2: kinematics: delta: profiles know cartesian, corexy and corexz",
        ),
        ("[printer]\nmax_velocity: 3\n", "printer.cfg:1: [printer] has no kinematics"),
        ("G28\n", "printer.cfg:1: \"G28\" is neither a section nor a setting"),
        ("a: 1\n", "printer.cfg:1: a setting before the first section"),
        ("[printer\n", "printer.cfg:1: a section without ]"),
        ("#define DELTA\n#define DEFAULT_AXIS_STEPS_PER_UNIT {1}\n", "printer.cfg:1: DELTA: profiles know"),
        ("#if 1\n#define DEFAULT_AXIS_STEPS_PER_UNIT {1}\n", "printer.cfg:1: this #if has no #endif"),
    ] {
        let said = refused(text).to_string();
        assert!(said.contains(expected), "{text:?}: {said}");
    }
    let directory = directory();
    let config = file(&directory, "printer.cfg", "[printer]\nkinematics: delta\n");
    let out = directory.path().join("out.toml");
    let outcome: Outcome = ferrostep(["import".as_ref(), config.as_os_str(), "-o".as_ref(), out.as_os_str()]);
    assert_eq!((outcome.status, out.exists()), (Some(2), false), "{outcome:#?}");
    assert_eq!(outcome.stderr.matches("printer.cfg").count(), 1, "the file is named once: {outcome:#?}");
    for mark in [[0xff, 0xfe], [0xfe, 0xff]] {
        let wide = file(&directory, "wide.cfg", [mark, *b"[\0"].concat());
        let outcome = ferrostep(["import".as_ref(), wide.as_os_str()]);
        assert_eq!(outcome.status, Some(2), "{outcome:#?}");
        assert!(outcome.stderr.contains("this is UTF-16 text: save it as UTF-8"), "{outcome:#?}");
    }
    let missing = ferrostep(["import", "no-such.cfg"]);
    assert!(missing.stderr.contains("no-such.cfg: cannot be read"), "{missing:#?}");
}

/// Pieces of configurations, put together in any order.
const PIECES: [&str; 30] = [
    "[printer]\nkinematics: cartesian\n",
    "[printer]\nkinematics: corexy\n",
    "[stepper_x]\n",
    "[stepper_z]\n",
    "[extruder]\n",
    "[heater_bed]\n",
    "[tmc2209 stepper_x]\n",
    "[probe]\n",
    "microsteps: ",
    "rotation_distance: ",
    "gear_ratio: ",
    "position_max: ",
    "position_min: ",
    "position_endstop: ",
    "endstop_pin: probe:z_virtual_endstop\n",
    "run_current: ",
    "max_velocity: ",
    "max_accel: ",
    "0\n",
    "-1e308\n",
    "1e-300\n",
    "nan\n",
    "50:0\n",
    "#define DEFAULT_AXIS_STEPS_PER_UNIT {A,A*A,1/0}\n",
    "#define A (A+A)\n",
    "#define COREXY\n",
    "#if ENABLED(A)\n",
    "#endif\n",
    "[include x]\n",
    "é: ü\n",
];

proptest! {
    /// Any text is a profile that passes its checks, or an error with a message.
    #[test]
    fn any_text_is_imported_or_refused(pieces in prop::collection::vec(prop::sample::select(&PIECES[..]), 0..40)) {
        let text = pieces.concat();
        let mut includes = 0;
        let imported = of_text("any", &text, &mut |_| { includes += 1; Ok(vec![("x".to_owned(), text.clone())]) });
        match imported {
            Ok(imported) => {
                prop_assert!(ferrostep_profiles::parse(&imported.profile, "any").is_ok());
                prop_assert!(imported.rows.iter().all(|row| row.kept.is_some() || !row.why.is_empty()));
            }
            Err(error) => prop_assert!(!error.to_string().is_empty()),
        }
        prop_assert!(includes < 200);
    }

    #[test]
    fn any_bytes_do_no_harm(text in ".{0,300}") {
        let _ = of_text("any", &text, &mut |_| Err("none".to_owned()));
        let _ = of_text("any", &format!("[printer]\nkinematics: corexy\n{text}"), &mut |_| Err("none".to_owned()));
        let marlin = format!("#define DEFAULT_AXIS_STEPS_PER_UNIT {{ 80, 80 }}\n#define X_MAX_POS {text}\n");
        let _ = of_text("any", &marlin, &mut |_| Err("none".to_owned()));
    }
}
