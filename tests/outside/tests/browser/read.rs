//! Chromium loads the page that reads a print, from the disk: its figures and its page are those of
//! the command, it cancels, and it has words for what it cannot read.

use std::fs;
use std::process::Command;

use ferrostep_testkit::chromium::chromium;
use ferrostep_testkit::program::{program, repository, scratch};
use ferrostep_testkit::python;
use serde_json::{Value, json};

const CONFIGURATION: &str = "tests/cases/import/k20-max-power/printer.cfg";

/// The page, as `cargo xtask page` builds it.
fn built() -> String {
    let output = Command::new(env!("CARGO")).args(["xtask", "page"]).current_dir(repository()).output().unwrap();
    assert!(output.status.success(), "cargo xtask page: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap().lines().next().unwrap().to_owned()
}

/// A page without the version, which names a commit and whether sources differ from it.
fn without_version(page: &str) -> String {
    let (before, rest) = page.split_once("\"version\":\"").unwrap();
    format!("{before}{}", rest.split_once('"').unwrap().1)
}

/// The same value with all its numbers as floating point, which JavaScript's all are.
fn as_in_javascript(value: &Value) -> Value {
    match value {
        Value::Number(number) => json!(number.as_f64()),
        Value::Array(values) => values.iter().map(as_in_javascript).collect(),
        Value::Object(values) => {
            Value::Object(values.iter().map(|(key, value)| (key.clone(), as_in_javascript(value))).collect())
        }
        other => other.clone(),
    }
}

#[test]
fn a_file_is_read_in_the_browser_as_by_the_command() {
    let folder = scratch();
    let at = |name: &str| folder.path().join(name);
    let examples = repository().join("examples");
    fs::copy(examples.join("cube.gcode"), at("job.gcode")).unwrap();
    fs::copy(repository().join(CONFIGURATION), at("printer.cfg")).unwrap();
    let configuration = fs::read_to_string(at("printer.cfg")).unwrap();
    let broken = configuration.replace("[printer]", "[printer");
    assert_ne!(broken, configuration);
    fs::write(at("broken.cfg"), &broken).unwrap();
    fs::write(at("rubbish.gcode"), b"\x7fELF\x02\x01\x01\0\0\0\0\0\0\0\0\0\x02\0\x3e\0\x01").unwrap();
    let packed = fs::read(examples.join("supports.gcode.gz")).unwrap();
    fs::write(at("cut.gcode.gz"), &packed[..9000]).unwrap();
    fs::write(at("large.gcode"), fs::read_to_string(at("job.gcode")).unwrap().repeat(20)).unwrap();

    let page = built();
    assert!(fs::metadata(&page).unwrap().len() <= 3_000_000);
    let chromium = chromium();
    let arguments = [chromium.to_str().unwrap(), &page, folder.path().to_str().unwrap()];
    let seen = python::run("browser_page.py", &arguments);
    assert_eq!(seen["errors"], json!([]), "{seen:#}");
    assert_eq!(seen["requests"], json!([]), "{seen:#}");

    let command = |arguments: &[&str]| {
        let output = Command::new(program()).args(arguments).current_dir(folder.path()).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        output.stdout
    };
    let json_of = |arguments: &[&str]| serde_json::from_slice::<Value>(&command(arguments)).unwrap();
    let done = &seen["chosen"]["done"];
    let estimate = json_of(&["estimate", "job.gcode", "--json"]);
    for key in
        ["file", "profile", "print_time_s", "motion_time_s", "filament_mm", "position_mm", "lines", "moves", "remarks"]
    {
        assert_eq!(as_in_javascript(&done["summary"][key]), as_in_javascript(&estimate[key]), "{key}");
    }
    let print = json_of(&["print", "job.gcode", "--json"]);
    for key in ["motor_steps", "order_digest", "step_digest"] {
        assert_eq!(as_in_javascript(&done["steps"][key]), as_in_javascript(&print[key]), "{key}");
    }
    command(&["show", "job.gcode", "-o", "command.html", "--no-open"]);
    let [ours, expected] =
        ["shown.html", "command.html"].map(|name| without_version(&fs::read_to_string(at(name)).unwrap()));
    assert!(ours == expected, "the pages differ: {}", folder.path().display());
    assert_eq!(seen["name"], "job.html");
    assert_eq!(seen["chosen"]["overflows"], false);

    assert_eq!(seen["cancelled"], json!(["before", true]));
    command(&["import", "printer.cfg", "-o", "imported.toml"]);
    let by_rules = json_of(&["estimate", "job.gcode", "--profile", "imported.toml", "--rules", "klipper", "--json"]);
    let dropped = &seen["dropped"]["done"]["summary"];
    for key in ["print_time_s", "motion_time_s", "rules", "limits"] {
        assert_eq!(as_in_javascript(&dropped[key]), as_in_javascript(&by_rules[key]), "{key}");
    }
    assert!(seen["dropped"]["kept"].as_str().unwrap().contains("settings of the configuration are kept"), "{seen:#}");

    let line = 1 + broken.lines().position(|line| line.starts_with("[printer")).unwrap();
    let message = seen["broken"]["error"].as_str().unwrap_or_else(|| panic!("{seen:#}"));
    assert!(message.contains(&format!("broken.cfg:{line}")), "{message}");
    let message = seen["rubbish"]["error"].as_str().unwrap_or_else(|| panic!("{seen:#}"));
    assert!(message.starts_with("rubbish.gcode: "), "{message}");
    assert!(seen["cut"]["stopped"].as_str().unwrap_or_default().contains("cannot be read"), "{seen:#}");
}
