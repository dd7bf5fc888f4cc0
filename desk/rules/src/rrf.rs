//! RepRapFirmware's rules.
//!
//! Sources: Duet's *GCode dictionary* (M201, M203, M204, M205, M566, M572, M595) and *Configuring
//! motion*; read against `src/Movement/DDA.cpp`, `DDARing.cpp` and `Kinematics/CoreKinematics.cpp`
//! of RepRapFirmware 3.6.
//!
//! In short: each axis keeps to its maximum speed and acceleration, and the acceleration along the
//! path of a move of X or Y to that of prints or travels. At a corner the speed of no axis jumps by
//! more than its jerk. With jerk policy 0, the default, motion stops between moves of different
//! kinds: print, travel, filament alone, Z alone. A ring of moves is planned anew with each line;
//! moves are fixed about a tenth of a second before they run, and lines are read while less than
//! two seconds of motion are waiting.
//!
//! Ramps of less than ten clocks, which RepRapFirmware leaves out, are kept: they take
//! less than 14 us.

mod settings;

pub use settings::{JerkPolicy, RrfSettings};

use crate::change::{Change, Effect};
use crate::motion::{Axis, Limit, Move, MoveError, PlannedMove};
use crate::setting::SettingError;
use crate::window::{Block, Window};
use std::collections::VecDeque;

/// Duration of motion that is fixed ahead, s (`UsualMinimumPreparedTime`).
const PREPARED_S: f64 = 0.1;
/// Duration of motion that is fixed ahead even if later moves could speed it up, s
/// (`AbsoluteMinimumPreparedTime`).
const PREPARED_ANYWAY_S: f64 = 0.05;
/// Duration of waiting motion at which no more lines are read, s.
const WAITING_S: f64 = 2.0;
/// Duration of waiting motion besides the first move at which no more lines are read, s.
const WAITING_BESIDES_FIRST_S: f64 = 0.5;

/// Data of a move that the corner after it needs.
#[derive(Clone, Copy, Debug)]
struct Before {
    shares: [f64; 4],
    nominal: f64,
    kind: Kind,
}

/// Kind of a move; with jerk policy 0 only moves of one kind join.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Kind {
    moves_xy: bool,
    is_printing: bool,
    is_filament_without_print: bool,
}

/// RepRapFirmware's planner.
#[derive(Clone, Debug)]
pub struct Rrf {
    settings: RrfSettings,
    window: Window,
    before: Option<Before>,
    /// Durations of the fixed moves, s; the running one first.
    prepared_s: VecDeque<f64>,
    /// Buffer for [`Window::plans`], kept to reuse its allocation.
    speeds: Vec<f64>,
}

impl Rrf {
    /// Creates a planner at rest.
    ///
    /// # Errors
    /// A setting with which no plan can be made.
    pub fn new(settings: RrfSettings) -> Result<Self, SettingError> {
        settings.check()?;
        Ok(Self { settings, window: Window::default(), before: None, prepared_s: VecDeque::new(), speeds: Vec::new() })
    }

    /// Returns the limits in force.
    pub const fn settings(&self) -> &RrfSettings {
        &self.settings
    }

    /// Sets the limits of later moves.
    ///
    /// # Errors
    /// A setting with which no plan can be made; the limits stay as they were.
    pub fn set(&mut self, settings: RrfSettings) -> Result<(), SettingError> {
        settings.check()?;
        self.settings = settings;
        Ok(())
    }

    /// Applies a command that changes limits.
    pub fn change(&mut self, change: &Change<'_>) -> Effect {
        self.settings.change(change)
    }

    /// Adds a move, and appends the moves that are now planned to `released`. A move without length
    /// is skipped.
    ///
    /// # Errors
    /// A displacement is not finite, or the speed is not above 0; the queue stays as it was.
    pub fn push(&mut self, one: &Move, released: &mut Vec<PlannedMove>) -> Result<(), MoveError> {
        one.check()?;
        let Some((mut block, entering)) = self.block(one) else { return Ok(()) };
        while !self.has_room() {
            self.run(released);
        }
        if let Some(before) = &self.before {
            (block.max_entry, block.entry_limit) = self.corner(before, &entering);
        }
        self.window.push(block);
        self.before = Some(entering);
        Ok(())
    }

    /// Plans all waiting moves so that motion ends at rest: for a dwell, a wait, homing, or the end
    /// of the print.
    pub fn flush(&mut self, released: &mut Vec<PlannedMove>) {
        while let Some(planned) = self.window.release() {
            released.push(planned);
        }
        self.window.rest();
        self.prepared_s.clear();
        self.before = None;
    }

    /// Returns the number of waiting moves.
    pub fn queued(&self) -> usize {
        self.window.len()
    }

    /// Returns true if the ring has room for another move now.
    fn has_room(&mut self) -> bool {
        let taken = self.prepared_s.len() + self.window.len();
        // The move before the oldest unfixed one must stay in the ring for its end speed.
        let free_after = self.settings.ring_length - 1;
        if taken > free_after || (taken == free_after && self.prepared_s.is_empty()) {
            return false;
        }
        let (mut total_s, mut first_s) = (0.0, None);
        self.window.plans(&mut self.speeds, |_, phases| {
            let duration_s = phases.accelerate_s + phases.cruise_s + phases.decelerate_s;
            first_s.get_or_insert(duration_s);
            total_s += duration_s;
        });
        total_s < WAITING_S || total_s - first_s.unwrap_or(0.0) < WAITING_BESIDES_FIRST_S
    }

    /// Finishes the running move, and fixes the moves that are due.
    fn run(&mut self, released: &mut Vec<PlannedMove>) {
        self.prepared_s.pop_front();
        let mut ahead_s: f64 = self.prepared_s.iter().sum();
        while ahead_s < PREPARED_S && 2 * self.prepared_s.len() < self.settings.ring_length {
            if ahead_s >= PREPARED_ANYWAY_S && self.is_first_braking() {
                return;
            }
            let Some(planned) = self.window.release() else { return };
            ahead_s += planned.duration_s();
            self.prepared_s.push_back(planned.duration_s());
            released.push(planned);
        }
    }

    /// Returns true if the first move brakes, so that later moves could speed it up.
    fn is_first_braking(&mut self) -> bool {
        let mut brakes = None;
        self.window.plans(&mut self.speeds, |_, phases| {
            brakes.get_or_insert(phases.end < phases.cruise);
        });
        brakes.unwrap_or(false)
    }

    /// Returns the squared speed of a corner, and its limit.
    fn corner(&self, before: &Before, entering: &Before) -> (f64, Limit) {
        if self.settings.jerk_policy == JerkPolicy::SameKind && before.kind != entering.kind {
            return (0.0, Limit::Rest);
        }
        let mut speed = before.nominal.min(entering.nominal);
        let mut limit = Limit::AskedSpeed;
        for axis in Axis::ALL {
            let index = axis as usize;
            let change = (before.shares[index] - entering.shares[index]).abs();
            if change * speed > self.settings.jerk_mm_per_s[index] {
                speed = self.settings.jerk_mm_per_s[index] / change;
                limit = if axis == Axis::E { Limit::FilamentCorner } else { Limit::Corner };
            }
        }
        (speed * speed, limit)
    }

    /// Creates a block by the limits in force, before its corner; `None` for a move without length.
    fn block(&self, one: &Move) -> Option<(Block, Before)> {
        let settings = &self.settings;
        let [x, y, _, e] = one.displacement_mm;
        let path_mm = one.path_mm();
        let length_mm = if path_mm > 0.0 { path_mm } else { e.abs() };
        if length_mm == 0.0 {
            return None;
        }
        let shares = one.displacement_mm.map(|part| part / length_mm);
        let moves_xy = x != 0.0 || y != 0.0;
        let is_printing = moves_xy && e > 0.0;
        let mut speed = (one.feed_mm_per_s.max(settings.min_speed_mm_per_s), Limit::AskedSpeed);
        let mut acceleration = (f64::INFINITY, Limit::Acceleration);
        let mut keep_to = |axis: Axis, share: f64, max_speed: f64, max_acceleration: f64| {
            if share > 0.0 {
                if max_speed < speed.0 * share {
                    speed = (max_speed / share, Limit::AxisSpeed(axis));
                }
                if max_acceleration / share < acceleration.0 {
                    acceleration = (max_acceleration / share, Limit::AxisAcceleration(axis));
                }
            }
        };
        for axis in Axis::ALL {
            let index = axis as usize;
            let mut max_acceleration = settings.max_acceleration_mm_per_s2[index];
            if axis == Axis::E && moves_xy && settings.pressure_advance_s > 0.0 {
                // With pressure advance the filament's speed jumps where the acceleration does.
                max_acceleration = max_acceleration.min(settings.jerk_mm_per_s[index] / settings.pressure_advance_s);
            }
            keep_to(axis, shares[index].abs(), settings.max_feed_mm_per_s[index], max_acceleration);
        }
        if settings.is_core_xy {
            // The limits of the motors; RepRapFirmware takes both displacements as positive.
            let [x, y, ..] = shares.map(f64::abs);
            for (axis, share) in [(Axis::X, x + y), (Axis::Y, (x - y).abs())] {
                let index = axis as usize;
                let [max_speed, max_acceleration] =
                    [settings.max_feed_mm_per_s[index], settings.max_acceleration_mm_per_s2[index]];
                keep_to(axis, share, max_speed, max_acceleration);
            }
        }
        if moves_xy {
            let along = if is_printing {
                settings.print_acceleration_mm_per_s2
            } else {
                settings.travel_acceleration_mm_per_s2
            };
            if along < acceleration.0 {
                acceleration = (along, Limit::Acceleration);
            }
        }
        let kind = Kind { moves_xy, is_printing, is_filament_without_print: e != 0.0 && !is_printing };
        let block = Block {
            tag: one.tag,
            length_mm,
            acceleration: acceleration.0,
            nominal: speed.0 * speed.0,
            max_entry: 0.0,
            min_entry: 0.0,
            last_exit: 0.0,
            entry_limit: Limit::Rest,
            speed_limit: speed.1,
            acceleration_limit: acceleration.1,
        };
        Some((block, Before { shares, nominal: speed.0, kind }))
    }
}
