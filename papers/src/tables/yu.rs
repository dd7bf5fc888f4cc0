//! Yu 2019: the permissible corner speed, and the effect of look-ahead on a chain of moves.

use ferrostep_planner::kinematics::UNITS_PER_MM;
use ferrostep_planner::{Move, PlannedBlock};

use super::chapter::{Cell, Chapter, Curve, Figure, Style, Table};
use super::example_machine::example_planner;

/// Yu's delta, mm.
const DEVIATION_MM: f64 = 0.1;

/// Acceleration of the examples, mm/s^2.
const ACCELERATION_MM_PER_S2: f64 = 1000.0;

/// Feedrate of the examples, mm/s.
const FEED_MM_PER_S: f32 = 100.0;

/// Chapter of Yu's paper, with tables and figures.
pub fn chapter() -> Chapter {
    Chapter {
        name: "yu",
        source: "Yu: G code preprocessing optimization algorithm for 3D printers. China Mechanical Engineering 30(1), 2019",
        tables: vec![corners(), chain()],
        figures: vec![arc(), speeds_along(), extrusion()],
    }
}

/// Look-ahead's plan of moves to these points, mm, with an equal amount of filament each, mm.
fn planned(places_mm: &[(f64, f64)], filament_mm: f64) -> Vec<PlannedBlock> {
    let Some(mut planner) = example_planner(ACCELERATION_MM_PER_S2, DEVIATION_MM, 64) else { return vec![] };
    let units = |mm: f64| (mm * UNITS_PER_MM as f64).round() as i64;
    for (line, &(x, y)) in (1..).zip(places_mm) {
        let request = Move {
            target_10nm: [units(x), units(y), 0],
            filament_100pm: 100 * units(filament_mm),
            feed_mm_per_s: FEED_MM_PER_S,
            line,
            ends_move: true,
        };
        if planner.add(&request).is_err() {
            return vec![];
        }
    }
    planner.flush();
    std::iter::from_fn(|| planner.next_planned()).collect()
}

/// Speed in the corner between two moves of this length, the second turned by an angle, mm/s.
fn corner_speed_mm_per_s(angle: f64, length_mm: f64) -> f64 {
    let corner = (length_mm, 0.0);
    let end = (length_mm * (1.0 + angle.cos()), length_mm * angle.sin());
    // Long moves before and after, in line with the two, so that only the corner limits the speed.
    let turned = (end.0 + 100.0 * angle.cos(), end.1 + 100.0 * angle.sin());
    let blocks = planned(&[(-100.0, 0.0), (0.0, 0.0), corner, end, turned], 0.0);
    // Moves in line become one block: the corner is the change of direction.
    let before = blocks.iter().rfind(|planned| planned.block.line <= 3);
    before.map_or(0.0, |planned| planned.exit.mm_per_s())
}

/// Yu's radius, mm.
fn radius_mm(angle: f64) -> f64 {
    let half = (angle / 2.0).cos();
    DEVIATION_MM * half / (1.0 - half)
}

/// Radius of the arc that touches two moves of this length at their midpoints, mm.
fn fitting_radius_mm(angle: f64, length_mm: f64) -> f64 {
    0.5 * length_mm / (angle / 2.0).tan()
}

fn corners() -> Table {
    let rows = [5.0f64, 10.0, 20.0, 30.0, 45.0, 60.0, 90.0, 120.0, 150.0, 170.0, 180.0]
        .map(|degrees| {
            let angle = degrees.to_radians();
            let (radius, fitting) = (radius_mm(angle), fitting_radius_mm(angle, 1.0));
            let speed = |radius: f64| (ACCELERATION_MM_PER_S2 * radius.max(0.0)).sqrt();
            vec![
                Cell::Number(degrees, 0),
                Cell::Number(radius.max(0.0), 3),
                Cell::Number(speed(radius), 2),
                Cell::Number(corner_speed_mm_per_s(angle, 20.0), 2),
                Cell::Number(fitting.max(0.0), 3),
                Cell::Number(speed(radius.min(fitting)), 2),
                Cell::Number(corner_speed_mm_per_s(angle, 1.0), 2),
            ]
        })
        .to_vec();
    Table {
        key: "corners",
        title: "Section 1.3.1, junction speed by the arc: delta = 0.1 mm, a = 1000 mm/s^2, feed 100 mm/s".to_owned(),
        columns: vec![
            "theta, degrees",
            "R by delta, mm",
            "sqrt(aR), mm/s",
            "ours, moves of 20 mm",
            "R that fits 1 mm, mm",
            "sqrt(aR), mm/s",
            "ours, moves of 1 mm",
        ],
        rows,
        note:
            "Ours are speeds as look-ahead settles them, at most the feed. Yu's radius alone would let short moves be \
               taken as fast as long ones; the arc must also end before the middle of the shorter move."
                .to_owned(),
    }
}

/// A long move, a zigzag, and a long move.
fn zigzag() -> Vec<(f64, f64)> {
    let mut places = vec![(20.0, 0.0)];
    let mut x = 20.0;
    for (index, length) in [2.0, 1.0, 0.5, 0.5, 1.0, 2.0, 4.0].into_iter().enumerate() {
        x += length;
        places.push((x, if index % 2 == 0 { 0.25 * length } else { 0.0 }));
    }
    places.push((x + 20.0, 0.0));
    places
}

fn chain() -> Table {
    let blocks = planned(&zigzag(), 0.0);
    // Row of each block, computed backwards from the last: v_s^2 = v_e^2 + 2 a s, with look-ahead's
    // v_e.
    let rows = blocks
        .iter()
        .map(|planned| {
            let length = planned.block.length_mm();
            let (entry, exit) = (planned.entry.mm_per_s(), planned.exit.mm_per_s());
            let reverse = (exit * exit + 2.0 * ACCELERATION_MM_PER_S2 * length).sqrt();
            let forward = (entry * entry + 2.0 * ACCELERATION_MM_PER_S2 * length).sqrt();
            vec![
                Cell::Count(planned.block.line.into()),
                Cell::Number(length, 3),
                Cell::Number(entry, 2),
                Cell::Number(reverse, 2),
                Cell::Number(exit, 2),
                Cell::Number(forward, 2),
            ]
        })
        .collect();
    Table {
        key: "reverse_pass",
        title: "Section 1.3.2, reverse pass: a zigzag of short moves between two long ones".to_owned(),
        columns: vec![
            "move",
            "length, mm",
            "entry, mm/s",
            "entry allowed by its exit",
            "exit, mm/s",
            "exit allowed by its entry",
        ],
        rows,
        note: "No entry is above what stopping in time allows, no exit above what accelerating allows.".to_owned(),
    }
}

/// Fig. 2.
fn arc() -> Figure {
    let angle = 60f64.to_radians();
    let half = angle / 2.0;
    let radius = radius_mm(angle);
    let touch = radius * half.tan();
    let (sine, cosine) = angle.sin_cos();
    // The corner is the origin; the first move arrives along x.
    let centre = (-touch, radius);
    let rounded = (0..=60)
        .map(|index| {
            let turned = angle * f64::from(index) / 60.0;
            (centre.0 + radius * turned.sin(), centre.1 - radius * turned.cos())
        })
        .collect();
    let nearest = (centre.0 + radius * half.sin(), centre.1 - radius * half.cos());
    let long = 1.6 * touch;
    Figure {
        name: "yu-junction-arc",
        title: "Yu 2019, fig. 2: the arc that rounds a corner of 60 degrees, OA = delta = 0.1 mm".to_owned(),
        x_label: "x, mm",
        y_label: "y, mm",
        equal_scales: true,
        curves: vec![
            Curve {
                name: "path".to_owned(),
                style: Style::Line,
                points: vec![(-long, 0.0), (0.0, 0.0), (long * cosine, long * sine)],
            },
            Curve { name: format!("arc, R = {radius:.3} mm"), style: Style::Line, points: rounded },
            Curve { name: "OA".to_owned(), style: Style::LineAndPoints, points: vec![(0.0, 0.0), nearest] },
            Curve {
                name: "radii to where it touches".to_owned(),
                style: Style::Dashed,
                points: vec![(-touch, 0.0), centre, (touch * cosine, touch * sine)],
            },
        ],
    }
}

/// Speeds over a block's path, the ramps in pieces.
fn speed_over_path(planned: &PlannedBlock, start_mm: f64) -> Vec<(f64, f64)> {
    let length = planned.block.length_mm();
    let gain = 2.0 * planned.block.acceleration.mm_per_s2();
    let (entry, exit, nominal) = (planned.entry.mm_per_s(), planned.exit.mm_per_s(), planned.block.nominal.mm_per_s());
    (0..=80)
        .map(|index| {
            let at = length * f64::from(index) / 80.0;
            let squared = (entry * entry + gain * at).min(exit * exit + gain * (length - at)).min(nominal * nominal);
            (start_mm + at, squared.sqrt())
        })
        .collect()
}

/// Speed over the path of some blocks.
fn speeds(blocks: &[PlannedBlock]) -> Vec<(f64, f64)> {
    let mut start = 0.0;
    let mut points = Vec::new();
    for planned in blocks {
        points.extend(speed_over_path(planned, start));
        start += planned.block.length_mm();
    }
    points
}

fn speeds_along() -> Figure {
    let blocks = planned(&zigzag(), 0.0);
    let mut start = 0.0;
    let mut ends = vec![(0.0, 0.0)];
    for planned in &blocks {
        start += planned.block.length_mm();
        ends.push((start, planned.exit.mm_per_s()));
    }
    Figure {
        name: "yu-look-ahead",
        title: "Yu 2019, sections 1.3.1 and 1.3.2: speed along the zigzag, settled by look-ahead".to_owned(),
        x_label: "path, mm",
        y_label: "speed, mm/s",
        equal_scales: false,
        curves: vec![
            Curve { name: "speed along the path".to_owned(), style: Style::Line, points: speeds(&blocks) },
            Curve { name: "ends of the moves".to_owned(), style: Style::Points, points: ends },
        ],
    }
}

/// Section 1.3.3.
fn extrusion() -> Figure {
    let filament_mm = 0.5;
    let blocks = planned(&[(15.0, 0.0), (15.0, 15.0), (0.0, 15.0)], filament_mm);
    let nozzle = speeds(&blocks);
    // dE/S is the same in all three moves.
    let filament_per_path = filament_mm / 15.0;
    let hundredfold = nozzle.iter().map(|&(at, speed)| (at, 100.0 * filament_per_path * speed)).collect();
    let constant = nozzle.iter().map(|&(at, _)| (at, 100.0 * filament_per_path * f64::from(FEED_MM_PER_S))).collect();
    Figure {
        name: "yu-extrusion",
        title: "Yu 2019, section 1.3.3: filament through the slow-down at two right angles".to_owned(),
        x_label: "path, mm",
        y_label: "speed, mm/s; of the filament 1/100 mm/s",
        equal_scales: false,
        curves: vec![
            Curve { name: "nozzle".to_owned(), style: Style::Line, points: nozzle },
            Curve { name: "filament, following it".to_owned(), style: Style::Line, points: hundredfold },
            Curve {
                name: "filament at a constant rate: a blob at each corner".to_owned(),
                style: Style::Dashed,
                points: constant,
            },
        ],
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// Number in a column of a row.
    fn number(row: &[Cell], column: usize) -> f64 {
        match row[column] {
            Cell::Number(number, _) => number,
            ref other => panic!("{other:?}"),
        }
    }

    #[test]
    fn look_ahead_takes_corners_as_the_formulas_say() {
        for row in &corners().rows {
            for (formula, ours) in [(2, 3), (5, 6)] {
                let expected = number(row, formula).min(FEED_MM_PER_S.into());
                assert!((number(row, ours) - expected).abs() < 0.01 + 1e-4 * expected, "{row:?}");
            }
        }
    }

    #[test]
    fn the_chain_stops_in_time_and_never_accelerates_too_fast() {
        let rows = chain().rows;
        assert_eq!(rows.len(), 9);
        for row in &rows {
            assert!(number(row, 2) <= number(row, 3) + 0.01 && number(row, 4) <= number(row, 5) + 0.01, "{row:?}");
        }
        assert_eq!(number(&rows[0], 2), 0.0);
        assert_eq!(number(rows.last().unwrap(), 4), 0.0);
    }
}
