//! `ferrostep papers`: tables, pictures, comparisons.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::Value;
use tempfile::TempDir;

use crate::end_to_end::command::{ferrostep, repository};

/// Variable with which the test writes the book's pictures and tables anew.
pub const REFRESH_VARIABLE: &str = "FERROSTEP_REFRESH";

/// Name and text of every picture in a folder.
fn pictures(folder: &Path) -> BTreeMap<String, String> {
    std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| {
            let path = entry.unwrap().path();
            (path.file_name().unwrap().to_str().unwrap().to_owned(), std::fs::read_to_string(path).unwrap())
        })
        .collect()
}

#[test]
fn every_paper_has_its_tables() {
    let all = ferrostep(["papers", "--json"]);
    assert_eq!((all.status, all.stderr.as_str()), (Some(0), ""));
    let all = all.json();
    let papers = all["papers"].as_array().unwrap();
    let names: Vec<_> = papers.iter().map(|paper| paper["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["wu", "yu", "corexy", "li"]);
    for (name, paper) in names.iter().zip(papers) {
        let tables = paper["tables"].as_array().unwrap();
        assert!(
            !tables.is_empty() && tables.iter().all(|table| !table["rows"].as_array().unwrap().is_empty()),
            "{name}"
        );
        let alone = ferrostep(["papers", name, "--json"]).json();
        assert_eq!(&alone["papers"][0], paper);
        let text = ferrostep(["papers", name]);
        assert_eq!(text.status, Some(0));
        for table in tables {
            assert!(text.stdout.contains(table["title"].as_str().unwrap()), "{name}");
        }
    }
}

#[test]
fn the_books_figures_match_the_command() {
    let in_book = repository().join("docs/src/images/papers");
    let folder = TempDir::new().unwrap();
    let drawn = ferrostep(["papers".as_ref(), "--svg".as_ref(), folder.path().as_os_str()]);
    assert_eq!(drawn.status, Some(0), "{drawn:?}");
    let drawn = pictures(folder.path());
    if std::env::var_os(REFRESH_VARIABLE).is_some() {
        std::fs::create_dir_all(&in_book).unwrap();
        for (name, text) in &drawn {
            std::fs::write(in_book.join(name), text).unwrap();
        }
    }
    let kept = pictures(&in_book);
    assert_eq!(drawn.keys().collect::<Vec<_>>(), kept.keys().collect::<Vec<_>>());
    for (name, text) in &drawn {
        assert!(&kept[name] == text, "{name} has changed: look at it, then set {REFRESH_VARIABLE} to keep it");
    }
}

#[test]
fn the_table_matches_the_command() {
    const PLACE: &str = "<!-- what `papers --compare` prints -->\n";
    let page = repository().join("tests/data/papers-compare.md");
    let text = std::fs::read_to_string(&page).unwrap();
    let (before, kept) = text.split_once(PLACE).unwrap();
    let compared = ferrostep(["papers", "--compare", "examples/cube.gcode"]);
    assert_eq!(compared.status, Some(0), "{compared:?}");
    let printed = format!("\n{}", compared.stdout);
    if std::env::var_os(REFRESH_VARIABLE).is_some() {
        std::fs::write(page, format!("{before}{PLACE}{printed}")).unwrap();
    } else {
        assert!(kept == printed, "the table has changed: look at it, then set {REFRESH_VARIABLE} to keep it");
    }
}

#[test]
fn compare_prints_a_file_in_every_way() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("corner.gcode");
    std::fs::write(&file, "M302 P1\nG28\nG1 X30 Y20 F6000\nG1 X60 Y21 E1\nG1 X60 Y60 E2\nG1 Z2\n").unwrap();
    for profile in ["cartesian", "corexy"] {
        let compared = ferrostep([
            "papers".as_ref(),
            "--compare".as_ref(),
            file.as_os_str(),
            "--profile".as_ref(),
            profile.as_ref(),
            "--json".as_ref(),
        ]);
        assert_eq!(compared.status, Some(0), "{compared:?}");
        let table = &compared.json()["choices"];
        let rows = table["rows"].as_array().unwrap();
        assert_eq!(rows.len(), 20);
        let column = |name: &str| {
            let columns = table["columns"].as_array().unwrap();
            columns.iter().position(|column| column.as_str().unwrap().starts_with(name)).unwrap()
        };
        for row in rows {
            let number = |name: &str| row[column(name)].as_f64().unwrap_or_else(|| panic!("{name} of {row}"));
            let limit = if profile == "corexy" { 10_000.0 } else { 1_000.0 };
            assert!(number("motion") > 1.0 && number("most events") > 1_000.0, "{row}");
            // Differences over 10 ms of positions that are whole steps, which of point-by-point
            // are the coarsest. The paper's table is slow: 30,000 Hz/s at most, whatever the
            // machine could do.
            let (least, most) = match (row[0].as_str().unwrap(), row[1].as_str().unwrap()) {
                (_, "s-curve-table") => (100.0, limit),
                ("point-by-point", _) => (0.4 * limit, 1.2 * limit),
                _ => (0.4 * limit, 1.05 * limit),
            };
            assert!(number("peak acceleration") > least && number("peak acceleration") < most, "{row}");
            assert!(number("largest path error") < 0.03, "{row}");
            // An exact one is half a step off just before and just after a step.
            assert!(number("extruder") > 0.49 && number("extruder") < 1.0, "{row}");
        }
        // Each method makes other steps.
        let digests: std::collections::BTreeSet<_> =
            rows.iter().map(|row| row[column("step digest")].to_string()).collect();
        assert!(digests.len() >= 14, "{digests:?}");
        let jerk = |acceleration: &str| {
            let of = |row: &&Value| row[0] == "step-bresenham" && row[1] == acceleration;
            rows.iter().find(of).unwrap()[column("peak jerk")].as_f64().unwrap()
        };
        assert!(jerk("s-curve") < 0.5 * jerk("trapezoid"), "{profile}: {} {}", jerk("s-curve"), jerk("trapezoid"));
    }
}

#[test]
fn impossible_comparisons_and_figures_are_refused() {
    let missing = ferrostep(["papers", "--compare", "no-such-file.gcode"]);
    assert_eq!(missing.status, Some(2));
    assert!(missing.stderr.contains("no-such-file.gcode"), "{missing:?}");
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("in-the-way");
    std::fs::write(&file, "G1 X1000000\n").unwrap();
    let drawn = ferrostep(["papers".as_ref(), "yu".as_ref(), "--svg".as_ref(), file.as_os_str()]);
    assert_eq!(drawn.status, Some(2));
    assert!(drawn.stderr.contains("in-the-way: cannot be written"), "{drawn:?}");
    assert_eq!(ferrostep(["papers", "euclid"]).status, Some(2));
    assert_eq!(ferrostep(["papers", "--profile", "corexy"]).status, Some(2));
}
