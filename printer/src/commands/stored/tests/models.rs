//! Settings of heaters that models control.

use ferrostep_hal_shim::Heater;

use super::*;
use crate::heat::model::HeaterModel;
use crate::ports::Heating;

/// The heaters' models are stored instead of their gains.
#[test]
fn models_are_stored_in_the_place_of_gains() {
    let model = HeaterModel {
        power_w: 40.0,
        capacity_j_per_k: 16.7,
        loss_w_per_k: 0.068,
        fanned_loss_w_per_k: 0.097,
        sensor_per_s: 0.22,
        filament_j_per_k_mm: 0.0056,
    };
    let bed = HeaterModel { fanned_loss_w_per_k: 0.068, ..model };
    let rig = || {
        Rig::new(|profile| {
            usual(profile);
            profile.control_models = [Some(model), Some(bed)];
        })
    };
    let (before, bank) = (rig(), Bank([const { Cell::new(DRIVER) }; 4]));
    let memory = Memory::new();
    let mut printer_before = printer(&before, &bank, Some(&memory));
    let lines = ["M306 E0 P50 C12.3456 R0.3 A0.07 F0.0999 H0.004", "M306 E-1 P200 C800 R0.1 A1.25"];
    for line in lines {
        execute(&mut printer_before, line).unwrap();
    }
    let reported = says(&before, &mut printer_before, "M503 S0");
    let model_lines: Vec<&str> = reported.iter().filter_map(|line| line.strip_prefix("echo:  M306")).collect();
    assert_eq!(model_lines, [" E0 P50.00 C12.3456 R0.30 A0.07 F0.0999 H0.004", " E-1 P200.00 C800.00 R0.10 A1.25"]);
    assert!(!reported.iter().any(|line| line.contains("M301") || line.contains("M304")), "{reported:#?}");
    let said = says(&before, &mut printer_before, "M500");
    assert!(said[0].ends_with("10 values that differ from the profile's)"), "{said:?}");
    let values = printer_before.live_values();
    let after = rig();
    let mut printer_after = printer(&after, &bank, Some(&memory));
    printer_after.restore_settings();
    assert_eq!(printer_after.live_values(), values);
    execute(&mut printer_after, "M502").unwrap();
    assert_eq!(printer_after.heating.model(Heater::Nozzle), Some(model));
    // The profile's value replaces one that is out of range or does not fit the others.
    for (name, value, why) in [
        ("nozzle.control_model.capacity_j_per_k", 0.0, "nozzle.control_model.capacity_j_per_k is stored as 0"),
        ("nozzle.control_model.power_w", f64::NAN, "nozzle.control_model.power_w is stored as"),
        ("nozzle.control_model.loss_w_per_k", 5.0, "nozzle.control_model  as stored is not possible"),
    ] {
        let memory = Memory::with(after.profile.name, &[(name, 0, value)]);
        let mut printer = printer(&after, &bank, Some(&memory));
        printer.restore_settings();
        let said = after.last_texts();
        assert!(said.iter().any(|line| line.contains(why)), "{said:?}");
        assert_eq!(printer.heating.model(Heater::Nozzle), Some(model), "{name}");
    }
    // A machine without models takes the values for those of another machine.
    let other = Rig::new(usual);
    let mut printer = printer(&other, &bank, Some(&memory));
    printer.restore_settings();
    assert!(other.last_texts()[0].contains("10 that this version does not know"));
}
