//! M569, M906, M913 and M914 of the second extruder's motor.

use ferrostep_tmc2209::{MOST_MOTORS, SECOND_EXTRUDER};

use super::*;
use crate::settings::profile::tools::FurtherTool;
use crate::settings::profile::tools::tests::{second, two as two_tools};

/// Two tools, and drivers of all motors.
fn two() -> (Rig, Bank<MOST_MOTORS>) {
    let rig = Rig::new(|profile| {
        usual(profile);
        profile.drivers = [Some(DRIVER); 4];
        profile.tools = two_tools(FurtherTool { driver: Some(DRIVER), ..second() });
    });
    (rig, Bank([const { Cell::new(DRIVER) }; MOST_MOTORS]))
}

fn currents(bank: &Bank<MOST_MOTORS>) -> [u16; 2] {
    [3, SECOND_EXTRUDER].map(|motor| bank.0[motor].get().current_ma)
}

#[test]
fn e_is_the_motor_of_the_tool() {
    let (rig, bank) = two();
    let mut printer = rig.printer();
    printer.set_drivers(&bank);
    for (line, currents_ma) in [
        ("M906 T1 E700", [350, 700]),
        ("M906 E400", [400, 700]),
        ("T1", [400, 700]),
        // Without T, the selected tool's motor.
        ("M906 E500", [400, 500]),
        ("M906 T0 E450", [450, 500]),
        // If one driver of a line cannot be set, or the tool does not exist, none of them changes.
        ("M906 T1 X600 E1000", [450, 500]),
        ("M906 T2 E300", [450, 500]),
        ("T0", [450, 500]),
        ("M906 X800", [450, 500]),
    ] {
        let is_refused = execute(&mut printer, line).is_err();
        assert_eq!(is_refused, line.contains("1000") || line.contains("T2"), "{line}");
        assert_eq!(currents(&bank), currents_ma, "{line}");
    }
    execute(&mut printer, "M569 S0 T1 E").unwrap();
    execute(&mut printer, "M914 T1 E7").unwrap();
    execute(&mut printer, "M913 T1 E25").unwrap();
    let [first, second] = [3, SECOND_EXTRUDER].map(|motor| bank.0[motor].get());
    assert_eq!((first.stealth_chop, first.stall_threshold), (true, 100));
    assert_eq!((second.stealth_chop, second.stall_threshold), (false, 7));
    assert_eq!([first, second].map(|driver| driver.spread_cycle_above_mm_per_s), [0, 25]);
}

#[test]
fn what_is_asked_for_without_a_tool_is_told_of_both() {
    let (rig, bank) = two();
    let mut printer = rig.printer();
    printer.set_drivers(&bank);
    execute(&mut printer, "M906 T1 E600").unwrap();
    for (line, expected) in [
        ("M906 T1", &["E1: 600"][..]),
        ("M569 E", &["E: stealth", "E1: stealth"]),
        ("M569 T0 E", &["E: stealth"]),
        ("M906", &["X: 350", "Y: 350", "Z: 350", "E: 350", "Z2: 350", "Z3: 350", "Z4: 350", "E1: 600"]),
        ("M122", &["X: ", "Y: ", "Z: ", "E: ", "Z2: ", "Z3: ", "Z4: ", "E1: "]),
    ] {
        rig.last_texts();
        execute(&mut printer, line).unwrap();
        let said = rig.last_texts();
        let said: Vec<&String> = said.iter().filter(|text| text.starts_with("echo:driver")).collect();
        assert_eq!(said.len(), expected.len(), "{line}: {said:?}");
        for (said, expected) in said.iter().zip(expected) {
            assert!(said.starts_with(&format!("echo:driver {expected}")), "{line}: {said}");
        }
    }
}

#[test]
fn current_and_choppers_of_t1_survive_the_power() {
    let (rig, bank) = two();
    let memory = Memory::new();
    {
        let mut printer = rig.printer();
        printer.set_drivers(&bank);
        printer.set_settings_memory(&memory);
        for line in ["M906 T1 E600", "M569 S0 T1 E", "M913 T1 E25", "M914 T1 E7", "M500"] {
            execute(&mut printer, line).unwrap();
        }
        rig.last_texts();
        execute(&mut printer, "M503 S0").unwrap();
        let said = rig.last_texts().join("\n");
        for line in ["M906 T1 E600", "M569 T1 E S0", "M913 T1 E25"] {
            assert!(said.contains(&format!("echo:  {line}")), "{said}");
        }
    }
    let (rig, bank) = two();
    let mut printer = rig.printer();
    printer.set_drivers(&bank);
    printer.set_settings_memory(&memory);
    printer.restore_settings();
    let second = bank.0[SECOND_EXTRUDER].get();
    // A stall threshold is only useful for homing axes.
    let expected = DriverSettings { current_ma: 600, stealth_chop: false, spread_cycle_above_mm_per_s: 25, ..DRIVER };
    assert_eq!(second, expected);
    assert_eq!(bank.0[3].get(), DRIVER);
    execute(&mut printer, "M502").unwrap();
    assert_eq!(bank.0[SECOND_EXTRUDER].get(), DRIVER);
    // A value that the board cannot make is replaced by the profile's.
    let memory = Memory::with(rig.printer().profile.name, &[("tools.t1.driver.current_ma", 0, 2000.0)]);
    printer.set_settings_memory(&memory);
    printer.restore_settings();
    assert_eq!(bank.0[SECOND_EXTRUDER].get(), DRIVER);
}

#[test]
fn of_one_tool_t1_has_no_effect() {
    let (rig, bank) = rig();
    let mut printer = rig.printer();
    printer.set_drivers(&bank);
    for line in ["M906 T1 X700 E700", "M569 S0 T1 E", "M913 T1 E25", "M914 T1 E7"] {
        execute(&mut printer, line).unwrap();
    }
    assert!(bank.0.iter().all(|driver| driver.get() == DRIVER));
    execute(&mut printer, "M906 T0 E700").unwrap();
    assert_eq!(bank.0[3].get().current_ma, 700);
}
