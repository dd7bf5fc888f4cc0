//! M306, and the gain commands beside a model, on a machine whose heaters are models.

mod second_nozzle;

use std::string::String;
use std::vec;
use std::vec::Vec;

use ferrostep_hal_shim::Heater;

use crate::commands::tuning::tests::{World, execute, say};
use crate::heat::model::HeaterModel;

const MODEL: HeaterModel = HeaterModel {
    power_w: 40.0,
    capacity_j_per_k: 16.7,
    loss_w_per_k: 0.068,
    fanned_loss_w_per_k: 0.097,
    sensor_per_s: 0.22,
    filament_j_per_k_mm: 0.0056,
};

/// A model controls the nozzle, a PID loop the bed.
fn world() -> World {
    let world = World::new();
    world.set_model(Heater::Nozzle, MODEL);
    world
}

#[test]
fn m306_reports_and_sets_marlins_constants() {
    let world = world();
    assert_eq!(say(&world, "M306"), ["echo:M306 E0 P40 C16.7 R0.22 A0.068 F0.097 H0.0056", "ok"]);
    assert_eq!(say(&world, "M306 E0 P50 C11.5 R0.4"), ["ok"]);
    assert_eq!(say(&world, "M306 A0.05 F0.08 H0"), ["ok"]);
    assert_eq!(say(&world, "M306 E0"), ["echo:M306 E0 P50 C11.5 R0.4 A0.05 F0.08 H0", "ok"]);
    let bed = HeaterModel { fanned_loss_w_per_k: 1.1, loss_w_per_k: 1.1, filament_j_per_k_mm: 0.0, ..MODEL };
    world.set_model(Heater::Bed, bed);
    assert_eq!(say(&world, "M306 E-1 A1.2"), ["ok"]);
    assert_eq!(say(&world, "M306 E-1"), ["echo:M306 E-1 P40 C16.7 R0.22 A1.2", "ok"]);
    assert_eq!(world.model(Heater::Bed).unwrap().fanned_loss_w_per_k, 1.2, "no fan blows at the bed");
}

#[test]
fn absurd_constants_are_refused_by_name_and_nothing_changes() {
    let world = world();
    for (line, why) in [
        ("M306 P0", "P: 0 is out of range, expected 1 to 3000"),
        ("M306 P50 C0", "C: 0 is out of range, expected 1 to 20000"),
        ("M306 P50 C-5", "C: -5 is out of range, expected 1 to 20000"),
        ("M306 P50 R0", "R: 0 is out of range, expected 0.01 to 5"),
        ("M306 P50 A0", "A: 0 is out of range, expected 0.001 to 100"),
        ("M306 P50 H0.2", "H: 0.2 is out of range, expected 0 to 0.1"),
        ("M306 P50 F0.05", "F: 0.05 is out of range, expected 0.068"),
        ("M306 A0.1", "F: 0.097"),
        ("M306 P50 Cnan", "C: \"nan\" is not a number"),
        ("M306 P50 X3", "M306: expected E0 or E1 (nozzle) or E-1 (bed)"),
        ("M306 E1 P50", "this machine has one extruder, T0"),
        ("M306 T P50", "with T alone"),
        ("M306 E-1 P50", "a PID loop controls this heater"),
        ("M306 E-1 T", "a PID loop controls this heater"),
    ] {
        let said = say(&world, line);
        assert!(said[0].contains(why), "{line}: {said:?}");
        assert!(said.iter().any(|text| text.starts_with("echo:line 1: ")), "{line}: {said:?}");
        assert_eq!(world.model(Heater::Nozzle), Some(MODEL), "{line}");
    }
    world.set_model(Heater::Bed, MODEL);
    assert!(say(&world, "M306 E-1 H0.005")[0].contains("the bed has neither F nor H"));
}

#[test]
fn the_gains_of_a_heater_with_a_model_are_refused() {
    let world = world();
    for line in ["M301", "M301 P20"] {
        assert!(say(&world, line)[0].contains("a model controls this heater: M306"), "{line}");
    }
    assert_eq!(say(&world, "M304 P120 I1.5 D600"), ["ok"]);
}

/// M306 T and M303 with U take the found model, M303 without U does not.
#[test]
fn the_model_is_found_and_taken() {
    for (line, target, takes) in
        [("M306 T", 200.0, true), ("M303 E0 S180 U", 180.0, true), ("M303 E0 S180 C5", 180.0, false)]
    {
        let world = world();
        let mut printer = world.printer();
        execute(&world, &mut printer, line, |second| {
            assert!(second != 5 || world.target(Heater::Nozzle) == target, "{line}");
        });
        let said = world.said();
        assert!(said.contains(&String::from("MPC Autotune start")), "{said:?}");
        assert_eq!(said.iter().any(|text| text.contains("C has no effect")), line.ends_with("C5"), "{said:?}");
        let parts: Vec<&String> = said.iter().filter(|text| text.starts_with(" part: ")).collect();
        assert_eq!(parts.len(), 5, "{said:?}");
        assert!(said.iter().any(|text| text == "echo:busy: processing"), "{said:?}");
        let at = said.iter().position(|text| text == "MPC Autotune finished!").unwrap();
        let [m306, first, second, third, ok] = &said[at + 1..] else { panic!("{said:?}") };
        assert!(first.starts_with("echo:[nozzle.control_model]: power_w = 40, capacity_j_per_k = 1"), "{first}");
        assert!(second.starts_with("echo:[nozzle.control_model]: loss_w_per_k = 0.1"), "{second}");
        assert!(third.ends_with("filament_j_per_k_mm = 0.0056"), "{third}");
        assert_eq!(ok, "ok");
        assert_eq!(world.model(Heater::Nozzle) != Some(MODEL), takes, "{line}");
        assert_eq!(world.target(Heater::Nozzle), 0.0);
        // The reported line sets the same values.
        assert_eq!(say(&world, m306.strip_prefix("echo:").unwrap()), ["ok"]);
        assert_eq!(say(&world, "M306"), vec![m306.clone(), String::from("ok")]);
        // 12 J/K, 0.11 and 0.13 W/K, a lag of 2 s, and a dead time of 1 s, which counts 1.7 times:
        // the temperature falls at 0.7 times the slope.
        let found = world.model(Heater::Nozzle).unwrap();
        let near = |found: f32, is: f32| (found / is - 1.0).abs() < 0.12;
        assert!(near(found.capacity_j_per_k, 12.0) && near(found.loss_w_per_k, 0.11), "{found:?}");
        assert!(near(found.fanned_loss_w_per_k, 0.13) && near(1.0 / found.sensor_per_s, 3.9), "{found:?}");
    }
}

#[test]
fn m108_and_faults_end_it_and_the_model_stays() {
    for at_s in [5, 60, 100] {
        let world = world();
        let mut printer = world.printer();
        execute(&world, &mut printer, "M306 T", |second| {
            if second == at_s {
                world.signals().end_wait();
            }
        });
        let said = world.said();
        assert!(said.iter().any(|text| text == "MPC Autotune ended by M108, the model stays"), "{said:?}");
        assert_eq!((world.target(Heater::Nozzle), world.model(Heater::Nozzle)), (0.0, Some(MODEL)));
    }
}

#[test]
fn a_hot_heater_and_a_print_refuse_it() {
    let world = world();
    say(&world, "M109 S180");
    assert!(say(&world, "M306 T")[0].contains("M303 needs an idle printer"));
    say(&world, "M104 S0");
    assert!(say(&world, "M306 T")[0].contains("let it cool"));
    assert!(say(&world, "M303 S180")[0].contains("let it cool"));
    assert_eq!(world.target(Heater::Nozzle), 0.0);
}
