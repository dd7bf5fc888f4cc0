//! Marlin's rules, with junction deviation or classic jerk.
//!
//! Sources: Marlin's documentation of M201, M203, M204, M205 and of *Configuration* (junction
//! deviation, jerk, arcs); read against `Marlin/src/module/planner.cpp` and `planner.h`.
//!
//! In short: each axis (on CoreXY, each motor) keeps to its maximum speed and acceleration; the
//! acceleration along the path is that of prints, travels or retractions. A ring of blocks is
//! planned anew with each line: the last block always ends at rest. The running block keeps its
//! end, so a move is planned with the ring's other blocks known, except the one whose place the
//! next line takes. The parser here is never late; a board's is, with lines of a few hundredths of
//! a millimetre, and then slows down (SLOWDOWN) or starves.

mod corner;
mod settings;

pub use settings::{Corner, JerkRule, MarlinSettings, SlowestSpeed};

use crate::change::{Change, Effect};
use crate::motion::{Axis, Limit, Move, MoveError, PlannedMove};
use crate::setting::SettingError;
use crate::window::{Block, Window};
use corner::{Corners, Segment};

/// Marlin's planner.
#[derive(Clone, Debug)]
pub struct Marlin {
    settings: MarlinSettings,
    window: Window,
    corners: Corners,
    /// Displacements of moves with too few steps, which the next move includes.
    carried_mm: [f64; 4],
}

impl Marlin {
    /// Creates a planner at rest.
    ///
    /// # Errors
    /// A setting with which no plan can be made.
    pub fn new(settings: MarlinSettings) -> Result<Self, SettingError> {
        settings.check()?;
        Ok(Self { settings, window: Window::default(), corners: Corners::default(), carried_mm: [0.0; 4] })
    }

    /// Returns the limits in force.
    pub const fn settings(&self) -> &MarlinSettings {
        &self.settings
    }

    /// Sets the limits of later moves.
    ///
    /// # Errors
    /// A setting with which no plan can be made; the limits stay as they were.
    pub fn set(&mut self, settings: MarlinSettings) -> Result<(), SettingError> {
        settings.check()?;
        self.settings = settings;
        Ok(())
    }

    /// Applies a command that changes limits.
    pub fn change(&mut self, change: &Change<'_>) -> Effect {
        self.settings.change(change)
    }

    /// Adds a move, and appends the moves that are now planned to `released`. A move without length
    /// is skipped; a move of fewer steps than `min_steps_per_segment` is joined to the next one.
    ///
    /// # Errors
    /// A displacement is not finite, or the speed is not above 0; the queue stays as it was.
    pub fn push(&mut self, one: &Move, released: &mut Vec<PlannedMove>) -> Result<(), MoveError> {
        one.check()?;
        let mut one = *one;
        for (part, carried) in one.displacement_mm.iter_mut().zip(self.carried_mm) {
            *part += carried;
        }
        let Some(segment) = Segment::new(&one, &self.settings) else {
            self.carried_mm = one.displacement_mm;
            return Ok(());
        };
        self.carried_mm = [0.0; 4];
        if self.window.len() >= self.settings.planned_blocks() {
            released.extend(self.window.release());
        }
        let (max_entry, entry_limit) = self.corners.enter(&segment, &self.settings);
        self.window.push(Block {
            tag: one.tag,
            length_mm: segment.length_mm,
            acceleration: segment.acceleration,
            nominal: segment.nominal * segment.nominal,
            max_entry,
            min_entry: segment.slowest,
            last_exit: one.arc.map_or(0.0, |arc| arc.safe_exit_mm_per_s.powi(2)).max(self.settings.last_exit()),
            entry_limit,
            speed_limit: segment.speed_limit,
            acceleration_limit: segment.acceleration_limit,
        });
        Ok(())
    }

    /// Plans all waiting moves so that motion ends at rest: for a dwell, a wait, homing, or the end
    /// of the print.
    pub fn flush(&mut self, released: &mut Vec<PlannedMove>) {
        while let Some(planned) = self.window.release() {
            released.push(planned);
        }
        self.window.rest();
        self.corners.rest();
    }

    /// Returns the number of waiting moves.
    pub fn queued(&self) -> usize {
        self.window.len()
    }
}

impl Segment {
    /// Creates a segment by the limits in force, before its corner; `None` for a move that is too
    /// short.
    fn new(one: &Move, settings: &MarlinSettings) -> Option<Self> {
        let [x, y, z, e] = one.displacement_mm;
        // Axes whose limits apply: on CoreXY, the motors.
        let motors = if settings.is_core_xy { [x + y, x - y, z, e] } else { one.displacement_mm };
        let path_mm = one.path_mm();
        let steps = settings.steps_per_mm.map(|per_mm| {
            let mut steps = motors;
            steps.iter_mut().zip(per_mm).for_each(|(part, per_mm)| *part = part.abs() * per_mm);
            steps
        });
        let least = f64::from(settings.min_steps_per_segment);
        let (has_path, moves_axes, is_long) = match steps {
            // Half a step or more rounds to one.
            Some([a, b, c, e]) => {
                let longest = a.max(b).max(c);
                (longest + 0.5 >= least, longest >= 0.5, longest.max(e) + 0.5 >= least)
            }
            None => (path_mm > 0.0, path_mm > 0.0, path_mm > 0.0 || e != 0.0),
        };
        let length_mm = if has_path { path_mm } else { e.abs() };
        if !is_long || length_mm == 0.0 {
            return None;
        }
        let asked = one.feed_mm_per_s.max(if e != 0.0 {
            settings.min_feed_mm_per_s
        } else {
            settings.min_travel_feed_mm_per_s
        });
        let shares = motors.map(|part| part / length_mm);
        let (mut nominal, mut speed_limit) = (asked, Limit::AskedSpeed);
        let (mut acceleration, mut acceleration_limit) = (
            match (moves_axes, e != 0.0) {
                (false, _) => settings.retract_acceleration_mm_per_s2,
                (true, true) => settings.acceleration_mm_per_s2,
                (true, false) => settings.travel_acceleration_mm_per_s2,
            },
            Limit::Acceleration,
        );
        for (axis, share) in Axis::ALL.into_iter().zip(shares.map(f64::abs)) {
            if share == 0.0 {
                continue;
            }
            let index = axis as usize;
            if settings.max_feed_mm_per_s[index] < nominal * share {
                nominal = settings.max_feed_mm_per_s[index] / share;
                speed_limit = Limit::AxisSpeed(axis);
            }
            // A retraction is limited only by its own acceleration.
            if moves_axes && settings.max_acceleration_mm_per_s2[index] < acceleration * share {
                acceleration = settings.max_acceleration_mm_per_s2[index] / share;
                acceleration_limit = Limit::AxisAcceleration(axis);
            }
        }
        let steps_per_mm = steps.map(|steps| steps.into_iter().fold(0.0, f64::max) / length_mm);
        let slowest = settings.slowest(acceleration, steps_per_mm).min(nominal * nominal);
        Some(Self {
            length_mm,
            shares,
            is_printing_or_core: e != 0.0 || settings.is_core_xy,
            nominal,
            acceleration,
            slowest,
            arc_radius_mm: one.arc.map_or(0.0, |arc| arc.radius_mm),
            speed_limit,
            acceleration_limit,
        })
    }
}
