//! The smallest machine that takes moves: it is always warm, never waits and never replies.

use core::cell::RefCell;
use core::future::Future;
use core::pin::pin;
use core::sync::atomic::{AtomicU32, Ordering};
use core::task::{Context, Poll, Waker};

use embedded_hal_async::delay::DelayNs;
use ferrostep_gcode::{MotionFigures, Reply};
use ferrostep_hal_shim::{Clock, FanOutput, Heater};
use ferrostep_papers::Papers;
use ferrostep_planner::look_ahead::Slot;
use ferrostep_planner::{
    ChoiceError, Limits, MotionChoice, Move, Moved, Planner, PressureAdvance, Request, StepsPerMm,
};
use ferrostep_printer::heat::HeatFault;
use ferrostep_printer::{HeaterStatus, Heating, HomingOutcome, Motion, MotionError, Printer, Replies};

/// The planner, its look-ahead ring in borrowed memory.
pub type BenchPlanner<'a> = Planner<&'a mut [Slot], Papers>;

/// Warm enough to extrude.
const CELSIUS: f32 = 210.0;

/// Takes the printer's moves straight into the planner.
#[derive(Clone, Copy)]
pub struct Machine<'a, 's> {
    /// The planner.
    pub planner: &'a RefCell<BenchPlanner<'s>>,
}

impl Motion for Machine<'_, '_> {
    type Bed = ferrostep_planner::surface::NoBed;
    type Servo = ferrostep_printer::Absent;
    type ZMotors = ferrostep_printer::Absent;
    type Tools = ferrostep_printer::Absent;
    type Backlash = ferrostep_printer::Absent;
    type SupplySignal = ferrostep_printer::Absent;

    async fn add(&mut self, request: impl Request) -> Result<Moved, MotionError> {
        self.planner.borrow_mut().add(&request).map_err(MotionError::Move)
    }

    fn try_add(&mut self, request: &impl Request) -> Option<Result<Moved, MotionError>> {
        Some(self.planner.borrow_mut().add(request).map_err(MotionError::Move))
    }

    async fn set_pressure_advance(&mut self, advance: &PressureAdvance) -> Result<bool, MotionError> {
        self.planner.borrow_mut().set_pressure_advance(advance).map_err(MotionError::Move)
    }

    async fn set_fan_power(&mut self, _fan: FanOutput, _power: u8) -> Result<(), MotionError> {
        Ok(())
    }

    async fn finish(&mut self) -> Result<(), MotionError> {
        self.planner.borrow_mut().flush();
        Ok(())
    }

    /// Sensors that all trigger at 0, where the machine is without a step.
    async fn seek(&mut self, _request: Move, axis: usize) -> Result<HomingOutcome, MotionError> {
        let mut position_10nm = self.position_10nm();
        if let Some(coordinate_10nm) = position_10nm.get_mut(axis) {
            *coordinate_10nm = 0;
        }
        self.set_position(position_10nm);
        Ok(HomingOutcome::Triggered)
    }

    fn position_10nm(&self) -> [i64; 3] {
        self.planner.borrow().position_10nm()
    }

    fn set_position(&mut self, position_10nm: [i64; 3]) {
        self.planner.borrow_mut().set_position(position_10nm);
    }

    fn motor_steps(&self) -> [i64; 4] {
        [0; 4]
    }

    fn figures(&self) -> MotionFigures {
        MotionFigures::default()
    }

    fn limits(&self) -> Limits {
        *self.planner.borrow().limits()
    }

    fn set_limits(&mut self, limits: Limits) {
        self.planner.borrow_mut().set_limits(limits);
    }

    fn motion_choice(&self) -> MotionChoice {
        *self.planner.borrow().motion_choice()
    }

    fn set_motion_choice(&mut self, choice: &MotionChoice) -> Result<(), ChoiceError> {
        self.planner.borrow_mut().set_motion_choice(choice)
    }

    fn extruder_steps_per_mm(&self) -> StepsPerMm {
        self.planner.borrow().extruder_steps_per_mm()
    }

    fn set_extruder_steps_per_mm(&mut self, steps_per_mm: StepsPerMm) -> Result<(), ChoiceError> {
        self.planner.borrow_mut().set_extruder_steps_per_mm(steps_per_mm)
    }

    fn set_motors_enabled(&mut self, _axes: u8, _enabled: bool) {}

    fn is_end_stop_triggered(&self, _axis: usize) -> bool {
        false
    }

    fn stop(&mut self) -> i64 {
        0
    }
}

impl Heating for Machine<'_, '_> {
    type Supply = ferrostep_printer::Present;
    type Models = ferrostep_printer::Absent;

    fn set_target(&mut self, _heater: Heater, _celsius: f32) {}

    fn status(&self, _heater: Heater) -> HeaterStatus {
        HeaterStatus { celsius: CELSIUS, target_celsius: CELSIUS, power: 0.0 }
    }

    fn all_off(&mut self) {}

    fn restart(&mut self) -> Result<(), HeatFault> {
        Ok(())
    }
}

/// Time that passes when it is asked for, so that every wait ends.
#[derive(Clone, Copy)]
pub struct QuickTime;

/// Seconds so far.
static NOW_S: AtomicU32 = AtomicU32::new(0);

impl Clock for QuickTime {
    fn now_ms(&self) -> u64 {
        u64::from(NOW_S.fetch_add(1, Ordering::Relaxed)) * 1000
    }
}

impl DelayNs for QuickTime {
    async fn delay_ns(&mut self, _ns: u32) {}
}

/// Drops all replies.
pub struct NoReplies;

impl Replies for NoReplies {
    fn send(&self, _reply: Reply<'_>) {}
}

/// A printer on such a machine.
pub type BenchPrinter<'a, 's> = Printer<'a, (Machine<'a, 's>, Machine<'a, 's>, QuickTime, NoReplies)>;

/// Executes a line that needs no waiting.
///
/// # Errors
/// The line was refused, or waits.
pub fn execute(printer: &mut BenchPrinter<'_, '_>, text: &str) -> Result<(), &'static str> {
    match pin!(printer.execute(0, text)).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(Ok(())) => Ok(()),
        Poll::Ready(Err(_)) => Err("a line was refused"),
        Poll::Pending => Err("a line waits, with nothing to wait for"),
    }
}
