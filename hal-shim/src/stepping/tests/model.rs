//! A board of the tests: its pins, and a port that notes its edges.

use std::cell::{Cell, RefCell};
use std::rc::Rc;

use crate::stepping::*;
pub use crate::virtual_board::CYCLES_A_TICK;
use crate::virtual_board::VirtualUpdateTimer;

/// Step pins 0 to 3, direction pins 4 to 7.
pub fn pins<const PORTS: usize>() -> PinMap<PORTS> {
    let motors = std::array::from_fn(|motor| MotorPins {
        step: Pin { port: motor % PORTS, number: motor as u8 },
        direction: Pin { port: (motor + 1) % PORTS, number: motor as u8 + 4 },
    });
    PinMap::new(motors).unwrap()
}

pub const SIGNALS: Signals = Signals { pulse_ticks: 8, direction_setup_ticks: 16 };

/// A port's levels over time, in cycles.
#[derive(Default)]
pub struct Edges {
    timer: Rc<VirtualUpdateTimer>,
    level: Cell<u16>,
    log: RefCell<Vec<(u64, u16)>>,
}

impl Edges {
    pub fn of(timer: &Rc<VirtualUpdateTimer>) -> Self {
        Self { timer: timer.clone(), ..Self::default() }
    }

    /// Time, level and the step pins that changed, for every change of a step pin.
    pub fn changes(&self) -> Vec<(u64, u16, u16)> {
        let mut before = 0;
        let mut changes = Vec::new();
        for &(now, level) in self.log.borrow().iter() {
            let changed = (level ^ before) & 0b1111;
            before = level;
            if changed != 0 {
                changes.push((now, level, changed));
            }
        }
        changes
    }

    /// Every level and since when.
    pub fn levels(&self) -> Vec<(u64, u16)> {
        self.log.borrow().clone()
    }

    /// Signed steps of the four motors where both edges step.
    pub fn steps(&self) -> [i32; 4] {
        let mut steps = [0; 4];
        for (_, level, changed) in self.changes() {
            for (motor, steps) in steps.iter_mut().enumerate() {
                *steps += i32::from(changed >> motor & 1) * (1 - 2 * i32::from(level >> (motor + 4) & 1));
            }
        }
        steps
    }
}

impl OutputPort for Edges {
    fn write(&self, word: u32) {
        let level = self.level.get() & !((word >> 16) as u16) | word as u16;
        if level != self.level.replace(level) {
            self.log.borrow_mut().push((self.timer.now_cycles(), level));
        }
    }
}

/// Memory for a feeder's accounts.
pub fn accounts<const N: usize>() -> &'static mut [SlotSteps; N] {
    Box::leak(Box::new([SlotSteps::NONE; N]))
}
