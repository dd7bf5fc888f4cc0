//! The book's table of hazards: every point has its cure and an existing test, or the reason for
//! which it is not a fault.

use std::collections::BTreeSet;
use std::path::Path;

/// The points of the review: its sections 1 to 3, and the deviations of section 4 in their order.
const POINTS: [&str; 37] = [
    "1.1", "1.2", "1.3", "1.4", "1.5", "1.6", "1.7", "2.1", "2.2", "2.3", "2.4", "2.5", "2.6", "2.7", "2.8", "2.9",
    "3.1", "3.2", "3.3", "3.4", "3.5", "3.6", "4.1", "4.2", "4.3", "4.4", "4.5", "4.6", "4.7", "4.8", "4.9", "4.10",
    "4.11", "4.12", "4.13", "4.14", "4.15",
];

/// A row of the table.
struct Row<'a> {
    point: &'a str,
    done: &'a str,
    tests: &'a str,
}

fn rows(page: &str) -> Vec<Row<'_>> {
    page.lines()
        .filter(|line| line.strip_prefix("| ").is_some_and(|row| row.starts_with(|first: char| first.is_ascii_digit())))
        .map(|line| {
            let cells: Vec<&str> = line.trim_matches('|').split(" | ").map(str::trim).collect();
            let [point, _hazard, done, tests] = cells[..] else { panic!("four cells expected: {line}") };
            Row { point, done, tests }
        })
        .collect()
}

/// Names in backticks of the form `file.rs::test`.
fn named(tests: &str) -> Vec<(&str, &str)> {
    let names = tests.split('`').skip(1).step_by(2);
    names.map(|name| name.split_once("::").unwrap_or_else(|| panic!("{name}: expected file.rs::test"))).collect()
}

#[test]
fn every_hazard_has_a_mend_and_an_existing_test() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let page = std::fs::read_to_string(root.join("docs/src/hazards.md")).unwrap();
    let rows = rows(&page);
    let points: Vec<&str> = rows.iter().map(|row| row.point).collect();
    assert_eq!(points, POINTS);
    let mut checked = BTreeSet::new();
    for Row { point, done, tests } in rows {
        let is_no_fault = done.starts_with("No fault:") || done.starts_with("Open:");
        assert!(is_no_fault || !named(tests).is_empty(), "{point}: no test");
        for (file, function) in named(tests) {
            let text =
                std::fs::read_to_string(root.join(file)).unwrap_or_else(|error| panic!("{point}: {file}: {error}"));
            let is_test = text.match_indices(&format!("fn {function}(")).any(|(place, _)| {
                let before = &text[..place];
                let attributes = before.rfind("\n\n").map_or(before, |start| &before[start..]);
                attributes.contains("#[test]") || before.contains("proptest!")
            });
            assert!(is_test, "{point}: {file} has no test {function}");
            checked.insert((file, function));
        }
    }
    assert!(checked.len() > 40, "only {} tests are named", checked.len());
}
