//! The command: its output, and its refusals.

use std::path::Path;
use std::process::Command;

use ferrostep_testkit::program::{program, repository};
use ferrostep_testkit::shown::prints::shown;
use ferrostep_testkit::shown::{errors, show};
use serde_json::Value;
use tempfile::TempDir;

/// The page's description of the print.
pub fn description(page: &str) -> Value {
    let start = page.split_once("id=\"description\">").unwrap().1;
    serde_json::from_str(start.split_once("</script>").unwrap().0).unwrap()
}

/// A folder with a job in it.
pub fn job(text: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("job.gcode"), text).unwrap();
    folder
}

/// Names in a folder, in order.
pub fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

const PART: &str = "G28\nM302 P1\nM83\n;LAYER_CHANGE\nG1 Z.2 F600\n;TYPE:Perimeter\nG1 X50 Y20 F3000\nG1 X90 E1\nG1 Y60 E1\n\
                    ;LAYER_CHANGE\nG1 Z.4 F600\n;TYPE:Solid infill\nG1 X50 E1 F3000\n";

#[test]
fn a_page_is_one_file_that_fetches_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let cube = repository().join("examples/cube.gcode");
    let output = show(folder.path(), [cube.as_os_str()]);
    assert!(output.status.success(), "{}", errors(&output));
    assert_eq!(names(folder.path()), ["cube.html"]);
    let page = std::fs::read_to_string(folder.path().join("cube.html")).unwrap();
    assert!(page.starts_with("<!doctype html><!-- ferrostep show -->"));
    assert!(page.contains("default-src 'none'") && !page.contains("http://") && !page.contains("https://"));
    for fetching in [" src=", "@import", "url(", "fetch(", "XMLHttpRequest", "WebSocket", "eval(", "innerHTML"] {
        assert!(!page.contains(fetching), "{fetching}");
    }
    let said = description(&page);
    assert_eq!(said["job"]["moves"], 5289);
    assert_eq!(said["job"]["slicer_time_s"], 1287.0);
    assert_eq!(said["features"][3], "Perimeter");
    let chances = said["job"]["chances"].as_array().unwrap();
    let time = |number: usize| chances[number][1].as_f64().unwrap();
    let print_time_s = said["job"]["print_time_s"].as_f64().unwrap();
    // Twice and four times the acceleration win, half of it loses.
    assert!(time(1) < time(0) && time(0) < print_time_s && print_time_s < time(2), "{chances:?}");
    // Once more: the older page is Ferrostep's.
    assert!(show(folder.path(), [cube.as_os_str()]).status.success());
}

#[test]
fn a_job_that_stops_has_its_page_up_to_there() {
    let folder = job(&format!("{PART}G1 X10 Q\"</script><b>\nG1 X1 Y1\n"));
    let output = show(folder.path(), ["job.gcode"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(errors(&output).contains("job.gcode: line 14"), "{}", errors(&output));
    let page = std::fs::read_to_string(folder.path().join("job.html")).unwrap();
    // Text of the job cannot become a part of the page.
    assert_eq!(page.matches("</script>").count(), 4);
    assert!(!page.contains("<b>"));
    let said = description(&page);
    let first = &said["job"]["findings"][0];
    assert_eq!((first["weight"].as_str(), first["line"].as_u64()), (Some("stop"), Some(14)), "{first}");
    assert_eq!(said["job"]["moves"], 6);
    assert_eq!(said["job"]["chances"].as_array().unwrap().len(), 0);
}

#[test]
fn empty_prints_and_prints_without_layers_have_a_page() {
    let folder = job("; nothing\n");
    assert!(show(folder.path(), ["job.gcode"]).status.success());
    let page = std::fs::read_to_string(folder.path().join("job.html")).unwrap();
    assert_eq!(description(&page)["columns"][0]["name"], "time");

    let folder = job(&PART.replace(";LAYER_CHANGE", ";"));
    assert!(show(folder.path(), ["job.gcode"]).status.success());
    let recording = shown(&folder.path().join("job.gcode"), "cartesian", 1000).recording;
    let layers = recording.nodes.iter().filter(|node| node.kind == ferrostep_show::Kind::Print).map(|node| node.layer);
    assert_eq!(layers.clone().min().zip(layers.max()), Some((0, 1)));
}

/// A machine that knows its chamber's temperature shows it, and no other does.
#[test]
fn a_chamber_has_its_curve() {
    let folder = job(&format!("M141 S40\n{PART}M191 S40\n"));
    let chamber = "\n[chamber]\nthermistor = \"nozzle1\"\nheater = \"nozzle1\"\nsensor = \"epcos-100k\"\n\
                   min_celsius = 0\nmax_celsius = 80\n";
    let profile = ferrostep_profiles::builtin_text("cartesian").unwrap().to_owned() + chamber;
    std::fs::write(folder.path().join("chamber.toml"), profile).unwrap();
    let columns = |page: &str, arguments: &[&str]| {
        let output = show(folder.path(), [&["job.gcode", "-o", page], arguments].concat());
        assert!(output.status.success(), "{}", errors(&output));
        let said = description(&std::fs::read_to_string(folder.path().join(page)).unwrap());
        said["columns"].as_array().unwrap().iter().map(|column| column["name"].to_string()).collect::<Vec<_>>()
    };
    let has_chamber = |columns: &[String]| columns.iter().any(|name| name == "\"chamber\"");
    assert!(has_chamber(&columns("chamber.html", &["--profile", "chamber.toml"])));
    assert!(!has_chamber(&columns("plain.html", &[])));
}

#[test]
fn findings_are_listed_with_their_lines() {
    let folder = job(&format!("{PART}G1 X500\nG4 S1\nM104 S200\n"));
    let output = show(folder.path(), ["job.gcode", "-o", "x.html"]);
    assert!(output.status.success(), "{}", errors(&output));
    let said = description(&std::fs::read_to_string(folder.path().join("x.html")).unwrap());
    let findings = said["job"]["findings"].as_array().unwrap();
    let find = |part: &str| {
        let found = findings.iter().find(|finding| finding["text"].as_str().unwrap().contains(part));
        found.unwrap_or_else(|| panic!("{part} is not in {findings:#?}"))
    };
    assert_eq!(find("outside the travel")["line"], 14);
    assert_eq!(find("the nozzle is still on")["weight"], "warning");
    assert_eq!(find("Longest wait")["line"], 15);
    assert_eq!(find("Fastest printing")["weight"], "extreme");
}

/// Retractions, of any number, are places, two of which are listed; moves that the board cannot
/// keep up with have a finding.
#[test]
fn retractions_and_slowed_moves_are_places() {
    let mut text = format!("{PART}G1 E-.8 F2400\nG1 E.8\nG1 E-1.5\nG1 E1.5\n");
    for number in 0..400 {
        text += &format!(
            "G1 X{:.3} Y{:.3} E.001 F12000\n",
            50.0 + f64::from(number) * 0.05,
            60.0 + f64::from(number % 2) * 0.05
        );
    }
    let folder = job(&text);
    let output = show(folder.path(), ["job.gcode", "--profile", "corexy"]);
    let said = String::from_utf8(output.stdout).unwrap();
    let said = said.trim_end();
    let page = description(&std::fs::read_to_string(folder.path().join("job.html")).unwrap());
    let findings = page["job"]["findings"].as_array().unwrap();
    let counted =
        findings.iter().filter(|finding| finding["weight"] != "extreme" && finding["weight"] != "place").count();
    assert!(
        said.ends_with(&format!(", {counted} finding{}", if counted == 1 { "" } else { "s" })),
        "{said}: {findings:#?}"
    );
    let find = |part: &str| findings.iter().find(|finding| finding["text"].as_str().unwrap().contains(part));
    assert_eq!(find("The first of 2 retractions: 0.80 mm").unwrap()["line"], 14, "{findings:#?}");
    assert_eq!(find("Longest retraction: 1.50 mm").unwrap()["line"], 16);
    let slowed = find("slowed, for the board cannot keep up").unwrap_or_else(|| panic!("{findings:#?}"));
    // It takes a millisecond.
    assert_eq!(slowed["weight"], "note");
    assert!((18..418).contains(&slowed["line"].as_u64().unwrap()), "{slowed}");
    let deviation = find("Farthest from the path asked for").unwrap()["text"].as_str().unwrap();
    let mm: f64 = deviation.split_whitespace().rev().nth(1).unwrap().parse().unwrap();
    assert!(mm < 0.03, "{deviation}");
}

#[test]
fn a_single_finding_is_one() {
    let folder = job(PART);
    let output = show(folder.path(), ["job.gcode"]);
    let none = String::from_utf8(output.stdout).unwrap();
    assert!(none.ends_with(", 0 findings\n"), "{none}");
    let folder = job(&format!("{PART}G1 X500\n"));
    let one = String::from_utf8(show(folder.path(), ["job.gcode"]).stdout).unwrap();
    assert!(one.ends_with(", 1 finding\n"), "{one}");
}

/// A page of a million retractions is no larger than any other, and lists two of them.
#[test]
fn a_million_retractions_have_a_page() {
    let folder = job(&format!("{PART}{}", "G1 E-.2 F6000 ; back\nG1 E.2 ; and forth\n".repeat(1_000_000)));
    let output = show(folder.path(), ["job.gcode"]);
    assert!(output.status.success(), "{}", errors(&output));
    let page = std::fs::read_to_string(folder.path().join("job.html")).unwrap();
    assert!(page.len() < 12 << 20, "{}", page.len());
    let said = description(&page);
    assert_eq!(said["totals"]["retractions"], 1_000_000);
    assert!(said["job"]["findings"].as_array().unwrap().len() < 12);
    assert!(said["left_out"].as_u64().unwrap() > 1_000_000);
}

/// A disk that is full in the middle of the page: here a limit of the file's size does the same.
#[cfg(unix)]
#[test]
fn a_page_that_does_not_fit_leaves_nothing() {
    let folder = job(PART);
    std::fs::write(folder.path().join("old.html"), "mine").unwrap();
    for page in ["new.html", "old.html"] {
        let output = Command::new("sh")
            .current_dir(folder.path())
            .args(["-c", "trap '' XFSZ; ulimit -f 16; exec \"$0\" show --no-open job.gcode -o \"$1\""])
            .arg(program())
            .arg(page)
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(2), "{page}");
        assert!(errors(&output).contains("cannot be written"), "{page}: {}", errors(&output));
        assert_eq!(names(folder.path()), ["job.gcode", "old.html"]);
    }
    assert_eq!(std::fs::read_to_string(folder.path().join("old.html")).unwrap(), "mine");
}

/// A prepared job has no text, but the same motion.
#[test]
fn a_prepared_job_is_shown() {
    let folder = job(PART);
    let prepared = Command::new(program())
        .current_dir(folder.path())
        .args(["preprocess", "job.gcode", "-o", "job.gpre"])
        .output()
        .unwrap();
    assert!(prepared.status.success(), "{}", errors(&prepared));
    assert!(show(folder.path(), ["job.gpre"]).status.success());
    let [text, prepared] =
        ["job.gcode", "job.gpre"].map(|name| shown(&folder.path().join(name), "cartesian", 1000).recording.totals);
    let off = (text.kinds[1].time_s - prepared.kinds[1].time_s).abs();
    // A short move of Z between two prints may count as printing.
    assert!(off < 0.1 && text.kinds[1].time_s > 2.0, "{:?}, expected {:?}", prepared.kinds, text.kinds);
    let off = (text.kinds[1].volume_mm3 - prepared.kinds[1].volume_mm3).abs();
    assert!(off < 0.01 * text.kinds[1].volume_mm3, "{:?}, expected {:?}", prepared.kinds, text.kinds);
}

#[test]
fn nothing_is_half_written_or_replaced_unasked() {
    let folder = job(PART);
    std::fs::write(folder.path().join("job.html"), "mine").unwrap();
    let refused = |arguments: &[&str], reason: &str| {
        let output = show(folder.path(), arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(errors(&output).contains(reason), "{arguments:?}: {}", errors(&output));
        assert_eq!(names(folder.path()), ["job.gcode", "job.html"]);
    };
    refused(&["job.gcode"], "choose another name with -o");
    refused(&["job.gcode", "-o", "job.gcode"], "this is the job to be read");
    refused(&["job.gcode", "-o", "missing/page.html"], "cannot be written");
    refused(&["job.gcode", "-o", "."], "this is a folder");
    refused(&["missing.gcode", "-o", "page.html"], "cannot be read");
    if Path::new("/dev/full").exists() {
        refused(&["job.gcode", "-o", "/dev/full"], "No space left on device");
    }
    assert_eq!(std::fs::read_to_string(folder.path().join("job.html")).unwrap(), "mine");
    assert_eq!(std::fs::read_to_string(folder.path().join("job.gcode")).unwrap(), PART);
}
