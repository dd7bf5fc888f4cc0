//! Plans that are read and not executed: for `estimate` and `preprocess`.

use std::cell::{Cell, RefCell};
use std::future::poll_fn;
use std::rc::Rc;
use std::task::Poll;

use ferrostep_gcode::MotionFigures;
use ferrostep_hal_shim::{Approach, FanOutput, ServoPulses};
use ferrostep_papers::Papers;
use ferrostep_planner::extruder::rounded_steps;
use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::surface::{Bed, BedStage, Mesh, MeshError};
use ferrostep_planner::{
    ChoiceError, Limits, MotionChoice, Move, MoveError, Moved, Notice, PlannedBlock, Planner, PressureAdvance,
    Progress, Recorded, Request, StepDigests, StepEntry, StepLedger, StepSink, StepsPerMm, TICKS_PER_SECOND,
};
use ferrostep_printer::machine::HomingTime;
use ferrostep_printer::{FanDemand, HomingOutcome, Motion, MotionError, Profile, Signals};
use ferrostep_virtual_board::VirtualMotors;

use super::desk_time::DeskTime;
use super::drivers::DeskDrivers;
use super::figures::{Figures, seconds};
use super::limit_factors::LimitFactors;
use super::line_ends::LineEnds;
use super::session_motion::{Desk, MotionState};
use super::z_motors::DeskZMotors;
use crate::gpre::Script;

/// Mask of all motors.
const ALL_MOTORS: u8 = 0b1111;

/// Motion that is planned before the desk lets time pass.
const LEAP_TICKS: u64 = TICKS_PER_SECOND as u64 / 10;

/// The reader's motors, which jump from block to block. Only homing makes steps, because its duration depends on the places of
/// the sensors.
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
    /// Reads the next block that may leave look-ahead, and moves the motors to its end; `false` without one.
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
    /// Holds the mesh; the motors, which make no steps, do not follow it.
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
                script.moved(request, self.planner.merged_moves() > merged);
            }
        }
        Ok(moved)
    }

    /// Reads a block; whether there is more room than before. A fan change that leaves look-ahead makes room without a
    /// block.
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
    /// A machine that has just been switched on, with this many blocks in its look-ahead ring; `is_written`: the plan is
    /// recorded.
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

/// The motion of a plan, as the printer's commands see it.
pub struct PlannedMotion<'a> {
    reader: &'a PlanReader,
    signals: &'a Signals,
}

impl PlannedMotion<'_> {
    /// Acts on the plan. Afterwards, if `leap_ticks` of motion have been planned since the last time, the desk lets time
    /// pass.
    async fn act<T>(
        &self,
        leap_ticks: u64,
        act: impl FnOnce(&mut Plan) -> Result<T, MotionError>,
    ) -> Result<T, MotionError> {
        if self.signals.is_halted() {
            return Err(MotionError::Stopped);
        }
        let outcome = act(&mut self.reader.plan.borrow_mut());
        if self.reader.tick() - self.reader.passed_tick.get() < leap_ticks {
            return outcome;
        }
        let mut is_first = true;
        poll_fn(|_| if std::mem::take(&mut is_first) { Poll::Pending } else { Poll::Ready(()) }).await;
        if self.signals.is_halted() { Err(MotionError::Stopped) } else { outcome }
    }
}

impl Motion for PlannedMotion<'_> {
    async fn add(&mut self, request: impl Request) -> Result<Moved, MotionError> {
        self.act(LEAP_TICKS, |plan| plan.add(&request)).await
    }

    async fn set_fan_power(&mut self, fan: FanOutput, power: u8) -> Result<(), MotionError> {
        self.act(LEAP_TICKS, |plan| {
            if plan.planner.is_look_ahead_empty() {
                plan.fan_powers[fan.index()] = power;
            } else {
                while !plan.planner.add_fan_power(fan as u8, power) && plan.makes_room() {}
            }
            Ok(())
        })
        .await
    }

    async fn set_pressure_advance(&mut self, advance: &PressureAdvance) -> Result<bool, MotionError> {
        self.act(LEAP_TICKS, |plan| {
            loop {
                match plan.planner.set_pressure_advance(advance) {
                    Err(MoveError::NoRoom) if plan.makes_room() => {}
                    outcome => return outcome.map_err(MotionError::Move),
                }
            }
        })
        .await
    }

    async fn finish(&mut self) -> Result<(), MotionError> {
        self.act(1, |plan| {
            plan.read_all();
            let fault = plan.planner.take_plan_fault();
            fault.map_or(Ok(()), |fault| Err(MotionError::Move(MoveError::Plan(fault))))
        })
        .await
    }

    fn begin_homing(&mut self) {
        let plan = &mut *self.reader.plan.borrow_mut();
        plan.homing_time.begin(plan.planner.motion_ticks());
    }

    async fn seek(&mut self, request: Move, axis: usize) -> Result<HomingOutcome, MotionError> {
        self.finish().await?;
        let signal = self.reader.drivers.stall_signal(axis);
        self.act(1, |plan| {
            plan.reading.motors.set_stall_signal(signal);
            plan.seek(&request, axis)
        })
        .await
    }

    fn position_10nm(&self) -> [i64; 3] {
        self.reader.plan.borrow().planner.position_10nm()
    }

    fn set_position(&mut self, position_10nm: [i64; 3]) {
        let plan = &mut *self.reader.plan.borrow_mut();
        let motors = plan.planner.set_position(position_10nm);
        plan.reading.ledger.redefine_motor_steps(motors.map(i64::from));
        plan.homing_time.end(plan.planner.motion_ticks());
    }

    fn motor_steps(&self) -> [i64; 4] {
        self.reader.plan.borrow().reading.ledger.motor_steps()
    }

    fn figures(&self) -> MotionFigures {
        let Figures { motor_steps, starvation_flushes, slowed_moves, merged_moves, digests, .. } =
            self.reader.figures();
        let StepDigests { order, step } = digests;
        MotionFigures {
            order_digest: order,
            step_digest: step,
            issued_steps: motor_steps,
            starvation_flushes,
            slowed_moves,
            merged_moves,
            ..MotionFigures::default()
        }
    }

    fn limits(&self) -> Limits {
        self.reader.factors.inverse().of(*self.reader.plan.borrow().planner.limits())
    }

    fn set_limits(&mut self, limits: Limits) {
        self.reader.plan.borrow_mut().planner.set_limits(self.reader.factors.of(limits));
    }

    fn motion_choice(&self) -> MotionChoice {
        *self.reader.plan.borrow().planner.motion_choice()
    }

    fn set_motion_choice(&mut self, choice: &MotionChoice) -> Result<(), ChoiceError> {
        self.reader.plan.borrow_mut().planner.set_motion_choice(choice)
    }

    fn extruder_steps_per_mm(&self) -> StepsPerMm {
        self.reader.plan.borrow().planner.extruder_steps_per_mm()
    }

    fn set_extruder_steps_per_mm(&mut self, steps_per_mm: StepsPerMm) -> Result<(), ChoiceError> {
        self.reader.plan.borrow_mut().planner.set_extruder_steps_per_mm(steps_per_mm)
    }

    type Servo = ferrostep_printer::Present;
    type ZMotors = ferrostep_printer::Present;
    type Tools = ferrostep_printer::Present;
    type Backlash = ferrostep_printer::Present;
    type SupplySignal = ferrostep_printer::Present;

    fn step_z_motors(&mut self, motors: u8) {
        let Reading { motors: virtual_motors, z_motors, .. } = &mut self.reader.plan.borrow_mut().reading;
        if let Some(z_motors) = z_motors {
            z_motors.step(motors, virtual_motors);
        }
    }

    fn step_extruder(&mut self, _tool: u8, offset_10nm: [i32; 2]) {
        self.reader.plan.borrow_mut().bed.set_nozzle_offset(offset_10nm);
    }

    fn send_servo_pulses(&mut self, pulses: ServoPulses) {
        self.reader.plan.borrow_mut().reading.motors.tell_pin(pulses.width_us);
    }

    type Bed = BedStage;

    fn mesh<T>(&mut self, act: impl FnOnce(&mut Mesh) -> T) -> Option<T> {
        self.reader.plan.borrow_mut().bed.mesh().map(act)
    }

    /// Blocks keep to what Z needs, so that they last as long as on a machine whose Z follows the bed.
    fn follow_bed(&mut self, on: bool) -> Result<(), MeshError> {
        let plan = &mut *self.reader.plan.borrow_mut();
        let switched = plan.bed.switch(on);
        plan.planner.set_surface(switched.ok().filter(|_| on));
        switched.map(|_| ())
    }

    fn set_motors_enabled(&mut self, motors: u8, enabled: bool) {
        let mask = &mut self.reader.plan.borrow_mut().enabled_motors;
        *mask = if enabled { *mask | motors } else { *mask & !motors };
    }

    fn is_end_stop_triggered(&self, axis: usize) -> bool {
        self.reader.plan.borrow().reading.motors.is_triggered(axis)
    }

    fn stop(&mut self) -> i64 {
        self.reader.stop();
        0
    }
}
