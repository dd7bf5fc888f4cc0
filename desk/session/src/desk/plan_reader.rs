//! Plans that are read and not executed: for `estimate` and `preprocess`.

mod planned_motion;

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use ferrostep_hal_shim::{Approach, FanOutput};
use ferrostep_papers::Papers;
use ferrostep_planner::extruder::rounded_steps;
use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::surface::{Bed, BedStage};
use ferrostep_planner::{
    Move, MoveError, Moved, Notice, PlannedBlock, Planner, Progress, Recorded, Request, StepDigests, StepEntry,
    StepLedger, StepSink,
};
use ferrostep_printer::machine::HomingTime;
use ferrostep_printer::{FanDemand, HomingOutcome, MotionError, Profile, Signals};
use ferrostep_virtual_board::VirtualMotors;

use super::desk_time::DeskTime;
use super::drivers::DeskDrivers;
use super::figures::{Figures, seconds};
use super::limit_factors::LimitFactors;
use super::line_ends::LineEnds;
use super::session_motion::{Desk, MotionState};
use super::z_motors::DeskZMotors;
use crate::gpre::Script;

pub(crate) use planned_motion::LEAP_TICKS;
pub use planned_motion::PlannedMotion;

/// Mask of all motors.
const ALL_MOTORS: u8 = 0b1111;

/// The reader's motors, which jump from block to block. Only homing makes steps, because its
/// duration depends on the places of the sensors.
struct Reading {
    motors: VirtualMotors,
    z_motors: Option<DeskZMotors>,
    /// The motors' positions as the machine counts them.
    ledger: StepLedger,
    /// Digests of the steps that were made.
    digests: StepDigests,
    /// Durations of the blocks that were read, ticks.
    read_ticks: u64,
    /// Position of the extruder after these blocks, 1/256 steps.
    extruder_256ths: i64,
    /// The record of the plan, if one is written.
    script: Option<Script>,
    /// The ends of lines, if someone follows them.
    line_ends: Option<Rc<LineEnds>>,
}

impl Reading {
    /// Reads the next block that may leave look-ahead, and moves the motors to its end;
    /// `false` without one.
    fn read(&mut self, planner: &mut Planner<Vec<Slot>, Papers>) -> bool {
        let before = planner.motion_ticks();
        let planned = match &mut self.script {
            None => planner.next_planned(),
            Some(script) => {
                let Some(recorded) = script.record_next(planner) else { return false };
                match recorded {
                    Recorded::Block { planned, .. } => Some(planned),
                    Recorded::FanPower { .. } => return true,
                }
            }
        };
        let Some(PlannedBlock { block, .. }) = planned else {
            self.read_ticks += planner.pass_over_rest();
            return false;
        };
        self.read_ticks += planner.motion_ticks() - before;
        let extruder_before = rounded_steps(self.extruder_256ths);
        self.extruder_256ths += i64::from(block.extruder_256ths);
        let [x, y, z] = block.steps.map(i64::from);
        let steps = [x, y, z, rounded_steps(self.extruder_256ths) - extruder_before];
        self.motors.ledger.displace(steps);
        self.ledger.displace(steps);
        if let Some(ends) = &self.line_ends {
            ends.note(block.line, self.ledger.tick() + self.read_ticks);
        }
        true
    }
}

/// Planner and reader.
struct Plan {
    planner: Planner<Vec<Slot>, Papers>,
    /// Keeps the mesh; the motors, which make no steps, do not follow it.
    bed: BedStage,
    reading: Reading,
    homing_time: HomingTime,
    enabled_motors: u8,
    fan_powers: [u8; FanOutput::COUNT],
}

impl Plan {
    /// Adds motion; reads blocks to make room for it.
    fn add(&mut self, request: &impl Request) -> Result<Moved, MotionError> {
        let merged = self.planner.merged_moves();
        let moved = loop {
            let reading = &mut self.reading;
            match self.planner.add_making_room(request, |planner| reading.read(planner)) {
                Err(MoveError::NoRoom) if self.makes_room() => {}
                outcome => break outcome.map_err(MotionError::Move)?,
            }
        };
        if moved == Moved::Queued {
            self.enabled_motors = ALL_MOTORS;
            if let (Some(script), Some(request)) = (&mut self.reading.script, request.as_move()) {
                script.moved(&request, self.planner.merged_moves() > merged);
            }
        }
        Ok(moved)
    }

    /// Reads a block; whether there is more room than before. A fan change that leaves look-ahead
    /// makes room without a block.
    fn makes_room(&mut self) -> bool {
        self.reading.read(&mut self.planner) || self.planner.has_room()
    }

    /// Reads all blocks.
    fn read_all(&mut self) {
        self.planner.flush();
        while self.reading.read(&mut self.planner) {}
    }

    /// Makes the steps of a move at standstill, up to the sensor of an axis.
    fn seek(&mut self, request: &Move, axis: usize) -> Result<HomingOutcome, MotionError> {
        self.homing_time.begin(self.planner.motion_ticks());
        if self.add(request)? == Moved::Nothing {
            return Ok(HomingOutcome::Missed);
        }
        self.planner.set_unshaped(true);
        self.planner.flush();
        let Reading { motors, ledger, digests, .. } = &mut self.reading;
        let mut steps = Seek { motors, ledger, digests, axis, triggered: false };
        steps.triggered = steps.motors.is_triggered(axis);
        while !steps.triggered && self.planner.advance(&mut steps) == Progress::Worked {}
        let triggered = steps.triggered;
        if triggered {
            let ledger = &self.reading.ledger;
            self.planner.reset_to(ledger.motor_steps(), ledger.tick(), ledger.directions());
        }
        self.planner.set_unshaped(false);
        if let Some(script) = &mut self.reading.script {
            script.sought();
        }
        Ok(if triggered { HomingOutcome::Triggered } else { HomingOutcome::Missed })
    }

    /// Ticks of all motion so far.
    fn tick(&self) -> u64 {
        self.reading.ledger.tick() + self.reading.read_ticks
    }
}

/// The steps of a move towards a sensor.
struct Seek<'a> {
    motors: &'a mut VirtualMotors,
    ledger: &'a mut StepLedger,
    digests: &'a mut StepDigests,
    axis: usize,
    triggered: bool,
}

impl StepSink for Seek<'_> {
    fn entry(&mut self, entry: StepEntry) {
        if self.triggered {
            return;
        }
        let Approach { added, triggered } = self.motors.play_until_triggered(entry, self.axis, &mut ());
        if let Some(added) = added {
            self.ledger.play(added, self.digests);
        }
        self.triggered = triggered;
    }

    fn notice(&mut self, _notice: Notice) {}
}

/// A planner whose blocks are read.
pub struct PlanReader {
    plan: RefCell<Plan>,
    factors: LimitFactors,
    time: Rc<DeskTime>,
    drivers: Rc<DeskDrivers>,
    /// Tick up to which the desk has let time pass.
    passed_tick: Cell<u64>,
}

impl PlanReader {
    /// A machine that has just been switched on, with this many blocks in its look-ahead ring;
    /// `is_written`: the plan is recorded.
    pub fn new(profile: &Profile, look_ahead: usize, drivers: Rc<DeskDrivers>, is_written: bool) -> Self {
        let mut planner = Planner::new(profile.geometry(), profile.limits, vec![Slot::EMPTY; look_ahead]);
        // The profile's file has been checked for all of them.
        planner.set_motion_choice(&profile.motion).ok();
        let mut motors = profile.virtual_motors();
        motors.set_framed(profile.framed_axes());
        let reading = Reading {
            motors,
            z_motors: DeskZMotors::new(profile),
            ledger: StepLedger::default(),
            digests: StepDigests::default(),
            read_ticks: 0,
            extruder_256ths: 0,
            script: is_written.then(Script::default),
            line_ends: None,
        };
        let bed = BedStage::new(&profile.geometry());
        let plan = Plan {
            planner,
            bed,
            reading,
            homing_time: HomingTime::default(),
            enabled_motors: 0,
            fan_powers: [0; FanOutput::COUNT],
        };
        let factors = LimitFactors::default();
        Self { plan: RefCell::new(plan), factors, time: Rc::default(), drivers, passed_tick: Cell::new(0) }
    }

    /// The same with other limits; commands that read or change them see those without the factors.
    #[must_use]
    pub fn with_factors(mut self, factors: LimitFactors) -> Self {
        let planner = &mut self.plan.get_mut().planner;
        planner.set_limits(factors.of(*planner.limits()));
        Self { factors, ..self }
    }

    /// Moves the motors at once to where another planner's moves have taken them, at standstill.
    pub(crate) fn jump_to(&self, position_10nm: [i64; 3]) {
        let Plan { planner, reading, .. } = &mut *self.plan.borrow_mut();
        let ([x, y, z], [from_x, from_y, from_z, _]) =
            (planner.set_position(position_10nm).map(i64::from), reading.ledger.motor_steps());
        let steps = [x - from_x, y - from_y, z - from_z, 0];
        reading.motors.ledger.displace(steps);
        reading.ledger.displace(steps);
    }

    /// Gives access to the record of the plan.
    pub fn with_script<T>(&self, act: impl FnOnce(&mut Script) -> T) -> Option<T> {
        self.plan.borrow_mut().reading.script.as_mut().map(act)
    }
}

impl Desk for PlanReader {
    type Motion<'a> = PlannedMotion<'a>;

    type State = Self;

    const MAKES_STEPS: bool = false;

    fn motion<'a>(&'a self, signals: &'a Signals) -> PlannedMotion<'a> {
        PlannedMotion { reader: self, signals }
    }

    fn pass_motion(&self) {
        self.passed_tick.set(self.tick());
    }

    fn wait_until(&self, wake_ns: u64) {
        self.time.wait_until(self.tick(), wake_ns);
    }

    fn now_ns(&self) -> u64 {
        self.time.now_ns(self.tick())
    }

    fn follow_lines(&self, ends: Rc<LineEnds>) -> bool {
        self.plan.borrow_mut().reading.line_ends = Some(ends);
        true
    }

    fn state(&self) -> &Self {
        self
    }
}

impl MotionState for PlanReader {
    fn tick(&self) -> u64 {
        self.plan.borrow().tick()
    }

    /// Reads the plan to its end: without steps the machine stops at the end of its moves.
    fn stop(&self) {
        self.plan.borrow_mut().read_all();
    }

    fn fan_demand(&self) -> FanDemand {
        let plan = self.plan.borrow();
        FanDemand { powers: plan.fan_powers, motors_on: plan.enabled_motors != 0 }
    }

    fn enabled_motors(&self) -> u8 {
        self.plan.borrow().enabled_motors
    }

    fn plan_block_by_block(&self) -> bool {
        self.plan.borrow_mut().planner.plan_block_by_block()
    }

    fn figures(&self) -> Figures {
        let plan = self.plan.borrow();
        Figures {
            print_time_s: 0.0,
            motion_time_s: seconds(plan.planner.motion_ticks() - plan.homing_time.ticks()),
            motor_steps: plan.reading.ledger.issued(),
            max_event_rate_hz: 0,
            underruns: 0,
            starvation_flushes: plan.planner.starvation_flushes(),
            slowed_moves: plan.planner.slowed_moves(),
            merged_moves: plan.planner.merged_moves(),
            digests: plan.reading.digests,
        }
    }
}
