//! Li 2017: the S-curve, its table, its cases, and the gain from a law that spans several moves.

use std::f64::consts::TAU;

use crate::CurveError;
use crate::Papers;
use crate::closed_form::{Profile, Ramp};
use crate::plan::Plan;
use crate::segments::{Line, Segments};
use crate::table::FrequencyTable;
use ferrostep_planner::kinematics::UNITS_PER_MM;
use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::{AccelerationProfile, MotionChoice, Move, Planner, TICKS_PER_SECOND};

use super::chapter::{Cell, Chapter, Curve, Figure, Style, Table};
use super::example_machine::example_planner;

/// The paper's experiment: start and highest frequency, Hz, and the jerk, Hz/s^2.
const START_HZ: f64 = 1_000.0;
const TOP_HZ: f64 = 10_000.0;
const JERK_HZ_PER_S2: f64 = 100_000.0;

/// Number of points in a curve.
const POINTS: u32 = 240;

/// Chapter of Li's paper, with tables and figures.
pub fn chapter() -> Chapter {
    // The constants above are in range.
    let (tables, figures) = content().unwrap_or_default();
    Chapter {
        name: "li",
        source: "Li, Dang, Huang, Zhao: Implementation of S-curve acceleration and deceleration control for 3D printing. \
                 Modular Machine Tool & Automatic Manufacturing Technique 2017(8)",
        tables,
        figures,
    }
}

fn content() -> Result<(Vec<Table>, Vec<Figure>), CurveError> {
    let ramp = Ramp::new(START_HZ, TOP_HZ, JERK_HZ_PER_S2, f64::INFINITY)?;
    let table = FrequencyTable::new(START_HZ, TOP_HZ, JERK_HZ_PER_S2)?;
    let tables = vec![experiment(&ramp, &table), slices(&ramp, &table), cases(&table), queue(&table), gains()];
    Ok((tables, vec![speed(&ramp, &table), acceleration(&ramp), short_segment(&table)?, runs()]))
}

fn number(number: f64) -> Cell {
    Cell::Number(number, 1)
}

/// The paper's figures for its ramp next to the computed ones.
fn experiment(ramp: &Ramp, table: &FrequencyTable) -> Table {
    let at_starts: f64 = table.iter().map(|slice| table.frequency_at(slice.start_s) * slice.duration_s).sum();
    let row = |what: &str, unit: &str, value: Cell| vec![what.into(), value, unit.into()];
    Table {
        key: "experiment",
        title: "The ramp of the paper's experiment: 1000 to 10000 Hz, j = 100000 Hz/s^2".to_owned(),
        columns: vec!["quantity", "value", "unit"],
        rows: vec![
            row("t1 = sqrt((Vt - V0)/j)", "s", Cell::Number(ramp.half_time_s(), 4)),
            row("greatest acceleration j t1", "Hz/s", number(ramp.peak_acceleration())),
            row("pulses, (V0 + Vt) t1", "", number(ramp.length())),
            row("slices of T = 2/f0", "", Cell::Count(table.len() as i64)),
            row("pulses of the table, frequencies of the slices' middles", "", number(table.pulses())),
            row("pulses of the table, frequencies of the slices' starts (paper)", "", number(at_starts)),
        ],
        note: "The machine's table takes the middles.".to_owned(),
    }
}

/// The table itself, every thirtieth slice.
fn slices(ramp: &Ramp, table: &FrequencyTable) -> Table {
    let rows = table.iter().enumerate().filter(|(index, _)| index % 30 == 0).map(|(index, slice)| {
        let exact = ramp.at(slice.start_s);
        vec![
            Cell::Count(index as i64),
            Cell::Number(slice.start_s, 3),
            number(slice.frequency_hz),
            number(slice.pulses_before),
            number(exact.length),
        ]
    });
    Table {
        key: "table",
        title: "The table of frequencies (sect. 1.2)".to_owned(),
        columns: vec!["slice", "from, s", "frequency, Hz", "pulses before, F", "closed form"],
        rows: rows.collect(),
        note: String::new(),
    }
}

/// A segment of each of the paper's cases.
fn cases(table: &FrequencyTable) -> Table {
    let segments = [
        ("(a)", 10_000.0, 1_000.0, 1_000.0, 10_000.0),
        ("(b)", 2_000.0, 1_000.0, 4_000.0, 10_000.0),
        ("(c)", 6_000.0, 8_000.0, 2_000.0, 5_000.0),
        ("(d)", 6_000.0, 2_000.0, 8_000.0, 5_000.0),
        ("both above the run", 6_000.0, 8_000.0, 8_000.0, 5_000.0),
        ("too short", 50.0, 2_000.0, 8_000.0, 9_000.0),
        ("below f0", 500.0, 0.0, 0.0, 400.0),
    ];
    let rows = segments.map(|(case, pulses, start_hz, stop_hz, run_hz)| {
        let plan = Plan::new(table, pulses, start_hz, stop_hz, run_hz);
        let mut row = vec![case.into()];
        row.extend([pulses, start_hz, run_hz, stop_hz].map(|value| Cell::Count(value as i64)));
        row.extend([plan.acceleration, plan.cruise, plan.deceleration, plan.run_hz].map(number));
        row.push(Cell::Number(plan.duration_s(table), 4));
        row
    });
    Table {
        key: "cases",
        title: "Cases of a segment (sect. 2, fig. 3, eqs. 5 and 6)".to_owned(),
        columns: vec!["case", "P", "Vs, Hz", "Vr, Hz", "Ve, Hz", "A", "C", "D", "fastest, Hz", "time, s"],
        rows: rows.into(),
        note:
            "In case (b) both ramps are cut where their acceleration is not zero; s-curve plans such a segment anew, \
               with two whole ramps."
                .to_owned(),
    }
}

/// Look-ahead over four lines.
fn queue(table: &FrequencyTable) -> Table {
    let lines = [(4_000.0, 8_000.0), (600.0, 10_000.0), (300.0, 3_000.0), (5_000.0, 10_000.0), (900.0, 6_000.0)];
    let mut segments = Segments::new(table);
    let mut rows = Vec::new();
    let mut take = |segments: &mut Segments| {
        let segment = segments.take()?;
        let mut row = vec![Cell::Count(rows.len() as i64 + 1), Cell::Count(segment.line.pulses as i64)];
        row.extend([segment.line.run_hz, segment.start_hz, segment.stop_hz].map(number));
        row.extend([segment.plan.acceleration, segment.plan.cruise, segment.plan.deceleration].map(number));
        row.push(format!("{:?}", segment.plan.case).into());
        rows.push(row);
        Some(())
    };
    for (pulses, run_hz) in lines {
        if !segments.read(Line { pulses, run_hz }) {
            take(&mut segments);
            segments.read(Line { pulses, run_hz });
        }
    }
    segments.finish();
    while take(&mut segments).is_some() {}
    Table {
        key: "queue",
        title: "Five lines through the paper's queue of three planned segments (fig. 4)".to_owned(),
        columns: vec!["segment", "P", "run, Hz", "start, Hz", "stop, Hz", "A", "C", "D", "case"],
        rows,
        note: String::new(),
    }
}

/// A planned path.
struct Planned {
    duration_s: f64,
    /// Path, mm, and speed, mm/s, at block ends.
    speeds: Vec<(f64, f64)>,
}

/// Plans a path; `None` if the machine cannot travel it.
fn plan(places_mm: &[(f64, f64)], law: AccelerationProfile, block_by_block: bool) -> Option<Planned> {
    let mut planner = example_planner(1_000.0, 0.1, 128)?;
    let choice = MotionChoice { acceleration: law, ..MotionChoice::DEFAULT };
    let is_set = planner.set_motion_choice(&choice).is_ok() && (!block_by_block || planner.plan_block_by_block());
    if !is_set {
        return None;
    }
    let units = |mm: f64| (mm * UNITS_PER_MM as f64).round() as i64;
    let mut speeds = vec![(0.0, 0.0)];
    let mut passed_mm = 0.0;
    let mut take = |planner: &mut Planner<Vec<Slot>, Papers>| {
        let planned = planner.next_planned()?;
        passed_mm += planned.block.length_mm();
        speeds.push((passed_mm, planned.exit.mm_per_s()));
        Some(())
    };
    for (line, &(x, y)) in (1..).zip(places_mm) {
        let target_10nm = [units(x), units(y), 0];
        let request = Move { target_10nm, filament_100pm: 0, feed_mm_per_s: 60.0, line, ends_move: true };
        while planner.add(&request).is_err() {
            take(&mut planner)?;
        }
    }
    planner.flush();
    while take(&mut planner).is_some() {}
    Some(Planned { duration_s: planner.motion_ticks() as f64 / f64::from(TICKS_PER_SECOND), speeds })
}

/// A circle of short moves.
fn circle() -> Vec<(f64, f64)> {
    let angles = (1..=252).map(|index| TAU * f64::from(index) / 252.0);
    angles.map(|angle| (20.0 * angle.cos() - 20.0, 20.0 * angle.sin())).collect()
}

/// Comparison of whole paths under each law.
fn gains() -> Table {
    let square = vec![(20.0, 0.0), (20.0, 20.0), (0.0, 20.0), (0.0, 0.0)];
    let wave = (1..=300).map(|index| 0.4 * f64::from(index));
    let wave: Vec<_> = wave.map(|x| (x, 3.0 * (TAU * x / 12.0).sin())).collect();
    let ways = [
        ("square of 20 mm, 4 moves", square),
        ("circle of 40 mm, 252 moves", circle()),
        ("wave of 3 mm over 12 mm, 300 moves", wave),
    ];
    let seconds = |way: &[_], law, alone| plan(way, law, alone).map(|planned| planned.duration_s);
    let rows = ways.map(|(name, way)| {
        let cell = |seconds: Option<f64>| seconds.map_or(Cell::Empty, |seconds| Cell::Number(seconds, 3));
        let alone = seconds(&way, AccelerationProfile::SCurve, true);
        let shared = seconds(&way, AccelerationProfile::SCurve, false);
        let gain = alone.zip(shared).map_or(Cell::Empty, |(alone, shared)| number(100.0 * (1.0 - shared / alone)));
        vec![
            name.into(),
            cell(seconds(&way, AccelerationProfile::Trapezoid, false)),
            cell(seconds(&way, AccelerationProfile::SCurveTable, false)),
            cell(seconds(&way, AccelerationProfile::SCurveFiveSegments, false)),
            cell(alone),
            cell(shared),
            gain,
        ]
    });
    Table {
        key: "gains",
        title: "Time of a way at 60 mm/s, 1000 mm/s^2, 10000 mm/s^3, 80 steps/mm".to_owned(),
        columns: vec![
            "way",
            "trapezoid, s",
            "table, s",
            "five segments, s",
            "s-curve, each move alone, s",
            "s-curve, s",
            "gain, %",
        ],
        rows: rows.into(),
        note: "Alone, as in the paper's five segments, every move begins and ends without acceleration; otherwise neighbours \
               share one law. Where a ramp reaches the greatest acceleration, s-curve holds it."
            .to_owned(),
    }
}

fn curve(name: &str, style: Style, points: impl Iterator<Item = (f64, f64)>) -> Curve {
    Curve { name: name.to_owned(), style, points: points.collect() }
}

fn times(duration_s: f64) -> impl Iterator<Item = f64> {
    (0..=POINTS).map(move |index| duration_s * f64::from(index) / f64::from(POINTS))
}

/// Fig. 5: speed over time, with a trapezoid of the same greatest acceleration.
fn speed(ramp: &Ramp, table: &FrequencyTable) -> Figure {
    let whole = 2.0 * ramp.half_time_s();
    let trapezoid = |time: f64| (time, (START_HZ + ramp.peak_acceleration() * time).min(TOP_HZ));
    Figure {
        name: "li-speed",
        title: "Li 2017, fig. 5: frequency over time".to_owned(),
        x_label: "time, s",
        y_label: "frequency, Hz",
        equal_scales: false,
        curves: vec![
            curve("S-curve", Style::Line, times(whole).map(|time| (time, ramp.at(time).speed))),
            curve("trapezoid of the same acceleration", Style::Dashed, times(whole).map(trapezoid)),
            curve(
                "table, every tenth slice",
                Style::Points,
                table.iter().step_by(10).map(|slice| (slice.start_s + slice.duration_s / 2.0, slice.frequency_hz)),
            ),
        ],
    }
}

/// Acceleration over the ramp.
fn acceleration(ramp: &Ramp) -> Figure {
    let whole = 2.0 * ramp.half_time_s();
    let peak = ramp.peak_acceleration();
    let end = (TOP_HZ - START_HZ) / peak;
    let in_khz = |(time, acceleration): (f64, f64)| (time, acceleration / 1_000.0);
    let trapezoid = [(0.0, 0.0), (0.0, peak), (end, peak), (end, 0.0), (whole, 0.0)];
    let s_curve = times(whole).map(|time| (time, ramp.at(time).acceleration));
    Figure {
        name: "li-acceleration",
        title: "Acceleration over time, beside fig. 5".to_owned(),
        x_label: "time, s",
        y_label: "acceleration, kHz/s",
        equal_scales: false,
        curves: vec![
            curve("S-curve", Style::Line, s_curve.map(in_khz)),
            curve("trapezoid of the same acceleration", Style::Dashed, trapezoid.into_iter().map(in_khz)),
        ],
    }
}

/// Case (b): the table's ramps cut off, and the closed form planned anew.
fn short_segment(table: &FrequencyTable) -> Result<Figure, CurveError> {
    let pulses = 2_000.0;
    let plan = Plan::new(table, pulses, START_HZ, START_HZ, TOP_HZ);
    let up_s = table.time_after(plan.start + plan.acceleration);
    let down_s = table.time_after(plan.stop + plan.deceleration);
    let cut = |time: f64| {
        let here = if time <= up_s { time } else { (up_s + down_s - time).max(0.0) };
        (time, table.frequency_at(here))
    };
    let profile = Profile::new([START_HZ, TOP_HZ, START_HZ], pulses, JERK_HZ_PER_S2, f64::INFINITY)?;
    let anew = times(profile.duration_s()).map(|time| (time, profile.at(time).speed));
    Ok(Figure {
        name: "li-short-segment",
        title: "Case (b), 2000 pulses: the table's ramps cut off, and planned anew".to_owned(),
        x_label: "time, s",
        y_label: "frequency, Hz",
        equal_scales: false,
        curves: vec![
            curve("table", Style::Dashed, times(up_s + down_s).map(cut)),
            curve("closed form", Style::Line, anew),
        ],
    })
}

/// Gain of a law that spans several moves, at the start of a circle.
fn runs() -> Figure {
    let way = circle();
    let speeds = |law, alone| {
        let planned = plan(&way, law, alone).map_or(Vec::new(), |planned| planned.speeds);
        planned.into_iter().take_while(|(passed_mm, _)| *passed_mm <= 30.0)
    };
    Figure {
        name: "li-runs",
        title: "A circle of 0.5 mm moves begins: speed at their ends".to_owned(),
        x_label: "path, mm",
        y_label: "speed, mm/s",
        equal_scales: false,
        curves: vec![
            curve("trapezoid", Style::Dashed, speeds(AccelerationProfile::Trapezoid, false)),
            curve("S-curve, each move alone", Style::LineAndPoints, speeds(AccelerationProfile::SCurve, true)),
            curve("S-curve over a run of moves", Style::LineAndPoints, speeds(AccelerationProfile::SCurve, false)),
        ],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_experiment_and_what_is_gained_come_out() {
        let chapter = chapter();
        let keys: Vec<_> = chapter.tables.iter().map(|table| table.key).collect();
        assert_eq!(keys, ["experiment", "table", "cases", "queue", "gains"]);
        let of = |key: &str, row: usize, column: usize| match &chapter.tables.iter().find(|table| table.key == key) {
            Some(table) => match table.rows[row][column] {
                Cell::Number(number, _) => number,
                _ => f64::NAN,
            },
            None => f64::NAN,
        };
        assert!((of("experiment", 0, 1) - 0.3).abs() < 1e-9 && (of("experiment", 1, 1) - 30_000.0).abs() < 1e-6);
        assert!((of("experiment", 2, 1) - 3_300.0).abs() < 1e-6 && (of("experiment", 4, 1) - 3_300.0).abs() < 1.0);
        assert!((of("experiment", 5, 1) - 3_291.0).abs() < 0.5);
        // A law that spans several moves is much faster on a circle and on a wave, and never faster
        // than a trapezoid.
        for row in [1, 2] {
            assert!(of("gains", row, 6) > 10.0 && of("gains", row, 5) > of("gains", row, 1), "{row}");
        }
        assert_eq!(chapter.figures.len(), 4);
        assert!(chapter.figures.iter().flat_map(|figure| &figure.curves).all(|curve| curve.points.len() > 4));
    }
}
