//! The book's picture: circles on a machine with play.

use std::f64::consts::TAU;
use std::fmt::Write;
use std::path::Path;

use ferrostep_checked_toml::book::REFRESH_VARIABLE;
use ferrostep_planner::Move;
use ferrostep_planner::backlash::Backlash;
use ferrostep_svg::{escaped, page};

use crate::backlash::axis::Axis;
use crate::backlash::follows::play_steps;
use crate::backlash::machine::{Bench, Event, MM, STEPS_PER_MM, plan};

const PLAY_MM: [f64; 3] = [0.2, 0.12, 0.0];
const RADIUS_MM: f64 = 10.0;
const SIDES: u32 = 180;

/// Scale of the nozzle's error in the picture.
const ENLARGED: f64 = 15.0;

/// Events between two points of the picture.
const BETWEEN: usize = 12;

const SIDE: f64 = 210.0;
const GAP: f64 = 20.0;
const TOP: f64 = 76.0;
const PIXELS_PER_MM: f64 = 7.0;

const PLAN_COLOUR: &str = "#9cc3e6";
const NOZZLE_COLOUR: &str = "#b7410e";
const NOTE_COLOUR: &str = "#57606a";

/// Two rounds, of which the second is drawn: in the first the axes come to a side of their play.
fn circle() -> Vec<Move> {
    let at = |side: u32| {
        let angle = TAU * f64::from(side) / f64::from(SIDES);
        let [x, y] = [angle.cos() - 1.0, angle.sin()].map(|part| (part * RADIUS_MM * MM as f64).round() as i64);
        Move { target_10nm: [x, y, 0], filament_100pm: 0, feed_mm_per_s: 60.0, line: side, ends_move: true }
    };
    (1..=2 * SIDES).map(at).collect()
}

/// Planned places of the nozzle in the second round, and the error of the axes there, mm.
fn second_round(plan: &[Event], motors: &[Event]) -> Vec<[[f64; 2]; 2]> {
    let backlash = Backlash { play_mm: PLAY_MM, ..Backlash::NONE };
    let mut axes = play_steps(&backlash).map(Axis::new);
    // The circle begins downwards in X and upwards in Y.
    axes[1].place = -play_steps(&backlash)[1];
    let offsets = axes.map(|axis| axis.place);
    let (mut wanted, mut at) = ([0; 3], [0; 3]);
    let mut motors = motors.iter().peekable();
    let mut points = Vec::new();
    for (index, event) in plan.iter().enumerate() {
        while let Some((_, stepping, directions)) = motors.next_if(|made| made.0 <= event.0) {
            for motor in (0..3).filter(|motor| stepping >> motor & 1 == 1) {
                at[motor] += if directions >> motor & 1 == 0 { 1 } else { -1 };
                axes[motor].follow(at[motor]);
            }
        }
        for motor in (0..3).filter(|motor| event.1 >> motor & 1 == 1) {
            wanted[motor] += if event.2 >> motor & 1 == 0 { 1 } else { -1 };
        }
        if index * 2 >= plan.len() && index % BETWEEN == 0 {
            let mm = |axis: usize, steps: i64| steps as f64 / STEPS_PER_MM[axis];
            let place = [mm(0, wanted[0]) + RADIUS_MM, mm(1, wanted[1])];
            points.push([place, [0, 1].map(|axis| mm(axis, axes[axis].place - offsets[axis] - wanted[axis]))]);
        }
    }
    points
}

fn path(out: &mut String, points: impl Iterator<Item = [f64; 2]>, colour: &str, width: f64) {
    for (index, [x, y]) in points.enumerate() {
        let _ = write!(out, "{}{x:.1} {y:.1}", if index == 0 { "<path d=\"M" } else { "L" });
    }
    let _ = writeln!(out, "Z\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\" stroke-linejoin=\"round\"/>");
}

#[test]
fn the_book_s_circles_are_what_the_axes_do() {
    let portions = plan(&circle(), false);
    let mut plain = Bench::new(&Backlash::NONE);
    plain.run(&portions, false);
    let title = "A circle of 20 mm on a machine with 0.2 mm of play in X and 0.12 mm in Y";
    let note = "blue: the plan; brown: the nozzle, what it is off enlarged 15 times; the largest and the mean of that";
    let mut out = format!(
        "<text x=\"20\" y=\"26\" font-weight=\"bold\">{}</text>\n<text x=\"20\" y=\"44\" font-size=\"11\" fill=\"{NOTE_COLOUR}\">{}</text>\n",
        escaped(title),
        escaped(note)
    );
    let mut largest = Vec::new();
    for (panel, (name, correction, smoothing_mm)) in
        [("uncorrected", 0.0, 3.0), ("over 3 mm", 1.0, 3.0), ("over 1 mm", 1.0, Backlash::SMOOTHING_MM)]
            .into_iter()
            .enumerate()
    {
        let mut bench = Bench::new(&Backlash { play_mm: PLAY_MM, correction, smoothing_mm });
        bench.run(&portions, false);
        let points = second_round(&plain.seen.0, &bench.seen.0);
        let off_um = points.iter().map(|[_, [x, y]]| x.hypot(*y) * 1000.0);
        let (most, mean) = (off_um.clone().fold(0.0, f64::max), off_um.sum::<f64>() / points.len() as f64);
        let left = GAP + panel as f64 * (SIDE + GAP);
        let on_page = |[x, y]: [f64; 2]| [left + SIDE / 2.0 + x * PIXELS_PER_MM, TOP + SIDE / 2.0 - y * PIXELS_PER_MM];
        path(&mut out, points.iter().map(|[place, _]| on_page(*place)), PLAN_COLOUR, 4.0);
        let nozzle =
            |[place, off]: &[[f64; 2]; 2]| on_page([place[0] + off[0] * ENLARGED, place[1] + off[1] * ENLARGED]);
        path(&mut out, points.iter().map(nozzle), NOZZLE_COLOUR, 1.2);
        let _ = writeln!(
            out,
            "<text x=\"{left:.1}\" y=\"{:.1}\" font-weight=\"bold\">{name}</text><text x=\"{left:.1}\" y=\"{:.1}\" font-size=\"11\" \
             fill=\"{NOTE_COLOUR}\">{most:.0} µm, {mean:.0} µm</text>",
            TOP - 10.0,
            TOP + 4.0
        );
        largest.push((most, mean));
    }
    let drawn = page(title, [GAP + 3.0 * (SIDE + GAP), TOP + SIDE + GAP], 13, out);
    let kept = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/src/images/backlash.svg");
    if std::env::var_os(REFRESH_VARIABLE).is_some() {
        std::fs::write(&kept, &drawn).unwrap();
    }
    assert!(largest[1].1 < largest[0].1 / 4.0 && largest[2].1 < largest[1].1 / 2.0, "{largest:?}");
    let kept = std::fs::read_to_string(&kept).unwrap_or_default();
    assert!(kept == drawn, "images/backlash.svg has changed: look at it, then set {REFRESH_VARIABLE} to keep it");
}
