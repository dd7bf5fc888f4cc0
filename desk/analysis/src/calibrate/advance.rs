//! Lines that show which pressure advance fits.

use std::fmt::Write;

use ferrostep_planner::PressureAdvance;
use ferrostep_printer::Profile;

use super::pattern::{
    Bead, MARGIN_MM, PatternError, RETRACTED_MM, RETRACTION_MM_PER_S, Temperatures, in_range, mm, nozzle_mm,
};

/// Parts of a line: slow, fast, slow; mm.
const PARTS_MM: [f64; 3] = [20.0, 40.0, 20.0];

/// Distance between two lines, mm.
const APART_MM: f64 = 5.0;

/// Every fifth line begins this far to the left, so that they can be counted; mm.
const MARK_MM: f64 = 4.0;

/// Layer height and line width for each mm of the nozzle's diameter.
const HEIGHT_OF_NOZZLE: f64 = 0.5;
const WIDTH_OF_NOZZLE: f64 = 1.125;

/// Values of the lines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdvanceSteps {
    /// K of the first line, s.
    pub first_s: f64,
    /// Increase from line to line, s.
    pub step_s: f64,
    /// Number of lines.
    pub lines: u16,
}

/// Parameters of the printed lines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdvanceLines {
    /// The lines' values.
    pub steps: AdvanceSteps,
    /// Speed of the first and the last part, mm/s.
    pub slow_mm_per_s: f64,
    /// Speed of the middle, mm/s.
    pub fast_mm_per_s: f64,
    /// Temperatures of nozzle and bed.
    pub temperatures: Temperatures,
}

impl AdvanceSteps {
    /// K of a line, counted from 1; s.
    fn seconds(&self, line: u16) -> f64 {
        self.first_s + f64::from(line.saturating_sub(1)) * self.step_s
    }

    fn check(&self) -> Result<(), PatternError> {
        let most_s = PressureAdvance::MAX_SECONDS;
        in_range("--from", self.first_s, 0.0..=most_s, "s")?;
        in_range("--step", self.step_s, 1e-4..=most_s, "s")?;
        let last_s = self.seconds(self.lines);
        if last_s > most_s {
            return Err(PatternError::Value(
                "--lines",
                f64::from(self.lines),
                format!("few enough for K up to {most_s} s"),
            ));
        }
        Ok(())
    }

    /// The keys of a profile for the line that looks best, counted from 1.
    ///
    /// # Errors
    /// [`PatternError`].
    pub fn keys(&self, best: u16) -> Result<String, PatternError> {
        self.check()?;
        if !(1..=self.lines).contains(&best) {
            return Err(PatternError::Value(
                "--best",
                f64::from(best),
                format!("a line from 1 to {} (--lines)", self.lines),
            ));
        }
        Ok(format!(
            "K is {:.4} s +- {:.4} s\n\nIn the profile:\n\n[pressure_advance]\nseconds = {0:.4}\n",
            self.seconds(best),
            0.5 * self.step_s
        ))
    }
}

impl AdvanceLines {
    fn check(&self, profile: &Profile) -> Result<(), PatternError> {
        self.steps.check()?;
        let fastest = profile.limits.max_feed_mm_per_s[0];
        for (option, speed) in [("--slow", self.slow_mm_per_s), ("--fast", self.fast_mm_per_s)] {
            if !(1.0..=fastest).contains(&speed) {
                return Err(PatternError::Value(option, speed, format!("1 to {fastest} mm/s, as fast as X moves")));
            }
        }
        self.temperatures.check(profile)
    }

    /// The G-code: a line for each value, slow, fast and slow again, between them travels with the
    /// filament pulled back.
    ///
    /// # Errors
    /// [`PatternError`].
    pub fn gcode(&self, profile: &Profile) -> Result<String, PatternError> {
        self.check(profile)?;
        let room_mm = mm(profile.size_10nm[1] - profile.lower_end_10nm[1].max(0)) - 2.0 * MARGIN_MM;
        // Two places more: for what is pushed out first, and for the marks.
        let needed_mm = APART_MM * f64::from(self.steps.lines + 2);
        if needed_mm > room_mm {
            let room = (room_mm / APART_MM - 2.0).floor().max(0.0);
            let expected = format!("at most {room}, for which the bed has room in Y");
            return Err(PatternError::Value("--lines", f64::from(self.steps.lines), expected));
        }
        let length_mm: f64 = PARTS_MM.iter().sum();
        let left_mm = 0.5 * (mm(profile.size_10nm[0]) - length_mm);
        if left_mm < MARGIN_MM + MARK_MM {
            return Err(PatternError::Narrow(length_mm + 2.0 * (MARK_MM + MARGIN_MM)));
        }
        let bead = Bead::of_nozzle(nozzle_mm(profile), HEIGHT_OF_NOZZLE, WIDTH_OF_NOZZLE);
        let pattern = Pattern {
            left_mm,
            front_mm: 0.5 * (mm(profile.size_10nm[1]) - needed_mm),
            height_mm: bead.height_mm,
            filament_per_mm: bead.filament_per_mm(profile),
        };
        Ok(self.write(&pattern, profile))
    }

    fn write(&self, pattern: &Pattern, profile: &Profile) -> String {
        let Self { steps, slow_mm_per_s, fast_mm_per_s, temperatures } = *self;
        let mut out = format!(
            "; Pressure advance on {}: {} lines from the front to the back, K from {} to {:.4} s.\n\
             ; The best line is as wide where its speed changes as elsewhere. Then: ferrostep calibrate advance --from {} --step {} \
             --lines {} --best LINE\n",
            profile.name,
            steps.lines,
            steps.first_s,
            steps.seconds(steps.lines),
            steps.first_s,
            steps.step_s,
            steps.lines
        );
        temperatures.begin(&mut out);
        let speeds = [slow_mm_per_s, fast_mm_per_s, slow_mm_per_s];
        // The first filament pushed out has no K.
        let _ = writeln!(out, "M900 K0");
        let front = [pattern.left_mm, pattern.front_mm];
        let _ = writeln!(out, "G1 X{:.3} Y{:.3} F6000\nG1 Z{:.3} F600", front[0], front[1], pattern.height_mm);
        pattern.part(
            &mut out,
            [front[0] + PARTS_MM.iter().sum::<f64>(), front[1]],
            slow_mm_per_s,
            PARTS_MM.iter().sum(),
        );
        for line in 1..=steps.lines {
            let begins_left = if line % 5 == 0 { MARK_MM } else { 0.0 };
            let y_mm = pattern.front_mm + APART_MM * f64::from(line);
            pattern.travel(&mut out, [pattern.left_mm - begins_left, y_mm]);
            let _ = writeln!(out, "; line {line}\nM900 K{:.4}", steps.seconds(line));
            let mut x_mm = pattern.left_mm;
            for (index, (part_mm, speed)) in PARTS_MM.into_iter().zip(speeds).enumerate() {
                x_mm += part_mm;
                let length_mm = if index == 0 { part_mm + begins_left } else { part_mm };
                pattern.part(&mut out, [x_mm, y_mm], speed, length_mm);
            }
        }
        let _ = writeln!(out, "; where the speed changes");
        let y_mm = pattern.front_mm + APART_MM * f64::from(steps.lines + 1);
        for x_mm in [pattern.left_mm + PARTS_MM[0], pattern.left_mm + PARTS_MM[0] + PARTS_MM[1]] {
            pattern.travel(&mut out, [x_mm, y_mm]);
            pattern.part(&mut out, [x_mm, y_mm + 0.8 * APART_MM], slow_mm_per_s, 0.8 * APART_MM);
        }
        let _ = writeln!(out, "M900 K{}", profile.motion.pressure_advance.seconds);
        super::pattern::end(&mut out, 20.0);
        out
    }
}

/// Position and thickness of the lines.
struct Pattern {
    left_mm: f64,
    front_mm: f64,
    height_mm: f64,
    filament_per_mm: f64,
}

impl Pattern {
    /// A part of a line, to a place.
    fn part(&self, out: &mut String, [x_mm, y_mm]: [f64; 2], speed_mm_per_s: f64, length_mm: f64) {
        let filament_mm = self.filament_per_mm * length_mm;
        let _ = writeln!(out, "G1 X{x_mm:.3} Y{y_mm:.3} E{filament_mm:.5} F{}", 60.0 * speed_mm_per_s);
    }

    /// Travels to a place, raised and with the filament pulled back.
    fn travel(&self, out: &mut String, [x_mm, y_mm]: [f64; 2]) {
        let speed = 60.0 * RETRACTION_MM_PER_S;
        let _ = writeln!(
            out,
            "G1 E-{RETRACTED_MM} F{speed}\nG1 Z{:.3} F600\nG1 X{x_mm:.3} Y{y_mm:.3} F6000\nG1 Z{:.3} F600\nG1 E{RETRACTED_MM} F{speed}",
            self.height_mm + 0.4,
            self.height_mm
        );
    }
}
