//! Hebei University of Technology: CoreXY plane control for FDM printers.

mod evenly;

use crate::bresenham::StepBresenham;
use crate::plane::{CoreXyLine, DualRate, LineEvent, LineFigures, PlaneMethod};
use ferrostep_planner::DualRatePeriods;

use evenly::Distance;

use super::chapter::{Cell, Chapter, Curve, Figure, Style, Table};

/// The paper's methods, with their names in the output.
const METHODS: [(PlaneMethod, &str); 3] = [
    (PlaneMethod::PointByPoint, "point-by-point"),
    (PlaneMethod::MinimumDeviation, "minimum-deviation"),
    (PlaneMethod::DualRate, "dual-rate"),
];

/// Periods of the worked example: 0.5 and 2.5 ms.
const EXAMPLE: DualRatePeriods = DualRatePeriods { shortest_ns: 500_000, longest_ns: 2_500_000 };

/// Periods that drivers can handle according to the paper: 10 us to 3 ms.
const DRIVERS: DualRatePeriods = DualRatePeriods { shortest_ns: 10_000, longest_ns: 3_000_000 };

/// Length of the fan's lines, pulses: 10 mm in pulses of 0.01 mm.
const FAN_PULSES: f64 = 1000.0;

/// Number of directions in the fan, one degree apart.
const FAN_DIRECTIONS: u16 = 360;

/// Pulse length in figures 3 and 5, mm.
const FIGURE_PULSE_MM: f64 = 0.1;

/// Chapter of the CoreXY paper, with tables and figures.
pub fn chapter() -> Chapter {
    Chapter {
        name: "corexy",
        source: "Hebei University of Technology: CoreXY plane control for FDM printers",
        tables: vec![worked_example(), traces(), fan()],
        figures: vec![
            trace("corexy-trace-3a", "figure 3", 5, 7),
            trace("corexy-trace-3b", "figure 3", 7, 5),
            trace("corexy-trace-5a", "figure 5", 4, 7),
            trace("corexy-trace-5b", "figure 5", 7, 4),
            distances(),
        ],
    }
}

/// Worked example: the paper's line from C(11.3, -8.4) to D(12.5, -8.7).
fn worked_example() -> Table {
    const PULSE_MM: f64 = 0.01;
    let pulses = |from_mm: f64, to_mm: f64| ((to_mm - from_mm) / PULSE_MM).round() as i64;
    let (x, y) = (pulses(11.3, 12.5), pulses(-8.4, -8.7));
    let (first, second) = (x + y, x - y);
    let mut rows: Vec<Vec<Cell>> =
        [("X, pulses", 120, x), ("Y, pulses", -30, y), ("A, pulses", 90, first), ("B, pulses", 150, second)]
            .map(|(what, paper, ours)| vec![what.into(), Cell::Count(paper), Cell::Count(ours)])
            .to_vec();
    if let Ok(DualRate::TwoRates(line)) = DualRate::new(first, second, &EXAMPLE) {
        let [first_ns, second_ns] = line.periods_ns();
        let ms = line.duration_ns() as f64 / 1e6;
        rows.extend([
            vec!["T1, ms".into(), Cell::Number(0.8333, 4), Cell::Number(first_ns / 1e6, 4)],
            vec!["T2, ms".into(), Cell::Number(0.5, 4), Cell::Number(second_ns / 1e6, 4)],
            vec!["duration, ms".into(), Cell::Number(75.0, 4), Cell::Number(ms, 4)],
        ]);
    }
    Table {
        key: "worked_example",
        title: "Section 2.3.2: C(11.3, -8.4) to D(12.5, -8.7), pulse 0.01 mm, T_min 0.5 ms, T_max 2.5 ms".to_owned(),
        columns: vec!["quantity", "paper", "ours"],
        rows,
        note: "Both motors turn counter-clockwise. The paper gives T_min and T_max; T1 follows from |A| T1 = |B| T2."
            .to_owned(),
    }
}

/// Events of a line on a CoreXY machine; empty if there is no such line.
fn events(method: PlaneMethod, x: i64, y: i64, periods: &DualRatePeriods) -> impl Iterator<Item = LineEvent> {
    CoreXyLine::new(method, x + y, x - y, periods).into_iter().flatten()
}

/// The lines of figures 3 and 5 by each method.
fn traces() -> Table {
    let letter = |event: LineEvent| match event.steps {
        [a, 0] if a > 0 => "A",
        [_, 0] => "a",
        [0, b] if b > 0 => "B",
        [0, _] => "b",
        [a, b] if a == b => "X",
        _ => "Y",
    };
    let mut rows = Vec::new();
    for (x, y) in [(5, 7), (7, 5), (4, 7), (7, 4)] {
        for (method, name) in METHODS {
            let Ok(figures) = LineFigures::new(method, x, y, &DRIVERS) else { continue };
            rows.push(vec![
                format!("({:.1}, {:.1})", x as f64 * FIGURE_PULSE_MM, y as f64 * FIGURE_PULSE_MM).into(),
                name.into(),
                events(method, x, y, &DRIVERS).map(letter).collect::<String>().into(),
                Cell::Count(figures.feeds as i64),
                Cell::Number(figures.largest_distance * FIGURE_PULSE_MM, 4),
                Cell::Number(figures.mean_distance * FIGURE_PULSE_MM, 4),
            ]);
        }
    }
    Table {
        key: "traces",
        title: "Figures 3 and 5: lines from (0, 0), pulse 0.1 mm".to_owned(),
        columns: vec!["to, mm", "method", "events", "steps of interpolation", "largest distance, mm", "mean distance, mm"],
        rows,
        note: "X, Y: both motors, along an axis. A, B: one motor alone forwards, a, b: backwards; a diagonal pulse is two \
               of them. Periods 10 us to 3 ms, so that dual-rate has no dead zone here."
            .to_owned(),
    }
}

/// Sums over the fan's directions.
#[derive(Clone, Copy, Debug, Default)]
struct Fan {
    lines: u64,
    two_rates: u64,
    feeds: u64,
    motor_steps: u64,
    busiest_motor_steps: u64,
    reversals: u64,
    largest_distance: f64,
    mean_distance_sum: f64,
    /// Largest distance if the motors turn evenly between their steps.
    largest_evenly: f64,
    mean_evenly_sum: f64,
}

impl Fan {
    fn add(&mut self, line: &LineFigures, evenly: Distance) {
        self.lines += 1;
        self.two_rates += u64::from(line.has_two_rates);
        self.feeds += line.feeds;
        self.motor_steps += line.motor_steps;
        self.busiest_motor_steps += line.busiest_motor_steps;
        self.reversals += line.reversals;
        self.largest_distance = self.largest_distance.max(line.largest_distance);
        self.mean_distance_sum += line.mean_distance;
        self.largest_evenly = self.largest_evenly.max(evenly.largest);
        self.mean_evenly_sum += evenly.mean;
    }

    /// Mean over the lines, all weighted equally.
    fn mean(&self, sum: f64) -> f64 {
        sum / self.lines as f64
    }

    fn row(&self, name: &str, periods: &str, shortest_ns: u32) -> Vec<Cell> {
        let ms = |pulses: u64| Cell::Number(self.mean(pulses as f64) * f64::from(shortest_ns) / 1e6, 2);
        vec![
            name.into(),
            periods.into(),
            Cell::Count(self.two_rates as i64),
            Cell::Number(self.largest_distance, 3),
            Cell::Number(self.mean(self.mean_distance_sum), 3),
            Cell::Number(self.largest_evenly, 3),
            Cell::Number(self.mean(self.mean_evenly_sum), 3),
            Cell::Number(self.mean(self.feeds as f64), 1),
            Cell::Number(self.mean(self.motor_steps as f64), 1),
            Cell::Number(self.mean(self.reversals as f64), 1),
            ms(self.feeds),
            ms(self.busiest_motor_steps),
        ]
    }
}

/// End of the fan's line in a direction, pulses.
fn fan_target(degrees: u16) -> (i64, i64) {
    let (sine, cosine) = f64::from(degrees).to_radians().sin_cos();
    ((FAN_PULSES * cosine).round() as i64, (FAN_PULSES * sine).round() as i64)
}

/// A line's figures and its events.
type Line = (LineFigures, Vec<LineEvent>);

/// Figures over all directions.
fn fan_of(line: impl Fn(i64, i64) -> Option<Line>) -> Fan {
    let mut fan = Fan::default();
    for degrees in 0..FAN_DIRECTIONS {
        let (x, y) = fan_target(degrees);
        if let Some((figures, events)) = line(x, y) {
            fan.add(&figures, evenly::distance(x, y, &events));
        }
    }
    fan
}

/// Line generator for one of the paper's methods.
fn by_method(method: PlaneMethod, periods: DualRatePeriods) -> impl Fn(i64, i64) -> Option<Line> {
    move |x, y| {
        let figures = LineFigures::new(method, x, y, &periods).ok()?;
        Some((figures, events(method, x, y, &periods).collect()))
    }
}

/// A line by the machine's own method: Bresenham on the motors' steps.
fn bresenham(x: i64, y: i64) -> Option<Line> {
    let motors = [x + y, x - y];
    let [first, second] = motors.map(|steps| u32::try_from(steps.unsigned_abs()).unwrap_or(u32::MAX));
    let [first_sign, second_sign] = motors.map(|steps| steps.signum() as i8);
    let most = first.max(second);
    let mut line = StepBresenham::new(most, first.min(second))?;
    let events: Vec<_> = (0..most)
        .map(|made| {
            let follows = i8::from(line.pass(1));
            let steps =
                if first >= second { [first_sign, follows * second_sign] } else { [follows * first_sign, second_sign] };
            LineEvent { share: (f64::from(made) + 0.5) / f64::from(most), steps }
        })
        .collect();
    Some((LineFigures::of_events(x, y, events.iter().copied()).ok()?, events))
}

fn fan() -> Table {
    let mut rows = Vec::new();
    for (periods, named) in [(EXAMPLE, "0.5 to 2.5 ms"), (DRIVERS, "10 us to 3 ms")] {
        for (method, name) in METHODS {
            let fan = fan_of(by_method(method, periods));
            rows.push(fan.row(name, named, periods.shortest_ns));
        }
        rows.push(fan_of(bresenham).row("step-bresenham, ours", named, periods.shortest_ns));
    }
    Table {
        key: "fan",
        title: "360 directions, lines of 1000 pulses, at the paper's constant periods".to_owned(),
        columns: vec![
            "method",
            "periods",
            "at two rates",
            "largest distance, pulses",
            "mean",
            "turning evenly: largest",
            "mean",
            "steps of interpolation",
            "motor steps",
            "reversals",
            "ms, T_min a step of interpolation",
            "ms, T_min a motor pulse",
        ],
        rows,
        note: "Distances from the ideal line, means over the line's time: with motors that stand still between steps, and \
               with motors that turn evenly from the middle of one step to the middle of the next. The other columns are \
               means of the lines. The paper claims that minimum deviation is more exact and faster than point-by-point, \
               and dual-rate more exact and faster than both. More exact than point-by-point: confirmed, by half. \
               Dual-rate more exact than minimum deviation: confirmed for motors that turn evenly, whose lines are \
               straight outside the dead zone; where they stand still it is as far off at the worst and nearer by a \
               seventh to a sixth in the mean. Faster: not confirmed. A diagonal pulse is two pulses of one motor; with no motor \
               pulse shorter than T_min all take the same time, max(|A|, |B|) T_min, and if a diagonal counted as one \
               pulse minimum deviation would be the fastest. Step Bresenham on the motors' own steps, which drives the \
               machine by default, is nearer than any of them where motors stand still."
            .to_owned(),
    }
}

/// A line by all three methods.
fn trace(name: &'static str, paper: &str, x: i64, y: i64) -> Figure {
    let mm = |half_pulses: i64| half_pulses as f64 / 2.0 * FIGURE_PULSE_MM;
    let mut curves = vec![Curve {
        name: "ideal".to_owned(),
        style: Style::Dashed,
        points: vec![(0.0, 0.0), (mm(2 * x), mm(2 * y))],
    }];
    for (method, method_name) in METHODS {
        let mut here = [0i64; 2];
        let behind = events(method, x, y, &DRIVERS).map(|LineEvent { steps: [a, b], .. }| {
            here = [here[0] + i64::from(a), here[1] + i64::from(b)];
            (mm(here[0] + here[1]), mm(here[0] - here[1]))
        });
        let points = std::iter::once((0.0, 0.0)).chain(behind).collect();
        curves.push(Curve { name: method_name.to_owned(), style: Style::LineAndPoints, points });
    }
    Figure {
        name,
        title: format!("Beside {paper}: to ({:.1}, {:.1})", mm(2 * x), mm(2 * y)),
        x_label: "x, mm",
        y_label: "y, mm",
        equal_scales: true,
        curves,
    }
}

/// The largest distance from the line over the fan's directions.
fn distances() -> Figure {
    let curve = |name: &str, line: &dyn Fn(i64, i64) -> Option<Line>| Curve {
        name: name.to_owned(),
        style: Style::Line,
        points: (0..FAN_DIRECTIONS)
            .filter_map(|degrees| {
                let (x, y) = fan_target(degrees);
                Some((f64::from(degrees), line(x, y)?.0.largest_distance))
            })
            .collect(),
    };
    let mut curves = METHODS.map(|(method, name)| curve(name, &by_method(method, DRIVERS))).to_vec();
    curves.push(curve("step-bresenham, ours", &bresenham));
    Figure {
        name: "corexy-fan",
        title: "Largest distance from the line, 1000 pulses, periods 10 us to 3 ms".to_owned(),
        x_label: "direction, degrees",
        y_label: "distance, pulses",
        equal_scales: false,
        curves,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_worked_example_is_the_paper_s() {
        for row in worked_example().rows {
            let [_, paper, ours] = &row[..] else { panic!("{row:?}") };
            match (paper, ours) {
                (Cell::Number(paper, _), Cell::Number(ours, _)) => assert!((paper - ours).abs() < 5e-5, "{row:?}"),
                _ => assert_eq!(paper, ours),
            }
        }
        assert_eq!(worked_example().rows.len(), 7);
    }

    /// Checks the statements of the fan's note.
    #[test]
    fn the_paper_s_claims_over_all_directions() {
        let ours = fan_of(bresenham);
        for periods in [EXAMPLE, DRIVERS] {
            let [point, minimum, dual] = METHODS.map(|(method, _)| fan_of(by_method(method, periods)));
            assert_eq!([point.lines, minimum.lines, dual.lines, ours.lines], [360; 4]);
            let mean = |fan: &Fan| fan.mean(fan.mean_distance_sum);
            // More accurate than point-by-point, by half.
            assert!(point.largest_distance > 0.99 && point.largest_distance < 1.0);
            for better in [minimum, dual, ours] {
                assert!(better.largest_distance <= 0.5 + 1e-9, "{better:?}");
                assert!(mean(&better) < 0.52 * mean(&point), "{better:?} {point:?}");
            }
            // Dual-rate has the same worst case and a smaller mean.
            assert!(dual.largest_distance > 0.95 * minimum.largest_distance, "{dual:?} {minimum:?}");
            let share = mean(&dual) / mean(&minimum);
            assert!((0.8..0.9).contains(&share), "{share}");
            // The line is straight if the motors turn evenly.
            assert!(minimum.largest_evenly > 0.4 && ours.largest_evenly > 0.2, "{minimum:?} {ours:?}");
            assert!(dual.largest_evenly < if periods == DRIVERS { 1e-9 } else { 0.2 }, "{dual:?}");
            assert!(dual.mean_evenly_sum < 0.1 * minimum.mean_evenly_sum, "{dual:?} {minimum:?}");
            // The machine's own method.
            assert!(ours.largest_distance < 0.36 && mean(&ours) < mean(&dual), "{ours:?} {dual:?}");
            // No motor pulse is saved, so no time is.
            assert_eq!(point.busiest_motor_steps, minimum.busiest_motor_steps);
            assert_eq!(point.busiest_motor_steps, dual.busiest_motor_steps);
            // Minimum deviation is the fastest only if a diagonal counts as one pulse.
            assert!(minimum.feeds < dual.feeds && dual.feeds <= point.feeds);
            assert_eq!((minimum.reversals, dual.reversals), (0, 0));
            assert!(point.reversals > 0 && minimum.motor_steps < point.motor_steps);
            assert_eq!(minimum.motor_steps, dual.motor_steps);
        }
    }
}
