//! The levels that the chip drives at its pins, from the ports' registers.

use rigless::device::RegisterFile;
use rigless::soc::stm32f427::generated::gpioa::Register;

use crate::chip::Stm32f4;
use crate::pins::Pin;
use crate::plant::{Plant, Switched};
use crate::wiring::Board;

/// Number of ports: A to I.
pub const COUNT: usize = 9;
/// First address of the ports' registers, 1 KiB each (RM0090 2.3).
const BASE: u64 = 0x4002_0000;
const SPACING: u64 = 0x400;

/// Modes of a pin, RM0090 8.4.1.
const OUTPUT: u64 = 0b01;
const ALTERNATE: u64 = 0b10;

/// The watched pins and their last driven levels.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct Ports {
    watched: [u16; COUNT],
    steps: [u16; COUNT],
    driven: [u16; COUNT],
    high: [u16; COUNT],
}

impl Ports {
    /// Watches the pins of the plant and the motors' signals.
    pub fn new(board: &Board, plant: &Plant) -> Self {
        let mut ports = Self { watched: [0; COUNT], steps: [0; COUNT], driven: [0; COUNT], high: [0; COUNT] };
        for port in 0..COUNT {
            for number in 0..16 {
                let pin = Pin { port: port as u8, number };
                let of_a_motor =
                    board.motors.iter().any(|motor| [motor.step, motor.direction, motor.enable].contains(&pin));
                if plant.listens_to(pin) || of_a_motor {
                    ports.watched[port] |= 1 << number;
                }
                if board.motors.iter().any(|motor| motor.step == pin) {
                    ports.steps[port] |= 1 << number;
                }
            }
        }
        ports
    }

    /// True if a pin is a step signal.
    pub fn is_step(&self, pin: Pin) -> bool {
        self.steps[usize::from(pin.port)] & 1 << pin.number != 0
    }

    /// The port of a register.
    pub fn at(address: u64) -> Option<usize> {
        let port = usize::try_from(address.checked_sub(BASE)? / SPACING).ok()?;
        (port < COUNT).then_some(port)
    }

    /// Watched pins of a port that changed: the pin, its level (`None` when the chip stops driving
    /// it), and whether the change is an edge. The driver's own resistor holds a floating pin low,
    /// so a pin that becomes a low output makes no edge.
    pub fn changes(&mut self, port: usize, registers: &RegisterFile) -> Vec<(Pin, Option<bool>, bool)> {
        let (modes, levels) = (registers.get(Register::Moder), registers.get(Register::Odr) as u16);
        let mut driven = 0u16;
        for number in 0..16 {
            driven |= u16::from(modes >> (2 * number) & 0b11 == OUTPUT) << number;
        }
        let high = levels & driven;
        let edges = high ^ self.high[port];
        let changed = ((driven ^ self.driven[port]) | edges) & self.watched[port];
        self.driven[port] = driven;
        self.high[port] = high;
        (0..16)
            .filter(|number| changed & 1 << number != 0)
            .map(|number| {
                let level = (driven & 1 << number != 0).then_some(high & 1 << number != 0);
                (Pin { port: port as u8, number }, level, edges & 1 << number != 0)
            })
            .collect()
    }

    /// The share of power that a timer passes through a pin, 0 to 1; `None` if no
    /// timer drives the pin.
    pub fn timer_power(&self, chip: &Stm32f4, switched: Switched) -> Option<f64> {
        let timer = switched.timer?;
        let registers = chip.port_registers(usize::from(switched.pin.port))?;
        let mode = registers.get(Register::Moder) >> (2 * switched.pin.number) & 0b11;
        let (functions, place) = match switched.pin.number {
            number @ 0..=7 => (Register::Afrl, number),
            number => (Register::Afrh, number - 8),
        };
        let function = registers.get(functions) >> (4 * place) & 0b1111;
        if mode != ALTERNATE || Some(function) != timer.alternate_function().map(u64::from) {
            return None;
        }
        Some(chip.duty(timer.timer, timer.channel).unwrap_or(0.0))
    }
}
