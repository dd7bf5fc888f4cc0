//! The printer's ports, like the firmware's.

use std::cell::{Cell, RefCell};

use embedded_hal_async::delay::DelayNs;
use ferrostep_gcode::Reply;
use ferrostep_hal_shim::Heater;
use ferrostep_papers::Papers;
use ferrostep_planner::look_ahead::Slot;
use ferrostep_printer::SharedMachine;
use ferrostep_printer::heat::HeatFault;
use ferrostep_printer::machine::Silence;
use ferrostep_printer::{Failure, HeaterStatus, Heating, Replies};
use ferrostep_step_player::Stepping;
use ferrostep_virtual_board::{ModelledSensors, VirtualDelay};

use super::{Board, BoardMachine, Queue};

/// Interval at which a command that waits for motion looks whether it has ended, ms.
const LOOK_MS: u32 = 1;

impl<'a, M: Stepping> SharedMachine for &Board<'a, M> {
    type Ring = Vec<Slot>;
    type Queue = ModelledSensors<Queue<'a, M>>;
    type Methods = Papers;
    type Servo = ferrostep_printer::Present;
    type ZMotors = ferrostep_printer::Present;
    type Tools = ferrostep_printer::Present;
    type Backlash = ferrostep_printer::Present;
    type SupplySignal = ferrostep_printer::Present;

    fn with<T>(&self, act: impl FnOnce(&mut BoardMachine<'a, M>) -> T) -> T {
        act(&mut self.machine.borrow_mut())
    }

    fn wake_planner(&self) {
        self.plan();
    }

    fn work(&self) {
        Board::work(self, Silence::default());
    }

    fn is_halted(&self) -> bool {
        self.interrupts.signals().is_halted()
    }

    async fn pause(&self) {
        VirtualDelay(&self.clock).delay_ms(LOOK_MS).await;
    }
}

/// Heaters without mains: they stay at the temperature of the room, and files must
/// allow that (M302).
#[derive(Debug, Default)]
pub struct ColdHeaters {
    targets_celsius: [f32; Heater::COUNT],
}

/// Temperature of the room, degrees Celsius.
const ROOM_CELSIUS: f32 = 22.0;

impl Heating for ColdHeaters {
    type Supply = ferrostep_printer::Present;
    type Models = ferrostep_printer::Present;

    fn set_target(&mut self, heater: Heater, celsius: f32) {
        self.targets_celsius[heater.index()] = celsius;
    }

    fn status(&self, heater: Heater) -> HeaterStatus {
        HeaterStatus { celsius: ROOM_CELSIUS, target_celsius: self.targets_celsius[heater.index()], power: 0.0 }
    }

    fn all_off(&mut self) {
        *self = Self::default();
    }

    fn restart(&mut self) -> Result<(), HeatFault> {
        Ok(())
    }
}

/// All lines to the host but `ok`, and the number of those.
#[derive(Debug, Default)]
pub struct Transcript(pub RefCell<Vec<String>>, pub Cell<u32>);

impl Replies for Transcript {
    fn send(&self, reply: Reply<'_>) {
        let is_ok = matches!(reply, Reply::Ok | Reply::OkTemperatures(_) | Reply::Resend { .. });
        self.1.set(self.1.get() + u32::from(is_ok));
        if !matches!(reply, Reply::Ok) {
            self.0.borrow_mut().push(reply.to_string());
        }
    }

    /// The failure is returned as well.
    fn refuse(&self, _line: u32, _failure: &Failure) {}
}
