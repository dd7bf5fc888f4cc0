//! M306 and M303 of T1's separate nozzle.

use ferrostep_hal_shim::{FanOutput, SpareConnector};

use super::*;
use crate::settings::profile::tools::tests::{second, two};
use crate::settings::profile::tools::{FurtherTool, ToolHeater};

/// T0 has a PID loop; T1 has a separate nozzle and fan, and optionally a model.
fn world(control_model: Option<HeaterModel>) -> World {
    World::with(|profile| {
        let connector = SpareConnector::Nozzle1;
        let settings = profile.nozzle;
        let heater = Some(ToolHeater { heater: connector, thermistor: connector, settings, control_model });
        profile.fans[FanOutput::Fan2.index()] =
            Some(crate::heat::fans::FanSettings { name: "right", ..crate::heat::fans::FanSettings::PART });
        profile.tools = two(FurtherTool { heater, fan: Some(FanOutput::Fan2.index() as u8), ..second() });
    })
}

#[test]
fn t1_has_a_model_of_its_own() {
    let world = world(Some(MODEL));
    let of_second = "echo:M306 E1 P40 C16.7 R0.22 A0.068 F0.097 H0.0056";
    assert_eq!(say(&world, "M306 E1"), [of_second, "ok"]);
    assert!(say(&world, "M306 E0")[0].contains("a PID loop controls this heater"));
    // Without E, the selected nozzle.
    assert!(say(&world, "M306")[0].contains("a PID loop controls this heater"));
    let mut printer = world.printer();
    assert!(execute(&world, &mut printer, "T1 S1", |_| {}));
    assert!(execute(&world, &mut printer, "M306", |_| {}));
    assert!(world.said().contains(&String::from(of_second)));
    assert_eq!(say(&world, "M306 E1 P50"), ["ok"]);
    assert_eq!(world.model(Heater::Nozzle1), Some(HeaterModel { power_w: 50.0, ..MODEL }));
    assert_eq!(world.model(Heater::Nozzle), None);
    assert!(say(&world, "M301 E1 P20")[0].contains("a model controls this heater: M306"));
    assert_eq!(say(&world, "M301 E0 P20"), ["ok"]);
    assert!(say(&world, "M306 E2 P50")[0].contains("T0 and T1"));
    assert!(say(&world, "M306 E1 F0.05")[0].contains("F: 0.05 is out of range"));
}

/// The plant is that of T0, without the fan of T0's model.
#[test]
fn its_model_is_found_with_its_own_fan() {
    for (line, target) in [("M306 E1 T", 200.0), ("M303 E1 S180 U", 180.0)] {
        let world = world(Some(MODEL));
        let mut printer = world.printer();
        let fans = core::cell::Cell::new((0, 0));
        execute(&world, &mut printer, line, |second| {
            assert!(second != 5 || world.target(Heater::Nozzle1) == target && world.target(Heater::Nozzle) == 0.0);
            let (part, own) = fans.get();
            fans.set((part.max(world.fan_power(FanOutput::Part)), own.max(world.fan_power(FanOutput::Fan2))));
        });
        let said = world.said();
        assert_eq!(fans.get(), (0, 255), "{line}: {said:?}");
        let at = said.iter().position(|text| text == "MPC Autotune finished!").unwrap();
        assert!(said[at + 1].starts_with("echo:M306 E1 P40 C"), "{said:?}");
        assert!(said[at + 2].starts_with("echo:[tools.t1.nozzle.control_model]: power_w = 40, capacity_j_per_k = 1"));
        let found = world.model(Heater::Nozzle1).unwrap();
        let near = |found: f32, is: f32| (found / is - 1.0).abs() < 0.12;
        assert!(near(found.capacity_j_per_k, 12.0) && near(found.loss_w_per_k, 0.11), "{found:?}");
        assert!(
            found.filament_j_per_k_mm == MODEL.filament_j_per_k_mm && near(1.0 / found.sensor_per_s, 3.9),
            "{found:?}"
        );
        assert_eq!((world.target(Heater::Nozzle1), world.model(Heater::Nozzle)), (0.0, None));
    }
}

/// M303 tunes a PID loop with T1's own fan as well.
#[test]
fn the_gains_of_t1_are_found_with_its_own_fan() {
    let world = world(None);
    let mut printer = world.printer();
    let most = core::cell::Cell::new((0, 0));
    execute(&world, &mut printer, "M303 E1 S180", |_| {
        let (part, own) = most.get();
        most.set((part.max(world.fan_power(FanOutput::Part)), own.max(world.fan_power(FanOutput::Fan2))));
    });
    let said = world.said();
    assert_eq!(most.get(), (0, 255));
    assert!(said.iter().any(|text| text.starts_with("echo:M301 E1 P")), "{said:?}");
}

/// Melting filament cools the selected nozzle: its loop raises the power at once.
#[test]
fn filament_counts_at_the_selected_nozzle() {
    use crate::heat::control::HeatControl;
    let world = world(Some(MODEL));
    let profile = world.profile();
    let mut heaters = profile.virtual_heaters();
    let mut control: HeatControl = HeatControl::new(profile.heaters(), profile.fans, &mut heaters);
    control.set_models(|_| Some(MODEL));
    for heater in [Heater::Nozzle, Heater::Nozzle1] {
        control.set_target(heater, 200.0);
    }
    let mut pushed_um = 0;
    let mut run = |control: &mut HeatControl, seconds: usize, um: i32| {
        for _ in 0..seconds * 100 {
            heaters.advance(0.01);
            pushed_um += um;
            control.note_filament(pushed_um);
            control.update(&mut heaters).unwrap();
        }
        [Heater::Nozzle, Heater::Nozzle1].map(|heater| control.status(heater).power)
    };
    let [first, second] = run(&mut control, 300, 0);
    assert!((first - second).abs() < 0.02, "{first} {second}");
    let melting = run(&mut control, 3, 60);
    assert!(melting[0] > first + 0.1 && (melting[1] - second).abs() < 0.03, "{melting:?}");
    control.select_nozzle(Heater::Nozzle1);
    run(&mut control, 200, 0);
    let melting = run(&mut control, 3, 60);
    assert!(melting[1] > second + 0.1 && (melting[0] - first).abs() < 0.03, "{melting:?}");
}
