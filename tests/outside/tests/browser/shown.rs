//! Chromium loads the page, turns it, plays it, and jumps from a finding to its place; and it loads
//! two prints beside each other.

use ferrostep_testkit::chromium::chromium;
use ferrostep_testkit::program::repository;
use ferrostep_testkit::python;
use ferrostep_testkit::shown::prints::{ARCS, CUBE, GYROID, Print, WINDOW_S};
use ferrostep_testkit::shown::{compare, errors, show};
use serde_json::{Value, json};

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value}, expected a number"))
}

fn loads(print: Print) {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let file = repository().join(print.file);
    let page = folder.path().join("page.html");
    let arguments = [file.as_os_str(), "-o".as_ref(), page.as_os_str(), "--profile".as_ref(), print.profile.as_ref()];
    assert!(show(folder.path(), arguments).status.success());

    let places = print.ten_places();
    let asked = json!(
        places
            .iter()
            .map(|place| json!({"line": place.line, "to_end_s": place.to_end_s, "window_s": WINDOW_S}))
            .collect::<Vec<_>>()
    );
    let (chromium, asked) = (chromium(), asked.to_string());
    let seen = python::run("show_page.py", &[chromium.to_str().unwrap(), page.to_str().unwrap(), &asked]);
    assert_eq!(seen["errors"], json!([]), "{seen:#}");
    assert_eq!(seen["requests"], json!([]), "{seen:#}");

    // The values that colour the path at ten places are those of the steps there.
    for (place, shown) in places.iter().zip(seen["places"].as_array().unwrap()) {
        assert_eq!(shown["line"], place.line);
        let (speed, expected) = (number(&shown["speed"]), place.speed_mm_per_s);
        assert!((speed - expected).abs() < 2.5 + 0.05 * expected, "{shown}, expected {place:?}");
        for axis in 0..3 {
            let off = (number(&shown["position"][axis]) - place.position_mm[axis]).abs();
            assert!(off < 0.03 + 0.002 * expected, "{shown}, expected {place:?}");
        }
    }
    for way in ["WebGL", "2D canvas"] {
        let drawn = &seen["drawn"][way];
        // The part is in the middle of the picture and fills a good part of it; turned, it
        // looks different.
        let share = number(&drawn["share"]);
        assert!((0.04..0.7).contains(&share), "{way}: {drawn}");
        for middle in drawn["middle"].as_array().unwrap() {
            assert!((0.25..0.75).contains(&number(middle)), "{way}: {drawn}");
        }
        assert!(number(&drawn["colours"]) >= 5.0, "{way}: {drawn}");
        assert_eq!(drawn["turned"], true, "{way}: {drawn}");
        // A coarse picture is drawn during movement where WebGL is computed; at rest the whole
        // one is there again.
        assert!(way != "WebGL" || drawn["coarse"] == true, "{way}: {drawn}");
        assert!((number(&drawn["turned_back"]) / share - 1.0).abs() < 0.005, "{way}: {drawn}");
    }
    assert!(number(&seen["played"][1]) > number(&seen["played"][0]), "{seen:#}");
    let jumps = seen["jumps"].as_array().unwrap();
    assert!(!jumps.is_empty());
    for jump in jumps {
        assert!(number(&jump["line"]) >= number(&jump["wanted"]), "{jump}");
        assert!((number(&jump["time"]) - number(&jump["wanted_time"])).abs() < 1.0, "{jump}");
    }
    assert_eq!(seen["modes"], 14);
    let used = &seen["controls"];
    for jump in ["goto", "clicked"] {
        assert!(number(&used[jump][1]) >= number(&used[jump][0]), "{used:#}");
    }
    assert_eq!(used["followed"], used["goto"][1], "{used:#}");
    assert_eq!(used["moves"][0], true, "{used:#}");
    let layer = format!("layer {}: ", number(&used["moves"][2]) + 1.0);
    assert!(used["moves"][1].as_str().unwrap().starts_with(&layer), "{used:#}");
    assert!(number(&used["features"]) >= 1.0, "{used:#}");
    assert_eq!(used["hidden"], json!([true, true]), "{used:#}");
    assert_eq!(used["marks"], used["marked"], "{used:#}");
    assert_eq!(used["unmarked"], true, "{used:#}");
    assert_eq!(used["folded"], json!([false, false]), "{used:#}");
    assert_eq!(seen["phone_overflow"], json!([0, 0, 0]), "{seen:#}");
    assert!(seen["tip"].as_str().unwrap().contains("line "), "{seen:#}");
}

#[test]
fn chromium_shows_the_cube() {
    loads(CUBE);
}

#[test]
fn chromium_shows_the_gyroid() {
    loads(GYROID);
}

#[test]
fn chromium_shows_arcs_on_corexy() {
    loads(ARCS);
}

/// Two prints on one page: each draws its own, and actions in one leave the other alone.
#[test]
fn chromium_shows_two_prints_beside_each_other() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let (file, page) = (repository().join(CUBE.file), folder.path().join("both.html"));
    let slower = ["--set", "acceleration_mm_per_s2.print=300", "--json"];
    let output = compare(folder.path(), &[&[file.to_str().unwrap(), "-o", "both.html"], &slower[..]].concat());
    assert!(output.status.success(), "{}", errors(&output));
    let said: Value = serde_json::from_slice(&output.stdout).unwrap();
    let times = ["a", "b"].map(|side| number(&said[side]["print_time_s"]));
    assert!(times[1] > 1.1 * times[0], "{said:#}");

    let seen = python::run("compare_page.py", &[chromium().to_str().unwrap(), page.to_str().unwrap()]);
    assert_eq!(seen["errors"], json!([]), "{seen:#}");
    assert_eq!(seen["requests"], json!([]), "{seen:#}");
    let table = seen["table"].as_array().unwrap();
    assert_eq!(table[0], json!(["print time", "23 min 10 s", "26 min 28 s", "+14.2 %"]));
    assert!(table.iter().all(|row| row.as_array().unwrap().len() == 4), "{table:#?}");
    let sides = seen["sides"].as_array().unwrap();
    assert_eq!(sides.len(), 2);
    for (side, time_s) in sides.iter().zip(times) {
        let share = number(&side["picture"]["share"]);
        assert!((0.04..0.7).contains(&share) && number(&side["picture"]["colours"]) >= 5.0, "{side}");
        assert!((number(&side["end"]) - time_s).abs() < 1.0, "{side}, expected {time_s} s");
    }
    // A finding of the first was clicked; the second still shows its end.
    let [ours, other] = [0, 1].map(|side| number(&seen["times"][side]));
    assert!(ours < times[0] - 1.0 && (other - times[1]).abs() < 1.0, "{seen:#}");
    assert_eq!(seen["phone_overflow"], 0, "{seen:#}");
}

/// A filled square of four layers, whose third is stopped by a line.
fn stopping() -> String {
    let mut text = "G28\nM302 P1\nM83\n".to_owned();
    for layer in 1..=4 {
        text += &format!(";LAYER_CHANGE\n;TYPE:<img src=x onerror=alert(1)>\nG1 Z{:.1} F600\n", 0.2 * f64::from(layer));
        for line in 0..100 {
            let y = 60.0 + 0.4 * f64::from(line);
            text += &format!("G0 X60 Y{y:.1} F6000\nG1 X100 E1.3 F3000\n");
        }
        text += if layer == 2 { "G1 X10 Q\"\n" } else { "" };
    }
    text
}

/// The rest of a job that stops is grey, in the legend, and switched by its key; sums leave it out.
#[test]
fn chromium_shows_the_rest_of_a_job_that_stops() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let page = folder.path().join("page.html");
    std::fs::write(folder.path().join("job.gcode"), stopping()).unwrap();
    let output = show(folder.path(), ["job.gcode", "-o", "page.html"]);
    assert!(errors(&output).contains("line 410"), "{}", errors(&output));

    let seen = python::run("rest_page.py", &[chromium().to_str().unwrap(), page.to_str().unwrap()]);
    assert_eq!(seen["errors"], json!([]), "{seen:#}");
    assert_eq!(seen["requests"], json!([]), "{seen:#}");
    for way in ["WebGL", "2D canvas"] {
        let drawn = &seen["drawn"][way];
        let facts = &drawn["facts"];
        assert_eq!(
            (&facts["shown"], &facts["hidden"], &facts["legend"]),
            (&json!(true), &json!(false), &json!("Not executed"))
        );
        assert_eq!((&facts["layers"], &facts["executed"]), (&json!(4), &json!(2)), "{facts:#}");
        assert_eq!(facts["end"], facts["time"], "{facts:#}");
        let text = |key: &str| facts[key].as_str().unwrap();
        assert!(text("finding").starts_with("Stop") && text("finding").contains("line 410"), "{facts:#}");
        assert!(text("figures").contains("0.26 m") && !text("shares").contains("executed"), "{facts:#}");
        assert!(text("about").contains("grey was not executed"), "{facts:#}");
        // The feature's name is text.
        assert!(text("features").contains("<img src=x onerror=alert(1)>"), "{facts:#}");
        assert_eq!(drawn["switched"], json!([false, false]), "{drawn:#}");
        let [with, without, again, layer] = [0, 1, 2, 3].map(|look| number(&drawn["grey"][look]));
        assert!(with > without + 0.05, "{way}: {drawn:#}");
        assert!((again - with).abs() < 0.01 && layer > without + 0.05, "{way}: {drawn:#}");
        assert!(drawn["tip"].as_str().unwrap().contains("line "), "{way}: {drawn:#}");
    }
}
