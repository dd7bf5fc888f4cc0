//! Moves that ask more and more of the motors, with marks that show which of them lost steps.

use std::fmt::Write;

use ferrostep_planner::TICKS_PER_SECOND;
use ferrostep_printer::Profile;

use super::pattern::{
    Bead, MARGIN_MM, PatternError, RETRACTED_MM, RETRACTION_MM_PER_S, Temperatures, in_range, mm, nozzle_mm,
};

/// Distance from stage to stage, mm.
const APART_MM: f64 = 12.0;

/// Length of a mark's half, and the gap between its halves, mm.
const HALF_MM: f64 = 5.0;
const GAP_MM: f64 = 0.6;

/// Height over the bed during the moves, mm.
const RAISED_MM: f64 = 5.0;

/// Speed and acceleration of the marks, which lose no steps; mm/s and mm/s^2.
const MARK_MM_PER_S: f64 = 20.0;
const MARK_MM_PER_S2: f64 = 500.0;

/// Side of the square in which short moves are made, mm.
const SMALL_MM: f64 = 20.0;

/// Share of the value that held which goes into the profile: a motor is weaker when it is hot and
/// the axis is dirty.
const KEPT: f64 = 0.85;

/// Layer height and line width for each mm of the nozzle's diameter.
const HEIGHT_OF_NOZZLE: f64 = 0.5;
const WIDTH_OF_NOZZLE: f64 = 1.125;

/// Quantity that rises from stage to stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tried {
    /// Acceleration of X and Y.
    Acceleration,
    /// Speed of X and Y.
    Speed,
}

/// The stages.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedSteps {
    /// Quantity that rises.
    pub tried: Tried,
    /// The limit's value in the first stage, mm/s^2 or mm/s.
    pub first: f64,
    /// Increase from stage to stage, mm/s^2 or mm/s.
    pub step: f64,
    /// Number of stages.
    pub stages: u16,
}

/// Parameters of the moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedMoves {
    /// The stages.
    pub steps: SpeedSteps,
    /// Times that each stage makes its moves.
    pub repeats: u16,
    /// Temperatures of nozzle and bed.
    pub temperatures: Temperatures,
}

impl Tried {
    const fn unit(self) -> &'static str {
        match self {
            Self::Acceleration => "mm/s^2",
            Self::Speed => "mm/s",
        }
    }

    const fn key(self) -> &'static str {
        match self {
            Self::Acceleration => "max_acceleration_mm_per_s2",
            Self::Speed => "max_feed_mm_per_s",
        }
    }

    const fn most(self) -> f64 {
        match self {
            Self::Acceleration => 100_000.0,
            Self::Speed => 2_000.0,
        }
    }
}

impl SpeedSteps {
    /// The value of a stage, counted from 1.
    fn value(&self, stage: u16) -> f64 {
        self.first + f64::from(stage.saturating_sub(1)) * self.step
    }

    fn check(&self) -> Result<(), PatternError> {
        let (most, unit) = (self.tried.most(), self.tried.unit());
        in_range("--from", self.first, 1.0..=most, unit)?;
        in_range("--step", self.step, 1.0..=most, unit)?;
        if self.value(self.stages) > most {
            return Err(PatternError::Value(
                "--stages",
                f64::from(self.stages),
                format!("few enough for at most {most} {unit}"),
            ));
        }
        Ok(())
    }

    /// The keys of a profile for the last stage whose marks are in line, counted
    /// from 1; 0 for none.
    ///
    /// # Errors
    /// [`PatternError`].
    pub fn keys(&self, good: u16) -> Result<String, PatternError> {
        self.check()?;
        let unit = self.tried.unit();
        if good == 0 {
            let expected = format!("a stage that holds: try again below {} {unit} (--from)", self.first);
            return Err(PatternError::Value("--good", 0.0, expected));
        }
        if good > self.stages {
            let expected = format!("a stage from 1 to {} (--stages)", self.stages);
            return Err(PatternError::Value("--good", f64::from(good), expected));
        }
        let held = self.value(good);
        let lost = if good < self.stages {
            format!("the motors hold {held} {unit} and lose steps at {} {unit}", self.value(good + 1))
        } else {
            format!("the motors hold {held} {unit}, the most that was tried (--stages)")
        };
        let kept = (KEPT * held).floor();
        Ok(format!(
            "{lost}\n\nIn the profile's {}, {:.0} % less, for motors get weaker as they get hot:\n\nx = {kept}, y = {kept}\n",
            self.tried.key(),
            100.0 * (1.0 - KEPT)
        ))
    }
}

/// Positions of marks and moves, and thickness of the marks.
struct Place {
    /// The marks' left end, and the middle of their height.
    first_mark: [f64; 2],
    /// The lowest and the highest corner of the moves.
    moves: [[f64; 2]; 2],
    height_mm: f64,
    filament_per_mm: f64,
}

impl SpeedMoves {
    /// The G-code: marks to compare with, then in each stage moves over the bed and a
    /// mark beside its own.
    ///
    /// # Errors
    /// [`PatternError`].
    pub fn gcode(&self, profile: &Profile) -> Result<String, PatternError> {
        let Self { steps, temperatures, .. } = self;
        steps.check()?;
        temperatures.check(profile)?;
        let [x_mm, y_mm, _] = profile.size_10nm.map(mm);
        let needed_mm = 4.0 * MARGIN_MM + 2.0 * SMALL_MM;
        if x_mm < needed_mm || y_mm < needed_mm {
            return Err(PatternError::Narrow(needed_mm));
        }
        let room = ((x_mm - 2.0 * MARGIN_MM) / APART_MM).floor();
        if f64::from(steps.stages) > room {
            return Err(PatternError::Value(
                "--stages",
                f64::from(steps.stages),
                format!("at most {room}, for which the bed has room in X"),
            ));
        }
        if steps.tried == Tried::Speed {
            let fastest = fastest_mm_per_s(profile);
            if steps.value(steps.stages) > fastest {
                let expected =
                    format!("few enough for {fastest:.0} mm/s, as fast as the board steps (minimum_event_interval_us)");
                return Err(PatternError::Value("--stages", f64::from(steps.stages), expected));
            }
        }
        let bead = Bead::of_nozzle(nozzle_mm(profile), HEIGHT_OF_NOZZLE, WIDTH_OF_NOZZLE);
        let place = Place {
            first_mark: [0.5 * (x_mm - APART_MM * f64::from(steps.stages - 1)), MARGIN_MM + HALF_MM],
            moves: [[MARGIN_MM, MARGIN_MM], [x_mm - MARGIN_MM, y_mm - MARGIN_MM]],
            height_mm: bead.height_mm,
            filament_per_mm: bead.filament_per_mm(profile),
        };
        Ok(self.write(&place, profile))
    }

    fn write(&self, place: &Place, profile: &Profile) -> String {
        let Self { steps, repeats, temperatures } = *self;
        let SpeedSteps { tried, first, step, stages } = steps;
        let word = if tried == Tried::Speed { "speed" } else { "acceleration" };
        let mut out = format!(
            "; Motors of {}: {stages} stages of {word} {first} to {} {}, from the left to the right. Each has marks that were printed first,\n\
             ; below and on the left, and marks that follow its moves, above and on the right. In the first stage that loses steps they are no\n\
             ; longer in line. Stop the print then, and: ferrostep calibrate speed --of {word} --from {first} --step {step} --stages {stages} --good LAST\n",
            profile.name,
            steps.value(stages),
            tried.unit()
        );
        temperatures.begin(&mut out);
        own_limits(&mut out, profile);
        for stage in 1..=stages {
            place.marks(&mut out, stage, -1.0);
        }
        for stage in 1..=stages {
            let value = steps.value(stage);
            let [x, y, ..] = profile.limits.max_feed_mm_per_s;
            let feed = if tried == Tried::Speed { value } else { x.min(y) };
            let _ = writeln!(out, "; stage {stage}: {value} {}", tried.unit());
            let _ = match tried {
                Tried::Acceleration => writeln!(out, "M201 X{value} Y{value}\nM204 T{value}"),
                Tried::Speed => writeln!(out, "M203 X{value} Y{value}\nM204 T{}", acceleration(profile)),
            };
            for _ in 0..repeats {
                place.moves(&mut out, 60.0 * feed);
            }
            own_limits(&mut out, profile);
            place.marks(&mut out, stage, 1.0);
        }
        let limits = &profile.limits;
        let _ =
            writeln!(out, "M204 P{} T{}", limits.print_acceleration_mm_per_s2, limits.travel_acceleration_mm_per_s2);
        super::pattern::end(&mut out, 2.0 * RAISED_MM);
        out
    }
}

/// The acceleration of moves while speed is tried: what X and Y both have.
fn acceleration(profile: &Profile) -> f64 {
    let [x, y, ..] = profile.limits.max_acceleration_mm_per_s2;
    x.min(y)
}

/// The profile's own limits, except the acceleration, which is that of marks.
fn own_limits(out: &mut String, profile: &Profile) {
    let [feed_x, feed_y, ..] = profile.limits.max_feed_mm_per_s;
    let [x, y, ..] = profile.limits.max_acceleration_mm_per_s2;
    let _ = writeln!(out, "M201 X{x} Y{y}\nM203 X{feed_x} Y{feed_y}\nM204 P{MARK_MM_PER_S2} T{MARK_MM_PER_S2}");
}

/// Returns the maximum speed of X and Y together at which every motor keeps the minimum
/// event interval, mm/s.
fn fastest_mm_per_s(profile: &Profile) -> f64 {
    let steps_per_s = f64::from(TICKS_PER_SECOND) / f64::from(profile.minimum_event_interval_ticks);
    let motors = profile.kinematics.largest_motor_feeds([1.0, 1.0, 0.0]);
    let each = motors.into_iter().zip(profile.steps_per_mm).map(|(feed, steps)| steps_per_s / (feed * steps.to_f64()));
    each.fold(f64::INFINITY, f64::min)
}

impl Place {
    /// A stage's marks: an upright one and a level one, each from the middle to the side.
    fn marks(&self, out: &mut String, stage: u16, side: f64) {
        let x_mm = self.first_mark[0] + APART_MM * f64::from(stage - 1);
        let y_mm = self.first_mark[1];
        let from = side * 0.5 * GAP_MM;
        let until = from + side * HALF_MM;
        self.line(out, [[x_mm, y_mm + from], [x_mm, y_mm + until]]);
        // Above the upright ones, and of half their width beside the next stage's.
        let level_mm = y_mm + 2.0 * HALF_MM;
        self.line(out, [[x_mm + from, level_mm], [x_mm + 0.8 * until, level_mm]]);
    }

    fn line(&self, out: &mut String, [from, to]: [[f64; 2]; 2]) {
        let speed = 60.0 * RETRACTION_MM_PER_S;
        let filament_mm = self.filament_per_mm * (to[0] - from[0]).hypot(to[1] - from[1]);
        let _ = writeln!(
            out,
            "G1 X{:.3} Y{:.3} F6000\nG1 Z{:.3} F600\nG1 E{RETRACTED_MM} F{speed}\nG1 X{:.3} Y{:.3} E{filament_mm:.5} F{}\n\
             G1 E-{RETRACTED_MM} F{speed}\nG1 Z{RAISED_MM} F600",
            from[0],
            from[1],
            self.height_mm,
            to[0],
            to[1],
            60.0 * MARK_MM_PER_S
        );
    }

    /// Over the whole bed along its diagonals and its sides, then short moves to and
    /// fro in the middle.
    fn moves(&self, out: &mut String, feed_mm_per_min: f64) {
        let [[low_x, low_y], [high_x, high_y]] = self.moves;
        let [x, y] = [0.5 * (low_x + high_x), 0.5 * (low_y + high_y)];
        let half = 0.5 * SMALL_MM;
        let small = [[x - half, y - half], [x + half, y + half]];
        for [[low_x, low_y], [high_x, high_y]] in [self.moves, small] {
            let corners = [
                [low_x, low_y],
                [high_x, high_y],
                [low_x, low_y],
                [high_x, low_y],
                [low_x, high_y],
                [high_x, low_y],
                [low_x, low_y],
                [low_x, high_y],
                [high_x, high_y],
                [high_x, low_y],
            ];
            for [x, y] in corners {
                let _ = writeln!(out, "G1 X{x:.3} Y{y:.3} F{feed_mm_per_min:.0}");
            }
        }
    }
}
