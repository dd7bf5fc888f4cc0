//! A desk that plans a job by another firmware's rules.

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use ferrostep_planner::kinematics::MAX_COORDINATE_10NM;
use ferrostep_planner::{Move, MoveError};
use ferrostep_printer::{FanDemand, Motion, MotionError, Profile, Signals};

use super::motion::RulesMotion;
use super::observer::PlanObserver;
use super::plan::{Plan, millimetres};
use super::refusals::Refusals;
use super::settings::ByRules;
use crate::desk::{
    Desk, DeskDrivers, DeskTime, Figures, LOOK_AHEAD_BLOCKS, LineEnds, MotionState, PlanReader, PlannedMotion,
};
use crate::limit_shares::RulesReport;

/// Plans moves by another firmware's rules, and homes by this one's.
pub struct RulesReader {
    own: PlanReader,
    plan: RefCell<Plan>,
    /// The end of the moves of that plan, which this firmware's planner has not followed; `None`:
    /// it is there.
    ahead_10nm: Cell<Option<[i64; 3]>>,
    is_homing: Cell<bool>,
    time: DeskTime,
    /// Tick up to which the desk has let time pass.
    passed_tick: Cell<u64>,
}

impl RulesReader {
    /// A machine that has just been switched on.
    pub fn new(profile: &Profile, by: ByRules, drivers: Rc<DeskDrivers>) -> Self {
        Self {
            own: PlanReader::new(profile, LOOK_AHEAD_BLOCKS, drivers, false),
            plan: RefCell::new(Plan::new(by)),
            ahead_10nm: Cell::new(None),
            is_homing: Cell::new(false),
            time: DeskTime::default(),
            passed_tick: Cell::new(0),
        }
    }

    /// Reports all motion from now on to an observer; none has been planned.
    pub fn observe(&self, observer: Box<dyn PlanObserver>) {
        self.with_plan(|plan| plan.observe(observer));
    }

    /// The machine is at another place.
    pub(super) fn stands(&self, position_10nm: [i64; 3]) {
        let tick = self.tick();
        self.with_plan(|plan| plan.with_observer(|observer| observer.stands(tick, millimetres(position_10nm))));
    }

    /// Gives access to the plan.
    pub(super) fn with_plan<T>(&self, act: impl FnOnce(&mut Plan) -> T) -> T {
        act(&mut self.plan.borrow_mut())
    }

    /// True from the beginning of homing until it sets the position.
    pub(super) fn is_homing(&self) -> bool {
        self.is_homing.get()
    }

    /// Homing begins or ends.
    pub(super) fn set_homing(&self, is_homing: bool) {
        self.is_homing.set(is_homing);
    }

    /// Ticks of motion since the desk let time pass.
    pub(super) fn waiting_ticks(&self) -> u64 {
        self.tick().saturating_sub(self.passed_tick.get())
    }

    /// The position after all moves.
    pub(super) fn position_10nm(&self, own: &PlannedMotion<'_>) -> [i64; 3] {
        self.ahead_10nm.get().unwrap_or_else(|| own.position_10nm())
    }

    /// Takes a move.
    ///
    /// # Errors
    /// [`MoveError`]; nothing has changed.
    pub(super) fn add(&self, one: &Move, own: &PlannedMotion<'_>) -> Result<(), MotionError> {
        if one.target_10nm.iter().any(|place| place.unsigned_abs() > MAX_COORDINATE_10NM as u64) {
            return Err(MotionError::Move(MoveError::TooFar));
        }
        let from_10nm = self.position_10nm(own);
        let own_ticks = self.own.tick();
        self.with_plan(|plan| plan.add(one, from_10nm, own_ticks)).map_err(|_| MotionError::Move(MoveError::Feed))?;
        self.ahead_10nm.set(Some(one.target_10nm));
        Ok(())
    }

    /// Plans all moves to their end at rest, where this firmware's planner takes over.
    pub(super) fn come_to_rest(&self) {
        self.with_plan(Plan::flush);
        if let Some(position_10nm) = self.ahead_10nm.take() {
            self.own.jump_to(position_10nm);
        }
    }
}

impl Desk for RulesReader {
    type Motion<'a> = RulesMotion<'a>;

    type State = Self;

    const MAKES_STEPS: bool = false;

    fn motion<'a>(&'a self, signals: &'a Signals) -> RulesMotion<'a> {
        RulesMotion::new(self, self.own.motion(signals), signals)
    }

    fn pass_motion(&self) {
        self.own.pass_motion();
        self.passed_tick.set(self.tick());
    }

    fn wait_until(&self, wake_ns: u64) {
        self.time.wait_until(self.tick(), wake_ns);
    }

    fn now_ns(&self) -> u64 {
        self.time.now_ns(self.tick())
    }

    fn rules(&self) -> Option<RulesReport> {
        Some(self.plan.borrow().report())
    }

    fn refusals(&self) -> Option<Rc<Refusals>> {
        Some(self.plan.borrow().refusals())
    }

    fn follow_lines(&self, ends: Rc<LineEnds>) -> bool {
        self.with_plan(|plan| plan.follow_lines(ends));
        true
    }

    fn state(&self) -> &Self {
        self
    }
}

impl MotionState for RulesReader {
    fn tick(&self) -> u64 {
        self.own.tick() + self.plan.borrow().ticks()
    }

    /// Plans to the end: without steps the machine stops at the end of its moves.
    fn stop(&self) {
        self.come_to_rest();
        self.own.stop();
    }

    fn fan_demand(&self) -> FanDemand {
        self.own.fan_demand()
    }

    fn enabled_motors(&self) -> u8 {
        self.own.enabled_motors()
    }

    /// The other firmware's planner has no such kind.
    fn plan_block_by_block(&self) -> bool {
        false
    }

    fn figures(&self) -> Figures {
        let own = self.own.figures();
        Figures { motion_time_s: own.motion_time_s + self.plan.borrow().seconds(), ..own }
    }
}
