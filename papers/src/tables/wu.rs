//! Wu, Wang, Li: Research and optimization of multi-axis linkage interpolation algorithm for
//! 3D printer, 2024.

mod extrusion;

use crate::bresenham::{
    Classic, Counted, FromFirstStair, FromQuotient, Line, LineStair, Slope, Stairs, Uncounted, Widths,
};
use serde_json::Value;

use super::chapter::{Cell, Chapter, Curve, Figure, Style, Table};

/// The committed counts of instructions on the Cortex-M4, which
/// `cargo xtask bench --save-baseline` makes.
const BASELINE: &str = include_str!("../../../xtask/bench-baseline.json");

/// A line of tables 1 to 5.
struct WuLine {
    /// The table's number.
    table: i64,
    name: &'static str,
    /// Key in the baseline.
    key: &'static str,
    end: [u32; 2],
    /// Mean time of five runs in MATLAB, classic and step, ms.
    means_ms: [f64; 2],
}

const LINES: [WuLine; 5] = [
    WuLine { table: 1, name: "y = x/3", key: "x3", end: [30, 10], means_ms: [318.998, 259.955] },
    WuLine { table: 2, name: "y = x/10", key: "x10", end: [100, 10], means_ms: [461.803, 295.806] },
    WuLine { table: 3, name: "y = x/50", key: "x50", end: [500, 10], means_ms: [609.427, 310.604] },
    WuLine { table: 4, name: "y = x/100", key: "x100", end: [1000, 10], means_ms: [936.467, 320.903] },
    WuLine { table: 5, name: "y = x", key: "x1", end: [30, 30], means_ms: [368.590, 368.255] },
];

/// Chapter of Wu's paper, with tables and figures.
pub fn chapter() -> Chapter {
    let baseline = serde_json::from_str(BASELINE).unwrap_or_default();
    let mut figures = vec![
        points("wu-7-tenth", "Fig. 7, y = x/10: points by classic Bresenham, and the line by stairs", [100, 10]),
        points("wu-8-diagonal", "Fig. 8, y = x: points by classic Bresenham, and the line by stairs", [30, 30]),
    ];
    figures.extend(cost_by_slope(&baseline));
    figures.push(extrusion::figure());
    Chapter {
        name: "wu",
        source: "Wu, Wang, Li: Research and optimization of multi-axis linkage interpolation algorithm for 3D printer. \
                 Journal of Northeastern University (Natural Science) 45(1), 2024",
        tables: vec![costs(&baseline), decisions(), extrusion::table()],
        figures,
    }
}

/// A whole number of the baseline.
fn count(baseline: &Value, key: &str) -> Option<i64> {
    key.split('.').try_fold(baseline, |value, key| value.get(key))?.as_i64()
}

fn ratio(one: Option<i64>, by: Option<i64>) -> Cell {
    one.zip(by).map_or(Cell::Empty, |(one, by)| Cell::Number(one as f64 / by as f64, 2))
}

fn costs(baseline: &Value) -> Table {
    let rows = LINES.iter().map(|line| {
        let [classic_ms, step_ms] = line.means_ms;
        let counts = ["classic", "classic_coalesced", "step"]
            .map(|way| count(baseline, &format!("target.bresenham.{}.{way}", line.key)));
        let [classic, coalesced, step] = counts;
        let mut row = vec![
            Cell::Count(line.table),
            line.name.into(),
            Cell::Number(classic_ms, 3),
            Cell::Number(step_ms, 3),
            Cell::Number(classic_ms / step_ms, 2),
        ];
        row.extend(counts.map(|count| count.map_or(Cell::Empty, Cell::Count)));
        row.extend([ratio(classic, step), ratio(coalesced, step)]);
        row
    });
    Table {
        key: "costs",
        title: "Tables 1 to 5: what a line costs, classic and step Bresenham".to_owned(),
        columns: vec![
            "table",
            "line",
            "Wu classic, ms",
            "Wu step, ms",
            "Wu ratio",
            "classic, instructions",
            "coalesced, instructions",
            "step, instructions",
            "classic / step",
            "coalesced / step",
        ],
        rows: rows.collect(),
        note:
            "Wu: mean of five runs in MATLAB, drawing included. Ours: from end point to entries in the step queue on \
               the Cortex-M4, for drivers that step at both edges, of the committed counts (cargo xtask bench); \
               coalesced: classic, with equal steps in one entry."
                .to_owned(),
    }
}

/// Decisions and entries of a line by stairs.
fn by_stairs<W: Widths>(slope: Slope) -> [i64; 2] {
    let mut stairs = Stairs::<W>::new(slope);
    let entries = stairs.by_ref().count() as i64;
    [stairs.decisions() as i64, entries]
}

fn decisions() -> Table {
    let rows = LINES.iter().filter_map(|line| {
        let [dx, dy] = line.end;
        let slope = Slope::new(dx, dy).ok()?;
        let mut classic = Classic::<Counted>::new(slope);
        classic.pass(dx);
        let [from_first, entries] = by_stairs::<FromFirstStair<Counted>>(slope);
        let [from_quotient, _] = by_stairs::<FromQuotient<Counted>>(slope);
        let counts = [classic.decisions() as i64, from_first, from_quotient, dx.into(), entries].map(Cell::Count);
        Some([Cell::Count(line.table), line.name.into()].into_iter().chain(counts).collect())
    });
    Table {
        key: "decisions",
        title: "The same lines: decision values compared with zero, and entries for the step queue".to_owned(),
        columns: vec![
            "table",
            "line",
            "classic",
            "step, from the first stair (corollary 2)",
            "step, from the quotient (corollary 1)",
            "classic, entries",
            "step, entries",
        ],
        rows: rows.collect(),
        note: "From the first stair: it is counted, then one comparison or two a stair. y = x is one run of its \
               complement's stairs: nothing to decide."
            .to_owned(),
    }
}

/// A line's points and its way by stairs.
fn points(name: &'static str, title: &str, end: [i64; 2]) -> Figure {
    let place = |[x, y]: [i32; 2]| (f64::from(x), f64::from(y));
    let (mut classic, mut stairs) = (vec![(0.0, 0.0)], vec![(0.0, 0.0)]);
    if let Ok(line) = Line::new(end) {
        classic.extend(line.points::<Uncounted>().map(place));
        let mut at = [0, 0];
        for LineStair { count, axes, differing } in line.stairs::<FromQuotient>() {
            let last = i32::from(differing != 0);
            for (events, axes) in [(count as i32 - last, axes), (last, axes ^ differing)] {
                for (axis, at) in at.iter_mut().enumerate() {
                    *at += events * i32::from(axes >> axis & 1);
                }
                stairs.push(place(at));
            }
        }
    }
    let ideal = [0.0, 1.0].map(|part| (part * end[0] as f64, part * end[1] as f64)).to_vec();
    Figure {
        name,
        title: title.to_owned(),
        x_label: "x, steps",
        y_label: "y, steps",
        equal_scales: end[0] == end[1],
        curves: vec![
            Curve { name: "classic: points".to_owned(), style: Style::Points, points: classic },
            Curve { name: "step: line".to_owned(), style: Style::Line, points: stairs },
            Curve { name: "ideal".to_owned(), style: Style::Dashed, points: ideal },
        ],
    }
}

/// Instructions against slope, where the committed counts have them.
fn cost_by_slope(baseline: &Value) -> Option<Figure> {
    let lines = baseline.pointer("/target/bresenham_slopes")?.as_array()?;
    let curve = |name: &str, way: &str| Curve {
        name: name.to_owned(),
        style: Style::LineAndPoints,
        points: lines
            .iter()
            .filter_map(|line| Some((line.get("dy")?.as_f64()?, line.get(way)?.get("instructions")?.as_f64()?)))
            .collect(),
    };
    Some(Figure {
        name: "wu-cost-by-slope",
        title: "Instructions of a line from (0, 0) to (100, dy), to entries in the step queue".to_owned(),
        x_label: "dy, steps",
        y_label: "instructions",
        equal_scales: false,
        curves: vec![
            curve("classic", "classic"),
            curve("classic, coalesced", "classic_coalesced"),
            curve("step", "step"),
        ],
    })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn the_committed_counts_have_every_line() {
        let baseline: Value = serde_json::from_str(BASELINE).unwrap();
        let table = costs(&baseline);
        assert!(table.rows.iter().flatten().all(|cell| *cell != Cell::Empty), "{:?}", table.rows);
        let slopes = cost_by_slope(&baseline).unwrap();
        assert!(slopes.curves.iter().all(|curve| curve.points.len() >= 20));
        // Step Bresenham is never the slower one.
        let [_, coalesced, step] = &slopes.curves[..] else { panic!("three ways") };
        assert!(coalesced.points.iter().zip(&step.points).all(|(coalesced, step)| step.1 < coalesced.1));
    }

    #[test]
    fn ratios_of_the_paper_are_its_own() {
        let ratios = LINES.each_ref().map(|line| (line.means_ms[0] / line.means_ms[1] * 100.0).round() / 100.0);
        assert_eq!(ratios, [1.23, 1.56, 1.96, 2.92, 1.00]);
    }

    #[test]
    fn figures_end_where_their_lines_do() {
        for figure in &chapter().figures[..2] {
            let ends: Vec<_> = figure.curves.iter().map(|curve| *curve.points.last().unwrap()).collect();
            assert!(ends.windows(2).all(|pair| pair[0] == pair[1]), "{ends:?}");
        }
    }
}
