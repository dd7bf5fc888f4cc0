//! The stages connected: moves in, step entries out.

mod prepared;
mod step_limits;

use crate::block::{Acceleration, Block, PlannedBlock, Speed};
use crate::bresenham::MAX_STEPS;
use crate::budget::Budget;
use crate::extruder::{Extruder, FILAMENT_UNITS_PER_MM, Place, rounded_steps};
use crate::inner_ends::InnerEnds;
use crate::interpolator::Interpolator;
use crate::junction::{Pull, radius_10nm, speed_of_jumps};
use crate::kinematics::{Geometry, MAX_COORDINATE_10NM, UNITS_PER_MM, narrow};
use crate::limits::{Limits, PathLimits, larger};
use crate::look_ahead::{Left, LookAhead, Marker, Part, Slot, SpeedLaw, Violation};
use crate::merge::{Open, Planned};
use crate::method::Method;
use crate::motion_choice::{AccelerationProfile, MotionChoice};
use crate::pace::Pace;
use crate::path::Path;
use crate::s_curve::law::Curve;
use crate::s_curve::{FrequencyTable, Jerk};
use crate::step_queue::{Notice, StepSink};
use crate::time_law::TimeLaw;
use crate::u64_to_f32;
use crate::{TICKS_PER_SECOND, kinematics};
use prepared::OpenPrepared;
pub use prepared::{PreparedBlock, PreparedMove, Recorded, Retuned};

/// Slowest feed that is planned, mm/s; slower ones are raised to it. The longest block then ends within 20 days, which the
/// time base holds.
pub const MIN_FEED_MM_PER_S: f64 = 0.01;

/// A move with more filament than this for its path, 1000 to 1, is planned as an extruder-only move: there is no
/// speed along a path so short that the extruder's speed could be told by.
const MOST_FILAMENT_PER_PATH: i64 = 1000;

/// Units of filament in a unit of length.
const FILAMENT_UNITS_PER_10NM: i64 = FILAMENT_UNITS_PER_MM / UNITS_PER_MM;

/// Ticks for 10 nm at 1 mm/s.
const TICKS_PER_10NM_AT_1_MM_PER_S: f32 = (TICKS_PER_SECOND as i64 / UNITS_PER_MM) as f32;

/// A straight move to a machine position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Move {
    /// Where X, Y and Z end, machine coordinates in units of 10 nm, at most 5 m either way.
    pub target_10nm: [i64; 3],
    /// Filament to push (or draw back), units of 0.1 nm.
    pub filament_100pm: i64,
    /// Speed along the path, of the filament where nothing else moves, mm/s.
    pub feed_mm_per_s: f32,
    /// Number of the source line.
    pub line: u32,
    /// Whether the line's move ends here.
    pub ends_move: bool,
}

/// Why a move was not taken. Nothing has changed then.
// A word, for a result that is told by a byte is copied by bytes.
#[repr(u32)]
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
    /// The move was prepared, and its plan cannot be followed. Motion ends before it.
    Violation(Violation),
    /// The move was prepared for other methods than the machine's: plans are of trapezoids.
    OtherLaw,
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
    path: Path,
    /// None where there is no move before, or it has no path.
    pull: Pull,
    /// The line of which more moves come: those of an arc.
    unended_line: Option<u32>,
}

impl Previous {
    /// No move before.
    const NONE: Self = Self { path: Path::NONE, pull: Pull::ZERO, unended_line: None };
}

/// Where a move takes the motors.
#[derive(Clone, Copy, Debug)]
struct Next {
    target_10nm: [i32; 3],
    steps: [i32; 3],
    motor_steps: [i32; 3],
    extruder: Place,
    extruder_end: i64,
    extruder_256ths: i32,
}

/// Moves in, step entries out.
#[derive(Debug)]
pub struct Planner<S> {
    geometry: Geometry,
    limits: Limits,
    path_limits: PathLimits,
    /// Lengths of a step of each motor, mm.
    step_mm: [f32; 4],
    choice: MotionChoice,
    method: Method,
    budget: Budget,
    pace: Pace,
    /// Target of the last move taken.
    position_10nm: [i32; 3],
    /// Motor positions at the end of the last block.
    motor_steps: [i32; 3],
    extruder: Extruder,
    /// Extruder position at the end of the last block.
    extruder_256ths: i64,
    previous: Previous,
    /// The block before, where blocks come without their ways.
    previous_steps: Option<Block>,
    /// The newest block, which the next move may continue. It enters the ring when that is known, never sooner than the
    /// ring has room, so that a full ring holds the same blocks however late the next move comes.
    open: Open,
    /// The nominal speed of the open block as its feed is now, where that is not the one its speeds were planned with, and
    /// its planned entry speed; where it was prepared.
    open_prepared: Option<OpenPrepared>,
    /// Moves of the other kind, prepared or not, wait until the ring is empty.
    draining: bool,
    /// What was wrong with a prepared job; nothing more of it is taken.
    violation: Option<Violation>,
    /// No error has said so yet: it was found when the last block was closed.
    is_violation_untold: bool,
    /// A flush waits until the open block has entered the ring.
    flushing: bool,
    look_ahead: LookAhead<S>,
    /// The law of the run whose blocks are leaving; under an S-curve only.
    curve: Curve,
    /// The frequencies, under a table only.
    table: Option<FrequencyTable>,
    interpolator: Interpolator,
    /// Speed at the end of the last block that left look-ahead.
    exit: Speed,
    /// Where X, Y and Z's motors and the extruder (1/256 steps) are at the end of that block.
    left_steps: [i32; 3],
    left_256ths: i64,
    motion_ticks: u64,
    nominal_ticks: u64,
    starvation_flushes: u64,
    merged_moves: u64,
    slowed_moves: u64,
}

impl<S: AsRef<[Slot]> + AsMut<[Slot]>> Planner<S> {
    /// A planner at machine position 0 with its look-ahead ring in the given memory.
    pub fn new(geometry: Geometry, limits: Limits, ring: S) -> Self {
        Self {
            geometry,
            limits,
            path_limits: PathLimits::new(&limits),
            step_mm: step_limits::step_mm(&geometry),
            choice: MotionChoice::DEFAULT,
            method: Method::new(&MotionChoice::DEFAULT, geometry.kinematics),
            budget: Budget::new(&geometry),
            pace: Pace::FULL,
            position_10nm: [0; 3],
            motor_steps: [0; 3],
            extruder: Extruder::new(geometry.steps_per_mm[3]),
            extruder_256ths: 0,
            previous: Previous::NONE,
            previous_steps: None,
            open: Open::NONE,
            open_prepared: None,
            draining: false,
            violation: None,
            is_violation_untold: false,
            flushing: false,
            look_ahead: LookAhead::new(ring),
            curve: Curve::NONE,
            table: None,
            interpolator: Interpolator::new(geometry.minimum_event_interval_ticks),
            exit: Speed::ZERO,
            left_steps: [0; 3],
            left_256ths: 0,
            motion_ticks: 0,
            nominal_ticks: 0,
            starvation_flushes: 0,
            merged_moves: 0,
            slowed_moves: 0,
        }
    }

    /// The limits for moves to come.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Sets the limits for moves to come; those taken keep theirs.
    pub fn set_limits(&mut self, limits: Limits) {
        self.limits = limits;
        self.path_limits = PathLimits::new(&limits);
    }

    /// The methods that make the steps.
    pub fn motion_choice(&self) -> &MotionChoice {
        &self.choice
    }

    /// Sets the methods that make the steps; `false` where moves wait, this build has not what is chosen, or its parameters are out of range
    /// (a profile's file has been checked for that), and then nothing has changed.
    pub fn set_motion_choice(&mut self, choice: &MotionChoice) -> bool {
        if !(self.is_idle() && choice.is_offered()) {
            return false;
        }
        let Some(law) = speed_law(choice) else { return false };
        self.choice = *choice;
        self.method = Method::new(choice, self.geometry.kinematics);
        self.interpolator.set_method(choice, self.geometry.kinematics);
        self.table = match law {
            SpeedLaw::Table(table) => Some(table),
            SpeedLaw::Trapezoid | SpeedLaw::SCurve(_) | SpeedLaw::SCurveBlockByBlock(_) => None,
        };
        self.look_ahead.set_law(&law);
        true
    }

    /// For comparison: under an S-curve, lets every block begin and end without acceleration instead of giving neighbours
    /// one law. `false` where moves wait or the motion is not of that kind, and then nothing has changed.
    pub fn plan_block_by_block(&mut self) -> bool {
        match speed_law(&self.choice) {
            Some(SpeedLaw::SCurve(jerk)) if self.is_idle() => {
                self.look_ahead.set_law(&SpeedLaw::SCurveBlockByBlock(jerk));
                true
            }
            _ => false,
        }
    }

    /// Holds the blocks that leave look-ahead from now on to a share of their nominal speeds, within what acceleration
    /// allows. For a machine that cannot keep up; [`Pace::FULL`] at first, and then nothing is changed.
    pub fn set_pace(&mut self, pace: Pace) {
        self.pace = pace;
    }

    /// The share of their nominal speeds that blocks keep.
    pub fn pace(&self) -> Pace {
        self.pace
    }

    /// Motors and steps of the machine.
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// Machine position at the end of all moves taken, units of 10 nm.
    pub fn position_10nm(&self) -> [i64; 3] {
        self.position_10nm.map(i64::from)
    }

    /// Sum of the durations of all blocks so far, in ticks.
    pub fn motion_ticks(&self) -> u64 {
        self.motion_ticks
    }

    /// How long all blocks begun so far would have lasted at their nominal speeds, in ticks: neither the pace nor ramps
    /// make them longer. What planning may take of the processor's time to keep up at full speed.
    pub fn nominal_ticks(&self) -> u64 {
        self.nominal_ticks
    }

    /// How often a block left the look-ahead ring early because steps ran out.
    pub fn starvation_flushes(&self) -> u64 {
        self.starvation_flushes
    }

    /// How many moves were joined to the one before, two moves that became one block counting as one.
    pub fn merged_moves(&self) -> u64 {
        self.merged_moves
    }

    /// How many moves became slower because the processor could not have kept up with them.
    pub fn slowed_moves(&self) -> u64 {
        self.slowed_moves
    }

    /// Whether any move or fan change would be taken now; some are even if this says no.
    pub fn has_room(&self) -> bool {
        self.look_ahead.has_room() && (!self.draining || self.is_look_ahead_empty())
    }

    /// Whether all moves taken have become step entries.
    pub fn is_idle(&self) -> bool {
        self.is_look_ahead_empty() && !self.interpolator.is_busy()
    }

    /// Whether no move waits for its speeds.
    pub fn is_look_ahead_empty(&self) -> bool {
        !self.open.is_some() && self.look_ahead.is_empty()
    }

    /// Whether the last entry handed out leaves the motors running.
    pub fn is_in_motion(&self) -> bool {
        self.interpolator.is_busy() || self.exit > Speed::ZERO
    }

    /// Takes a move.
    pub fn add(&mut self, request: &Move) -> Result<Moved, MoveError> {
        self.add_making_room(request, |_| false)
    }

    /// As [`Self::add`], but where the move needs room it is made: `make_room` takes a block with [`Self::next_planned`] or
    /// [`Self::next_recorded`], and returns whether there was one. So a move is planned once, not again after it was refused.
    ///
    /// # Errors
    /// As [`Self::add`].
    pub fn add_making_room(
        &mut self,
        request: &Move,
        mut make_room: impl FnMut(&mut Self) -> bool,
    ) -> Result<Moved, MoveError> {
        if self.look_ahead.is_prepared() && !self.end_prepared() {
            return Err(MoveError::NoRoom);
        }
        let Some(next) = self.next(request)? else { return Ok(Moved::Nothing) };
        let planned = self.plan_apart(request, &next, request.filament_100pm);
        if !self.flushing && self.shares_blocks() && self.open.absorb(&planned) {
            self.merged_moves += 1;
        } else {
            while !self.close() {
                if !make_room(self) {
                    return Err(MoveError::NoRoom);
                }
            }
            self.open.begin(&planned);
        }
        self.follow(&next, &planned);
        Ok(Moved::Queued)
    }

    /// Whether moves may share a block. The papers' other methods decide from the start of a block, and the table of
    /// frequencies counts the steps of a whole block.
    #[inline]
    fn shares_blocks(&self) -> bool {
        self.method.is_default() && self.table.is_none()
    }

    /// Where a move takes the motors; `None` if it displaces nothing.
    #[inline(always)]
    fn next(&self, request: &Move) -> Result<Option<Next>, MoveError> {
        // NaN is in no range. `is_finite` takes the number's bits apart.
        if !(request.feed_mm_per_s > 0.0 && request.feed_mm_per_s <= f32::MAX) {
            return Err(MoveError::Feed);
        }
        let Some(target_10nm) = narrow(request.target_10nm) else { return Err(MoveError::TooFar) };
        if !Extruder::can_push(self.geometry.steps_per_mm[3], request.filament_100pm) {
            return Err(MoveError::TooMuchFilament);
        }
        if request.filament_100pm == 0 && target_10nm == self.position_10nm {
            return Ok(None);
        }
        let motor_steps = self.geometry.motor_steps_from(target_10nm, self.position_10nm, self.motor_steps);
        // A target is within 10^8 steps, and so is where the motors stand: nothing wraps.
        let [[x, y, z], [from_x, from_y, from_z]] = [motor_steps, self.motor_steps];
        let steps = [x.wrapping_sub(from_x), y.wrapping_sub(from_y), z.wrapping_sub(from_z)];
        if steps.iter().any(|steps| steps.unsigned_abs() > MAX_STEPS) {
            return Err(MoveError::TooFar);
        }
        let extruder = self.extruder.advanced(request.filament_100pm);
        let extruder_end = extruder.position_256ths();
        let Ok(extruder_256ths) = i32::try_from(extruder_end.wrapping_sub(self.extruder_256ths)) else {
            return Err(MoveError::TooMuchFilament);
        };
        Ok(Some(Next { target_10nm, steps, motor_steps, extruder, extruder_end, extruder_256ths }))
    }

    /// The move has been taken.
    #[inline(always)]
    fn follow(&mut self, next: &Next, planned: &Planned) {
        let unended_line = (!planned.block.ends_move).then_some(planned.block.line);
        self.previous = Previous { path: planned.path, pull: planned.pull, unended_line };
        self.extruder.set(next.extruder);
        self.extruder_256ths = next.extruder_end;
        self.position_10nm = next.target_10nm;
        self.motor_steps = next.motor_steps;
    }

    /// [`Self::plan`] in one place, but for prepared moves.
    #[inline(never)]
    fn plan_apart(&self, request: &Move, next: &Next, corner_filament_100pm: i64) -> Planned {
        self.plan(request, next, corner_filament_100pm)
    }

    /// A move as a block of its own, its speed not yet within the budget. Its corners see `corner_filament_100pm` of
    /// filament, units of 0.1 nm.
    #[inline(always)]
    fn plan(&self, request: &Move, next: &Next, corner_filament_100pm: i64) -> Planned {
        let Next { target_10nm, steps, extruder_256ths, .. } = *next;
        let least = MIN_FEED_MM_PER_S as f32;
        let feed = if request.feed_mm_per_s < least { least } else { request.feed_mm_per_s };
        let filament_100pm = request.filament_100pm.wrapping_abs();
        let filament = filament_10nm(filament_100pm);
        let mut path = Path::between(self.position_10nm, target_10nm);
        path.filament = if corner_filament_100pm == request.filament_100pm {
            if filament_100pm == request.filament_100pm { filament } else { -filament }
        } else {
            filament_10nm(corner_filament_100pm)
        };
        let path_10nm = path.length_10nm();

        let moves_filament_alone =
            i64::from(path_10nm) * (MOST_FILAMENT_PER_PATH * FILAMENT_UNITS_PER_10NM) <= filament_100pm;
        let (length, length_10nm, (mut feed, acceleration)) = if moves_filament_alone {
            let rounded = (filament_100pm + FILAMENT_UNITS_PER_10NM / 2) / FILAMENT_UNITS_PER_10NM;
            (filament, (rounded as u32).max(1), self.path_limits.of_filament(feed))
        } else {
            let [x, y, z] = path.vector_10nm.map(|component| component.unsigned_abs() as f32);
            let prints = filament_100pm != 0;
            (path.length, path_10nm, self.path_limits.along(feed, path.length, [x, y, z, filament], prints))
        };
        let mut block = Block {
            steps,
            extruder_256ths,
            length_10nm,
            nominal: Speed::ZERO,
            acceleration: Acceleration::from_mm_per_s2_f32(acceleration),
            line: request.line,
            ends_move: request.ends_move,
            inner_ends: InnerEnds::NONE,
        };
        // No motor steps faster than events may follow each other: v / S * steps <= 1 / interval.
        let (densest, least_ticks) = self.method.densest_and_least_ticks(steps);
        let most = larger(densest as f32, extruder_256ths.unsigned_abs() as f32 / 256.0);
        let shortest_ticks = most * self.geometry.minimum_event_interval_ticks as f32;
        let shortest_ticks = larger(shortest_ticks, least_ticks);
        if feed * shortest_ticks > length * TICKS_PER_10NM_AT_1_MM_PER_S {
            feed = length * TICKS_PER_10NM_AT_1_MM_PER_S / shortest_ticks;
        }
        block.nominal = Speed::from_mm_per_s_f32(feed).max(Speed(1));
        let pull = if moves_filament_alone { Pull::ZERO } else { Pull::of_mm_per_s2(acceleration) };
        let has_corner = pull.is_some() && self.previous.pull.is_some();
        let junction = if has_corner { self.junction(&path, pull, request.line) } else { Speed::ZERO };
        let events = self.events(steps, path.filament);
        Planned { block, events, junction, path, pull }
    }

    /// Most step events of a move: of X, Y and Z's motors, and of the extruder with this filament, units of 10 nm. How its
    /// steps fall depends on what was pushed before; a plan must not, and so counts one more than it has filament for.
    #[inline(always)]
    fn events(&self, steps: [i32; 3], filament_10nm: f32) -> f32 {
        let motors = self.method.events(steps) as f32;
        if filament_10nm == 0.0 {
            return motors;
        }
        let [.., step_mm] = self.step_mm;
        motors + 1.0 + filament_10nm.abs() / (step_mm * UNITS_PER_MM as f32)
    }

    /// Bound of the speed in the corner before a path; a stop is next to a move without one.
    #[inline(never)]
    fn junction(&self, path: &Path, pull: Pull, line: u32) -> Speed {
        let before = &self.previous;
        let radius = radius_10nm(&before.path, path, self.path_limits.four_deviations_10nm);
        self.held_in_corner(pull.weaker(before.pull).speed_along(radius), path, line)
    }

    /// What the axes' instantaneous corner velocities leave of a speed. Between the chords of an arc they ask for nothing:
    /// what is commanded has no corner there.
    #[inline(always)]
    fn held_in_corner(&self, speed: Speed, path: &Path, line: u32) -> Speed {
        let before = &self.previous;
        if before.unended_line == Some(line) {
            return speed;
        }
        speed.min(speed_of_jumps(&before.path, path, self.path_limits.per_corner_velocity))
    }

    /// The open block enters the ring, within the budget; `false` without room. A flush that waited for it follows.
    fn close(&mut self) -> bool {
        let open = &mut self.open;
        if open.is_some() {
            if self.open_prepared.is_some() {
                if !self.close_prepared() {
                    return false;
                }
            } else {
                if !self.look_ahead.has_room() {
                    return false;
                }
                let nominal = open.block.nominal;
                let cost = self.budget.cost(&open.block, open.events, open.moves);
                if let Some(slower) = cost.slower_nominal(nominal) {
                    open.block.nominal = slower;
                    self.slowed_moves += u64::from(open.moves);
                }
                self.look_ahead.push(&open.block, open.junction);
                open.clear();
            }
        }
        if self.flushing {
            self.flushing = false;
            self.look_ahead.flush();
        }
        true
    }

    /// Changes the fan when the moves taken so far are done; `false` without room.
    pub fn add_fan_power(&mut self, power: u8) -> bool {
        self.close() && self.look_ahead.push_marker(Marker::FanPower { power })
    }

    /// Motion ends with the last move taken; everything in the look-ahead ring may leave.
    pub fn flush(&mut self) {
        self.flushing = true;
        self.close();
        self.previous.pull = Pull::ZERO;
        self.previous_steps = None;
    }

    /// The step queue runs low and no input is at hand: the oldest block leaves with the speeds it has.
    pub fn release(&mut self) {
        if !self.is_look_ahead_empty() && !self.look_ahead.can_leave() {
            self.close();
            self.look_ahead.release();
            self.starvation_flushes += 1;
        }
    }

    /// Does a little work; hands at most [`crate::interpolator::MAX_ENTRIES`] entries and two notices to `sink`.
    #[inline]
    pub fn advance(&mut self, sink: &mut impl StepSink) -> Progress {
        if self.interpolator.is_busy() {
            self.interpolator.advance(sink);
            if !self.interpolator.is_busy() {
                let ([x, y, z], extruder) = (self.left_steps, rounded_steps(self.left_256ths));
                let motor_steps = [i64::from(x), i64::from(y), i64::from(z), extruder];
                sink.notice(Notice::BlockEnded { tick: self.interpolator.notice_tick(), motor_steps });
            }
            return Progress::Worked;
        }
        match self.pop() {
            Some(Left::Block(planned)) => {
                let law = match &self.table {
                    None => TimeLaw::trapezoid(&planned),
                    Some(table) => TimeLaw::staircase(&planned, table),
                };
                self.begin(&planned, &law, sink);
            }
            Some(Left::Part(part)) => {
                let (planned, law) = self.along(&part);
                self.begin(&planned, &law, sink);
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

    #[inline]
    fn begin(&mut self, planned: &PlannedBlock, law: &TimeLaw, sink: &mut impl StepSink) {
        self.exit = planned.exit;
        let nominal_ticks = self.look_ahead.left_nominal().ticks_for(planned.block.length_10nm);
        self.nominal_ticks = self.nominal_ticks.saturating_add(nominal_ticks);
        self.motion_ticks += self.interpolator.begin(planned, law, sink);
    }

    /// The speeds and the law of a block of a run.
    #[inline(never)]
    fn along(&mut self, part: &Part) -> (PlannedBlock, TimeLaw) {
        let entry = if part.offset_10nm == 0 {
            self.curve = Curve::new(&part.run);
            part.run.entry
        } else {
            self.exit
        };
        let (law, exit) = TimeLaw::along(&self.curve, part.offset_10nm, part.block.length_10nm);
        let ends_run = part.offset_10nm.saturating_add(part.block.length_10nm) >= part.run.length_10nm;
        let exit = if ends_run { part.run.exit } else { exit };
        self.exit = exit;
        (PlannedBlock { block: part.block, entry, exit }, law)
    }

    /// What may leave look-ahead now.
    #[inline]
    fn pop(&mut self) -> Option<Left> {
        if self.flushing {
            self.close();
        }
        let left = self.look_ahead.pop(self.pace);
        if let Some(Left::Block(PlannedBlock { block, .. }) | Left::Part(Part { block, .. })) = &left {
            let ([x, y, z], [dx, dy, dz]) = (self.left_steps, block.steps);
            // As the sums that were taken: within 31 and 63 bits.
            self.left_steps = [x.wrapping_add(dx), y.wrapping_add(dy), z.wrapping_add(dz)];
            self.left_256ths = self.left_256ths.wrapping_add(i64::from(block.extruder_256ths));
        }
        left
    }

    /// For estimates: takes the next block that may leave without executing it.
    pub fn next_planned(&mut self) -> Option<PlannedBlock> {
        loop {
            match self.pop()? {
                Left::Block(planned) => {
                    self.motion_ticks += match &self.table {
                        None => TimeLaw::trapezoid(&planned).duration_ticks(),
                        Some(table) => TimeLaw::staircase(&planned, table).duration_ticks(),
                    };
                    return Some(planned);
                }
                Left::Part(part) => {
                    let (planned, law) = self.along(&part);
                    self.motion_ticks += law.duration_ticks();
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
        // Every field is named: a new one has to say here what remains of it after a stop.
        let Self {
            geometry,
            limits: _,
            path_limits: _,
            step_mm: _,
            choice: _,
            method: _,
            budget: _,
            pace: _,
            position_10nm,
            motor_steps: taken_steps,
            extruder,
            extruder_256ths,
            previous,
            previous_steps,
            open,
            open_prepared,
            draining,
            violation,
            is_violation_untold,
            flushing,
            look_ahead,
            curve,
            table: _,
            interpolator,
            exit,
            left_steps,
            left_256ths,
            motion_ticks: _,
            nominal_ticks: _,
            starvation_flushes: _,
            merged_moves: _,
            slowed_moves: _,
        } = self;
        let [x, y, z, e] = motor_steps;
        let dropped_100pm = extruder.stand_at(e);
        *extruder_256ths = extruder.position_256ths();
        *position_10nm = geometry.position_10nm([x, y, z]).map(within_reach);
        *taken_steps = [x, y, z].map(|steps| steps as i32);
        *previous = Previous::NONE;
        *previous_steps = None;
        *open = Open::NONE;
        *open_prepared = None;
        *draining = false;
        *violation = None;
        *is_violation_untold = false;
        *flushing = false;
        look_ahead.clear();
        *curve = Curve::NONE;
        interpolator.stand_at(tick, *extruder_256ths, directions);
        *exit = Speed::ZERO;
        *left_steps = *taken_steps;
        *left_256ths = *extruder_256ths;
        dropped_100pm
    }

    /// Says where the machine is, at standstill (homing). Returns where its motors therefore stand.
    pub fn set_position(&mut self, position_10nm: [i64; 3]) -> [i32; 3] {
        self.position_10nm = position_10nm.map(within_reach);
        self.motor_steps = self.geometry.motor_steps(self.position_10nm());
        self.left_steps = self.motor_steps;
        self.previous = Previous::NONE;
        self.motor_steps
    }
}

/// Filament of units of 0.1 nm in units of 10 nm.
#[inline(always)]
fn filament_10nm(filament_100pm: i64) -> f32 {
    // Of up to 43 cm the processor makes a float.
    let filament = match u32::try_from(filament_100pm) {
        Ok(filament) => filament as f32,
        Err(_) => u64_to_f32::of_i64(filament_100pm),
    };
    filament / FILAMENT_UNITS_PER_10NM as f32
}

/// The nearest coordinate within 5 m.
fn within_reach(coordinate_10nm: i64) -> i32 {
    coordinate_10nm.clamp(-MAX_COORDINATE_10NM, MAX_COORDINATE_10NM) as i32
}

/// How speeds change under a choice; `None` where its parameters are out of range.
fn speed_law(choice: &MotionChoice) -> Option<SpeedLaw> {
    Some(match choice.acceleration {
        AccelerationProfile::Trapezoid => SpeedLaw::Trapezoid,
        AccelerationProfile::SCurve => SpeedLaw::SCurve(Jerk::from_mm_per_s3(choice.jerk_mm_per_s3).ok()?),
        AccelerationProfile::SCurveTable => {
            let [start_hz, top_hz, jerk_hz_per_s2] = {
                let table = &choice.s_curve_table;
                [table.start_hz, table.top_hz, table.jerk_hz_per_s2].map(f64::from)
            };
            SpeedLaw::Table(FrequencyTable::new(start_hz, top_hz, jerk_hz_per_s2).ok()?)
        }
    })
}

/// Filament in units of 0.1 nm for a length in units of 10 nm at a flow in percent: the exact product.
pub const fn filament_100pm(length_10nm: i64, flow_percent: i64) -> i64 {
    // 10 nm are 100 units, a percent is a hundredth.
    const _: () = assert!(FILAMENT_UNITS_PER_MM == 100 * kinematics::UNITS_PER_MM);
    length_10nm.saturating_mul(flow_percent)
}
