//! The outcomes of many runs as a matrix of fault and state.

use std::collections::BTreeMap;
use std::fmt::Write;

use serde::Serialize;

use super::fault;
use super::state::State;
use super::verdict::Outcome;

/// The outcomes of a fault in a state.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Cell {
    /// Runs.
    pub runs: usize,
    /// The number of runs whose machine has no such part.
    pub without: usize,
    /// The longest time that heaters had power after the fault, ms, among the runs in
    /// which they went off.
    pub worst_off_ms: f64,
    /// The number of runs in which heaters with power went off.
    pub off: usize,
    /// The number of runs with a reset.
    pub resets: usize,
    /// The number of runs with a violation.
    pub violations: usize,
    /// The first lines that hosts read, with their counts.
    pub host_read: BTreeMap<String, usize>,
}

impl Cell {
    /// The line that hosts read most often.
    #[must_use]
    pub fn most_frequent(&self) -> &str {
        self.host_read.iter().max_by_key(|(_, count)| **count).map_or("-", |(line, _)| line)
    }
}

/// The outcomes by fault and state.
#[derive(Debug, Default, Serialize)]
pub struct Matrix {
    /// Rows in the order of [`fault::ALL`]: fault, state, cell.
    pub cells: Vec<(&'static str, State, Cell)>,
}

impl Matrix {
    /// Collects the outcomes of runs.
    #[must_use]
    pub fn new(outcomes: &[Outcome]) -> Self {
        let mut cells: BTreeMap<(&'static str, State), Cell> = BTreeMap::new();
        for outcome in outcomes {
            let cell = cells.entry((outcome.fault, outcome.state)).or_default();
            cell.runs += 1;
            if outcome.without {
                cell.without += 1;
                continue;
            }
            if let (Some(off_ms), true) = (outcome.heaters_off_ms, outcome.was_hot) {
                cell.off += 1;
                cell.worst_off_ms = cell.worst_off_ms.max(off_ms);
            }
            cell.resets += usize::from(!outcome.resets.is_empty());
            cell.violations += usize::from(!outcome.violations.is_empty());
            *cell.host_read.entry(outcome.host_read.clone()).or_default() += 1;
        }
        let mut rows = Vec::new();
        for (name, ..) in fault::ALL {
            for state in State::ALL {
                if let Some(cell) = cells.remove(&(name, state)) {
                    rows.push((name, state, cell));
                }
            }
        }
        Self { cells: rows }
    }

    /// A table for people. Each cell has the longest time until heaters were off, the number of
    /// runs in which they went off, resets after `R`, and violations after an exclamation mark.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = format!("{:<30}", "fault");
        for state in State::ALL {
            let _ = write!(text, "{:<20}", state.name());
        }
        text.push('\n');
        for (name, ..) in fault::ALL {
            let mut row = String::new();
            for state in State::ALL {
                let cell = self.cells.iter().find(|(other, at, _)| *other == name && *at == state);
                let _ = write!(row, "{:<20}", cell.map_or(String::new(), |(.., cell)| brief(cell)));
            }
            if !row.trim().is_empty() {
                let _ = writeln!(text, "{name:<30}{}", row.trim_end());
            }
        }
        text.push_str("\n100ms 3/5 R2 !1: heaters off after at most 100 ms in 3 of 5 runs, 2 resets, 1 violation\n");
        text
    }

    /// The line that hosts read most often, by cell.
    #[must_use]
    pub fn lines(&self) -> String {
        let mut text = String::new();
        for (name, state, cell) in self.cells.iter().filter(|(.., cell)| cell.runs > cell.without) {
            let _ = writeln!(text, "{name:<30}{:<10}{}", state.name(), cell.most_frequent());
        }
        text
    }

    /// The matrix for spreadsheets.
    #[must_use]
    pub fn csv(&self) -> String {
        let mut text = "fault,state,runs,without,off,worst_off_ms,resets,violations,host_read\n".to_owned();
        for (name, state, cell) in &self.cells {
            let _ = writeln!(
                text,
                "{name},{},{},{},{},{:.1},{},{},\"{}\"",
                state.name(),
                cell.runs,
                cell.without,
                cell.off,
                cell.worst_off_ms,
                cell.resets,
                cell.violations,
                cell.most_frequent().replace('"', "\"\"")
            );
        }
        text
    }
}

fn brief(cell: &Cell) -> String {
    if cell.without == cell.runs {
        return "no such part".to_owned();
    }
    let runs = cell.runs - cell.without;
    let mut text = match cell.worst_off_ms {
        _ if cell.off == 0 => format!("- 0/{runs}"),
        worst if worst < 10_000.0 => format!("{worst:.0}ms {}/{runs}", cell.off),
        worst => format!("{:.1}s {}/{runs}", worst / 1e3, cell.off),
    };
    if cell.resets > 0 {
        let _ = write!(text, " R{}", cell.resets);
    }
    if cell.violations > 0 {
        let _ = write!(text, " !{}", cell.violations);
    }
    text
}

/// The command that repeats a run with a violation.
#[must_use]
pub fn reproduction(board: &str, outcome: &Outcome) -> String {
    format!(
        "mainboard faults --board {board} --only {} --state {} --run {}",
        outcome.fault,
        outcome.state.name(),
        outcome.seed
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(off_ms: Option<f64>, violations: &[&str]) -> Outcome {
        Outcome {
            fault: "24v-cut",
            state: State::Printing,
            seed: 1,
            at_s: 0.0,
            detail: String::new(),
            without: false,
            heaters_off_ms: off_ms,
            was_hot: true,
            host_read: "Error:x".to_owned(),
            resets: Vec::new(),
            heard: Vec::new(),
            hottest_celsius: [0.0; 2],
            watched_s: 0.0,
            violations: violations.iter().map(|text| (*text).to_owned()).collect(),
        }
    }

    #[test]
    fn a_cell_has_the_longest_time_and_the_counts() {
        let matrix = Matrix::new(&[outcome(Some(5.0), &[]), outcome(Some(50.0), &["late"]), outcome(None, &[])]);
        assert!(matrix.text().contains("50ms 2/3 !1"), "{}", matrix.text());
        assert!(matrix.csv().contains("24v-cut,printing,3,0,2,50.0,0,1,\"Error:x\""), "{}", matrix.csv());
        assert!(matrix.lines().contains("Error:x"));
    }
}
