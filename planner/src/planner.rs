//! The stages connected: moves in, step entries out.

use crate::block::{Acceleration, Block, PlannedBlock, Speed};
use crate::bresenham::MAX_STEPS;
use crate::extruder::{Extruder, FILAMENT_UNITS_PER_MM};
use crate::inner_ends::InnerEnds;
use crate::interpolator::Interpolator;
use crate::junction::Corner;
use crate::kinematics::{Geometry, MAX_COORDINATE_10NM, UNITS_PER_MM};
use crate::limits::Limits;
use crate::look_ahead::{Left, LookAhead, Marker, Slot};
use crate::square_root::square_root;
use crate::step_queue::{Notice, StepSink};
use crate::time_law::TimeLaw;
use crate::{TICKS_PER_SECOND, kinematics};

/// Slowest feed that is planned, mm/s; slower ones are raised to it. The longest block then ends within 20 days, which the
/// time base holds.
pub const MIN_FEED_MM_PER_S: f64 = 0.01;

/// A move with more filament than this for its path, 1000 to 1, is planned as an extruder-only move: there is no
/// speed along a path so short that the extruder's speed could be told by.
const MOST_FILAMENT_PER_PATH: f64 = 1000.0;

/// A straight move to a machine position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Move {
    /// Where X, Y and Z end, machine coordinates in units of 10 nm, at most 5 m either way.
    pub target_10nm: [i64; 3],
    /// Filament to push (or draw back), units of 0.1 nm.
    pub filament_100pm: i64,
    /// Speed along the path, of the filament where nothing else moves, mm/s.
    pub feed_mm_per_s: f64,
    /// Number of the source line.
    pub line: u32,
    /// Whether the line's move ends here.
    pub ends_move: bool,
}

/// Why a move was not taken. Nothing has changed then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MoveError {
    /// The look-ahead ring is full; try again when it is not.
    NoRoom,
    /// A coordinate is beyond 5 m, or a motor would run more than 2^28 steps.
    TooFar,
    /// More filament than one move may push.
    TooMuchFilament,
    /// The feed is not a number above zero.
    Feed,
}

/// What became of a move that was taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moved {
    /// It displaces nothing and was dropped.
    Nothing,
    /// It will be executed.
    Queued,
}

/// What [`Planner::advance`] did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Something; call again.
    Worked,
    /// Nothing: no block may leave the look-ahead ring now.
    Waiting,
}

/// The move before, as its successor's junction sees it.
#[derive(Clone, Copy, Debug)]
struct Previous {
    unit: [f64; 3],
    length_mm: f64,
    acceleration_mm_per_s2: f64,
}

/// Moves in, step entries out.
#[derive(Debug)]
pub struct Planner<S> {
    geometry: Geometry,
    limits: Limits,
    /// Target of the last move taken.
    position_10nm: [i64; 3],
    /// Motor positions at the end of the last block.
    motor_steps: [i32; 3],
    extruder: Extruder,
    /// Extruder position at the end of the last block.
    extruder_256ths: i64,
    previous: Option<Previous>,
    look_ahead: LookAhead<S>,
    interpolator: Interpolator,
    /// Speed at the end of the last block handed to the interpolator.
    exit: Speed,
    motion_ticks: u64,
    starvation_flushes: u64,
}

impl<S: AsRef<[Slot]> + AsMut<[Slot]>> Planner<S> {
    /// A planner at machine position 0 with its look-ahead ring in the given memory.
    pub fn new(geometry: Geometry, limits: Limits, ring: S) -> Self {
        Self {
            geometry,
            limits,
            position_10nm: [0; 3],
            motor_steps: [0; 3],
            extruder: Extruder::new(geometry.steps_per_mm[3]),
            extruder_256ths: 0,
            previous: None,
            look_ahead: LookAhead::new(ring),
            interpolator: Interpolator::new(geometry.minimum_event_interval_ticks),
            exit: Speed::ZERO,
            motion_ticks: 0,
            starvation_flushes: 0,
        }
    }

    /// The limits for moves to come.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Sets the limits for moves to come; those taken keep theirs.
    pub fn set_limits(&mut self, limits: Limits) {
        self.limits = limits;
    }

    /// Motors and steps of the machine.
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// Machine position at the end of all moves taken, units of 10 nm.
    pub fn position_10nm(&self) -> [i64; 3] {
        self.position_10nm
    }

    /// Sum of the durations of all blocks so far, in ticks.
    pub fn motion_ticks(&self) -> u64 {
        self.motion_ticks
    }

    /// How often a block left the look-ahead ring early because steps ran out.
    pub fn starvation_flushes(&self) -> u64 {
        self.starvation_flushes
    }

    /// Whether a move would be taken now.
    pub fn has_room(&self) -> bool {
        self.look_ahead.has_room()
    }

    /// Whether all moves taken have become step entries.
    pub fn is_idle(&self) -> bool {
        self.look_ahead.is_empty() && !self.interpolator.is_busy()
    }

    /// Whether no move waits for its speeds.
    pub fn is_look_ahead_empty(&self) -> bool {
        self.look_ahead.is_empty()
    }

    /// Whether the last entry handed out leaves the motors running.
    pub fn is_in_motion(&self) -> bool {
        self.interpolator.is_busy() || self.exit > Speed::ZERO
    }

    /// Takes a move.
    pub fn add(&mut self, request: &Move) -> Result<Moved, MoveError> {
        if !(request.feed_mm_per_s > 0.0 && request.feed_mm_per_s.is_finite()) {
            return Err(MoveError::Feed);
        }
        if request.target_10nm.iter().any(|coordinate| coordinate.unsigned_abs() > MAX_COORDINATE_10NM as u64) {
            return Err(MoveError::TooFar);
        }
        if request.filament_100pm.unsigned_abs() > self.extruder.longest_move_100pm() as u64 {
            return Err(MoveError::TooMuchFilament);
        }
        if request.target_10nm == self.position_10nm && request.filament_100pm == 0 {
            return Ok(Moved::Nothing);
        }
        if !self.has_room() {
            return Err(MoveError::NoRoom);
        }
        let motor_steps = self.geometry.motor_steps(request.target_10nm);
        let mut steps = [0; 3];
        for (steps, (to, from)) in steps.iter_mut().zip(motor_steps.iter().zip(self.motor_steps)) {
            *steps = to - from;
            if steps.unsigned_abs() > MAX_STEPS {
                return Err(MoveError::TooFar);
            }
        }
        let mut extruder = self.extruder;
        extruder.advance(request.filament_100pm);
        let extruder_end = extruder.position_256ths();
        let Ok(extruder_256ths) = i32::try_from(extruder_end - self.extruder_256ths) else {
            return Err(MoveError::TooMuchFilament);
        };

        let (block, junction, previous) = self.block(request, steps, extruder_256ths);
        self.look_ahead.push(block, junction);
        self.previous = previous;
        self.extruder = extruder;
        self.extruder_256ths = extruder_end;
        self.position_10nm = request.target_10nm;
        self.motor_steps = motor_steps;
        Ok(Moved::Queued)
    }

    /// The block of a move, its squared junction speed, and what the next junction needs.
    fn block(&self, request: &Move, steps: [i32; 3], extruder_256ths: i32) -> (Block, f64, Option<Previous>) {
        let limits = &self.limits;
        let filament_mm = request.filament_100pm.unsigned_abs() as f64 / FILAMENT_UNITS_PER_MM as f64;
        let mut path_mm = [0.0; 3];
        for (component, (to, from)) in path_mm.iter_mut().zip(request.target_10nm.iter().zip(self.position_10nm)) {
            *component = (to - from) as f64 / UNITS_PER_MM as f64;
        }
        let [x, y, z] = path_mm;
        let exact_mm = square_root(x * x + y * y + z * z);
        let mut feed = request.feed_mm_per_s.max(MIN_FEED_MM_PER_S);
        let mut acceleration;
        let length_mm;
        let mut previous = None;
        let mut junction = 0.0;

        if exact_mm * MOST_FILAMENT_PER_PATH <= filament_mm {
            length_mm = filament_mm;
            feed = feed.min(limits.max_feed_mm_per_s[3]);
            acceleration = limits.retract_acceleration_mm_per_s2.min(limits.max_acceleration_mm_per_s2[3]);
        } else {
            length_mm = exact_mm;
            let unit = path_mm.map(|component| component / exact_mm);
            acceleration = if request.filament_100pm == 0 {
                limits.travel_acceleration_mm_per_s2
            } else {
                limits.print_acceleration_mm_per_s2
            };
            let shares = [unit[0], unit[1], unit[2], filament_mm / exact_mm];
            for (axis, share) in shares.into_iter().enumerate() {
                let share = share.abs();
                if share > 0.0 {
                    feed = feed.min(limits.max_feed_mm_per_s[axis] / share);
                    acceleration = acceleration.min(limits.max_acceleration_mm_per_s2[axis] / share);
                }
            }
            if let Some(before) = &self.previous {
                let corner = Corner { before: before.unit, after: unit, shorter_mm: exact_mm.min(before.length_mm) };
                junction =
                    corner.radius_mm(limits.junction_deviation_mm) * acceleration.min(before.acceleration_mm_per_s2);
            }
            previous = Some(Previous { unit, length_mm: exact_mm, acceleration_mm_per_s2: acceleration });
        }
        // No motor steps faster than events may follow each other.
        let step_rate = f64::from(TICKS_PER_SECOND) / f64::from(self.geometry.minimum_event_interval_ticks.max(1));
        let master = steps.iter().fold(0, |most, steps| steps.unsigned_abs().max(most));
        let most_steps = f64::from(master).max(f64::from(extruder_256ths.unsigned_abs()) / 256.0);
        if most_steps > 0.0 {
            feed = feed.min(length_mm / most_steps * step_rate);
        }
        let block = Block {
            steps,
            extruder_256ths,
            length_10nm: ((length_mm * UNITS_PER_MM as f64 + 0.5) as u32).max(1),
            nominal: Speed::from_mm_per_s(feed).max(Speed(1)),
            acceleration: Acceleration::from_mm_per_s2(acceleration),
            line: request.line,
            ends_move: request.ends_move,
            inner_ends: InnerEnds::NONE,
        };
        (block, junction, previous)
    }

    /// Changes the fan when the moves taken so far are done; `false` without room.
    pub fn add_fan_power(&mut self, power: u8) -> bool {
        self.look_ahead.push_marker(Marker::FanPower { power })
    }

    /// Motion ends with the last move taken; everything in the look-ahead ring may leave.
    pub fn flush(&mut self) {
        self.look_ahead.flush();
        self.previous = None;
    }

    /// The step queue runs low and no input is at hand: the oldest block leaves with the speeds it has.
    pub fn release(&mut self) {
        if !self.look_ahead.is_empty() && !self.look_ahead.can_leave() {
            self.look_ahead.release();
            self.starvation_flushes += 1;
        }
    }

    /// Does a little work; hands at most [`crate::interpolator::MAX_ENTRIES`] entries and one notice to `sink`.
    #[inline]
    pub fn advance(&mut self, sink: &mut impl StepSink) -> Progress {
        if self.interpolator.is_busy() {
            self.interpolator.advance(sink);
            return Progress::Worked;
        }
        match self.look_ahead.pop() {
            Some(Left::Block(planned)) => {
                let law = TimeLaw::trapezoid(&planned);
                self.exit = planned.exit;
                self.motion_ticks += self.interpolator.begin(&planned, &law, sink);
            }
            Some(Left::Marker(marker)) => {
                let tick = self.interpolator.notice_tick();
                let Marker::FanPower { power } = marker;
                sink.notice(Notice::FanPower { tick, power });
            }
            None => return Progress::Waiting,
        }
        Progress::Worked
    }

    /// For estimates: takes the next block that may leave without executing it.
    pub fn next_planned(&mut self) -> Option<PlannedBlock> {
        loop {
            match self.look_ahead.pop()? {
                Left::Block(planned) => {
                    self.motion_ticks += TimeLaw::trapezoid(&planned).duration_ticks();
                    return Some(planned);
                }
                Left::Marker(_) => {}
            }
        }
    }

    /// Forgets all motion that has not happened: the motors stand at these steps (X, Y, Z, extruder), at this tick of
    /// the motion clock, with these direction signals. The position becomes the nearest to where they stand. Returns the
    /// filament that has been taken and not pushed, units of 0.1 nm.
    pub fn stand_at(&mut self, motor_steps: [i64; 4], tick: u64, directions: u8) -> i64 {
        self.look_ahead.clear();
        self.exit = Speed::ZERO;
        self.interpolator.set_directions(directions);
        let dropped_100pm = self.extruder.stand_at(motor_steps[3]);
        self.extruder_256ths = self.extruder.position_256ths();
        self.interpolator.abandon(tick, self.extruder_256ths);
        self.previous = None;
        let [x, y, z, _] = motor_steps;
        self.motor_steps = [x, y, z].map(|steps| steps as i32);
        self.position_10nm = self.geometry.position_10nm([x, y, z]);
        dropped_100pm
    }

    /// Says where the machine is, at standstill (homing). Returns where its motors therefore stand.
    pub fn set_position(&mut self, position_10nm: [i64; 3]) -> [i32; 3] {
        self.position_10nm = position_10nm;
        self.motor_steps = self.geometry.motor_steps(position_10nm);
        self.previous = None;
        self.motor_steps
    }
}

/// Filament in units of 0.1 nm for a length in units of 10 nm at a flow in percent: the exact product.
pub const fn filament_100pm(length_10nm: i64, flow_percent: i64) -> i64 {
    // 10 nm are 100 units, a percent is a hundredth.
    const _: () = assert!(FILAMENT_UNITS_PER_MM == 100 * kinematics::UNITS_PER_MM);
    length_10nm.saturating_mul(flow_percent)
}
