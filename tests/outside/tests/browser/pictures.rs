//! Pictures of the page, kept in the book and beside the tests: pictures drawn now have
//! their structure.
//!
//! `FERROSTEP_REFRESH=1` takes them anew. Pixels differ with the browser and its fonts, so they
//! are not compared.

use ferrostep_checked_toml::book::REFRESH_VARIABLE;
use ferrostep_testkit::chromium::chromium;
use ferrostep_testkit::program::repository;
use ferrostep_testkit::python;
use ferrostep_testkit::shown::prints::{ARCS, CUBE, GYROID, Print};
use ferrostep_testkit::shown::show;
use serde_json::{Value, json};

/// Prints with their kept pictures, from the root. The gyroid's is the README's.
const PICTURES: [(Print, &str); 3] = [
    (CUBE, "tests/data/pages/cube.png"),
    (GYROID, "docs/src/images/show.png"),
    (ARCS, "tests/data/pages/arcs-corexy.png"),
];

/// Greatest mean difference of the parts' colours, of 255. Another print differs by more
/// than twice that.
const MOST_OFF: f64 = 2.5;

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value}, expected a number"))
}

/// Difference between two pictures; `None` if their structure is the same.
fn difference(a: &Value, b: &Value) -> Option<String> {
    if a["size"] != b["size"] {
        return Some(format!("{} by {}", a["size"], b["size"]));
    }
    let parts = [a, b].map(|picture| picture["parts"].as_array().unwrap().iter().map(number).collect::<Vec<_>>());
    let sum: f64 = parts[0].iter().zip(&parts[1]).map(|(a, b)| (a - b).abs()).sum();
    let off = sum / parts[0].len() as f64;
    let share = number(&a["share"]) / number(&b["share"]);
    let middles = [0, 1].map(|axis| (number(&a["middle"][axis]) - number(&b["middle"][axis])).abs());
    let is_same = off < MOST_OFF && (0.9..1.1).contains(&share) && middles.iter().all(|off| *off < 0.02);
    (!is_same).then(|| format!("colours {off:.2} apart, {share:.3} of the print's share, middles {middles:.3?} apart"))
}

#[test]
fn the_kept_pictures_show_what_the_pages_show() {
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
    let mut taken = Vec::new();
    for (print, kept) in PICTURES {
        let (page, new) = (folder.path().join("page.html"), folder.path().join("new.png"));
        let file = repository().join(print.file);
        let arguments =
            [file.as_os_str(), "-o".as_ref(), page.as_os_str(), "--profile".as_ref(), print.profile.as_ref()];
        assert!(show(folder.path(), arguments).status.success());
        let kept_file = repository().join(kept);
        let mut arguments = vec![chromium(), page, new.clone()];
        let is_written = std::env::var_os(REFRESH_VARIABLE).is_some();
        if !is_written {
            arguments.push(kept_file.clone());
        }
        let arguments: Vec<&str> = arguments.iter().map(|argument| argument.to_str().unwrap()).collect();
        let seen = python::run("page_picture.py", &arguments);
        assert_eq!((&seen["errors"], &seen["requests"]), (&json!([]), &json!([])), "{seen:#}");
        if is_written {
            std::fs::copy(&new, &kept_file).unwrap();
        } else {
            let off = difference(&seen["pictures"][0], &seen["pictures"][1]);
            assert_eq!(off, None, "{kept} has changed: look at the page, then set {REFRESH_VARIABLE} to keep it");
        }
        taken.push(seen["pictures"][0].clone());
    }
    // Another print has another structure.
    for (index, a) in taken.iter().enumerate() {
        assert!(taken[..index].iter().all(|b| difference(a, b).is_some()), "{:?}", PICTURES[index].1);
    }
}
