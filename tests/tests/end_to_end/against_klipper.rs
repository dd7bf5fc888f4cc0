//! The table of time and error beside Klipper's rules: a part of it, measured again.

use ferrostep_planner::ShaperKind;
use ferrostep_random_cases::share_of;
use ferrostep_testkit::against_klipper::chart;
use ferrostep_testkit::against_klipper::table::{Case, Cell, FRAMES, Plan, measure, row_start, write_job};

use crate::end_to_end::command::{directory, repository};

/// Numbers of a row: time, s, and an error for each frame, um.
fn row(page: &str, name: &str, plan: Plan, kind: ShaperKind) -> Vec<f64> {
    let start = row_start(name, plan, kind);
    let line = page.lines().find(|line| line.starts_with(&start)).unwrap_or_else(|| panic!("no row {start}"));
    let cells: Vec<f64> =
        line[start.len()..].trim_end_matches('|').split('|').map(|cell| cell.trim().parse().unwrap()).collect();
    assert_eq!(cells.len(), 1 + FRAMES.len(), "{line}");
    cells
}

#[test]
fn the_books_chart_shows_the_tables() {
    chart::keep_current(&repository()).unwrap();
}

#[test]
fn the_rows_are_what_the_simulator_measures() {
    let page = std::fs::read_to_string(repository().join("tests/data/against-klipper.md")).unwrap();
    let folder = directory();
    let case = Case::bed_slinger(&repository(), "cube", &repository().join("examples/cube.gcode"));
    let job = write_job(&case, folder.path());
    let cells = [
        (Plan::Ferrostep, ShaperKind::Zv, 0),
        (Plan::CloserFerrostep, ShaperKind::Mzv, 5),
        (Plan::BudgetFerrostep, ShaperKind::Zv, 1),
        (Plan::TolerantFerrostep, ShaperKind::Mzv, 2),
        (Plan::Klipper, ShaperKind::Mzv, 0),
        (Plan::TunedKlipper, ShaperKind::Zv, 3),
    ];
    // The first cell in every run, and this run's share of the others.
    for index in std::iter::once(0).chain(share_of(cells.len() as u64 - 1).map(|index| index as usize + 1)) {
        let (plan, kind, frame) = cells[index];
        let written = row(&page, "cube", plan, kind);
        let (time_s, p99_um) = measure(&case, &job, Cell { plan, kind, off: FRAMES[frame] });
        let make = "FERROSTEP_REFRESH=1 cargo xtask against-klipper";
        let off = [time_s - written[0], p99_um - written[1 + frame]];
        // The tolerance is the book's last digit; sine and exponential are the computer's own.
        assert!(off[0].abs() < 0.11 && off[1].abs() < 1.01, "{plan:?} {kind:?}: {time_s} {p99_um}; {make}");
    }
}
