//! Two ways to follow the nozzle: an extruder with its own step times, and one that steps with the
//! master.
//!
//! Both are computed here along a straight chain of moves, by path alone: the machine's time law is
//! the same for both.

use crate::bresenham::{Classic, Slope, Uncounted};

use crate::tables::chapter::{Cell, Curve, Figure, Style, Table};

/// lambda for layers of 0.2 mm, lines of 0.45 mm, filament of 1.75 mm: 4 h b / (pi D^2).
const LAMBDA: f64 = 4.0 * 0.2 * 0.45 / (std::f64::consts::PI * 1.75 * 1.75);

/// Steps per mm of the profile cartesian.
const MASTER_STEPS_PER_MM: f64 = 80.0;
const EXTRUDER_STEPS_PER_MM: f64 = 95.0;

/// Length of the whole chain, mm.
const CHAIN_MM: f64 = 60.0;

/// Extruder steps per mm of path.
const STEPS_PER_PATH_MM: f64 = LAMBDA * EXTRUDER_STEPS_PER_MM;

/// Positions of the extruder's steps along the chain, mm.
type Steps = Vec<f64>;

/// Steps as the machine makes them: at each half step of lambda s (Wu 2024, eq. 11).
fn by_its_own_times() -> Steps {
    let last = (CHAIN_MM * STEPS_PER_PATH_MM).round() as u32;
    (0..last).map(|step| (f64::from(step) + 0.5) / STEPS_PER_PATH_MM).collect()
}

/// Steps by Bresenham: together with some of the master's steps of each move, from one rounded
/// position to the next.
fn by_the_master(move_mm: f64) -> Steps {
    let master_steps = (move_mm * MASTER_STEPS_PER_MM).round() as u32;
    let mut steps = Vec::new();
    for index in 0..(CHAIN_MM / move_mm).round() as u32 {
        let start_mm = f64::from(index) * move_mm;
        let [from, to] = [start_mm, start_mm + move_mm].map(|at_mm| (at_mm * STEPS_PER_PATH_MM).round() as u32);
        let Ok(slope) = Slope::new(master_steps, to - from) else { continue };
        let mut line = Classic::<Uncounted>::new(slope);
        // The master's step k is due at (k - 1/2) S/N.
        let due = (0..master_steps).filter(|_| line.pass(1)).map(|step| (f64::from(step) + 0.5) / MASTER_STEPS_PER_MM);
        steps.extend(due.map(|along_mm| start_mm + along_mm));
    }
    steps
}

/// Deviation from lambda s just before and just after each step, in steps.
fn deviations(steps: &[f64]) -> impl Iterator<Item = (f64, f64)> {
    steps.iter().zip(0u32..).flat_map(|(&at_mm, made)| {
        let ideal = at_mm * STEPS_PER_PATH_MM;
        [(at_mm, f64::from(made) - ideal), (at_mm, f64::from(made + 1) - ideal)]
    })
}

fn largest_deviation(steps: &[f64]) -> f64 {
    deviations(steps).fold(0.0, |largest, (_, off)| off.abs().max(largest))
}

/// Shortest and longest path between two steps, relative to the one that lambda requires.
fn spacing(steps: &[f64]) -> [f64; 2] {
    let ways = || steps.windows(2).map(|pair| (pair[1] - pair[0]) * STEPS_PER_PATH_MM);
    [ways().fold(f64::INFINITY, f64::min), ways().fold(0.0, f64::max)]
}

/// Table of both methods by length of the moves.
pub fn table() -> Table {
    let own = by_its_own_times();
    let rows = [20.0, 5.0, 2.0, 1.0, 0.5, 0.25].map(|move_mm| {
        let slave = by_the_master(move_mm);
        let mut row = vec![Cell::Number(move_mm, 2)];
        for steps in [&own, &slave] {
            let [shortest, longest] = spacing(steps);
            row.extend([largest_deviation(steps), shortest, longest].map(|number| Cell::Number(number, 3)));
        }
        row
    });
    Table {
        key: "extrusion",
        title: "Section 2.2: an extruder by lambda s, and one that steps with the master's steps by Bresenham"
            .to_owned(),
        columns: vec![
            "moves of, mm",
            "lambda s: farthest off, steps",
            "shortest spacing",
            "longest spacing",
            "Bresenham: farthest off, steps",
            "shortest spacing",
            "longest spacing",
        ],
        rows: rows.to_vec(),
        note: "60 mm in a straight line; layers of 0.2 mm, lines of 0.45 mm, filament of 1.75 mm, 80 and 95 steps/mm. \
               Spacing: of the extruder's steps, by the even one that lambda asks for."
            .to_owned(),
    }
}

/// Figure of both methods along some moves.
pub fn figure() -> Figure {
    let shown_mm = 6.0;
    let curve = |name: &str, steps: &[f64]| Curve {
        name: name.to_owned(),
        style: Style::Line,
        points: deviations(steps).take_while(|(at_mm, _)| *at_mm <= shown_mm).collect(),
    };
    Figure {
        name: "wu-extrusion",
        title: "How far the extruder is from lambda s, along moves of 1 mm".to_owned(),
        x_label: "path, mm",
        y_label: "extruder steps",
        equal_scales: false,
        curves: vec![
            curve("by lambda s", &by_its_own_times()),
            curve("by Bresenham with the master", &by_the_master(1.0)),
        ],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_push_as_much() {
        for move_mm in [20.0, 1.0, 0.5, 0.25] {
            assert_eq!(by_the_master(move_mm).len(), by_its_own_times().len(), "{move_mm}");
        }
    }

    #[test]
    fn an_extruder_by_lambda_is_even_and_never_more_than_half_a_step_off() {
        let own = by_its_own_times();
        assert!((largest_deviation(&own) - 0.5).abs() < 1e-9);
        assert!(spacing(&own).iter().all(|way| (way - 1.0).abs() < 1e-9));
        for (move_mm, longest_at_least) in [(20.0, 1.02), (1.0, 1.15), (0.25, 1.7)] {
            let slave = by_the_master(move_mm);
            assert!(largest_deviation(&slave) > 0.6, "{move_mm}");
            let [shortest, longest] = spacing(&slave);
            assert!(shortest < 0.98 && longest > longest_at_least, "{move_mm}: {shortest} {longest}");
        }
    }
}
