//! The optional keys of the heaters, and of their time without use.

use ferrostep_printer::HeaterModel;
use ferrostep_profiles::{Problem, builtin_text, load, parse};
use ferrostep_virtual_board::HeatedMass;

/// The cartesian profile with more lines at the start of `[bed]`, and at its start.
fn with(start: &str, bed: &str) -> String {
    let text = builtin_text("cartesian").unwrap().replacen("[bed]\n", &format!("[bed]\n{bed}"), 1);
    format!("{start}{text}")
}

#[test]
fn absent_keys_have_their_defaults() {
    let profile = load("cartesian").unwrap();
    assert_eq!(profile.heater_timeout_s, 1800);
    assert_eq!((profile.bed.max_target_celsius, profile.nozzle.max_target_celsius), (125.0, 275.0));
    assert_eq!((profile.nozzle.mass, profile.bed.mass), (HeatedMass::NOZZLE, HeatedMass::BED));
}

#[test]
fn values_within_their_ranges_are_taken() {
    let bed = "max_target_celsius = 110\nwatch_s = 300\nrunaway_celsius = 30\n\
               model = { power_w = 500, capacity_j_per_k = 900.5, loss_w_per_k = 3, dead_time_s = 1.5 }\n";
    let profile = parse(&with("heater_timeout_s = 600\n", bed), "test.toml").unwrap();
    assert_eq!(profile.heater_timeout_s, 600);
    assert_eq!(profile.bed.max_target_celsius, 110.0);
    assert_eq!((profile.bed.watch.watch_ms, profile.bed.watch.runaway_celsius), (300_000, 30.0));
    let mass = HeatedMass {
        heater_w: 500.0,
        capacity_j_per_k: 900.5,
        loss_w_per_k: 3.0,
        fan_loss_w_per_k: 0.0,
        dead_time_s: 1.5,
        sensor_lag_s: 0.0,
    };
    assert_eq!(profile.bed.mass, mass);
    assert_eq!(parse(&with("heater_timeout_s = 0\n", ""), "test.toml").unwrap().heater_timeout_s, 0);
}

/// Marlin's example of a V6 (Configuration.h).
#[test]
fn a_model_controls_a_heater_where_its_table_is() {
    let v6 = "power_w = 40, capacity_j_per_k = 16.7, loss_w_per_k = 0.068, sensor_per_s = 0.22";
    let text = |of_nozzle: &str, of_bed: &str| {
        let text = with("", &format!("control_model = {{ {v6}{of_bed} }}\n"));
        text.replacen("[nozzle]\n", &format!("[nozzle]\ncontrol_model = {{ {v6}{of_nozzle} }}\n"), 1)
    };
    let profile = parse(&text(", fanned_loss_w_per_k = 0.097", ""), "test.toml").unwrap();
    let model = HeaterModel {
        power_w: 40.0,
        capacity_j_per_k: 16.7,
        loss_w_per_k: 0.068,
        fanned_loss_w_per_k: 0.097,
        sensor_per_s: 0.22,
        filament_j_per_k_mm: 0.0054,
    };
    let bed = HeaterModel { fanned_loss_w_per_k: 0.068, filament_j_per_k_mm: 0.0, ..model };
    assert_eq!(profile.control_models, [Some(model), Some(bed)]);
    assert_eq!(load("cartesian").unwrap().control_models, [None; 2]);
    // A prepared job has no heaters' control in it.
    assert_eq!(profile.plan_hash, parse(&with("", ""), "test.toml").unwrap().plan_hash);
    for (of_nozzle, of_bed, key) in [
        (", fanned_loss_w_per_k = 0.06", "", "nozzle.control_model.fanned_loss_w_per_k"),
        (", filament_j_per_k_mm = -1", "", "nozzle.control_model.filament_j_per_k_mm"),
        ("", ", fanned_loss_w_per_k = 0.1", "bed.control_model.fanned_loss_w_per_k"),
        ("", ", filament_j_per_k_mm = 0.005", "bed.control_model.filament_j_per_k_mm"),
    ] {
        let error = parse(&text(of_nozzle, of_bed), "test.toml").unwrap_err();
        let Problem::OutOfRange { key: blamed, .. } = error.problem() else { panic!("{key}: {error}") };
        assert_eq!(blamed, key, "{error}");
    }
    for (good, bad, key) in [
        ("power_w = 40", "power_w = 0", "bed.control_model.power_w"),
        ("capacity_j_per_k = 16.7", "capacity_j_per_k = nan", "bed.control_model.capacity_j_per_k"),
        ("capacity_j_per_k = 16.7", "capacity_j_per_k = -3", "bed.control_model.capacity_j_per_k"),
        ("loss_w_per_k = 0.068", "loss_w_per_k = 0", "bed.control_model.loss_w_per_k"),
        ("sensor_per_s = 0.22", "sensor_per_s = 0", "bed.control_model.sensor_per_s"),
    ] {
        let bed = format!("control_model = {{ {} }}\n", v6.replace(good, bad));
        let error = parse(&with("", &bed), "test.toml").unwrap_err();
        let Problem::OutOfRange { key: blamed, .. } = error.problem() else { panic!("{key}: {error}") };
        assert_eq!(blamed, key, "{error}");
    }
}

#[test]
fn others_are_refused_by_name() {
    let model = "capacity_j_per_k = 900, loss_w_per_k = 3";
    for (start, bed, key) in [
        ("heater_timeout_s = -1\n", String::new(), "heater_timeout_s"),
        ("heater_timeout_s = 65536\n", String::new(), "heater_timeout_s"),
        ("", "max_target_celsius = 126\n".to_owned(), "bed.max_target_celsius"),
        ("", "max_target_celsius = 49\n".to_owned(), "bed.max_target_celsius"),
        ("", "watch_s = 301\n".to_owned(), "bed.watch_s"),
        ("", "runaway_celsius = 31\n".to_owned(), "bed.runaway_celsius"),
        ("", format!("model = {{ power_w = 0, {model} }}\n"), "bed.model.power_w"),
        ("", format!("model = {{ power_w = nan, {model} }}\n"), "bed.model.power_w"),
        ("", format!("model = {{ power_w = 9, {model}, dead_time_s = 31 }}\n"), "bed.model.dead_time_s"),
        ("", format!("model = {{ power_w = 9, {model}, fan_loss_w_per_k = -1 }}\n"), "bed.model.fan_loss_w_per_k"),
    ] {
        let error = parse(&with(start, &bed), "test.toml").unwrap_err();
        let Problem::OutOfRange { key: blamed, .. } = error.problem() else { panic!("{key}: {error}") };
        assert_eq!(blamed, key, "{error}");
        assert!(error.line().is_some(), "{error}");
    }
    for (bed, message) in [
        (format!("model = {{ {model} }}\n"), "missing key \"bed.model.power_w\""),
        (format!("model = {{ watts = 9, {model} }}\n"), "unknown key \"bed.model.watts\""),
    ] {
        let error = parse(&with("", &bed), "test.toml").unwrap_err().to_string();
        assert!(error.contains(message), "{error}");
    }
}

/// T1's nozzle has its own model or no model, whatever controls T0's.
#[test]
fn the_second_nozzle_has_a_model_where_its_table_is() {
    use ferrostep_hal_shim::Heater;
    let v6 = "{ power_w = 40, capacity_j_per_k = 16.7, loss_w_per_k = 0.068, sensor_per_s = 0.22 }";
    let tools = |nozzle: &str| {
        format!("\n[tools.t1]\nmotor = \"e1\"\noffset_mm = {{ x = 20, y = 0, z = 0 }}\nheater = \"nozzle1\"\n{nozzle}")
    };
    let of_first =
        builtin_text("cartesian").unwrap().replacen("[nozzle]\n", &format!("[nozzle]\ncontrol_model = {v6}\n"), 1);
    let of_second = tools(&format!("[tools.t1.nozzle]\ncontrol_model = {v6}\n"));
    for (text, models) in [
        (of_first.clone() + &tools(""), [true, false]),
        (builtin_text("cartesian").unwrap().to_owned() + &of_second, [false, true]),
        (of_first + &of_second, [true, true]),
    ] {
        let profile = parse(&text, "two.toml").unwrap();
        let [nozzle, second] = [Heater::Nozzle, Heater::Nozzle1].map(|heater| profile.control_model(heater));
        assert_eq!([nozzle.is_some(), second.is_some()], models);
        assert!(second.is_none_or(|model| model.filament_j_per_k_mm == 0.0054 && model.power_w == 40.0));
    }
    let text = builtin_text("cartesian").unwrap().to_owned() + &of_second.replace("16.7", "0.5");
    let error = parse(&text, "two.toml").unwrap_err().to_string();
    assert!(error.contains("tools.t1.nozzle.control_model.capacity_j_per_k = 0.5: expected 1 to 20000"), "{error}");
}
