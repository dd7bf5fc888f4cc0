//! `print --json` and `estimate --json`: the book's schema holds, and the parts of a print add up.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::end_to_end::command::{directory, ferrostep, file, repository};

/// Contradictions of a value to a schema, with their places; only the words that the book's
/// schema uses are known.
fn faults(schema: &Value, value: &Value, place: &str) -> Vec<String> {
    const KNOWN: [&str; 10] = [
        "$schema",
        "title",
        "description",
        "type",
        "properties",
        "required",
        "additionalProperties",
        "items",
        "minimum",
        "enum",
    ];
    for word in schema.as_object().unwrap().keys() {
        assert!(KNOWN.contains(&word.as_str()), "{place}: the test does not know the schema's {word}");
    }
    let is_right = match schema["type"].as_str().unwrap() {
        "object" => value.is_object(),
        "array" => value.is_array(),
        "string" => value.is_string(),
        "number" => value.is_number(),
        "integer" => value.is_u64() || value.is_i64(),
        other => panic!("{place}: the test does not know the type {other}"),
    };
    if !is_right {
        return vec![format!("{place}: {value} is no {}", schema["type"])];
    }
    let mut found = Vec::new();
    if let (Some(minimum), Some(number)) = (schema["minimum"].as_f64(), value.as_f64()) {
        found.extend((number < minimum).then(|| format!("{place}: {number} is below {minimum}")));
    }
    if let Some(allowed) = schema["enum"].as_array() {
        found.extend((!allowed.contains(value)).then(|| format!("{place}: {value} is none of {allowed:?}")));
    }
    for (index, item) in value.as_array().into_iter().flatten().enumerate() {
        found.extend(faults(&schema["items"], item, &format!("{place}[{index}]")));
    }
    let Some(object) = value.as_object() else { return found };
    for key in schema["required"].as_array().unwrap() {
        let key = key.as_str().unwrap();
        found.extend((!object.contains_key(key)).then(|| format!("{place}: {key} is missing")));
    }
    assert_eq!(schema["additionalProperties"], false);
    for (key, item) in object {
        match schema["properties"].get(key) {
            None => found.push(format!("{place}: {key} is not in the schema")),
            Some(schema) => found.extend(faults(schema, item, &format!("{place}.{key}"))),
        }
    }
    found
}

fn schema() -> Value {
    let text = fs::read_to_string(repository().join("docs/src/summary.schema.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

#[track_caller]
fn summary(command: &str, job: &Path) -> Value {
    let summary = ferrostep([command, job.to_str().unwrap(), "--json"]).json();
    assert_eq!(faults(&schema(), &summary, command), Vec::<String>::new(), "{}", job.display());
    summary
}

fn sum(parts: &Value, key: &str) -> f64 {
    parts.as_array().unwrap().iter().map(|part| part[key].as_f64().unwrap()).sum()
}

#[test]
fn the_schema_refuses_what_is_wrong() {
    let schema = schema();
    let right = summary("estimate", &repository().join("tests/cases/klipper-files/mainsail-orca.gcode"));
    for (change, expected) in [
        (json!({ "layers": -1 }), "layers: -1 is below 0"),
        (json!({ "layers": "two" }), "layers: \"two\" is no \"integer\""),
        (json!({ "pauses": [{ "line": 3, "command": "M0" }] }), "pauses[0]: at_s is missing"),
        (json!({ "surprise": 1 }), "surprise is not in the schema"),
        (json!({ "remarks": [{ "kind": "odd", "message": "", "count": 1, "lines": [] }] }), "is none of"),
    ] {
        let mut wrong = right.clone();
        wrong.as_object_mut().unwrap().extend(change.as_object().unwrap().clone());
        let found = faults(&schema, &wrong, "estimate");
        assert!(found.len() == 1 && found[0].contains(expected), "{found:?}");
    }
}

#[test]
fn the_schema_holds_for_jobs_of_all_kinds() {
    let directory = directory();
    let stopped = file(&directory, "stopped.gcode", "G28\nG1 X10 F3000\nM112\nG1 X5\n");
    let odd = file(&directory, "odd.gcode", ";LAYER_CHANGE\nG28\nM9999\nG1 X500 F6000\nM0\nM205 X8\nM104 S200\n");
    for job in [
        repository().join("examples/cube.bgcode"),
        repository().join("tests/cases/klipper-files/k1-creality.gcode"),
        repository().join("tests/cases/klipper-files/macros-in-the-middle.gcode"),
        stopped,
        odd.clone(),
    ] {
        for command in ["print", "estimate"] {
            summary(command, &job);
        }
    }
    let prepared = directory.path().join("job.gpre");
    let outcome = ferrostep(["preprocess".as_ref(), odd.as_os_str(), "-o".as_ref(), prepared.as_os_str()]);
    assert_eq!(outcome.status, Some(0), "{outcome:#?}");
    assert!(summary("print", &prepared).get("layer_list").is_none());
}

#[test]
fn parts_add_up_to_the_print_and_are_the_same_planned_and_printed() {
    let job = repository().join("tests/cases/klipper-files/mainsail-orca.gcode");
    let both = ["print", "estimate"].map(|command| summary(command, &job));
    for summary in &both {
        let layers = &summary["layer_list"];
        let heights = |key: &str| layers.as_array().unwrap().iter().map(|layer| layer[key].clone()).collect::<Vec<_>>();
        assert_eq!(
            (heights("line"), heights("z_mm"), heights("height_mm")),
            (vec![json!(12), json!(30)], vec![json!(0.2), json!(0.4)], vec![json!(0.2), json!(0.2)],)
        );
        let names: Vec<_> = summary["features"].as_array().unwrap().iter().map(|part| &part["name"]).collect();
        assert_eq!(names, ["External perimeter", "Solid infill"]);
        assert_eq!(summary["objects"][0]["name"], "ring_id_0_copy_0");
        let (motion_s, filament_mm) =
            (summary["motion_time_s"].as_f64().unwrap(), summary["filament_mm"].as_f64().unwrap());
        let layers_s = sum(layers, "time_s");
        assert!((layers_s - motion_s).abs() < 0.002 * motion_s, "{layers_s} {motion_s}");
        for parts in [layers, &summary["features"], &summary["objects"]] {
            assert!((sum(parts, "filament_mm") - filament_mm).abs() < 1e-6, "{parts:#}");
        }
    }
    for parts in ["layer_list", "features", "objects"] {
        let times = both.each_ref().map(|summary| sum(&summary[parts], "time_s"));
        assert!((times[0] - times[1]).abs() < 0.002 * times[0], "{parts}: {times:?}");
    }
}

#[test]
fn homing_is_no_part_of_a_feature() {
    let directory = directory();
    let text = ";TYPE:Custom\nG28\nM109 S200\nG1 X50 Y50 Z1 F6000\nG28 X\nG1 X90 E1 F1200\nM104 S0\n";
    for command in ["print", "estimate"] {
        let summary = summary(command, &file(&directory, "job.gcode", text));
        let (custom_s, motion_s) = (sum(&summary["features"], "time_s"), summary["motion_time_s"].as_f64().unwrap());
        assert!((custom_s - motion_s).abs() < 0.01, "{command}: {custom_s} {motion_s}");
    }
}

#[test]
fn a_layer_takes_what_it_adds_to_the_print() {
    let layers: Vec<String> = (1..=3)
        .map(|layer| format!(";LAYER_CHANGE\nG1 Z{layer} F600\nG1 X{} E{layer} F1200\nG1 X10\n", 10 + 20 * layer))
        .collect();
    let directory = directory();
    let time_s = |count: usize| {
        let text = format!("G28\nM109 S200\nG1 X10 Y10 F6000\n{}M104 S0\n", layers[..count].concat());
        let summary = summary("estimate", &file(&directory, "job.gcode", text));
        (summary["motion_time_s"].as_f64().unwrap(), summary["layer_list"].clone())
    };
    let (all_s, list) = time_s(3);
    for count in 1..3 {
        let rest_s: f64 = list.as_array().unwrap()[count..].iter().map(|layer| layer["time_s"].as_f64().unwrap()).sum();
        let difference_s = all_s - time_s(count).0;
        assert!((rest_s - difference_s).abs() < 0.05, "{count}: {rest_s} {difference_s}");
    }
}

#[test]
fn a_pause_has_the_time_at_which_it_begins() {
    let directory = directory();
    let before = "G28\nM109 S200\nG1 X50 F3000\nG1 X60 E1 F600\n";
    let whole = file(&directory, "whole.gcode", format!("{before}M0\nG1 X100\nPAUSE\nG1 X10\nM104 S0\n"));
    let part = file(&directory, "part.gcode", before);
    for command in ["print", "estimate"] {
        let pauses = summary(command, &whole)["pauses"].clone();
        let at_s = [0, 1].map(|index| pauses[index]["at_s"].as_f64().unwrap());
        let expected_s = summary(command, &part)["print_time_s"].as_f64().unwrap();
        assert!((at_s[0] - expected_s).abs() < 0.01 && at_s[1] > at_s[0] + 3.9, "{at_s:?} {expected_s}");
        assert_eq!((&pauses[0]["line"], &pauses[0]["command"]), (&json!(5), &json!("M0")));
        assert_eq!((&pauses[1]["line"], &pauses[1]["command"]), (&json!(7), &json!("PAUSE")));
    }
}
