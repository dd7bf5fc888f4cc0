//! A test board: its pins, and a port that records its edges.

use std::cell::{Cell, RefCell};
use std::ops::Range;
use std::rc::Rc;

use ferrostep_planner::StepEntry;
use proptest::prelude::*;

pub use crate::CYCLES_A_TICK;
use crate::*;

/// Step pins 0 to 3, direction pins 4 to 7.
pub fn pins<const PORTS: usize>() -> PinMap<PORTS> {
    let motors = std::array::from_fn(|motor| MotorPins {
        step: Pin { port: motor % PORTS, number: motor as u8 },
        direction: Pin { port: (motor + 1) % PORTS, number: motor as u8 + 4 },
    });
    PinMap::new(motors).unwrap()
}

/// Stairs at an interval, with at least one motor in the last event.
pub fn any_stair(ticks: Range<u32>) -> impl Strategy<Value = StepEntry> {
    (ticks, 1u16..70, 1u8..16, 0u8..15).prop_map(|(ticks, count, axes, other)| {
        let added = if other < axes { other } else { other + 1 };
        StepEntry::stair(ticks, count, axes, added).unwrap()
    })
}

pub const SIGNALS: Signals = Signals { pulse_ticks: 84, direction_setup_ticks: 84 };

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

    /// Every level with the time at which it began.
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

impl<const PORTS: usize> OutputPorts<PORTS> for [Edges; PORTS] {
    fn write(&self, port: usize, word: u32) {
        self[port].put_out(word);
    }
}

impl Edges {
    pub fn put_out(&self, word: u32) {
        let level = self.level.get() & !((word >> 16) as u16) | word as u16;
        if level != self.level.replace(level) {
            self.log.borrow_mut().push((self.timer.now_cycles(), level));
        }
    }
}

/// A player with everything that its interrupt needs.
pub struct Interrupt<M, const PORTS: usize, const N: usize> {
    pub player: StepPlayer<M, PORTS, N>,
    pub timer: Rc<VirtualUpdateTimer>,
    pub ports: [Edges; PORTS],
    next: RefCell<NextWords<PORTS>>,
}

impl<M: Stepping, const PORTS: usize, const N: usize> Interrupt<M, PORTS, N> {
    pub fn leaked() -> &'static Self {
        let timer = Rc::new(VirtualUpdateTimer::default());
        let ports = std::array::from_fn(|_| Edges::of(&timer));
        let (player, next) = (StepPlayer::new(), RefCell::new(NextWords::NONE));
        Box::leak(Box::new(Self { player, timer, ports, next }))
    }

    pub fn feeder(&'static self, signals: Signals) -> StepFeeder<'static, M, PORTS, N> {
        StepFeeder::new(&self.player, pins::<PORTS>(), signals)
    }

    /// Runs the interrupt, whatever called it.
    pub fn call(&self) {
        self.timer.interrupt(&self.player, &mut self.next.borrow_mut(), &self.ports);
    }

    /// Advances time to the next update, which is served unless the interrupt is masked.
    pub fn update(&self) {
        self.timer.next_update();
        if self.timer.is_called() {
            self.call();
        }
    }

    /// Starts a motion as the producer does. Returns true if there was one to start.
    pub fn start(&self, feeder: &mut StepFeeder<'_, M, PORTS, N>) -> bool {
        let starts = feeder.start();
        if starts {
            self.start_or_end();
        }
        starts
    }

    /// Runs the interrupt for start and end.
    pub fn start_or_end(&self) {
        self.player.start_or_end(&mut self.next.borrow_mut(), &*self.timer);
    }

    /// Stops motion as another task would.
    pub fn stop(&self) {
        self.timer.mask();
        self.player.link().request_stop();
    }
}
