//! A port with four motors on it that count.

use core::cell::Cell;

use ferrostep_step_player::VirtualUpdateTimer;
use ferrostep_step_player::{MotorPins, OutputPorts, Pin, PinMap};

/// Motors on one port: step signals on pins 0 to 3, directions on 4 to 7.
#[derive(Debug)]
pub struct VirtualPort<'a> {
    timer: &'a VirtualUpdateTimer,
    both_edges: bool,
    level: Cell<u16>,
    motor_steps: Cell<[i64; 4]>,
    events: Cell<u64>,
    last_cycle: Cell<u64>,
    shortest_cycles: Cell<u64>,
}

impl<'a> VirtualPort<'a> {
    /// All signals low. A step is each edge, or the rising one.
    pub fn new(timer: &'a VirtualUpdateTimer, both_edges: bool) -> Self {
        Self {
            timer,
            both_edges,
            level: Cell::new(0),
            motor_steps: Cell::new([0; 4]),
            events: Cell::new(0),
            last_cycle: Cell::new(0),
            shortest_cycles: Cell::new(u64::MAX),
        }
    }

    /// Pins of the motors.
    pub const fn pins() -> PinMap<1> {
        let mut motors = [MotorPins { step: Pin { port: 0, number: 0 }, direction: Pin { port: 0, number: 4 } }; 4];
        let mut motor = 1;
        while motor < 4 {
            motors[motor] = MotorPins {
                step: Pin { port: 0, number: motor as u8 },
                direction: Pin { port: 0, number: motor as u8 + 4 },
            };
            motor += 1;
        }
        match PinMap::new(motors) {
            Some(map) => map,
            None => unreachable!(),
        }
    }

    /// Positions of the motors, steps.
    pub fn motor_steps(&self) -> [i64; 4] {
        self.motor_steps.get()
    }

    /// Moments at which motors stepped.
    pub fn events(&self) -> u64 {
        self.events.get()
    }

    /// The shortest time between two of them, cycles.
    pub fn shortest_cycles(&self) -> u64 {
        self.shortest_cycles.get()
    }
}

impl OutputPorts<1> for VirtualPort<'_> {
    fn write(&self, _port: usize, word: u32) {
        let level = self.level.get() & !((word >> 16) as u16) | word as u16;
        let before = self.level.replace(level);
        let stepped = if self.both_edges { level ^ before } else { level & !before } & 0b1111;
        if stepped == 0 {
            return;
        }
        let mut motor_steps = self.motor_steps.get();
        for (motor, steps) in motor_steps.iter_mut().enumerate() {
            *steps += i64::from(stepped >> motor & 1) * (1 - 2 * i64::from(level >> (motor + 4) & 1));
        }
        self.motor_steps.set(motor_steps);
        let now = self.timer.now_cycles();
        if self.events.get() > 0 {
            self.shortest_cycles.set(self.shortest_cycles.get().min(now - self.last_cycle.get()));
        }
        self.last_cycle.set(now);
        self.events.set(self.events.get() + 1);
    }
}
